"""Widths of scattered beams where few of them are.

The usual width of a scattered beam follows from the number of its lamp's paths, as if these were everywhere in the
medium. Most may be elsewhere: in the chamber of a lamp whose light comes through a slit into a room, say. The few beams
in the room would be seen one by one, as streaks. So a beam is at least so wide that a point is covered by a dozen:

    r ≥ √(12 / (π n)),

where n is the length of beams in a volume, over the volume. It is counted in the smallest cells that have enough beams.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import drjit as dr
import numpy as np

from ...numerics.arrays import to_float, to_numpy
from ...runtime.device import Float
from ...scene import Array
from .radii import Width
from .records import Segments

# Beams that cover a point at least; places along each beam that are counted; cells along each axis of the grids, fine
# to coarse; and places in a cell that are enough.
_COVERING, _PLACES, _CELLS, _ENOUGH = 12.0, 4, (16, 8, 4, 2, 1), 12
_GOLDEN = 0.5 * (np.sqrt(5) - 1)


def widened(segments: Sequence[Segments], center: Array, extent: float) -> list[Segments]:
    """Return the segments of a pass, of which scattered ones are wider where few of their lamp's are in a medium.

    `center` and `extent` are those of the region with everything in it; what lies outside counts to its outer cells.
    """
    if not segments:
        return []
    columns = [_columns(each) for each in segments]
    places, weights, radius, kind = (np.concatenate(each) for each in zip(*columns, strict=True))
    radii = np.stack([radius, radius], axis=1)
    for each in np.unique(kind[kind >= 0]):
        own = np.flatnonzero(kind == each)
        least = _least(np.clip(places[own], center - extent, center + extent), weights[own])
        halves = least.reshape(len(own), 2, _PLACES // 2).mean(axis=2)
        radii[own] = np.maximum(radii[own], halves)
    parts = np.split(radii, np.cumsum([len(each[2]) for each in columns])[:-1])
    return [_with(each, part) for each, part in zip(segments, parts, strict=True)]


def _columns(segments: Segments) -> tuple[Array, ...]:
    """Return places along segments, (N, P, 3), the length for which each stands, radii, and numbers of kinds, (N,).

    The kind stands for a lamp in a medium; it is −1 for light that was not scattered.
    """
    *lines, radius = to_numpy([*segments.origin, *segments.direction, segments.length, segments.width.radius])
    rows = np.stack(lines, axis=1)
    rows = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, 0)
    origin, direction, length = rows[:, None, :3], rows[:, None, 3:6], rows[:, 6]
    # A turn for each, so that beams side by side are not all counted in the same planes.
    turn = np.arange(len(length)) * _GOLDEN % 1
    along = ((np.arange(_PLACES) + turn[:, None]) / _PLACES).astype(np.float32)
    places = origin + direction * (along * length[:, None])[..., None]
    numbers = to_numpy([segments.source, segments.medium]).astype(np.int64)
    kind = np.where(segments.scattered.numpy() & (length > 0), numbers[0] << 32 | numbers[1], -1)
    return places, length / _PLACES, radius, kind


def _least(places: Array, lengths: Array) -> Array:
    """Return the least radii at places, (N, P, 3), each of which stands for a length of beam, (N,)."""
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    size = np.maximum(high - low, 1e-9 * max(float((high - low).max()), 1e-30))
    inside, weights = (places - low) / size, np.repeat(lengths, _PLACES)
    density = np.zeros(places.shape[:2])
    for side in _CELLS:
        cells = np.minimum((inside * side).astype(np.int64), side - 1) @ [1, side, side**2]
        known = np.bincount(cells.ravel(), weights) / (size / side).prod()
        first = (density == 0) & ((np.bincount(cells.ravel())[cells] >= _ENOUGH) | (side == _CELLS[-1]))
        density[first] = known[cells[first]]
        if density.all():
            break
    least: Array = np.sqrt(_COVERING / (np.pi * np.maximum(density, 1e-30)))
    return least


def _with(segments: Segments, radii: Array) -> Segments:
    """Return segments of which the scattered ones have these radii at their two ends, (N, 2)."""
    result = copy(segments)
    start, end = (to_float(each) for each in radii.T)
    slope = (end - start) * dr.rcp(dr.maximum(segments.length, 1e-30))
    own = Width(Float(0), start, Float(0), slope)
    result.width = dr.select(segments.scattered, own, segments.width)
    dr.eval(result.width)
    return result
