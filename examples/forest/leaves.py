"""The gobo of the forest: a tile of leaves with gaps, white where the sun comes through."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SIZE = 640  # pixels of the tile's side
FINE = 2  # samples per pixel in each direction
LEAVES = 9000


def waves(random: np.random.Generator, most: int, count: int = 40) -> Array:
    """Return a tileable field of about unit deviation, with at most `most` waves across the tile."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] * (2 * np.pi / SIZE)
    total = np.zeros((SIZE, SIZE))
    for _ in range(count):
        ku, kv = random.integers(-most, most + 1, 2)
        total += np.cos(ku * u + kv * v + random.uniform(0, 2 * np.pi)) if (ku, kv) != (0, 0) else 0
    return total / np.sqrt(count / 2)


def leaves(random: np.random.Generator) -> Array:
    """Return the tile, (SIZE, SIZE, 1), from 0 behind leaves to 1 in the gaps; its edges fit together.

    Leaves are pointed ovals. They grow everywhere except where two slowly varying fields agree, so that gaps come in
    groups: the shafts of light are broad, with sparks between them.
    """
    gaps = 0.8 * waves(random, 4) + waves(random, 14)
    shut = np.zeros((SIZE * FINE, SIZE * FINE), dtype=bool)
    placed = 0
    while placed < LEAVES:
        x, y = random.uniform(0, SIZE, 2)
        length, angle = random.uniform(9, 20), random.uniform(0, 2 * np.pi)
        slender = random.uniform(0.28, 0.42)
        placed += 1
        if gaps[int(y), int(x)] > 1.45:
            continue
        reach = int(length * FINE) + 2
        column, row = int(x * FINE), int(y * FINE)
        v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1] / (FINE * length)
        along = u * np.cos(angle) + v * np.sin(angle)
        across = v * np.cos(angle) - u * np.sin(angle)
        leaf = np.abs(across) < slender * (1 - along**2) * (1 - 0.35 * along)
        rows = np.arange(row - reach, row + reach + 1) % len(shut)
        columns = np.arange(column - reach, column + reach + 1) % len(shut)
        shut[np.ix_(rows, columns)] |= leaf & (np.abs(along) < 1)
    open_part = 1.0 - shut.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))
    return open_part[..., None]
