"""Sessions: a shot, edits of it, and the pictures that follow each edit."""

from __future__ import annotations

import atexit
import logging
import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from ..images.frame import pixels_of
from ..runtime.files import PathLike
from ..scene import Camera, SceneError
from ..shot.shot import Shot
from ..shot.subject import Viewpoint, several
from ..usd.authoring.controls import Controls, controls_of
from ..usd.authoring.editing import EditLayer
from ..usd.authoring.library import LookLibrary
from ..usd.authoring.presets import BEAM, apply_preset
from ..usd.cameras.stereo import check_stereo, is_eye
from ..usd.layers.frames import time_range
from ..usd.stage import list_cameras, up_axis
from .edits import Edits, IfChanged
from .final import Wanted, file_beside, flags_of
from .inspector import Inspected, inspected
from .live import Cancelled
from .pictures import Picture, Problem, SessionView
from .viewing import LivePictures, between, checked_pose

#: A listener; it is called in the thread that renders.
Told = Callable[[Picture | Problem], None]

T = TypeVar("T")


class Session:
    r"""A shot that is rendered while it is edited: first a quick small picture, then a whole one, then more passes.

    Rendering runs in a thread of its own. An edit or a change of view cancels the present picture between two phases of
    a pass, unless it is a quick first picture. The finished picture has the bits that `Shot.render` gives with as many
    passes and with the edits as a layer over the stage.

    Parameters
    ----------
    path
        A USD file.
    camera
        Path or name of the camera; None, the default: as for `Shot.open`.
    layer
        The file of the edits: they are read from it, and `edits.save()` writes it. Edits that are not saved are kept in
        an autosave beside it. None, the default: edits are kept in memory.
    view
        What is shown at first, a `SessionView`. Default: 480 x 270 pixels, 64 passes.
    looks
        The folder of the look library. Default: `looks` beside the stage.
    **given
        Further arguments of `Shot.open`.

    Attributes
    ----------
    shot, edits, view, looks
        The `Shot`, its `Edits` (`edits.save(path)` writes them), what is shown, and the look library.
    version
        The number of the last edit or change of view.

    Raises
    ------
    SceneError
        A stage, a camera, a layer or a view that cannot be used; a Mitsuba scene.

    Examples
    --------
    >>> with pb.studio.Session("shot.usda") as session:
    ...     session.show(paused=True)
    ...     session.edit({"/Lamp.inputs:intensity": 20.0})
    ...     session.edits.paths()
    1
    2
    ['/Lamp.inputs:intensity']
    """

    def __init__(
        self, path: PathLike, camera: str | None = None, layer: PathLike | None = None, view: SessionView | None = None,
        looks: PathLike | None = None, **given: Any,
    ) -> None:  # fmt: skip
        if Path(path).suffix.lower() == ".xml":
            raise SceneError(
                f"{path} is a Mitsuba scene, which the studio cannot edit: expected a USD stage; `photonbeams render` "
                "renders it, with --session-layer for looks and --set for parameters"
            )
        stereo = given.pop("stereo", None)
        self.shot = Shot.open(path, camera, **given)
        self._path, self._camera = Path(path), camera
        self.looks = LookLibrary(Path(looks or self._path.with_name("looks")))
        self._layers = [str(each) for each in several(given.get("session_layers", ()))]
        self._overrides = [str(each) for each in several(given.get("overrides", ()))]
        self.edits = Edits(EditLayer(self.shot.stage), layer)
        self.view = view or SessionView()
        if stereo is not None:
            self.view = replace(self.view, stereo=stereo)
        self.version = 0
        self._listeners: list[Told] = []
        self._lock = threading.RLock()  # of the stage and the view
        self._live = LivePictures(self.shot, self._viewpoint, self.edits.paths, self._lock)
        self._changed = threading.Condition(self._lock)
        self._closed = False
        self._check(self.view)
        self._thread = threading.Thread(target=self._run, name="studio", daemon=True)
        self._thread.start()
        atexit.register(self.close)  # an interpreter that ends while kernels run would abort

    def listen(self, told: Told) -> Callable[[], None]:
        """Call `told` with each `Picture`, or the `Problem` why there is none; return a function that ends this."""
        with self._lock:
            self._listeners.append(told)

        def end() -> None:
            with suppress(ValueError):
                self._listeners.remove(told)

        return end

    def edit(self, values: Mapping[str, Any], step: str | None = None) -> int:
        """Set values, and return the version that will show them.

        Parameters
        ----------
        values
            Values by the paths of attributes, "/Prim.attribute"; None leaves one to the stage again.
        step
            Edits in a row with the same `step`, such as those of a drag, are undone together.

        Raises
        ------
        SceneError
            A prim or an attribute that does not exist, or a value of another type; then nothing is set.
        """
        with self._lock:
            self.edits.set(values, step)
            return self._new()

    def apply(self, preset: str, path: str) -> str:
        """Apply a preset to a look, or give a light a new look with it; return the look's path.

        Parameters
        ----------
        preset
            The name of one of `usd.authoring.presets.PRESETS`, or of a look of the library.
        path
            The path of the look or of the light.

        Raises
        ------
        SceneError
            No such preset; a prim that is neither a look nor a light, or that cannot have a look.
        """
        wanted = self.looks.preset(preset)

        def apply_to(layer: EditLayer) -> str:
            return apply_preset(self.shot.stage, layer, wanted, path, self._size() / BEAM)

        return self._changed_by(lambda: self.edits.change(apply_to))

    def keep_look(self, path: str) -> str:
        """Write the look at `path` to the library as a new file, and return its name there; SceneError if it cannot."""
        with self._lock:
            return self.looks.keep(self.shot.stage, path).label

    def _size(self) -> float:
        """Return roughly how long the stage's beams are: the radius of its bounding sphere."""
        found = self._live.scene()
        if found is None:  # there is no picture yet
            exposure = self.shot.subject.exposure(self._viewpoint(self.view), self.view.frame, blur=False, lens=True)
            found = exposure(0.0)[0]
        return BEAM if found.bounds is None else float(found.bounds[1])

    def undo(self) -> bool:
        """Undo the last step; return whether there was one."""
        return self._changed_by(self.edits.undo)

    def redo(self) -> bool:
        """Redo the step that was undone last; return whether there was one."""
        return self._changed_by(self.edits.redo)

    def revert(self) -> None:
        """Remove all edits, so that all values are the stage's own again."""
        self._changed_by(self.edits.revert)

    def discard(self) -> None:
        """Go back to the edits that were saved last."""
        self._changed_by(self.edits.discard)

    def save(self, changed: IfChanged = "ask") -> Path:
        """Write the edits to their file, and return it; `changed` is that of `Edits.save`."""
        if changed != "merge":
            return self.edits.save(changed=changed)
        return self._changed_by(lambda: self.edits.save(changed=changed))

    def show(self, **changes: Any) -> int:
        """Change the view, and return the version that will show it.

        Parameters
        ----------
        **changes
            Fields of `SessionView`: width, height, frame, camera, pose, area, lens, blur, solo, paused, passes, stereo,
            denoise, bounces.

        Raises
        ------
        SceneError
            A size, an area, a frame or a camera that cannot be shown; then nothing is changed.
        """
        with self._lock:
            view = replace(self.view, **changes)
            self._check(view)
            self.view = view if view.pose is None else replace(view, pose=checked_pose(view.pose))
            return self._new()

    def _check(self, view: SessionView) -> None:
        """Raise SceneError for a view that cannot be shown."""
        view.check()
        if view.camera is not None and view.camera not in self.cameras():
            raise SceneError(f"there is no camera {view.camera!r}: expected one of {', '.join(self.cameras())}")
        check_stereo(view.stereo)
        if view.stereo is not None:
            self.shot.subject.cameras(self._viewpoint(view), view.frame)
        self.shot.resolution(view.width, view.height)
        pixels_of(view.area, view.width, view.height)
        frames = self.frames()
        if view.frame is not None and frames is None:
            raise SceneError(f"the frame is {view.frame}, but the stage has no range of frames: expected none")
        if view.frame is not None and frames is not None and not frames[0] <= view.frame <= frames[1]:
            raise SceneError(f"the frame is {view.frame}: expected {frames[0]:g} to {frames[1]:g}")

    @property
    def name(self) -> str:
        """The name of the stage's file."""
        return self._path.name

    def controls(self) -> list[Controls]:
        """Return what can be edited, with present values."""
        with self._lock:
            return controls_of(self.shot.stage, self.shot.time(self.view.frame))

    def inspect(self, at: tuple[float, float], depth: float | None = None) -> Inspected:
        """Return the beams in a pixel by light, and how the brightest one is integrated: see `inspector.inspected`.

        Parameters
        ----------
        at
            The pixel's place in the picture, in fractions from the top left.
        depth
            The planar depth of the first surface there; None: there is none.
        """
        with self._lock:
            frame = self._live.frame()
            if frame is None or not all(0 <= each <= 1 for each in at):
                return [], None
            return inspected(frame, at, depth)

    def wanted(
        self, passes: int, frames: tuple[float, float] | None = None, size: tuple[int, int] | None = None,
        denoise: bool = False, file: PathLike | None = None,
    ) -> Wanted:  # fmt: skip
        """Return what a final render of the present view needs.

        Parameters
        ----------
        passes
            The number of passes.
        frames
            The first and the last frame; None: the view's frame.
        size, denoise
            Width and height in pixels, None: those of the view; and whether the picture is denoised.
        file
            Where the picture is written, from the stage's folder and within it; None: in a temporary folder.

        Raises
        ------
        SceneError
            Passes, frames or a size out of range; a file elsewhere; a free camera, which the stage does not have.
        """
        view = self.view if size is None else replace(self.view, width=size[0], height=size[1])
        if view.pose is not None:
            raise SceneError("the camera was moved freely: expected a camera of the stage")
        first, last = (view.frame, view.frame) if frames is None else frames
        self._check(replace(view, passes=passes, frame=first))
        self._check(replace(view, passes=passes, frame=last))
        both = None if first is None or last is None else (first, last)
        if both is not None and both[0] > both[1]:
            raise SceneError(f"the frames are {both[0]:g} to {both[1]:g}: expected the first before the last")
        target = None if file is None else file_beside(self._path, file, first is not None)
        flags = [word for each in self._layers for word in ("--session-layer", each)]
        flags += [word for each in self._overrides for word in ("--set", each)]
        bounces, camera = self._live.bounces(view), self._viewpoint(view).camera
        flags += [*flags_of(replace(view, passes=passes, bounces=bounces, camera=camera, denoise=denoise))]
        return Wanted(self._path, self.edits.text(), flags, both, target)

    def resting(self) -> AbstractContextManager[None]:
        """Return a context in which pictures get no further passes; the first ones after edits come as always."""
        return self._live.resting()

    def bounces(self) -> tuple[int, int]:
        """Return the bounces of the present view, as `--bounces`, and those that the stage or a room usually has."""
        live, chosen = self._live, self._live.bounces(self.view)
        return live.own_bounces if chosen is None else chosen, live.usual_bounces

    def cameras(self) -> list[str]:
        """Return the paths of the stage's cameras."""
        with self._lock:
            return list_cameras(self.shot.stage)

    def frames(self) -> tuple[float, float] | None:
        """Return the stage's first and last frame, or None if it has no range of frames."""
        return time_range(self.shot.stage)

    def rate(self) -> float:
        """Return the number of frames per second."""
        return float(self.shot.stage.GetFramesPerSecond())

    def up(self) -> Literal["Y", "Z"]:
        """Return the stage's up axis, "Y" or "Z"."""
        return "Z" if up_axis(self.shot.stage)[2] else "Y"

    def camera(self) -> Camera:
        """Return the camera as the stage has it at the view's frame; for two eyes, the camera between them."""
        with self._lock:
            return between(self.shot.subject.cameras(self._viewpoint(self.view), self.view.frame))

    def has_pair(self) -> bool:
        """Return whether the camera is one of a pair of eyes that are both prims of the stage."""
        with self._lock:
            return bool(self.cameras()) and is_eye(self.shot.stage, self._viewpoint(self.view).camera)

    def _viewpoint(self, view: SessionView) -> Viewpoint:
        """Return a view's camera, or else the session's; None is the stage's own choice."""
        return Viewpoint(view.camera or self._camera, view.stereo)

    def close(self) -> None:
        """End the session: its thread, its pictures, and its autosave of edits that are not saved."""
        with self._lock:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()
        self._live.forget()
        self.edits.close()
        atexit.unregister(self.close)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _changed_by(self, change: Callable[[], T]) -> T:
        """Return what a change of the edits returns, and begin a version, unless that is False: nothing changed."""
        with self._lock:
            result = change()
            if result is not False:
                self._new()
            return result

    def _new(self) -> int:
        self.version += 1
        self._changed.notify_all()
        return self.version

    def _run(self) -> None:
        shown = -1
        while True:
            with self._lock:
                while (self.version == shown or self.view.paused) and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                shown = self.version
            try:
                for picture in self._live.pictures(self.view, shown, partial(self._is_old, shown), self._is_closed):
                    self._tell(picture)
            except Cancelled:
                continue
            except SceneError as error:
                self._tell(Problem.of(shown, str(error), self.edits.paths()))
            except Exception as error:  # of any kind: the session must survive errors of the renderer
                self._tell(Problem(shown, f"the picture could not be rendered: {error}"[:300]))

    def _is_old(self, version: int) -> bool:
        return self._closed or version != self.version

    def _is_closed(self) -> bool:
        return self._closed

    def _tell(self, what: Picture | Problem) -> None:
        for told in [*self._listeners]:
            try:
                told(what)
            except Exception:  # the session must survive errors of a listener
                logging.getLogger("photonbeams").exception("a listener of the session failed")


__all__ = ["Picture", "Problem", "Session", "SessionView"]
