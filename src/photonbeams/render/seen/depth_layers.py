"""Layers of a holdout: what covers only a part of a pixel, or several depths of it.

A sample of a deep picture covers the fraction A of what is behind it, from Z on if it is a surface, and of fog between
Z and ZBack so much that the rest falls exponentially ("Interpreting OpenEXR Deep Pixels", Hillman 2013). So the
optical depth -log(1 - A) grows by a step at Z, or linearly from Z to ZBack. Those of samples that overlap add up. A
flat picture with an alpha is one step in each pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...scene import Array

#: The optical depth of what is opaque: e^-40 is nothing beside the steps of random numbers, 2^-24.
OPAQUE = 40.0
# Volumes that are thinner than this fraction of their depth are surfaces.
_THIN = 1e-5
_TOGETHER = 1 << 18  # samples whose layers are found together


@dataclass(frozen=True)
class DepthLayers:
    """Layers of a picture's pixels, row by row, and in a pixel from front to back, without overlaps.

    Attributes
    ----------
    counts
        (H, W) integers: how many layers each pixel has.
    front, back
        (N,) depths, the same for a surface.
    optical
        (N,) optical depth of a pixel up to the end of each layer.
    """

    counts: Array
    front: Array
    back: Array
    optical: Array

    @classmethod
    def of_surfaces(cls, depth: Array, alpha: Array) -> DepthLayers:
        """Return one surface in each pixel, (H, W), that covers `alpha` of it; infinite depths are no surface."""
        there = np.isfinite(depth) & (alpha > 0)
        found = np.asarray(depth, np.float64)[there]
        return cls(there.astype(np.int64), found, found, _optical(alpha[there]))

    @classmethod
    def of_samples(cls, counts: Array, front: Array, back: Array, alpha: Array) -> DepthLayers:
        """Return the layers of samples, (N,), of which pixels have `counts`, (H, W), in any order; they may overlap."""
        ends = np.cumsum(counts.ravel())
        # Some pixels at a time: the steps on the way take many times as much memory as the layers.
        last = np.unique(np.searchsorted(ends, np.arange(_TOGETHER, len(front), _TOGETHER)))
        parts = []
        for begin, end in pairwise([0, *last.tolist(), counts.size]):
            own = slice(ends[begin - 1] if begin else 0, ends[end - 1] if end else 0)
            parts.append(cls._of_some(counts.ravel()[begin:end], front[own], back[own], alpha[own]))
        return cls(
            np.concatenate([each.counts for each in parts]).reshape(counts.shape),
            *(np.concatenate([getattr(each, name) for each in parts]) for name in ("front", "back", "optical")),
        )

    @classmethod
    def _of_some(cls, counts: Array, front: Array, back: Array, alpha: Array) -> DepthLayers:
        """Return the layers of the samples of some pixels, (P,)."""
        front, back = (np.asarray(each, np.float64) for each in (front, back))
        pixel = np.repeat(np.arange(counts.size), counts.ravel())
        there = alpha > 0
        pixel, front, back, optical = pixel[there], front[there], back[there], _optical(alpha[there])
        solid = (back - front <= _THIN * back) | (optical >= OPAQUE)
        back = np.where(solid, front, back)
        density = np.where(solid, 0.0, optical / np.where(solid, 1.0, back - front))
        # Optical depths of a pixel change at places: steps of surfaces, and slopes from where a volume begins or ends.
        of = np.concatenate([pixel, pixel])
        place = np.concatenate([front, back])
        step, slope = np.concatenate([optical * solid, 0 * optical]), np.concatenate([density, -density])
        order = np.lexsort((place, of))
        of, place, step, slope = of[order], place[order], step[order], slope[order]
        same = of[1:] == of[:-1]
        volume = np.where(same, _sums(slope, of)[:-1] * np.diff(place), 0.0) if len(of) else slope
        # Each place is a layer for its step, and then one for the volume up to the next place.
        grown = np.stack([step, np.append(volume, 0.0)[: len(of)]], axis=1).ravel()
        begin = np.repeat(place, 2)
        end = np.stack([place, np.append(place[1:], 0.0)[: len(of)]], axis=1).ravel()
        of = np.repeat(of, 2)
        thick = grown > 1e-9
        of, begin, end, grown = of[thick], begin[thick], end[thick], grown[thick]
        number = np.bincount(of, minlength=counts.size).reshape(counts.shape)
        return cls(number, begin, end, _sums(grown, of))

    def nearest(self) -> Array:
        """Return the nearest depth of each pixel, (H, W); infinite where there is none."""
        result, some = np.full(self.counts.size, np.inf), self.counts.ravel() > 0
        result[some] = self.front[self.starts()[:-1][some]]
        return result.reshape(self.counts.shape)

    def starts(self) -> Array:
        """Return the number of the first layer of each pixel, and how many there are in all, (H W + 1,)."""
        return np.concatenate([[0], np.cumsum(self.counts.ravel())])

    def times(self, factor: Array) -> DepthLayers:
        """Return layers whose depths are multiplied by `factor`, (H, W)."""
        each = np.repeat(np.asarray(factor).ravel(), self.counts.ravel())
        return DepthLayers(self.counts, self.front * each, self.back * each, self.optical)

    def taken(self, pixels: Array) -> DepthLayers:
        """Return the layers of pixels with these numbers, (H', W'); of -1 there are none."""
        if np.array_equal(pixels.ravel(), np.arange(self.counts.size)):
            return replace(self, counts=self.counts.reshape(pixels.shape))
        there = pixels >= 0
        counts = np.where(there, self.counts.ravel()[np.where(there, pixels, 0)], 0)
        first = np.repeat(self.starts()[np.where(there, pixels, 0)].ravel(), counts.ravel())
        within = np.arange(len(first)) - np.repeat(np.cumsum(counts.ravel()) - counts.ravel(), counts.ravel())
        index = first + within
        return DepthLayers(counts, self.front[index], self.back[index], self.optical[index])

    def slopes(self, axis: int, inside: tuple[int, int, int, int]) -> Array:
        """Return the change of 1/Z from pixel to pixel, (N,), along an axis of the picture: the smaller of two, or 0.

        They lead to the layers of the pixels on either side that are nearest in 1/Z; a pixel without a layer has 0.
        Pixels `inside` (left, top, right, bottom) of the picture do not depend on others. Volumes have no slope.
        """
        shape, counts, starts = self.counts.shape, self.counts.ravel(), self.starts()
        if not len(self.front):
            return np.zeros(0)
        pixel = np.repeat(np.arange(counts.size), counts)
        place = pixel // shape[1], pixel % shape[1]
        # In a pixel layers are sorted by their depth, so that these keys are sorted in the whole picture.
        solid = self.front == self.back
        inverse = 1 / np.maximum(self.front, self.front[solid].min(initial=np.inf) if solid.any() else 1.0)
        rank = 0.9 * (1 - inverse / inverse.max())
        steps = [_step(inverse, pixel, starts, rank, _beside(place, axis, way, shape, inside), way) for way in (-1, 1)]
        before, after = (np.where(np.isnan(own), other, own) for own, other in (steps, steps[::-1]))
        smaller = np.sign(before) * np.minimum(np.abs(before), np.abs(after))
        found: Array = np.where((before * after > 0) & solid, smaller, 0.0)
        return found


def _optical(alpha: Array) -> Array:
    """Return optical depths, up to that of what is opaque."""
    with np.errstate(divide="ignore"):
        found: Array = np.minimum(-np.log1p(-np.minimum(np.asarray(alpha, np.float64), 1.0)), OPAQUE)
    return found


def _sums(values: Array, of: Array) -> Array:
    """Return the sums of values up to each one, apart for each run of the same number `of`."""
    if not len(values):
        return values
    total = np.cumsum(values)
    first = np.flatnonzero(np.append(True, of[1:] != of[:-1]))
    before = np.repeat(total[first] - values[first], np.diff(np.append(first, len(of))))
    found: Array = total - before
    return found


def _beside(place: tuple[Array, Array], axis: int, way: int, shape: tuple[int, ...], inside: tuple[int, ...]) -> Array:
    """Return the numbers of the pixels beside others, -1 beyond the picture, and from inside of `inside` beyond it."""
    there = tuple(own + way * (number == axis) for number, own in enumerate(place))
    left, top, right, bottom = inside

    def within(row: Array, column: Array) -> Array:
        return (row >= top) & (row < bottom) & (column >= left) & (column < right)

    known = (there[axis] >= 0) & (there[axis] < shape[axis]) & (within(*there) | ~within(*place))
    return np.where(known, there[0] * shape[1] + there[1], -1)


def _step(inverse: Array, pixel: Array, starts: Array, rank: Array, beside: Array, way: int) -> Array:
    """Return the change of 1/Z to the nearest layer of other pixels, per pixel; NaN where there is no other pixel."""
    other = np.maximum(beside, 0)
    low, high = starts[other], starts[other + 1]
    empty, last = low == high, len(inverse) - 1
    found = np.searchsorted(pixel + rank, other + rank)
    near = [inverse[np.clip(np.clip(found - back, low, high - 1), 0, last)] for back in (1, 0)]
    value = np.where(np.abs(near[0] - inverse) < np.abs(near[1] - inverse), *near)
    step: Array = np.where(beside < 0, np.nan, way * (np.where(empty, 0.0, value) - inverse))
    return step
