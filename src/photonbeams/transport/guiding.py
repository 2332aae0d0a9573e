"""Guided emission: which samples of an emitter reach what the camera sees (Jensen 1995; Guo et al. 2018, simplified).

A pilot (`transport.pilot`) finds emission samples, points of the unit cube, whose light cameras see. A tree of boxes
learns their density: each box is halved as long as there are samples enough. The tree warps uniform samples to that
density: they go down it, and are stretched at each box in proportion to the probabilities of its halves.

A part of the samples stays uniform, so that light which the pilot missed is found, too, and the estimate is unbiased
for any tree. The map is linear in each box, so it keeps strata together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from ..scene import Array

# The part of samples that stays uniform.
_UNIFORM = 0.1
# Boxes with fewer samples are not halved, nor those that are so many levels down. Few find narrow gaps, many are better
# where light is even: each tree is judged by samples that it does not know.
_LEAST, _DEEPEST = (4, 16, 64), 40
# Each half counts as if it had so many samples more: few of them prove little.
_PRIOR = 2.0
# The greatest weight of a sample against the mean.
BRIGHTEST = 8.0
# How often samples follow light that something stops, against light that is seen: they find the holes that the pilot
# missed.
_DOUBT = 0.25
# Orders of the axes that are halved: of the sun it matters where light passes, of a small lamp where it goes.
_ORDERS = (0, 1), (2, 3), (2, 3, 0, 1)
#: Emission stays uniform where visible light has, by guided samples, more than this part of the variance that it has by
#: uniform ones: strata are worth more then, above all for light straight from its emitter, whose beams lie side by
#: side, and beams beside the picture cost little. Most strata of a portal are in the picture.
ENOUGH, ENOUGH_STRAIGHT, ENOUGH_PORTAL = 0.9, 0.4, 0.1


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
    widths
        Factors on the widths of beams by place and by direction, (2,), the same for all samples: the roots of the mean
        room of visible light. Were each as wide as its own room, the wide beams from where samples are rare would shine
        into what the camera sees, and the narrow ones from there not back.
    """

    axis: Array
    child: Array
    fraction: Array
    widths: Array = field(default_factory=lambda: np.ones(2))

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


def learn(points: Array, weights: Array, stopped: Array | None = None, enough: float = ENOUGH) -> GuidingMap | None:
    """Return the guiding map for samples (N, 4) of visible light with weights (N,); None where uniform ones serve.

    Half of the samples tell which tree is best: that of the others in which they have the least room, on average. The
    room of a sample is 1 / density; its mean is the variance of the light by guided samples against uniform ones.

    Parameters
    ----------
    points, weights
        The samples.
    stopped
        Samples whose light something stops before it is seen, (M, 4): a part of the guided samples follows them.
    enough
        The greatest mean room of samples that are worth guiding.
    """
    known = weights > 0
    points, weights = points[known], weights[known].astype(np.float64)
    if len(weights) < 4 * _LEAST[0]:
        return None
    weights = np.minimum(weights, BRIGHTEST * weights.mean())
    judge, own = points[1::2], weights[1::2] / weights[1::2].sum()
    cells = {}
    for way in product(_ORDERS, _LEAST):
        stretches = _grown(*_with(points[::2], weights[::2], stopped), *way).stretches(judge)
        cells[way] = stretches[:, 0::2] * stretches[:, 1::2]
    rooms = {way: float(own @ each.prod(axis=1)) for way, each in cells.items()}
    best = min(rooms, key=rooms.__getitem__)
    if not rooms[best] < enough:
        return None
    return replace(_grown(*_with(points, weights, stopped), *best), widths=np.sqrt(own @ cells[best]))


def _with(points: Array, weights: Array, stopped: Array | None) -> tuple[Array, Array]:
    """Return samples of visible light, and those whose light something stops."""
    if stopped is None or not len(stopped):
        return points, weights
    more = np.full(len(stopped), _DOUBT * weights.sum() / len(stopped))
    return np.concatenate([points, stopped]), np.concatenate([weights, more])


def _grown(points: Array, weights: Array, order: Sequence[int], least: int) -> GuidingMap:
    """Return the map of a tree of boxes that are halved along axes in this order while they have `least` samples.

    The probabilities of halves are those of a Pólya tree (Lavine 1992): as if each had some samples more.
    """
    more = _PRIOR * weights.mean()
    inside, node, own = points.astype(np.float64), np.zeros(len(points), dtype=np.int64), weights
    axes, lower, sums = [np.full(1, -1)], [np.full(1, 0.5)], [np.full(1, 1.0)]
    children, first = [np.zeros(1, dtype=np.int64)], 1
    for depth in range(_DEEPEST):
        axis = order[depth % len(order)]
        split = np.bincount(node, minlength=len(axes[-1])) >= least
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
