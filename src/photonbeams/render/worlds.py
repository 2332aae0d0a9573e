"""The worlds of a shot over the shutter interval, slice by slice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .. import scene
from ..world.described import world_of_scene
from ..world.shutter import CameraMotion, Moment, Shutter, slice_of
from ..world.world import World

if TYPE_CHECKING:
    from ..looks import Look


class Worlds(Protocol):
    """The world that light meets, in the slice of the shutter interval that each pass covers."""

    @property
    def opened(self) -> World:
        """The world when the shutter opens."""

    @property
    def varies(self) -> bool:
        """Whether passes may differ although no light paths are sent."""

    def medium(self, number: int) -> scene.Medium | None:
        """Return the first homogeneous medium in the middle of a pass, for programs."""

    def ends(self, number: int) -> Sequence[World]:
        """Return the worlds at the start of pass `number` and at its end; one if nothing moves."""

    def middle(self, number: int) -> World:
        """Return the world in the middle of pass `number`, which its camera paths meet."""

    def looks(self, number: int) -> Mapping[str, Look | None] | None:
        """Return the looks in the middle of a pass, by the names of lamps; None: those of the world's sources."""

    def slice(self, number: int) -> tuple[float, float]:
        """Return the slice of the shutter interval that a pass covers, as fractions."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""


class StillWorld:
    """The world of a shot in which nothing moves, and no look changes with time."""

    varies = False

    def __init__(self, world: World) -> None:
        self.opened = world

    def ends(self, number: int) -> Sequence[World]:
        """Return the world."""
        return [self.opened]

    def middle(self, number: int) -> World:
        """Return the world."""
        return self.opened

    def medium(self, number: int) -> None:
        """Return None: programs are for stages."""
        return

    def looks(self, number: int) -> None:
        """Return None: the sources have the looks."""
        return

    def slice(self, number: int) -> tuple[float, float]:
        """Return the whole interval."""
        return 0.0, 1.0

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0)."""
        return 0.0, 0.0


class ShutterWorlds:
    """The worlds of a shot that may move, built when they are asked for.

    Parameters
    ----------
    shutter
        The scene and cameras over the shutter interval.
    sharp
        As in `described.world_of_scene`.
    planned
        How many passes share the interval; further passes begin it again. None: the number is not known.
    earlier
        Worlds of another frame of the same shot, parts of which may be used again. They are let go with the first world
        that is built: kernels have code for the surfaces of all worlds in memory.
    """

    varies = True

    def __init__(
        self, shutter: Shutter, sharp: bool, planned: int | None = None, earlier: Sequence[World] = ()
    ) -> None:  # fmt: skip
        self.shutter, self.planned = shutter, planned
        self.known: list[World] = []
        self._sharp, self._earlier = sharp, [each for each in earlier if each.parts.sharp == sharp]
        cameras = [camera for moment in shutter.ends(0.0, 1.0) for camera in moment.cameras]
        self._eyes = [np.asarray(each.to_world)[:3, 3] for each in cameras]

    def at(self, moment: Moment) -> World:
        """Return the world of a moment; parts of earlier worlds that are still the same are used again."""
        for world in self.known:
            if world.parts.given is moment.scene:
                return world
        found = next((each for each in self._earlier if each.parts.given is moment.scene), None)
        like = next(reversed(self.known or self._earlier), None)
        world = found or world_of_scene(moment.scene, self._eyes, like=like, sharp=self._sharp)
        self.known, self._earlier = [*self.known[-2:], world], []
        return world

    def slice(self, number: int) -> tuple[float, float]:
        """Return the slice of the shutter interval that a pass covers, as fractions."""
        return slice_of(number if self.planned is None else number % self.planned, self.planned)

    def _times(self, number: int) -> tuple[float, float]:
        """Return the fractions of the shutter at which a pass opens and closes; both 0 if nothing moves."""
        return self.slice(number) if self.shutter.moving else (0.0, 0.0)

    def _between(self, number: int) -> Moment:
        return self.shutter.at(0.5 * sum(self._times(number)))

    @property
    def opened(self) -> World:
        """The world when the shutter opens."""
        return self.at(self.shutter.at(0.0))

    def medium(self, number: int) -> scene.Medium | None:
        """Return the first homogeneous medium in the middle of a pass."""
        return self._between(number).scene.medium

    def ends(self, number: int) -> list[World]:
        """Return the worlds at the start of pass `number` and at its end; one if nothing moves."""
        return [self.at(moment) for moment in self.shutter.ends(*self._times(number))]

    def middle(self, number: int) -> World:
        """Return the world in the middle of pass `number`."""
        return self.at(self._between(number))

    def looks(self, number: int) -> Mapping[str, Look | None]:
        """Return the looks in the middle of a pass, by the names of lamps and drawn beams."""
        return self._between(number).scene.looks()

    def camera(self, number: int, view: int) -> CameraMotion:
        """Return the camera of a view in pass `number`."""
        ends = self.shutter.ends(*self._times(number))
        return CameraMotion(ends[0].cameras[view], self._between(number).cameras[view], ends[-1].cameras[view])

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass."""
        return self.shutter.clock(0.5 * sum(self.slice(number)))
