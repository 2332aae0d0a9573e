"""The door to OpenEXR: what a file says of its parts, and their pixels, which are held against that.

OpenEXR leaves out a part whose pixels it cannot decode, and allocates what a header or a chunk claims. So the headers
and the places of all chunks are read here first ("OpenEXR File Layout"), and what OpenEXR returns must have the parts,
the channels, the types and the rows that the headers name.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import NamedTuple

import numpy as np
import OpenEXR

from ..runtime.files import PathLike
from ..runtime.inputs import problem_of
from .files import MOST_PIXELS, UnreadableImageError, check_decoded

# Flags of the version: one part, which has tiles; and several parts.
_TILED, _MANY_PARTS = 0x200, 0x1000
# How many times as large data may be as deep compressions make them: deflate reaches 1032.
_MOST_COMPRESSED = 1100
# What begins a chunk, after its part and its line: bytes of its pixels; of a deep one, bytes of its counts, its
# samples, and its samples when they are decoded. A tile has its place and its levels before that.
_LEADERS = {
    b"scanlineimage": struct.Struct("<i"), b"tiledimage": struct.Struct("<16xi"),
    b"deepscanline": struct.Struct("<3Q"), b"deeptile": struct.Struct("<16x3Q"),
}  # fmt: skip
# Lines of a chunk by the number of the compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB, HTJ2K of
# 256 lines and of 32, LJ2K, ZSTD.
_LINES = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256, 256, 32, 256, 1)
_TYPES = ("uint32", "float16", "float32")  # of channels, by their numbers
_DAMAGED = "its header or its chunks are damaged, or the end is missing"


class _Stored(NamedTuple):
    """How a channel is stored: its type, and of how many pixels it has a value, across and down."""

    kind: str
    across: int
    down: int


@dataclass(frozen=True)
class _Header:
    """What a file says of a part: its type, rows and columns, channels by name, and bytes of its decoded samples."""

    kind: bytes
    shape: tuple[int, int]
    channels: Mapping[str, _Stored]
    samples: int  # 0 if it is not deep

    @property
    def deep(self) -> bool:
        return self.kind.startswith(b"deep")

    def fits(self, part: OpenEXR.Part) -> bool:
        """Return whether what OpenEXR has read of the part has all of its channels, with their types and rows."""
        found = {name: (str(each.pixels.dtype), each.pixels.shape) for name, each in part.channels.items()}
        rows, columns = self.shape
        return found == {
            name: ("object" if self.deep else each.kind, (-(-rows // each.down), -(-columns // each.across)))
            for name, each in self.channels.items()
        }


def exr_parts(path: PathLike, *, header_only: bool = False, deep: bool = False) -> list[OpenEXR.Part]:
    """Return the parts of an EXR, with an array for each channel. Parts may be `deep` only where that is asked for.

    Raises
    ------
    SceneError
        A file that is no EXR, is damaged, ends too early, does not fit into memory, or is deep unless it may be.
    OSError
        As `problem_of`.
    """
    headers, told = _headers(path), StringIO()
    if not header_only:
        if not deep and any(each.deep for each in headers):
            raise UnreadableImageError(path, "it is a deep one")
        check_decoded(path, sum(each.shape[0] * each.shape[1] * len(each.channels) for each in headers))
    try:
        with redirect_stdout(told):  # it prints why a part cannot be decoded
            parts = list(OpenEXR.File(str(path), separate_channels=True, header_only=header_only).parts)
        repr([part.header for part in parts])  # of text that is not UTF-8, this raises an error here
    except UnicodeDecodeError:
        raise UnreadableImageError(path, "its header has a name that is not in UTF-8") from None
    except ZeroDivisionError:
        raise UnreadableImageError(path, "its header has a fraction over 0") from None
    except (RuntimeError, ValueError, TypeError, IndexError, MemoryError) as error:
        raise UnreadableImageError(path, " ".join(str(error).split())[:120]) from None
    if not all(np.isfinite(part.header.get("chromaticities", 0)).all() for part in parts):
        raise UnreadableImageError(path, "its header has chromaticities that are not finite")
    if len(parts) != len(headers) or not (header_only or all(map(_Header.fits, headers, parts))):
        why = told.getvalue().strip().rpartition(" - ")[2][:80] or "its header is damaged"
        raise UnreadableImageError(path, f"it lacks pixels that its header names: {why}")
    return parts


def deep_sizes(path: PathLike) -> list[int]:
    """Return how many bytes the samples of each part have when they are decoded; 0 for parts that are not deep.

    SceneError for a file that is damaged: chunks that reach beyond it, or that claim more than their bytes can hold.
    """
    return [each.samples for each in _headers(path)]


def _headers(path: PathLike) -> list[_Header]:
    """Return what a file says of its parts; SceneError if a chunk is not where it says."""
    if problem := problem_of(path):
        raise UnreadableImageError(path, problem)
    try:
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if data[:4] != b"\x76\x2f\x31\x01":
                raise UnreadableImageError(path, "it is no EXR")
            return list(_parts(data))
    except (struct.error, ValueError, IndexError, KeyError, OverflowError, ZeroDivisionError):
        raise UnreadableImageError(path, _DAMAGED) from None


def _parts(data: mmap.mmap) -> Iterator[_Header]:
    """Yield what the headers say; ValueError and others for a file that is damaged."""
    found, place, flags = [], 8, struct.unpack_from("<I", data, 4)[0]
    several = bool(flags & _MANY_PARTS)
    while data[place]:
        attributes = {}
        while data[place]:
            name, place = _word(data, place)
            _, place = _word(data, place)
            (size,) = struct.unpack_from("<i", data, place)
            attributes[name] = data[place + 4 : place + 4 + size]
            if size < 0 or len(attributes[name]) < size:
                raise ValueError
            place += 4 + size
        found.append(attributes)
        place += 1
        if not several:
            found[0].setdefault(b"type", b"tiledimage" if flags & _TILED else b"scanlineimage")
            break
    place += several
    for number, each in enumerate(found):
        x0, y0, x1, y1 = struct.unpack("<4i", each[b"dataWindow"])
        rows, columns = y1 + 1 - y0, x1 + 1 - x0
        if not (rows > 0 and columns > 0 and rows * columns <= MOST_PIXELS):
            raise ValueError
        kind, count, lines = each[b"type"], *_chunks(each, rows, columns)
        places = struct.unpack_from(f"<{count}Q", data, place)
        place += 8 * count
        begin = struct.pack("<i", number) if several else b""
        begins = [begin + struct.pack("<i", y0 + k * lines) if lines else begin for k in range(count)]
        samples = sum(_decoded(data, kind, *chunk) for chunk in zip(places, begins, strict=True))
        yield _Header(kind, (rows, columns), dict(_channels(each[b"channels"])), samples)


def _chunks(attributes: Mapping[bytes, bytes], rows: int, columns: int) -> tuple[int, int]:
    """Return how many chunks a part has, and lines of each; no chunks of tiles of several levels if it does not say."""
    said = struct.unpack("<i", attributes[b"chunkCount"])[0] if b"chunkCount" in attributes else 0
    if attributes[b"type"] in (b"tiledimage", b"deeptile"):
        across, down, mode = struct.unpack("<2IB", attributes[b"tiles"])
        count, lines = 0 if mode & 15 else -(-columns // across) * -(-rows // down), 0
    else:
        lines = _LINES[attributes[b"compression"][0]]
        count = -(-rows // lines)
    if said and count and said != count:
        raise ValueError
    return said or count, lines


def _decoded(data: mmap.mmap, kind: bytes, place: int, begin: bytes) -> int:
    """Return how many bytes the samples of a deep chunk have when they are decoded, 0 for others.

    ValueError for a chunk that does not `begin` as it should, ends beyond the file, or claims more than it can hold.
    """
    leader = _LEADERS[kind]
    *stored, whole = (*leader.unpack_from(data, place + len(begin)), 0)[:3]
    end = place + len(begin) + leader.size + sum(stored)
    if data[place : place + len(begin)] != begin or min(stored) < 0 or end > len(data):
        raise ValueError
    if whole > _MOST_COMPRESSED * stored[-1]:
        raise ValueError
    return int(whole)


def _channels(value: bytes) -> Iterator[tuple[str, _Stored]]:
    """Yield the name of each channel in the value of an attribute, and how it is stored."""
    place = 0
    while value[place]:
        name, place = _word(value, place)
        kind, across, down = struct.unpack_from("<i4x2i", value, place)
        yield name.decode("utf-8", "replace"), _Stored(_TYPES[kind], across, down)
        place += 16


def _word(data: mmap.mmap | bytes, place: int) -> tuple[bytes, int]:
    """Return the word at a place, which ends with a zero, and the place behind it."""
    end = data.find(b"\0", place)
    if end < 0:
        raise ValueError
    return data[place:end], end + 1
