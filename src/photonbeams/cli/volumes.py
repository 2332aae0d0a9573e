"""Rows of `photonbeams info` about the grids of volume files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..runtime.inputs import opened
from ..scene import Array, SceneError
from ..volumes.vdb import VDBGrid, read_grids
from ..volumes.vol import read_vol

VOLUMES = (".vdb", ".vol")
COLUMNS = ("grid", "type", "class", "voxels", "box", "from", "voxel size", "range", "dense", "compression")


def volume_rows(path: Path) -> list[tuple[str, ...]]:
    """Return a row for each grid of a file; SceneError if it cannot be read."""
    try:
        with opened(path) as file:
            if path.suffix.lower() == ".vdb":
                return [_row(each) for each in read_grids(file)]
            voxels = read_vol(file)
    except SceneError as error:
        raise SceneError(f"{path}: expected a grid that can be read, but {error}") from None
    values, size = voxels.values, np.abs(np.diag(voxels.to_file)[:3])
    shape = np.array(values.shape[2::-1])
    kind = "float" if values.ndim == 3 else "vec3s"
    return [
        ("", kind, "", f"{np.prod(shape):,}", _times(shape), triple(voxels.to_file[:3, 3]), triple(size / shape),
         _range([values]), _memory(values.nbytes), "none")
    ]  # fmt: skip


def _row(grid: VDBGrid) -> tuple[str, ...]:
    kind = grid.type + (", half" if grid.half else "")
    word = str(grid.metadata.get("class", ""))
    size = "frustum" if grid.to_file is None else triple(np.linalg.norm(grid.to_file[:3, :3], axis=0))
    try:
        tree = grid.tree
    except SceneError:  # points and text have no voxels
        return (grid.name, kind, word, "not read", "", "", size, "", "", grid.codec)
    if tree.box is None:
        return (grid.name, kind, word, "none", "", "", size, "", "", grid.codec)
    low, high = tree.box
    parts = [values[masks] for _, masks, values in tree.leaves()]
    parts += [tile.value for tile in tree.tiles if tile.active]
    count = high - low + 1
    dense = 4 * tree.channels * float(np.prod(count.astype(np.float64)))
    return (grid.name, kind, word, f"{tree.active_voxels:,}", _times(count), " ".join(str(each) for each in low), size,
            _range(parts), _memory(dense), grid.codec)  # fmt: skip


def _range(parts: list[Array]) -> str:
    """Return a text with the least and the greatest value."""
    some = [part for part in parts if part.size]
    return f"{min(part.min() for part in some):.5g} to {max(part.max() for part in some):.5g}" if some else ""


def _times(counts: Array) -> str:
    return " x ".join(str(each) for each in counts)


def triple(values: Iterable[float]) -> str:
    """Return numbers in a row, or one number if all are the same."""
    words = [f"{value:.4g}" for value in values]
    return words[0] if len(set(words)) == 1 else " ".join(words)


def _memory(size: float) -> str:
    return f"{size / 1e6:,.1f} MB" if size >= 1e5 else f"{size / 1e3:,.1f} kB"
