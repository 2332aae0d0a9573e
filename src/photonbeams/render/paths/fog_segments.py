"""The place at which a walk's segment through media gathers a lamp, and what that leaves to the end of its flight.

Light of a lamp that is scattered at the distance t has the weight w(t) at that place, and 1 − w(t) at the flight's end.
With the density of equiangular distances p_e, that of flights p_f, and its part α of a mixture,

    q(t) = α p_e(t) + (1 − α) p_f(t),    α = 1 / (1 + σt D)

In homogeneous media the place has the density q, and w = 1. In media that vary no density of flights is known. There
the place has the density p_e, and w = α p_e / q, with σt(t) exp(−σ t) for p_f, where σ is the medium's mean extinction.
Right in the mean is any p_f that is a function of the place alone; a good one lowers the noise.
"""

from __future__ import annotations

import drjit as dr

from ...runtime.device import Array2f, Array3f, Float, UInt32
from ...transport.interactions import SCATTERED, flight, scattering_density
from ...world.media.media import Media
from .toward_lamps import Ball, Equiangular
from .walk_vertices import Walk

# The optical depth from which on the guessed density of flights is constant, so that it is never 0.
_DEEPEST = 40.0


class FogSegment:
    """The segments of walks in their media, up to a length, each with a ball around its lamp."""

    def __init__(self, media: Media, walk: Walk, length: Float, ball: Ball) -> None:
        self._media, self._walk = media, walk
        self._begin, end = media.extent(walk.medium, walk.origin, walk.direction, length)
        self._length, self._mean = end - self._begin, media.mean_extinction(walk.medium)
        self._equiangular = Equiangular(walk.origin + self._begin * walk.direction, walk.direction, self._length, ball)
        self._fractions = walk.throughput * dr.rcp(dr.maximum(dr.sum(walk.throughput), 1e-30))
        self._varying, _ = media.varying(walk.medium)
        # Equiangular distances are dense where the lamp is near, flights where the fog is still seen.
        self._part = dr.select(ball.near, dr.rcp(1 + self._mean * self._equiangular.distance), 0)

    def sample(self, u: Array2f, flown: Array2f) -> tuple[Float, Array3f]:
        """Return the distance of a place, and σs there times its weight over its density; `flown` are for flights."""
        walk, part = self._walk, self._part
        free, _ = flight(self._media, walk.medium, UInt32(SCATTERED), self._fractions, self._length, flown)
        t = dr.select(self._varying | (u.x < part), self._equiangular.sample(u.y), free)
        scattering, extinction = self._coefficients(t)
        mixed = self._flights(t, extinction) + part * self._equiangular.density(t)
        weight = dr.select(self._varying, part, 1) * dr.rcp(dr.maximum(mixed, 1e-30))
        return self._begin + t, dr.select(self._length > 0, scattering * weight, 0)

    def left(self, distance: Float) -> Float:
        """Return the weight of the light at the end of flights: 1 − w, and 0 in homogeneous media."""
        t = dr.clip(distance - self._begin, 0, self._length)
        flights = self._flights(t, self._coefficients(t)[1])
        mixed = flights + self._part * self._equiangular.density(t)
        return dr.select(self._varying, flights * dr.rcp(dr.maximum(mixed, 1e-30)), 0)

    def _coefficients(self, t: Float) -> tuple[Array3f, Array3f]:
        walk = self._walk
        return self._media.coefficients(walk.medium, walk.origin + (self._begin + t) * walk.direction)

    def _flights(self, t: Float, extinction: Array3f) -> Float:
        """Return (1 − α) p_f."""
        even = scattering_density(self._media, self._walk.medium, self._fractions, self._length, t)
        guess = dr.dot(self._fractions, extinction) * dr.exp(-dr.minimum(self._mean * t, _DEEPEST))
        return (1 - self._part) * dr.select(self._varying, guess, even)
