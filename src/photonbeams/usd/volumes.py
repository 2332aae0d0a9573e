"""Densities of UsdVol volumes: grids in files of Mitsuba's .vol format.

The format: "VOL", a byte that is 3, then little-endian int32 1 (float32 data), counts along x, y, z, channels, the
bounding box as 6 float32, and the data, channels first, then x, y, z.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from pathlib import Path

import numpy as np
from pxr import Ar, Sdf, Usd

from ..scene import Array, DensityGrid, SceneError
from .reading import Reading
from .textures import resolved, stamp

_HEADER = struct.Struct("<3sB5i6f")
_DENSITY = "field:density"


def read_grid(reading: Reading, prim: Usd.Prim, to_world: Array) -> DensityGrid | None:
    """Return the density of a volume, or None, with a warning, where its file is of a kind that is not read.

    Raises
    ------
    SceneError
        A volume without such a field, a file that is not there or cannot be read.
    """
    fields = reading.targets(prim, _DENSITY)
    if not fields:
        raise reading.fail(prim, _DENSITY, "names no field: expected a relationship to a prim with a filePath")
    field = fields[0]
    asset = reading.value(field, "filePath")
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        raise reading.fail(field, "filePath", "names no file: expected a grid, @name.vol@")
    if Path(asset.path).suffix.lower() != ".vol":
        reading.warn(prim, f"has its density in {asset.path}, which is not read: expected a .vol file; it is skipped")
        return None
    path = resolved(reading, asset)
    if not path:
        raise reading.fail(field, "filePath", f"names {asset.path}: expected a .vol file, there is none")
    try:
        values, low, high = _vol(path, stamp(path))
        local = np.linalg.inv(reading.to_world(prim)) @ reading.to_world(field)
        box = np.diag([*(high - low), 1.0])
        box[:3, 3] = low
        return DensityGrid(values, to_world @ local @ box)
    except (SceneError, ValueError, OSError, np.linalg.LinAlgError) as error:
        raise reading.fail(
            field, "filePath", f"names {asset.path}: expected a .vol file of a density ({error})"
        ) from None


# A shutter is read at many times: the values are then the same object, read once.
@lru_cache(maxsize=16)
def _vol(path: str, _stamp: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return values, (Z, Y, X) or (Z, Y, X, 3), and the corners of the bounding box."""
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        raise ValueError("it cannot be opened")
    data = bytes(asset.GetBuffer())
    if len(data) < _HEADER.size:
        raise ValueError(f"it has {len(data)} bytes")
    magic, version, kind, x, y, z, channels, *box = _HEADER.unpack_from(data)
    if (magic, version, kind) != (b"VOL", 3, 1) or channels not in (1, 3) or min(x, y, z) < 1:
        raise ValueError("its header is not that of float32 data of one or three channels")
    count = x * y * z * channels
    if len(data) < _HEADER.size + 4 * count:
        raise ValueError(f"it ends before its {count} values")
    values = np.frombuffer(data, "<f4", count, _HEADER.size).reshape(z, y, x, channels).astype(np.float32)
    return values[..., 0] if channels == 1 else values, np.array(box[:3]), np.array(box[3:])
