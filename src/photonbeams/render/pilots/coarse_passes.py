"""A pilot: passes along a coarse grid of rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from ...numerics.arrays import channel_mean
from ...runtime.device import Array3f, Float, UInt32
from ...scene import Array
from ...world.cameras.cameras import View
from ...world.cameras.sensors import PrimaryRays
from ..light import ShotLight
from ..ray_passes import PassRenderer, ViewRays

#: Rays of a pilot, across and down.
COLUMNS, ROWS = 40, 24
#: A pilot has this fraction (1/N) of the light paths, and at least this many of each emitter. Fewer beams are wider, if
#: the bounds of radii allow it. Then they have as much noise as all beams; else they have more, at most N times as
#: much. The choice takes the geometric mean of the two, N^½ times as much.
FEWER, _FEWEST = 4, 128
# Cameras of a shot whose rays a pilot takes, at most.
_CAMERAS = 8


@dataclass(frozen=True)
class Pixels:
    """How many pixels a pass has, and how many of them the pixel filter averages.

    The filter lowers the noise of surfaces and walks by that factor, not that of beams: a stroke is many pixels wide.
    """

    count: int
    averaged: float = 1.0


def with_fewer_paths(light: ShotLight) -> tuple[ShotLight, float]:
    """Return a light with the light paths of a pilot, and the fraction of all paths, and drawn beams, that it has."""
    strata, drawn = light.simulation.strata(light.world), sum(len(each.start) for each in light.world.drawn)
    fewer = {each.name: max(each.count // FEWER, min(each.count, _FEWEST)) for each in strata}
    whole = sum(each.count for each in strata) + drawn
    return light.with_counts(fewer), (sum(fewer.values()) + drawn) / whole if whole else 1.0


class Pilot:
    """Passes along the coarse rays of cameras; each of several cameras has some of the columns.

    Attributes
    ----------
    surfaces, beams
        The radiance of rays in the passes so far, (P, H, W), the mean of the channels: all but that of beams, and that
        of beams.
    coarse, photons
        How many of the beams a picture gathers along fewer rays than pixels, and how many photons there are.
    """

    def __init__(self, passes: PassRenderer, cameras: Sequence[View]) -> None:
        self._passes, self._rays = passes, _coarse_rays(cameras)
        self.surfaces = self.beams = np.zeros((0, ROWS, COLUMNS), dtype=np.float32)
        self.coarse = self.photons = 0

    def add(self, count: int, together: int = 1, surfaces: bool = True) -> None:
        """Add passes, with or without surfaces.

        So many passes are rendered `together`: one, or all that have no beams and photons.
        """
        pixels = dr.arange(UInt32, COLUMNS * ROWS)
        first = len(self.beams)
        for number in range(first, first + count, together):
            light, photons = self._passes.lit(number)
            self._passes.count(light)
            self.coarse += sum(len(each.beams) for each in light.sets if self._passes.coarse(number, light, each))
            self.photons += sum(dr.width(each.number) for each in light.hits)
            # Beams are at rest, since coarse rays have no times.
            light = replace(light, sets=[own._replace(close=None) for own in light.sets])
            if surfaces:
                samples = self._passes.samples(number, (together - 1).bit_length())
                order = samples.indices(pixels)
                dr.eval(order)
                joint = ViewRays(PrimaryRays.joined([self._rays] * together), None)
                seen = self._passes.seen(light, joint, order, samples, photons)
                own = seen.radiance
                self.surfaces = np.concatenate([self.surfaces, _gray(own, together)])
            single = self._passes.samples(number)
            gathered = self._passes.gathered(number, light, ViewRays(self._rays, None), pixels, single)
            beams = _gray(sum(gathered.values(), dr.zeros(Array3f, 1)), 1)
            self.beams = np.concatenate([self.beams, np.repeat(beams, together, axis=0)])


def _gray(radiance: Array3f, count: int) -> Array:
    """Return the mean of the channels, by samples, rows and columns."""
    return np.broadcast_to(channel_mean(radiance).numpy(), count * ROWS * COLUMNS).reshape(count, ROWS, COLUMNS)


def _coarse_rays(cameras: Sequence[View]) -> PrimaryRays:
    """Return the rays of a pilot."""
    some = cameras[:: -(-len(cameras) // _CAMERAS)]
    lane = dr.arange(UInt32, COLUMNS * ROWS)
    origin, direction = dr.zeros(Array3f, COLUMNS * ROWS), dr.zeros(Array3f, COLUMNS * ROWS)
    for place, camera in enumerate(some):
        own = lane % dr.opaque(UInt32, len(some)) == dr.opaque(UInt32, place)
        begin, toward = camera.coarse_rays(COLUMNS, ROWS)
        origin, direction = dr.select(own, begin, origin), dr.select(own, toward, direction)
    count = dr.width(direction)
    return PrimaryRays(
        origin, direction, dr.zeros(Float, count), dr.full(Float, dr.largest(Float), count), dr.ones(Array3f, count)
    )


def by_blocks(found: Array, block: int) -> Array:
    """Return the means of blocks of rays, (H, W); rays at the edges beside whole blocks do not count."""
    rows, columns = (each // block for each in found.shape)
    whole = found[: rows * block, : columns * block]
    result: Array = whole.reshape(rows, block, columns, block).mean(axis=(1, 3))
    return result
