"""Smoke that drifts, on a grid: sheets of noise, carried along by the curl of noise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

Array = npt.NDArray[np.float64]

SIDE = 64  # cells of the periodic noise along each edge
STEPS = 9  # steps back along the path on which smoke came


def noise(random: np.random.Generator, coarsest: float, slope: float) -> Array:
    """Return periodic noise of deviation 1, (SIDE, SIDE, SIDE): `coarsest` waves per cube and more, finer weaker."""
    k = np.fft.fftfreq(SIDE, 1 / SIDE)
    length = np.sqrt(sum(each**2 for each in np.meshgrid(k, k, k, indexing="ij")))
    weight = np.where((length >= coarsest) & (length < SIDE / 4), np.maximum(length, 1) ** -slope, 0)
    field = np.fft.ifftn(np.fft.fftn(random.standard_normal((SIDE,) * 3)) * weight).real
    return field / field.std()


def curl(random: np.random.Generator, coarsest: float, slope: float) -> list[Array]:
    """Return a velocity without divergence, of deviation 1: the curl of three fields of noise."""
    x, y, z = (noise(random, coarsest, slope) for _ in range(3))

    def slopes(field: Array) -> list[Array]:
        return [(np.roll(field, -1, axis) - np.roll(field, 1, axis)) / 2 for axis in range(3)]

    dx, dy, dz = slopes(x), slopes(y), slopes(z)
    velocity = [dz[1] - dy[2], dx[2] - dz[0], dy[0] - dx[1]]
    return [each / each.std() for each in velocity]


class Smoke:
    """Smoke in a box, at any time."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        self._wind, self._eddies = curl(random, 1, 3.2), curl(random, 4, 2.4)
        self._sheets, self._clouds = noise(random, 2, 2.6), noise(random, 1, 3.0)

    def density(self, low: Array, high: Array, counts: tuple[int, int, int], time: float) -> Array:
        """Return the density of cells of a box, (X, Y, Z), from 0 to about 1; the noise repeats after 8 units."""
        axes = [a + (np.arange(count) + 0.5) * (b - a) / count for a, b, count in zip(low, high, counts, strict=True)]
        place = np.stack(np.meshgrid(*axes, indexing="ij")) * (SIDE / 8)
        came = (1.0 + 0.35 * time) * SIDE / 8
        for _ in range(STEPS):
            wind, eddies = (np.stack([_at(each, place) for each in field]) for field in (self._wind, self._eddies))
            place = place - came / STEPS * (0.34 * wind + 0.13 * eddies)
        sheets = np.exp(-((_at(self._sheets, place) / 0.36) ** 2))
        clouds = np.clip(0.58 + 0.42 * _at(self._clouds, place), 0, 1)
        return (0.06 + clouds * sheets) * _fading(counts)


def _fading(counts: tuple[int, int, int]) -> Array:
    """Return factors of cells that fall to 0 at the sides of the box, so that the box is not visible."""
    x, y, z = (np.clip(np.minimum(np.arange(n) + 0.5, n - np.arange(n) - 0.5) / (0.24 * n), 0, 1) for n in counts)
    product = x[:, None, None] * y[:, None] * z
    return product * product * (3 - 2 * product)


def _at(field: Array, place: Array) -> Array:
    return np.asarray(map_coordinates(field, place, order=1, mode="grid-wrap"))
