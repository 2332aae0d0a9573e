"""The scene of a stage at any fraction of the shutter interval; objects at rest are the identical objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...scene import Camera, Scene, SceneError
from ...scene.changes import followed, same
from ...scene.places import Origin

if TYPE_CHECKING:
    from ...world.shutter import Shutter

# Fractions of the shutter at which a scene is checked for motion, besides its end and its time samples: something may
# be the same at two keys and different in between.
_PROBES = (0.29, 0.71)
_MOST_PROBES = 16


_KEPT = 8

_HERE = Origin()  # the user's own coordinates

_NEAREST = 1e-9  # time codes before a sample, where held values are still the old ones


class Exposure:
    """Scene and cameras at fractions of the shutter interval; the last few are cached.

    Parameters
    ----------
    read_scene, read_cameras
        Functions that return the scene, and the cameras, at a time code.
    start, stop, keys
        Time codes when the shutter opens and closes, and of the time samples after the first and up to the second.

    Attributes
    ----------
    duration
        How long the shutter is open, in time codes.
    moving
        Whether anything moves in that time.
    """

    def __init__(
        self,
        read_scene: Callable[[float], Scene],
        read_cameras: Callable[[float], tuple[Camera, ...]],
        start: float,
        stop: float,
        keys: Sequence[float] = (),
    ) -> None:
        self._read_scene, self._read_cameras = read_scene, read_cameras
        self._start, self.duration = start, stop - start
        self._first = read_scene(start), read_cameras(start)
        self._known = {start: self._first}  # and the last requests: a pass requests three, some of them twice
        self._keys = np.asarray(keys, dtype=np.float64)
        # Reading a scene takes long, so what is at rest at these times is assumed to be at rest in between.
        step = max(1, len(keys) // _MOST_PROBES)
        probes = [*map(self.code, _PROBES), self._closing(1.0), *(key for key in keys[::step] if key < stop)]
        self._still = not self.duration or all(self._scene(each) is self._first[0] for each in probes)
        self.moving = bool(self.duration) and (not self._still or any(self._eyes_moved(each) for each in probes))

    def __call__(self, fraction: float) -> tuple[Scene, tuple[Camera, ...]]:
        """Return the scene and cameras at a fraction of the shutter interval, 0 to 1."""
        return self._moment(self.code(fraction))

    def closing(self, fraction: float) -> tuple[Scene, tuple[Camera, ...]]:
        """Return the scene and cameras at the fraction at which a slice closes.

        If there is a time sample at that time, held values (an asset, a token, a bool, a string) are those before it: a
        slice is a half-open interval, otherwise its beams, which span it from end to end, would include a part of the
        next slice.
        """
        return self._moment(self._closing(fraction))

    def _closing(self, fraction: float) -> float:
        code = self.code(fraction)
        step = max(_NEAREST, 4 * np.spacing(abs(code)))
        return float(code - step) if np.any(np.abs(self._keys - code) < 0.5 * step) else code

    def _moment(self, code: float) -> tuple[Scene, tuple[Camera, ...]]:
        if code not in self._known:
            content = self._first[0] if self._still else self._scene(code)
            for old in list(self._known)[1 : max(1, len(self._known) - _KEPT + 1)]:
                del self._known[old]
            self._known[code] = content, self._eyes(code)
        return self._known[code]

    def shutter(self, eyes: Sequence[int], rate: float = 1.0, origin: Origin = _HERE) -> Shutter:
        """Return the renderer's shutter for some of the cameras, with `rate` time codes a second.

        Its coordinates begin at `origin`.
        """
        from ...world.shutter import Moment, Shutter

        def seen(moment: tuple[Scene, tuple[Camera, ...]]) -> Moment:
            return Moment(origin.local(moment[0]), tuple(origin.local(moment[1][eye]) for eye in eyes))

        def clock(fraction: float) -> tuple[float, float]:
            code = self.code(fraction)
            return code, code / rate

        def later() -> Moment:
            code = self._start + 1
            return seen((self._scene(code), self._eyes(code)))

        closing = self.closing
        return Shutter(lambda at: seen(self(at)), self.moving, clock, lambda at: seen(closing(at)), self._still, later)

    def code(self, fraction: float) -> float:
        """Return the time code of a fraction of the shutter interval."""
        return self._start + fraction * self.duration

    def _scene(self, code: float) -> Scene:
        try:
            return followed(self._first[0], self._read_scene(code))
        except SceneError as error:
            raise SceneError(f"{error} (at time {code:g}, while the shutter is open)") from None

    def _eyes(self, code: float) -> tuple[Camera, ...]:
        return tuple(map(same, self._first[1], self._read_cameras(code)))

    def _eyes_moved(self, code: float) -> bool:
        return any(a is not b for a, b in zip(self._eyes(code), self._first[1], strict=True))
