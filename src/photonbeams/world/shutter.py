"""The shutter interval of a shot, and the slice of it that each pass covers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .. import scene

_MOST_SLICES = 1 << 16


class Moment(NamedTuple):
    """A shot at one time: its scene, and its cameras, one for each view."""

    scene: scene.Scene
    cameras: tuple[scene.Camera, ...]


class CameraMotion(NamedTuple):
    """A camera in a pass: when the pass opens, in its middle and when it closes; the same camera if it is at rest."""

    opened: scene.Camera
    middle: scene.Camera
    closed: scene.Camera

    def at(self, time: float) -> scene.Camera:
        """Return the camera at a `time` of the pass, from 0 to 1; it must hardly turn."""
        if self.closed is self.opened:
            return with_lens(self.opened, self.middle)
        first, last = (
            np.linalg.inv(np.asarray(each.to_world, dtype=np.float64)) for each in (self.opened, self.closed)
        )
        to_world = np.linalg.inv((1 - time) * first + time * last)
        u, _, v = np.linalg.svd(to_world[:3, :3])  # axes in between are a little too short
        to_world[:3, :3] = u @ v
        return replace(with_lens(self.opened, self.middle), to_world=to_world)


@dataclass(frozen=True)
class Shutter:
    """A shot while the shutter is open.

    Attributes
    ----------
    at
        Returns the shot at a fraction of the shutter interval, from 0 (open) to 1 (close). An object that is identical
        at two times is at rest between them.
    moving
        Whether anything moves; if not, `at` is only called with 0.
    clock
        Returns frame number and seconds at a fraction of the shutter interval, for looks that change with time.
    before
        Returns the shot at the end of a slice, just before a discontinuity if there is one there. None: as `at`.
    unchanging
        Whether the scene is known to be at rest while cameras move.
    later
        Returns the shot one frame after the shutter opens, for motion vectors; None: nothing moves.
    """

    at: Callable[[float], Moment]
    moving: bool = False
    clock: Callable[[float], tuple[float, float]] = lambda _: (0.0, 0.0)
    before: Callable[[float], Moment] | None = None
    unchanging: bool = False
    later: Callable[[], Moment] | None = None

    def with_scenes(self, changed: Callable[[scene.Scene], scene.Scene]) -> Shutter:
        """Return the shot with other scenes."""

        def seen(at: Callable[[float], Moment]) -> Callable[[float], Moment]:
            return lambda fraction: (moment := at(fraction))._replace(scene=changed(moment.scene))

        return replace(self, at=seen(self.at), before=None if self.before is None else seen(self.before))

    @classmethod
    def still(cls, description: scene.Scene, *cameras: scene.Camera) -> Shutter:
        """Return a shot in which nothing moves."""
        moment = Moment(description, cameras)
        return cls(lambda _: moment)

    def ends(self, begin: float, end: float) -> list[Moment]:
        """Return the shot at the beginning and at the end of a slice; a single moment where nothing moves."""
        if not self.moving:
            return [self.at(0.0)]
        return [self.at(begin), (self.before or self.at)(end)]


def turn(a: scene.Camera, b: scene.Camera) -> float:
    """Return the angle between two cameras, in degrees."""
    if a is b:
        return 0.0
    turned = np.asarray(a.to_world)[:3, :3].T @ np.asarray(b.to_world)[:3, :3]
    return float(np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1))))


def with_lens(camera: scene.Camera, middle: scene.Camera) -> scene.Camera:
    """Return a camera with the lens and film of `middle`, another time: within a pass they do not change."""
    if middle is camera:
        return camera
    return replace(middle, to_world=camera.to_world)


def slice_of(number: int, passes: int | None) -> tuple[float, float]:
    """Return the slice of the shutter interval that a pass covers, as fractions.

    If the number of passes is known, there are as many equal slices, in the order of a van der Corput sequence. If it
    is unknown (None: a time limit), the first pass covers the whole interval, the next two its halves, the next four
    its quarters, and so on; so the interval is covered whenever that stops.
    """
    if passes is not None and passes <= _MOST_SLICES:
        rank = _order(passes)[number]
        return rank / passes, (rank + 1) / passes
    bits = (number + 1).bit_length() - 1
    place = int(f"{number + 1:b}"[:0:-1] or "0", 2)
    return place / (1 << bits), (place + 1) / (1 << bits)


@lru_cache(maxsize=8)
def _order(passes: int) -> list[int]:
    """Return the ranks of the first numbers of the van der Corput sequence of base 2 (their bits reversed)."""
    inverse = [int(f"{k:032b}"[::-1], 2) for k in range(passes)]
    ranks = [0] * passes
    for rank, number in enumerate(sorted(range(passes), key=inverse.__getitem__)):
        ranks[number] = rank
    return ranks
