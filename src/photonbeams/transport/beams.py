"""Turn segments of light paths into sets of beams: bound their radii, and cut them at the portal or at the focus."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..beams.guides import known_guides, led, pieces_along
from ..beams.sets import BeamSet
from ..numerics.arrays import compressed, joined, opaque
from ..numerics.hashing import hash32, unit_float
from ..numerics.structs import Struct
from ..runtime.device import Bool, Float, UInt32
from ..world.media import RenderedMedium, over_mean
from ..world.sources import Source
from ..world.world import World
from .coverage import medium_coverage
from .radii import Limits
from .records import Segments

# A segment is cut at its focus if its radius there is less than this fraction of a straight cone's.
_WAIST = 0.8

# Beams continue beyond the boundary of their medium as far as their rim is in it, but at most by this many radii, or
# one free path. Otherwise the medium would be dark at a boundary that they cross at a slant. Outside they are not seen.
_BEYOND = 4.0

# Places along a beam at which a grid's density is looked up, as fractions of its length.
_DENSITIES = (0.0, 0.5, 1.0)


class Piece(Struct):
    """One piece of each segment as a beam, at one time; `there` says which segments have that piece."""

    there: Bool
    beams: Beams
    depth: UInt32


@dataclass(frozen=True)
class Cutting:
    """How segments of one emitter in one medium become beams.

    Attributes
    ----------
    medium, source
        The medium and the emitter.
    limits, straight
        Bounds of radii of scattered light, and of light straight from the emitter.
    named
        Whether beams carry what looks and programs may read: place on the light path, random number and id.
    short
        Whether beams end at the path's next scattering event.
    free_paths
        The greatest radius of beams in a grid, in free paths at the beam.
    """

    medium: RenderedMedium
    source: Source
    limits: Limits
    straight: Limits
    named: bool
    short: bool
    free_paths: float = np.inf

    def own(self, segments: Segments) -> Bool:
        """Return which segments belong to the emitter and lie in the medium."""
        inside = segments.medium == dr.opaque(UInt32, self.medium.number)
        mine = inside & (segments.source == dr.opaque(UInt32, self.source.number))
        return mine if self.source.beams else mine & (segments.depth > 0)

    def fitted(self, world: World, segments: Segments) -> Segments:
        """Return segments fitted into the medium: narrower, and with their flux corrected for what lies outside."""
        # `narrowing` has already narrowed the light straight from lamps.
        tried = Bool(True) if self.straight is self.limits else segments.depth > 0
        result = copy(segments)
        fine = self._fine(segments, tried)

        def shape(factor: Any) -> tuple[Any, ...]:
            result.narrow = segments.narrow * fine * factor
            lead, end = self._reach(result, result.narrow)
            first, last = (self._radius(result, each, result.narrow) for each in (0, segments.length))
            return first, last, lead, end, dr.select(end > 0, -segments.direction, segments.normal)

        factor, covered = medium_coverage(world, segments, shape, self._decay(), tried)
        result.narrow, result.flux = segments.narrow * fine * factor, segments.flux * dr.rcp(covered)
        dr.eval(result.narrow, result.flux)
        return result

    def _fine(self, segments: Segments, tried: Bool) -> Float:
        """Return factors on the radii of beams in a grid, which bound these in free paths where the grid is densest."""
        if self.medium.tracked is None or not np.isfinite(self.free_paths):
            return dr.ones(Float, dr.width(segments.length))
        densest = Float(0)
        for part in _DENSITIES:
            point = dr.fma(segments.direction, part * segments.length, segments.origin)
            densest = dr.maximum(densest, dr.max(self.medium.extinction(point)))
        widest = dr.opaque(Float, self.free_paths) * self.limits.scale * dr.rcp(dr.maximum(densest, 1e-30))
        radius = dr.maximum(*(self._radius(segments, each, segments.narrow) for each in (0, segments.length)))
        return dr.select(tried, dr.minimum(widest * dr.rcp(dr.maximum(radius, 1e-30)), 1), 1)

    def _decay(self) -> Float:
        """Return the mean rate at which beams fade."""
        fades = self.medium.tracked is None and not self.short
        return dr.opaque(Float, sum(self.medium.medium.extinction) / 3 if fades else 0)

    def pieces(self, segments: Segments, there: Bool) -> list[Piece]:
        """Return segments as beams, cut into two pieces at the portal or the focus where there is one."""
        length = segments.length
        portal = segments.portal - segments.offset
        at_portal = there & (portal > 0) & (portal < length)
        focus = segments.width.focus()
        # A beam is not narrowed on the light's side of its portal: surfaces that block its rim are behind the portal.
        narrow = dr.select(at_portal, 1, segments.narrow)
        first, last = self._radius(segments, 0, narrow), self._radius(segments, length, segments.narrow)
        waist = self._radius(segments, focus, segments.narrow)
        inside = there & ~at_portal & (focus > 0) & (focus < length)
        cut = at_portal | (inside & (waist < _WAIST * dr.lerp(first, last, focus * dr.rcp(length))))
        middle = dr.select(at_portal, portal * (1 - 1e-5), dr.select(cut, focus, length))
        before, behind = (self._radius(segments, middle, each) for each in (narrow, segments.narrow))
        lead, end = self._reach(segments, narrow)
        plane = dr.select(end > 0, -segments.direction, segments.normal)
        first, last = self._radius(segments, -lead, narrow), self._radius(segments, length + end, segments.narrow)
        near_end, before = dr.select(cut, middle, length + end), dr.select(cut, before, last)
        normal = dr.select(cut, -segments.direction, plane)
        near = self._beams(segments, lead, (-lead, near_end), (first, before), normal)
        far = self._beams(segments, lead, (middle, length + end), (behind, last), plane)
        if not self.named:
            near.power, far.power = self._left(segments, -lead), self._left(segments, middle)
        return [Piece(there, near, segments.depth), Piece(cut, far, segments.depth)]

    def _reach(self, segments: Segments, narrow: Any) -> tuple[Any, Any]:
        """Return how far beams extend before their start and beyond their end: as far as their rim is in the medium."""
        first, last = self._radius(segments, 0, narrow), self._radius(segments, segments.length, segments.narrow)
        lead, end = self._beyond(segments.slant, first), self._beyond(segments.slant_end, last)
        lead = dr.select(segments.depth == 0, dr.minimum(lead, segments.offset), lead)  # no light before its lamp
        return lead, end

    def _beyond(self, slant: Any, radius: Any) -> Any:
        """Return how far the rim of beams reaches beyond a boundary that their axis crosses at this slant."""
        free = dr.opaque(Float, 1 / max(*self.medium.medium.extinction, 1e-30))
        return dr.minimum(dr.minimum(slant, _BEYOND) * radius, free)

    def _radius(self, segments: Segments, s: Any, narrow: Any) -> Any:
        radius = segments.width(s)
        if self.straight is self.limits:
            return self.limits(radius) * narrow
        return dr.select(segments.depth == 0, self.straight(radius), self.limits(radius)) * narrow

    def _left(self, segments: Segments, s: Any) -> Any:
        """Return the flux that remains at a distance along segments."""
        if self.medium.tracked is not None:
            return segments.flux
        left = dr.exp(-opaque(self.medium.medium.extinction) * s)
        return segments.flux * (over_mean(left, segments.flux) if self.short else left)

    def _beams(
        self, segments: Segments, lead: Any, ends: tuple[Any, Any], radii: tuple[Any, Any], normal: Any
    ) -> Beams:
        result = Beams()
        result.start, result.end = (segments.origin + each * segments.direction for each in ends)
        result.radius_start, result.radius_end = radii
        result.power, result.end_normal = segments.flux, normal
        if self.named:
            result.power = segments.flux * opaque(self.source.beam_scale)
            straight = segments.depth == 0
            entry = dr.select(straight, segments.offset, lead)
            result.entry, result.offset = entry, entry + ends[0]
            result.total = dr.select(straight, segments.total, segments.length)
            result.random = unit_float(hash32(segments.index, segments.key))
            # Light through the portal and light beside it have separate sequences, so ids must tell them apart.
            result.id = Float(2 * segments.index + dr.select(dr.isfinite(segments.portal), UInt32(1), UInt32(0)))
            result.generation = Float(segments.depth)
        return result


def sets_of(world: World, cuttings: Iterable[Cutting], steps: Sequence[Segments]) -> list[BeamSet]:
    """Return the beams of all steps: a set for each emitter and medium, two where scattered light has another look."""
    result: list[BeamSet] = []
    if not steps:
        return result
    segments = joined(list(steps))
    for cutting in cuttings:
        pieces: list[Piece] = []
        for mine in compressed(cutting.own(segments), segments):
            fitted = cutting.fitted(world, mine)
            for piece in cutting.pieces(fitted, dr.max(fitted.flux) > 0):
                pieces += compressed(piece.there, piece)
        if pieces:
            result += _sets(cutting, joined(pieces))
    return result


#: Segments at shutter open and at shutter close, and which of them exist at either time.
Moments = tuple[Sequence[Segments], Sequence[Bool]]


def moving_sets(cuttings: Iterable[Cutting], steps: Sequence[Moments], later: Sequence[Source]) -> list[BeamSet]:
    """Return the beams of light straight from lamps, at shutter open and close.

    Parameters
    ----------
    steps
        For each step, the segments at both times, and which of them exist.
    later
        The emitters at shutter close, by number.
    """
    result = []
    for cutting in cuttings:
        pieces: list[list[Beams]] = []
        for segments, there in steps:
            mine = [each & cutting.own(segment) for each, segment in zip(there, segments, strict=True)]
            kept = compressed(mine[0] | mine[1], *mine, *segments)
            if kept:
                states = [cutting.pieces(segment, each) for each, segment in zip(kept[:2], kept[2:], strict=True)]
                pieces += [
                    _pair(*pair) for pair in zip(*states, strict=True) if bool(dr.any(pair[0].there | pair[1].there))
                ]
        if pieces:
            opened, closed = (joined(list(state)) for state in zip(*pieces, strict=True))
            opened, closed = _led([cutting.source, later[cutting.source.number]], opened, closed)
            result.append(_set(cutting, cutting.source.look, opened, closed))
    return result


def _pair(first: Piece, last: Piece) -> list[Beams]:
    """Return the pieces that exist at either time, for both times; where one does not exist, it has no power."""
    kept = compressed(first.there | last.there, first, last)
    return [_present(*kept), _present(*reversed(kept))] if kept else []


def _present(own: Piece, other: Piece) -> Beams:
    result: Beams = dr.select(own.there, own.beams, other.beams)
    result.power = dr.select(own.there, own.beams.power, 0)
    return result


def _set(cutting: Cutting, look: Any, beams: Beams, close: Beams | None = None, depth: Any = None) -> BeamSet:
    """Return beams as a set that belongs to their emitter, with a look."""
    source = cutting.source
    dr.eval(beams, close, depth)
    return BeamSet(
        source.group, look, beams, close, source.name, source.number, source.to_world, cutting.medium.number, depth
    )


def _sets(cutting: Cutting, found: Piece) -> list[BeamSet]:
    """Return an emitter's beams in a medium: two sets if its straight and its scattered light differ in look."""
    source = cutting.source
    like = source.look is None or source.scattered == "look"
    if like and source.scattered != "off" and not source.guides:
        return [_set(cutting, source.look, found.beams, None, found.depth)]
    straight, scattered = compressed(found.depth == 0, found), compressed(found.depth > 0, found)
    result = [_set(cutting, source.look, _led([source], each.beams)[0]) for each in straight]
    if source.scattered != "off":
        look = source.look if source.scattered == "look" else None
        result += [_set(cutting, look, each.beams, None, each.depth) for each in scattered]
    return result


def _led(sources: Sequence[Source], *states: Beams) -> list[Beams]:
    """Return beams straight from a lamp, bent along its guides if it has any, for each time."""
    guides = [known_guides(each.guides) for each in sources]
    count = max(pieces_along(each) for each in guides)
    return [led(state, each, count) for state, each in zip(states, guides, strict=True)]
