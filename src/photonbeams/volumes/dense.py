"""Dense boxes of voxels, which the renderer takes, made from sparse grids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..scene import Array, SceneError
from .tree import Tree
from .vdb import VDBGrid

# The most values of a dense box, 406³. Each takes 4 bytes, and 4 more for each copy that a renderer makes.
MOST_VALUES = 1 << 26


@dataclass(frozen=True)
class Voxels:
    """A dense box of voxels."""

    values: Array  # (Z, Y, X) or (Z, Y, X, 3) float32, at the centres of cells
    to_file: Array  # (4, 4) from the unit cube, which the box fills, to the space of the file, for column vectors
    step: int = 1  # how many of the file's voxels make one cell, along each edge: more than 1 if it has too many

    def at(self, points: Array) -> Array:
        """Return values at points (N, 3) in the file's space, linear between the centres of cells, 0 outside."""
        from scipy.ndimage import map_coordinates

        shape = np.array(self.values.shape[2::-1])
        inverse = np.linalg.inv(self.to_file)
        places = (points @ inverse[:3, :3].T + inverse[:3, 3]) * shape - 0.5
        channels = self.values.reshape(*self.values.shape[:3], -1)
        found = [
            map_coordinates(channels[..., each], places.T[::-1], order=1, mode="constant")
            for each in range(channels.shape[3])
        ]
        return np.stack(found, axis=-1).astype(np.float32)

    def centers(self) -> Array:
        """Return the centres of cells in the file's space, (Z · Y · X, 3)."""
        axes = [(np.arange(count) + 0.5) / count for count in self.values.shape[2::-1]]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        unit = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        return unit @ self.to_file[:3, :3].T + self.to_file[:3, 3]


def voxels_of(grid: VDBGrid, most: int = MOST_VALUES) -> Voxels:
    """Return the box of a grid's active voxels, with a border of cells whose value is 0.

    Linear interpolation then falls to the background over one voxel, as in OpenVDB. If there were more than `most`
    values, cells are the means over cubes of voxels. A level set becomes a density: 1 if deeper than its narrow band,
    0 outside.

    Raises
    ------
    SceneError
        A grid whose transform is not linear; a grid that is broken.
    """
    if grid.to_file is None:
        raise SceneError(f"its grid {grid.name} is in a frustum: expected a linear transform")
    tree = grid.tree
    if tree.box is None:
        return Voxels(np.zeros((1, 1, 1) if tree.channels == 1 else (1, 1, 1, 3), np.float32), grid.to_file)
    low, high = tree.box
    count = high - low + 1
    step = _step(count, tree.channels, most)
    cells = -(-count // step)
    density = _inside(grid) if grid.is_level_set and tree.channels == 1 else (lambda values: values.astype(np.float32))
    # Values that are not finite, or too large for float32, are found at the end.
    with np.errstate(over="ignore", invalid="ignore"):
        sums = _sums(tree, density, (low, count, step))
    if not np.all(np.isfinite(sums)):
        raise SceneError(f"its grid {grid.name} has values that are not finite numbers")
    result = np.zeros((*cells[::-1] + 2, tree.channels), dtype=np.float32)
    result[1:-1, 1:-1, 1:-1] = sums.transpose(2, 1, 0, 3)
    box = np.diag([*(step * (cells + 2.0)), 1.0])
    box[:3, 3] = low - step - 0.5
    return Voxels(result[..., 0] if tree.channels == 1 else result, grid.to_file @ box, step)


def _sums(tree: Tree, density: Callable[[Array], Array], box: tuple[Array, Array, int]) -> Array:
    """Return the means of cells, (X, Y, Z, channels); `box` is least index, count of voxels, and a cell's edge."""
    low, count, step = box
    background = density(tree.background)
    sums = np.zeros((*-(-count // step), tree.channels), dtype=np.float32)
    for origins, _, values in tree.leaves():
        blocks = density(values).reshape(-1, tree.size, tree.size, tree.size, tree.channels) - background
        for origin, block in zip(origins - low, blocks, strict=True):
            _add(sums, origin, block, count, step)
    for tile in tree.tiles:
        origin = np.array(tile.origin) - low
        _fill(sums, origin, tile.size, density(tile.value) - background, count, step)
    if background.any():
        sums += background
    return sums


def _step(count: Array, channels: int, most: int) -> int:
    """Return the smallest edge of cells, in voxels, for which a box has no more than `most` values."""
    step = 1
    while channels * float(np.prod(-(-count // step) + 2.0)) > most:
        step += 1 + step // 8  # boxes may be wider than any loop by ones should be long
    return step


def _inside(grid: VDBGrid) -> Callable[[Array], Array]:
    """Return a function from a level set's distances to densities: the depth in the narrow band, as in OpenVDB."""
    band = float(abs(grid.tree.background[0])) or 1.0
    return lambda values: np.clip(-values.astype(np.float32) / band, 0, 1)


def _add(sums: Array, origin: Array, block: Array, count: Array, step: int) -> None:
    """Add a leaf's values to the means of cells."""
    first, last = np.maximum(-origin, 0), np.minimum(count - origin, block.shape[0])
    if np.any(last <= first):
        return
    block = block[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    start = (origin + first) // step
    if step > 1:
        for axis in range(3):
            cells = (np.arange(first[axis], last[axis]) + origin[axis]) // step
            block = np.add.reduceat(block, np.unique(cells, return_index=True)[1], axis=axis)
        block = block / step**3
    sums[tuple(slice(a, a + n) for a, n in zip(start, block.shape[:3], strict=True))] += block


def _fill(sums: Array, origin: Array, size: int, value: Array, count: Array, step: int) -> None:
    """Add a tile's value to the means of cells, weighted by the fraction of each cell that it covers."""
    first, last = np.maximum(origin, 0), np.minimum(origin + size, count)
    if np.any(last <= first):
        return
    parts, places = [], []
    for axis in range(3):
        cells = np.arange(first[axis] // step, (last[axis] - 1) // step + 1)
        overlap = np.minimum((cells + 1) * step, last[axis]) - np.maximum(cells * step, first[axis])
        parts.append((overlap / step).astype(np.float32))
        places.append(slice(cells[0], cells[-1] + 1))
    weight = parts[0][:, None, None] * parts[1][:, None] * parts[2]
    sums[tuple(places)] += weight[..., None] * value
