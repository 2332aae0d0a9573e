"""Radii of beams from photon differentials (Schjøth et al. 2007; Progressive Photon Beams, Jarosz et al. 2011).

A light path is a function of the four numbers of its emission sample, and so is its position at distance s along a
segment, P(s) = p + s d, whose derivatives are linear in s. N samples of a Sobol sequence fill cells of any aspect, with
N = N_x · N_y over the two pairs of numbers. Cells that are equally wide in both pairs give the least blur. With P_k the
derivatives across the segment,

    r² = (overlap / 2)² · ((|P_0|² + |P_1|²) / (2 N_x) + (|P_2|² + |P_3|²) / (2 N_y)),

which is a quadratic polynomial in s with one minimum, at the focus of a lens. Beams are cut there, because the radius
of a beam is linear. The width of light straight from a lamp does not depend on what it meets: if beams that an edge
stops were narrower than those beside them, a line would be seen along the shaft.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.structs import Struct
from ...runtime.device import Array3f, Float
from ...world.differentials import RayDifferentials

if TYPE_CHECKING:
    from ...numerics.given import Number


class Width(Struct):
    """The radius along a segment: linear before a knot, the focus or the portal, and linear behind it.

    `radius` is the radius at the distance `knot`; `before` and `behind` are by how much it grows per unit of distance
    from there.
    """

    knot: Float
    radius: Float
    before: Float
    behind: Float

    def __call__(self, s: Number) -> Float:
        """Return the radius at a distance."""
        t = s - self.knot
        return dr.maximum(self.radius + dr.abs(t) * dr.select(t < 0, self.before, self.behind), 0)

    def later(self, s: Float) -> Width:
        """Return the width of the part of a segment that begins at a distance."""
        return Width(self.knot - s, self.radius, self.before, self.behind)


class Limits(NamedTuple):
    """Bounds of radii in scene units, and a factor on radii that shrinks from pass to pass (all opaque)."""

    floor: Any
    ceiling: Any
    scale: Any

    def __call__(self, radius: Float) -> Float:
        """Return a radius clamped to the bounds, times the factor."""
        return dr.clip(radius, self.floor, self.ceiling) * self.scale

    def raised(self, factor: Float) -> Limits:
        """Return bounds with so many times the ceiling, unless one radius is set for all."""
        fixed = self.floor == self.ceiling
        return self._replace(ceiling=dr.select(fixed, self.ceiling, factor * self.ceiling))


@dataclass(frozen=True)
class _Spread:
    """Half the sum of the squares of two derivatives across a segment: a + b s + c s²."""

    a: Any
    b: Any
    c: Any

    @classmethod
    def of(cls, columns: list[tuple[Array3f, Array3f]], direction: Array3f) -> _Spread:
        total = [Float(0), Float(0), Float(0)]
        for p, d in columns:
            across, turn = p - direction * dr.dot(p, direction), d - direction * dr.dot(d, direction)
            parts = 0.5 * dr.squared_norm(across), dr.dot(across, turn), 0.5 * dr.squared_norm(turn)
            total = [each + part for each, part in zip(total, parts, strict=True)]
        return cls(*total)

    def __call__(self, s: Number) -> Any:
        return dr.maximum(dr.fma(dr.fma(self.c, s, self.b), s, self.a), 0)


def width(
    differentials: RayDifferentials, direction: Array3f, length: Float, count: Float, overlap: Float,
    portal: Float | None = None,
) -> Width:  # fmt: skip
    """Return the widths of segments of paths that are `count` samples of one sequence.

    The root of the polynomial is replaced by lines between its values at the start, at the knot and at `length`. The
    knot is the portal where there is one, else the focus.

    Parameters
    ----------
    overlap
        Width of a beam in spacings of its neighbours.
    portal
        The distance to the portal, infinity where there is none; None: there are no portals.
    """
    columns = differentials.columns()
    place, aim = _Spread.of(columns[:2], direction), _Spread.of(columns[2:], direction)
    ratio = dr.maximum(place(0), place(length)) * dr.rcp(dr.maximum(dr.maximum(aim(0), aim(length)), 1e-30))
    cells = dr.clip(dr.sqrt(count * ratio), dr.minimum(count, 1), dr.maximum(count, 1))
    half2 = dr.square(0.5 * overlap)
    x, y = half2 * dr.rcp(cells), half2 * cells * dr.rcp(count)
    a, b, c = (x * getattr(place, each) + y * getattr(aim, each) for each in "abc")
    known = dr.isfinite(a + b + c)  # derivatives may be infinite at a grazing angle
    a, b, c = (dr.select(known, each, 0) for each in (a, b, c))

    def radius(s: Float) -> Float:
        return dr.safe_sqrt(dr.fma(dr.fma(c, s, b), s, a))

    knot = -0.5 * b * dr.rcp(dr.maximum(c, 1e-30))
    if portal is not None:
        knot = dr.select((portal > 0) & (portal < length), portal, knot)
    inside = (knot > 0) & (knot < length)
    knot = dr.select(inside, knot, 0)
    start, there, end = radius(Float(0)), radius(knot), radius(length)
    behind = (end - there) * dr.rcp(dr.maximum(length - knot, 1e-30))
    before = dr.select(inside, (start - there) * dr.rcp(dr.maximum(knot, 1e-30)), -behind)
    return Width(knot, there, before, behind)
