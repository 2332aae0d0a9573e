"""Guided emission: learn which emission samples cameras see (Jensen 1995; Guo et al. 2018, simplified).

A pilot (`guiding.pilot`) finds emission samples, points of the 4D unit cube, whose light cameras see. A tree of boxes
learns their density: each box is halved as long as it has enough samples. The tree warps uniform samples to that
density: they descend it, and at each box they are stretched in proportion to the probabilities of its halves.

A fraction of the samples stays uniform. So light that the pilot missed is found, too, and the estimate is unbiased for
any tree. The map is linear in each box, so it keeps strata together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from ...scene import Array

# Fractions of samples that stay uniform. Half of them do where the pilot found too little to tell where light is: what
# few samples say is then wrong at some places, whose beams would be bright streaks. Where only light straight from its
# emitter counts, such a map is worth less than strata.
_UNIFORM = 0.1, 0.5
# Least numbers of samples in a box that is halved, and the deepest level. Small numbers find narrow gaps, large ones
# are better where light is even; so a tree is grown for each, and judged by samples that it does not know.
_LEAST, _DEEPEST = (4, 16, 64), 40
# Each half counts as if it had this many samples more, because a few samples prove little.
_PRIOR = 2.0
# Greatest weight of a sample, relative to the mean.
BRIGHTEST = 8.0
# Total weight of samples whose light is blocked, relative to visible ones: they find the holes that the pilot missed.
_DOUBT = 0.25
# Orders in which axes are halved. For the sun, the place of a path matters; for a small lamp, its direction.
_ORDERS = (0, 1), (2, 3), (2, 3, 0, 1)
#: Emission stays uniform unless guiding reduces the variance of visible light to less than this fraction. Otherwise
#: strata are worth more, above all for light straight from its emitter, whose beams lie side by side, while beams
#: outside the picture cost little. Most strata of a portal are in the picture.
ENOUGH, ENOUGH_STRAIGHT, ENOUGH_PORTAL = 0.9, 0.4, 0.1


@dataclass(frozen=True)
class _Boxes:
    """A tree of boxes as in `GuidingMap`, with the part of the weights, the volume and the number of samples of each.

    A tree with a greater least number is the same, but for boxes with fewer samples, which it does not halve.
    """

    axis: Array
    child: Array
    part: Array
    volume: Array
    held: Array

    def fraction(self, uniform: float, least: int = 0) -> Array:
        """Return `GuidingMap.fraction` if a fraction of the samples stays uniform, and ½ in boxes with too few."""
        part = (1 - uniform) * self.part + uniform * self.volume
        lower = part[self.child] / np.where(self.axis < 0, 1, part)
        return lower if least == 0 else np.where(self.held < least, 0.5, lower)


@dataclass(frozen=True)
class GuidingMap:
    """A map of the 4D unit cube onto itself, by a tree of boxes that are halved.

    Attributes
    ----------
    axis
        The axis along which each box is halved, one for all of a level; −1 if it is not. The first box is the cube.
    child
        The number of each box's lower half; the upper half is the next one.
    fraction
        The fraction of each box's samples that is in its lower half.
    widths
        Factors on the widths of beams by place and by direction, (2,): the roots of the mean room of visible light.
        They are the same for all samples. If each beam had the width of its own room, wide beams from where samples are
        rare would shine into what the camera sees, but the narrow beams there would not shine back.
    """

    axis: Array
    child: Array
    fraction: Array
    widths: Array = field(default_factory=lambda: np.ones(2))

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return the images of `points`, (N, 4), and the derivative of the map along each axis there, (N, 4)."""
        inside = points.astype(np.float64).T.copy()
        low, size, stretch = np.zeros_like(inside), np.ones_like(inside), np.ones_like(inside)
        node, rows = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
        while len(kept := np.flatnonzero(self.axis[node] >= 0)):
            node, rows = node[kept], rows[kept]
            at, fraction = (self.axis[node[0]], rows), self.fraction[node]  # a level is halved along one axis
            place = inside[at]
            upper = place >= fraction
            own = np.where(upper, 1 - fraction, fraction)
            inside[at] = np.clip((place - np.where(upper, fraction, 0)) / own, 0, 1)
            size[at] *= 0.5
            low[at] += size[at] * upper
            stretch[at] *= 0.5 / own
            node = self.child[node] + upper
        place = np.minimum(low + size * inside, np.nextafter(np.float32(1), np.float32(0)))
        return np.ascontiguousarray(place.T, np.float32), np.ascontiguousarray(stretch.T)

    def evened(self, uniform: float) -> GuidingMap:
        """Return a map with the mean of this one's density and 1, which has the weight `uniform`."""
        part, volume = np.ones(len(self.axis)), np.ones(len(self.axis))
        boxes = np.zeros(1, dtype=np.int64)
        while len(boxes := boxes[self.axis[boxes] >= 0]):
            lower, own = self.child[boxes], self.fraction[boxes]
            part[lower], part[lower + 1] = part[boxes] * own, part[boxes] * (1 - own)
            volume[lower] = volume[lower + 1] = 0.5 * volume[boxes]
            boxes = np.concatenate([lower, lower + 1])
        even = uniform * volume + (1 - uniform) * part
        return replace(self, fraction=np.where(self.axis < 0, 1, even[self.child] / even))

    def density(self, points: Array) -> Array:
        """Return the density of images at `points`, (N, 4)."""
        return 1 / self.stretches(points).prod(axis=1)

    def stretches(self, points: Array) -> Array:
        """Return the derivatives of the map along each axis, (N, 4), where its images are `points`, (N, 4)."""
        return _stretches(self.axis, self.child, [self.fraction], points)[0]


def _stretches(axis: Array, child: Array, fractions: Sequence[Array], points: Array) -> list[Array]:
    """Return `GuidingMap.stretches` of maps whose boxes are the same, but for their `fractions`."""
    inside, result = points.astype(np.float64).T.copy(), [np.ones((4, len(points))) for _ in fractions]
    node, rows = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
    while len(kept := np.flatnonzero(axis[node] >= 0)):
        node, rows = node[kept], rows[kept]
        at = axis[node[0]], rows
        place = 2 * inside[at]
        upper = place >= 1
        inside[at] = place - upper
        for stretch, lower in zip(result, fractions, strict=True):
            part = lower[node]
            stretch[at] *= 0.5 / np.where(upper, 1 - part, part)
        node = child[node] + upper
    return [np.ascontiguousarray(each.T) for each in result]


def learn(points: Array, weights: Array, stopped: Array | None = None, enough: float = ENOUGH) -> GuidingMap | None:
    """Return the guiding map for samples of visible light; None if uniform samples serve as well.

    Trees are grown from half of the samples. The best tree is the one in which the other half has the least room, on
    average. The room of a sample is 1 / density. Its mean is the variance of the light by guided samples, relative to
    uniform ones.

    Parameters
    ----------
    points, weights
        The samples, (N, 4), and their weights, (N,).
    stopped
        Samples whose light is blocked before it is seen, (M, 4); a fraction of the guided samples follows them.
    enough
        The greatest mean room for which guiding is worthwhile.
    """
    known = weights > 0
    points, weights = points[known], weights[known].astype(np.float64)
    if len(weights) < 4 * _LEAST[0]:
        return None
    weights = np.minimum(weights, BRIGHTEST * weights.mean())
    judge, own = points[1::2], weights[1::2] / weights[1::2].sum()
    cells = {}
    uniform = _UNIFORM if enough >= ENOUGH else _UNIFORM[:1]
    for order in _ORDERS:
        tree, ways = _grown(*_with(points[::2], weights[::2], stopped), order, _LEAST[0]), [*product(uniform, _LEAST)]
        stretches = _stretches(tree.axis, tree.child, [tree.fraction(*way) for way in ways], judge)
        for way, each in zip(ways, stretches, strict=True):
            cells[order, way] = each[:, 0::2] * each[:, 1::2]
    rooms = {each: float(own @ cell.prod(axis=1)) for each, cell in cells.items()}
    best = min(rooms, key=rooms.__getitem__)
    if not rooms[best] < enough:
        return None
    order, (fraction, least) = best
    tree = _grown(*_with(points, weights, stopped), order, least)
    return GuidingMap(tree.axis, tree.child, tree.fraction(fraction), np.sqrt(own @ cells[best]))


def _with(points: Array, weights: Array, stopped: Array | None) -> tuple[Array, Array]:
    """Return samples of visible light and samples whose light is blocked, with their weights."""
    if stopped is None or not len(stopped):
        return points, weights
    more = np.full(len(stopped), _DOUBT * weights.sum() / len(stopped))
    return np.concatenate([points, stopped]), np.concatenate([weights, more])


def _grown(points: Array, weights: Array, order: Sequence[int], least: int) -> _Boxes:
    """Return a tree of boxes, halved along axes in this order while they have `least` samples.

    The probabilities of halves are those of a Pólya tree (Lavine 1992), as if each half had a few samples more.
    """
    more = _PRIOR * weights.mean()
    inside, node, own = points.astype(np.float64), np.zeros(len(points), dtype=np.int64), weights
    axes, parts, counts = [np.full(1, -1)], [np.full(1, 1.0)], [np.full(1, len(points))]
    children, first = [np.zeros(1, dtype=np.int64)], 1
    for depth in range(_DEEPEST):
        axis = order[depth % len(order)]
        split = counts[-1] >= least
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
        parts.append(part * np.repeat(parts[-1][parents], 2))
        counts.append(np.bincount(node, minlength=2 * len(parents)))
        first += 2 * len(parents)
        axes.append(np.full(2 * len(parents), -1))
        children.append(np.zeros(2 * len(parents), dtype=np.int64))
    volumes = [np.full(len(own), 0.5**level) for level, own in enumerate(axes)]
    return _Boxes(*map(np.concatenate, (axes, children, parts, volumes, counts)))
