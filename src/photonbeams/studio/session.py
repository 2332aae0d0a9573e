"""Sessions: a shot, edits of it, and the pictures that follow each edit."""

from __future__ import annotations

import atexit
import logging
import os
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..images.frame import pixels_of
from ..runtime.files import PathLike
from ..scene import Array, Camera, Scene, SceneError, whole
from ..shot.development import Development
from ..shot.request import Prepared, prepare
from ..shot.shot import Shot
from ..shot.subject import Viewpoint
from ..usd.authoring.controls import Controls, controls_of
from ..usd.authoring.editing import EditLayer
from ..usd.authoring.presets import BEAM, apply_preset, preset_of
from ..usd.cameras.stereo import check_stereo, is_eye
from ..usd.common.motion import equal, followed, same
from ..usd.layers.frames import time_range
from ..usd.stage import list_cameras, up_axis
from ..world.cameras.cameras import Window
from ..world.shutter import Moment, Shutter
from .edits import Edits
from .final import Wanted
from .inspector import Inspected, inspected
from .live import Cancelled, LiveFrame
from .pictures import Picture, Problem, SessionView
from .viewing import alone, between, can_denoise, checked_pose, placed, with_fewer_paths

# The most pixels of the first picture after an edit, and its most light paths per light.
_FIRST_PIXELS, _FIRST_PATHS = 160 * 90, 1024

# Denoised pictures come with each of the first 16 passes, then with every eighth: denoising takes longer than a pass,
# and pictures hardly change from one pass to the next.
_EACH, _ONE_OF = 16, 8

# The most that a view may ask for: a page must not be able to fill the memory.
_MOST_PIXELS, _MOST_PASSES = 1 << 23, 1 << 16


#: A listener; it is called in the thread that renders.
Told = Callable[[Picture | Problem], None]


@dataclass
class _Chain:
    """The last frame of one size, whose unchanged parts the next frame reuses; its scene and denoised layers.

    `whole` are the layers of the last whole picture by views; the view "" is that of the picture's own layers.
    """

    frame: LiveFrame | None = None
    moment: Moment | None = None
    filtered: dict[str, Any] = field(default_factory=dict)
    whole: dict[str, Mapping[str, Array]] = field(default_factory=dict)

    def whole_of(
        self, views: dict[str, Mapping[str, Array]], window: Window, area: tuple[float, float, float, float] | None
    ) -> dict[str, Mapping[str, Array]]:
        """Return layers of an area pasted into those of the last whole picture, by views; remember whole pictures."""
        if area is None:
            self.whole = dict(views)
            return views
        x0, y0, x1, y1 = pixels_of(area, window.width, window.height)
        result: dict[str, Mapping[str, Array]] = {}
        for view, layers in views.items():
            result[view] = pasted = {}
            for name, pixels in layers.items():
                shape = (window.height, window.width, *pixels.shape[2:])
                before = self.whole.get(view, {}).get(name)
                known = before is not None and before.shape == shape
                pasted[name] = before.copy() if known else np.zeros(shape, pixels.dtype)  # type: ignore[union-attr]
                pasted[name][y0:y1, x0:x1] = pixels
        return result


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
    **given
        Further arguments of `Shot.open`.

    Attributes
    ----------
    shot, edits, view
        The `Shot`, its `Edits` (`edits.save(path)` writes them), and what is shown.
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
        **given: Any,
    ) -> None:  # fmt: skip
        if Path(path).suffix.lower() == ".xml":
            raise SceneError(
                f"{path} is a Mitsuba scene, which the studio cannot edit: expected a USD stage; `photonbeams render` "
                "renders it, with --session-layer for looks and --set for parameters"
            )
        stereo = given.pop("stereo", None)
        self.shot = Shot.open(path, camera, **given)
        self._path, self._camera = Path(path), camera
        layers, overrides = given.get("session_layers", ()), given.get("overrides", ())
        self._layers = [str(layers)] if isinstance(layers, str | os.PathLike) else [str(each) for each in layers]
        self._overrides = [overrides] if isinstance(overrides, str) else [*overrides]
        self.edits = Edits(EditLayer(self.shot.stage), layer)
        self.view = view or SessionView()
        if stereo is not None:
            self.view = replace(self.view, stereo=stereo)
        self.version = 0
        self._listeners: list[Told] = []
        self._chains = {True: _Chain(), False: _Chain()}
        self._lock = threading.RLock()  # of the stage and the view
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
            The name of one of `usd.authoring.presets.PRESETS`.
        path
            The path of the look or of the light.

        Raises
        ------
        SceneError
            No such preset; a prim that is neither a look nor a light, or that cannot have a look.
        """
        wanted = preset_of(preset)
        with self._lock:
            unit = self._size() / BEAM
            look = self.edits.change(lambda layer: apply_preset(self.shot.stage, layer, wanted, path, unit))
            self._new()
            return look

    def _size(self) -> float:
        """Return roughly how long the stage's beams are: the radius of its bounding sphere."""
        moments = (chain.moment for chain in self._chains.values())
        found = next((each.scene for each in moments if each is not None), None)
        if found is None:  # there is no picture yet
            exposure = self.shot.subject.exposure(self._viewpoint(self.view), self.view.frame, blur=False, lens=True)
            found = exposure(0.0)[0]
        return BEAM if found.bounds is None else float(found.bounds[1])

    def undo(self) -> bool:
        """Undo the last step; return whether there was one."""
        return self._moved(self.edits.undo)

    def redo(self) -> bool:
        """Redo the step that was undone last; return whether there was one."""
        return self._moved(self.edits.redo)

    def revert(self) -> None:
        """Remove all edits, so that all values are the stage's own again."""
        with self._lock:
            self.edits.revert()
            self._new()

    def discard(self) -> None:
        """Go back to the edits that were saved last."""
        with self._lock:
            self.edits.discard()
            self._new()

    def show(self, **changes: Any) -> int:
        """Change the view, and return the version that will show it.

        Parameters
        ----------
        **changes
            Fields of `SessionView`: width, height, frame, camera, pose, area, lens, blur, solo, paused, passes, stereo,
            denoise.

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
        for name in ("lens", "blur", "paused", "denoise"):
            if not isinstance(getattr(view, name), bool):
                raise SceneError(f"{name} is {getattr(view, name)!r}: expected True or False")
        if view.width * view.height > _MOST_PIXELS:
            raise SceneError(f"the size is {view.width} x {view.height}: expected {_MOST_PIXELS:,} pixels at most")
        if not 1 <= whole(view.passes, "passes") <= _MOST_PASSES:
            raise SceneError(f"passes is {view.passes}: expected 1 to {_MOST_PASSES}")
        if view.camera is not None and view.camera not in self.cameras():
            raise SceneError(f"there is no camera {view.camera!r}: expected one of {', '.join(self.cameras())}")
        check_stereo(view.stereo)
        if view.stereo is not None:
            self.shot.subject.cameras(self._viewpoint(view), view.frame)
        self.shot.resolution(view.width, view.height)
        pixels_of(view.area, view.width, view.height)
        frames = self.frames()
        if view.frame is not None and frames is None:
            raise SceneError(f"the frame is {view.frame}, but the stage has no range of frames: expected None")
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
            frame = self._chains[False].frame or self._chains[True].frame
            if frame is None or not all(0 <= each <= 1 for each in at):
                return [], None
            return inspected(frame, at, depth)

    def wanted(self, passes: int, frames: tuple[float, float] | None = None) -> Wanted:
        """Return what a final render of the present view needs.

        Parameters
        ----------
        passes
            The number of passes.
        frames
            The first and the last frame; None: the view's frame.

        Raises
        ------
        SceneError
            Passes or frames out of range; a free camera, which the stage does not have.
        """
        view = self.view
        if view.pose is not None:
            raise SceneError("the camera was moved freely: expected a camera of the stage")
        first, last = (view.frame, view.frame) if frames is None else frames
        self._check(replace(view, passes=passes, frame=first))
        self._check(replace(view, passes=passes, frame=last))
        if first is not None and last is not None and first > last:
            raise SceneError(f"the frames are {first:g} to {last:g}: expected the first before the last")
        number = None if first is None or last is None else (first, last)
        with self._lock:
            text = self.edits.text()
        return Wanted(
            self._path, self._layers, self._overrides, text, self._viewpoint(view).camera, view.width, view.height,
            passes, number, view.stereo,
        )  # fmt: skip

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
            return is_eye(self.shot.stage, self._viewpoint(self.view).camera)

    def _viewpoint(self, view: SessionView) -> Viewpoint:
        """Return a view's camera, or else the session's; None is the stage's own choice."""
        return Viewpoint(view.camera or self._camera, view.stereo)

    def close(self) -> None:
        """End the session: its thread, its pictures, and its autosave of edits that are not saved."""
        with self._lock:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()
        # Kernels have code for the surfaces and media of every scene in memory.
        self._chains = {True: _Chain(), False: _Chain()}
        self.edits.close()
        atexit.unregister(self.close)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _moved(self, move: Callable[[], bool]) -> bool:
        with self._lock:
            done = move()
            if done:
                self._new()
            return done

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
                self._render(shown)
            except Cancelled:
                continue
            except SceneError as error:
                self._tell(Problem.of(shown, str(error), self.edits.paths()))
            except Exception as error:  # of any kind: the session must survive errors of the renderer
                self._tell(Problem(shown, f"the picture could not be rendered: {error}"[:300]))

    def _tell(self, what: Picture | Problem) -> None:
        for told in [*self._listeners]:
            try:
                told(what)
            except Exception:  # the session must survive errors of a listener
                logging.getLogger("photonbeams").exception("a listener of the session failed")

    def _render(self, version: int) -> None:
        """Render the pictures of a version, until there is a later one."""
        view = self.view
        for first in (True, False):
            # First pictures are never cancelled: there would be none while edits come faster than pictures.
            unwanted = self._is_closed if first else partial(self._is_old, version)
            scale = min(1.0, (_FIRST_PIXELS / (view.width * view.height)) ** 0.5) if first else 1.0
            frame, ready = self._begun(view, scale, first, unwanted)
            passes = 1 if first else view.passes
            for number in range(passes):
                frame.add_pass(number)
                if unwanted():
                    raise Cancelled
                development, done = self._development(ready, first, number, view), number + 1
                if development.denoise and done > _EACH and done % _ONE_OF:
                    continue
                made = development.frame(frame.sums(), frame.statistics)
                if unwanted():
                    raise Cancelled
                views = {name: layers for name, (layers, _) in made.views.items()}
                whole = self._chains[first].whole_of({"": made.layers, **views}, ready.window, view.area)
                layers, statistics = whole.pop(""), frame.statistics
                self._tell(Picture(version, layers, done, view.passes, scale, statistics, whole, first))

    def _development(self, ready: Prepared, first: bool, number: int, view: SessionView) -> Development:
        """Return how the passes up to `number` become a picture."""
        if not first and number >= view.passes - 1:
            return replace(ready.development, denoise=False)
        # After an edit of a look, denoised layers of surfaces can be reused.
        return replace(ready.development, filtered=self._chains[first].filtered) if number == 0 else ready.development

    def _is_old(self, version: int) -> bool:
        return self._closed or version != self.version

    def _is_closed(self) -> bool:
        return self._closed

    def _begun(
        self, view: SessionView, scale: float, first: bool, unwanted: Callable[[], bool]
    ) -> tuple[LiveFrame, Prepared]:  # fmt: skip
        """Return the frame of a view, which has no passes yet."""
        chain = self._chains[first]
        with self._lock:
            ready = self._ready(view, scale, first, chain)
        planned = None if first else view.passes
        before = chain.frame
        frame = LiveFrame(ready, planned, before, first and before is not None, unwanted)
        chain.frame, chain.moment = frame, ready.content.shutter.at(0.0)
        return frame, ready

    def _ready(self, view: SessionView, scale: float, first: bool, chain: _Chain) -> Prepared:
        """Return what a frame needs; what did not change since the last frame are the same objects."""
        before = chain.moment
        width, height = (max(1, round(scale * each)) for each in (view.width, view.height))
        # `denoise` leaves the passes' bits as they are; whether pictures are denoised is up to `Development.denoise`.
        settings = {"denoise": view.denoise and can_denoise(), **({"beams": _FIRST_PATHS} if first else {})}
        picture = {"width": width, "height": height, "crop": view.area, "blur": view.blur and not first}
        ready = prepare(
            self.shot.subject, self._viewpoint(view), view.frame, 1 if first else view.passes, None,
            {**settings, **picture, "lens": view.lens},
        )  # fmt: skip
        self._check_edits()
        shutter, viewers = ready.content.shutter, ready.content.viewers
        moment = shutter.at(0.0)

        def seen(content: Scene) -> Scene:
            content = with_fewer_paths(content, _FIRST_PATHS) if first else content
            return alone(content, view.solo) if view.solo else content

        content = seen(moment.scene)
        if before is not None:  # the widths of beams depend on the bounds, which an edit may change
            bounds, content = content.bounds, followed(before.scene, content)
            content = content if equal(content.bounds, bounds) else replace(content, bounds=bounds)
        cameras = moment.cameras
        if view.pose is not None:
            cameras = placed(cameras, view.pose)
        if before is not None and len(before.cameras) == len(cameras):
            cameras = tuple(map(same, before.cameras, cameras))
        seen_from = viewers() if view.pose is None else cameras
        shutter = self._beginning(shutter, Moment(content, cameras), seen, view.pose is not None)
        return replace(ready, content=replace(ready.content, shutter=shutter, viewers=lambda: seen_from))

    def _beginning(self, shutter: Shutter, moment: Moment, seen: Callable[[Scene], Scene], free: bool) -> Shutter:
        """Return a shutter that begins with the given moment; the scenes of later ones go through `seen`.

        A `free` camera does not move.
        """

        def at(fraction: float, of: Callable[[float], Moment] = shutter.at) -> Moment:
            if fraction == 0:
                return moment
            with self._lock:  # the stage is read
                found = of(fraction)
            cameras = moment.cameras if free else tuple(map(same, moment.cameras, found.cameras))
            return Moment(followed(moment.scene, seen(found.scene)), cameras)

        before = shutter.before
        return replace(shutter, at=at, before=None if before is None else partial(at, of=before))

    def _check_edits(self) -> None:
        """Raise a warning about what was edited as a SceneError: who edits a value does not want a substitute."""
        warnings, edited = self.shot.warnings, self.edits.paths()
        wrong = [text for text in warnings.given if any(path in text for path in edited)]
        warnings.given.difference_update(wrong)  # so that they can be given again
        if wrong:
            raise SceneError(warnings.causes.get(wrong[0], wrong[0]))


__all__ = ["Picture", "Problem", "Session", "SessionView"]
