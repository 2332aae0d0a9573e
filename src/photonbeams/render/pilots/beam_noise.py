"""The noise and cost of the beams of a pass: two halves of them tell, along a coarse grid of rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import numpy as np

from ...beams.sets import BeamSet
from ...numerics.arrays import channel_mean, taken, to_uint
from ...runtime.device import Array3f, Float, UInt32
from ...scene import Array
from ...world.cameras.cameras import View
from ...world.cameras.sensors import PrimaryRays
from ..costs import of_beams
from ..light import TracedLight
from ..ray_passes import PassRenderer, ViewRays

# Rays, across and down.
_COLUMNS, _ROWS = 40, 24
# Blocks of a set's beams, about.
_BLOCKS = 64
# Cameras of a shot whose rays are taken, at most.
_CAMERAS = 8


class BeamCost(NamedTuple):
    """The `noise` of the beams of a pass, (mean √B)², and their cost."""

    noise: float
    cost: float


class _StillPasses(PassRenderer):
    """Passes in which looks do not change with time: all frames of a film that have one light have one plan."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0)."""
        return 0.0, 0.0


def beam_cost(frame: PassRenderer, light: TracedLight, pixels: int) -> BeamCost:
    """Return the noise of the beams of a frame's first pass, and what it costs to gather them for so many pixels.

    The light along a ray is x₁ + x₂, of half of the beams and of the others. These are nearly independent, so that
    x₁ − x₂ has the variance of the sum, and the mean of |x₁ − x₂| is √(2 / π) standard deviations.
    """
    passes = _StillPasses(frame.settings, frame.light, frame.light.max_depth, frame.statistics.fresh())
    # Drawn beams are the same in all passes, and few rays meet those that only mirrors show.
    sets = [each for each in light.sets if len(each.beams) and not each.tallied]
    traced = [each for each in sets if each.light < len(light.world.emitters)]
    count = sum(len(each.beams) for each in light.sets)
    photons = sum(dr.width(each.number) for each in light.hits)
    coarse = sum(len(each.beams) for each in light.sets if passes.coarse(0, light, each))
    cost = of_beams(count + photons, count, pixels, coarse)
    if not traced:
        return BeamCost(0.0, cost)
    rays = _coarse_rays(frame.light.cameras)
    halves = [gathered(passes, replace(light, sets=[_half(each, own) for each in traced]), rays) for own in (0, 1)]
    noise = np.pi / 2 * np.abs(halves[0] - halves[1]).mean() ** 2
    return BeamCost(float(np.nan_to_num(noise)), cost)


def _half(beams: BeamSet, first: int) -> BeamSet:
    """Return every second of some blocks of a set's beams, at rest: coarse rays have no times.

    Light paths are a Sobol sequence. Every second one is on the same side of the lamp; blocks are all around it.
    """
    number = np.arange(len(beams.beams))
    block = number // max(len(number) // _BLOCKS, 1)
    index = to_uint(np.flatnonzero((block + first) % 2 == 0) if len(number) > 1 else number)
    return beams._replace(beams=taken(beams.beams, index), depth=taken(beams.depth, index), close=None)


def gathered(passes: PassRenderer, light: TracedLight, rays: PrimaryRays) -> Array:
    """Return the radiance of beams along coarse rays, the mean of the channels, (N,)."""
    pixels = dr.arange(UInt32, _COLUMNS * _ROWS)
    groups = passes.gathered(0, light, ViewRays(rays, None), pixels, passes.samples(0))
    radiance = channel_mean(sum(groups.values(), dr.zeros(Array3f, _COLUMNS * _ROWS))).numpy()
    return np.nan_to_num(radiance).astype(np.float64)


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
