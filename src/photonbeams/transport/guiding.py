"""Guided emission: which samples of an emitter reach what the camera sees (Jensen 1995; Guo et al. 2018, simplified).

A pilot (`transport.pilot`) finds emission samples, points of the unit cube, whose light cameras see. A tree of boxes
learns their density: each box is halved as long as there are samples enough. The tree warps uniform samples to that
density: they go down it, and are stretched at each box in proportion to the probabilities of its halves.

A part of the samples stays uniform, so that light which the pilot missed is found, too, and the estimate is unbiased
for any tree. The map is linear in each box, so it keeps strata together, and scales ray differentials by known factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..scene import Array

# The part of samples that stays uniform.
_UNIFORM = 0.1
# Boxes with fewer samples are not halved, nor those that are so many levels down.
_LEAST, _DEEPEST = 4, 40
# Each half counts as if it had so many samples more: few of them prove little.
_PRIOR = 2.0
# The greatest weight of a sample against the mean.
_BRIGHTEST = 8.0
# The part of the samples with visible light whose widths are below the greatest.
_SEEN = 0.95
# Orders of the axes that are halved: of the sun it matters where light passes, of a small lamp where it goes.
_ORDERS = (0, 1), (2, 3), (2, 3, 0, 1)
#: Emission stays uniform where visible light fills a greater part of the cube: strata are worth more then, the more so
#: for light straight from its emitter, whose beams lie side by side. Seen from within a shaft of which a fifth is in
#: the picture, guided beams err several times as much as uniform ones.
ENOUGH, ENOUGH_STRAIGHT = 0.5, 0.1


@dataclass(frozen=True)
class GuidingMap:
    """A map of the 4D unit cube onto itself, by a tree of boxes that are halved.

    Attributes
    ----------
    axis
        The axis along which each box is halved, −1 where it is not. The first box is the cube.
    child
        The number of its lower half; the upper half is the next one.
    fraction
        The fraction of a box's samples that is in its lower half.
    widest
        The greatest factors on widths, by place and by direction: see `widths`.
    """

    axis: Array
    child: Array
    fraction: Array
    widest: Array = field(default_factory=lambda: np.full(2, np.inf))

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return the images of points (N, 4), and the derivative of the map along each axis there, (N, 4)."""
        inside = points.astype(np.float64)
        low, size, stretch = np.zeros_like(inside), np.ones_like(inside), np.ones_like(inside)
        node, rows = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
        while len(rows := rows[self.axis[node[rows]] >= 0]):
            box = node[rows]
            axis, fraction = self.axis[box], self.fraction[box]
            place = inside[rows, axis]
            upper = place >= fraction
            own = np.where(upper, 1 - fraction, fraction)
            inside[rows, axis] = np.clip((place - np.where(upper, fraction, 0)) / own, 0, 1)
            size[rows, axis] *= 0.5
            low[rows, axis] += size[rows, axis] * upper
            stretch[rows, axis] *= 0.5 / own
            node[rows] = self.child[box] + upper
        place = np.minimum(low + size * inside, np.nextafter(np.float32(1), np.float32(0)))
        return place.astype(np.float32), stretch

    def widths(self, derivatives: Array) -> Array:
        """Return factors on the widths of beams by place and by direction, (N, 2), for derivatives of the map (N, 4).

        Samples fill cells of any aspect, so those of a pair are as wide by either number. Where light begins that no
        camera sees samples are rare, and beams would be so wide that they shine through walls: they are no wider than
        where it is seen.
        """
        return np.minimum(np.sqrt(derivatives[:, 0::2] * derivatives[:, 1::2]), self.widest)

    def density(self, points: Array) -> Array:
        """Return the density of the images at points (N, 4)."""
        return 1 / self.stretches(points).prod(axis=1)

    def stretches(self, points: Array) -> Array:
        """Return the derivatives of the map along each axis where its images are points (N, 4)."""
        inside, result = points.astype(np.float64), np.ones(points.shape)
        node, rows = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
        while len(rows := rows[self.axis[node[rows]] >= 0]):
            box = node[rows]
            axis, fraction = self.axis[box], self.fraction[box]
            place = 2 * inside[rows, axis]
            upper = place >= 1
            inside[rows, axis] = place - upper
            result[rows, axis] *= 0.5 / np.where(upper, 1 - fraction, fraction)
            node[rows] = self.child[box] + upper
        return result


def learn(points: Array, weights: Array, enough: float = ENOUGH) -> GuidingMap | None:
    """Return the guiding map for samples (N, 4) of visible light with weights (N,); None where uniform ones serve.

    They do where visible light fills `enough` of the cube. Half of the samples tell in which order axes are best split,
    by how likely the trees of the other half find them.
    """
    known = weights > 0
    points, weights = points[known], weights[known].astype(np.float64)
    if len(weights) < 4 * _LEAST:
        return None
    weights = np.minimum(weights, _BRIGHTEST * weights.mean())
    gains = [_gain(_grown(points[::2], weights[::2], order), points[1::2], weights[1::2]) for order in _ORDERS]
    if not np.exp(-max(gains)) < enough:
        return None
    guide = _grown(points, weights, _ORDERS[int(np.argmax(gains))])
    widths = guide.widths(guide.stretches(points))
    return replace(guide, widest=np.quantile(widths, _SEEN, axis=0))


def _gain(guide: GuidingMap, points: Array, weights: Array) -> float:
    """Return the mean logarithm of a map's density: e to minus it is the part of the cube that the map fills."""
    return float((weights * np.log(guide.density(points))).sum() / weights.sum())


def _grown(points: Array, weights: Array, order: Sequence[int]) -> GuidingMap:
    """Return the map of a tree of boxes that are halved along axes in this order while they have enough samples.

    The probabilities of halves are those of a Pólya tree (Lavine 1992): as if each had some samples more.
    """
    more = _PRIOR * weights.mean()
    inside, node, own = points.astype(np.float64), np.zeros(len(points), dtype=np.int64), weights
    axes, lower, sums = [np.full(1, -1)], [np.full(1, 0.5)], [np.full(1, 1.0)]
    children, first = [np.zeros(1, dtype=np.int64)], 1
    for depth in range(_DEEPEST):
        axis = order[depth % len(order)]
        split = np.bincount(node, minlength=len(axes[-1])) >= _LEAST
        if not split.any():
            break
        kept = split[node]
        inside, own = inside[kept], own[kept]
        inside[:, axis] *= 2
        upper = inside[:, axis] >= 1
        inside[:, axis] -= upper
        node = 2 * (np.cumsum(split) - 1)[node[kept]] + upper
        parents = np.flatnonzero(split)
        found = np.bincount(node, own, minlength=2 * len(parents)) + more
        axes[-1][parents], children[-1][parents] = axis, first + 2 * np.arange(len(parents))
        part = found / np.repeat(found[::2] + found[1::2], 2)
        sums.append(part * np.repeat(sums[-1][parents], 2))
        first += 2 * len(parents)
        axes.append(np.full(2 * len(parents), -1))
        lower.append(np.full(2 * len(parents), 0.5))
        children.append(np.zeros(2 * len(parents), dtype=np.int64))
    return _mapped(axes, children, sums)


def _mapped(axes: list[Array], children: list[Array], sums: list[Array]) -> GuidingMap:
    """Return the map of a tree, given by levels: axes, lower halves and probabilities; some samples stay uniform."""
    child = np.concatenate(children)
    part = np.concatenate(
        [(1 - _UNIFORM) * own + _UNIFORM * 0.5**level for level, own in enumerate(sums)]
    )  # a box of level k has the volume 2^-k
    return GuidingMap(np.concatenate(axes), child, part[child] / np.where(np.concatenate(axes) < 0, 1, part))
