"""Samples of walks through fog toward a small lamp, around which the fog is bright.

Fog is lit as 1/d² at the distance d from a small lamp. With free flights, and directions by the phase function or BSDF
alone, the variance of walks is inversely proportional to the lamp's radius. Two densities end that. Along a segment at
the distance D from the lamp, with t from where it comes closest, the light of a place is as D / (D² + t²) (Kulla and
Fajardo 2012, "Importance sampling techniques for path tracing in participating media"). A ray with the angle x to the
lamp gathers ∫ 1/d² dt, which is as (π − x) / sin x (Georgiev et al. 2013, "Joint importance sampling of low-order
volumetric scattering"). Each shares its samples with the usual density, by the balance heuristic (Veach 1997).
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np
import numpy.typing as npt

from ...numerics.arrays import to_float, to_numpy
from ...numerics.sampling import pixel_sample
from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Array4f, Bool, Float, UInt32
from ...world.bounds import Bounds
from ...world.media.media import Media
from ...world.warp import perpendicular
from .walk_vertices import DirectionSample


class Ball(Struct):
    """Spheres around lamps; `near` says whether lamps have one, rather than shine from infinity."""

    center: Array3f
    radius: Float
    near: Bool


# Places of each emitter that its sphere goes around.
_PLACES = 32


def around(bounds: Bounds, count: int) -> tuple[UInt32, Array3f, Array2f]:
    """Return the numbers of `count` emitters, places around a scene from which they are seen, and sample points."""
    lane = dr.arange(UInt32, _PLACES * count)
    corner = Array3f(lane & 1, (lane >> 1) & 1, (lane >> 2) & 1) * 2 - 1
    place = Array3f(bounds.center) + corner * bounds.radius
    return lane // dr.opaque(UInt32, _PLACES), place, pixel_sample(lane, dr.opaque(UInt32, 1))


class Balls:
    """Spheres around emitters, by their numbers.

    Parameters
    ----------
    points
        (N, M, 3) places of each emitter, which are not finite if it has none.
    """

    def __init__(self, points: npt.NDArray[np.float64]) -> None:
        low, high = points.min(axis=1), points.max(axis=1)
        with np.errstate(invalid="ignore"):
            center, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)
        packed = np.column_stack([center, radius])
        finite = np.isfinite(packed).all(axis=1, keepdims=True)
        self._packed = to_float(np.where(finite, packed, [0.0, 0.0, 0.0, -1.0]).ravel())

    @classmethod
    def of(cls, places: Array3f, count: int) -> Balls:
        """Return the spheres around `count` emitters from their places, as `around` numbers them."""
        return cls(to_numpy(places).T.reshape(count, _PLACES, 3))

    def __call__(self, number: UInt32, active: Bool) -> Ball:
        """Return the spheres around emitters."""
        ball = dr.gather(Array4f, self._packed, number, active)
        return Ball(Array3f(ball.xyz), dr.maximum(ball.w, 0), active & (ball.w >= 0))


class Equiangular:
    """Distances along segments of rays, dense where these pass a lamp.

    p(t) = D / ((b − a) (D² + (t − c)²)), where c is the place closest to the lamp's centre, D² its squared distance
    plus the squared radius, and a and b are the angles to the ends of the segment.
    """

    def __init__(self, origin: Array3f, direction: Array3f, length: Float, ball: Ball) -> None:
        to = ball.center - origin
        self._closest = dr.dot(to, direction)
        across = dr.squared_norm(to - self._closest * direction) + dr.square(ball.radius)
        self.distance = dr.sqrt(dr.maximum(across, 1e-12))
        self._first = dr.atan2(-self._closest, self.distance)
        self._last = dr.atan2(length - self._closest, self.distance)
        self._length = length

    def sample(self, u: Float) -> Float:
        """Return a distance, for u in [0, 1)."""
        t = self._closest + self.distance * dr.tan(dr.lerp(self._first, self._last, u))
        return dr.clip(t, 0, self._length * (1 - 1e-6))

    def density(self, t: Float) -> Float:
        """Return the density of a distance."""
        squared = dr.square(self.distance) + dr.square(t - self._closest)
        return self.distance * dr.rcp(dr.maximum(self._last - self._first, 1e-9) * squared)


class Toward:
    """Directions from places toward lamps: p(ω) = (π − x) / (π³ sin x), where x is the angle to the lamp."""

    def __init__(self, place: Array3f, ball: Ball) -> None:
        to = ball.center - place
        distance = dr.norm(to)
        self._axis = dr.select(distance > 1e-20, to * dr.rcp(distance), Array3f(0, 0, 1))
        self.distance = distance

    def sample(self, u: Array2f) -> Array3f:
        """Return a direction, for a point of the unit square."""
        sine, cosine = dr.sincos(dr.pi * (1 - dr.safe_sqrt(1 - u.x)))
        up, side = dr.sincos(2 * dr.pi * u.y)
        s, t = perpendicular(self._axis)
        return cosine * self._axis + sine * (side * s + up * t)

    def density(self, direction: Array3f) -> Float:
        """Return the density of a direction per solid angle."""
        sine, cosine = dr.norm(dr.cross(self._axis, direction)), dr.dot(self._axis, direction)
        return (dr.pi - dr.atan2(sine, cosine)) * dr.rcp(dr.pi**3 * dr.maximum(sine, 1e-6))

    def part(self, extinction: Float) -> Float:
        """Return which part of the directions should go there: at most a half, at an optical depth of 1.

        Through thin fog, what surfaces bring counts for more; through thick fog, no light of the lamp arrives.
        """
        depth = dr.minimum(extinction * self.distance, 80)
        return 0.5 * depth * dr.exp(1 - depth)


def aimed(
    media: Media, medium: UInt32, toward: Toward, near: Bool, plain: DirectionSample, pick: Float, u: Array2f,
    evaluate: Callable[[Array3f, Bool], tuple[Array3f, Float]],
) -> DirectionSample:  # fmt: skip
    """Return samples of which some go toward lamps, if media scatter light before them.

    Parameters
    ----------
    media, medium
        The media, and those in which the samples begin.
    toward, near
        The directions to lamps, and which of these there are.
    plain
        Samples of phase functions or BSDFs.
    pick, u
        Numbers and points that choose between both, and that choose a direction.
    evaluate
        Function of directions, and of whether they are needed, that returns the phase function or BSDF times cosine,
        and the density of `plain`.
    """
    hazy = dr.max(media.scattering(medium)) > 0
    part = dr.select(near & hazy, toward.part(media.mean_extinction(medium)), 0)
    other, going = toward.sample(u), pick < part
    value, pdf = evaluate(other, going)
    own = (1 - part) * plain.pdf + part * toward.density(plain.direction)
    weight = dr.select(plain.ideal, plain.weight * dr.rcp(1 - part), plain.value * dr.rcp(dr.maximum(own, 1e-30)))
    mixed = (1 - part) * pdf + part * toward.density(other)
    there = DirectionSample(other, value, value * dr.rcp(dr.maximum(mixed, 1e-30)), pdf, Bool(False), Bool(False))
    weight = dr.select(plain.pdf > 0, weight, 0)
    rest = DirectionSample(plain.direction, plain.value, weight, plain.pdf, plain.ideal, plain.null)
    result: DirectionSample = dr.select(going, there, rest)
    return result
