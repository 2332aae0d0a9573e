"""Parts of light straight from filtered lamps: each part has its own fraction of the light."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

import drjit as dr

from ...numerics.hashing import hash32
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...world.emitters.filters import FilterChain
from .records import Segments

#: A part of each segment: who has one, where it begins and ends, and the fraction of the light that is left, at both
#: ends where it changes between them; without fractions, nothing filters it.
Part = tuple[Bool, Any, Any, tuple[Array3f, ...]]


def filtered_parts(
    filters: FilterChain | None, segments: Segments, parts: Iterable[tuple[Bool, Any, Any]]
) -> Iterator[Part]:  # fmt: skip
    """Yield parts of segments, cut where filters begin and end to act, without those that have no light."""
    if filters is None:
        yield from ((*part, ()) for part in parts)
        return
    seed = hash32(segments.key, segments.index, UInt32(Stream.FILTER))
    straight = segments.depth == 0
    places = filters.places(segments.origin, segments.direction, segments.offset, seed)

    def left(s: Float) -> Array3f:
        point = dr.fma(segments.direction, s, segments.origin)
        value = filters.factor(point, -segments.direction, segments.offset + s, seed, soft=False)
        return dr.select(straight, value, Array3f(1))

    for present, begin, until in parts:
        knots = [begin, *(dr.clip(dr.select(straight, place, dr.inf), begin, until) for place in places), until]
        for first, last in pairwise(knots):
            # Just inside of the part, as steps of ramps are at its ends.
            near = (1e-4 if filters.varying else 0.5) * (last - first)
            light = (left(first + near), left(last - near))[: 2 if filters.varying else 1]
            lit = dr.max(sum(light, Array3f(0))) > 0
            yield present & (first < last) & lit, first, last, light
