"""Radii of beams from the spacing of their neighbours, by balanced stratification.

N samples of a 4D Sobol sequence fill elementary intervals of any aspect: N = N_x · N_y cells over the two 2D factors of
a light path. At the distance where footprints matter, cells that are as wide by the one factor as by the other give the
least blur, so N_x and N_y are chosen to balance them. Neighbours then just overlap: radius = overlap / 2 · spacing.
(Photon differentials, Schjøth et al. 2007, and Progressive Photon Beams, Jarosz et al. 2011, derive widths from
neighbours too.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..device import Float
from .emission import Emission
from .lights import opaque

FLOOR = 1e-4  # least radius in units of the bounding radius: a point light's apex must not be singular


def radius_along(
    emission: Emission, count: int, reference: float, overlap: float, floor: Any
) -> Callable[[Float], Float]:
    """Return the radius of each path as a function of the distance from its light.

    With a, b the extents of the factors and α, β how much they widen the path at distance `reference`, N_x and N_y =
    N / N_x balance α a / √N_x = β b / √N_y, both at least 1.
    """
    samples = opaque(count)
    a, b = emission.extent_x, emission.extent_y
    distance = opaque(reference)
    wide_x = dr.abs(emission.x0 + emission.x1 * distance) * a
    wide_y = dr.abs(emission.y0 + emission.y1 * distance) * b
    cells = dr.clip(dr.sqrt(samples) * wide_x / dr.maximum(wide_y, 1e-20), 1, samples)
    cell_x, cell_y = a * dr.rsqrt(cells), b * dr.sqrt(cells / samples)
    half = opaque(0.5 * overlap)

    def radius(s: Float) -> Float:
        x, y = cell_x * (emission.x0 + emission.x1 * s), cell_y * (emission.y0 + emission.y1 * s)
        return dr.maximum(half * dr.sqrt(x * x + y * y), floor)

    return radius
