"""Truncated cones that enclose beams with all that reaches past their ends, for lists of beams."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from ..beams import Beams
from ..runtime.device import Array3f, Float


class Cone(NamedTuple):
    """Cones of beams at one time of the shutter interval, in some space."""

    start: Any
    end: Any
    radius_start: Any
    radius_end: Any


def around(beams: Beams, start: Array3f, end: Array3f) -> Cone:
    """Return cones that enclose beams; `start` and `end` are in a space with the scale of the world."""
    r0, r1 = beams.radius_start, beams.radius_end
    if beams.start_tangent is not None:
        return _around_joints(beams, start, end)
    if beams.end_normal is not None:  # the rim may reach past the end by a radius
        axis, length = end - start, dr.norm(end - start)
        axis, slope = axis / length, (r1 - r0) / length
        end, r1 = end + axis * r1, r1 + dr.maximum(slope, 0) * r1
    return Cone(start, end, r0, r1)


def _around_joints(beams: Beams, start: Array3f, end: Array3f) -> Cone:
    """Return cones that enclose pieces of curves: their rims may reach past both ends, by at most a radius."""
    axis = dr.normalize(beams.end - beams.start)
    here = dr.normalize(end - start)
    radius = dr.maximum(beams.radius_start, beams.radius_end)
    if beams.end_normal is not None:  # a piece keeps growing up to the surface's plane, see `Course.fraction`
        radius = dr.maximum(radius, 2 * beams.radius_end - beams.radius_start)
    reaches = []
    last = beams.end_tangent if beams.end_normal is None else beams.end_normal
    normal: Any
    for normal, own in ((beams.start_tangent, beams.radius_start), (last, beams.radius_end)):
        cosine2 = dr.square(dr.dot(axis, normal)) * dr.rcp(dr.maximum(dr.squared_norm(normal), 1e-20))
        slant = dr.sqrt(dr.maximum(1 - cosine2, 0) * dr.rcp(dr.maximum(cosine2, 1e-6)))
        # Somewhat more than at this time: between shutter open and close, planes turn relative to their beams.
        reaches.append(dr.minimum(own, radius * dr.fma(1.5, slant, 0.05)))
    return Cone(start - here * reaches[0], end + here * reaches[1], radius, radius)


def half_line(rate: Float, value: Float) -> tuple[Any, Any]:
    """Return the part of [0, 1] where value + rate · λ ≤ 0; an empty one is returned reversed.

    The radius of a cone is linear along its axis, and so is its box, so the part of a cone before a boundary is such an
    interval.
    """
    flat = dr.abs(rate) < 1e-12
    root = -value / dr.select(flat, 1, rate)
    low = dr.select(flat, dr.select(value <= 0, 0, 2), dr.select(rate < 0, dr.maximum(root, 0), 0))
    high = dr.select(flat, dr.select(value <= 0, 1, -1), dr.select(rate > 0, dr.minimum(root, 1), 1))
    return low, high
