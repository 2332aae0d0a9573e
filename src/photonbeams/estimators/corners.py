"""Where a chord is cut because the integrand has a corner: at knots of ramps, and at edges of a profile.

A ray meets the corners of each input in an order that is known: forward or backward along the beam, and over the radius
first inward, then outward. So a loop over pieces needs only the number of the next one, however many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import drjit as dr

from ..looks.bound_look import BoundLook
from ..looks.table import Places
from ..numerics.syntax import syntax
from ..runtime.device import Float, UInt32
from .geometry import Chord, inside_cone
from .records import Record


@dataclass
class Crossings:
    """The crossings with the corners of one input, `where(number)`, in ascending order but for misses."""

    count: UInt32
    where: Callable[[UInt32], Float]

    def first(self) -> tuple[UInt32, Float]:
        """Return the number of the first crossing, and where it is."""
        return UInt32(0), self.where(UInt32(0))


def crossings(beam: Record, ray: Chord, look: BoundLook) -> list[Crossings]:
    """Return the crossings of a chord with the corners of each input, τ from its point."""
    units: dict[str, Float | int] = {"fraction": beam.total, "distance": 1}
    return [
        _rings(places, ray) if name == "radius" else _planes(places, beam, ray, units.get(name))
        for name, places in look.places.items()
    ]


def _planes(places: Places, beam: Record, ray: Chord, unit: Float | int | None) -> Crossings:
    """Return where a chord meets places along the beam, in units of `unit`, or along the ray if that is None."""
    rate = ray.cosine if ray.course is None else ray.course.rate()
    inv_c = dr.rcp(dr.select(dr.abs(ray.cosine) < 1e-6, dr.copysign(1e-6, ray.cosine), ray.cosine))

    def where(number: UInt32) -> Float:
        if unit is None:
            return places(number) - ray.t
        distance = places(dr.select(rate < 0, places.count - 1 - number, number)) * unit - beam.offset
        return (distance - ray.s) * inv_c if ray.course is None else ray.course.where(distance)

    return Crossings(places.count, where)


def _rings(places: Places, ray: Chord) -> Crossings:
    """Return where a chord meets places over the radius: inward, then outward."""

    def where(number: UInt32) -> Float:
        outward = number >= places.count
        ring = places(dr.select(outward, number - places.count, places.count - 1 - number))
        first, last = within(ring, ray)
        # The axis is a ring that is never met: the chord is cut where it comes closest.
        closest = -ray.drift / dr.maximum(ray.sin2, 1e-12)
        missed = first > last
        return dr.select(ring == 0, closest, dr.select(missed, -dr.inf, dr.select(outward, last, first)))

    return Crossings(2 * places.count, where)


def across_section(x: Float, look: BoundLook) -> tuple[list[Crossings], Float]:
    """Return where v meets the rings if ρ² = x + (1 − x) v², and the v where the profile becomes dark."""
    inv_wide = dr.rcp(dr.maximum(1 - x, 1e-6))

    def at(ring: Float | float) -> Float:
        return dr.sqrt(dr.clip((dr.square(ring) - x) * inv_wide, 0, 1))

    rings = look.places.get("radius")
    edges = [] if rings is None else [Crossings(rings.count, lambda number: at(rings(number)))]
    return edges, at(look.profile.edge)


def within(ring: Float | float, ray: Chord) -> tuple[Float, Float]:
    """Return the τ between which a ray is nearer to the axis than `ring` radii; reversed if it nowhere is."""
    growth, radius = ring * ray.growth, ring * ray.radius
    return inside_cone(
        dr.fma(-growth, growth, ray.sin2), dr.fma(-growth, radius, ray.drift), dr.fma(-radius, radius, ray.offset2),
        growth,
    )  # fmt: skip


@syntax
def cut(
    edges: Sequence[Crossings], nearest: list[tuple[UInt32, Float]], low: Float, high: Float
) -> tuple[list[tuple[UInt32, Float]], Float]:
    """Return the first crossings after `low`, and where the first of them all is, or `high` if that comes before."""
    found = []
    for k in range(len(edges)):
        number, place = nearest[k]
        while (number < edges[k].count) & ~(place > low):
            number += 1
            place = edges[k].where(number)
        high = dr.select((number < edges[k].count) & (place < high), place, high)
        found.append((number, place))
    return found, high
