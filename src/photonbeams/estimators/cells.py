"""A uniform grid of cubes in the world, and lists of what lies in each of them.

The lists are sorted by cell with a radix sort of two digits: each of a fixed number of lanes walks its own share of
the items in turn and counts in counters of its own, of which there are lanes × 2048, however many cells there are. So
the order in a list depends on nothing but the items.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque
from ..runtime.device import Float, Int32, UInt32

#: Most cells of a grid, and most along an axis: float32 still holds a place within a cell to 1/8192 of it.
MOST_CELLS, MOST_ALONG = 1 << 21, 1 << 10

# Places round to 2⁻²⁴ of the largest number that went into them, some of them a few times, and the cells' own
# boundaries
#: to 2⁻¹⁴ of a cell: items are enlarged by this fraction of those numbers, and this much of a cell.
ROUNDING, BORDER = 2.0**-19, 1e-3

# Lanes that sort, and the bits of a cell's number that are sorted by at once: 2 × 11 hold all cells.
_LANES = 1024
_DIGIT = 11
_BUCKETS = 1 << _DIGIT

#: Entries of lists at a time: 64 MiB for each of the five arrays that sorting them takes.
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
    margin: Any  # by how much more than they are things are listed, in cells

    @classmethod
    def of(cls, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], size: float, rounding: float) -> CellGrid:
        """Return the grid of cells of this size, or somewhat larger, from one corner to the other at least.

        `rounding` is how far a place may be from where it is meant.
        """
        size, counts = fitting(high - low, size)
        return cls(
            opaque(low), dr.opaque(Float, size), dr.opaque(Float, 1 / size),
            tuple(dr.opaque(Int32, int(count)) for count in counts), int(np.prod(counts)),
            dr.opaque(Float, rounding / size + BORDER),
        )  # fmt: skip

    def local(self, point: Any) -> Any:
        """Return a place in units of cells."""
        return (point - self.low) * self.inv

    def index(self, place: Any, axis: int) -> Any:
        """Return the number along an axis of the cell at a place in units of cells, the nearest one of the grid."""
        # Clipped as a float first: what is far does not fit an integer.
        return Int32(dr.floor(dr.clip(place, 0, Float(self.counts[axis] - 1))))

    def span(self, low: Any, high: Any, axis: int) -> tuple[Any, Any]:
        """Return the first cell along an axis between two places in units of cells, and the last; reversed if none."""
        count = Float(self.counts[axis])
        return (
            dr.maximum(Int32(dr.floor(dr.clip(low, -1, count))), 0),
            dr.minimum(Int32(dr.floor(dr.clip(high, -1, count))), self.counts[axis] - 1),
        )

    def number(self, x: Any, y: Any, z: Any) -> Any:
        """Return a cell's number."""
        return UInt32(x + self.counts[0] * (y + self.counts[1] * z))


def fitting(extent: npt.NDArray[np.float64], size: float) -> tuple[float, npt.NDArray[np.int64]]:
    """Return the size of cells and their numbers along the axes of a box: no more than may be."""
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

    def of(self, cell: Any, active: Any = True) -> tuple[Any, Any]:
        """Return where a cell's list begins and where it stops."""
        return dr.gather(UInt32, self.first, cell, active), dr.gather(UInt32, self.first, cell + 1, active)


#: `entry(cell, item, lane, active)` counts or lists an item in a cell; `visit(item, lane, entry)`, in a kernel, calls
#: it for the cells that the item may lie in.
Entry = Callable[[Any, Any, Any, Any], None]
Visit = Callable[[Any, Any, Entry], None]


class Sorting:
    """The lists of one range of items: counted first (`entries`), made by `lists`.

    Parameters
    ----------
    visit
        What tells the cells of an item.
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

    def _count(self, cell: Any, item: Any, lane: Any, active: Any) -> None:
        dr.scatter_inc(self.counter, _bucket(cell, lane), active)
        # Where sums are few, Dr.Jit's choice is a copy for each thread, which makes their number a part of the kernel.
        dr.scatter_reduce(dr.ReduceOp.Add, self.sums, UInt32(1), cell, active, dr.ReduceMode.Local)

    def _put(self, cell: Any, item: Any, lane: Any, active: Any) -> None:
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


def _bucket(cell: Any, lane: Any) -> Any:
    """Return a lane's counter of a cell's first digit."""
    return (cell & (_BUCKETS - 1)) * _LANES + lane


@dr.syntax
def _walk(begin: Any, stop: Any, visit: Visit, entry: Entry) -> None:
    """Visit the cells of each lane's items, begin + lane, begin + lane + LANES and so on."""
    lane = dr.arange(UInt32, _LANES) + dr.opaque(UInt32, 0)
    item = begin + lane
    while item < stop:
        visit(item, lane, entry)
        item += _LANES


@dr.syntax
def _place(keys: Any, items: Any, portion: Any, entries: Any, counter: Any, base: Any, out: Any) -> None:
    """Count each lane's entries by their second digit, or put them where they belong: neighbours stay in order."""
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
    """Items of which it is known how long their lists are, and not yet what is in them."""

    entries: int

    def lists(self) -> L:
        """Return the lists."""


def batches(sort: Callable[[int, int], Counted[L]], count: int) -> Iterator[L]:
    """Yield the lists of all items, in as many parts as keep each part's lists within memory.

    `sort(begin, stop)` is told of a range of the items.
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
