"""How much deep EXRs hold, from what their chunks say before anything is decoded ("OpenEXR File Layout").

A decoder allocates what a chunk claims, and keeps all of them, so a damaged or hostile file would fill the memory.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from typing import NamedTuple

from ..runtime.files import PathLike
from .files import unreadable

_MANY_PARTS = 0x1000  # a flag of the version
# How many times as large data may be as deep compressions make them: deflate reaches 1032.
_MOST_COMPRESSED = 1100
# What precedes a chunk: its line, or the place and the levels of a tile, and then bytes of its counts, its samples, and
# its samples when they are decoded.
_LEADERS = {b"deepscanline": struct.Struct("<4x3Q"), b"deeptile": struct.Struct("<16x3Q")}


class _Part(NamedTuple):
    """A part's type, and where its chunks are."""

    kind: bytes
    chunks: tuple[int, ...]


def deep_sizes(path: PathLike) -> list[int]:
    """Return how many bytes the samples of each part have when they are decoded; 0 for parts that are not deep.

    Raises
    ------
    SceneError
        A file that is damaged: chunks that reach beyond it, or that claim more than their bytes can hold.
    """
    try:
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            first = 4 * bool(struct.unpack_from("<I", data, 4)[0] & _MANY_PARTS)  # chunks begin with the part's number
            return [sum(_decoded(data, part.kind, each + first) for each in part.chunks) for part in _parts(data)]
    except (struct.error, ValueError, IndexError, KeyError, OverflowError):
        raise unreadable(path, "its header or its chunks are damaged, or the end is missing") from None


def _decoded(data: mmap.mmap, kind: bytes, place: int) -> int:
    """Return how many bytes the samples of a chunk have when they are decoded; ValueError for what cannot be."""
    leader = _LEADERS.get(kind)
    if leader is None:
        return 0
    counts, packed, whole = leader.unpack_from(data, place)
    if place + leader.size + counts + packed > len(data) or whole > _MOST_COMPRESSED * packed:
        raise ValueError
    return int(whole)


def _parts(data: mmap.mmap) -> Iterator[_Part]:
    """Yield the parts of a file."""
    headers, place, several = [], 8, struct.unpack_from("<I", data, 4)[0] & _MANY_PARTS
    while data[place]:
        attributes = {}
        while data[place]:
            (name, _), place = _words(data, place, 2)
            (size,) = struct.unpack_from("<i", data, place)
            attributes[name] = data[place + 4 : place + 4 + size]
            if size < 0 or len(attributes[name]) < size:
                raise ValueError
            place += 4 + size
        headers.append(attributes)
        place += 1
        if not several:
            break
    place += bool(several)
    for each in headers:
        count = struct.unpack("<i", each[b"chunkCount"])[0] if b"chunkCount" in each else 0
        yield _Part(each.get(b"type", b""), struct.unpack_from(f"<{count}Q", data, place))
        place += 8 * count


def _words(data: mmap.mmap, place: int, count: int) -> tuple[list[bytes], int]:
    """Return words that end with a zero, and the place behind them."""
    found = []
    for _ in range(count):
        end = data.find(b"\0", place)
        if end < 0:
            raise ValueError
        found.append(data[place:end])
        place = end + 1
    return found, place
