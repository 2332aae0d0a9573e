"""Noise of texture nodes: Perlin's (2002) with the hash of Jenkins (2006), and the sum of its octaves."""

from __future__ import annotations

from typing import Any

import numpy as np

_SCALE = 0.982  # Blender's, which keeps noise of three dimensions in -1 to 1


def fractal(points: Any, detail: float, roughness: Any, lacunarity: Any) -> Any:
    """Return noise (N,) from 0 to 1, about 0.5, at points (N, 3): `detail` octaves beyond the first."""
    detail = float(np.clip(detail, 0, 15))
    whole, part = int(detail), detail - int(detail)
    total, most = np.zeros(len(points)), np.zeros(len(points))
    amplitude: Any = 1.0
    scale: Any = 1.0
    found = []
    for k in range(whole + 2 if part else whole + 1):
        total, most = total + amplitude * perlin(points * scale), most + amplitude
        amplitude, scale = amplitude * roughness, scale * np.reshape(lacunarity, (-1, 1))
        if k >= whole:
            found.append(0.5 * total / most + 0.5)
    return found[0] + part * (found[-1] - found[0])


def perlin(points: Any) -> Any:
    """Return noise (N,) from -1 to 1 at points (N, 3)."""
    cell = np.floor(points)
    inside, corner = points - cell, cell.astype(np.int64)
    fade = inside**3 * (inside * (6 * inside - 15) + 10)
    total = np.zeros(len(points))
    for each in np.ndindex(2, 2, 2):
        weight = np.where(np.array(each) == 1, fade, 1 - fade).prod(axis=1)
        total += weight * _slope(hashed(corner + each), inside - each)
    return _SCALE * total


def _slope(number: Any, offset: Any) -> Any:
    """Return the product of an offset (N, 3) and one of Perlin's gradients, which a number chooses."""
    low = number & 15
    x, y, z = offset.T
    u = np.where(low < 8, x, y)
    v = np.where(low < 4, y, np.where((low == 12) | (low == 14), x, z))
    return np.where(low & 1, -u, u) + np.where(low & 2, -v, v)


def hashed(cells: Any) -> Any:
    """Return a number of 32 bits (N,) for each cell (N, 3) of integers."""
    with np.errstate(over="ignore"):
        start = np.uint32((0xDEADBEEF + (3 << 2) + 13) & 0xFFFFFFFF)
        a, b, c = (start + cells[:, k].astype(np.uint32) for k in range(3))
        for into, other, turn in (("c", "b", 14), ("a", "c", 11), ("b", "a", 25), ("c", "b", 16), ("a", "c", 4),
                                  ("b", "a", 14), ("c", "b", 24)):  # fmt: skip
            value = {"a": a, "b": b, "c": c}
            changed = (value[into] ^ value[other]) - (
                (value[other] << np.uint32(turn)) | (value[other] >> np.uint32(32 - turn))
            )
            a, b, c = (changed if into == name else value[name] for name in "abc")
    return c
