"""Radii of beams from photon differentials (Schjøth et al. 2007; Progressive Photon Beams, Jarosz et al. 2011).

A light path is a function of the four numbers of its emission sample, and so is its position at distance s along a
segment, P(s) = p + s d, whose derivatives are linear in s. N samples of a Sobol sequence fill cells of any aspect, with
N = N_x · N_y over the two pairs of numbers. Cells that are equally wide in both pairs give the least blur. With P_k the
derivatives across the segment,

    r² = (overlap / 2)² · ((|P_0|² + |P_1|²) / (2 N_x) + (|P_2|² + |P_3|²) / (2 N_y)),

which is a quadratic polynomial in s with one minimum, at the focus of a lens. Beams are cut there, because the radius
of a beam is linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ..numerics.structs import Struct
from ..runtime.device import Array3f, Float
from .differentials import RayDifferentials


class Width(Struct):
    """The squared radius of a segment as a polynomial in the distance from its start, a + b s + c s²."""

    a: Float
    b: Float
    c: Float

    def __call__(self, s: Any) -> Any:
        """Return the radius at a distance."""
        return dr.safe_sqrt(dr.fma(dr.fma(self.c, s, self.b), s, self.a))

    def focus(self) -> Any:
        """Return the distance at which the segment is narrowest, which may be before its start or beyond its end."""
        return -0.5 * self.b * dr.rcp(dr.maximum(self.c, 1e-30))


class Limits(NamedTuple):
    """Bounds of radii in scene units, and a factor on radii that shrinks from pass to pass (all opaque)."""

    floor: Any
    ceiling: Any
    scale: Any

    def __call__(self, radius: Any) -> Any:
        """Return a radius clamped to the bounds, times the factor."""
        return dr.clip(radius, self.floor, self.ceiling) * self.scale


@dataclass(frozen=True)
class _Spread:
    """Half the sum of the squares of two derivatives across a segment: a + b s + c s²."""

    a: Any
    b: Any
    c: Any

    @classmethod
    def of(cls, columns: list[tuple[Any, Any]], direction: Array3f) -> _Spread:
        total = [Float(0), Float(0), Float(0)]
        for p, d in columns:
            across, turn = p - direction * dr.dot(p, direction), d - direction * dr.dot(d, direction)
            parts = 0.5 * dr.squared_norm(across), dr.dot(across, turn), 0.5 * dr.squared_norm(turn)
            total = [each + part for each, part in zip(total, parts, strict=True)]
        return cls(*total)

    def __call__(self, s: Any) -> Any:
        return dr.maximum(dr.fma(dr.fma(self.c, s, self.b), s, self.a), 0)


def width(differentials: RayDifferentials, direction: Array3f, length: Float, count: Float, overlap: Float) -> Width:
    """Return the widths of segments of paths that are `count` samples of one sequence.

    `overlap` is the width of a beam in spacings of its neighbours.
    """
    columns = differentials.columns()
    place, aim = _Spread.of(columns[:2], direction), _Spread.of(columns[2:], direction)
    ratio = dr.maximum(place(0), place(length)) * dr.rcp(dr.maximum(dr.maximum(aim(0), aim(length)), 1e-30))
    cells = dr.clip(dr.sqrt(count * ratio), dr.minimum(count, 1), dr.maximum(count, 1))
    half2 = dr.square(0.5 * overlap)
    x, y = half2 * dr.rcp(cells), half2 * cells * dr.rcp(count)
    a, b, c = (x * getattr(place, each) + y * getattr(aim, each) for each in "abc")
    known = dr.isfinite(a + b + c)  # derivatives may be infinite at a grazing angle
    return Width(*(dr.select(known, each, 0) for each in (a, b, c)))
