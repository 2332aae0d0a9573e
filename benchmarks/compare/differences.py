"""How pictures of two trees differ, as pure functions of NumPy arrays.

Pictures are grey, (S, H, W): those of S seeds, the same seeds for both trees. A seed's two pictures are a pair: where
the trees draw the same light paths, nearly all noise is in both, and cancels in their difference. So what is tested is
the mean of the pairs' differences, against how much these differ from seed to seed. The test is also right where the
trees draw other paths; then the noise is that of both.

Two seeds give one number for the noise of the whole picture, which is too few. But the differences of blocks of pixels
are many. Their variances add up to that of the mean if blocks are independent, and neighbouring pixels are not: a beam
is wide. So the variance is taken from blocks of several sizes, up to a third of the picture, and the size decides at
which the change is least significant. What a whole picture has in common, such as the number of paths through a
keyhole, no block shows: where the whole picture's variance is larger than that of the blocks allows, it decides as
well. A Student's t has as many degrees of freedom as the blocks have by Satterthwaite (1946), and is told as Z, the
number of standard deviations of a normal variate that is as improbable.

Two means are tested: that of all light, and one in which blocks with much noise weigh less. In many pictures a few
bright blocks have most of the noise, and hide what happens to the others: with two seeds and other paths, a change of
5 % of the keyhole is seen in no comparison of a hundred by the first mean, and in 89 by the second.

Calibrated with 12 seeds of eight scenes, in November 2026: between pairs of other seeds, Z has a standard deviation of
0.7 to 1.1, of 1.4 in the shaft, and of 2 in the forest, where few beams make the light of the whole picture: there,
more seeds tell a change from chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage, special, stats

Array = npt.NDArray[np.float64]

# Rows of square blocks in the picture, from which the noise of the mean is taken.
ROWS = (12, 6, 4, 3)
# How improbable the whole picture's variance must be, from the blocks, before it decides.
SURPRISE = 0.01
# The least variance of a block, relative to the square of its light, by which its weight is found.
QUIET = 3e-4
# Side of the blocks, in pixels, of which the worst is told, and the neighbourhood, in blocks, that shares its variance.
BLOCK = 8
NEIGHBOURHOOD = 5
# The noise that rounding alone may cause, relative to a block's light: 10 units in the last place.
ROUNDING = 1e-6
# Side of the blocks, in pixels, whose error counts: an eye averages over some pixels.
ERROR_BLOCK = 4
# Light of a block, relative to the mean, below which errors are not taken relative to it.
DARK = 0.01
# How many times as bright as its surroundings a dot is, and how bright at least, in units of the picture's mean.
DOT = 10.0
DOT_LEAST = 1.0
# A dot's surroundings are the frame of pixels at this distance.
RING = 2


class Change(NamedTuple):
    """A change of the mean, relative to the base's mean, and its significance as a normal variate, signed."""

    relative: float
    z: float


class Block(NamedTuple):
    """A block whose light has changed, relative to its light, with its significance; its corner in pixels."""

    relative: float
    z: float
    x: int
    y: int


def grey(pictures: Any) -> Array:
    """Return pictures, (S, H, W, 3), as (S, H, W); what is not finite is 0."""
    result: Array = np.nan_to_num(np.asarray(pictures, np.float64), posinf=0.0, neginf=0.0).mean(axis=-1)
    return result


def block_sums(picture: Array, side: int) -> Array:
    """Return the sums of the last two axes' blocks of `side` × `side` values; those at the edges may be smaller."""
    rows, columns = (np.arange(0, length, side) for length in picture.shape[-2:])
    sums: Array = np.add.reduceat(np.add.reduceat(picture, rows, axis=-2), columns, axis=-1)
    return sums


def normal(t: float, freedom: float) -> float:
    """Return the normal variate that is as improbable as a Student's `t`."""
    z = -float(special.ndtri_exp(stats.t.logsf(abs(t), freedom)))
    return float(np.copysign(z if np.isfinite(z) else abs(t), t))


# -- means -----------------------------------------------------------------------------------------------------------


class _Variance(NamedTuple):
    """The variance of a sum, and its degrees of freedom."""

    value: float
    freedom: float


def change(base: Array, new: Array) -> Change:
    """Return how the mean of pictures has changed, (S, H, W) for each tree, with at least two seeds."""
    difference = new - base
    total = float(difference.mean(axis=0).sum())
    light = abs(float(base.mean(axis=0).sum()))
    if not difference.any():
        return Change(0.0, 0.0)
    scores = [_score(total, variance) for variance in _variances(difference)]
    return Change(total / light if light else np.inf, min(scores, key=abs))


def weights(base: Array, new: Array) -> Array:
    """Return the weights of pixels in the second mean, (H, W), whose mean is 1.

    A block's weight is the root of its light over its variance between seeds, both averaged over its neighbourhood. The
    root is a compromise: the inverse variance would be best if the variance were known, but it is that of few numbers.
    """
    sums = np.stack([block_sums(pictures, BLOCK) for pictures in (base, new)])  # (2, S, rows, columns)
    variance = _shared(sums.var(axis=1, ddof=1).mean(axis=0))
    light = _shared(np.abs(sums).mean(axis=(0, 1)))
    weight = np.sqrt(light / (variance + QUIET * light**2 + 1e-30))
    rows, columns = base.shape[1:]
    pixels: Array = weight.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[:rows, :columns]
    mean = float(pixels.mean())
    return pixels / mean if mean else np.ones_like(pixels)


def _shared(blocks: Array) -> Array:
    """Return the means of the blocks' neighbourhoods."""
    # Its running sums may be below 0 by rounding where all blocks are black.
    means: Array = np.maximum(ndimage.uniform_filter(blocks, NEIGHBOURHOOD, mode="nearest"), 0)
    return means


def _score(total: float, variance: _Variance) -> float:
    if variance.value == 0:
        return float(np.copysign(np.inf, total)) if total else 0.0
    return normal(total / variance.value**0.5, variance.freedom)


def _variances(difference: Array) -> Iterator[_Variance]:
    """Yield the variances of the sum over the picture of the seeds' mean, one for each size of blocks that decides."""
    height = difference.shape[1]
    sizes = [_variance(block_sums(difference, -(-height // rows))) for rows in ROWS]
    yield from sizes
    whole = _variance(difference.sum(axis=(1, 2), keepdims=True))
    if _is_larger(whole, max(sizes)):
        yield whole


def _is_larger(one: _Variance, other: _Variance) -> bool:
    """Return whether a variance is larger than another beyond chance."""
    if other.value == 0:
        return True
    return bool(stats.f.sf(one.value / other.value, one.freedom, other.freedom) < SURPRISE)


def _variance(blocks: Array) -> _Variance:
    """Return the variance of the sum of independent blocks, (S, …), of the seeds' mean.

    A block's variance has S − 1 degrees of freedom. The sum has fewer the more it is that of few blocks: as many as the
    variate χ² whose mean and variance are the sum's.
    """
    seeds = len(blocks)
    variance = blocks.var(axis=0, ddof=1).ravel() / seeds
    total, squares = float(variance.sum()), float((variance**2).sum())
    effective = (seeds + 1) * total**2 / squares if squares else np.inf
    return _Variance(total, float(min(effective, (seeds - 1) * variance.size)))


def worst_block(base: Array, new: Array) -> Block:
    """Return the block with the most significant change.

    A block's variance is the larger of its own and its neighbourhood's mean. Of some hundred blocks, the worst has a Z
    of three to five by chance, and more where single paths are bright.
    """
    difference = block_sums(new - base, BLOCK)
    light = block_sums(np.abs(base).mean(axis=0), BLOCK)
    variance = difference.var(axis=0, ddof=1) / len(difference)
    deviation = np.sqrt(np.maximum(variance, _shared(variance))) + ROUNDING * light
    mean = difference.mean(axis=0)
    t = np.divide(mean, deviation, out=np.zeros_like(mean), where=deviation > 0)
    row, column = np.unravel_index(np.abs(t).argmax(), t.shape)
    freedom = NEIGHBOURHOOD**2 * (len(difference) - 1)
    relative = mean[row, column] / max(light[row, column], DARK * float(light.mean()), 1e-30)
    return Block(float(relative), normal(float(t[row, column]), freedom), int(column) * BLOCK, int(row) * BLOCK)


# -- noise, dots and lines -------------------------------------------------------------------------------------------


def error(pictures: Array) -> float:
    """Return the relative error of one of several pictures, (S, H, W): the root of the mean over blocks.

    The variance of each block is taken relative to its light and weighted by its light: dark corners may be noisy.
    """
    sums = block_sums(pictures, ERROR_BLOCK)
    variance, light = sums.var(axis=0, ddof=1), np.abs(sums.mean(axis=0))
    floor = max(DARK * float(light.mean()), 1e-30)
    return float(((variance / np.maximum(light, floor)).sum() / max(float(light.sum()), 1e-30)) ** 0.5)


def dots(pictures: Any) -> int:
    """Return how many dots pictures have, (S, H, W, 3), all together.

    A dot is the brightest of the 3 × 3 pixels about it, as bright as the picture's mean at least, and more than ten
    times as bright as its surroundings: the second brightest of the 16 pixels at distance two. So a dot's own blur by
    the pixel filter is not its surroundings, two dots may be neighbours, and neither an edge nor a thin line, which
    crosses these pixels twice, is a dot. Pixels that are not finite are dots, too.
    """
    count = int((~np.isfinite(pictures)).any(axis=-1).sum())
    return count + sum(_dots(picture) for picture in grey(pictures))


def _dots(picture: Array) -> int:
    rows, columns = picture.shape
    wide = np.pad(picture, RING, mode="reflect")
    steps = range(-RING, RING + 1)
    ring = [
        wide[RING + y : RING + y + rows, RING + x : RING + x + columns]
        for y in steps for x in steps if max(abs(y), abs(x)) == RING
    ]  # fmt: skip
    around = np.sort(ring, axis=0)[-2]
    brightest = picture >= ndimage.maximum_filter(picture, 3, mode="nearest")
    bright = picture > np.maximum(DOT * around, DOT_LEAST * picture.mean())
    return int((bright & brightest).sum())


def dots_came(base: int, new: int) -> bool:
    """Return whether a tree has more dots than another by more than three standard deviations of a Poisson variate."""
    return new > base + 3 * (base + 1) ** 0.5


def line(pictures: Array) -> float:
    """Return how much the most conspicuous row or column of the pictures' mean, (S, H, W), stands out.

    A row stands out by how far its mean is above, or below, those of both of its neighbours: by the smaller of the two
    steps, or an edge would count. It is taken relative to their light, in units of the median row's; for columns the
    same. Where there is no artefact, the largest is that of some thin object.
    """
    mean = pictures.mean(axis=0)
    return max(_steps(mean.mean(axis=1)), _steps(mean.mean(axis=0)))


def _steps(means: Array) -> float:
    """Return the largest step to the same side against both neighbours, in units of the median step."""
    before, middle, after = means[:-2], means[1:-1], means[2:]
    step = np.minimum(np.abs(middle - before), np.abs(middle - after))
    step /= np.maximum((before + middle + after) / 3, DARK * float(np.abs(means).mean()) + 1e-30)
    same_side = (middle - before) * (middle - after) > 0
    typical = float(np.median(step))
    return float((step * same_side).max() / typical) if typical else 0.0
