"""The blend of the two estimates: the weight of the frustum against the billboard (theory, "Two estimates").

The billboard evaluates the factors at one point, whatever the beam's ends and the camera's place. It equals the frustum
if the chord, of half length h about the closest approach, lies free inside the beam, the ray and the medium, and the
factors vary little over it. Two numbers decide: h over the distance to the nearest boundary, and the relative change of
the factors over h, whose square is the billboard's error.
"""

from __future__ import annotations

import drjit as dr

from ..looks import BoundLook
from ..looks.factors import Value
from ..runtime.device import Bool, Float
from .geometry import ClosestApproach, Course, Rays
from .records import Record

# The frustum takes over where the chord comes nearer to a boundary than this, in half chords.
_CLEARANCE = 1.2
# Relative change of the factors over half a chord that leaves the billboard an error of about (0.1)²/6.
_CHANGE = 0.1
# Below this sin² float32 has lost the angle.
NARROW = 0.0025
# The weights change from this fraction of the limit to the limit.
_BEGIN = 0.7


def need(beam: Record, at: ClosestApproach, radius: Float, look: BoundLook, ray: Rays) -> tuple[Float, Float]:
    """Return how much a ray needs the frustum for this beam (1: entirely), because of boundaries and of the factors."""
    sine = at.sin2 * at.inv_sine
    taper = dr.abs(at.taper(beam))
    opening = dr.fma(-taper, taper, at.sin2)
    # Farthest that the chord through the axis reaches from the closest approach; infinite along the cone's wall. If the
    # ray is steeper than the cone opens, the closest approach may lie beyond the apex, where the radius is negative.
    reach = dr.abs(radius) if beam.bend is None else beam.widest
    half = look.profile.edge * reach * (taper + sine) * dr.rcp(dr.maximum(opening, 1e-6))
    c = dr.abs(at.cosine)
    margin = dr.minimum(dr.abs(at.t - ray.t_min), dr.abs(ray.t_max - at.t))
    to_end = dr.minimum(dr.abs(at.s - beam.begin), dr.abs(beam.stop - at.s)) * dr.rcp(dr.maximum(c, 1e-6))
    margin = dr.minimum(margin, to_end)
    if at.course is not None:
        margin = dr.minimum(margin, _to_joints(at.course, beam.cap is None))
    for normal, height in beam.planes(ray.origin):
        facing = dr.dot(ray.direction, normal)
        margin = dr.minimum(margin, dr.abs(dr.fma(facing, at.t, -height)) * dr.rcp(dr.maximum(dr.abs(facing), 1e-6)))
    boundary = _CLEARANCE * half * dr.rcp(dr.maximum(margin, 1e-20))
    rate = change_rate(beam, c, look)
    if look.lenient:
        rate -= (1 - look.of_noise) * look.rate_place
    change = (half * rate + taper * at.inv_sine) * (1 / _CHANGE)
    narrow = NARROW * dr.square(at.inv_sine)
    return boundary, dr.maximum(change, narrow)


def factors(beam: Record, ray: Rays, look: BoundLook, along: Float, t: Float, cosine: Float, rho2: Float) -> Value:
    """Return the factors that may change along a ray, where it is at t and beside the place `along` on the beam's axis.

    `cosine` is that between ray and light, and `rho2` the squared distance from the axis in radii.
    """
    distance = along + beam.offset
    where = look.at(
        distance=distance, depth=beam.depth(distance), from_light=distance, fraction=beam.fraction(distance),
        to_camera=t, cosine=-cosine, rho2=rho2, place=lambda: ray.point(t), beam=beam, ray=ray.index,
    )  # fmt: skip
    return look.light(where, t - ray.t_min)


def change_rate(beam: Record, cosine: Float, look: BoundLook) -> Float:
    """Return how fast the factors change along a ray: largest slope over largest value; `cosine` must be ≥ 0."""
    return dr.fma(cosine, look.rate_along + look.rate_fraction * beam.inv_total, look.rate_eye + look.rate_place)


def _to_joints(course: Course, both: bool) -> Float:
    """Return the distance along the ray to the nearer of the planes at which a piece of a curve meets others."""
    first = dr.abs(course.a) * dr.rcp(dr.maximum(dr.abs(course.a_rate), 1e-6))
    if not both:  # a surface cuts the end
        return first
    return dr.minimum(first, dr.abs(course.b) * dr.rcp(dr.maximum(dr.abs(course.b_rate), 1e-6)))


def frustum_weight(boundary: Float, change: Float) -> Float:
    """Return the frustum's weight, a smooth function: 0 is the billboard alone, 1 the frustum alone."""
    x = dr.clip((dr.maximum(boundary, change) - _BEGIN) * (1 / (1 - _BEGIN)), 0, 1)
    return x * x * dr.fma(-2, x, 3)


def touched(boundary: Float, change: Float, inside: Bool) -> Bool:
    """Return whether the frustum contributes to a ray: it has weight, and the chord can overlap the beam."""
    return ((boundary > _BEGIN) | inside) & (dr.maximum(boundary, change) > _BEGIN)
