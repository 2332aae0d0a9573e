"""Narrow beams straight from a lamp where a surface blocks their rim.

A beam is a single ray with a width. Where a surface blocks its rim but not its axis, as in corners and at edges, a wide
beam would shine through the surface. It keeps its flux and becomes narrower.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.hashing import hash32
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.stage_world import StageWorld
from ..world.warp import facing, perpendicular
from .radii import width

if TYPE_CHECKING:
    from .records import LightPaths

_RIM = 6  # rays that test a beam's rim for surfaces
_SLACK = 0.25  # radii by which the rim may stop before the plane where the axis ended: surfaces are curved


def narrow(world: StageWorld, paths: LightPaths, overlap: float, scale: Any, halvings: Any, most: int) -> None:
    """Find where paths that leave their lamps are stopped, and the factors on their radii.

    Parameters
    ----------
    overlap, scale
        Width of a beam in spacings of its neighbours, and the pass's factor on all radii.
    halvings, most
        How often each beam is halved at most, and the greatest of these: a beam that is too narrow is a bright streak,
        one that is too wide a soft edge.
    """
    alive = paths.initial > 0
    hit = world.solid(paths.origin, paths.direction, alive, hash32(paths.index, paths.key), paths.link)
    met = hit.is_valid()
    paths.total = dr.select(met, hit.t, paths.reach)
    against = dr.select(met, facing(Array3f(hit.n), paths.direction), -paths.direction)
    begin = dr.select(paths.portal < paths.total, paths.portal, 0)
    radius = width(paths.differentials, paths.direction, paths.total, paths.count, dr.opaque(Float, overlap))(
        paths.total
    )
    radius *= scale
    dr.eval(paths.total, against, begin, radius)
    for number in range(most):
        tried = alive & (halvings > dr.opaque(UInt32, number))
        blocked = _rim_blocked(world, paths, begin, against, radius * paths.narrow, tried)
        paths.narrow = dr.select(blocked, 0.5 * paths.narrow, paths.narrow)
        dr.eval(paths.narrow)


def _rim_blocked(
    world: StageWorld, paths: LightPaths, begin: Float, against: Array3f, at_end: Float, active: Bool
) -> Bool:
    """Return whether rays to the rim's end meet a surface before the one that stopped the axis.

    They begin on the axis, not on the rim: beside a portal's edge the rim begins in the wall, which is not a leak.
    """
    across, up = perpendicular(paths.direction)
    start = paths.origin + begin * paths.direction
    end = paths.origin + paths.total * paths.direction
    seed = hash32(paths.index, paths.key)
    blocked = dr.full(Bool, False, dr.width(paths.total))
    for angle in np.arange(_RIM) * (2 * np.pi / _RIM):
        side = float(np.cos(angle)) * across + float(np.sin(angle)) * up
        ray = end + at_end * side - start
        length = dr.norm(ray)
        ray *= dr.rcp(length)
        facing = dr.dot(ray, against)
        plane = dr.dot(end - start, against) / dr.minimum(facing, -1e-3)
        reach = dr.minimum(plane, length + at_end) - _SLACK * at_end
        blocked |= world.blocked(start, ray, reach, active & (reach > 0), seed, paths.link)
    return blocked
