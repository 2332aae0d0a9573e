"""Trees of OpenVDB grids: where the voxels are, and their values.

A root has nodes of 4096³ voxels, these have nodes of 128³, and these have leaves of 8³. Where a node has no child, a
single value fills the child's place: a tile. Masks say which voxels and tiles are active.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..scene import Array, SceneError
from .bytes import ACTIVE_MASK, Cursor

_COUNT, _COUNTS, _ORIGIN = struct.Struct("<i"), struct.Struct("<2I"), struct.Struct("<3i")
_AT_ONCE = 4096  # leaves
_MOST_TILES = 1 << 22

# How a node stores its inactive values: all are the background; all are its negative; all are one value; a mask chooses
# between the background and its negative, between the background and one value, or between two values; or all values
# are stored.
_BACKGROUND, _NEGATIVE, _ONE, _MASK, _MASK_AND_ONE, _MASK_AND_TWO, _ALL = range(7)


class Tile(NamedTuple):
    """A cube of one value: its least index, its size in voxels, the value, and whether it is active."""

    origin: Array
    size: int
    value: Array
    active: bool


@dataclass(frozen=True)
class _Encoding:
    """How the values of nodes are stored."""

    type: np.dtype
    stored: np.dtype
    channels: int
    compression: int
    background: Array

    def values(self, cursor: Cursor, mask: Array) -> Array:
        """Return the next values of a node, (voxels, channels)."""
        (kind,) = cursor.take(1)
        if kind > _ALL:
            raise SceneError(f"a node has inactive values of the kind {kind}: expected 0 to {_ALL}")
        first = self.background if kind == _BACKGROUND else -self.background
        second = self.background
        if kind in (_ONE, _MASK_AND_ONE, _MASK_AND_TWO):
            first = self._single(cursor)
        if kind == _MASK_AND_TWO:
            second = self._single(cursor)
        chosen = bits(cursor.take(len(mask) // 8)) if kind in (_MASK, _MASK_AND_ONE, _MASK_AND_TWO) else None
        sparse = bool(self.compression & ACTIVE_MASK) and kind != _ALL
        count = int(np.count_nonzero(mask)) if sparse else len(mask)
        found = self._stored(cursor, count)
        if count == len(mask):
            return found
        result = np.empty((len(mask), self.channels), self.type)
        result[:] = first if chosen is None else np.where(chosen[:, None], second, first)
        result[mask] = found
        return result

    def _single(self, cursor: Cursor) -> Array:
        return np.frombuffer(cursor.take(self.type.itemsize * self.channels), self.type)

    def _stored(self, cursor: Cursor, count: int) -> Array:
        if not count and self.stored != self.type:
            return np.empty((0, self.channels), self.type)  # for half floats even the size is omitted
        block = cursor.block(count * self.channels * self.stored.itemsize, self.compression)
        return np.frombuffer(block, self.stored).reshape(count, self.channels).astype(self.type)


class Tree:
    """The voxels of a grid.

    It is read by cursors at the file's topology and values. `kind` is the NumPy type of values, and `name` OpenVDB's:
    leaves of "bool" and "mask" are stored differently. The rest is as in `VDBGrid`.

    Attributes
    ----------
    background
        (channels,) the value of all voxels that are not in the tree.
    tiles
        Tiles that are active, or whose value is not the background.
    origins, masks
        (leaves, 3) the least index of each leaf, and (leaves, bytes) which of its voxels are active, as bits.
    size
        Voxels along the edge of a leaf.
    """

    def __init__(
        self, topology: Cursor, values: Cursor, levels: tuple[int, ...], kind: str, channels: int, half: bool,
        compression: int, name: str,
    ) -> None:  # fmt: skip
        if not levels or not 1 <= sum(levels) <= 20 or max(levels) > 6:
            raise SceneError(f"a grid has nodes of the sizes {levels}: expected 5, 4 and 3")
        (buffers,) = topology.unpack(_COUNT)
        if buffers != 1:
            raise SceneError(f"a grid has {buffers} buffers: expected 1")
        type_ = np.dtype(kind)
        self.channels, self.size, self._levels, self._bits = channels, 1 << levels[-1], levels, name in ("bool", "mask")
        self._plain, self._cursor = name == "mask", values
        self.background = np.frombuffer(topology.take(type_.itemsize * channels), type_)
        shorter = np.dtype("<f2") if half and type_.kind == "f" else type_
        if type_.kind == "b":  # NumPy has no negative of a bool; in C++ it is the bool itself
            self._encoding = _Encoding(np.dtype("<i1"), np.dtype("<i1"), 1, compression, self.background.view("<i1"))
        else:
            self._encoding = _Encoding(type_, shorter, channels, compression, self.background)
        self.tiles: list[Tile] = []
        self._leaves = [(np.empty((0, 3), np.int64), np.empty((0, self.size**3 // 8), "u1"))]
        self._root(topology)
        self._start = values.place
        self.origins, self.masks = (np.concatenate(each) for each in zip(*self._leaves, strict=True))

    def _root(self, cursor: Cursor) -> None:
        tiles, children = cursor.unpack(_COUNTS)
        for _ in range(tiles):
            origin = _origin(cursor)
            value = np.frombuffer(cursor.take(self.background.nbytes), self.background.dtype)
            self._keep(Tile(origin, 1 << sum(self._levels), value, bool(cursor.take(1)[0])))
        for _ in range(children):
            self._node(cursor, _origin(cursor), 0)

    def _keep(self, tile: Tile) -> None:
        if tile.active or not np.array_equal(tile.value, self.background):
            self.tiles.append(tile)
        if len(self.tiles) > _MOST_TILES:
            raise SceneError(f"a grid has more than {_MOST_TILES} tiles")

    def _node(self, cursor: Cursor, origin: Array, level: int) -> None:
        """Read a node and its children."""
        log = self._levels[level]
        count, size = 1 << 3 * log, 1 << sum(self._levels[level + 1 :])
        children, active = (bits(cursor.take(count // 8)) for _ in range(2))
        values = self._encoding.values(cursor, active)
        differs = (values != self._encoding.background).any(axis=1)
        for index in np.flatnonzero(~children & (active | differs)):
            value = values[index].astype(self.background.dtype)
            self._keep(Tile(origin + size * _offset(index, log), size, value, bool(active[index])))
        inner = np.flatnonzero(children)
        places = origin + size * _offset(inner, log)
        if level + 2 == len(self._levels):
            masks = np.frombuffer(cursor.take(len(inner) * size**3 // 8), "u1").reshape(len(inner), -1)
            self._leaves.append((places, masks))
            return
        for place in places:
            self._node(cursor, place, level + 1)

    def leaves(self) -> Iterator[tuple[Array, Array, Array]]:
        """Yield origins (n, 3), active voxels (n, size³) and values (n, size³, channels) of some leaves at a time.

        The order of voxels in a leaf is that of the array [x, y, z].
        """
        self._cursor.place = self._start
        for origins, masks in self._active():
            yield origins, masks, np.stack([self._leaf(each) for each in masks])

    def _active(self) -> Iterator[tuple[Array, Array]]:
        """Yield origins (n, 3) and active voxels (n, size³) of some leaves at a time."""
        for first in range(0, len(self.origins), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            yield self.origins[some], bits(self.masks[some].reshape(-1)).reshape(-1, self.size**3)

    def _leaf(self, mask: Array) -> Array:
        """Return the next leaf's values."""
        bytes_, cursor = self.size**3 // 8, self._cursor
        stored = cursor.take(bytes_)  # the mask again
        if not self._bits:
            return self._encoding.values(cursor, mask)
        cursor.take(_ORIGIN.size)
        return bits(stored if self._plain else cursor.take(bytes_))[:, None]

    @cached_property
    def active_voxels(self) -> int:
        """The number of active voxels, including those of active tiles."""
        leaves = sum(int(np.count_nonzero(masks)) for _, masks in self._active())
        return leaves + sum(tile.size**3 for tile in self.tiles if tile.active)

    @cached_property
    def box(self) -> tuple[Array, Array] | None:
        """The least and the greatest index of active voxels; None if there are none."""
        lows = [tile.origin for tile in self.tiles if tile.active]
        highs = [tile.origin + tile.size - 1 for tile in self.tiles if tile.active]
        for origins, masks in self._active():
            some = masks.any(axis=1)
            if some.any():
                active = masks[some].reshape(-1, self.size, self.size, self.size)
                lines = np.stack([active.any(axis=axes) for axes in ((2, 3), (1, 3), (1, 2))], axis=1)  # (n, 3, size)
                lows.append((origins[some] + lines.argmax(axis=2)).min(axis=0))
                highs.append((origins[some] + self.size - 1 - lines[..., ::-1].argmax(axis=2)).max(axis=0))
        return (np.min(lows, axis=0), np.max(highs, axis=0)) if lows else None


def bits(data: Array | memoryview) -> Any:
    """Return a mask's bits."""
    return np.unpackbits(np.frombuffer(data, "u1"), bitorder="little").view(bool)


def _origin(cursor: Cursor) -> Array:
    return np.array(cursor.unpack(_ORIGIN), dtype=np.int64)


def _offset(index: Any, log: int) -> Array:
    """Return the positions of entries in a node, (n, 3); z varies fastest."""
    side = (1 << log) - 1
    return np.stack([index >> 2 * log, (index >> log) & side, index & side], axis=-1).astype(np.int64)
