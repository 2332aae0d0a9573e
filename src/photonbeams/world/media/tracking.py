"""Transmittance through heterogeneous media: residual ratio tracking (Novák et al. 2014), unbiased, with little noise.

A ray's segment in a medium is cut into SEGMENTS pieces. In each piece, two probes give a control c, whose optical depth
is known, and a rate μ, which is about the largest residual |σt − c|. At the points of a Poisson process of that rate,
the estimate is multiplied by 1 − (σt − c) / μ. The product has the mean exp(−∫ σt − c), whatever c and μ are.

A `Track` keeps the estimate for all distances along a ray: the control's optical depth at the ends of pieces, and the
product after each point. Light paths sample free flights instead (delta tracking, Woodcock et al. 1965).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ...looks.context import ShadingContext
from ...looks.factors import Factor
from ...numerics.arrays import channel_mean
from ...numerics.hashing import hash32, unit_float
from ...numerics.syntax import syntax
from ...runtime.device import Array3f, Array4f, Bool, Float, UInt32, mitsuba
from ..spectra import rgb

mi = mitsuba()

SEGMENTS = 32

# Gauss's two points on [0, 1], and the least rate of a piece as a fraction of the majorant: even if both probes find
# nothing, there may be something between them. With 32 pieces and 0.4, the light of a ray through noise on a grid of 8³
# (32³) spreads by 5 % (10 %), at 1.7 points for each ray; with 16 and 0.02, by 34 % (48 %) at 0.1 (0.3) points.
_PROBES = (0.21132486540518713, 0.7886751345948129)
_LEAST = 0.4

#: Returns σt at points: Array3f.
Extinction = Callable[[Any], Any]


@dataclass
class MediumSegment:
    """Segments of rays in a medium, o + t d for t from `near` to `far`, with a majorant and the number of pieces."""

    origin: Any
    direction: Any
    near: Any
    far: Any
    majorant: Any
    seed: Any
    pieces: Any = SEGMENTS


@syntax
def walk(
    segment: MediumSegment, extinction: Extinction, active: Bool, counter: UInt32 | None = None, base: Any = None,
    out: Float | None = None,
) -> Array3f:  # fmt: skip
    """Return the transmittance of rays over their segments.

    Parameters
    ----------
    counter
        (rays,), to which the number of points of each ray is written; or None.
    base, out
        Index of each ray's first point in the list of points, and the list: t and the product after it; or None.
    """
    piece = UInt32(0)
    drawn, points = UInt32(0), UInt32(0)
    depth, product = Array3f(0), Array3f(1)
    pieces = UInt32(segment.pieces)
    step = dr.maximum(segment.far - segment.near, 0) * dr.rcp(Float(pieces))
    going = active & (step > 0)
    while going & (piece < pieces):
        begin = dr.fma(Float(piece), step, segment.near)
        control, rate = _control(segment, extinction, begin, step)
        depth += control * step
        t = begin - dr.log(1 - unit_float(hash32(segment.seed, drawn))) * dr.rcp(rate)
        drawn += 1
        while t < begin + step:
            here = extinction(dr.fma(segment.direction, t, segment.origin))
            product *= 1 - (here - control) * dr.rcp(rate)
            if dr.hint(out is not None, mode="scalar"):
                dr.scatter(out, Array4f(t, product.x, product.y, product.z), base + points)
            points += 1
            t -= dr.log(1 - unit_float(hash32(segment.seed, drawn))) * dr.rcp(rate)
            drawn += 1
        piece += 1
    if dr.hint(counter is not None, mode="scalar"):
        dr.scatter(counter, points, dr.arange(UInt32, dr.width(counter)))
    return product * dr.exp(-depth)


@syntax
def glow(segment: MediumSegment, extinction: Extinction, emission: Extinction, active: Bool) -> Array3f:
    """Return the radiance that a medium emits along rays' segments, an unbiased estimate: ∫ T(t) ε(t) dt.

    In each piece ε is evaluated at one point, at a random distance; the transmittance up to there is that of `walk`.

    Parameters
    ----------
    emission
        Returns the emitted radiance per scene unit, at points: Array3f.
    """
    piece, drawn = UInt32(0), UInt32(0)
    depth, product, result = Array3f(0), Array3f(1), Array3f(0)
    step = dr.maximum(segment.far - segment.near, 0) * (1 / SEGMENTS)
    going = active & (step > 0)
    while going & (piece < SEGMENTS):
        begin = dr.fma(Float(piece), step, segment.near)
        control, rate = _control(segment, extinction, begin, step)
        place = dr.fma(unit_float(hash32(segment.seed, piece, UInt32(1))), step, begin)
        passed = Array3f(product)
        before, product, drawn = _passed(
            segment=segment,
            extinction=extinction,
            begin=begin,
            stop=begin + step,
            place=place,
            control=control,
            rate=rate,
            product=passed,
            drawn=drawn,
        )
        left = passed * before * dr.exp(-depth - control * (place - begin))
        result += step * left * emission(dr.fma(segment.direction, place, segment.origin))
        depth += control * step
        piece += 1
    return result


@syntax
def scattering_point(
    segment: MediumSegment, extinction: Extinction, scattering: Extinction, sample: Float, active: Bool
) -> tuple[Any, Any]:
    """Return a point on each ray's segment at which a medium scatters light toward the ray's origin, and its weight.

    The mean of f(point) · weight is ∫ T(t) σs(t) f(t) dt. Each piece has one point, at a distance with a density
    proportional to exp(−c t), where c is its control. One of the points is chosen, with a probability proportional to
    its contribution (weighted reservoir sampling).

    Parameters
    ----------
    scattering
        Returns σs at points: Array3f.
    sample
        A number in [0, 1) for each ray, by which the point is chosen.
    """
    piece, drawn = UInt32(0), UInt32(0)
    depth, product, weight = Array3f(0), Array3f(1), Array3f(0)
    total, chosen, left = Float(0), Float(0), Float(sample)
    pieces = UInt32(segment.pieces)
    step = dr.maximum(segment.far - segment.near, 0) * dr.rcp(Float(pieces))
    going = active & (step > 0)
    while going & (piece < pieces):
        begin = dr.fma(Float(piece), step, segment.near)
        control, rate = _control(segment, extinction, begin, step)
        # Where both probes find nothing, the control is 0 and the density even.
        even = dr.maximum(channel_mean(control), 1e-4 * rate)
        ending = 1 - dr.exp(-even * step)
        within = -dr.log(1 - unit_float(hash32(segment.seed, piece, UInt32(1))) * ending) * dr.rcp(even)
        place = begin + dr.minimum(within, step)
        passed = Array3f(product)
        before, product, drawn = _passed(
            segment=segment,
            extinction=extinction,
            begin=begin,
            stop=begin + step,
            place=place,
            control=control,
            rate=rate,
            product=passed,
            drawn=drawn,
        )
        here = passed * before * dr.exp(-depth - control * within + even * within)
        here *= scattering(dr.fma(segment.direction, place, segment.origin)) * ending * dr.rcp(even)
        own = dr.abs(channel_mean(here))
        total += own
        taken = left * total < own
        # The same number serves the next choice: given the outcome, it can be rescaled to be uniform in [0, 1) again.
        part = own * dr.rcp(dr.maximum(total, 1e-30))
        left = dr.select(
            taken, left * dr.rcp(dr.maximum(part, 1e-30)), (left - part) * dr.rcp(dr.maximum(1 - part, 1e-7))
        )
        left = dr.clip(left, 0, 1 - 1e-7)
        chosen = dr.select(taken, place, chosen)
        weight = dr.select(taken, here * dr.rcp(dr.maximum(own, 1e-30)), weight)
        depth += control * step
        piece += 1
    return chosen, weight * total


@syntax
def _passed(
    segment: MediumSegment, extinction: Extinction, begin: Float, stop: Float, place: Float, control: Array3f,
    rate: Float, product: Array3f, drawn: UInt32,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Return the product over a piece's points before `place`, `product` times all of them, and the samples drawn."""
    before, product, drawn = Array3f(1), Array3f(product), UInt32(drawn)
    t = begin - dr.log(1 - unit_float(hash32(segment.seed, drawn))) * dr.rcp(rate)
    drawn += 1
    while t < stop:
        factor = 1 - (extinction(dr.fma(segment.direction, t, segment.origin)) - control) * dr.rcp(rate)
        product *= factor
        before *= dr.select(t < place, factor, 1)
        t -= dr.log(1 - unit_float(hash32(segment.seed, drawn))) * dr.rcp(rate)
        drawn += 1
    return before, product, drawn


def _control(segment: MediumSegment, extinction: Extinction, begin: Float, step: Float) -> tuple[Any, Any]:
    """Return a piece's control, and the rate of its points."""
    first, last = (extinction(dr.fma(segment.direction, begin + place * step, segment.origin)) for place in _PROBES)
    rate = dr.maximum(dr.max(dr.abs(first - last)), _LEAST * segment.majorant)
    return 0.5 * (first + last), dr.maximum(rate, 1e-20)


class Track:
    """The transmittance at all distances along rays, which are given by number."""

    def __init__(self, segment: MediumSegment, extinction: Extinction, active: Bool) -> None:
        count = dr.width(segment.direction)
        self._near, self._step = Float(segment.near), dr.maximum(segment.far - segment.near, 0) * (1 / SEGMENTS)
        counter = dr.zeros(UInt32, count)
        dr.eval(walk(segment, extinction, active, counter), counter)
        self._first = dr.prefix_sum(counter)
        self._stop = self._first + counter
        total = int(dr.sum(counter)[0])
        self._points = dr.zeros(Float, 4 * max(total, 1))
        dr.eval(walk(segment, extinction, active, counter, self._first, self._points))
        self._depths = _depths(segment, extinction, active)
        dr.eval(self._near, self._step, self._first, self._stop, self._points, self._depths)

    @syntax
    def __call__(self, ray: UInt32, t: Float) -> Array3f:
        """Return the transmittance of rays up to the distance t."""
        near, step = dr.gather(Float, self._near, ray), dr.gather(Float, self._step, ray)
        x = dr.clip((t - near) * dr.rcp(dr.maximum(step, 1e-30)), 0, SEGMENTS)
        piece = dr.minimum(UInt32(x), SEGMENTS - 1)
        at = ray * (SEGMENTS + 1) + piece
        low, high = dr.gather(Array4f, self._depths, at).xyz, dr.gather(Array4f, self._depths, at + 1).xyz
        depth = dr.lerp(low, high, x - Float(piece))
        first = dr.gather(UInt32, self._first, ray)
        begin, end = UInt32(first), dr.gather(UInt32, self._stop, ray)
        while begin < end:  # the first point beyond t
            middle = (begin + end) // 2
            before = dr.gather(Float, self._points, 4 * middle) < t
            begin, end = dr.select(before, middle + 1, begin), dr.select(before, end, middle)
        passed = begin > first
        last = dr.gather(Array4f, self._points, begin - 1, passed)
        product = dr.select(passed, Array3f(last.y, last.z, last.w), Array3f(1))
        return product * dr.exp(-depth)


@syntax
def _depths(segment: MediumSegment, extinction: Extinction, active: Bool) -> Float:
    """Return the control's optical depth at the ends of pieces, as SEGMENTS + 1 packets for each ray."""
    count = dr.width(segment.direction)
    result = dr.zeros(Float, 4 * (SEGMENTS + 1) * count)
    ray, piece, depth = dr.arange(UInt32, count), UInt32(0), Array3f(0)
    step = dr.maximum(segment.far - segment.near, 0) * (1 / SEGMENTS)
    going = active & (step > 0)
    while going & (piece < SEGMENTS):
        control, _ = _control(segment, extinction, dr.fma(Float(piece), step, segment.near), step)
        depth += control * step
        piece += 1
        dr.scatter(result, Array4f(depth.x, depth.y, depth.z, 0), ray * (SEGMENTS + 1) + piece)
    return result


class Tracked(Factor):
    """The look's factor toward the camera in a heterogeneous medium, from a track of each ray.

    The track is set before beams are gathered. Until then, the factor is the transmittance at the greatest extinction.
    """

    of_rays = True

    def __init__(self, extinction: float) -> None:
        self.track: Track | None = None
        self._extinction = dr.opaque(Float, extinction)

    def evaluate(self, at: ShadingContext) -> Array3f:
        """Return the transmittance; without a track, the one at the greatest extinction."""
        if self.track is None or at.ray is None:
            return dr.exp(-self._extinction * at.depth) * Array3f(1)
        return self.track(at.ray, at.to_camera)


@syntax
def free_flight(
    media: Any, origin: Array3f, direction: Array3f, length: Float, fractions: Array3f, seed: UInt32, active: Bool,
    stops: Bool,
) -> tuple[Any, Any, Any, Any]:  # fmt: skip
    """Return free flights of light through heterogeneous media.

    Parameters
    ----------
    media
        Pointers to the media.
    fractions
        The fraction of the flux in each channel, by which collisions are sampled.
    stops
        Which flights end at each tentative collision. In media with a coloured extinction the colour of the light
        changes there.

    Returns
    -------
    distance, collided, scattered, weight
        Distances; whether flights end in the medium; whether light is scattered there, rather than continuing (a null
        collision); and weights, with those of the null collisions before.
    """
    ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
    inside, enter, leave = media.intersect_aabb(ray)
    end = dr.minimum(leave, length)
    place = dr.zeros(mi.MediumInteraction3f, dr.width(length))
    majorant = dr.max(rgb(media.get_majorant(place, active)))
    t = dr.maximum(enter, 0)
    weight, collided, scattered, drawn = Array3f(1), Bool(False), Bool(False), UInt32(0)
    going = active & inside & (majorant > 0)
    while going:
        t -= dr.log(1 - unit_float(hash32(seed, drawn))) * dr.rcp(majorant)
        if t >= end:
            going = Bool(False)
        else:
            place = dr.zeros(mi.MediumInteraction3f, dr.width(t))
            place.p = mi.Point3f(dr.fma(direction, t, origin))
            sigma_s, _, sigma_t = media.get_scattering_coefficients(place, going)
            sigma_s, sigma_t = rgb(sigma_s), dr.minimum(rgb(sigma_t), majorant)
            left = fractions * weight
            probability = dr.sum(left * sigma_t) * dr.rcp(majorant * dr.maximum(dr.sum(left), 1e-30))
            real = unit_float(hash32(seed, drawn, UInt32(1))) < probability
            there = dr.select(
                real, sigma_s * dr.rcp(majorant * dr.maximum(probability, 1e-20)),
                (majorant - sigma_t) * dr.rcp(majorant * dr.maximum(1 - probability, 1e-20)),
            )  # fmt: skip
            weight *= there
            if real | stops:
                collided, scattered, going = Bool(True), real, Bool(False)
        drawn += 1
    return dr.select(collided, t, length), collided, scattered, weight
