"""Write cloud.vol, a cloud of puffs with frayed edges, in Mitsuba's own format for grids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import zoom

from photonbeams.runtime.device import mitsuba

SIZE = (48, 48, 96)  # z, y, x, over a box of 1.6 × 1.6 × 3.2
PUFFS = 26


def noise(rng: np.random.Generator, octaves: int = 4) -> Any:
    """Return noise of mean 0, each octave half as strong and half as large as the one before."""
    total = np.zeros(SIZE)
    for octave in range(octaves):
        coarse = rng.standard_normal([max(2, each * 2**octave // 24) for each in SIZE])
        scale = [size / each for size, each in zip(SIZE, coarse.shape, strict=True)]
        total += zoom(coarse, scale, order=1, mode="nearest")[: SIZE[0], : SIZE[1], : SIZE[2]] / 2**octave
    return total


def cloud(seed: int = 3) -> Any:
    """Return the density, from 0 to 1, and 0 at the border of the box."""
    rng = np.random.default_rng(seed)
    half = np.array([0.8, 0.8, 1.6])
    axes = [each * ((np.arange(n) + 0.5) / n * 2 - 1) for n, each in zip(SIZE, half, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = np.full(SIZE, -1.0)
    for _ in range(PUFFS):
        x = rng.uniform(-1.15, 1.15)
        radius = rng.uniform(0.2, 0.42) * (1 - 0.35 * abs(x))
        center = [rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.25 - 0.2 * abs(x)), x]
        inside = np.maximum(inside, 1 - np.linalg.norm(place - center, axis=-1) / radius)
    edge = np.prod(np.clip((half - np.abs(place)) / 0.1, 0, 1), axis=-1)
    density = np.clip(3 * (inside + 0.16 * noise(rng)), 0, 1) * edge
    return density**2 * (3 - 2 * density)  # begins softly, so that the cells of the grid do not show as steps


def main() -> None:
    """Write the grid beside this script."""
    mi = mitsuba()
    mi.VolumeGrid(cloud()[..., None].astype(np.float32)).write(str(Path(__file__).with_name("cloud.vol")))


if __name__ == "__main__":
    main()
