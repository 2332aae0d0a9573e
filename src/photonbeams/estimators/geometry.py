"""Geometry of a camera ray and a beam: closest approach, ray ∩ truncated cone.

With unit ray direction d, unit axis w, c = d·w and e = start − o:

    sin² = 1 − c²,  s = (c (d·e) − w·e)/sin²,  t = (d·e − c (w·e))/sin²,  u² = (d·(w × e))²/sin²

s and t are the parameters of closest approach along the beam and along the ray, u the distance between the lines.
Inside the cone R(s) = r0 + k s, measured from the ray parameter t0, with e⊥ the offset from the axis there:

    A τ² + 2B τ + C ≤ 0,  A = sin² − k²c²,  B = e⊥·d − k c R(s0),  C = |e⊥|² − R(s0)²

A piece of a curve lies between two planes, perpendicular to the light's directions T0 and T1 at its ends, which it
shares with the pieces before and after it. A point x at p = x − start has these distances from them, along the axis:

    a = p·T0 / (w·T0),  b = length − p·T1 / (w·T1)

and u = a / (a + b), which is 0 on the first plane and 1 on the second, replaces s / length in radius, falloff, power
and direction. On the plane between two pieces all of these agree, so that no joint is visible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from ..numerics.arrays import taken
from ..numerics.given import Number
from ..runtime.device import Array3f, Bool, Float, UInt32
from .records import Record


@dataclass
class Rays:
    """Camera rays o + t d with d of unit length, for t from t_min to t_max.

    `shared_origin` says that all rays have one origin (a pinhole): what depends only on beam and origin is then
    computed once for each beam. The medium begins at `t_min`, from which the eye factor counts. `time` is 0 at shutter
    open and 1 at shutter close, for beams that move.
    """

    origin: Any  # (N, 3)
    direction: Any  # (N, 3)
    t_max: Any  # (N,)
    t_min: Any = None  # (N,), None: 0
    shared_origin: bool = False
    time: Any = None  # (N,)
    base: Any = None  # the packed origin: that of all rays, or the one that `origin` is relative to; None: the world's
    index: Any = None  # (N,) numbers of the rays, for looks with data for each ray

    def point(self, t: Float) -> Array3f:
        """Return the position in world space at t."""
        point = self.direction * t
        if self.origin is not None:
            point = point + self.origin
        return point if self.base is None else point + self.base

    def taken(self, lanes: UInt32) -> Rays:
        """Return some of the rays."""
        names = ("origin", "direction", "t_max", "t_min", "time", "index")
        own = {name: taken(getattr(self, name), lanes) for name in names}
        dr.eval(own)
        return replace(self, **own)


@dataclass
class LinePair:
    """How a ray passes a beam's axis, computed without a division: enough to decide whether they meet."""

    cosine: Any  # c = d·w
    sin2: Any
    along: Any  # d·e
    reach: Any  # w·e
    s_sin2: Any  # s sin²
    u2_sin2: Any  # u² sin²

    def meets(self, beam: Record) -> Bool:
        """Return whether the ray, endless both ways, meets the endless cone of which the beam is a part.

        The exact condition is u² (sin² − k²c²) < sin² R(s)², here multiplied by sin². A piece of a curve is replaced by
        the cylinder around it.
        """
        if beam.bend is not None:
            return self.u2_sin2 < self.sin2 * dr.square(beam.reaching)
        taper = beam.slope * self.cosine
        radius_sin2 = dr.fma(beam.slope, self.s_sin2, beam.radius * self.sin2)
        return self.u2_sin2 * dr.fma(-taper, taper, self.sin2) < dr.square(radius_sin2)

    def closest(self, beam: Record, origin: Array3f | None, direction: Array3f) -> ClosestApproach:
        """Return where the two lines come closest."""
        inv_sine = dr.rsqrt(self.sin2)
        inv = dr.square(inv_sine)
        t = dr.fma(-self.cosine, self.reach, self.along) * inv
        at = ClosestApproach(self.cosine, self.sin2, inv_sine, self.s_sin2 * inv, t, self.u2_sin2 * inv)
        if beam.bend is not None:
            relative = beam.start if origin is None else beam.start - origin
            at.course = course(beam, dr.fma(direction, t, -relative), direction)
        return at


@dataclass
class ClosestApproach:
    """Where a ray and a beam's axis come closest."""

    cosine: Any  # c = d·w
    sin2: Any
    inv_sine: Any
    s: Any  # along the beam, from its start
    t: Any  # along the ray
    u2: Any  # squared distance between the lines
    course: Any = None  # of a piece of a curve, from there

    @property
    def along(self) -> Float:
        """Distance from the beam's start that determines radius and falloff."""
        return self.s if self.course is None else self.course.along(Float(0))

    def taper(self, beam: Record) -> Float:
        """Return how fast the radius changes along the ray."""
        return beam.slope * (self.cosine if self.course is None else self.course.rate())


@dataclass
class Course:
    """How a ray runs between the two planes of a piece of a curve, τ from a point of the ray; a and b as above."""

    a: Any
    a_rate: Any
    b: Any
    b_rate: Any
    length: Any
    first: Any  # d·T0
    last: Any  # d·T1
    twist: Any  # 1 − T0·T1

    def fraction(self, tau: Float) -> Float:
        """Return u at τ, valid from the first plane to the last one or, if it is farther, to a surface."""
        a, b = self.at(tau)
        return dr.clip(a * dr.rcp(self._span(a + b)), 0, 2)

    def at(self, tau: Float) -> tuple[Float, Float]:
        """Return a and b at τ."""
        return dr.fma(self.a_rate, tau, self.a), dr.fma(self.b_rate, tau, self.b)

    def _span(self, span: Float) -> Float:
        # If a bend is tighter than the beam is wide, there is no beam beyond the line where the planes meet.
        return dr.maximum(span, 1e-6 * self.length)

    def along(self, tau: Float) -> Float:
        """Return the distance from the start at τ, u · length."""
        return self.fraction(tau) * self.length

    def rate(self) -> Float:
        """Return how fast `along` changes at τ = 0."""
        span = self._span(self.a + self.b)
        return self.length * dr.fma(self.a_rate, self.b, -(self.a * self.b_rate)) * dr.rcp(dr.square(span))

    def where(self, distance: Float) -> Float:
        """Return the τ at which `along` has this value."""
        rate = dr.fma(self.length, self.a_rate, -distance * (self.a_rate + self.b_rate))
        rest = dr.fma(distance, self.a + self.b, -self.length * self.a)
        return rest * dr.rcp(dr.select(dr.abs(rate) < 1e-6 * self.length, 1e-6 * self.length, rate))

    def cosine(self, tau: Float) -> Float:
        """Return the cosine between the ray and the light's direction at τ, which turns from T0 to T1."""
        u = self.fraction(tau)
        squared = dr.fma(-2 * u * (1 - u), self.twist, 1)
        return dr.fma(u, self.last - self.first, self.first) * dr.rsqrt(dr.maximum(squared, 1e-6))


def course(beam: Record, point: Array3f, direction: Array3f) -> Course:
    """Return how a ray runs along a piece of a curve, from a point relative to the piece's start."""
    bend = beam.bend
    first, last = dr.dot(direction, bend.first), dr.dot(direction, bend.last)
    a = dr.dot(point, bend.first) * bend.first_inv
    b = dr.fma(-dr.dot(point, bend.last), bend.last_inv, beam.length)
    return Course(
        a=a,
        a_rate=first * bend.first_inv,
        b=b,
        b_rate=-last * bend.last_inv,
        length=beam.length,
        first=first,
        last=last,
        twist=bend.twist,
    )


# The least sin² between lines: along the axis, rounding may take the cosine beyond 1.
_PARALLEL = 1e-7


def passing(beam: Record, origin: Array3f | None, direction: Array3f) -> LinePair:
    """Return how a ray passes a beam; `origin` is relative to the packed origin, or None if that is shared."""
    if beam.moment is not None:
        relative, moment, reach = beam.start, beam.moment, beam.reach
    else:
        relative = beam.start if origin is None else beam.start - origin
        moment, reach = dr.cross(beam.axis, relative), dr.dot(beam.axis, relative)
    c, along = dr.dot(direction, beam.axis), dr.dot(direction, relative)
    sin2 = dr.maximum(dr.fma(-c, c, 1), _PARALLEL)
    return LinePair(c, sin2, along, reach, dr.fma(c, along, -reach), dr.square(dr.dot(direction, moment)))


def closest_approach(beam: Record, origin: Array3f | None, direction: Array3f) -> ClosestApproach:
    """Return where a ray and a beam's axis come closest; `origin` as for `passing`."""
    return passing(beam, origin, direction).closest(beam, origin, direction)


@dataclass
class Chord:
    """The part of a ray inside a beam: τ in [a, b], counted from the ray parameter `t`; empty unless `valid`."""

    valid: Any
    a: Any
    b: Any
    t: Any
    s: Any  # along the beam at τ = 0
    cosine: Any
    sin2: Any
    offset2: Any  # |e⊥|² at τ = 0
    drift: Any  # e⊥·d at τ = 0
    radius: Any  # R at τ = 0, and its change with τ; for a piece of a curve, of the cone that fits the chord
    growth: Any
    course: Any = None  # of a piece of a curve

    def along(self, tau: Float) -> Float:
        """Return the distance along the beam at τ."""
        return dr.fma(self.cosine, tau, self.s) if self.course is None else self.course.along(tau)

    def radius2(self, tau: Float) -> Float:
        """Return the squared distance from the axis at τ."""
        return dr.maximum(dr.fma(dr.fma(self.sin2, tau, 2 * self.drift), tau, self.offset2), 0)


_HUGE = 1e30


def chord(beam: Record, origin: Array3f | None, direction: Array3f, t_min: Float, t_max: Float) -> Chord:
    """Intersect a ray with a truncated cone.

    This is valid from everywhere: beside the beam, inside it, behind its ends, on its axis and along it in either
    direction. The cone is intersected from a point of the ray near the beam, where all numbers are of the beam's size,
    not from the camera, where float32 would cancel.
    """
    relative = beam.start if origin is None else beam.start - origin
    c = dr.dot(direction, beam.axis)
    # One vector gives both sin² and the drift: the distance from the axis is then that of one line, whatever the
    # rounding of the vector.
    turn = dr.fma(beam.axis, -c, direction)
    sin2 = dr.squared_norm(turn)
    reach = dr.dot(beam.axis, relative)
    low, high = _slab(beam, origin, direction, c, reach)
    low, high = dr.maximum(low, t_min), dr.minimum(high, t_max)
    # Where (distance from the axis)² + R² is least: near a cylinder's axis, near a cone's tip. From there, no term of
    # the quadratic is greater than twice the square of a radius on the chord.
    growth = beam.slope * c
    least = dr.fma(growth, growth, sin2)
    toward = dr.fma(-growth, dr.fma(-beam.slope, reach, beam.radius), dr.dot(relative, turn))
    nearest = toward / dr.maximum(least, 1e-12)
    t = dr.maximum(dr.minimum(nearest, high), low)
    point = dr.fma(direction, t, -relative)
    s = dr.dot(point, beam.axis)
    across = dr.fma(beam.axis, -s, point)
    bend = None if beam.bend is None else course(beam, point, direction)
    radius = dr.fma(beam.slope, s if bend is None else bend.along(Float(0)), beam.radius)
    slope_c = growth if bend is None else beam.slope * bend.rate()
    drift, offset2 = dr.dot(across, turn), dr.squared_norm(across)

    def inside(radius: Float, slope_c: Float) -> tuple[Float, Float]:
        first, last = inside_cone(
            dr.fma(-slope_c, slope_c, sin2), dr.fma(-slope_c, radius, drift), dr.fma(-radius, radius, offset2), slope_c
        )
        return dr.maximum(first, low - t), dr.minimum(last, high - t)

    a, b = inside(radius, slope_c)
    if bend is not None:
        for _ in range(_REFINEMENTS):
            radius, slope_c = _secant(beam, bend, a, b, radius, slope_c)
            a, b = inside(radius, slope_c)
    # A slanted surface may cut a cone beyond its tip; what lies there between the walls is no light.
    valid = (a < b) & (low < high) & (dr.fma(slope_c, 0.5 * (a + b), radius) > 0)
    return Chord(
        valid=valid,
        a=a,
        b=b,
        t=t,
        s=s,
        cosine=c,
        sin2=sin2,
        offset2=offset2,
        drift=drift,
        radius=radius,
        growth=slope_c,
        course=bend,
    )


# Along a ray, the radius of a tapered piece of a curve is not linear, and its wall is not a cone. The chord is that of
# the cone with the piece's radii at both ends of the chord. It is found by secant steps, each of which squares the
# error.
_REFINEMENTS = 3


def _secant(beam: Record, bend: Course, a: Float, b: Float, radius: Float, growth: Float) -> tuple[Float, Float]:
    """Return radius at τ = 0 and growth of the cone through a chord's ends; unchanged if the chord is empty."""
    at_a, at_b = (dr.fma(beam.slope, bend.along(each), beam.radius) for each in (a, b))
    wide = b - a > 1e-6 * beam.length
    found = (at_b - at_a) * dr.rcp(dr.select(wide, b - a, 1))
    growth = dr.select(wide, found, growth)
    return dr.select(wide, dr.fma(-growth, a, at_a), radius), growth


def _slab(beam: Record, origin: Array3f | None, direction: Array3f, c: Float, reach: Float) -> tuple[Float, Float]:
    """Return the ray interval between a beam's two ends: planes across the axis, or the plane of its last surface."""
    low, high = between(c, reach + beam.begin, reach + beam.stop)
    joints: list[tuple[Any, Any]] = []
    if beam.bend is not None:
        joints.append((beam.bend.first, beam.bend.first_height))
        if beam.cap is None:
            joints.append((-beam.bend.last, -beam.bend.last_height))
    planes = beam.planes(origin)
    planes += [(normal, far if origin is None else far - dr.dot(origin, normal)) for normal, far in joints]
    for normal, height in planes:
        cut_low, cut_high = between(dr.dot(direction, normal), height, _HUGE)
        low, high = dr.maximum(low, cut_low), dr.minimum(high, cut_high)
    return low, high


def between(rate: Float, low: Float, high: Number) -> tuple[Any, Any]:
    """Return the t for which low ≤ rate · t ≤ high; an empty interval is returned reversed."""
    flat = dr.abs(rate) < 1e-9
    inv = dr.rcp(dr.select(flat, 1, rate))
    t0, t1 = low * inv, high * inv
    inside = (low <= 0) & (high >= 0)
    return (
        dr.select(flat, dr.select(inside, -_HUGE, _HUGE), dr.minimum(t0, t1)),
        dr.select(flat, dr.select(inside, _HUGE, -_HUGE), dr.maximum(t0, t1)),
    )


def inside_cone(A: Float, B: Any, C: Float, slope_c: Float) -> tuple[Float, Float]:
    """Return the interval of A τ² + 2B τ + C ≤ 0 on the nappe of positive radius.

    With A < 0 the ray runs along the axis within the cone's opening; the inside is then outside of the two roots, on
    the side toward which the radius grows. In the stable form of the roots, A → 0 sends one of them to infinity.
    """
    disc = dr.fma(B, B, -A * C)
    q = -(B + dr.copysign(dr.sqrt(dr.maximum(disc, 0)), B))
    q = dr.select(dr.abs(q) < 1e-30, dr.copysign(1e-30, q), q)
    r0, r1 = q / dr.select(dr.abs(A) < 1e-30, dr.copysign(1e-30, A), A), C / q
    low, high = dr.minimum(r0, r1), dr.maximum(r0, r1)
    outer, miss = A < 0, disc < 0
    first = dr.select(outer, dr.select(miss | (slope_c < 0), -_HUGE, high), dr.select(miss, _HUGE, low))
    last = dr.select(outer, dr.select(miss | (slope_c > 0), _HUGE, low), dr.select(miss, -_HUGE, high))
    return first, last
