"""What cameras see: points all over their pictures, on surfaces and in fog, at which pilots ask what lights them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ...numerics.arrays import compressed, to_numpy
from ...numerics.hashing import hash32
from ...numerics.sampling import pixel_sample, sobol_block
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...scene import Array
from ...world.emitters.portals import Portal
from ...world.shadow_rays import leaving, to_lamp
from ...world.warp import facing, outward
from ...world.world import World
from .importance import Views

if TYPE_CHECKING:
    from ...estimators.projection import Projection

mi = mitsuba()

# Numbers of points, for all cameras together: in fog, and on surfaces.
_IN_FOG, _ON_SURFACES = 1 << 16, 1 << 12
# Number of rays to points of a portal, and of points on each.
_AIMED, _ALONG = 1 << 10, 12
# Most boundaries of fog along a ray that are told apart.
_BOUNDARIES = 4
# How far points are above surfaces, as a fraction of their distance from the camera.
_ABOVE = 1e-4
# In a room, surfaces in the picture see more than this fraction of other surfaces.
_ENCLOSED = 0.7


class FogPoints(Struct):
    """Points in fog that cameras see; `light` is what a unit of irradiance there would send to the camera."""

    position: Array3f
    medium: UInt32
    light: Float
    part: UInt32
    number: UInt32


class SurfacePoints(Struct):
    """Points close above surfaces that cameras see, with the distance from the camera and the site: see `Linking`."""

    position: Array3f
    normal: Array3f
    distance: Float
    site: UInt32
    number: UInt32

    @property
    def places(self) -> Array:
        """The points, (N, 3)."""
        return to_numpy(self.position).T.astype(np.float64)


@dataclass(frozen=True)
class _EyeRays:
    """Rays from cameras, with the parts of the picture that they pass and numbers from which samples follow."""

    origin: Array3f
    direction: Array3f
    part: UInt32
    number: UInt32


def surfaces_seen(world: World, views: Sequence[Projection]) -> SurfacePoints | None:
    """Return points on the surfaces that cameras see, through panes of glass, too; None if they see none."""
    number = dr.arange(UInt32, _ON_SURFACES)
    place, _ = sobol_block(_ON_SURFACES, 0, (_ON_SURFACES,))
    origin, direction = Views(views)(number % dr.opaque(UInt32, len(views))).ray(place)
    hit = world.ahead(origin, direction, number)
    result = SurfacePoints()
    result.distance = dr.norm(Array3f(hit.p) - origin)
    result.normal = facing(outward(hit), direction)
    result.position = Array3f(hit.p) + _ABOVE * result.distance * result.normal
    result.site = world.linking.of_surfaces(hit) + dr.zeros(UInt32, _ON_SURFACES)
    result.number = number
    met = hit.is_valid()
    dr.eval(met, result)
    kept = compressed(met, result)
    return kept[0] if kept else None


def is_room(world: World, points: SurfacePoints | None) -> bool:
    """Return whether most of the light that surfaces in the picture scatter comes from other surfaces, as in a room.

    There light bounces often; where most directions lead to the sky, it hardly does.
    """
    if points is None:
        return False
    around = mi.Frame3f(mi.Vector3f(points.normal))
    local = mi.warp.square_to_cosine_hemisphere(mi.Point2f(pixel_sample(points.number, dr.opaque(UInt32, 1))))
    turned = Array3f(around.to_world(local))
    further = world.ahead(points.position, turned, points.number)
    return bool(np.mean(further.is_valid().numpy()) > _ENCLOSED)


def fog_seen(world: World, views: Sequence[Projection]) -> FogPoints | None:
    """Return points in fog that cameras see, all over their pictures and at all depths; None if they see none."""
    number = dr.arange(UInt32, _IN_FOG) + dr.opaque(UInt32, 0)
    packed = Views(views)
    view, place = packed(hash32(number, UInt32(4)) % packed.count), pixel_sample(number, dr.opaque(UInt32, 5))
    return _fog_along(world, _EyeRays(*view.ray(place), view.part_at(place), number))


def fog_before(world: World, views: Sequence[Projection], portal: Portal) -> FogPoints | None:
    """Return points in fog on straight lines from cameras to a portal, so that no hole is too small to be seen through.

    It does not matter whether the portal is in the picture.
    """
    u, _ = sobol_block(_AIMED * _ALONG, 0, (0,))
    number = dr.arange(UInt32, _AIMED * _ALONG)
    target, _, there = portal.sample(u)
    packed = Views(views)
    origin = packed(number % packed.count).origin
    dr.eval(target, there, origin)
    kept = compressed(there, _Aim(target, origin, number))
    if not kept:
        return None
    (aim,) = kept
    part = dr.zeros(UInt32, dr.width(aim.number))
    return _fog_along(world, _EyeRays(aim.origin, dr.normalize(aim.target - aim.origin), part, aim.number))


class _Aim(Struct):
    """Points of a portal, and the cameras that look at them."""

    target: Array3f
    origin: Array3f
    number: UInt32


def _fog_along(world: World, rays: _EyeRays) -> FogPoints | None:
    """Return a point in fog on each ray before the first surface, where there is any.

    What lies between two boundaries of fog gets as many points as the rest of a ray, however thin it is and far away.
    """
    hit = world.ahead(rays.origin, rays.direction, rays.number, panes=False)
    far = dr.norm(Array3f(hit.p) - rays.origin)
    parts = _stretches(world, rays, dr.select(hit.is_valid(), far, world.bounds.exit(rays.origin, rays.direction)))
    result, distance, weight = FogPoints(), Float(0), Float(0)
    result.medium = dr.zeros(UInt32, dr.width(rays.number))
    count = sum((dr.select(each.holds, 1.0, 0.0) for each in parts), Float(0))
    left = pixel_sample(rays.number, dr.opaque(UInt32, 6)).x * count
    for each in parts:
        chosen = each.holds & (left >= 0) & (left < 1)
        distance = dr.select(chosen, dr.lerp(each.first, each.last, left), distance)
        weight = dr.select(chosen, count * (each.last - each.first), weight)
        result.medium = dr.select(chosen, each.medium, result.medium)
        left -= dr.select(each.holds, 1.0, 0.0)
    result.position = rays.origin + distance * rays.direction
    direction = Array3f(rays.direction)
    dr.eval(result.position, result.medium, direction, distance, weight)
    there, scattering = weight > 0, world.media.scattering(result.medium)
    _, seen = world.unblocked(to_lamp(result.position, -direction, distance), result.medium, rays.number, there)
    result.light = dr.max(seen * dr.select(scattering > 0, scattering, 1)) * weight
    result.part, result.number = rays.part, rays.number
    there &= result.light > 0
    dr.eval(there, result)
    kept = compressed(there, result)
    return kept[0] if kept else None


@dataclass(frozen=True)
class _Stretch:
    """The parts of rays from a boundary of media to the next one, and whether there is a medium."""

    first: Float
    last: Float
    medium: UInt32

    @property
    def holds(self) -> Bool:
        """Whether a part has any length, and a medium."""
        return (self.last > self.first) & (self.medium > 0)


def _stretches(world: World, rays: _EyeRays, far: Float) -> list[_Stretch]:
    """Return the parts of rays in one medium each, up to a distance."""
    here, first, medium = Array3f(rays.origin), Float(0) * far, world.medium_of_view(rays.origin, rays.direction)
    result = []
    for _ in range(_BOUNDARIES if world.nested else 0):
        hit = world.around.ray_intersect(mi.Ray3f(mi.Point3f(here), mi.Vector3f(rays.direction)), first < far)
        along = dr.dot(Array3f(hit.p) - rays.origin, rays.direction)
        last = dr.select(hit.is_valid(), dr.minimum(dr.maximum(along, first), far), far)
        result.append(_Stretch(first, last, medium))
        medium = world.media.beyond(hit, rays.direction, medium, hit.is_valid())
        here, first = leaving(hit, rays.direction, world.size), last
    return [*result, _Stretch(first, far, medium)]
