"""Light paths of a stage's lamps, and of an emitter's light through its portal and past it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.sampling import pairs, sobol_points
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..scene import Array
from ..world.bounds import Bounds
from ..world.emitters.lamp import Lamp
from ..world.emitters.portals import Portal, emit_through
from ..world.emitters.rays import EmittedRays
from ..world.shadow_rays import gap_before
from ..world.stage_world import StageWorld
from .emission import Emitter, Stratum

_PROBE = 4096  # paths that measure how much of a lamp's light passes its images

# The fraction of a lamp's beams that do not go through its portal, if such beams are seen.
LIGHT_SIDE = 0.25

# The fraction of these that pass close by the portal, if light is scattered more than once.
SURROUND = 0.25

# How often a beam is halved, at most, where a surface blocks its rim: through a portal or without one, and past one.
HALVINGS, HALVINGS_ASIDE = 1, 5


class LampEmitter:
    """The light of a lamp.

    Parameters
    ----------
    world, number
        The stage, and the lamp's number in it.
    margin
        For light from infinity, the distance from media up to which its paths begin around these, in radii of the
        world: that of the beams, or those at the boundary of a medium would lack neighbours.
    """

    halvings = HALVINGS

    def __init__(self, world: StageWorld, number: int, margin: float = 0.0) -> None:
        self.world, self.margin = world, margin
        self.light, self.lamp = world.description.lights[number], world.lights[number]
        self.bounds = world.bounds.around(list(world.boxes.values()), margin) if margin else world.bounds
        self.name, self.source, self.link = self.light.name, number, world.link_of(self.light)
        self._escape = 1.0 if self.lamp.infinite else scene.ESCAPE

    def sample(self, u: Array2f, v: Array2f) -> EmittedRays:
        """Return light paths for emission samples: `u` places them on the lamp, `v` chooses their directions."""
        return self.begun(self.lamp.emit(u, v, self.bounds))

    def begun(self, rays: EmittedRays) -> EmittedRays:
        """Return rays that leave the lamp as they begin in the world."""
        rays.flux = dr.select(rays.valid, rays.flux, 0)
        active = dr.max(rays.flux) > 0
        rays.origin = self._off_surfaces(rays.origin, active)
        rays.reach = self.bounds.exit(rays.origin, rays.direction, self._escape)
        rays.medium = self.world.medium_at(rays.origin, rays.direction, active)
        return rays

    def _off_surfaces(self, origin: Array3f, active: Bool) -> Array3f:
        """Return origins of paths; those on a flat lamp in the plane of a surface begin before that surface."""
        if not self.lamp.flat:
            return origin
        gap, axis = gap_before(origin, self.world.size), self.lamp.bare.axis + 0 * origin.x
        number = dr.arange(UInt32, dr.width(origin))
        link = dr.opaque(UInt32, self.link) + 0 * number
        flush = self.world.blocked(origin - gap * axis, axis, 2 * gap, active, number, link)
        return dr.select(flush, origin + gap * axis, origin)


def radius_from_infinity(lamp: Lamp, count: int, overlap: float) -> float:
    """Return the radius of a lamp's beams in the middle of the world, in its radii, if they come from infinity; else 0.

    With the solid angle Ω of the lamp, N paths that begin on a disc of radius R have the radius r of `transport.radii`,

        r² = (overlap / 2)² · R² · max(π / N, 5/2 · √(π Ω / N)).
    """
    if not lamp.infinite:
        return 0.0
    return 0.5 * overlap * float(np.sqrt(max(np.pi / count, 2.5 * np.sqrt(2 * np.pi**2 * lamp.covered / count))))


class Windowed(Emitter, Protocol):
    """An emitter that may have a portal.

    Attributes
    ----------
    lamp
        The lamp that says what reaches a point: see `world.lights`.
    bounds
        The sphere around the world.
    """

    lamp: Any
    bounds: Bounds

    def begun(self, rays: EmittedRays) -> EmittedRays:
        """Return rays that leave the emitter as they begin in the world."""


class PortalEmitter:
    """The part of an emitter's light that passes its portal (`through`), or the part that does not.

    `without` is an opening within the portal whose light does not count.
    """

    def __init__(self, emitter: Windowed, portal: Portal, through: bool, without: Portal | None = None) -> None:
        self.emitter, self.portal, self.through, self.without = emitter, portal, through, without
        self.name, self.source, self.link, self.lamp = emitter.name, emitter.source, emitter.link, emitter.lamp
        # Few through a portal, where a narrow beam would be seen as a streak; many beside it, where light would leak.
        self.halvings = HALVINGS if through else HALVINGS_ASIDE

    def sample(self, u: Array2f, v: Array2f) -> EmittedRays:
        """Return light paths: `u` places them on the emitter, `v` chooses a direction or a point of the portal."""
        emitter = self.emitter
        if self.through:
            paths = emit_through(emitter.lamp, self.portal, emitter.bounds, u, v)
            if self.without is not None:
                paths.valid &= ~self.without.crosses(paths.origin, paths.direction)
                paths.portal = dr.full(Float, dr.inf, dr.width(paths.portal))
            return emitter.begun(paths)
        result = emitter.sample(u, v)
        result.valid &= ~self.portal.crosses(result.origin, result.direction)
        result.flux = dr.select(result.valid, result.flux, 0)
        return result


def with_surrounds(strata: Sequence[Stratum]) -> list[Stratum]:
    """Split each stratum of paths past a portal into two: paths close by the portal, and all others.

    Only a little of the light hits the edges of a hole. But when it is scattered into the room, it matters as much as
    the light that passes the hole, so it needs paths of its own.
    """
    result = []
    for stratum in strata:
        emitter, count = stratum.emitter, round(SURROUND * stratum.count)
        if not isinstance(emitter, PortalEmitter) or emitter.through or emitter.lamp.images:
            result.append(stratum)
            continue
        surround = emitter.portal.surround
        if surround is None or count < 1:
            result.append(stratum)
            continue
        near = PortalEmitter(emitter.emitter, surround, True, without=emitter.portal)
        far = PortalEmitter(emitter.emitter, surround, False)
        result.append(Stratum(near, count, (*stratum.sequence, 4), stratum.fixed))
        result.append(Stratum(far, stratum.count - count, stratum.sequence, stratum.fixed, stratum.guide))
    return result


def lit_fraction(emitter: LampEmitter | PortalEmitter) -> float:
    """Return which fraction of the emitter's paths passes its images, estimated from a few; 1 without images."""
    lamp, through = emitter.lamp, isinstance(emitter, PortalEmitter) and emitter.through
    if not lamp.images:
        return 1.0
    if through not in lamp.lit:
        lamp.lit[through] = _lit(emitter, sobol_points(_PROBE, 0, (_PROBE,)))
    return lamp.lit[through]


def _lit(emitter: Emitter, points: Array) -> float:
    """Return the fraction of the paths with these emission samples that carry light, among those that exist."""
    probe = emitter.sample(*pairs(points))
    there = np.broadcast_to(probe.valid.numpy(), len(points))
    lit = there & (probe.flux.numpy().max(axis=0) > 0)
    return float(lit.sum() / max(there.sum(), 1))


def guided_count(stratum: Stratum) -> int:
    """Return the number of paths of a stratum of which as many carry light as if it were not guided.

    A guide sends paths to where images let light pass; those that others need to find these places would be too many.
    """
    if stratum.guide is None or not stratum.emitter.lamp.images:
        return stratum.count
    points = sobol_points(_PROBE, 0, (_PROBE,))
    before, behind = (_lit(stratum.emitter, each) for each in (points, stratum.guide(points)[0]))
    return max(round(stratum.count * min(before / max(behind, 1e-30), 1)), 1)
