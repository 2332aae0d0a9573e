"""The noise and cost of the beams of a pass, from passes with fewer light paths along a coarse grid of rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import numpy as np

from ...numerics.arrays import channel_mean
from ...runtime.device import Array3f, Float, UInt32
from ...scene import Array
from ...world.cameras.cameras import View
from ...world.cameras.sensors import PrimaryRays
from ..costs import records_of
from ..light import ShotLight
from ..passes import Statistics
from ..ray_passes import PassRenderer, ViewRays

# Rays, across and down.
_COLUMNS, _ROWS = 40, 24
#: Passes.
PASSES = 2
# The fraction (1/N) of the light paths that such a pass has, and the least number of each stratum.
_FEWER, _FEWEST = 4, 128
# Cameras of a shot whose rays are taken, at most.
_CAMERAS = 8


class BeamCost(NamedTuple):
    """The `noise` of the beams of a pass, (mean √B)², and how many there are.

    `records` are beams and photons; of beams that are `tested`, `coarse` ones are gathered along fewer rays than
    pixels.
    """

    noise: float
    records: float
    tested: float = 0.0
    coarse: float = 0.0


def beam_cost(light: ShotLight, statistics: Statistics) -> BeamCost:
    """Return the noise and the numbers of the beams of a pass; `statistics` are those of the frame."""
    if not light.world.hazy:
        return BeamCost(0.0, records_of(light.paths))
    own, portion = with_fewer_paths(light.seeded(0))
    passes = _StillPasses(own.settings, own, own.max_depth, statistics.fresh())
    with statistics.phase("plan"):
        found, coarse = _gathered(passes, light.cameras)
    # The mean of |x₁ − x₂| is 2 / √π standard deviations. Photons, which samples of a pass share, are left out: two
    # passes tell too little. Radii are taken as bounded: so many times fewer beams have so many times the variance.
    noise = np.pi / 4 * np.abs(np.diff(np.nan_to_num(found).astype(np.float64), axis=0)).mean() ** 2 * portion
    count = passes.statistics.beams / (PASSES * portion)
    return BeamCost(float(noise), count, count, coarse / (PASSES * portion))


def with_fewer_paths(light: ShotLight) -> tuple[ShotLight, float]:
    """Return a light with the light paths of a pilot, and the fraction of all paths, and drawn beams, that it has."""
    strata, drawn = light.simulation.strata(light.world), sum(len(each.start) for each in light.world.drawn)
    fewer = {each.name: max(each.count // _FEWER, min(each.count, _FEWEST)) for each in strata}
    whole = sum(each.count for each in strata) + drawn
    return light.with_counts(fewer), (sum(fewer.values()) + drawn) / whole if whole else 1.0


class _StillPasses(PassRenderer):
    """Passes in which looks do not change with time: all frames of a film have one plan."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0)."""
        return 0.0, 0.0


def _gathered(passes: PassRenderer, cameras: Sequence[View]) -> tuple[Array, int]:
    """Return the radiance of beams along coarse rays, the mean of the channels, (P, N).

    Return, too, how many of the beams a picture gathers along fewer rays than pixels.
    """
    rays, pixels = ViewRays(_coarse_rays(cameras), None), dr.arange(UInt32, _COLUMNS * _ROWS)
    found, coarse = [], 0
    for number in range(PASSES):
        light, _ = passes.lit(number)
        passes.count(light)
        coarse += sum(len(each.beams) for each in light.sets if passes.coarse(number, light, each))
        # Beams are at rest, since coarse rays have no times.
        light = replace(light, sets=[own._replace(close=None) for own in light.sets])
        groups = passes.gathered(number, light, rays, pixels, passes.samples(number))
        radiance = channel_mean(sum(groups.values(), dr.zeros(Array3f, 1))).numpy()
        found.append(np.broadcast_to(radiance, _COLUMNS * _ROWS))
    return np.array(found), coarse


def _coarse_rays(cameras: Sequence[View]) -> PrimaryRays:
    """Return rays all over the pictures of cameras; each of several has some of the columns."""
    some = cameras[:: -(-len(cameras) // _CAMERAS)]
    lane = dr.arange(UInt32, _COLUMNS * _ROWS)
    origin, direction = dr.zeros(Array3f, _COLUMNS * _ROWS), dr.zeros(Array3f, _COLUMNS * _ROWS)
    for place, camera in enumerate(some):
        own = lane % dr.opaque(UInt32, len(some)) == dr.opaque(UInt32, place)
        begin, toward = camera.coarse_rays(_COLUMNS, _ROWS)
        origin, direction = dr.select(own, begin, origin), dr.select(own, toward, direction)
    count = dr.width(direction)
    return PrimaryRays(
        origin, direction, dr.zeros(Float, count), dr.full(Float, dr.largest(Float), count), dr.ones(Array3f, count)
    )
