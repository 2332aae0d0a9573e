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

from ..looks.bound_look import BoundLook
from ..looks.factors import Value
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Bool, Float, UInt32
from .blend import change_rate, factors, frustum_weight, need
from .corners import crossings, cut, within
from .geometry import Chord, Rays, chord, closest_approach
from .points import Points
from .records import Packed, Record, load

# Most change of the radius, as a ratio, over one piece of a chord: six points then err by 1e-6 on 1/R². For the change
# of the factors see `BoundLook.change`. That is infinite at a jump: the look limits how often a chord is cut for it.
_RATIO = 3.0
# Least piece of a chord in a pointed cone.
_NARROWEST = 1e-7
# Most optical depth of the first piece of a chord, and of the last: six points then err by 1e-5.
_DEPTH = 8.0


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


def _lit(ray: Chord, look: BoundLook) -> tuple[Float, Float]:
    """Return the part of a chord on which the profile is not dark."""
    if look.profile.support == 1:
        return ray.a, ray.b
    first, last = within(look.profile.edge, ray)
    return dr.clip(first, ray.a, ray.b), dr.clip(last, ray.a, ray.b)


@syntax
def chord_integral(beam: Record, ray: Chord, look: BoundLook, points: Points, camera: Rays, active: Bool) -> Array3f:
    """Return ∫ k2 · along · eye over the chord, piece by piece between corners (Talk, eq. 2)."""
    total = Array3f(0)
    begin, end = _lit(ray, look)
    low, end = Float(begin), dr.select(active, end, begin)
    edges = crossings(beam, ray, look)
    nearest = [each.first() for each in edges]
    cosine, length, growth = dr.abs(ray.cosine), end - begin, ray.growth
    rate = change_rate(beam, cosine, look)
    rate_across = look.rate_radius * dr.sqrt(ray.sin2)
    shortest = length * dr.rcp(look.cuts)
    thin = _DEPTH * dr.rcp(dr.maximum(dr.fma(cosine, look.decay_along, look.decay_eye), 1e-20))
    spread = dr.select(growth > 0, _RATIO - 1, 1 - 1 / _RATIO) * dr.rcp(dr.maximum(dr.abs(growth), 1e-20))
    while low < end:
        radius = dr.fma(beam.slope, ray.along(low), beam.radius)
        inv_radius = dr.rcp(dr.maximum(radius, 1e-12))
        steady = look.change * dr.rcp(dr.maximum(dr.fma(rate_across, inv_radius, rate), 1e-20))
        # What decays matters at one end of the chord: pieces may be as long as their distance from both.
        fading = dr.maximum(thin, dr.minimum(low - begin, 0.5 * (end - low)))
        narrow = dr.maximum(spread * radius, _NARROWEST * length)
        longest = dr.minimum(dr.minimum(dr.maximum(steady, shortest), fading), narrow)
        # A piece of almost all the rest takes the whole rest, or rounding would leave a sliver. If the piece is so
        # short that it rounds to nothing, it takes the rest as well, or the loop would never end.
        high = low + longest
        high = dr.select((end - low > 1.01 * longest) & (high > low), high, end)
        nearest, high = cut(edges, nearest, low, high)
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
        boundary, change = need(beam, at, radius, look, ray)
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
