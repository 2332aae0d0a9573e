"""The gobos of the concert: a star, bars, and a break-up, white where the light comes through."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SIZE, FINE = 256, 3  # pixels along a side, and samples per pixel in each direction


def _plane() -> tuple[Array, Array]:
    """Return x and y from −1 to 1 over the fine samples, y upward."""
    x = (np.arange(SIZE * FINE) + 0.5) / (SIZE * FINE) * 2 - 1
    return np.meshgrid(x, -x)


def _pixels(lit: Array) -> Array:
    """Return the mean of the samples of each pixel, (SIZE, SIZE, 1), within the gobo's round frame."""
    x, y = _plane()
    inside = (np.hypot(x, y) < 0.97) & lit
    return np.asarray(inside.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None])


def star() -> Array:
    """Return eight rays around a disc, with dots between their tips."""
    x, y = _plane()
    radius, angle = np.hypot(x, y), np.arctan2(x, y)
    sector = np.abs((angle / (2 * np.pi / 8) + 0.5) % 1 - 0.5) * 2  # 0 on a ray, 1 halfway to the next
    rays = (radius > 0.30) & (radius < 0.95) & (sector < 0.42 * (1 - 0.6 * radius))
    dots = np.hypot(radius - 0.74, radius * (1 - sector) * np.pi / 8) < 0.085
    return _pixels((radius < 0.20) | rays | dots)


def bars() -> Array:
    """Return five upright bars."""
    x, _ = _plane()
    return _pixels(np.abs((x * 2.5 + 0.5) % 1 - 0.5) < 0.24)


def breakup(random: np.random.Generator) -> Array:
    """Return shards: cells of a Voronoi diagram of random sizes, with broad leads between them."""
    x, y = _plane()
    seeds = random.uniform(-1.1, 1.1, (60, 2))
    distance = np.sort(np.hypot(x[..., None] - seeds[:, 0], y[..., None] - seeds[:, 1]), axis=-1)
    owner = np.argmin(np.hypot(x[..., None] - seeds[:, 0], y[..., None] - seeds[:, 1]), axis=-1)
    wide = random.choice([0.05, 0.08, 0.3], len(seeds), p=[0.4, 0.3, 0.3])  # the last leaves no light at all
    return _pixels(distance[..., 1] - distance[..., 0] > wide[owner])
