"""Float64 twin of the noise, written from its definition: a sum over the corners of a cell, in NumPy.

Points are arrays (n, N): a row for each coordinate, the last one for time.
"""

from functools import cache
from itertools import product

import numpy as np

MASK = 0xFFFFFFFF
SHIFTS = np.array([[0.37], [0.61], [0.17], [0.83]])


def mixed(state):
    """Return MurmurHash3's 32-bit finaliser of a state; the numbers are stored in 64 bits."""
    state = state & MASK
    state ^= state >> 16
    state = (state * 0x85EBCA6B) & MASK
    state ^= state >> 13
    state = (state * 0xC2B2AE35) & MASK
    return state ^ (state >> 16)


def hashed(words, seed):
    state = np.full(words[0].shape, (seed * 0x9E3779B9 + 0x7F4A7C15) & MASK, dtype=np.uint64)
    for word in words:
        state = mixed(state + word)
    return state


def cells(points):
    return np.floor(points).astype(np.int64).astype(np.uint64) & MASK


def fade(x):
    return 6 * x**5 - 15 * x**4 + 10 * x**3


@cache
def deviation(n):
    """Return the standard deviation of the noise before it is scaled.

    The variance is the mean over a cell of the sum of its corners' variances. Eight Gauss points per axis integrate
    polynomials of degree 15 exactly, and these have degree 12.
    """
    x, w = np.polynomial.legendre.leggauss(8)
    inside = np.stack(np.meshgrid(*[(x + 1) / 2] * n)).reshape(n, -1)
    weight = np.prod(np.stack(np.meshgrid(*[w / 2] * n)).reshape(n, -1), axis=0)
    variance = 0.0
    for corner in product((0, 1), repeat=n):
        fades = [fade(x) if up else 1 - fade(x) for x, up in zip(inside, corner, strict=True)]
        squared = sum((x - up) ** 2 for x, up in zip(inside, corner, strict=True))
        variance += np.sum(weight * np.prod(fades, axis=0) ** 2 * squared / 3)
    return np.sqrt(variance)


def snoise(points, seed=0):
    points = np.asarray(points, dtype=np.float64)
    n = len(points)
    bits = {1: 24, 2: 16, 3: 10, 4: 8}[n]
    inside = points - np.floor(points)
    total = np.zeros(points.shape[1])
    for corner in product((0, 1), repeat=n):
        state = hashed(cells(np.floor(points) + np.array(corner)[:, None]), seed)
        weight = np.prod([fade(x) if up else 1 - fade(x) for x, up in zip(inside, corner, strict=True)], axis=0)
        for k in range(n):
            number = (state >> (32 - bits * (k + 1))) & ((1 << bits) - 1)
            gradient = 2 * number / ((1 << bits) - 1) - 1
            total += weight * gradient * (inside[k] - corner[k])
    value = total * 0.25 / deviation(n)
    size = np.minimum(np.abs(value), 1.25)
    return np.sign(value) * np.where(size < 0.75, size, 1 - (1.25 - size) ** 2)


def noise(points):
    return 0.5 + 0.5 * snoise(points)


def vnoise(points):
    return np.stack([snoise(points, seed) for seed in (1, 2, 3)])


def octaves(points, count, lacunarity, gain, of):
    total = 0.0
    for k in range(count):
        shifted = points * lacunarity**k + k * SHIFTS[: len(points)]
        total = total + gain**k * of(snoise(shifted, 4 + k if k else 0))
    return 0.5 + 0.5 * total


def fbm(points, count=6, lacunarity=2.0, gain=0.5):
    return octaves(points, count, lacunarity, gain, lambda value: value)


def turbulence(points, count=6, lacunarity=2.0, gain=0.5):
    return octaves(points, count, lacunarity, gain, np.abs)


def cellnoise(points):
    return (hashed(cells(points), 100) >> 8) / 2**24


def random(*numbers):
    # Adding 0 turns −0 into 0.
    words = [(np.asarray(x, dtype=np.float32) + np.float32(0)).view(np.uint32).astype(np.uint64) for x in numbers]
    return (hashed(words, 100) >> 8) / 2**24
