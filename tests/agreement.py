"""Whether sets of pictures, each made with several seeds, have the same mean: a Z-test of blocks of pixels."""

from __future__ import annotations

import numpy as np


def blocks(pictures: np.ndarray, size: int) -> np.ndarray:
    """Return the means of square blocks of pixels (seeds, H, W, 3) as (seeds, blocks, 3)."""
    seeds, height, width, channels = pictures.shape
    cut = pictures[:, : height // size * size, : width // size * size]
    cut = cut.reshape(seeds, height // size, size, width // size, size, channels)
    return cut.mean(axis=(2, 4)).reshape(seeds, -1, channels)


def deviations(ours: np.ndarray, theirs: np.ndarray, size: int = 4, bias: float = 0.0) -> np.ndarray:
    """Return by how many standard errors the means of blocks differ, beyond a bias.

    The variance of a block's mean is that of its seeds; few seeds tell it badly, so it is no less than what the median
    of all blocks has of its mean. `bias` is a part of each block's mean, and of the mean of all.
    """
    values = [blocks(each, size) for each in (ours, theirs)]
    centers = [each.mean(axis=0) for each in values]
    scale = np.maximum(centers[1], centers[1].mean(axis=0))
    squares = []
    for each, center in zip(values, centers, strict=True):
        variance = each.var(axis=0, ddof=1) / len(each)
        usual = np.median(variance / np.maximum(center, 1e-12) ** 2, axis=0)
        squares.append(np.maximum(variance, usual * center**2))
    off = np.maximum(np.abs(centers[0] - centers[1]) - bias * scale, 0)
    return off / np.sqrt(sum(squares) + 1e-30)


def ratio(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the ratio of the means of two sets of pictures, over all pixels and channels."""
    return float(ours.mean() / theirs.mean())
