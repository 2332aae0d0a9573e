"""Beam × Beam 1D: the beam as a flat billboard (Jarosz et al. 2011; Talk, section 1).

    L = Φ · angle(θ) / sin θ · k1(u, R(s)) · along(s) · eye(t)

One evaluation for each beam and ray: cheap, and accurate from beside. It is singular as θ → 0 and meaningless with the
camera inside; `auto` leaves these cases to the frustum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr

from ..looks import BoundLook
from ..looks.factors import Value
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Bool, Float, UInt32
from .blend import NARROW, factors, frustum_weight, need, touched
from .corners import across_section, cut
from .geometry import ClosestApproach, Rays, passing
from .points import Points
from .records import Packed, Record, load


def value(
    beam: Record, at: ClosestApproach, u2: Float, radius: Float, look: BoundLook, ray: Rays, points: Points
) -> Array3f:
    """Return a beam's radiance toward a ray that passes its axis at the squared distance `u2`."""
    inv_radius = dr.rcp(radius)
    x = u2 * dr.square(inv_radius)
    kernel = dr.sqrt(dr.maximum(1 - x, 0)) * (inv_radius * at.inv_sine)
    if look.by_radius:
        light = _projected(beam, at, x, look, ray, points)
    else:
        light = _light(beam, at, x, look, ray) * look.profile.line(x)
    return beam.light(at.along) * (light * look.turned(-_cosine(at), beam) * kernel)


def _cosine(at: ClosestApproach) -> Float:
    """Return the cosine between the ray and the light where they come closest."""
    return at.cosine if at.course is None else at.course.cosine(Float(0))


def _light(beam: Record, at: ClosestApproach, rho2: Float, look: BoundLook, ray: Rays) -> Value:
    """Return the factors at the closest approach, for the squared distance ρ² from the axis in radii."""
    return factors(beam, ray, look, at.along, at.t, _cosine(at), rho2)


@syntax
def _projected(beam: Record, at: ClosestApproach, x: Float, look: BoundLook, ray: Rays, points: Points) -> Value:
    """Return 2 ∫_0^1 density · light dv with ρ² = x + (1 − x) v²: the line projection of all that changes with ρ.

    The integral is split at the rings where the integrand has corners, and into pieces over which the look hardly
    changes: dρ/dv is at most 1.
    """
    longest = dr.clip(look.change * dr.rcp(dr.maximum(look.rate_radius, 1e-20)), dr.rcp(look.cuts), 1)
    edges, end = across_section(x, look)
    nearest = [each.first() for each in edges]
    total = Array3f(0)
    low = Float(0)
    while low < end:
        high = low + longest
        high = dr.select(high > end - 0.01 * longest, end, high)
        nearest, high = cut(edges, nearest, low, high)
        half, middle = 0.5 * (high - low), 0.5 * (high + low)
        j = UInt32(0)
        while j < points.count:
            node = points(j)
            rho2 = dr.lerp(x, Float(1), dr.square(dr.fma(half, node.x, middle)))
            total += _light(beam, at, rho2, look, ray) * (look.profile.density(rho2) * (node.y * half))
            j += 1
        low = high
    return 2 * total


def in_range(
    beam: Record, at: ClosestApproach, t_min: Float, t_max: Float, origin: Array3f | None, direction: Array3f
) -> Bool:
    """Return whether the closest approach lies between the beam's ends and on the visible part of the ray."""
    inside = (at.s > beam.begin) & (at.s < beam.stop) & (at.t > t_min) & (at.t < t_max)
    if at.course is not None:
        inside &= (at.course.a > 0) if beam.cap is not None else (at.course.a > 0) & (at.course.b > 0)
    for normal, height in beam.planes(origin):
        inside &= dr.dot(direction, normal) * at.t > height
    return inside


@syntax
def billboard(
    radiance: Array3f,
    beam: Record,
    ray: Rays,
    look: BoundLook,
    points: Points,
    blended: bool,
    span: Any = None,
) -> tuple[Array3f, Bool]:
    """Return `radiance` plus a beam's radiance toward a ray and, for `auto`, whether the frustum contributes too.

    With `span`, a pair, the beam counts only if span[0] ≤ t < span[1] for the ray parameter t of closest approach.
    """
    marked = Bool(False)
    passage = passing(beam, ray.origin, ray.direction)
    if passage.meets(beam):
        at = passage.closest(beam, ray.origin, ray.direction)
        radius = dr.fma(beam.slope, at.along, beam.radius)
        inside = in_range(beam, at, ray.t_min, ray.t_max, ray.origin, ray.direction)
        here = inside
        if dr.hint(span is not None, mode="scalar"):
            # t computed from the place on the axis: if the lines are nearly parallel, it is as accurate as s.
            foot = dr.fma(passage.cosine, at.s, passage.along)
            here = inside & (foot >= span[0]) & (foot < span[1])
        if dr.hint(blended, mode="scalar"):
            boundary, change = need(beam, at, radius, look, ray)
            weight = 1 - frustum_weight(boundary, change)
            if here & (radius > 0) & (weight > 0):
                # A distance that equals R where the ray leaves the cone. At u = R itself the chord of a tapered beam is
                # not yet empty, and a hard rim would cause a step in the blend.
                u2 = at.u2 * (1 - dr.square(at.taper(beam) * at.inv_sine))
                radiance = radiance + value(beam, at, u2, radius, look, ray, points) * weight
            # An empty ray, as beyond the picture's edge, has t_min ≥ t_max: its boundary is everywhere.
            marked = touched(boundary, change, inside) & (ray.t_min < ray.t_max)
        else:
            hit = here & (radius > 0) & (at.u2 < dr.square(radius))  # a surface may cut a cone beyond its tip
            radiance = radiance + dr.select(hit, value(beam, at, at.u2, radius, look, ray, points), 0)
    if dr.hint(blended, mode="scalar"):
        # Along the axis rounding may make the ray miss the cone.
        marked |= passage.sin2 < NARROW
    return radiance, marked


@syntax
def billboard_sum(
    rays: list[Rays],
    first: UInt32,
    stop: UInt32,
    number: Callable[[UInt32], UInt32],
    packed: Packed,
    look: BoundLook,
    points: Points,
    blended: bool,
    marks: UInt32 | None = None,
    blocks: Sequence[UInt32] = (),
) -> list[Array3f]:
    """Return the radiance of the beams `number(first)` … `number(stop − 1)` toward each of the lane's rays.

    Every lane carries several rays, so that one gather of a beam serves them all: gathers limit the speed of this loop.

    Parameters
    ----------
    rays
        The K rays of each lane, of one time; origins are relative to the packed origin.
    points
        Quadrature over the cross-section, for looks that change with the distance from the axis.
    blended
        Whether to leave out what the frustum estimates better (`auto`), or to take everything (`billboard`).
    marks, blocks
        For `auto`, a UInt32 array in which the entries are marked that the frustum has to visit: with the bits of those
        rays that need it. `blocks` are the bits of the lane's rays.
    """
    radiance = [Array3f(0) for _ in range(len(rays))]
    i = UInt32(first)
    while i < stop:
        beam = load(packed, number(i), rays[0].time)
        marked = UInt32(0)
        for p in range(len(rays)):
            radiance[p], touches = billboard(radiance[p], beam, rays[p], look, points, blended)
            if dr.hint(marks is not None, mode="scalar"):
                marked |= dr.select(touches, blocks[p], 0)
        if dr.hint(marks is not None, mode="scalar"):  # noqa: SIM102 - one is Python, the other is traced
            if marked > 0:
                # Lanes of one tile write to the same place: no race, whatever the order.
                dr.scatter_reduce(dr.ReduceOp.Or, marks, marked, i, marked > 0, dr.ReduceMode.Local)
        i += 1
    return radiance
