"""Dense boxes of voxels, which the renderer takes, made from sparse grids.

One box around puffs that are far apart would have far more voxels than they have. So where a box is too large, each
connected part of the grid gets its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..scene import Array, SceneError
from .tree import Tree
from .vdb import VDBGrid

# The most values of a dense box, 406³. Each takes 4 bytes, and 4 more for each copy that a renderer makes.
MOST_VALUES = 1 << 26
# The most boxes of a grid: each is a medium of its own, and rays pass one after the other.
_MOST_PARTS = 16
# Parts beyond these are not told apart, because pairs are compared.
_MOST_PIECES = 256

#: The least and the greatest index of voxels.
Box = tuple[Array, Array]


@dataclass(frozen=True)
class Voxels:
    """A dense box of voxels."""

    values: Array  # (Z, Y, X) or (Z, Y, X, 3) float32, at the centres of cells
    to_file: Array  # (4, 4) from the unit cube, which the box fills, to the space of the file, for column vectors
    step: int = 1  # how many of the file's voxels make one cell, along each edge: more than 1 if it has too many


def parts_of(grid: VDBGrid, most: int = MOST_VALUES) -> list[Voxels]:
    """Return boxes as `voxels_of`, which do not overlap: one of the grid, or of each of its parts if that is finer.

    Raises
    ------
    SceneError
        The same as for `voxels_of`.
    """
    tree = grid.tree
    if tree.box is None or tree.background.any() or _step([tree.box], tree.channels, most) == 1:
        return [voxels_of(grid, most)]
    boxes = _boxes(tree)
    step = _step(boxes, tree.channels, most)
    apart: list[Box] = []
    while len(apart) != len(boxes):  # borders of cells grow with the step
        apart, boxes = boxes, _merged(boxes, 3 * step)
        step = _step(boxes, tree.channels, most)
    return [voxels_of(grid, most, (box, step)) for box in boxes]


def voxels_of(grid: VDBGrid, most: int = MOST_VALUES, part: tuple[Box, int] | None = None) -> Voxels:
    """Return the box of a grid's active voxels, or of a `part` with its step; with a border of cells that are 0.

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
    (low, high), step = part or (tree.box, _step([tree.box], tree.channels, most))
    count = high - low + 1
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
        _fill(sums, tile.origin - low, tile.size, density(tile.value) - background, count, step)
    if background.any():
        sums += background
    return sums


def _boxes(tree: Tree) -> list[Box]:
    """Return the boxes of connected leaves and tiles that are active; only the whole if there are very many."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    assert tree.box is not None
    if sum(tile.active for tile in tree.tiles) > _MOST_PIECES:
        return [tree.box]
    origins = tree.origins[tree.masks.any(axis=1)]
    neighbors = cKDTree(origins // tree.size).query_pairs(1, p=np.inf, output_type="ndarray")
    links = coo_matrix((np.ones(len(neighbors)), neighbors.T), (len(origins), len(origins)))
    count, label = connected_components(links, directed=False)
    if count > _MOST_PIECES:
        return [tree.box]
    lows, highs = np.full((count, 3), 1 << 40), np.full((count, 3), -1 << 40)
    np.minimum.at(lows, label, origins)
    np.maximum.at(highs, label, origins + tree.size - 1)
    tiles = [(tile.origin, tile.origin + tile.size - 1) for tile in tree.tiles if tile.active]
    low, high = tree.box
    return [
        (np.maximum(first, low), np.minimum(last, high)) for first, last in (*zip(lows, highs, strict=True), *tiles)
    ]


def _merged(boxes: list[Box], gap: int) -> list[Box]:
    """Return boxes that are more than a `gap` apart, and not too many: others are merged with the nearest in volume."""
    result = list(boxes)
    while len(result) > 1:
        lows, highs = (np.array(each, dtype=float) for each in zip(*result, strict=True))
        distance = np.maximum(lows[:, None] - highs[None], lows[None] - highs[:, None]).max(axis=-1)
        union = np.prod(np.maximum(highs[:, None], highs[None]) - np.minimum(lows[:, None], lows[None]) + 1, axis=-1)
        cost = np.where(distance <= gap, -1.0, union)
        np.fill_diagonal(cost, np.inf)
        one, other = np.unravel_index(np.argmin(cost), cost.shape)
        if cost[one, other] > 0 and len(result) <= _MOST_PARTS:
            break
        (low, high), (first, last) = result[one], result[other]
        kept = [each for index, each in enumerate(result) if index not in (one, other)]
        result = [*kept, (np.minimum(low, first), np.maximum(high, last))]
    return sorted(result, key=lambda box: box[0].tolist())


def _step(boxes: list[Box], channels: int, most: int) -> int:
    """Return the smallest edge of cells, in voxels, for which boxes have no more than `most` values in all."""
    counts, step = np.array([high - low + 1 for low, high in boxes]), 1
    while channels * float(np.prod(-(-counts // step) + 2.0, axis=1).sum()) > most:
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
