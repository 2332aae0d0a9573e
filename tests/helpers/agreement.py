"""A Z-test of whether two sets of pictures, each rendered with several seeds, have the same mean in each block."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Means(NamedTuple):
    """Means over seeds with their standard errors, of blocks of pixels (blocks, 3) and of the whole picture (3,)."""

    blocks: np.ndarray
    block_errors: np.ndarray
    whole: np.ndarray
    whole_error: np.ndarray


def means(pictures: np.ndarray, size: int = 4) -> Means:
    """Return the means over square blocks of pixels, and over all pixels, of pictures (seeds, H, W, 3).

    The variance of a block's mean comes from the seeds. Few seeds estimate it badly, so the variance relative to the
    squared mean is at least its median over all blocks with light. Relative to the mean it is at least that of all
    blocks together: a dim block has light of few beams, whose number varies by its root.
    """
    seeds, height, width, channels = pictures.shape
    cut = pictures[:, : height // size * size, : width // size * size].astype(np.float64)
    cut = cut.reshape(seeds, height // size, size, width // size, size, channels)
    blocks, whole = cut.mean(axis=(2, 4)).reshape(seeds, -1, channels), cut.mean(axis=(1, 2, 3, 4))
    center = blocks.mean(axis=0)
    variance = blocks.var(axis=0, ddof=1) / seeds
    relative = np.where(center > 0, variance / np.maximum(center, 1e-12) ** 2, np.nan)
    usual = np.nan_to_num(np.nanmedian(relative, axis=0))
    counted = variance.sum(axis=0) / np.maximum(center.sum(axis=0), 1e-30)
    errors = np.sqrt(np.maximum(variance, np.maximum(usual * center**2, counted * center)))
    return Means(center, errors, whole.mean(axis=0), whole.std(axis=0, ddof=1) / np.sqrt(seeds))


def deviations(ours: Means, theirs: Means, bias: float = 0.0) -> np.ndarray:
    """Return by how many standard errors the means of blocks differ beyond a bias.

    `bias` is a fraction of each block's mean, or of the whole picture's mean where that is larger.
    """
    scale = np.maximum(theirs.blocks, theirs.whole)
    off = np.maximum(np.abs(ours.blocks - theirs.blocks) - bias * scale, 0)
    result: np.ndarray = off / np.sqrt(ours.block_errors**2 + theirs.block_errors**2 + 1e-30)
    return result


def ratio(ours: Means, theirs: Means) -> tuple[float, float]:
    """Return the ratio of the means over all pixels and channels, and its standard error."""
    value = float(ours.whole.mean() / theirs.whole.mean())
    # The channels share their noise, so their errors are not independent: the largest relative error counts for all.
    own, other = (float((each.whole_error / np.maximum(each.whole, 1e-30)).max()) for each in (ours, theirs))
    return value, value * float(np.hypot(own, other))
