"""The density of fog that varies, on a grid: it falls with height, and has wisps.

Media on grids are tracked without bias, so the grid's cells are all that a picture could differ by. Between the centres
of cells, linear interpolation of exp(−h / H) is wrong by (cell / H)² / 8 at most, 1e-4 for 32 cells a falloff.
Cells lie at multiples of their size in world space, so that fog in a box that moves does not.
"""

from __future__ import annotations

import logging

import drjit as dr
import numpy as np

from ... import scene
from ...looks.context import LightContext, ShadingContext
from ...looks.patterns import Noise
from ...runtime.device import Array3f, Float

_LOG = logging.getLogger("photonbeams")

_PER_FALLOFF = 32  # cells along a falloff
_PER_WISP = 2  # cells along the smallest wisps
_MOST_ALONG, _MOST_CELLS = 1 << 16, 1 << 23  # cells along heights without noise, and in all


def density_grid(medium: scene.Medium) -> scene.DensityGrid | None:
    """Return the density of a bounded medium on a grid around it; None if it does not vary.

    Raises
    ------
    SceneError
        The medium is more than 10,000 mean free paths deep.
    """
    density, boundary = medium.density, medium.boundary
    if density is None or density.even or boundary is None:
        return None
    low, high = boundary.points.min(axis=0), boundary.points.max(axis=0)
    low, step, counts = _cells(medium, low.astype(np.float64) - density.zero, np.maximum(high - low, 1e-30))
    axes = [first + (np.arange(count) + 0.5) * each for first, each, count in zip(low, step, counts, strict=True)]
    values = np.ones((1, 1, 1))
    if density.falloff is not None:
        heights = np.maximum(axes[density.axis] - density.ground, 0) / density.falloff
        values = np.exp(-heights).reshape(np.where(np.arange(3) == 2 - density.axis, -1, 1))
    if density.noise is not None and density.noise.amount > 0:
        context = LightContext(time=density.seconds or 0.0, zero=density.zero)
        values = values * _wisps(density.noise, context, [*map(np.add, axes, density.zero)])
    to_world = np.diag([*(step * counts), 1.0])
    to_world[:3, 3] = low + density.zero
    scene.media.check_depth(max(medium.extinction) * float(values.max()), to_world, f"medium {medium.name}")
    return scene.DensityGrid(values.astype(np.float32), to_world)


def _cells(
    medium: scene.Medium, low: scene.Array, extent: scene.Array
) -> tuple[scene.Array, scene.Array, scene.Array]:  # fmt: skip
    """Return the first corner, the size, and the number of a grid's cells along x, y and z."""
    density = medium.density
    assert density is not None
    noise = density.noise if density.noise is not None and density.noise.amount > 0 else None
    step = np.full(3, np.inf)
    if noise is not None:
        wanted = noise.scale / 2 ** (noise.octaves - 1) / _PER_WISP
        step[:] = wanted
    if density.falloff is not None:
        least = extent[density.axis] / _MOST_ALONG
        step[density.axis] = max(min(step[density.axis], density.falloff / _PER_FALLOFF), least)
    while np.prod(np.ceil(extent / step) + 2.0) > _MOST_CELLS:
        step *= 1.1
    if noise is not None and step[(density.axis + 1) % 3] > 2 * wanted:
        found = step[(density.axis + 1) % 3] * _PER_WISP
        _LOG.warning(
            "%s: its noise has wisps of down to %.3g units in a space of %.3g: those below %.3g are blurred; expected "
            "a smaller space, fewer octaves, or a larger scale", medium.name or "the fog", wanted * _PER_WISP,
            extent.max(), found,
        )  # fmt: skip
    # The first centre is at or below the first corner of the fog, and the last at or above its last one.
    even = ~np.isfinite(step)
    step = np.where(even, extent, step)
    first = np.where(even, 0, np.floor(low / step - 0.5))
    last = np.where(even, 1, np.ceil((low + extent) / step + 0.5))
    return np.where(even, low, first * step), step, (last - first).astype(np.int64)


def _wisps(noise: scene.FogNoise, context: LightContext, axes: list[scene.Array]) -> scene.Array:
    """Return the factor of wisps at the centres of cells, (Z, Y, X), at places along `axes`."""
    z, y, x = (each.ravel() for each in np.meshgrid(*axes[::-1], indexing="ij"))
    points = Array3f(*(Float(each.astype(np.float32)) for each in (x, y, z)))
    factor = Noise(noise.amount, noise.scale, noise.octaves, noise.contrast, noise.drift, noise.evolution)
    found = factor.evaluate(ShadingContext(place=lambda: points, context=context))
    dr.eval(found)
    return np.asarray(found).reshape([len(each) for each in axes[::-1]])
