"""The samples that pixels have in a pass of everything but beams: as many as lower the picture's error the most.

A pass with n samples of a pixel has the variance V = B + S / n there, of which B is that of its beams, and it costs
C = b + Σ n · s. Eyes and displays see errors in proportion to about 1 / √L of the light L; after equal cost, the mean
of these is in proportion to Σ √(V / L) · √C, a sum over the picture. Two pilots tell what that takes, where they cost
less than they may save. The first one traces some of the light paths and asks few rays for B, which is one number,
(mean √B)², for all frames of a shot. S differs more: a hundredth of the pixels, where lamps shine on surfaces or edges
cross, may have most of it. So a second pilot sends rays through all blocks of the frame's whole picture, and each block
has its own number of samples, n = argmin √((B + S / n) / L) + λ n, of all λ with the one of the least error. Costs are
computed from counts, so that the plan of a scene is the same on every machine and in every crop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import numpy as np

from ...numerics.arrays import to_uint
from ...numerics.hashing import hash32
from ...runtime.device import UInt32
from ...scene import Array
from ...world.cameras.cameras import Window
from ..costs import of_beams, of_sample, of_tracing, power_below, surface_samples
from ..films.sample_layout import Piece
from ..light import ShotLight
from ..passes import Statistics
from ..ray_passes import PassRenderer
from .coarse_passes import Pilot, Pixels, with_fewer_paths

# Passes of the first pilot. It is asked where it costs less than the usual samples of one pass.
_PASSES = 2
# Where two samples of a pixel differ, it is an edge, where the beams have more samples.
_CHOICES = 2, 4, 8, 16, 32
_BITS = 30  # of the indices of all samples in the whole picture; overscan has larger ones
# Of plans that are nearly as good as the best, the one with the fewest samples is taken: its time has more passes.
_NEARLY = 1.02
_DARK = 0.05  # of the mean light: darker blocks count no more than those
_WEIGHTS = np.geomspace(1e-4, 1e3, 71)  # λ, in units of the mean of √V
#: The second pilot has one ray for so many pixels across and down, with so many samples.
CELL, SAMPLES = 4, 2
_BLOCK = 2  # cells across and down that have the same number of samples


class BeamCost(NamedTuple):
    """The `noise` of the beams of a pass, (mean √B)², and their cost."""

    noise: float
    cost: float


@dataclass(frozen=True)
class SampleCounts:
    """How many samples the pixels of a picture have in a pass: of each block, row by row."""

    blocks: Array

    @classmethod
    def of(cls, each: int) -> SampleCounts:
        """Return the counts of a picture whose pixels have `each`."""
        return cls(np.full((1, 1), each))

    @property
    def most(self) -> int:
        """The greatest number."""
        return int(self.blocks.max())

    @property
    def uniform(self) -> bool:
        """Whether all pixels have the same number."""
        return bool(self.blocks.min() == self.most)

    @property
    def typical(self) -> int:
        """The greatest power of two up to the mean."""
        return power_below(int(self.blocks.mean()))

    def pieces(self, window: Window) -> list[Piece]:
        """Return the samples of a pass in a window; overscan has the numbers of the picture's edge."""
        x0, y0, x1, y1 = window.crop
        across, down = (
            np.clip(np.arange(first, end), 0, size - 1) // (CELL * _BLOCK)
            for first, end, size in ((x0, x1, window.width), (y0, y1, window.height))
        )
        counts = self.blocks[down][:, across].ravel()
        return [
            Piece(to_uint(np.flatnonzero(counts == each)), each, range(each)) for each in np.unique(counts).tolist()
        ]


@dataclass(frozen=True)
class SamplePlan:
    """What is known of the samples of all frames of a shot.

    Attributes
    ----------
    usual
        The number that follows from counts alone.
    beams
        What the first pilot found; None: pixels have the usual number.
    sample
        The cost of a sample of all pixels.
    averaged
        As in `Pixels`.
    """

    usual: int
    beams: BeamCost | None = None
    sample: float = 0.0
    averaged: float = 1.0

    def counts(self, radiance: Array, window: Window) -> SampleCounts:
        """Return the numbers of samples with the least error at equal cost.

        Their mean is at most the usual number, or twice the fewest, so that passes cost about what is usual.

        Parameters
        ----------
        radiance
            That of the second pilot's rays, (SAMPLES, cells): the mean of the channels.
        window
            The whole picture.
        """
        assert self.beams is not None
        beams, cost = self.beams
        # Light that overflows is infinite.
        found = np.nan_to_num(radiance).astype(np.float64).reshape(SAMPLES, -1, -(-window.width // CELL))
        noise, light = (_of_blocks(each) for each in (found.var(axis=0, ddof=1) / self.averaged, found.mean(axis=0)))
        # Few samples tell little of light that is rarely found.
        surfaces, shining = np.maximum(noise, _around(noise)), _around(light)
        seen = 1 / np.sqrt(np.maximum(shining + _DARK * shining.mean(), 1e-30))
        free = _BITS - 2 * (max(window.width, window.height) - 1).bit_length()
        choices = np.array([each for each in _CHOICES if each.bit_length() <= max(free, 2)])
        errors = seen * np.sqrt(beams + surfaces / choices[:, None, None])
        unit = max(errors[0].mean(), 1e-30)
        most = max(self.usual, 2 * _CHOICES[0])
        plans = (choices[(errors / unit + own * choices[:, None, None]).argmin(axis=0)] for own in _WEIGHTS[::-1])
        fit = [each for each in plans if each.mean() <= most]  # the fewest samples first
        spent = [
            (seen * np.sqrt(beams + surfaces / each)).mean() ** 2 * (cost + each.mean() * self.sample) for each in fit
        ]
        return SampleCounts(next(each for each, own in zip(fit, spent, strict=True) if own <= _NEARLY * min(spent)))


def sample_plan(light: ShotLight, pixels: Pixels, statistics: Statistics, seen: bool = True) -> SamplePlan:
    """Return the plan of a frame.

    Parameters
    ----------
    light
        The light of the frame.
    pixels
        The pixels of the whole picture.
    statistics
        Statistics of the frame: the time of the pilot is added, and they may interrupt it.
    seen
        Whether rays see surfaces, which are not held out.
    """
    settings, walked = light.settings, light.walks(light.world).surfaces is not None
    if settings.surface_samples is not None:
        return SamplePlan(settings.surface_samples)
    usual, sample = surface_samples(light.paths, pixels.count, walked), of_sample(walked) * pixels.count
    plain = seen and settings.surfaces and settings.program is None and bool(light.cameras) and light.paths > 0
    if not plain or max(usual, _CHOICES[0]) * sample < _PASSES * of_tracing(light.paths):
        return SamplePlan(usual)
    return SamplePlan(usual, _beam_cost(light, pixels, statistics), sample, pixels.averaged)


def _beam_cost(light: ShotLight, pixels: Pixels, statistics: Statistics) -> BeamCost:
    """Return what the first pilot finds, or has found for another frame."""
    if not light.world.hazy:
        return BeamCost(0.0, of_tracing(light.paths))
    known = light.findings.beams
    if pixels.count not in known:
        own, portion = with_fewer_paths(light.seeded(0))
        passes = _PilotPasses(own.settings, own, own.max_depth, statistics.fresh())
        with statistics.phase("plan"):
            pilot = Pilot(passes, light.cameras)
            pilot.add(_PASSES, surfaces=False)
        # The mean of |x₁ − x₂| is 2 / √π standard deviations. Photons, which samples of a pass share, are left out: two
        # passes tell too little. Radii are taken as bounded: so many times fewer beams have so many times the variance.
        noise = np.pi / 4 * np.abs(np.diff(pilot.beams.astype(np.float64), axis=0)).mean() ** 2 * portion
        count, coarse = (each / (_PASSES * portion) for each in (passes.statistics.beams, pilot.coarse))
        known[pixels.count] = BeamCost(float(noise), of_beams(count, count, pixels.count, coarse))
    return known[pixels.count]


class _PilotPasses(PassRenderer):
    """Passes in which looks do not change with time: all frames of a film have one plan."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0)."""
        return 0.0, 0.0


def pilot_pixels(width: int, height: int) -> UInt32:
    """Return the numbers of the pixels that the second pilot sees in a whole picture: one of each cell, at random."""
    columns, rows = -(-width // CELL), -(-height // CELL)
    cell = dr.arange(UInt32, columns * rows)
    place = hash32(cell, UInt32(0))
    across, down = dr.opaque(UInt32, columns), dr.opaque(UInt32, width)
    x = dr.minimum(cell % across * CELL + place % CELL, down - 1)
    y = dr.minimum(cell // across * CELL + (place >> 8) % CELL, dr.opaque(UInt32, height - 1))
    result = y * down + x
    dr.eval(result)
    return result


def _of_blocks(cells: Array) -> Array:
    """Return the means of blocks of cells; those at the edges may be smaller."""
    rows, columns = (np.arange(0, size, _BLOCK) for size in cells.shape)
    sums = np.add.reduceat(np.add.reduceat(cells, rows, axis=0), columns, axis=1)
    sizes: Sequence[Array] = [np.diff([*first, size]) for first, size in zip((rows, columns), cells.shape, strict=True)]
    result: Array = sums / np.multiply.outer(*sizes)
    return result


def _around(blocks: Array) -> Array:
    """Return the means of blocks with those around them."""
    rows, columns = blocks.shape
    wide = np.pad(blocks, 1, mode="edge")
    result: Array = np.mean([wide[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)
    return result
