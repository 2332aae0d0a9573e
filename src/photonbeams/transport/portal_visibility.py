"""Portal visibility: whether the camera sees a lamp's light that does not pass the lamp's portal.

Light paths through a portal only light what lies behind it. If the camera sees fog that the light reaches without
passing the portal, the light's other paths are needed, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ..numerics.arrays import indices, opaque
from ..numerics.hashing import hash32
from ..numerics.sampling import pixel_sample, sobol_block
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..world.emitters.emitter import Emitter
from ..world.emitters.portals import Portal
from ..world.shadow_rays import to_lamp

if TYPE_CHECKING:
    from ..world.emitters.lamp import Lamp
    from ..world.world import World

_POINTS = 12  # along each ray
_AIMED = 1024  # rays to points of the portal
_NUDGE = 1e-4  # fraction of the world's radius by which points stay away from the surface at a ray's end


def lights_seen(world: World, origin: Array3f, direction: Array3f) -> frozenset[str]:
    """Return the names of the lights that light visible fog by paths that miss their portal.

    Parameters
    ----------
    world
        The world.
    origin, direction
        A coarse grid of camera rays (128 × 72 suffices). Rays from the same origins to points of the portal are added,
        so that no hole is too small to be seen through.

    Notes
    -----
    On each ray, up to its first surface, points are paired with points of the light. The light is seen if any line
    between a pair is free, does not pass the portal, and carries light.
    """
    return frozenset(
        each.name
        for each in world.emitters
        if each.portal is not None and _sees(world, each, each.portal, origin, direction)
    )


def _sees(world: World, emitter: Emitter, portal: Portal, origin: Array3f, direction: Array3f) -> bool:
    stopping = world.stopping(emitter.links)
    rays = ((origin, direction), _aimed(portal, origin))
    return any(_any_lit(world, stopping, emitter.lamp, portal, *each) for each in rays)


def _aimed(portal: Portal, origin: Array3f) -> tuple[Array3f, Array3f]:
    """Return rays from the given origins to points of the portal."""
    u, _ = sobol_block(_AIMED, 0, (0,))
    point, _, on_portal = portal.sample(u)
    index = indices(on_portal)
    if not len(index):
        return dr.zeros(Array3f, 1), Array3f(0, 0, 1) + dr.zeros(Float, 1)
    point = dr.gather(Array3f, point, index)
    number = dr.arange(UInt32, len(index))
    eye = dr.gather(Array3f, origin + dr.zeros(Float, dr.width(origin)), number % dr.width(origin))
    return eye, dr.normalize(point - eye)


def _any_lit(world: World, stopping: World, source: Lamp, portal: Portal, origin: Array3f, direction: Array3f) -> bool:
    """Return whether any point on the rays is lit past the portal; `stopping` has the surfaces that block the light."""
    width = max(dr.width(origin), dr.width(direction))
    number = dr.arange(UInt32, width)
    always = dr.full(Bool, True, width)
    hit = world.solids.first(origin, direction, always, number)
    near, far = Float(0), dr.select(hit.is_valid(), hit.t, world.bounds.exit(origin, direction))
    far = far - opaque(_NUDGE * world.radius)
    lit = dr.full(Bool, False, width)
    for step in np.linspace(0.5, _POINTS - 0.5, _POINTS) / _POINTS:
        seed = hash32(number, dr.opaque(UInt32, int(step * 1e6)))
        point = origin + (near + opaque(step) * (far - near)) * direction
        inside = (far > near) & (world.medium_at(point, direction, far > near) > 0)
        lit |= inside & _lit(stopping, source, portal, point, pixel_sample(number, seed), seed)
        dr.eval(lit)
    return bool(dr.any(lit))


def _lit(world: World, source: Lamp, portal: Portal, point: Array3f, u: Array2f, seed: UInt32) -> Bool:
    """Return which points the light reaches along a free line that does not pass the portal."""
    sample = source.illuminate(point, u)
    carries = dr.max(sample.weight) > 0
    distance = dr.minimum(to_lamp(point, sample.direction, sample.distance).length, dr.largest(Float))
    free = ~world.solids.blocked(point, sample.direction, distance, carries, seed)
    return carries & free & ~portal.crosses(point, sample.direction, distance)
