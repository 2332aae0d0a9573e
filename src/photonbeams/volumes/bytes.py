"""Bytes of volume files: reads that stay within bounds whatever a file claims, and decompression of its blocks."""

from __future__ import annotations

import struct
import zlib
from typing import Any, BinaryIO

from ..scene import SceneError
from ..scene.extras import needs

_LENGTH = struct.Struct("<I")
_SIZE = struct.Struct("<q")

# Compression flags of .vdb files.
ZIP, ACTIVE_MASK, BLOSC = 1, 2, 4

# A Blosc block begins with version, codec, flags, type size, and three counts of bytes: decompressed, per part, total.
_BLOSC_HEADER = struct.Struct("<4B3I")


class Cursor:
    """Reads bytes one after the other, and never beyond their end."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data, self.place = memoryview(data), 0

    @classmethod
    def of(cls, file: BinaryIO, first: int, most: int) -> Cursor:
        """Return a cursor over up to `most` bytes of a file, from the byte `first`."""
        if first < 0 or most < 0:
            raise SceneError("it refers to places outside of the file")
        file.seek(first)
        return cls(file.read(most))

    def take(self, count: int) -> memoryview:
        """Return the next bytes."""
        end = self.place + count
        if count < 0 or end > len(self._data):
            raise SceneError("it ends too early, or its sizes are wrong")
        result = self._data[self.place : end]
        self.place = end
        return result

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return the next numbers, in the given layout."""
        return layout.unpack(self.take(layout.size))

    def text(self) -> str:
        """Return the next string, which is preceded by its length."""
        return bytes(self.take(self.unpack(_LENGTH)[0])).decode("utf-8", "replace")

    def block(self, size: int, compression: int) -> bytes | memoryview:
        """Return the next `size` bytes, decompressed."""
        if not compression & (ZIP | BLOSC):
            return self.take(size)
        (stored,) = self.unpack(_SIZE)
        if stored <= 0:  # blocks that compression would not shrink are stored uncompressed
            result: bytes | memoryview = self.take(-stored)
        elif compression & BLOSC:
            result = _from_blosc(self.take(stored), size)
        else:
            result = _from_zip(self.take(stored), size)
        if len(result) != size:
            raise SceneError(f"a block has {len(result)} bytes, but {size} were expected")
        return result


def _from_zip(data: memoryview, size: int) -> bytes:
    try:
        return zlib.decompressobj().decompress(data, max(size, 1))
    except zlib.error:
        raise SceneError("a block cannot be decompressed") from None


def _from_blosc(data: memoryview, size: int) -> bytes:
    # Checked before memory is allocated, since the library trusts the sizes in the block.
    if len(data) < _BLOSC_HEADER.size or _BLOSC_HEADER.unpack_from(data)[4:7:2] != (size, len(data)):
        raise SceneError("a block is not as long as it says")
    with needs("vdb", "a compressed grid", "blosc"):
        import blosc  # optional, and only imported for files that need it

    try:
        return bytes(blosc.decompress(bytes(data)))
    except blosc.error:
        raise SceneError("a block cannot be decompressed") from None
