"""Radii of beams from the spacing of their neighbours, by balanced stratification.

N samples of a 4D Sobol sequence fill elementary intervals of any aspect: N = N_x · N_y cells over the two 2D factors of
a light path. At the distance where footprints matter, cells that are as wide by the one factor as by the other give the
least blur, so N_x and N_y are chosen to balance them. Neighbours then just overlap: radius = overlap / 2 · spacing.
(Photon differentials, Schjøth et al. 2007, and Progressive Photon Beams, Jarosz et al. 2011, derive widths from
neighbours too.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..numerics.hashing import hash32
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.warp import perpendicular
from .lamps import Emission

if TYPE_CHECKING:
    from ..world.stage_world import StageWorld

FLOOR = 1e-4  # least radius in units of a path's usual length: a point light's apex must not be singular

_RIM = 6  # rays along a beam's rim that look for surfaces in its way
_SLACK = 0.25  # radii that the rim may be stopped short of the plane where the axis ended: surfaces are curved


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


def unblocked(
    world: StageWorld,
    emission: Emission,
    radius: Callable[[Float], Float],
    begin: Float,
    total: Float,
    against: Array3f,
    halvings: int,
) -> Float:
    """Return the factor on each beam's radius that keeps it out of surfaces: 1, or halved while its rim is blocked.

    A beam is one ray with a width. Where a surface stands in the way of the rim but not of the axis, in corners and at
    edges, a wide beam would shine through it. Its light stays; the beam becomes narrower.

    Parameters
    ----------
    begin, total, against
        The beam's ends, as distances from the light, and the normal of the surface that stopped it.
    halvings
        How often at most: a narrow beam is a bright streak, where a wide one is a soft edge.
    """
    scale = dr.full(Float, 1.0, dr.width(total))
    seed = hash32(dr.arange(UInt32, dr.width(total)))
    for _ in range(halvings):
        scale = dr.select(_rim_blocked(world, emission, radius, scale, begin, total, against, seed), 0.5 * scale, scale)
        dr.eval(scale)
    return scale


def _rim_blocked(
    world: StageWorld,
    emission: Emission,
    radius: Callable[[Float], Float],
    scale: Float,
    begin: Float,
    total: Float,
    against: Array3f,
    seed: UInt32,
) -> Bool:
    """Return whether a ray from the axis' begin to the rim's end meets a surface before the one that stopped the axis.

    From the axis, not from the rim: beside a portal's edge the rim begins in the wall, and that is no leak.
    """
    across, up = perpendicular(emission.direction)
    start = emission.origin + begin * emission.direction
    end = emission.origin + total * emission.direction
    at_end = radius(total) * scale
    blocked = dr.full(Bool, False, dr.width(total))
    for angle in np.arange(_RIM) * (2 * np.pi / _RIM):
        side = float(np.cos(angle)) * across + float(np.sin(angle)) * up
        ray = end + at_end * side - start
        length = dr.norm(ray)
        ray *= dr.rcp(length)
        facing = dr.dot(ray, against)
        plane = dr.dot(end - start, against) / dr.minimum(facing, -1e-3)
        reach = dr.minimum(plane, length + at_end) - _SLACK * at_end
        blocked |= world.blocked(start, ray, reach, reach > 0, seed)
    return blocked
