"""Light paths of a lamp as they leave it: measure-preserving maps from the 4D unit cube, with and without a portal.

A sample has two 2D factors: u, on the light's extent, and v, over directions or over the portal. Each path carries how
a cell of either factor widens it, from which `radii` computes the radii of beams. The flux of a path is radiance · area
· solid angle / samples, with the cosines of the geometry (radiometry; Jarosz et al. 2008 for photons).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import opaque
from ..numerics.sampling import pairs, sobol_points
from ..numerics.structs import Struct
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..scene import Array
from ..world.bounds import Bounds
from ..world.emitters.cylinders import CylinderLamp
from ..world.emitters.gobos import ProjectedLight, bare, spread
from ..world.emitters.lights import FlatLamp, SphereLamp
from ..world.emitters.mesh_lamps import MeshLamp
from ..world.emitters.portals import Portal
from ..world.emitters.stretched import StretchedLamp
from ..world.shadow_rays import gap_before
from ..world.stage_world import StageWorld
from ..world.warp import disk, perpendicular, power_cone, sphere
from .differentials import RayDifferentials
from .emission import EmissionSample, Emitter, Stratum

_PROBE = 4096  # paths that measure how much of a lamp's light passes its images

# The fraction of a lamp's beams that do not go through its portal, if such beams are seen.
LIGHT_SIDE = 0.25

# The fraction of these that pass close by the portal, if light is scattered more than once.
SURROUND = 0.25

# How often a beam is halved, at most, where a surface blocks its rim: through a portal or without one, and past one.
HALVINGS, HALVINGS_ASIDE = 1, 5

Aimed = tuple[Array3f, Float]  # directions, and their density per solid angle

_WIDE = 2 * np.pi / 3  # a cone wider than this is sampled as part of the whole sphere, which distorts less
_GRAZING = 0.02  # least cosine for a beam's width: along a surface, a beam would be infinitely wide


class LampRays(Struct):
    """Light paths as they leave the light.

    `flux` is the flux of each, `portal` the distance at which it passes the portal (infinite: none), and `valid` says
    which exist at all. At distance s from the light, a shift by x over the light's extent and by y over the other
    factor moves the path by x (x0 + x1 s) + y (y0 + y1 s). `extent_x` and `extent_y` are the square roots of the
    factors' measures, which are 1 / density.
    """

    origin: Array3f
    direction: Array3f
    flux: Array3f
    portal: Float
    valid: Bool
    extent_x: Float
    extent_y: Float
    x0: Float
    x1: Float
    y0: Float
    y1: Float

    def differentials(self) -> RayDifferentials:
        """Return the derivatives of rays by the four numbers of the emission sample.

        The maps preserve measure and are nearly isotropic: the two numbers of a pair move a path equally far, at right
        angles to each other.
        """
        columns = []
        for extent, shift, turn in ((self.extent_x, self.x0, self.x1), (self.extent_y, self.y0, self.y1)):
            for side in perpendicular(self.direction):
                columns.append((side * (extent * shift), side * (extent * turn)))
        return RayDifferentials.of(columns)


def emit(light: scene.Light, source: Any, bounds: Bounds, u: Array2f, v: Array2f, count: int) -> LampRays:
    """Return `count` light paths in all directions of a light: `u` places them on it, `v` chooses directions."""
    lamp = bare(source)
    if isinstance(lamp, SphereLamp):
        result = _emit_sphere(lamp, u, _directions(light, source, v))
    elif isinstance(lamp, FlatLamp):
        result = _emit_flat(lamp, u, _directions(light, source, v))
    elif isinstance(lamp, CylinderLamp | StretchedLamp):
        result = _emit_body(lamp, u, _directions(light, source, v))
    elif isinstance(lamp, MeshLamp):
        result = _emit_mesh(lamp, u, v)
    else:
        result = _emit_from_infinity(lamp, bounds, u, v)
    if isinstance(source, ProjectedLight):
        result.flux = result.flux * source.tint(result.origin, result.direction)
    result.flux *= opaque(1 / count)
    result.portal = dr.full(Float, dr.inf, dr.width(u))
    result.valid = dr.full(Bool, True, dr.width(u))
    return result


def emit_through(source: Any, portal: Portal, bounds: Bounds, u: Array2f, v: Array2f, count: int) -> LampRays:
    """Return light paths through a portal: `v` places them on it, `u` chooses the point or direction of the light.

    The flux is (radiance / pdf) · |cos θ| · area / count, where θ is the angle at the portal. `count` is the number of
    candidates; those that miss the portal are not valid.
    """
    result = LampRays()
    point, normal, result.valid = portal.sample(v)
    light_sample = (
        source.without_portal_gobo(point, u) if isinstance(source, ProjectedLight) else source.illuminate(point, u)
    )
    cosine = dr.abs(dr.dot(normal, light_sample.direction))
    area = opaque(portal.area)
    infinite = bare(source).infinite
    result.direction = -light_sample.direction
    result.portal = bounds.behind(point, result.direction) if infinite else light_sample.distance
    result.origin = point - result.portal * result.direction
    result.flux = light_sample.weight * (cosine * area * opaque(1 / count))
    if isinstance(source, ProjectedLight):
        result.flux = result.flux * source.portal_color(point)
    result.extent_x = dr.select(light_sample.pdf > 0, dr.rsqrt(dr.maximum(light_sample.pdf, 1e-30)), 0)
    result.extent_y = dr.sqrt(area * dr.maximum(cosine, _GRAZING))
    # The shift from a light at distance d is x d |1 - s/d| + y s/d, with x an angle at the portal; from infinity, it is
    # x |s - d| + y.
    result.x0, result.x1 = result.portal, dr.full(Float, -1, dr.width(u))
    result.y0 = dr.full(Float, 1 if infinite else 0, dr.width(u))
    result.y1 = dr.full(Float, 0, dr.width(u)) if infinite else dr.rcp(result.portal)
    return result


def _emit_sphere(source: SphereLamp, u: Array2f, aimed: Aimed) -> LampRays:
    result = LampRays()
    result.direction, density = aimed
    result.origin = source.position(u, result.direction)
    area = dr.pi * source.radius * source.radius
    result.flux = source.emitted(result.direction) * (dr.select(source.radius > 0, area, 1) / density)
    result.extent_x = dr.sqrt(area) + 0 * u.x
    _spread(result, density)
    return result


def _emit_flat(source: FlatLamp, u: Array2f, aimed: Aimed) -> LampRays:
    result = LampRays()
    result.direction, density = aimed
    cosine = dr.dot(result.direction, source.axis)
    result.origin = source.position(u)
    result.flux = source.emitted(result.direction) * (cosine * source.area / dr.maximum(density, 1e-30))
    result.extent_x = dr.sqrt(source.area * dr.maximum(cosine, _GRAZING))
    _spread(result, dr.maximum(density, _GRAZING / dr.pi))
    return result


def _emit_body(source: CylinderLamp | StretchedLamp, u: Array2f, aimed: Aimed) -> LampRays:
    """Return paths in all directions; those along one direction begin uniformly over the silhouette."""
    result = LampRays()
    result.direction, density = aimed
    result.origin = source.position(u, result.direction)
    area = source.silhouette(result.direction)
    result.flux = source.emitted(result.direction) * (area / density)
    result.extent_x = dr.sqrt(area)
    _spread(result, density)
    return result


def _emit_mesh(source: MeshLamp, u: Array2f, v: Array2f) -> LampRays:
    """Return paths whose directions, at each point of a mesh, have a density proportional to the cosine."""
    result = LampRays()
    result.origin, normal, radiance = source.position(u)
    result.direction, density = power_cone(v, normal, opaque(1.0), opaque(1.0))
    cosine = dr.dot(result.direction, normal)
    result.flux = radiance * source.emitted(result.direction) * (source.area * dr.pi)
    result.extent_x = dr.sqrt(source.area * dr.maximum(cosine, _GRAZING))
    _spread(result, dr.maximum(density, _GRAZING / dr.pi))
    return result


def _emit_from_infinity(source: Any, bounds: Bounds, u: Array2f, v: Array2f) -> LampRays:
    """Return paths that begin on a disc that touches the bounding sphere and covers it."""
    result = LampRays()
    light_sample = source.illuminate(dr.zeros(Array3f, dr.width(u)), v)
    result.direction = -light_sample.direction
    s, t = perpendicular(result.direction)
    offset = disk(u)
    result.origin = bounds.center + bounds.radius * (s * offset.x + t * offset.y - result.direction)
    area = dr.pi * bounds.radius * bounds.radius
    result.flux = light_sample.weight * area
    result.extent_x = dr.sqrt(area) + 0 * u.x
    _spread(result, dr.select(light_sample.pdf > 0, light_sample.pdf, dr.inf))
    return result


def _spread(result: LampRays, density: Float) -> None:
    """Set how paths widen: positions stay apart as they are, and directions of this density fan out."""
    width = dr.width(result.origin)
    result.extent_y = dr.rsqrt(density)
    result.x0, result.x1 = dr.full(Float, 1, width), dr.full(Float, 0, width)
    result.y0, result.y1 = dr.full(Float, 0, width), dr.full(Float, 1, width)


def _directions(light: scene.Light, source: Any, v: Array2f) -> Aimed:
    """Return directions within the light's cone, and their density per solid angle.

    The density follows what the light radiates: its profile, the cos θ of a flat light, and the focus if that darkens
    other directions.
    """
    if isinstance(source, ProjectedLight) and source.sampler is not None:
        return source.sampler.sample(v)
    axis, flat = bare(source).axis, isinstance(bare(source), FlatLamp)
    shaping = light.shaping or scene.Shaping(cone_angle=180.0)
    # A focus darkens directions beside the axis, but not those ahead and behind: it is followed on one side alone.
    focused = shaping.focus > 0 and max(shaping.focus_tint) == 0 and (flat or shaping.cone_angle <= 90)
    widest = np.pi / 2 if flat or focused else np.pi
    cutoff = min(np.radians(shaping.cone_angle), widest if flat else min(widest, spread(light)))
    power = (1.0 if flat else 0.0) + (shaping.focus if focused else 0.0)
    if cutoff > _WIDE:
        return sphere(v), dr.full(Float, 1 / (4 * np.pi), dr.width(v))
    if power == 0:
        q = 2 * np.sin(cutoff / 2) ** 2
    else:
        q = -np.expm1((power + 1) * np.log(np.cos(cutoff))) if cutoff < np.pi / 2 else 1.0
    return power_cone(v, axis, opaque(power), opaque(q))


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
        self._escape = 1.0 if bare(self.lamp).infinite else scene.ESCAPE

    def sample(self, u: Array2f, v: Array2f) -> EmissionSample:
        """Return light paths for emission samples: `u` places them on the lamp, `v` chooses their directions."""
        return self.begun(emit(self.light, self.lamp, self.bounds, u, v, 1))

    def begun(self, paths: LampRays) -> EmissionSample:
        """Return paths that leave the lamp as emission samples."""
        flux = dr.select(paths.valid, paths.flux, 0)
        origin = self._off_surfaces(paths.origin, dr.max(flux) > 0)
        reach = self.bounds.exit(origin, paths.direction, self._escape)
        medium = self.world.medium_at(origin, paths.direction, dr.max(flux) > 0)
        return EmissionSample(
            origin, paths.direction, flux, paths.differentials(), reach, paths.portal, medium, paths.valid
        )

    def _off_surfaces(self, origin: Array3f, active: Bool) -> Array3f:
        """Return origins of paths; those on a flat lamp in the plane of a surface begin before that surface."""
        lamp = bare(self.lamp)
        if not isinstance(lamp, FlatLamp):
            return origin
        gap, axis = gap_before(origin, self.world.size), lamp.axis + 0 * origin.x
        number = dr.arange(UInt32, dr.width(origin))
        link = dr.opaque(UInt32, self.link) + 0 * number
        flush = self.world.blocked(origin - gap * axis, axis, 2 * gap, active, number, link)
        return dr.select(flush, origin + gap * axis, origin)


def radius_from_infinity(light: scene.Light, lamp: Any, count: int, overlap: float) -> float:
    """Return the radius of a lamp's beams in the middle of the world, in its radii, if they come from infinity; else 0.

    With the solid angle Ω of the lamp, N paths that begin on a disc of radius R have the radius r of `transport.radii`,

        r² = (overlap / 2)² · R² · max(π / N, 5/2 · √(π Ω / N)).
    """
    if not bare(lamp).infinite:
        return 0.0
    wide = 2 * np.sin(np.radians(light.angle) / 4) ** 2 if isinstance(light, scene.DistantLight) else 2.0
    return 0.5 * overlap * float(np.sqrt(max(np.pi / count, 2.5 * np.sqrt(2 * np.pi**2 * wide / count))))


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

    def begun(self, paths: LampRays) -> EmissionSample:
        """Return paths that leave the emitter as emission samples."""


class PortalEmitter:
    """The part of an emitter's light that passes its portal (`through`), or the part that does not.

    `without` is an opening within the portal whose light does not count.
    """

    def __init__(self, emitter: Windowed, portal: Portal, through: bool, without: Portal | None = None) -> None:
        self.emitter, self.portal, self.through, self.without = emitter, portal, through, without
        self.name, self.source, self.link, self.lamp = emitter.name, emitter.source, emitter.link, emitter.lamp
        # Few through a portal, where a narrow beam would be seen as a streak; many beside it, where light would leak.
        self.halvings = HALVINGS if through else HALVINGS_ASIDE

    def sample(self, u: Array2f, v: Array2f) -> EmissionSample:
        """Return light paths: `u` places them on the emitter, `v` chooses a direction or a point of the portal."""
        emitter = self.emitter
        if self.through:
            paths = emit_through(emitter.lamp, self.portal, emitter.bounds, u, v, 1)
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
        if not isinstance(emitter, PortalEmitter) or emitter.through or isinstance(emitter.lamp, ProjectedLight):
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
    if not isinstance(lamp, ProjectedLight):
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
    if stratum.guide is None or not isinstance(stratum.emitter.lamp, ProjectedLight):
        return stratum.count
    points = sobol_points(_PROBE, 0, (_PROBE,))
    before, behind = (_lit(stratum.emitter, each) for each in (points, stratum.guide(points)[0]))
    return max(round(stratum.count * min(before / max(behind, 1e-30), 1)), 1)
