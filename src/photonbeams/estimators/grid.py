"""Radiance of beams toward any rays by a grid in the world, for what camera rays see through glass and in mirrors.

Each cell lists the beams that may lie in it. A ray walks the cells (Amanatides & Woo 1987, "A Fast Voxel Traversal
Algorithm for Ray Tracing") and visits their lists. A beam lies in several cells of a ray but counts in only one: the
billboard where the ray comes closest to the axis, the frustum at the middle of the chord. Either place is a ray
parameter t that depends only on beam and ray; it belongs to the cell with t_enter ≤ t < t_exit. The t_exit of a cell
and the t_enter of the next are the same number; the first t_enter and the last t_exit are infinite. So every t belongs
to one cell of the ray, in spite of rounding; and the beam is in that cell's list, because beams are enlarged for the
lists.

No part of a beam that a ray can meet lies outside of the grid: its box holds the segments of all rays in the beams'
box.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..beams import Beams
from ..looks import BoundLook
from ..numerics.arrays import opaque
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Array4f, Bool, Float, Int32, UInt32
from .billboard import billboard
from .cells import ROUNDING, CellGrid, CellLists, Entry, Sorting, batches, fitting
from .coarse_rays import RayImages
from .cones import around, half_line
from .frustum import frustum
from .geometry import Rays, between
from .points import Points
from .records import SHORTEST, Packed, load

# A billboard of `auto` reaches out to 1/√(1 − 0.1²) radii (see blend), and a radius is rounded.
_WIDER = 1.006

_FAR = 1e30

# Costs in tests of a beam. Measured on two AVX-512 cores; a factor of two either way changes the total time by a few
# per cent.
_STEP = 0.5  # of a ray to the next cell
_ENTRY = 10.0  # of the lists


def sum_over_grid(
    beams: Beams, close: Beams | None, packed: Packed, rays: Rays, look: BoundLook, estimator: str, points: Points,
    images: RayImages | None = None,
) -> Array3f:  # fmt: skip
    """Return the radiance of all beams toward all rays: the sum of `sum_over_all`, added in another order.

    With `images`, the radiance along some rays is interpolated.
    """
    radiance = dr.zeros(Array3f, dr.width(rays.direction))
    built = build(beams, close, rays)
    if built is None:
        return radiance
    grid, marks, span = built
    for lists in batches(partial(Sorting, grid.cells, marks.visit), len(beams)):
        if not lists.entries:
            continue
        visitor = partial(_added, packed, look, estimator, points)

        def along(some: UInt32, lists: CellLists = lists, visitor: Callable[..., Array3f] = visitor) -> Array3f:
            own = [dr.gather(Float, each, some) for each in span]
            return traverse_grid(rays.taken(some), (own[0], own[1]), grid, lists, visitor)

        if images is None:
            radiance = radiance + traverse_grid(rays, span, grid, lists, visitor)
        else:
            radiance = radiance + images.radiance(rays, along)
        dr.eval(radiance)
    return radiance


# -- Which beams lie in which cell -------------------------------------------------------------------------------------


@dataclass
class Marks:
    """Bounds of each beam over the shutter interval: boxes around the discs at its two ends, and a cone.

    There are four packets of four numbers for each beam: centre of the first end's box and a radius, the same for the
    last end, and the half extents of both boxes. The beam lies within these radii about the line between the centres.
    """

    data: Any
    grid: Any = None

    def visit(self, item: UInt32, lane: UInt32, entry: Entry) -> None:
        """Visit the cells that a beam may lie in."""
        _cells_of(item, lane, self.data, self.grid, entry)

    def box(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return the corners of the box around all beams."""
        low, high = Array3f(_FAR), Array3f(-_FAR)
        for end in range(2):
            centre, half = self._packet(end).xyz, self._packet(2 + end).xyz
            low, high = dr.minimum(low, centre - half), dr.maximum(high, centre + half)
        return _least(low), -_least(-high)

    def _packet(self, number: int) -> Array4f:
        count = dr.width(self.data) // 16
        return dr.gather(Array4f, self.data, dr.arange(UInt32, count) * 4 + dr.opaque(UInt32, number))

    def sizes(self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> tuple[float, float, float, int]:
        """Return the volume, surface, length plus π radii, and number of the parts of beams in a box."""
        first, last = self._packet(0), self._packet(1)
        span = last.xyz - first.xyz
        radius = 0.5 * (first.w + last.w)
        corners = opaque(low), opaque(high)
        begin, stop = Float(0), Float(1)
        for axis in range(3):
            place = first[axis]
            a, b = between(span[axis], corners[0][axis] - radius - place, corners[1][axis] + radius - place)
            begin, stop = dr.maximum(begin, a), dr.minimum(stop, b)
        inside = begin < stop
        length = dr.select(inside, dr.norm(span) * (stop - begin), 0)
        radius = dr.select(inside, radius, 0)
        square = np.pi * dr.square(radius)
        sums = (square * length, 2 * square + 2 * np.pi * radius * length, length + np.pi * radius)
        volume, surface, reach = (float(dr.sum(each)[0]) for each in sums)
        number: Any = dr.count(inside)
        return volume, surface, reach, int(number[0])


def marks_of(beams: Beams, close: Beams | None) -> Marks:
    """Return the bounds of beams over the shutter interval.

    At any time the ends of a beam are convex combinations of those at shutter open and at shutter close.
    """
    cones = [around(each, each.start, each.end) for each in (beams, close) if each is not None]
    packets = []
    for end in range(2):
        places, radii = [cone[end] for cone in cones], [cone[2 + end] * _WIDER for cone in cones]
        if close is None:
            axis = cones[0].end - cones[0].start
            axis = axis * dr.rcp(dr.maximum(dr.norm(axis), 1e-20))
            packets.append((places[0], radii[0], dr.sqrt(dr.maximum(1 - axis * axis, 0)) * radii[0]))
            continue
        # Discs turn as the beam moves, so each is replaced by a ball.
        widest = dr.maximum(radii[0], radii[1])
        half = 0.5 * dr.abs(places[1] - places[0])
        packets.append((0.5 * (places[0] + places[1]), widest + dr.norm(half), half + widest))
    if close is not None:  # the discs of a moving beam are not perpendicular to the line between the boxes
        radius = dr.maximum(packets[0][1], packets[1][1])
        packets = [(place, radius, half) for place, _, half in packets]
    data = dr.zeros(Float, len(beams) * 16)
    number = dr.arange(UInt32, len(beams)) * 4
    # A beam without length has no axis and no light, and is listed nowhere.
    there = dr.isfinite(sum(dr.sum(place) + radius + dr.sum(half) for place, radius, half in packets))
    longest = dr.norm(beams.end - beams.start)
    if close is not None:
        longest = dr.maximum(longest, dr.norm(close.end - close.start))
    there &= longest > SHORTEST
    packets = [
        (dr.select(there, place, 0), dr.select(there, radius, 0), dr.select(there, half, -_FAR))
        for place, radius, half in packets
    ]
    for end, (place, radius, half) in enumerate(packets):
        dr.scatter(data, Array4f(place.x, place.y, place.z, radius), number + end)
        dr.scatter(data, Array4f(half.x, half.y, half.z, 0), number + (2 + end))
    dr.eval(data)
    return Marks(data)


@syntax
def _cells_of(item: UInt32, lane: UInt32, data: Float, grid: CellGrid, entry: Entry) -> None:
    """Visit the cells that a beam may lie in: layer by layer, row by row, from the first cell to the last.

    The boxes of a beam's discs change linearly from its start to its end. So the part of the beam in a layer or a row
    follows from linear inequalities. Of the cells in the boxes, only those near the axis count.
    """
    ends = [dr.gather(Array4f, data, item * 4 + end) for end in range(4)]
    first, last = grid.local(ends[0].xyz), grid.local(ends[1].xyz)
    half, grown = ends[2].xyz * grid.inv + grid.margin, (ends[3].xyz - ends[2].xyz) * grid.inv
    axis = last - first
    radius, growth = ends[0].w * grid.inv, (ends[1].w - ends[0].w) * grid.inv
    length2 = dr.squared_norm(axis)
    inv_length2 = dr.rcp(dr.maximum(length2, 1e-20))
    # Points of a cell are at most half a diagonal from its centre, and the radius there differs by the slope.
    diagonal = 0.8661
    more = diagonal + grid.margin + dr.minimum(dr.abs(growth), dr.abs(growth) * diagonal * dr.sqrt(inv_length2))
    low, high = dr.minimum(first - half, last - half - grown), dr.maximum(first + half, last + half + grown)
    z, last_z = grid.span(low.z, high.z, 2)
    last_z = dr.select(low.z <= high.z, last_z, -1)  # an empty box: the beam is listed nowhere
    while z <= last_z:
        in_layer = _part(axis.z, grown.z, first.z, half.z, Float(z), Float(0), Float(1))
        low_y, high_y = _reach(axis.y, grown.y, first.y, half.y, *in_layer)
        y, last_y = grid.span(low_y, high_y, 1)
        last_y = dr.select(in_layer[0] <= in_layer[1], last_y, -1)
        while y <= last_y:
            in_row = _part(axis.y, grown.y, first.y, half.y, Float(y), *in_layer)
            low_x, high_x = _reach(axis.x, grown.x, first.x, half.x, *in_row)
            x, last_x = grid.span(low_x, high_x, 0)
            last_x = dr.select(in_row[0] <= in_row[1], last_x, -1)
            while x <= last_x:
                centre = Array3f(Float(x), Float(y), Float(z)) + 0.5 - first
                fraction = dr.clip(dr.dot(centre, axis) * inv_length2, 0, 1)
                reach = dr.fma(growth, fraction, radius) + more
                entry(grid.number(x, y, z), item, lane, dr.squared_norm(centre - axis * fraction) <= dr.square(reach))
                x += 1
            y += 1
        z += 1


def _part(
    rate: Float, growth: Float, first: Float, half: Float, cell: Float, begin: Float, stop: Float
) -> tuple[Float, Float]:
    """Return the part of [begin, stop] along a beam in which its discs' boxes touch the cells from `cell` on.

    first − half + (rate − growth) λ ≤ cell + 1 and first + half + (rate + growth) λ ≥ cell
    """
    low0, high0 = half_line(rate - growth, first - half - (cell + 1))
    low1, high1 = half_line(-(rate + growth), cell - (first + half))
    return dr.maximum(begin, dr.maximum(low0, low1)), dr.minimum(stop, dr.minimum(high0, high1))


def _reach(rate: Float, growth: Float, first: Float, half: Float, begin: Float, stop: Float) -> tuple[Float, Float]:
    """Return how far the discs' boxes reach along an axis, between two fractions along a beam."""
    at_begin, at_stop = dr.fma(rate, begin, first), dr.fma(rate, stop, first)
    half_begin, half_stop = dr.fma(growth, begin, half), dr.fma(growth, stop, half)
    return dr.minimum(at_begin - half_begin, at_stop - half_stop), dr.maximum(
        at_begin + half_begin, at_stop + half_stop
    )


# -- The grid ----------------------------------------------------------------------------------------------------------


def build(beams: Beams, close: Beams | None, rays: Rays) -> tuple[CellGrid, Marks, tuple[Float, Float]] | None:
    """Return the grid for these rays, the beams' bounds, and the rays' span in it; None if no ray meets its box."""
    marks = marks_of(beams, close)
    low, high = marks.box()
    if np.any(low > high):
        return None
    rounding = ROUNDING * float(max(np.abs(low).max(), np.abs(high).max()))
    t0, t1 = _span(rays, low - rounding, high + rounding)
    hit = t0 <= t1
    count: Any = dr.count(hit)
    met = int(count[0])
    if met == 0:
        return None
    a, b = rays.point(t0), rays.point(t1)
    far = Array3f(_FAR)
    seen_low = _least(dr.select(hit, dr.minimum(a, b), far))
    seen_high = -_least(dr.select(hit, -dr.maximum(a, b), far))
    origin = np.abs(_least(dr.select(hit, -dr.abs(rays.origin), far))).max()
    rounding = ROUNDING * float(max(np.abs(low).max(), np.abs(high).max(), origin))
    low, high = np.maximum(low, seen_low) - rounding, np.minimum(high, seen_high) + rounding
    length = float(dr.sum(dr.select(hit, t1 - t0, 0))[0])
    size = _best(high - low, met, length, *marks.sizes(low, high))
    grid = CellGrid.of(low, high, max(size, 8 * rounding), rounding)
    marks.grid = grid
    return grid, marks, _span(rays, low, high)


def _span(rays: Rays, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> tuple[Any, Any]:
    """Return the part of rays that lies in a box; an empty one is returned reversed."""
    corners = opaque(low), opaque(high)
    t0, t1 = Float(rays.t_min), Float(rays.t_max)
    for axis in range(3):
        a, b = between(rays.direction[axis], *(corner[axis] - rays.origin[axis] for corner in corners))
        t0, t1 = dr.maximum(t0, a), dr.minimum(t1, b)
    dr.eval(t0, t1)
    return t0, t1


def _least(points: Array3f) -> npt.NDArray[np.float64]:
    return np.array([float(dr.min(axis)[0]) for axis in points])


def _best(
    extent: npt.NDArray[np.float64], rays: int, path: float, volume: float, surface: float, length: float, count: int
) -> float:
    """Return the size of cells with the least cost.

    Convex bodies of random orientation touch about V/h³ + ¾ S/h² + 3/2 (L + π R)/h + 1 cells of size h (Steiner's
    formula: the volume of the body's sum with a cube); their total is E. A segment of length l passes 3/2 l/h + 1 of N
    cells, each with E/N beams. Small cells cost steps and entries, large ones tests of beams that are not near. E
    includes the cost of wide beams, which are tested again in each of a ray's cells inside them.
    """
    best, least = float(extent.max()), np.inf
    for size in float(extent.max()) * 2.0 ** (-np.arange(41) / 4):
        h, counts = fitting(extent, float(size))
        cells = float(counts.prod())
        entries = min(volume / h**3 + 0.75 * surface / h**2 + 1.5 * length / h + count, count * cells)
        steps = rays + 1.5 * path / h
        cost = steps * (_STEP + entries / cells) + _ENTRY * entries + cells
        if cost < least:
            best, least = h, cost
    return best


# -- Rays through it ---------------------------------------------------------------------------------------------------


@syntax
def _added(
    packed: Packed, look: BoundLook, estimator: str, points: Points, radiance: Array3f, ray: Rays, number: UInt32,
    span: tuple[Float, Float],
) -> Array3f:  # fmt: skip
    """Return `radiance` plus a beam's, if closest approach or the chord's middle lies in a span of the ray."""
    beam = load(packed, number, ray.time)
    if dr.hint(estimator == "frustum", mode="scalar"):
        radiance = frustum(radiance, beam, ray, look, points, False, span)
    else:
        radiance, marked = billboard(radiance, beam, ray, look, points, estimator == "auto", span)
        if dr.hint(estimator == "auto", mode="scalar"):  # noqa: SIM102 - one is Python, the other is traced
            if marked:
                radiance = frustum(radiance, beam, ray, look, points, True, span)
    return radiance


class _GridWalk:
    """The walk of a ray from cell to cell."""

    def __init__(self, ray: Rays, span: tuple[Float, Float], grid: CellGrid) -> None:
        self._ray, self._grid, self._end = ray, grid, span[1]
        self._flat = [dr.abs(each) < 1e-9 for each in ray.direction]  # as `between` has it
        self._inv = [dr.rcp(dr.select(flat, 1, each)) for flat, each in zip(self._flat, ray.direction, strict=True)]
        self._step = [dr.select(each < 0, Int32(-1), Int32(1)) for each in ray.direction]

    def begin(self, t: Float) -> tuple[Int32, Int32, Int32]:
        """Return the cell at t."""
        place = self._grid.local(self._ray.point(t))
        return tuple(self._grid.index(place[axis], axis) for axis in range(3))  # type: ignore[return-value]

    def beyond(self, cell: tuple[Int32, Int32, Int32]) -> tuple[Float, tuple[Int32, Int32, Int32], Bool]:
        """Return the t at which the ray leaves a cell, the cell beyond, and whether there is none.

        Boundaries are computed from the grid's corner, not from cell to cell, so that t never decreases.
        """
        grid, ray = self._grid, self._ray
        leaves = []
        for axis in range(3):
            edge = Float(cell[axis] + dr.select(self._step[axis] > 0, Int32(1), Int32(0)))
            place = dr.fma(edge, grid.size, grid.low[axis]) - ray.origin[axis]
            leaves.append(dr.select(self._flat[axis], _FAR, place * self._inv[axis]))
        by_x = (leaves[0] <= leaves[1]) & (leaves[0] <= leaves[2])
        by_y = ~by_x & (leaves[1] <= leaves[2])
        chosen = by_x, by_y, ~by_x & ~by_y
        t = dr.minimum(leaves[0], dr.minimum(leaves[1], leaves[2]))
        following = tuple(at + dr.select(by, step, 0) for at, by, step in zip(cell, chosen, self._step, strict=True))
        outside = Bool(False)
        for at, count in zip(following, grid.counts, strict=True):
            outside |= (at < 0) | (at >= count)
        return t, following, outside | (t >= self._end)  # type: ignore[return-value]


@syntax
def traverse_grid(
    ray: Rays, span: tuple[Float, Float], grid: CellGrid, lists: CellLists, visit: Callable[..., Array3f],
    total: Array3f | None = None,
) -> Any:  # fmt: skip
    """Return what `visit(total, ray, beam, (t_enter, t_exit))` makes of `total`, cell by cell, beam by beam.

    There is one loop. Each turn takes a ray to the next beam, and to the next cell when its list is done, so that rays
    of a vector do not wait for each other's lists.
    """
    if dr.hint(total is None, mode="scalar"):
        total = Array3f(0)
    cells = _GridWalk(ray, span, grid)
    inside = span[0] <= span[1]
    x, y, z = cells.begin(span[0])
    i, stop = lists.of(grid.number(x, y, z), inside)
    enter = dr.full(Float, -_FAR, dr.width(ray.direction))
    leave, (next_x, next_y, next_z), last = cells.beyond((x, y, z))
    active = inside & ((i < stop) | ~last)
    while active:
        if i >= stop:
            x, y, z = next_x, next_y, next_z
            enter = leave
            leave, (next_x, next_y, next_z), last = cells.beyond((x, y, z))
            i, stop = lists.of(grid.number(x, y, z))
        if i < stop:
            beam = dr.gather(UInt32, lists.items, i)
            total = visit(total, ray, beam, (enter, dr.select(last, _FAR, leave)))
            i += 1
        active = (i < stop) | ~last
    return total
