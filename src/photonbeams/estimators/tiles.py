"""Which beams can touch which screen tile: projected footprints, walked row by row, into a list of beams per tile.

The projection of a cone is the hull of two discs, its half extent R/z linear along the projected axis (both R and 1
are, over z). So the columns that a row of tiles has to visit follow from linear inequalities. A beam that contains
the camera or nearly does has no such footprint: every tile lists it, as the Talk puts a quad over the whole screen.

The lists are in an order that depends on nothing but the beams: each lane walks its own share of them in turn and
counts in its own cells, so that no two threads race for a slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..device import Array3f, Array4f, Bool, Float, Int32, UInt32

#: Width and height of a tile in pixels.
TILE = 16

# Lanes that bin; the cells they count in take 4 · LANES bytes a tile.
_LANES = 1024

# Beams are clipped this many radii before the camera plane, where a disc's picture is still an ellipse.
_CLIP = 1.25


@dataclass
class Projection:
    """Camera space and screen of one view.

    Attributes
    ----------
    origin, right, up, forward
        Camera position and unit vectors, world space (Dr.Jit, opaque).
    scale
        Pixels per unit of slope (perspective), or per scene unit (orthographic), along x and along y.
    center
        Pixel position of the optical axis.
    width, height
        Image size in pixels.
    edge_x, edge_y
        Greatest |x/z| and |y/z| in the picture (perspective).
    """

    origin: Any
    right: Any
    up: Any
    forward: Any
    scale: tuple[Any, Any]
    center: tuple[Any, Any]
    width: int
    height: int
    orthographic: bool
    edge_x: float = 0.0
    edge_y: float = 0.0

    @property
    def columns(self) -> int:
        """Number of tiles in a row."""
        return -(-self.width // TILE)

    @property
    def rows(self) -> int:
        """Number of rows of tiles."""
        return -(-self.height // TILE)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    def to_camera(self, point: Any) -> Any:
        """Return x right, y up, z forward of a world point."""
        q = point - self.origin
        return Array3f(dr.dot(q, self.right), dr.dot(q, self.up), dr.dot(q, self.forward))


@dataclass
class Footprints:
    """Screen footprints of N beams: two discs, x, y and half extents in pixels, and 1/z, packed for gathering."""

    data: Any  # three packets of four a beam
    count: int


def footprints(beams: Beams, view: Projection) -> Footprints:
    """Project beams to the screen."""
    start, end = view.to_camera(beams.start), view.to_camera(beams.end)
    r0, r1 = beams.radius_start, beams.radius_end
    if beams.end_normal is not None:  # the rim may reach past the end by a radius
        axis = dr.normalize(end - start)
        slope = (r1 - r0) / dr.norm(end - start)
        end, r1 = end + axis * r1, r1 + dr.maximum(slope, 0) * r1
    if view.orthographic:
        near, visible = dr.full(Bool, False, len(beams)), dr.full(Bool, True, len(beams))
    else:
        near, visible, start, end, r0, r1 = _clip(start, end, r0, r1, view)
    z0, z1 = (Float(1), Float(1)) if view.orthographic else (dr.rcp(start.z), dr.rcp(end.z))
    stretch_x, stretch_y = (1.0, 1.0) if view.orthographic else (_stretch(view.edge_x), _stretch(view.edge_y))
    (sx, sy), (cx, cy) = view.scale, view.center
    packets = (
        Array4f(cx + sx * start.x * z0, cy - sy * start.y * z0, cx + sx * end.x * z1, cy - sy * end.y * z1),
        Array4f(
            *(dr.abs(s) * r * z * k for r, z in ((r0, z0), (r1, z1)) for s, k in ((sx, stretch_x), (sy, stretch_y)))
        ),
        # Depth is compared by a number that is linear on the screen: 1/z in perspective, −z in parallel projection.
        Array4f(
            _key(start.z, view), _key(end.z, view), dr.maximum(r0, r1), dr.select(near, 1, dr.select(visible, 0, -1))
        ),
    )
    data = dr.zeros(Float, len(beams) * 12)
    for number, packet in enumerate(packets):
        dr.scatter(data, packet, dr.arange(UInt32, len(beams)) * 3 + number)
    dr.eval(data)
    return Footprints(data, len(beams))


def _stretch(edge: float) -> float:
    """Return how much wider than R/z a sphere's picture is at most, inside a picture with this greatest slope."""
    return float(np.hypot(1.0, edge))


def _key(z: Any, view: Projection) -> Any:
    return -z if view.orthographic else dr.rcp(z)


def _clip(start: Any, end: Any, r0: Any, r1: Any, view: Projection) -> tuple[Any, ...]:
    """Clip beams to the half space before the camera; tell which are near, and which can be seen at all.

    A disc of radius R about a point c behind the clip plane z = ε is seen, in a picture whose corner lies at the angle
    e, only if √(|c|² − ε²) cos e − ε sin e < R. Beams that come so near are seen everywhere.
    """
    largest = dr.maximum(r0, r1)
    limit = dr.maximum(_CLIP * largest, 1e-6)
    axis = end - start
    where = dr.clip(-dr.dot(start, axis) / dr.maximum(dr.squared_norm(axis), 1e-20), 0, 1)
    distance = dr.norm(start + axis * where)
    corner = float(np.sqrt(1 + view.edge_x**2 + view.edge_y**2))
    behind = dr.minimum(start.z, end.z) < limit
    near = behind & (distance < (_CLIP + (1 + _CLIP) * corner) * largest)
    visible = near | (dr.maximum(start.z, end.z) > limit)
    dz = dr.select(axis.z == 0, 1, axis.z)
    cut = dr.clip((limit - start.z) / dz, 0, 1)
    radius, middle = dr.lerp(r0, r1, cut), start + axis * cut
    cut_start, cut_end = start.z < limit, end.z < limit
    start, r0 = dr.select(cut_start, middle, start), dr.select(cut_start, radius, r0)
    end, r1 = dr.select(cut_end, middle, end), dr.select(cut_end, radius, r1)
    start.z, end.z = dr.maximum(start.z, limit), dr.maximum(end.z, limit)
    return near, visible, start, end, r0, r1


@dr.syntax
def _walk(
    marks: Footprints, view: Projection, begin: Any, stop: Any, depth: Any, counter: Any, base: Any, out: Any
) -> Any:
    """Visit the tiles under each lane's beams, begin + lane, begin + lane + LANES, …; count them or list the beams.

    counter
        Cell (tile, lane) counts what the lane has put into the tile.
    base, out
        Where each cell begins in the list, and the list; None only counts.
    """
    columns, rows = dr.opaque(Int32, view.columns), dr.opaque(Int32, view.rows)
    lane = dr.arange(UInt32, _LANES)
    beam = begin + lane
    while beam < stop:
        ends = dr.gather(Array4f, marks.data, beam * 3)
        reach = dr.gather(Array4f, marks.data, beam * 3 + 1)
        rest = dr.gather(Array4f, marks.data, beam * 3 + 2)
        everywhere = rest.w > 0
        dx, dy = ends.z - ends.x, ends.w - ends.y
        drx, dry = reach.z - reach.x, reach.w - reach.y
        row = dr.select(everywhere, 0, _from_zero(_tile(dr.minimum(ends.y - reach.y, ends.w - reach.w), rows)))
        last = dr.select(everywhere, rows, _tile(dr.maximum(ends.y + reach.y, ends.w + reach.w), rows) + 1)
        last = dr.minimum(dr.select(rest.w < 0, 0, last), rows)
        while row < last:
            top = Float(row * TILE)
            # y − r ≤ bottom and y + r ≥ top, linear in λ: the part of the axis whose discs touch the row
            low0, high0 = _half_line(dy - dry, ends.y - reach.y - (top + TILE))
            low1, high1 = _half_line(-(dy + dry), top - (ends.y + reach.y))
            low, high = dr.maximum(low0, low1), dr.minimum(high0, high1)
            xa, ra = dr.fma(dx, low, ends.x), dr.fma(drx, low, reach.x)
            xb, rb = dr.fma(dx, high, ends.x), dr.fma(drx, high, reach.x)
            column = dr.select(everywhere, 0, _from_zero(_tile(dr.minimum(xa - ra, xb - rb), columns)))
            edge = dr.select(everywhere, columns, _tile(dr.maximum(xa + ra, xb + rb), columns) + 1)
            edge = dr.minimum(dr.select((low > high) & ~everywhere, 0, edge), columns)
            front = dr.maximum(dr.lerp(rest.x, rest.y, low), dr.lerp(rest.x, rest.y, high))
            while column < edge:
                tile = UInt32(row * columns + column)
                seen = everywhere | (front > _hidden(dr.gather(Float, depth, tile), rest.z, view))
                cell = tile * _LANES + lane
                slot: Any = dr.scatter_inc(counter, cell, seen)
                if dr.hint(out is not None, mode="scalar"):
                    dr.scatter(out, beam, dr.gather(UInt32, base, cell) + slot, seen)
                column += 1
            row += 1
        beam += _LANES


def _hidden(depth: Any, radius: Any, view: Projection) -> Any:
    """Return the depth key below which a beam of this radius lies entirely behind the tile's farthest surface."""
    return -(depth + radius) if view.orthographic else dr.rcp(depth + radius)


def _tile(pixel: Any, count: Any) -> Any:
    # Clipped as a float first: a far pixel position does not fit an integer.
    return Int32(dr.floor(dr.clip(pixel * (1 / TILE), -1, Float(count))))


def _from_zero(tile: Any) -> Any:
    return dr.maximum(tile, 0)


def _half_line(rate: Any, value: Any) -> tuple[Any, Any]:
    """Return the part of [0, 1] where value + rate · λ ≤ 0; an empty one is returned reversed."""
    flat = dr.abs(rate) < 1e-12
    root = -value / dr.select(flat, 1, rate)
    low = dr.select(flat, dr.select(value <= 0, 0, 2), dr.select(rate < 0, dr.maximum(root, 0), 0))
    high = dr.select(flat, dr.select(value <= 0, 1, -1), dr.select(rate > 0, dr.minimum(root, 1), 1))
    return low, high


@dataclass
class Lists:
    """The beams of each tile: `beams[first[tile] : stop[tile]]`."""

    beams: Any
    first: Any
    stop: Any
    entries: int

    def keep(self, flags: Any) -> Lists:
        """Return the lists with the flagged entries alone, in their order."""
        index: Any = dr.compress(flags > 0)
        before = dr.prefix_sum(flags)
        total, entries = dr.opaque(UInt32, dr.width(index)), dr.opaque(UInt32, self.entries)

        def place(i: Any) -> Any:
            return dr.select(i < entries, dr.gather(UInt32, before, dr.minimum(i, entries - 1)), total)

        kept = Lists(dr.gather(UInt32, self.beams, index), place(self.first), place(self.stop), dr.width(index))
        dr.eval(kept.beams, kept.first, kept.stop)
        return kept


class Bins:
    """The cells that one view's beams are counted in, for the beams `begin` … `stop` − 1.

    Parameters
    ----------
    depth
        (tiles,) planar depth of each tile's farthest surface; beams wholly behind it are not listed.
    """

    def __init__(self, marks: Footprints, view: Projection, depth: Any, begin: int, stop: int) -> None:
        self._marks, self._view, self._depth = marks, view, depth
        self._range = dr.opaque(UInt32, begin), dr.opaque(UInt32, stop)
        self._cells = view.tiles * _LANES
        counter = dr.zeros(UInt32, self._cells)
        _walk(marks, view, *self._range, depth, counter, None, None)
        self._base = dr.prefix_sum(counter)
        self._counter = counter
        last = dr.opaque(UInt32, self._cells - 1)
        self.entries = int((dr.gather(UInt32, self._base, last) + dr.gather(UInt32, counter, last))[0])

    def lists(self) -> Lists:
        """Return the beams of each tile."""
        out, cursor = dr.zeros(UInt32, max(self.entries, 1)), dr.zeros(UInt32, self._cells)
        if self.entries:
            _walk(self._marks, self._view, *self._range, self._depth, cursor, self._base, out)
        tile = dr.arange(UInt32, self._view.tiles)
        first = dr.gather(UInt32, self._base, tile * _LANES)
        last, total = dr.opaque(UInt32, self._view.tiles - 1), dr.opaque(UInt32, self.entries)
        stop = dr.select(tile < last, dr.gather(UInt32, self._base, dr.minimum(tile + 1, last) * _LANES), total)
        dr.eval(out, first, stop)
        return Lists(out, first, stop, self.entries)
