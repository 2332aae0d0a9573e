"""Write OpenVDB files: dense arrays become float grids, without their empty leaves."""

from __future__ import annotations

import struct
import uuid
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from photonbeams.runtime.files import PathLike, write_bytes
from photonbeams.scene import Array, SceneError
from photonbeams.volumes.bytes import ACTIVE_MASK, ZIP

_LEAF = 8
_OFFSETS = struct.Struct("<3q")


def write_vdb(path: PathLike, grids: Mapping[str, Array], to_file: Array | None = None, half: bool = True) -> None:
    """Write grids to an OpenVDB file, compressed by zip.

    Parameters
    ----------
    grids
        Arrays by name: (Z, Y, X) numbers, or (Z, Y, X, 3) vectors. Voxels of value 0 are inactive.
    to_file
        (4, 4) transform from the unit cube, which the array fills, to the file's space, for column vectors; None: cells
        have the size 1, and the first one begins at the origin.
    half
        Whether half floats are written, which have 11 bits of precision and half the size.

    Raises
    ------
    SceneError
        Arrays of another shape, or with numbers that are not finite.
    OSError
        As for `runtime.files.atomic_path`: the file is written whole or not at all.
    """
    unique = str(uuid.uuid5(uuid.NAMESPACE_OID, "photonbeams")).encode()
    parts = [struct.pack("<8s3IB36s", b" BDV\0\0\0\0", 224, 11, 0, 1, unique), struct.pack("<2i", 0, len(grids))]
    place = sum(map(len, parts))
    for name, values in grids.items():
        values = np.asarray(values, dtype=np.float32)
        if values.ndim not in (3, 4) or values.shape[3:] not in ((), (3,)) or not np.all(np.isfinite(values)):
            raise SceneError(f"grid {name} has the shape {values.shape}: expected (Z, Y, X) or (Z, Y, X, 3), finite")
        parts.append(_grid(name, values, to_file, half, place))
        place += len(parts[-1])
    write_bytes(path, b"".join(parts))


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def _grid(name: str, values: Array, to_file: Array | None, half: bool, place: int) -> bytes:
    """Return a grid with its descriptor, which will be at the offset `place` of the file."""
    kind = "float" if values.ndim == 3 else "vec3s"
    tree = f"Tree_{kind}_5_4_3" + ("_HalfFloat" if half else "")
    head = _text(name) + _text(tree) + _text("")
    start = place + len(head) + _OFFSETS.size
    meta = [("name", "string", name.encode()), ("class", "string", b"fog volume")]
    meta += [("is_saved_as_half_float", "bool", bytes([half]))]
    top = [struct.pack("<I", ZIP | ACTIVE_MASK), struct.pack("<i", len(meta))]
    top += [_text(key) + _text(type_) + struct.pack("<I", len(value)) + value for key, type_, value in meta]
    shape = np.array(values.shape[2::-1], dtype=np.float64)
    matrix = np.diag([*shape, 1.0]) if to_file is None else np.asarray(to_file, dtype=np.float64)
    # OpenVDB's voxels have their centres at whole indices.
    to_cells = np.diag([*1 / shape, 1.0])
    to_cells[:3, 3] = 0.5 / shape
    top += [_text("AffineMap"), (matrix @ to_cells).T.astype("<f8").tobytes()]
    leaves = _leaves(values)
    channels = values.shape[3] if values.ndim == 4 else 1
    top.append(struct.pack("<i", 1) + bytes(4 * channels) + _topology(leaves, channels, half))
    buffers = b"".join(_leaf(values, half) for values in leaves.values())
    body = b"".join(top)
    return head + _OFFSETS.pack(start, start + len(body), start + len(body) + len(buffers)) + body + buffers


def _leaves(values: Array) -> dict[tuple[int, int, int], Array]:
    """Return the leaves that are not empty by origin, in the order of the tree."""
    array = values.reshape(*values.shape[:3], -1).transpose(2, 1, 0, 3)
    counts = [-(-count // _LEAF) for count in array.shape[:3]]
    found = {}
    for node in np.ndindex(*(-(-count // 16) for count in counts)):
        for child in np.ndindex(16, 16, 16):
            origin = tuple(_LEAF * (16 * a + b) for a, b in zip(node, child, strict=True))
            part = array[tuple(slice(first, first + _LEAF) for first in origin)]
            if part.size and part.any():
                leaf = np.zeros((_LEAF, _LEAF, _LEAF, array.shape[3]), np.float32)
                leaf[: part.shape[0], : part.shape[1], : part.shape[2]] = part
                found[origin] = leaf.reshape(_LEAF**3, -1)
    return dict(sorted(found.items(), key=lambda item: _order(item[0])))  # type: ignore[arg-type]


def _order(origin: tuple[int, int, int]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(each // size for each in origin) for size in (4096, 128, _LEAF))


def _topology(leaves: Mapping[tuple[int, int, int], Array], channels: int, half: bool) -> bytes:
    """Return root and nodes with their masks, values of 0 where there is no child, and the leaves' masks."""
    roots: dict[tuple[int, ...], dict[tuple[int, ...], list[tuple[int, int, int]]]] = {}
    for origin in leaves:
        root, node, _ = _order(origin)
        roots.setdefault(root, {}).setdefault(node, []).append(origin)
    parts = [struct.pack("<2I", 0, len(roots))]
    for root, nodes in roots.items():
        parts.append(struct.pack("<3i", *(4096 * each for each in root)))
        parts.append(_node(np.array(list(nodes)) % 32, 5, half))
        for origins in nodes.values():
            parts.append(_node(np.array(origins) // _LEAF % 16, 4, half))
            parts += [_mask(leaves[origin].any(axis=1)) for origin in origins]
    return b"".join(parts)


def _node(children: Array, log: int, half: bool) -> bytes:
    mask = np.zeros((1 << log,) * 3, dtype=bool)
    mask[tuple(children.T)] = True
    # Inactive values are the background and not stored; for half floats even their size is omitted.
    return _mask(mask.reshape(-1)) + bytes(mask.size // 8) + b"\0" + (b"" if half else bytes(8))


def _mask(mask: Any) -> bytes:
    return np.packbits(mask, bitorder="little").tobytes()


def _leaf(values: Array, half: bool) -> bytes:
    active = values.any(axis=1)
    data = values[active].astype("<f2" if half else "<f4").tobytes()
    packed = zlib.compress(data)
    stored = (
        struct.pack("<q", len(packed)) + packed if len(packed) < len(data) else struct.pack("<q", -len(data)) + data
    )
    return _mask(active) + b"\0" + stored
