"""Beam × Beam 2D: the beam as a conical frustum, integrated along the ray by quadrature (Talk, sections 2 and 3).

    L = Φ · angle(θ) · ∫_a^b k2(r(t)/R(s(t)), R(s(t))) · along(s(t)) · eye(t) dt

There is no 1/sin θ and no singularity, so it holds with the camera inside the cone and along the axis. The interval [a,
b] is the ray's chord through the cone, split where the profile or a colour ramp has a corner; the rule is applied to
each smooth piece.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..looks.bound_look import MOST_CORNERS, BoundLook
from ..looks.factors import Value
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Bool, Float, UInt32
from .blend import change_rate, factors, frustum_weight, need
from .geometry import Chord, Rays, chord, closest_approach
from .points import Points
from .records import Packed, Record, load

# Most change of the radius, as a ratio, over one piece of a chord: six points then err by 1e-6 on 1/R². For the change
# of the factors see `BoundLook.change`. The look also limits how often a chord is cut (`BoundLook.cuts`): the rate of
# change is infinite at a jump, and a pointed cone would be cut without end.
_RATIO = 3.0


def corners(beam: Record, ray: Chord, look: BoundLook) -> list[Float]:
    """Return the τ at which the integrand has a corner: rings of the profile, knots of the colour ramp."""
    radius, slope_c = ray.radius, ray.growth
    result = []
    for ring in look.rings:
        if ring == 0:
            result.append(-ray.drift / dr.maximum(ray.sin2, 1e-12))
            continue
        rho = dr.opaque(Float, ring)
        A = dr.fma(-(rho * rho) * slope_c, slope_c, ray.sin2)
        B = dr.fma(-(rho * rho) * slope_c, radius, ray.drift)
        C = dr.fma(-(rho * rho) * radius, radius, ray.offset2)
        root = dr.sqrt(dr.maximum(dr.fma(B, B, -A * C), 0))
        inv = dr.rcp(dr.select(dr.abs(A) < 1e-12, 1e-12, A))
        result += [(-B - root) * inv, (-B + root) * inv]
    inv_c = dr.rcp(dr.select(dr.abs(ray.cosine) < 1e-6, 1e-6, ray.cosine))
    elsewhere = []
    for name, place in look.corners:
        at = dr.opaque(Float, place)
        if name == "eye":
            elsewhere.append(at - ray.t)
        elif name != "radius":
            distance = (at * beam.total if name == "fraction" else at) - beam.offset
            straight = (distance - ray.s) * inv_c
            elsewhere.append(straight if ray.course is None else ray.course.where(distance))
    return result + elsewhere[:MOST_CORNERS]


def integrand(beam: Record, ray: Chord, tau: Float, look: BoundLook, camera: Rays) -> Value:
    """Return k2 times all factors that change along the ray, at τ, including power and angle if they change."""
    s = ray.along(tau)
    radius = dr.maximum(dr.fma(beam.slope, s, beam.radius), 1e-12)
    inv = dr.rcp(radius * radius)
    rho2 = dr.minimum(ray.radius2(tau) * inv, 1)
    cosine = ray.cosine if ray.course is None else ray.course.cosine(tau)
    light = factors(beam, camera, look, s, ray.t + tau, cosine, rho2)
    if beam.gain is not None:
        light *= beam.light(s)
    if ray.course is not None:
        light *= look.turned(-cosine, beam)
    return light * (look.profile.density(rho2) * inv)


def unchanging(beam: Record, ray: Chord, look: BoundLook) -> Array3f:
    """Return Φ · angle, or the part of it that does not change along the beam."""
    power = beam.power if beam.gain is None else Array3f(1)
    return power if ray.course is not None else power * look.turned(-ray.cosine, beam)


@syntax
def chord_integral(beam: Record, ray: Chord, look: BoundLook, points: Points, camera: Rays, active: Bool) -> Array3f:
    """Return ∫ k2 · along · eye over the chord, piece by piece between corners (Talk, eq. 2)."""
    breaks = corners(beam, ray, look)
    total = Array3f(0)
    low, end = Float(ray.a), dr.select(active, ray.b, ray.a)
    rate = change_rate(beam, dr.abs(ray.cosine), look)
    rate_across = look.rate_radius * dr.sqrt(ray.sin2)
    shortest = (ray.b - ray.a) * dr.rcp(look.cuts)
    growth = ray.growth
    spread = dr.select(growth > 0, _RATIO - 1, 1 - 1 / _RATIO) * dr.rcp(dr.maximum(dr.abs(growth), 1e-20))
    while low < end:
        radius = dr.fma(beam.slope, ray.along(low), beam.radius)
        inv_radius = dr.rcp(dr.maximum(radius, 1e-12))
        steady = look.change * dr.rcp(dr.maximum(dr.fma(rate_across, inv_radius, rate), 1e-20))
        longest = dr.maximum(dr.minimum(steady, spread * radius), shortest)
        # A piece of almost all the rest takes the whole rest, or rounding would leave a sliver. If the piece is so
        # short that `cut` rounds to `low`, it takes the rest as well, or the loop would never end.
        cut = low + longest
        high = dr.select((end - low > 1.01 * longest) & (cut > low), cut, end)
        for place in breaks:
            high = dr.select((place > low) & (place < high), place, high)
        half, middle = 0.5 * (high - low), 0.5 * (high + low)
        j = UInt32(0)
        while j < points.count:
            node = points(j)
            total += integrand(beam, ray, dr.fma(half, node.x, middle), look, camera) * (node.y * half)
            j += 1
        low = high
    return total


@syntax
def frustum(
    radiance: Array3f,
    beam: Record,
    ray: Rays,
    look: BoundLook,
    points: Points,
    blended: bool,
    span: Any = None,
) -> Array3f:
    """Return `radiance` plus a beam's radiance toward a ray.

    With `span`, a pair, the beam counts only if span[0] ≤ t < span[1] for the ray parameter t of the chord's middle.
    """
    part = chord(beam, ray.origin, ray.direction, ray.t_min, ray.t_max)
    weight = dr.select(part.valid, Float(1), Float(0))
    if dr.hint(span is not None, mode="scalar"):
        middle = dr.fma(part.a + part.b, 0.5, part.t)
        weight = dr.select((middle >= span[0]) & (middle < span[1]), weight, 0)
    if dr.hint(blended, mode="scalar"):
        at = closest_approach(beam, ray.origin, ray.direction)
        radius = dr.fma(beam.slope, at.along, beam.radius)
        boundary, change = need(beam, at, radius, look, ray.t_min, ray.t_max, ray.origin, ray.direction)
        weight *= frustum_weight(boundary, change)
    if weight > 0:
        light = chord_integral(beam, part, look, points, ray, weight > 0)
        radiance = radiance + unchanging(beam, part, look) * light * weight
    return radiance


@syntax
def frustum_sum(
    ray: Rays,
    first: UInt32,
    stop: UInt32,
    number: Callable[[UInt32], UInt32],
    packed: Packed,
    look: BoundLook,
    points: Points,
    blended: bool,
    wanted: Callable[[UInt32], Bool] | None = None,
) -> Array3f:
    """Return the radiance of the beams `number(first)` … `number(stop − 1)` toward each lane's ray.

    With `blended` (`auto`), each beam is multiplied by the frustum's weight, the complement of the billboard's.
    `wanted(i)` tells whether a lane needs the entry i at all.
    """
    radiance = Array3f(0)
    i = UInt32(first)
    while i < stop:
        if dr.hint(wanted is None, mode="scalar"):  # noqa: SIM114 - one is Python, the other is traced
            radiance = frustum(radiance, load(packed, number(i), ray.time), ray, look, points, blended)
        elif wanted(i):  # type: ignore[misc]
            radiance = frustum(radiance, load(packed, number(i), ray.time), ray, look, points, blended)
        i += 1
    return radiance
