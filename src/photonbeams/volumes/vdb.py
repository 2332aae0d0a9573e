"""OpenVDB files: the grids that they hold, with metadata and transforms. `tree` reads the voxels.

A file has a header, metadata, and for each grid a descriptor with the offsets of its parts. A grid has its compression,
metadata, transform, the topology of its tree, and the values of the tree's leaves.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np

from ..scene import Array, SceneError
from .bytes import ACTIVE_MASK, BLOSC, ZIP, Cursor
from .tree import Tree

# Since version 222 each grid has its own compression; later versions of the library write nothing newer than 225.
VERSIONS = range(222, 226)

_MAGIC = b" BDV\0\0\0\0"
_START = struct.Struct("<8s3IB36s")  # magic, version of the format, of the library, offsets of grids, UUID
_COUNT = struct.Struct("<i")
_PLACES = struct.Struct("<3q")  # offsets of the grid, of its leaves' values, and of its end
_FLAGS = struct.Struct("<I")
_MOST_GRIDS = 4096
_HEADER = 1 << 24  # the most bytes of a header with its metadata
_DESCRIPTOR = 1 << 16

# The number of doubles in each kind of map. Scales are followed by vectors that can be derived from them.
_MATRIX, _VECTOR = 16, 3
_MAPS = {
    "AffineMap": _MATRIX, "UnitaryMap": _MATRIX, "TranslationMap": _VECTOR,
    "ScaleMap": 5 * _VECTOR, "UniformScaleMap": 5 * _VECTOR,
    "ScaleTranslateMap": 6 * _VECTOR, "UniformScaleTranslateMap": 6 * _VECTOR,
}  # fmt: skip

#: The values of each type of grid: their NumPy type, and how many a voxel has.
TYPES = {
    "float": ("<f4", 1), "double": ("<f8", 1), "half": ("<f2", 1), "int32": ("<i4", 1), "int64": ("<i8", 1),
    "uint8": ("<u1", 1), "uint32": ("<u4", 1), "bool": ("?", 1), "mask": ("?", 1),
    "vec3s": ("<f4", 3), "vec3d": ("<f8", 3), "vec3i": ("<i4", 3),
}  # fmt: skip


Places = tuple[int, int, int]  # offsets in the file of a grid, of the values of its leaves, and of its end


@dataclass(frozen=True)
class VDBGrid:
    """A grid of a file."""

    name: str  # several grids of a file may have the same
    type: str  # of its values, such as "float" or "vec3s"
    levels: tuple[int, ...]  # binary logarithms of its nodes' sizes, from the root's children to the leaves: 5, 4, 3
    half: bool  # whether floats are stored as half floats
    compression: int  # flags
    # (4, 4) from indices of voxels to the file's space, for column vectors; None if not linear, as for a frustum.
    to_file: Array | None
    metadata: dict[str, str | bool]  # its texts and truth values
    data: bytes  # of its tree
    _topology: int  # this and the next are places in the data
    _values: int

    @property
    def is_level_set(self) -> bool:
        """Whether its values are distances from a surface, not densities."""
        return bool(self.metadata.get("class") == "level set")

    @property
    def codec(self) -> str:
        """The compression in words."""
        words = {BLOSC: "Blosc", ZIP: "zip", ACTIVE_MASK: "active voxels"}
        return ", ".join(text for flag, text in words.items() if self.compression & flag) or "none"

    @cached_property
    def tree(self) -> Tree:
        """Its voxels; SceneError for a type of values that is not supported, or a broken tree."""
        if self.type not in TYPES:
            known = ", ".join(TYPES)
            raise SceneError(f"its grid {self.name} has voxels of the type {self.type}: expected one of {known}")
        topology, values = (Cursor(memoryview(self.data)[place:]) for place in (self._topology, self._values))
        return Tree(topology, values, self.levels, *TYPES[self.type], self.half, self.compression, self.type)


def read_grids(file: BinaryIO) -> list[VDBGrid]:
    """Return the grids of a file; raise SceneError, a clause about the file, for any other."""
    return list(_grids(file))


def _grids(file: BinaryIO) -> Iterator[VDBGrid]:
    size = file.seek(0, io.SEEK_END)
    cursor = Cursor.of(file, 0, min(size, _HEADER))
    if size < _START.size:
        raise SceneError(f"it has {size} bytes")
    magic, version, _, _, offsets, _ = cursor.unpack(_START)
    if magic != _MAGIC:
        raise SceneError("it is no OpenVDB file")
    if version not in VERSIONS:
        raise SceneError(f"its format has the version {version}: expected {VERSIONS[0]} to {VERSIONS[-1]}")
    if not offsets:
        raise SceneError("it is a stream, which lacks the offsets of its grids: expected a file")
    _metadata(cursor)
    (count,) = cursor.unpack(_COUNT)
    if not 0 <= count <= _MOST_GRIDS:
        raise SceneError(f"it has {count} grids: expected up to {_MOST_GRIDS}")
    place, found = cursor.place, dict[str, Places]()
    for _ in range(count):
        cursor = Cursor.of(file, place, _DESCRIPTOR)
        unique, kind, source = cursor.text(), cursor.text(), cursor.text()
        places: Any = cursor.unpack(_PLACES)
        yield _grid(file, size, (unique, kind), places, shared=found.get(source) if source else None)
        found[unique] = places
        if places[2] < place:
            raise SceneError("its grids are not one after the other")
        place = places[2]


def _grid(file: BinaryIO, size: int, names: tuple[str, str], places: Places, *, shared: Places | None) -> VDBGrid:
    """Return a grid; an instance has its own metadata and transform, and the tree of another grid, `shared`."""
    name, kind = names[0].split("\x1e")[0], names[1].removesuffix("_HalfFloat")
    first, _, end = places
    if not 0 <= first <= end <= size:
        raise SceneError(f"its grid {name} is not within it")
    cursor = Cursor.of(file, first, end - first)
    (compression,) = cursor.unpack(_FLAGS)
    metadata = _metadata(cursor)
    to_file = _transform(cursor)
    parts = re.fullmatch(r"Tree_(\w+?)((?:_\d)+)", kind)
    value, levels = (parts[1], tuple(int(each) for each in parts[2][1:].split("_"))) if parts else (kind, ())
    half = kind != names[1] or metadata.get("is_saved_as_half_float") is True
    if shared is not None:
        places = shared
        cursor = Cursor.of(file, places[0], places[2] - places[0])
        (compression,) = cursor.unpack(_FLAGS)
        _metadata(cursor)
        _transform(cursor)
    return VDBGrid(
        name=name,
        type=value,
        levels=levels,
        half=half,
        compression=compression,
        to_file=to_file,
        metadata=metadata,
        data=_body(file, places, size),
        _topology=cursor.place,
        _values=places[1] - places[0],
    )


def _body(file: BinaryIO, places: Places, size: int) -> bytes:
    first, values, end = places
    if not 0 <= first <= values <= end <= size:
        raise SceneError("the values of a grid are not within it")
    file.seek(first)
    return file.read(end - first)


def _metadata(cursor: Cursor) -> dict[str, str | bool]:
    """Return the next metadata that are texts or truth values; no others are needed here."""
    result: dict[str, str | bool] = {}
    (count,) = cursor.unpack(_COUNT)
    for _ in range(count):
        name, kind = cursor.text(), cursor.text()
        (size,) = cursor.unpack(_COUNT)
        value = bytes(cursor.take(size))
        if kind == "string":
            result[name] = value.decode("utf-8", "replace")
        elif kind == "bool":
            result[name] = any(value)
    return result


def _transform(cursor: Cursor) -> Array | None:
    """Return the next map from voxels to the file's space; None for a frustum, after which nothing can be read."""
    kind = cursor.text()
    if kind not in _MAPS:
        return None
    numbers = np.array(cursor.unpack(struct.Struct(f"<{_MAPS[kind]}d")))
    result = np.eye(4)
    if len(numbers) == _MATRIX:
        result = numbers.reshape(4, 4).T
    elif "Translat" in kind:
        result[:3, 3], numbers = numbers[:3], numbers[3:]
    if "Scale" in kind:
        result[:3, :3] = np.diag(numbers[:3])
    return result
