"""What a viewport shows: scenes and cameras are sent as they change, and pictures are kept as they come."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from typing import Any

from .bundle import NoRendererError, NotYetError
from .changes import Sent, same
from .process import POOL, Renderer
from .reading.cameras import CAMERA
from .reading.kept import Kept
from .reading.prims import Prim
from .reading.scene import SceneReader


class Viewport:
    """A renderer that follows a scene and a camera.

    Attributes
    ----------
    picture
        The last picture, (H, W, 4) from the top row down; None: there is none yet.
    text
        What it shows, or why there is none.
    """

    def __init__(self) -> None:
        self.picture: Any = None
        self.text = "Starting the renderer"
        self._folder = tempfile.TemporaryDirectory(prefix="photonbeams")
        self._kept = Kept(self._folder.name)
        self._renderer: Renderer | None = None
        self._sent, self._shown = Sent(), dict[str, Any]()
        self._prims: list[dict[str, Any]] | None = None  # None: the scene cannot be read
        self._is_read = False  # whether the prims are those of the scene as it is
        self._awaited: int | None = None  # the view whose first picture has not come
        self._waits = False  # whether there was not yet a renderer
        self._failures = 0  # renderers in a row that ended before they showed something
        self._warnings: list[str] = []
        self._told = set[str]()

    def change(self, updates: Any) -> None:
        """Note that the scene has changed, by the updates of its depsgraph."""
        self._kept.forget(updates)
        self._is_read, self._failures = False, 0

    def show(self, depsgraph: Any, python: str, camera: Prim, view: dict[str, Any]) -> None:
        """Send what has changed, unless the first picture of what was sent before is still to come.

        Parameters
        ----------
        depsgraph, python
            What Blender has evaluated, and the Python that is chosen.
        camera
            The prim of the camera.
        view
            Width, height and other fields of the renderer's `SessionView`.
        """
        if self._awaited is not None or self._failures > 1:
            return
        wanted = {**view, "pose": camera.matrix.T.tolist()}
        fixed = replace(camera, matrix=None).described()  # a camera that only moves leaves the scene as it is
        if not self._is_read:
            self._is_read = True
            try:
                self._prims = SceneReader(depsgraph, self._kept, self._warn).prims()
            except Exception as error:  # of any kind: it would come again with each redraw
                self.text = f"the scene could not be read: {type(error).__name__}: {error}"[:300]
                self._prims = None
        if self._prims is None:
            return
        try:
            if self._renderer is None:
                self._renderer, self._sent, self._shown = POOL.take(python), Sent(), {}
            changes = self._sent.changes([*self._prims, fixed])
            if not changes and same(self._shown, wanted):
                return
            if changes:
                self._renderer.send("scene", **changes)
            self._renderer.rendered += 1
            self._awaited, self._shown = self._renderer.rendered, wanted
            self._renderer.send("view", number=self._awaited, camera=CAMERA, view=wanted)
        except NotYetError as error:
            self.text, self._waits = str(error), True
        except NoRendererError as error:
            self._fail(error)

    def poll(self) -> bool:
        """Take what the renderer has sent; return whether there is something new to be drawn."""
        new, self._waits = self._waits, False
        try:
            while self._renderer is not None and (message := self._renderer.receive(0)) is not None:
                new |= self._take(message)
        except NoRendererError as error:
            self._fail(error)
            return True
        return new

    def _take(self, message: dict[str, Any]) -> bool:
        assert self._renderer is not None
        if message["is"] == "warning":
            self._warn(message["text"])
            return True
        if message.get("number") != self._renderer.rendered:
            return False  # of an earlier view
        if message["is"] == "picture":
            self.picture = message["layers"]["rgba"]
            self._awaited, self._failures = None, 0
            height, width = self.picture.shape[:2]
            size = f"{width} × {height}"
            if message["scale"] < 1:
                size += f" of {self._shown['width']} × {self._shown['height']}"
            self.text = f"Pass {message['done']} of {message['planned']} | {size}"
        elif message["is"] == "end":
            self._awaited = None
            if message["problem"]:
                self.text = message["problem"]
        return True

    def warnings(self) -> list[str]:
        """Return the warnings since the last call; each is given once."""
        found, self._warnings = self._warnings, []
        return found

    def _warn(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._warnings.append(text)

    def _fail(self, error: NoRendererError) -> None:
        """Say why there is no renderer; the next call of `show` starts another one, unless two have failed."""
        self.text, self._awaited = str(error), None
        self._failures += 1
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None

    def close(self) -> None:
        """Leave the renderer to others."""
        if self._renderer is not None:
            POOL.give(self._renderer)
        self._renderer = None
        self._folder.cleanup()
