"""Connections: straight lines between emitters and points in fog that cameras see, and whether anything blocks them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ...numerics.arrays import compressed, to_numpy
from ...numerics.hashing import hash32
from ...numerics.sampling import pixel_sample
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...scene import Array
from ...world.shadow_rays import leaving, to_lamp
from ...world.world import World
from ..emission import PathEmitter
from .importance import Views, relative

if TYPE_CHECKING:
    from ...estimators.projection import Projection

mi = mitsuba()

# Number of points, for all cameras together; most boundaries of fog along a ray that are told apart.
_POINTS, _BOUNDARIES = 1 << 16, 4


class VisiblePoints(Struct):
    """Points in fog that cameras see; `light` is what a unit of irradiance there would send to the camera."""

    position: Array3f
    medium: UInt32
    light: Float
    part: UInt32
    number: UInt32


@dataclass(frozen=True)
class ShadowRays:
    """Lines from an emitter to points in the picture: the points, and the directions of light, (N, 3).

    `weight`, (N,), is how much light in the picture each stands for; `free`, (N,), is whether nothing blocks the line.
    """

    point: Array
    direction: Array
    weight: Array
    free: Array

    def chosen(self, free: bool, most: int) -> tuple[Array, Array]:
        """Return points and directions of at most `most` lines that are free, or that are not, chosen by weight."""
        index = np.flatnonzero(self.free == free)
        number = min(most, len(index))
        if not number:
            return self.point[:0], self.direction[:0]
        ends = np.cumsum(self.weight[index])
        places = np.searchsorted(ends, (np.arange(number) + 0.5) / number * ends[-1])
        index = index[np.minimum(places, len(index) - 1)]
        return self.point[index], self.direction[index]


class Connections:
    """Points all over the pictures of cameras, and the lines along which the lamps of a stage light them."""

    def __init__(self, world: World, views: Sequence[Projection]) -> None:
        self._world = world
        found = compressed(*_visible(world, Views(views)))
        self._points: VisiblePoints | None = found[0] if found else None

    def __call__(self, emitter: PathEmitter) -> ShadowRays:
        """Return the lines along which an emitter lights the points."""
        points, world = self._points, self._world
        if points is None:
            return ShadowRays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=bool))
        acting = world.linking.acting(dr.opaque(UInt32, emitter.source), points.medium)
        lamp = emitter.lamp.at(acting)
        sample = lamp.illuminate(points.position, pixel_sample(points.number, dr.opaque(UInt32, 7)))
        distance = dr.minimum(to_lamp(points.position, sample.direction, sample.distance).length, dr.largest(Float))
        active = dr.max(sample.weight) > 0
        dr.eval(sample, distance, active)
        seed = hash32(points.number, UInt32(8))
        link = dr.zeros(UInt32, dr.width(seed)) + dr.opaque(UInt32, emitter.link)
        free = ~world.solids.blocked(points.position, sample.direction, distance, active, seed, link)
        if emitter.portal is not None:
            passes = emitter.portal.crosses(points.position, sample.direction, distance)
            active &= passes if emitter.through else ~passes
        reached = world.dimming(points.position, sample.direction, distance, points.medium, seed, active)
        light = dr.select(active, dr.max(sample.weight * reached) * points.light, 0)
        dr.eval(light, free)
        weight, index = light.numpy().astype(np.float64), np.flatnonzero(light.numpy() > 0)
        lit, part = free.numpy()[index], points.part.numpy()[index]
        weight = weight[index]
        for each in (lit, ~lit):
            weight[each] = relative(weight[each], part[each])
        return ShadowRays(to_numpy(points.position).T[index], -to_numpy(sample.direction).T[index], weight, lit)


def _visible(world: World, views: Views) -> tuple[Bool, VisiblePoints]:
    """Return points all over the pictures and at all depths, and which of them are in fog."""
    number = dr.arange(UInt32, _POINTS) + dr.opaque(UInt32, 0)
    view = views(hash32(number, UInt32(4)) % views.count)
    place = pixel_sample(number, dr.opaque(UInt32, 5))
    share = pixel_sample(number, dr.opaque(UInt32, 6)).x
    origin, direction = view.ray(place)
    hit = world.solids.first(origin, direction, Bool(True), number)
    far = dr.select(hit.is_valid(), hit.t, world.bounds.exit(origin, direction))
    distance, weight = _between(world, origin, direction, far, share)
    result = VisiblePoints()
    result.position = origin + distance * direction
    dr.eval(result.position, direction, distance, weight)
    result.medium = world.medium_at(result.position, direction, Bool(True))
    scattering = world.media.scattering(result.medium)
    seen = world.dimming(result.position, -direction, distance, result.medium, number, Bool(True))
    result.light = dr.max(seen * dr.select(scattering > 0, scattering, 1)) * weight
    result.part = view.part_at(place)
    result.number = number
    there = (result.medium > 0) & (result.light > 0)
    dr.eval(there, result)
    return there, result


def _between(world: World, origin: Array3f, direction: Array3f, far: Float, share: Float) -> tuple[Float, Float]:
    """Return distances along rays for numbers in [0, 1), and what each stands for: 1 over its density.

    What lies between two boundaries of fog gets as many as the rest of a ray, however thin it is and far away.
    """
    ends, here = [Float(0) * far], Array3f(origin)
    for _ in range(_BOUNDARIES if world.nested else 0):
        hit = world.around.ray_intersect(mi.Ray3f(mi.Point3f(here), mi.Vector3f(direction)), ends[-1] < far)
        along = dr.dot(Array3f(hit.p) - origin, direction)
        ends.append(dr.select(hit.is_valid(), dr.minimum(dr.maximum(along, ends[-1]), far), far))
        here = leaving(hit, direction, world.size)
    ends.append(far)
    count, distance, weight = Float(0), Float(0), Float(0)
    for first, last in pairwise(ends):
        count += dr.select(last > first, 1.0, 0.0)
    left = share * count
    for first, last in pairwise(ends):
        there = (last > first) & (left >= 0)
        distance = dr.select(there & (left < 1), dr.lerp(first, last, left), distance)
        weight = dr.select(there & (left < 1), count * (last - first), weight)
        left -= dr.select(there, 1.0, 0.0)
    return distance, weight
