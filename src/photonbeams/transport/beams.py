"""Segments of light paths as beams: radii within their bounds, cut at the focus."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr

from ..beams import Beams
from ..numerics.arrays import compressed, joined, opaque, taken
from ..runtime.device import UInt32
from ..world.media import RenderedMedium, ended
from .paths import Segments
from .radii import Limits

# A segment is cut at its focus where it is narrower there, by this factor, than a straight cone would be.
_WAIST = 0.8


class Lit:
    """The beams of one medium, and the events on the path of each before it."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"beams": Beams, "events": UInt32}

    def __init__(self, beams: Any = None, events: Any = None) -> None:
        self.beams: Any = beams
        self.events: Any = events

    def up_to(self, most: int) -> Beams | None:
        """Return the beams with at most so many events before them, or None."""
        if most < 0:
            return None
        kept = compressed(self.events <= dr.opaque(UInt32, most), self.beams)
        return kept[0] if kept else None


def lit(volume: RenderedMedium, steps: list[Segments], limits: Limits, short: bool = False) -> Lit | None:
    """Return the beams of a medium, from the segments of all steps; None where there are none."""
    pieces: list[Lit] = []
    for segments in steps:
        kept = compressed(segments.medium == dr.opaque(UInt32, volume.number), segments)
        if kept:
            pieces += _cut(kept[0], limits, volume, short)
    return joined(pieces) if pieces else None


def _cut(segments: Segments, limits: Limits, volume: RenderedMedium, short: bool) -> list[Lit]:
    """Return segments as beams, in two pieces where there is a focus."""
    width, length = segments.width, segments.length
    focus = width.focus()
    first, last = limits(width(0)), limits(width(length))
    waist = limits(width(focus))
    inside = (focus > 0) & (focus < length)
    cut = inside & (waist < _WAIST * dr.lerp(first, last, focus * dr.rcp(length)))
    middle, middle_radius = dr.select(cut, focus, length), dr.select(cut, waist, last)
    normal = dr.select(cut, -segments.direction, segments.normal)
    near = _beams(segments, (0 * length, middle), (first, middle_radius), normal, segments.flux)
    dr.eval(near, cut)
    result = [Lit(near, segments.events)]
    index: Any = dr.compress(cut)
    if len(index):
        left = dr.exp(-opaque(volume.medium.extinction) * middle)
        if short:
            left = ended(left, segments.flux)
        flux = segments.flux if volume.tracked is not None else segments.flux * left
        far = _beams(segments, (middle, length), (middle_radius, last), segments.normal, flux)
        result.append(taken(Lit(far, segments.events), index))
    return result


def _beams(segments: Segments, ends: tuple[Any, Any], radii: tuple[Any, Any], normal: Any, power: Any) -> Beams:
    result = Beams()
    result.start, result.end = (segments.origin + each * segments.direction for each in ends)
    result.radius_start, result.radius_end = radii
    result.power, result.end_normal = power, normal
    return result
