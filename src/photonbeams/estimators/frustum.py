"""Beam × Beam 2D: the beam as a conical frustum, integrated along the ray by quadrature (Talk, sections 2 and 3).

    L = Φ · angle(θ) · ∫_a^b k2(r(t)/R(s(t)), R(s(t))) · along(s(t)) · eye(t) dt

No 1/sin θ and no singularity: valid with the camera inside the cone and along the axis. The interval [a, b] is the
ray's chord through the cone, split where the profile or a colour ramp has a corner; the rule's points serve each
smooth piece.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from ..arrays import to_float
from ..device import Array2f, Array3f, Float, UInt32
from ..looks import BoundLook
from ..quadrature import Rule
from .blend import frustum_weight, need
from .geometry import Chord, Packed, Rays, Record, chord, closest_approach, load

# A ramp with more corners than this is taken for a smooth curve: each costs every chord a comparison.
_MOST_CORNERS = 8

# Change of the factors, in units of their largest value, and of the radius, as a ratio, that one piece of a chord may
# hold: six points then err by 1e-5 on an exponential, by 1e-6 on 1/R². A chord is cut in four at most for it, since a
# look with jumps changes endlessly fast, and a pointed cone endlessly often.
_CHANGE, _RATIO, _MOST_CUTS = 8.0, 3.0, 4


class Points:
    """A rule's points and weights in device memory: neither their values nor their number is part of a kernel."""

    def __init__(self, rule: Rule) -> None:
        self._data = to_float(np.stack([rule.points, rule.weights], axis=1))
        self.count = dr.opaque(UInt32, len(rule.points))

    def __call__(self, number: Any) -> Any:
        """Return point and weight of this number."""
        return dr.gather(Array2f, self._data, number)


def corners(beam: Record, ray: Chord, look: BoundLook) -> list[Any]:
    """Return the τ at which the integrand has a corner: rings of the profile, knots of the colour ramp."""
    radius, slope_c = ray.radius, ray.growth
    result = []
    for rho in look.profile.corners:
        if rho == 0:
            result.append(-ray.drift / dr.maximum(ray.sin2, 1e-12))
            continue
        A = dr.fma(-(rho * rho) * slope_c, slope_c, ray.sin2)
        B = dr.fma(-(rho * rho) * slope_c, radius, ray.drift)
        C = dr.fma(-(rho * rho) * radius, radius, ray.offset2)
        root = dr.sqrt(dr.maximum(dr.fma(B, B, -A * C), 0))
        inv = dr.rcp(dr.select(dr.abs(A) < 1e-12, 1e-12, A))
        result += [(-B - root) * inv, (-B + root) * inv]
    distances = [dr.opaque(Float, place) - beam.offset for place in look.corners_distance]
    distances += [dr.opaque(Float, place) * beam.total - beam.offset for place in look.corners_fraction]
    if ray.course is not None:
        return result + [ray.course.where(distance) for distance in distances[:_MOST_CORNERS]]
    inv_c = dr.rcp(dr.select(dr.abs(ray.cosine) < 1e-6, 1e-6, ray.cosine))
    return result + [(distance - ray.s) * inv_c for distance in distances[:_MOST_CORNERS]]


def integrand(beam: Record, ray: Chord, tau: Any, look: BoundLook, t_min: Any) -> Any:
    """Return k2 · along · eye at τ, and of power and angle what changes along the beam."""
    s = ray.along(tau)
    radius = dr.maximum(dr.fma(beam.slope, s, beam.radius), 1e-12)
    inv = dr.rcp(radius * radius)
    distance = s + beam.offset
    t = ray.t + tau
    light = look.path(distance, beam.depth(distance), beam.fraction(distance), t, t - t_min)
    if beam.gain is not None:
        light *= beam.light(s)
    if ray.course is not None:
        light *= look.angle(-ray.course.cosine(tau))
    return light * (look.profile.density(dr.minimum(ray.radius2(tau) * inv, 1)) * inv)


def steady(beam: Record, ray: Chord, look: BoundLook) -> Any:
    """Return Φ · angle, or what of it does not change along the beam."""
    power = beam.power if beam.gain is None else Array3f(1)
    return power if ray.course is not None else power * look.angle(-ray.cosine)


@dr.syntax
def chord_integral(beam: Record, ray: Chord, look: BoundLook, points: Points, t_min: Any, active: Any) -> Any:
    """Return ∫ k2 · along · eye over the chord, piece by piece between corners (Talk, eq. 2)."""
    breaks = corners(beam, ray, look)
    total = Array3f(0)
    low, end = Float(ray.a), dr.select(active, ray.b, ray.a)
    rate = dr.fma(dr.abs(ray.cosine), look.rate_along + look.rate_fraction * beam.inv_total, look.rate_eye)
    steady = _CHANGE * dr.rcp(dr.maximum(rate, 1e-20))
    shortest = (ray.b - ray.a) * (1 / _MOST_CUTS)
    growth = ray.growth
    spread = dr.select(growth > 0, _RATIO - 1, 1 - 1 / _RATIO) * dr.rcp(dr.maximum(dr.abs(growth), 1e-20))
    while low < end:
        radius = dr.fma(beam.slope, ray.along(low), beam.radius)
        longest = dr.maximum(dr.minimum(steady, spread * radius), shortest)
        # A piece of almost the whole rest takes all of it: rounding would leave a sliver. One too short to be told from
        # `low` would never end.
        cut = low + longest
        high = dr.select((end - low > 1.01 * longest) & (cut > low), cut, end)
        for place in breaks:
            high = dr.select((place > low) & (place < high), place, high)
        half, middle = 0.5 * (high - low), 0.5 * (high + low)
        j = UInt32(0)
        while j < points.count:
            node = points(j)
            total += integrand(beam, ray, dr.fma(half, node.x, middle), look, t_min) * (node.y * half)
            j += 1
        low = high
    return total


@dr.syntax
def frustum_sum(
    ray: Rays,
    first: Any,
    stop: Any,
    number: Callable[[Any], Any],
    packed: Packed,
    look: BoundLook,
    points: Points,
    blended: bool,
) -> Any:
    """Return the radiance of the beams `number(first)` … `number(stop − 1)` toward each lane's ray.

    With `blended` each beam counts by the frustum's weight, the billboard's complement (`auto`).
    """
    radiance = Array3f(0)
    i = UInt32(first)
    while i < stop:
        beam = load(packed, number(i), ray.time)
        part = chord(beam, ray.origin, ray.direction, ray.t_min, ray.t_max)
        weight = dr.select(part.valid, Float(1), Float(0))
        if dr.hint(blended, mode="scalar"):
            at = closest_approach(beam, ray.origin, ray.direction)
            radius = dr.fma(beam.slope, at.along, beam.radius)
            boundary, change = need(beam, at, radius, look, ray.t_min, ray.t_max, ray.origin, ray.direction)
            weight *= frustum_weight(boundary, change)
        if weight > 0:
            light = chord_integral(beam, part, look, points, ray.t_min, weight > 0)
            radiance += steady(beam, part, look) * light * weight
        i += 1
    return radiance
