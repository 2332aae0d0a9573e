"""The samples that pixels have in a pass of everything but beams: as many as lower the picture's error the most.

A pass with n samples of a pixel has the variance V = B + S / n there, of which B is that of its beams, and it costs
C = b + Σ n · s. Eyes and displays see errors in proportion to about 1 / √L of the light L, here that of all but beams.
After equal cost, the mean of these is in proportion to Σ √(V / L) · √C, a sum over the picture. Two pilots tell what
that takes, where they cost less than they may save. The first one gathers the beams of the first pass along few rays
for B, which is one number, (mean √B)². S differs more: a hundredth of the pixels, where lamps shine on surfaces or
edges cross, may have most of it. So a second pilot sends rays through all blocks of the frame's whole picture, and each
block has its own number of samples, n = argmin √((B + S / n) / L) + λ n, of all λ with the one of the least error.
Costs are computed from counts and no clock, and crops have the plan of the whole picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np

from ...numerics.arrays import to_uint
from ...numerics.hashing import hash32
from ...runtime.device import UInt32
from ...scene import Array
from ...world.cameras.cameras import Window
from ..costs import LANES, of_sample, of_tracing, power_below, surface_samples
from ..films.sample_layout import SamplePiece
from ..light import ShotLight
from .beam_noise import BeamCost

# Pilots are asked where the usual samples of a pass cost this many times what it costs to trace its light paths: they
# help less where samples are cheap.
_WORTH = 2.0
#: Where rays of a pixel reach distances with this ratio, it has an edge, and the beams have more samples there. So
#: blocks near edges have two samples at least.
EDGE = 1.1
_CHOICES = 1, 2, 4, 8, 16, 32
_FEW = 4  # samples of a pixel on average that are never too many
_BITS = 30  # of the indices of all samples in the whole picture; overscan has larger ones
# Of plans that are nearly as good as the best, the one with the fewest samples is taken: its time has more passes.
_NEARLY = 1.02
_DARK = 0.05  # of the mean light, which is added: dark blocks count little more than those that have it
_WEIGHTS = np.geomspace(1e-4, 1e3, 71)  # λ, in units of the mean of √V
# The second pilot has one ray for so many pixels across and down, or in large pictures more, with so many samples.
_CELL, SAMPLES = 4, 2
_BLOCK = 2  # cells across and down that have the same number of samples
# Light that is so many times as much as that of half of the cells around it is rare. How far there is more, in blocks,
# and the part of its variance that is taken for theirs: with all of it, a room with a shaft has a third more noise.
_RARE, _WIDE, _PART = 4.0, 6, 0.125


@dataclass(frozen=True)
class Pixels:
    """How many pixels a pass has, and how many of them the pixel filter averages.

    The filter lowers the noise of surfaces and walks by that factor, not that of beams: a stroke is many pixels wide.
    """

    count: int
    averaged: float = 1.0


@dataclass(frozen=True)
class SampleCounts:
    """How many samples the pixels of a picture have in a pass: of each block, row by row, and the side of a block."""

    blocks: Array
    side: int

    @classmethod
    def of(cls, each: int) -> SampleCounts:
        """Return the counts of a picture whose pixels have `each`."""
        return cls(np.full((1, 1), each), 1)

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
        """The greatest power of two up to the mean, but 2 where only some blocks have edges."""
        return min(self.most, max(2, power_below(int(self.blocks.mean()))))

    def pieces(self, window: Window) -> list[SamplePiece]:
        """Return the samples of a pass in a window; overscan has the numbers of the picture's edge."""
        x0, y0, x1, y1 = window.crop
        across, down = (
            np.clip(np.arange(first, end), 0, size - 1) // self.side
            for first, end, size in ((x0, x1, window.width), (y0, y1, window.height))
        )
        counts = self.blocks[down][:, across].ravel()
        found = ((each, np.flatnonzero(counts == each)) for each in np.unique(self.blocks).tolist())
        return [SamplePiece(to_uint(pixels), each, range(each)) for each, pixels in found if len(pixels)]


@dataclass(frozen=True)
class SamplePlan:
    """What is known of the samples of all frames of a shot.

    Attributes
    ----------
    usual
        The number that follows from counts alone.
    sample
        The cost of a sample of all pixels; 0: pixels have the usual number.
    averaged
        As in `Pixels`.
    """

    usual: int
    sample: float = 0.0
    averaged: float = 1.0

    def counts(self, beams: BeamCost, radiance: Array, reach: Array, window: Window) -> SampleCounts:
        """Return the numbers of samples with the least error at equal cost.

        Their mean is at most the usual number, or a few, so that passes cost about what is usual.

        Parameters
        ----------
        beams
            The noise and cost of the beams of a pass.
        radiance, reach
            The radiance, the mean of the channels, and the distances of the second pilot's rays, (SAMPLES, cells).
        window
            The whole picture.
        """
        # Light that overflows is infinite, and so is the distance of what is not met.
        cell = cell_of(window.width, window.height)
        found, far = (
            np.nan_to_num(each).astype(np.float64).reshape(SAMPLES, -1, -(-window.width // cell))
            for each in (radiance, reach)
        )
        cells, bright = found.var(axis=0, ddof=1) / self.averaged, found.mean(axis=0)
        noise, light = _of_blocks(cells), _of_blocks(bright)
        ends = _of_blocks(far.max(axis=0), np.maximum), _of_blocks(far.min(axis=0), np.minimum)
        edges = _around(ends[0], np.max) > EDGE * _around(ends[1], np.min)
        # Few samples tell little of light that is rarely found, such as that of bright stripes: some cells have it.
        # Blocks without would be seen as patches, and as dark ones once they are denoised.
        alone = bright > _RARE * _around(bright, np.median)
        rare = _PART * _widely(_of_blocks(np.where(alone, cells, 0)))
        surfaces, shining = np.maximum(np.maximum(noise, rare), _around(noise)), _around(light)
        seen = 1 / np.sqrt(np.maximum(shining + _DARK * shining.mean(), 1e-30))
        free = _BITS - 2 * (max(window.width, window.height) - 1).bit_length()
        choices = np.array([each for each in _CHOICES if each.bit_length() <= max(free, 2)], dtype=np.uint8)
        errors = seen * np.sqrt(beams.noise + surfaces / choices[:, None, None])
        unit, errors[0][edges] = max(errors[0].mean(), 1e-30), np.inf
        most = max(self.usual, _FEW)
        plans = (choices[(errors / unit + own * choices[:, None, None]).argmin(axis=0)] for own in _WEIGHTS[::-1])
        fit = [each for each in plans if each.mean() <= most]  # the fewest samples first
        spent = [
            (seen * np.sqrt(beams.noise + surfaces / each)).mean() ** 2 * (beams.cost + each.mean() * self.sample)
            for each in fit
        ]
        best = next(each for each, own in zip(fit, spent, strict=True) if own <= _NEARLY * min(spent))
        return SampleCounts(best, cell * _BLOCK)


def sample_plan(light: ShotLight, pixels: Pixels, seen: bool = True) -> SamplePlan:
    """Return the plan of a frame.

    Parameters
    ----------
    light
        The light of the frame.
    pixels
        The pixels of the whole picture.
    seen
        Whether rays see surfaces, which are not held out.
    """
    settings, walked = light.settings, light.walks(light.world).surfaces is not None
    if settings.surface_samples is not None:
        return SamplePlan(settings.surface_samples)
    usual, sample = surface_samples(light.paths, pixels.count, walked), of_sample(walked) * pixels.count
    plain = seen and settings.surfaces and settings.program is None and bool(light.cameras) and light.paths > 0
    if not plain or max(usual, 2) * sample < _WORTH * of_tracing(light.paths):
        return SamplePlan(usual)
    return SamplePlan(usual, sample, pixels.averaged)


def cell_of(width: int, height: int) -> int:
    """Return the side of the second pilot's cells: so many that all its rays are followed at once."""
    cell = _CELL
    while SAMPLES * -(-width // cell) * -(-height // cell) > LANES:
        cell *= 2
    return cell


def pilot_pixels(width: int, height: int) -> UInt32:
    """Return the numbers of the pixels that the second pilot sees in a whole picture: one of each cell, at random."""
    cell = cell_of(width, height)
    columns, rows = -(-width // cell), -(-height // cell)
    index, side = dr.arange(UInt32, columns * rows), dr.opaque(UInt32, cell)
    place = hash32(index, UInt32(0))
    across, down = dr.opaque(UInt32, columns), dr.opaque(UInt32, width)
    x = dr.minimum(index % across * side + place % side, down - 1)
    y = dr.minimum(index // across * side + (place >> 8) % side, dr.opaque(UInt32, height - 1))
    result = y * down + x
    dr.eval(result)
    return result


def _of_blocks(cells: Array, reduce: np.ufunc | None = None) -> Array:
    """Return what a function such as `np.maximum` makes of blocks of cells, or their means; the last may be smaller."""
    (rows, columns), kind = (np.arange(0, size, _BLOCK) for size in cells.shape), reduce or np.add
    result: Array = kind.reduceat(kind.reduceat(cells, rows, axis=0), columns, axis=1)
    if reduce is not None:
        return result
    sizes = [np.diff([*first, size]) for first, size in zip((rows, columns), cells.shape, strict=True)]
    return result / np.multiply.outer(*sizes)


def _widely(blocks: Array) -> Array:
    """Return the means of blocks with those up to `_WIDE` blocks away."""
    wide = np.pad(blocks, _WIDE, mode="edge")
    view = np.lib.stride_tricks.sliding_window_view
    rows = view(wide, 2 * _WIDE + 1, axis=0).mean(axis=-1)
    result: Array = view(rows, 2 * _WIDE + 1, axis=1).mean(axis=-1)
    return result


def _around(blocks: Array, reduce: Callable[..., Array] = np.mean) -> Array:
    """Return the means of blocks with those around them, or what another function makes of them."""
    rows, columns = blocks.shape
    wide = np.pad(blocks, 1, mode="edge")
    return reduce([wide[y : y + rows, x : x + columns] for y in range(3) for x in range(3)], axis=0)
