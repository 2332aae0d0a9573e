"""Mitsuba's .vol files: a dense grid of float32 values.

"VOL", a byte that is 3, then little-endian int32 1 (float32 data), counts along x, y, z, channels, the bounding box as
6 float32, and the data, channels first, then x, y, z.
"""

from __future__ import annotations

import io
import struct
from typing import BinaryIO

import numpy as np

from ..scene import SceneError
from .dense import MOST_VALUES, Voxels

HEADER = struct.Struct("<3sB5i6f")


def vol_shape(file: BinaryIO) -> tuple[int, int, int, int]:
    """Return the counts of cells along x, y, z, and of channels; SceneError if the file does not hold as many."""
    size = file.seek(0, io.SEEK_END)
    if size < HEADER.size:
        raise SceneError(f"it has {size} bytes")
    file.seek(0)
    magic, version, kind, x, y, z, channels, *_ = HEADER.unpack(file.read(HEADER.size))
    if (magic, version, kind) != (b"VOL", 3, 1):
        raise SceneError("its header is not that of float32 data")
    if min(x, y, z) < 1:
        raise SceneError(f"it has {x} x {y} x {z} cells: expected 1 or more along each axis")
    if channels not in (1, 3, 6):  # Mitsuba's: densities, colours, and phase functions
        raise SceneError(f"it has {channels} channels: expected 1 or 3")
    count = x * y * z * channels
    if size < HEADER.size + 4 * count:
        raise SceneError(f"it ends before its {count} values")
    return x, y, z, channels


def read_vol(file: BinaryIO, most: int = MOST_VALUES) -> Voxels:
    """Return the grid of a file with one or three channels; SceneError as `vol_shape`, or for more than `most`."""
    x, y, z, channels = vol_shape(file)
    if channels not in (1, 3):
        raise SceneError(f"it has {channels} channels: expected 1 or 3")
    count = x * y * z * channels
    if count > most:
        raise SceneError(f"it has {count} values: expected up to {most}")
    file.seek(0)
    data = file.read(HEADER.size + 4 * count)
    values = np.frombuffer(data, "<f4", count, HEADER.size).reshape(z, y, x, channels).astype(np.float32)
    low, high = np.array(HEADER.unpack_from(data)[-6:]).reshape(2, 3)
    box = np.diag([*(high - low), 1.0])
    box[:3, 3] = low
    return Voxels(values[..., 0] if channels == 1 else values, box)
