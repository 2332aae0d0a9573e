"""A uniform grid of cubes in the world, and lists of the items in each cube.

The lists are sorted by cell with a radix sort of two digits. Each of a fixed number of lanes walks its own part of the
items in turn, and counts in counters of its own; there are lanes × 2048 counters, however many cells there are. So the
order in a list depends on nothing but the items.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Bool, Float, Int32, UInt32

#: Most cells of a grid.
MOST_CELLS = 1 << 21
#: Most cells along an axis: float32 still resolves 1/8192 of a cell.
MOST_ALONG = 1 << 10

#: Items are enlarged by this fraction of the largest number that their positions are computed from: positions are
#: rounded, a few times, to 2⁻²⁴ of it.
ROUNDING = 2.0**-19
#: Items are also enlarged by this fraction of a cell: the boundaries of cells are rounded to 2⁻¹⁴ of a cell.
BORDER = 1e-3

# Lanes that sort, and the bits of a cell's number that make a digit: two digits of 11 bits hold all cells.
_LANES = 1024
_DIGIT = 11
_BUCKETS = 1 << _DIGIT

#: Most entries of lists at a time: sorting takes five arrays, which are then of 64 MiB each.
ENTRIES = 1 << 24

L = TypeVar("L", covariant=True)


@dataclass
class CellGrid:
    """Cubes of one size: numbers in kernels are opaque."""

    low: Any  # corner, world space
    size: Any  # edge of a cell
    inv: Any
    counts: tuple[Any, ...]  # cells along each axis (Int32)
    cells: int
    margin: Any  # by how much items are enlarged for the lists, in cells

    @classmethod
    def of(cls, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], size: float, rounding: float) -> CellGrid:
        """Return a grid of cells of at least this size that reaches from one corner to the other or beyond.

        `rounding` is the largest error of a place.
        """
        size, counts = fitting(high - low, size)
        return cls(
            opaque(low), dr.opaque(Float, size), dr.opaque(Float, 1 / size),
            tuple(dr.opaque(Int32, int(count)) for count in counts), int(np.prod(counts)),
            dr.opaque(Float, rounding / size + BORDER),
        )  # fmt: skip

    def local(self, point: Array3f) -> Array3f:
        """Return a place in units of cells."""
        return (point - self.low) * self.inv

    def index(self, place: Float, axis: int) -> Int32:
        """Return the number along an axis of the cell at a place in units of cells, or of the nearest cell."""
        # Clip as a float first: a far place does not fit into an integer.
        return Int32(dr.floor(dr.clip(place, 0, Float(self.counts[axis] - 1))))

    def span(self, low: Float, high: Float, axis: int) -> tuple[Int32, Int32]:
        """Return the first and the last cell along an axis between two places in units of cells; reversed if none."""
        count = Float(self.counts[axis])
        return (
            dr.maximum(Int32(dr.floor(dr.clip(low, -1, count))), 0),
            dr.minimum(Int32(dr.floor(dr.clip(high, -1, count))), self.counts[axis] - 1),
        )

    def number(self, x: Int32, y: Int32, z: Int32) -> UInt32:
        """Return a cell's number."""
        return UInt32(x + self.counts[0] * (y + self.counts[1] * z))


def fitting(extent: npt.NDArray[np.float64], size: float) -> tuple[float, npt.NDArray[np.int64]]:
    """Return a size of cells, `size` or larger, and their numbers along the axes of a box, within the limits."""
    size = max(size, float(extent.max()) / (MOST_ALONG - 1), 1e-30)
    while True:
        counts = np.maximum(np.ceil(extent / size), 1)
        if counts.prod() <= MOST_CELLS and counts.max() <= MOST_ALONG:
            return size, counts.astype(np.int64)
        size *= 1.05


@dataclass
class CellLists:
    """The items of each cell: `items[first[cell] : first[cell + 1]]`."""

    items: Any
    first: Any  # (cells + 1,)
    entries: int

    def of(self, cell: UInt32, active: Bool | bool = True) -> tuple[UInt32, UInt32]:
        """Return where a cell's list begins and where it stops."""
        return dr.gather(UInt32, self.first, cell, active), dr.gather(UInt32, self.first, cell + 1, active)


#: `entry(cell, item, lane, active)` counts or lists an item in a cell. `visit(item, lane, entry)` calls it, in a
#: kernel, for the cells in which the item may lie.
Entry = Callable[[UInt32, UInt32, UInt32, "Bool | bool"], None]
Visit = Callable[[UInt32, UInt32, Entry], None]


class Sorting:
    """The lists of one range of items: they are counted first (`entries`), and made by `lists`.

    Parameters
    ----------
    visit
        Calls its third argument for each cell of an item.
    begin, stop
        The range of items.
    """

    def __init__(self, cells: int, visit: Visit, begin: int, stop: int) -> None:
        self._visit, self._cells = visit, cells
        self._range = dr.opaque(UInt32, begin), dr.opaque(UInt32, stop)
        self.base: Any = None
        self.keys: Any = None
        self.items: Any = None
        self.sums, self.counter = dr.zeros(UInt32, cells + 1), dr.zeros(UInt32, _BUCKETS * _LANES)
        _walk(*self._range, visit, self._count)
        dr.eval(self.sums, self.counter)
        self.first = dr.prefix_sum(self.sums)
        self.entries = int(dr.gather(UInt32, self.first, dr.opaque(UInt32, cells))[0])

    def lists(self) -> CellLists:
        """Return the lists."""
        self.base = dr.prefix_sum(self.counter)
        width = max(self.entries, 2)
        self.keys, self.items = dr.zeros(UInt32, width), dr.zeros(UInt32, width)
        self.counter = dr.zeros(UInt32, _BUCKETS * _LANES)
        _walk(*self._range, self._visit, self._put)
        dr.eval(self.keys, self.items, self.counter)
        if self._cells > _BUCKETS:
            self._by_second_digit()
        return CellLists(self.items, self.first, self.entries)

    def _count(self, cell: UInt32, item: UInt32, lane: UInt32, active: Bool | bool) -> None:
        dr.scatter_inc(self.counter, _bucket(cell, lane), active)
        # For few sums, Dr.Jit would choose a copy for each thread, which makes their number a part of the kernel.
        dr.scatter_reduce(dr.ReduceOp.Add, self.sums, UInt32(1), cell, active, dr.ReduceMode.Local)

    def _put(self, cell: UInt32, item: UInt32, lane: UInt32, active: Bool | bool) -> None:
        bucket = _bucket(cell, lane)
        slot: Any = dr.scatter_inc(self.counter, bucket, active)
        place = dr.gather(UInt32, self.base, bucket, active) + slot
        dr.scatter(self.keys, cell, place, active)
        dr.scatter(self.items, item, place, active)

    def _by_second_digit(self) -> None:
        entries = dr.opaque(UInt32, self.entries)
        portion = dr.opaque(UInt32, -(-self.entries // _LANES))
        counter = dr.zeros(UInt32, _BUCKETS * _LANES)
        _place(self.keys, self.items, portion, entries, counter, None, None)
        dr.eval(counter)
        base, cursor = dr.prefix_sum(counter), dr.zeros(UInt32, _BUCKETS * _LANES)
        out = dr.zeros(UInt32, dr.width(self.items))
        _place(self.keys, self.items, portion, entries, cursor, base, out)
        dr.eval(out)
        self.items = out


def _bucket(cell: UInt32, lane: UInt32) -> UInt32:
    """Return a lane's counter of a cell's first digit."""
    return (cell & (_BUCKETS - 1)) * _LANES + lane


@syntax
def _walk(begin: UInt32, stop: UInt32, visit: Visit, entry: Entry) -> None:
    """Visit the cells of each lane's items, begin + lane, begin + lane + LANES and so on."""
    lane = dr.arange(UInt32, _LANES) + dr.opaque(UInt32, 0)
    item = begin + lane
    while item < stop:
        visit(item, lane, entry)
        item += _LANES


@syntax
def _place(
    keys: UInt32, items: UInt32, portion: UInt32, entries: UInt32, counter: UInt32, base: UInt32 | None,
    out: UInt32 | None,
) -> None:  # fmt: skip
    """Count each lane's entries by their second digit, or write them to their places, in an order that is stable."""
    lane = dr.arange(UInt32, _LANES) + dr.opaque(UInt32, 0)
    i = lane * portion
    stop = dr.minimum(i + portion, entries)
    while i < stop:
        bucket = (dr.gather(UInt32, keys, i) >> _DIGIT) * _LANES + lane
        slot: Any = dr.scatter_inc(counter, bucket)
        if dr.hint(out is not None, mode="scalar"):
            dr.scatter(out, dr.gather(UInt32, items, i), dr.gather(UInt32, base, bucket) + slot)
        i += 1


class Counted(Protocol[L]):
    """Items whose lists have a known length, but no contents yet."""

    entries: int

    def lists(self) -> L:
        """Return the lists."""


def batches(sort: Callable[[int, int], Counted[L]], count: int) -> Iterator[L]:
    """Yield the lists of all `count` items, in as many parts as are needed to bound the memory of the lists.

    `sort(begin, stop)` returns a range of the items, counted.
    """
    whole = sort(0, count)
    parts = min(-(-whole.entries // ENTRIES), count)
    if parts <= 1:
        yield whole.lists()
        return
    del whole
    size = -(-count // parts)
    for at in range(0, count, size):
        yield sort(at, min(at + size, count)).lists()
