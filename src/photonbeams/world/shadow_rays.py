"""Rays that leave surfaces, and shadow rays from points to lamps.

A ray must not meet the surface that it leaves, whose points have rounding errors. Mitsuba moves its origin along the
normal, by 1500 ulps of the greatest coordinate and at least 1500 ulps of 1. That is too far where a scene is small, or
far from the origin of its coordinates, or where the lamp is nearer than that. So the gap is limited here, and a shadow
ray goes from where it begins to the lamp: it neither passes the lamp nor ends too early.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..numerics.structs import Struct
from ..runtime.device import Array3f, Float, mitsuba
from .bounds import box_around

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiScene, Ray, SurfaceInteraction

mi = mitsuba()

# Rounding errors of points, relative to their greatest coordinate: a few ulps of float32 each.
_ROUNDING = 8 * 2**-24

# The gap at a surface is at most this fraction of a lamp's height above it.
_LOW = 1 / 64

# Fraction of the distance by which shadow rays end before the lamp, because the lamp may lie on a surface.
_SHORTENED = 1e-4


class ShadowRay(Struct):
    """Rays to lamps, up to their `length`, which is infinite toward lamps at infinity; they end `before` the lamps."""

    origin: Array3f
    direction: Array3f
    length: Float
    before: Float

    def ray(self) -> Ray:
        """Return the rays as Mitsuba's."""
        result = mi.Ray3f(mi.Point3f(self.origin), mi.Vector3f(self.direction))
        result.maxt = self.length
        return result

    def across(self) -> Ray:
        """Return rays that end as far beyond the points, on surfaces, as shadow rays end before them."""
        result = self.ray()
        result.maxt = self.length + 2 * self.before
        return result


def size_of(*plugins: MiScene) -> Float:
    """Return the diameter of Mitsuba scenes, opaque; 1 if they are empty, or a point."""
    box = mi.ScalarBoundingBox3f()
    for each in plugins:
        box.expand(box_around(each))
    size = float(np.linalg.norm(np.ravel(box.extents()))) if box.valid() else 0.0
    return opaque(size or 1.0)


def gap_at(place: Array3f, size: Float) -> Float:
    """Return how far from a place the rays begin that leave a surface there."""
    extent = dr.max(dr.abs(place))
    return dr.minimum(_usual_gap(extent), dr.maximum(mi.math.RayEpsilon * size, rounding(extent)))


def gap_before(place: Array3f, size: Float) -> Float:
    """Return how far before a lamp paths begin if the lamp lies in the plane of a surface, up to rounding."""
    return dr.minimum(gap_at(place, size), rounding(dr.max(dr.abs(place)) + size))


def rounding(extent: Float) -> Float:
    """Return the rounding error of points whose greatest coordinate is `extent`."""
    return _ROUNDING * extent


def leaving(hit: SurfaceInteraction, direction: Any, size: Float) -> Array3f:
    """Return the origins of rays that leave surfaces of a scene with the diameter `size`."""
    return _moved(hit, mi.Vector3f(direction), mi.math.RayEpsilon * size)


def to_lamp(point: Any, direction: Array3f, distance: Float, size: Float | None = None) -> ShadowRay:
    """Return the shadow rays to lamps.

    Parameters
    ----------
    point
        Points, or hits on surfaces (Mitsuba's interactions) of a scene with the diameter `size`.
    direction, distance
        Where the lamps are from there; a distance may be infinite.
    """
    place, near = point if size is None else Array3f(point.p), dr.isfinite(distance)
    result = to_point(point, place + dr.select(near, distance, 1) * direction, size)
    if size is not None:
        result.origin = dr.select(near, result.origin, leaving(point, direction, size))
    result.direction = dr.select(near, result.direction, direction)
    result.length = dr.select(near, result.length, dr.inf)
    return result


def to_point(point: Any, lamp: Array3f, size: Float | None = None) -> ShadowRay:
    """Return the shadow rays to points of lamps, as `to_lamp` does."""
    origin = point
    if size is not None:
        to = lamp - Array3f(point.p)
        height = dr.abs(dr.dot(Array3f(point.n), to))
        origin = _moved(point, mi.Vector3f(to), dr.minimum(mi.math.RayEpsilon * size, _LOW * height))
    to = lamp - origin
    length = dr.norm(to)
    result = ShadowRay()
    result.origin, result.direction = origin, to * dr.rcp(dr.maximum(length, 1e-30))
    result.before = length * _SHORTENED + rounding(dr.max(dr.abs(lamp)))
    result.length = length - result.before
    return result


def _moved(hit: Any, direction: Array3f, most: Float) -> Array3f:
    """Return Mitsuba's origins of rays, but not further from the surface than `most` and the rounding error."""
    place = Array3f(hit.p)
    extent = dr.max(dr.abs(place))
    most = dr.maximum(most, rounding(extent))
    near = place + dr.mulsign(most, dr.dot(hit.n, direction)) * Array3f(hit.n)
    return dr.select(_usual_gap(extent) <= most, Array3f(hit.spawn_ray(direction).o), near)


def _usual_gap(extent: Float) -> Float:
    """Return how far Mitsuba moves the origins of rays whose greatest coordinate is `extent`."""
    return mi.math.RayEpsilon * (1 + extent)
