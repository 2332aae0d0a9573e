"""The pictures of a session's views, and scenes and cameras as views change them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from time import monotonic, sleep
from typing import Any

import numpy as np

from ..images.frame import pixels_of
from ..render.films.denoising import lacking_denoiser
from ..render.settings import depth_of
from ..scene import BLACK, Array, Camera, Scene, SceneError
from ..scene.changes import followed, same, sharing
from ..shot.development import Development
from ..shot.request import Prepared, RenderCall, prepare
from ..shot.shot import Shot
from ..shot.subject import Viewpoint
from ..world.cameras.cameras import Window
from ..world.shutter import Moment, Shutter
from .live import Cancelled, LiveFrame
from .pictures import Picture, SessionView

# The most pixels of the first picture after an edit, and its most light paths per light. It has one sample of a pixel:
# with more of either it is hardly better, and takes twice as long.
_FIRST_PIXELS, _FIRST_PATHS = 160 * 90, 256

# The most pixels of the second picture, of one pass, and how many times as many the whole one has at least.
_SECOND_PIXELS, _MANY = 480 * 270, 3

# Denoised pictures come with each of the first 16 passes, then with every eighth: denoising takes longer than a pass,
# and pictures hardly change from one pass to the next.
_EACH, _ONE_OF = 16, 8

# Seconds that a quick first picture may take before the machine counts as slow, and the longest wait for further edits.
_SLOW, _CALM = 0.4, 1.0
_POLL = 0.01  # seconds between two looks at whether there was an edit

# Bounces of light in rooms.
_IN_ROOMS = 3


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


class LivePictures:
    """The pictures of a session's views: a quick small one, then a whole one, then more passes.

    Before a whole one of many pixels comes one of a medium size.

    The finished one is `raw_at_last`: it is not denoised, so that it has the bits of a render.
    """

    def __init__(
        self, shot: Shot, viewpoint: Callable[[SessionView], Viewpoint], edited: Callable[[], Sequence[str]],
        lock: AbstractContextManager[Any], raw_at_last: bool = True,
    ) -> None:  # fmt: skip
        self._shot, self._viewpoint, self._edited, self._lock = shot, viewpoint, edited, lock
        self._raw_at_last = raw_at_last
        self._room: bool | None = None  # whether the first picture is of a room
        self._rests = 0  # contexts in which later pictures wait
        self.forget()

    def forget(self) -> None:
        """Forget all frames: kernels have code for the surfaces and media of every scene in memory."""
        self._first, self._second, self._whole = _Chain(), _Chain(), _Chain()

    def frame(self) -> LiveFrame | None:
        """Return the last frame, of a whole picture if there is one."""
        return self._whole.frame or self._first.frame

    @contextmanager
    def resting(self) -> Iterator[None]:
        """Let all but the first picture after an edit wait within the context."""
        self._rests += 1
        try:
            yield
        finally:
            self._rests -= 1

    def bounces(self, view: SessionView) -> int | None:
        """Return the bounces of a view, as `--bounces`; None: those of the stage."""
        return _IN_ROOMS if view.bounces is None and self._room and not self.own_bounces else view.bounces

    @property
    def own_bounces(self) -> int:
        """The bounces of the stage."""
        scene = self.scene()
        return 0 if scene is None else scene.bounces

    @property
    def usual_bounces(self) -> int:
        """The bounces of the stage, or of rooms if it has none."""
        return self.own_bounces or _IN_ROOMS

    def scene(self) -> Scene | None:
        """Return a scene that was rendered last, if there is one."""
        moment = self._first.moment or self._whole.moment
        return None if moment is None else moment.scene

    def pictures(
        self, view: SessionView, version: int, is_old: Callable[[], bool], is_closed: Callable[[], bool]
    ) -> Iterator[Picture]:
        """Yield the pictures of a view; raise `Cancelled` once it is old."""
        pixels, begin = view.width * view.height, monotonic()
        # First pictures are never cancelled: there would be none while edits come faster than pictures.
        yield from self._passes(view, version, self._first, min(1.0, (_FIRST_PIXELS / pixels) ** 0.5), is_closed)
        _wait_for_calm(monotonic() - begin, is_old)
        try:
            if pixels > _MANY * _SECOND_PIXELS:
                yield from self._passes(view, version, self._second, (_SECOND_PIXELS / pixels) ** 0.5, is_old)
            yield from self._passes(view, version, self._whole, 1.0, is_old)
        except KeyboardInterrupt:  # anywhere: what would be reused may not be whole
            self._second, self._whole = _Chain(), _Chain()
            raise

    def _passes(
        self, view: SessionView, version: int, chain: _Chain, scale: float, unwanted: Callable[[], bool]
    ) -> Iterator[Picture]:
        """Yield the pictures of a chain, pass after pass."""
        frame, ready = self.begun(view, chain, scale, unwanted)
        first = chain is self._first
        for number in range(view.passes if chain is self._whole else 1):
            while self._rests and not first and not unwanted():
                sleep(_POLL)
            frame.add_pass(number)
            if unwanted():
                raise Cancelled
            development, done = self._development(ready, chain, number, view), number + 1
            if development.settings.denoise and done > _EACH and done % _ONE_OF and done < view.passes:
                continue
            made = development.frame(frame.sums(), frame.statistics)
            if unwanted():
                raise Cancelled
            views = {name: layers for name, (layers, _) in made.views.items()}
            whole = chain.whole_of({"": made.layers, **views}, ready.window, view.area)
            layers, statistics = whole.pop(""), frame.statistics
            yield Picture(
                version=version,
                layers=layers,
                passes=done,
                planned=view.passes,
                scale=scale,
                statistics=statistics,
                views=whole,
                is_first=first,
                frame=view.frame,
                space=made.color_space,
            )

    def _development(self, ready: Prepared, chain: _Chain, number: int, view: SessionView) -> Development:
        """Return how the passes up to `number` become a picture."""
        if chain is self._whole and self._raw_at_last and number >= view.passes - 1:
            return replace(ready.development, settings=replace(ready.development.settings, denoise=False))
        # After an edit of a look, denoised layers of surfaces can be reused.
        return replace(ready.development, filtered=chain.filtered) if number == 0 else ready.development

    def begun(
        self, view: SessionView, chain: _Chain, scale: float, unwanted: Callable[[], bool]
    ) -> tuple[LiveFrame, Prepared]:  # fmt: skip
        """Return the frame of a view, which has no passes yet, and what it needs."""
        first, before = chain is self._first, chain.frame
        with self._lock:
            ready = self._ready(view, scale, first, chain.moment)
        like, beside = before or self._first.frame, None if first else self._first.frame
        planned, keeps_guides = None if first else view.passes, first and before is not None
        frame = LiveFrame(ready, planned, like, keeps_guides, beside, unwanted)
        chain.frame, chain.moment = frame, ready.content.shutter.at(0.0)
        if self._room is None and view.bounces is None and not self.own_bounces:
            self._room = frame.in_room
            if self._room:  # now with bounces
                return self.begun(view, chain, scale, unwanted)
        return frame, ready

    def _ready(self, view: SessionView, scale: float, first: bool, before: Moment | None) -> Prepared:
        """Return what a frame needs; what did not change since the last frame are the same objects."""
        width, height = (max(1, round(scale * each)) for each in (view.width, view.height))
        # `denoise` leaves the passes' bits as they are; whether pictures are denoised is up to `Development.denoise`.
        settings: dict[str, Any] = {"denoise": view.denoise and can_denoise()}
        settings |= {"beams": _FIRST_PATHS, "surface_samples": 1} if first else {}
        bounces = self.bounces(view)
        if bounces is not None:
            settings["max_depth"] = depth_of(bounces)
        picture = {"width": width, "height": height, "crop": view.area, "blur": view.blur and not first}
        passes, given = 1 if first else view.passes, {**settings, **picture, "lens": view.lens}
        ready = prepare(RenderCall(self._shot.subject, self._viewpoint(view), view.frame, passes, None, given))
        self._check_edits()
        shutter, viewers = ready.content.shutter, ready.content.viewers
        moment = shutter.at(0.0)

        def seen(content: Scene) -> Scene:
            content = with_fewer_paths(content, _FIRST_PATHS) if first else content
            return alone(content, view.solo) if view.solo else content

        content = seen(moment.scene)
        if before is not None:
            content = sharing(before.scene, content)
        if not first and self._first.moment is not None:
            content = sharing(self._first.moment.scene, content)
        cameras = moment.cameras
        if view.pose is not None:
            pose = np.array(view.pose)
            pose[:3, 3] += content.zero
            cameras = placed(cameras, pose)
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
        warnings, edited = self._shot.warnings, self._edited()
        wrong = [text for text in warnings.given if any(path in text for path in edited)]
        warnings.given.difference_update(wrong)  # so that they can be given again
        if wrong:
            raise SceneError(warnings.causes.get(wrong[0], wrong[0]))


def _wait_for_calm(took: float, is_old: Callable[[], bool]) -> None:
    """Wait for further edits if the first picture `took` long; raise `Cancelled` at one.

    Larger pictures have long kernels that cannot be cancelled: none begins while somebody drags a slider.
    """
    end = monotonic() + (min(took, _CALM) if took > _SLOW else 0)
    while monotonic() < end:
        if is_old():
            raise Cancelled
        sleep(_POLL)


def with_fewer_paths(content: Scene, most: int) -> Scene:
    """Return a scene whose lights have at most so many light paths."""
    lights = [
        each if each.beam_count is None else replace(each, beam_count=min(each.beam_count, most))
        for each in content.lights
    ]
    return replace(content, lights=tuple(lights))


def alone(content: Scene, shining: Sequence[str]) -> Scene:
    """Return a scene in which only these lights and drawn beams shine."""
    lights = [each if each.name in shining else replace(each, radiance=BLACK) for each in content.lights]
    drawn = [each for each in content.drawn if each.name in shining]
    return replace(content, lights=tuple(lights), drawn=tuple(drawn))


def between(cameras: Sequence[Camera]) -> Camera:
    """Return the camera between two eyes, or the only camera."""
    if len(cameras) == 1:
        return cameras[0]
    poses = [np.asarray(each.to_world) for each in cameras]
    middle = poses[0].copy()
    middle[:3, 3] = np.mean([each[:3, 3] for each in poses], axis=0)
    return replace(cameras[0], to_world=middle)


def placed(cameras: Sequence[Camera], pose: Array) -> tuple[Camera, ...]:
    """Return cameras moved so that the camera between them has a pose."""
    if len(cameras) == 1:
        return (replace(cameras[0], to_world=pose),)
    away = np.linalg.inv(np.asarray(between(cameras).to_world))
    return tuple(replace(each, to_world=pose @ (away @ np.asarray(each.to_world))) for each in cameras)


@cache
def can_denoise() -> bool:
    """Return whether this machine can denoise; if not, warn once why."""
    lacking = lacking_denoiser()
    if lacking is not None:
        logging.getLogger("photonbeams").warning("pictures are not denoised: %s", lacking)
    return lacking is None


def checked_pose(value: Any) -> Array:
    """Return a camera's transform to the world, (4, 4); SceneError for anything else."""
    try:
        pose = np.array(value, dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError):
        raise SceneError(f"the pose is {value!r:.80}: expected 16 numbers") from None
    if not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3])) < 1e-12:
        raise SceneError("the pose is no transform: expected a finite matrix that can be inverted")
    return pose
