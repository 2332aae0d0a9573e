"""Which beams can touch which screen tile: footprints, walked row by row, into a list of beams per tile.

The edges of a footprint are linear along its axis, so the columns that a row of tiles has to visit follow from linear
inequalities.

The order of a list depends on nothing but the beams: each lane walks its own part of the beams in turn and counts in
its own cells, so that no two threads race for a slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ..numerics.arrays import indices
from ..numerics.syntax import syntax
from ..runtime.device import Array4f, Bool, Float, Int32, UInt32
from .cones import half_line
from .footprints import FAR, Footprints
from .projection import TILE, Projection

_LANES = 1024  # lanes that count
_MOST_CELLS = 1 << 25  # in which they count, of four bytes: a cell for each lane and tile


class Widths(NamedTuple):
    """Which beams a tile lists, by their least half width there on the screen, in pixels.

    A tile lists beams of at least `own` that are narrower than `coarser` in the square of four tiles around it. If
    `own` is None, it lists beams that are at least as wide as `coarser` there. Both numbers are opaque.
    """

    own: Any
    coarser: Any


@syntax
def _walk(
    marks: Footprints, view: Projection, begin: UInt32, stop: UInt32, depth: Float, widths: Widths | None, lanes: int,
    counter: UInt32, base: UInt32 | None, out: UInt32 | None,
) -> None:  # fmt: skip
    """Visit the tiles under each lane's beams, begin + lane, begin + lane + lanes, …; count them or list the beams.

    counter
        Cell (tile, lane) counts the beams that the lane has put into the tile.
    widths
        `Widths`, or None.
    base, out
        Where each cell begins in the list, and the list; None only counts.
    """
    columns, rows = dr.opaque(Int32, view.columns), dr.opaque(Int32, view.rows)
    all_lanes = dr.opaque(UInt32, lanes)
    lane = dr.arange(UInt32, lanes)
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
        last = dr.select(everywhere | _may_be(reach, widths), last, 0)
        while row < last:
            top = Float(row * TILE)
            # y − r ≤ bottom and y + r ≥ top, linear in λ: the part of the axis whose discs touch the row
            low0, high0 = half_line(dy - dry, ends.y - reach.y - (top + TILE))
            low1, high1 = half_line(-(dy + dry), top - (ends.y + reach.y))
            low, high = dr.maximum(low0, low1), dr.minimum(high0, high1)
            xa, ra = dr.fma(dx, low, ends.x), dr.fma(drx, low, reach.x)
            xb, rb = dr.fma(dx, high, ends.x), dr.fma(drx, high, reach.x)
            column = dr.select(everywhere, 0, _from_zero(_tile(dr.minimum(xa - ra, xb - rb), columns)))
            edge = dr.select(everywhere, columns, _tile(dr.maximum(xa + ra, xb + rb), columns) + 1)
            edge = dr.minimum(dr.select((low > high) & ~everywhere, 0, edge), columns)
            front = dr.maximum(dr.lerp(rest.x, rest.y, low), dr.lerp(rest.x, rest.y, high))
            while column < edge:
                tile = UInt32(row * columns + column)
                farthest = dr.gather(Float, depth, tile)
                seen = (farthest >= 0) & (everywhere | (front > _hidden(farthest, rest.z, view)))
                cell = tile * all_lanes + lane
                seen &= _is_of(ends, reach, column, row, widths)
                slot: Any = dr.scatter_inc(counter, cell, seen)
                if dr.hint(out is not None, mode="scalar"):
                    dr.scatter(out, beam, dr.gather(UInt32, base, cell) + slot, seen)
                column += 1
            row += 1
        beam += all_lanes


def _may_be(reach: Array4f, widths: Widths | None) -> Bool:
    """Return whether any tile can list a beam, given the half extents of its ends."""
    if widths is None:
        return Bool(True)
    most = -_least(-reach)
    return most >= widths.coarser if widths.own is None else (_least(reach) < widths.coarser) & (most >= widths.own)


def _is_of(ends: Array4f, reach: Array4f, column: Int32, row: Int32, widths: Widths | None) -> Bool:
    """Return whether a beam has the width of the beams that a tile lists."""
    if widths is None:
        return Bool(True)
    around = Float((column >> 1) * (2 * TILE)), Float((row >> 1) * (2 * TILE))
    wide = _half_width(ends, reach, *around, 2 * TILE) >= widths.coarser
    if widths.own is None:
        return wide
    return ~wide & (_half_width(ends, reach, Float(column * TILE), Float(row * TILE), TILE) >= widths.own)


def _least(packet: Any) -> Any:
    """Return the least of four numbers."""
    return dr.minimum(dr.minimum(packet.x, packet.y), dr.minimum(packet.z, packet.w))


def _half_width(ends: Array4f, reach: Array4f, left: Float, top: Float, side: int) -> Any:
    """Return the least half width, in pixels, of a beam in a square; infinite if the axis does not cross the square."""
    dx, dy, drx, dry = ends.z - ends.x, ends.w - ends.y, reach.z - reach.x, reach.w - reach.y
    bounds = (
        half_line(dx - drx, ends.x - reach.x - (left + side)), half_line(-(dx + drx), left - (ends.x + reach.x)),
        half_line(dy - dry, ends.y - reach.y - (top + side)), half_line(-(dy + dry), top - (ends.y + reach.y)),
    )  # fmt: skip
    low, high = bounds[0]
    for first, last in bounds[1:]:
        low, high = dr.maximum(low, first), dr.minimum(high, last)
    a, b = (dr.minimum(dr.fma(drx, each, reach.x), dr.fma(dry, each, reach.y)) for each in (low, high))
    return dr.select(low <= high, dr.minimum(a, b), FAR)


def _hidden(depth: Float, radius: Float, view: Projection) -> Float:
    """Return the depth key below which a beam of this radius lies entirely behind the tile's farthest surface."""
    return -(depth + radius) if view.orthographic else dr.rcp(depth + radius)


def _tile(pixel: Float, count: Int32) -> Int32:
    # Clip as a float first: a far pixel position does not fit into an integer.
    return Int32(dr.floor(dr.clip(pixel * (1 / TILE), -1, Float(count))))


def _from_zero(tile: Int32) -> Int32:
    return dr.maximum(tile, 0)


@dataclass
class TileLists:
    """The beams of each tile: `beams[first[tile] : stop[tile]]`.

    `marks` are the blocks of the tile that entries are for, as bits; None: they are for all.
    """

    beams: Any
    first: Any
    stop: Any
    entries: int
    marks: Any = None

    @property
    def busy(self) -> Bool:
        """Which tiles have entries."""
        return self.stop > self.first

    def keep(self, marks: UInt32) -> TileLists:
        """Return the lists with only the entries that have marks, in their order."""
        index = indices(marks > 0)
        before = dr.prefix_sum(dr.select(marks > 0, UInt32(1), 0))
        total, entries = dr.opaque(UInt32, dr.width(index)), dr.opaque(UInt32, self.entries)

        def place(i: UInt32) -> UInt32:
            return dr.select(i < entries, dr.gather(UInt32, before, dr.minimum(i, entries - 1)), total)

        first, stop = place(self.first), place(self.stop)
        beams, kept = (dr.gather(UInt32, each, index) for each in (self.beams, marks))
        dr.eval(beams, kept, first, stop)
        return TileLists(beams, first, stop, len(index), kept)


class Bins:
    """The cells in which one view's beams are counted, for the beams `begin` … `stop` − 1.

    Parameters
    ----------
    depth
        (tiles,) planar depth of each tile's farthest surface; beams wholly behind it are not listed. A tile with a
        depth below 0 lists no beams.
    widths
        Widths of the beams that are listed; None: all beams.
    """

    def __init__(
        self, marks: Footprints, view: Projection, depth: Float, begin: int, stop: int, widths: Widths | None = None
    ) -> None:
        self._tiles = view.tiles
        self._lanes = min(_LANES, 1 << ((_MOST_CELLS // self._tiles).bit_length() - 1))
        self._inputs = marks, view, dr.opaque(UInt32, begin), dr.opaque(UInt32, stop), depth, widths, self._lanes
        self._cells = self._tiles * self._lanes
        counter = dr.zeros(UInt32, self._cells)
        _walk(*self._inputs, counter, None, None)
        self._base = dr.prefix_sum(counter)
        last = dr.opaque(UInt32, self._cells - 1)
        self.entries = int((dr.gather(UInt32, self._base, last) + dr.gather(UInt32, counter, last))[0])

    def lists(self) -> TileLists:
        """Return the beams of each tile."""
        out, cursor = dr.zeros(UInt32, max(self.entries, 1)), dr.zeros(UInt32, self._cells)
        if self.entries:
            _walk(*self._inputs, cursor, self._base, out)
        tile, lanes = dr.arange(UInt32, self._tiles), dr.opaque(UInt32, self._lanes)
        first = dr.gather(UInt32, self._base, tile * lanes)
        last, total = dr.opaque(UInt32, self._tiles - 1), dr.opaque(UInt32, self.entries)
        stop = dr.select(tile < last, dr.gather(UInt32, self._base, dr.minimum(tile + 1, last) * lanes), total)
        dr.eval(out, first, stop)
        return TileLists(out, first, stop, self.entries)
