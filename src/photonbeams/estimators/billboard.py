"""Beam × Beam 1D: the beam as a flat billboard (Jarosz et al. 2011; Talk, section 1).

    L = Φ · angle(θ) / sin θ · k1(u, R(s)) · along(s) · eye(t)

One evaluation a beam and ray: cheap, and right from beside. It is singular as θ → 0 and meaningless with the camera
inside; `auto` leaves those to the frustum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..device import Array3f, Bool, UInt32
from ..looks import BoundLook
from .blend import frustum_weight, need, touched
from .geometry import Approach, Packed, Rays, Record, closest_approach, load


def value(beam: Record, at: Approach, radius: Any, look: BoundLook, t_min: Any) -> Any:
    """Return a beam's radiance toward a ray that meets it, by the line kernel of the look's profile."""
    inv_radius = dr.rcp(radius)
    x = at.u2 * inv_radius * inv_radius
    sine_inv = dr.sqrt(at.inv_sin2)
    kernel = dr.sqrt(dr.maximum(1 - x, 0)) * look.profile.line(x) * inv_radius * sine_inv
    distance = at.s + beam.offset
    factors = (
        look.along(distance, dr.maximum(distance - beam.entry, 0), dr.clip(distance * dr.rcp(beam.total), 0, 1))
        * look.eye(at.t, at.t - t_min)
        * look.angle(-at.cosine)
    )
    return beam.power * (factors * kernel)


def in_range(beam: Record, at: Approach, t_min: Any, t_max: Any, origin: Any, direction: Any) -> Any:
    """Return whether the closest approach lies between the beam's ends and on the visible part of the ray."""
    inside = (at.s > 0) & (at.s < beam.stop) & (at.t > t_min) & (at.t < t_max)
    if beam.cap is not None:
        height = beam.cap_offset - (0.0 if origin is None else dr.dot(origin, beam.cap))
        inside &= dr.dot(direction, beam.cap) * at.t > height
    return inside


@dr.syntax
def billboard_sum(
    rays: list[Rays],
    first: Any,
    stop: Any,
    number: Callable[[Any], Any],
    packed: Packed,
    look: BoundLook,
    blended: bool,
    flags: Any = None,
) -> list[Any]:
    """Return the radiance of the beams `number(first)` … `number(stop − 1)` toward each of the lane's rays.

    Every lane carries several rays, so that one gather of a beam serves them all: gathers bound this loop.

    Parameters
    ----------
    rays
        The K rays of each lane, origins relative to the packed origin.
    blended
        Whether to leave out what the frustum does better (`auto`), or to take everything (`billboard`).
    flags
        For `auto`: a UInt32 array in which the entries that the frustum has to visit are marked.
    """
    radiance = [Array3f(0) for _ in range(len(rays))]
    i = UInt32(first)
    while i < stop:
        beam = load(packed, number(i))
        marked = Bool(False)
        for p in range(len(rays)):
            ray = rays[p]
            at = closest_approach(beam, ray.origin, ray.direction)
            radius = dr.fma(beam.slope, at.s, beam.radius)
            if dr.hint(not blended, mode="scalar"):
                hit = (at.u2 < radius * radius) & in_range(beam, at, ray.t_min, ray.t_max, ray.origin, ray.direction)
                if hit:
                    radiance[p] += value(beam, at, radius, look, ray.t_min)
            else:
                taper = beam.slope * at.cosine
                # Meets the cone that the beam is cut from, exactly: u² A ≤ sin² R², over sin².
                near = at.u2 * dr.fma(-taper * taper, at.inv_sin2, 1) < radius * radius
                if near:
                    boundary, change = need(beam, at, radius, look, ray.t_min, ray.t_max, ray.origin, ray.direction)
                    inside = in_range(beam, at, ray.t_min, ray.t_max, ray.origin, ray.direction)
                    share = 1 - frustum_weight(boundary, change)
                    if inside & (share > 0) & (at.u2 < radius * radius):
                        radiance[p] += value(beam, at, radius, look, ray.t_min) * share
                    marked |= touched(boundary, change, inside)
        if dr.hint(flags is not None, mode="scalar"):
            # Lanes of one tile write the same number to the same place: no race, whatever the order.
            dr.scatter(flags, UInt32(1), i, marked)
        i += 1
    return radiance
