"""Walls beside scattered beams, whose planes cut them.

The beams of scattered light are wide. A wall that is thinner would let them shine through: out of a bright chamber into
the dark room beside it. So each is cut by the plane of the wall where it starts, and by that of one beside it: the one
with most of the beam behind. `coverage` then gives the part in front what lies behind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.hashing import hash32, unit_float
from ...numerics.structs import Struct
from ...numerics.syntax import syntax
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...world.media.interfaces import transmits
from ...world.warp import facing, perpendicular

if TYPE_CHECKING:
    from .records import Segments

# Rays that look for walls: back from the start, on along the surface at the end, and across from three places.
_BACK, _ON, _ACROSS = 0, 1, 15

# How far from its ends a beam is looked at, in radii.
_NEAR = 0.1

# An axis ends on walls, up to rounding: it may lie so many radii behind the plane of a wall.
_BEHIND = 0.05

# A wall is thin if its other face begins before this fraction of the way to a radius from the axis.
_THICK = 0.99

# Planes are the same if the cosine between their normals is greater.
_SAME = 0.99


class Sides(Struct):
    """The planes of the walls at the start of beams, and beside them.

    Attributes
    ----------
    origin, start
        Where a beam begins, and the normal of the wall there.
    place, beside
        A point of the wall beside it, and its normal. Normals point toward the beam, and are 0 where there is no wall.
    """

    origin: Array3f
    start: Array3f
    place: Array3f
    beside: Array3f

    def planes(self) -> tuple[tuple[Any, Any], ...]:
        """Return a point of each plane, and its normal."""
        return (self.origin, self.start), (self.place, self.beside)

    def any(self) -> Bool:
        """Return which beams have a wall at their start or beside them."""
        return (dr.squared_norm(self.start) > 0) | (dr.squared_norm(self.beside) > 0)


@syntax
def sides_of(meet: Callable[..., Any], segments: Segments, radii: tuple[Float, Float], active: Bool) -> Sides:
    """Return the walls beside beams with these radii at their two ends.

    A wall counts if the axis lies before its plane, at both ends, and if it is not the wall where the beam starts or
    ends. Of several, those come first that are thinner than the beam, then those with more of the beam behind. A sheet
    is not known to be thin, because what is behind it may be inside of something.
    """
    first, last = radii
    origin, direction, length = segments.origin, segments.direction, dr.minimum(segments.length, 1e18)
    slope = (last - first) * dr.rcp(dr.maximum(length, 1e-20))
    seed = hash32(segments.index, segments.key, segments.depth)
    across, up = perpendicular(direction)
    end_normal = segments.normal
    on = direction - dr.dot(end_normal, direction) * end_normal
    on = dr.select(dr.squared_norm(on) > 1e-6, dr.normalize(on), across)
    begin, until = (dr.minimum(_NEAR * each, 0.1 * length) for each in (first, last))
    start, place, beside, most = Array3f(0), Array3f(0), Array3f(0), Float(0)
    line = UInt32(0)
    while line < 2 + _ACROSS:
        back = line == _BACK
        sine, cosine = dr.sincos(2 * dr.pi * (Float(line) * (1 / _ACROSS) + unit_float(seed)))
        way = dr.select(back, -direction, dr.select(line == _ON, on, cosine * across + sine * up))
        s = dr.select(line % 3 == 0, begin, dr.select(line % 3 == 1, length - until, 0.5 * length))
        radius = dr.select(back, 2 * s, dr.fma(slope, s, first))
        axis = dr.fma(direction, s, origin)
        hit = meet(axis, way, active, hash32(seed, line))
        found = active & hit.is_valid() & ~transmits(hit) & (hit.t < radius)
        # From within a thick wall, the way back meets the same face.
        again = meet(dr.fma(way, radius, axis), -way, found & ~back, hash32(seed, line))
        thin = again.is_valid() & (again.t < _THICK * (radius - hit.t))
        normal, point = facing(Array3f(hit.n), way), Array3f(hit.p)
        at_start = dr.dot(normal, origin - point)
        at_end = dr.fma(dr.dot(normal, direction), length, at_start)
        starts, ends = dr.abs(at_start) < _BEHIND * first, dr.abs(at_end) < _BEHIND * last
        start = dr.select(found & back & starts, normal, start)
        starts &= dr.dot(normal, start) > _SAME
        ends &= dr.dot(normal, end_normal) > _SAME
        least = dr.minimum(at_start, at_end)
        before = least > -_BEHIND * dr.minimum(first, last)
        behind = _behind(at_start / first, at_end / last) + dr.select(thin, Float(1), 0)
        better = found & ~back & ~starts & ~ends & before & (behind > most)
        place = dr.select(better, point + dr.minimum(least, 0) * normal, place)
        beside, most = dr.select(better, normal, beside), dr.select(better, behind, most)
        line += 1
    return Sides(segments.origin, start, place, beside)


def _behind(at_start: Float, at_end: Float) -> Float:
    """Return about which part of beams is behind planes at these distances from the axis' ends, in radii.

    At the distance x it is about (1 − x)²/2, whose mean from one end to the other this is.
    """
    a, b = (dr.clip(1 - each, 0, 1) for each in (at_start, at_end))
    change = at_end - at_start
    mean = (a * a * a - b * b * b) * dr.rcp(6 * dr.select(dr.abs(change) > 1e-3, change, 1))
    return dr.select(dr.abs(change) > 1e-3, mean, 0.5 * a * b)
