"""The integral of a beam along a ray in long double, adaptive: written from the definition, without any of the kernels.

    L = Φ ∫ density(ρ) / R² · along(s) · eye(t) dt,  R = r0 + k s,  ρ = |e⊥| / R

over the part of the ray in the truncated cone, found as the roots of |e⊥|² = R² (Talk, equation 2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

_LONG = np.longdouble
_FEW, _MANY = (np.polynomial.legendre.leggauss(count) for count in (8, 15))
_HALVINGS = 48
_MOST_PIECES = 3000
_ACCURACY = 1e-9  # of the integral


@dataclass(frozen=True)
class Cone:
    """A truncated cone of light."""

    start: Array  # (3,)
    end: Array  # (3,)
    radius_start: float
    radius_end: float

    @property
    def length(self) -> np.longdouble:
        """Length of the axis."""
        return np.sqrt(np.sum(np.square(np.asarray(self.end, _LONG) - np.asarray(self.start, _LONG))))


@dataclass(frozen=True)
class Factors:
    """The factors of a look as NumPy functions, and where they are not smooth."""

    density: Callable[[Array], Array]  # of ρ, normalised: (M, 1) or (M, 3)
    along: Callable[[Array], Array]  # of s / length: (M, 3)
    eye: Callable[[Array], Array]  # of t: (M, 3)
    rings: Sequence[float] = ()  # values of ρ
    knots: Sequence[float] = ()  # values of s / length
    eye_knots: Sequence[float] = ()  # values of t


def radiance(cone: Cone, factors: Factors, origin: Array, direction: Array) -> Array:
    """Return the radiance (3,) of a beam of power 1 toward a ray from its origin on."""
    start, axis = np.asarray(cone.start, _LONG), np.asarray(cone.end, _LONG) - np.asarray(cone.start, _LONG)
    length = cone.length
    axis = axis / length
    way = np.asarray(direction, _LONG)
    way = way / np.sqrt(way @ way)
    relative = np.asarray(origin, _LONG) - start
    slope = (_LONG(cone.radius_end) - _LONG(cone.radius_start)) / length
    cosine, place = way @ axis, relative @ axis
    across, turn = relative - place * axis, way - cosine * axis
    sin2, drift, offset2 = turn @ turn, across @ turn, across @ across

    def quadratic(ring: float) -> tuple[Any, Any, Any]:
        """Return A, B, C of |e⊥|² − ring² R² = A t² + 2 B t + C."""
        growth, radius = ring * slope * cosine, ring * (_LONG(cone.radius_start) + slope * place)
        return sin2 - growth**2, drift - growth * radius, offset2 - radius**2

    def crossings(ring: float) -> list[Any]:
        A, B, C = quadratic(ring)
        if ring == 0 or B * B < A * C:
            return [-drift / sin2] if ring == 0 and sin2 > 0 else []
        q = -(B + np.copysign(np.sqrt(B * B - A * C), B))
        return [each for each, valid in ((q / A if A else 0, A != 0), (C / q if q else 0, q != 0)) if valid]

    def planes(places: Sequence[float]) -> list[Any]:
        return [] if cosine == 0 else [(_LONG(each) * length - place) / cosine for each in places]

    ends = planes((0.0, 1.0))
    low, high = (max(min(ends), _LONG(0)), max(ends)) if ends else (_LONG(0), _LONG(1e30))
    if not low < high or (not ends and not 0 <= place <= length):
        return np.zeros(3)
    edges = sorted({low, high, *(each for each in crossings(1.0) if low < each < high)})
    A, B, C = quadratic(1.0)
    total = np.zeros(3)
    breaks = planes(factors.knots) + [_LONG(each) for each in factors.eye_knots]
    breaks += [each for ring in factors.rings for each in crossings(ring)]

    def integrand(base: Any, tau: Array) -> Array:
        # `tau` counts from `base`, so that float64 resolves it.
        s = np.float64(place + cosine * base) + np.float64(cosine) * tau
        radius = cone.radius_start + np.float64(slope) * s
        squared = np.float64(offset2 + base * (2 * drift + sin2 * base)) + tau * (
            np.float64(2 * (drift + sin2 * base)) + np.float64(sin2) * tau
        )
        rho = np.sqrt(np.clip(squared / radius**2, 0, 1))
        light = factors.along(s / np.float64(length)) * factors.eye(np.float64(base) + tau)
        return light * factors.density(rho) / (radius**2)[:, None]

    for first, last in pairwise(edges):
        middle = (first + last) / 2
        inside = A * middle**2 + 2 * B * middle + C <= 0
        if not inside or _LONG(cone.radius_start) + slope * (place + cosine * middle) <= 0:
            continue
        base = min(max(-drift / sin2, first), last) if sin2 > 0 else first
        cuts = sorted({first, last, base, *(each for each in breaks if first < each < last)})
        total += _adaptive(lambda tau, base=base: integrand(base, tau), np.array([float(each - base) for each in cuts]))
    return total


def _adaptive(function: Callable[[Array], Array], cuts: Array) -> Array:
    """Return the integral of a function (M,) → (M, 3), halving pieces until two rules agree."""
    even = np.linspace(0, 1, 7)[:-1]
    low, high = cuts[:-1], cuts[1:]
    edges = np.append((low[:, None] + (high - low)[:, None] * even).ravel(), cuts[-1])
    low, high, total = edges[:-1], edges[1:], np.zeros(3)
    for _ in range(_HALVINGS):
        if not len(low):
            break
        half, middle = 0.5 * (high - low), 0.5 * (high + low)

        def by(rule: tuple[Array, Array], half: Array = half, middle: Array = middle) -> Array:
            nodes, weights = rule
            values = function((middle[:, None] + half[:, None] * nodes).ravel()).reshape(len(half), len(nodes), 3)
            return np.einsum("nkc,k->nc", values, weights) * half[:, None]

        coarse, fine = by(_FEW), by(_MANY)
        sure = np.abs(total + fine.sum(axis=0)).max() * _ACCURACY
        done = (np.abs(coarse - fine).max(axis=1) <= sure / len(low)) | (half <= 1e-15 * np.abs(middle))
        if len(low) > _MOST_PIECES:
            done[:] = True
        total = total + fine[done].sum(axis=0)
        low, high, middle = low[~done], high[~done], middle[~done]
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return total
