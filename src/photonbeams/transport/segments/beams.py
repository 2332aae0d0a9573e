"""Turn segments of light paths into sets of beams: bound their radii, and cut them at the portal or at the focus."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...beams import Beams
from ...beams.guides import known_guides, led, pieces_along
from ...beams.sets import BeamSet
from ...numerics.arrays import compressed, joined, opaque
from ...numerics.hashing import hash32, unit_float
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...world.bounds import Box
from ...world.emitters.filters import FilterChain
from ...world.emitters.sources import Source
from ...world.media.rendered import RenderedMedium, over_mean
from ...world.world import World
from .coverage import medium_coverage
from .filtering import filtered_parts
from .radii import Limits
from .records import Segments, tangent
from .sides import sides_of

if TYPE_CHECKING:
    from ...looks import Look
    from ...numerics.given import Number

# A segment is cut at its focus if its radius there is less than this fraction of a straight cone's.
_WAIST = 0.8

# Beams continue beyond the boundary of their medium as far as their rim is in it, but at most by this many radii, or
# one free path. Otherwise the medium would be dark at a boundary that they cross at a slant. Outside they are not seen.
_BEYOND = 4.0

# A surface this near beyond the end of a segment, in radii, is where the segment ends.
_FLUSH = 1e-3

# Places along a beam at which a grid's density is looked up, as fractions of its length.
_DENSITIES = (0.0, 0.5, 1.0)


class Piece(Struct):
    """One piece of each segment as a beam, at one time; `there` says which segments have that piece.

    `scattered` says whose light something other than mirrors and glass has turned.
    """

    there: Bool
    beams: Beams
    depth: UInt32
    scattered: Bool


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
    box
        The box around the medium, if light straight from lamps also makes beams beside it (see `fringes`).
    reentrant
        Whether a line may leave the medium and enter it again.
    longest
        Length of straight light from which on the greatest radius grows in proportion (opaque); None: it never does.
    walls
        Whether there may be walls that cut beams of scattered light.
    chain
        Returns the filters of a source that act in a medium, by its number.
    """

    medium: RenderedMedium
    source: Source
    limits: Limits
    straight: Limits
    named: bool
    short: bool
    free_paths: float = np.inf
    box: Box | None = None
    reentrant: bool = False
    longest: Any = None
    walls: bool = False
    chain: Callable[[Source, int], FilterChain | None] = lambda source, _: source.filters

    def filters(self, source: Source) -> FilterChain | None:
        """Return the filters of a source, the cutting's or the same at another time, that act in the medium."""
        return self.chain(source, self.medium.number)

    def own(self, segments: Segments) -> Bool:
        """Return which segments belong to the emitter and lie in the medium."""
        inside = segments.medium == dr.opaque(UInt32, self.medium.number)
        mine = inside & (segments.source == dr.opaque(UInt32, self.source.number))
        straight = self.source.beams and self.medium.number not in self.source.unlit
        return mine if straight else mine & (segments.depth > 0)

    def fitted(self, world: World, segments: Segments) -> Segments:
        """Return segments fitted into the medium: narrower or reflected, with flux corrected for what lies outside."""
        tried = segments.depth > 0 if self.whole else Bool(True)
        result = copy(segments)
        fine = self._fine(segments, tried)

        def shape(factor: Float) -> tuple[Any, ...]:
            result.narrow, result.clear = self._narrowed(segments, fine * factor)
            lead, end, plane = self._reach(result)
            first, last = (self._radius(result, each, result.narrow) for each in (0, segments.length))
            return first, last, lead, end, plane

        if self.walls:
            first, last, *_ = shape(Float(1))
            result.sides = sides_of(world.intersect, segments, (first, last), tried)
            dr.eval(result.sides)
        factor, covered, shift = medium_coverage(world, result, shape, self._decay(), tried)
        result.narrow, result.clear = self._narrowed(segments, fine * factor)
        result.flux, result.origin = segments.flux * dr.rcp(covered), segments.origin + shift
        dr.eval(result.narrow, result.clear, result.flux, result.origin)
        return result

    @property
    def whole(self) -> bool:
        """Whether light straight from lamps fits: `narrowing` made it narrower, or `fringes` has what lies beside."""
        return self.straight is not self.limits or self.box is not None or self.reentrant

    @staticmethod
    def _narrowed(segments: Segments, factor: Float) -> tuple[Float, Float]:
        """Return the factors on the radii of segments, and where they begin to apply: all along if `factor` is less."""
        return segments.narrow * factor, dr.select(factor < 1, -dr.inf, segments.clear)

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

    def pieces(self, segments: Segments, there: Bool, filters: FilterChain | None = None) -> list[Piece]:
        """Return segments as beams, cut at the portal or the focus, by filters, and where they become narrower."""
        length = segments.length
        portal = segments.portal - segments.offset
        at_portal = there & (portal > 0) & (portal < length)
        focus = segments.width.knot
        first, last, waist = (self._radius(segments, each, 1) for each in (0, length, focus))
        inside = there & ~at_portal & (focus > 0) & (focus < length)
        at_focus = inside & (waist < _WAIST * dr.lerp(first, last, focus * dr.rcp(length)))
        clear = segments.clear - segments.offset
        at_clear = there & (clear > 0) & (clear < length)
        lead, end, plane = self._reach(segments)
        stop = length + end
        cuts = (at_portal | at_focus, dr.select(at_portal, portal * (1 - 1e-5), focus)), (at_clear, clear)
        knots = [dr.select(cut, place, stop) for cut, place in cuts]
        ends = [-lead, dr.minimum(*knots), dr.maximum(*knots), stop]
        exists = there, there & (cuts[0][0] | at_clear), there & cuts[0][0] & at_clear
        result = []
        parts = zip(exists, ends, ends[1:], strict=False)
        for present, begin, until, light in filtered_parts(filters, segments, parts):
            narrow = dr.select(clear <= dr.maximum(begin, 0), segments.narrow, 1)
            radii = self._radius(segments, begin, narrow), self._radius(segments, until, narrow)
            normal = dr.select(until >= stop, plane, -segments.direction)
            beams = self._beams(segments, lead, (begin, until), radii, normal)
            if not self.named:
                beams.power = self._left(segments, begin)
            if light:
                beams.power_end = beams.power * light[1] if len(light) > 1 else None
                beams.power = beams.power * light[0]
            result.append(Piece(present, beams, segments.depth, segments.scattered))
        return result

    def _reach(self, segments: Segments) -> tuple[Any, Any, Any]:
        """Return how far beams extend before their start and beyond their end, and the normal of the plane there.

        They reach as far as their rim is in the medium.
        """
        clear = segments.clear - segments.offset
        first, last = (
            self._radius(segments, s, dr.select(clear <= s, segments.narrow, 1)) for s in (0, segments.length)
        )
        free = dr.opaque(Float, 1 / max(*self.medium.medium.extinction, 1e-30))
        lead, end = (
            dr.minimum(dr.minimum(slant, _BEYOND) * radius, free)
            for slant, radius in ((segments.slant, first), (segments.slant_end, last))
        )
        plane = dr.select(end > 0, -segments.direction, segments.normal)
        if self.box is None and not self.reentrant:
            return dr.select(segments.depth == 0, dr.minimum(lead, segments.offset), lead), end, plane
        # Light straight from a lamp, which does not begin before it, and ends at the surface that its axis meets. Along
        # a boundary, beams reach as far as the medium does.
        straight = segments.depth == 0
        most = segments.room, segments.room_end
        if self.box is not None:
            low, high = (opaque(each) for each in self.box)
            middle = dr.dot(0.5 * (low + high) - segments.origin, segments.direction)
            extent = 1.001 * dr.dot(0.5 * (high - low), dr.abs(segments.direction))
            beyond = extent - middle, extent + middle - segments.length
            most = dr.minimum(most[0], beyond[0]), dr.minimum(most[1], beyond[1])
        entering = dr.minimum(dr.minimum(segments.slant * first, most[0]), dr.minimum(free, segments.offset))
        left = segments.total - segments.offset - segments.length
        leaving = dr.minimum(segments.slant_end * last, most[1])
        # The surface that stops the axis cuts the rim, too, even where the axis left the medium before.
        stopped = (leaving + tangent(segments.against, segments.direction) * last > left) & dr.isinf(segments.room_end)
        leaving = dr.select(stopped & (left > _FLUSH * last), left, dr.minimum(leaving, left))
        entering, leaving = dr.maximum(entering, 0), dr.maximum(leaving, 0)
        ahead = dr.select(stopped, segments.against, -segments.direction)
        return dr.select(straight, entering, lead), dr.select(straight, leaving, end), dr.select(straight, ahead, plane)

    def _radius(self, segments: Segments, s: Number, narrow: Number) -> Any:
        radius, straight = segments.width(s), self.straight
        if self.longest is not None:  # so that the near part of a longer beam is as wide as it would be alone
            straight = straight._replace(ceiling=straight.ceiling * dr.maximum(segments.length / self.longest, 1))
        return dr.select(segments.depth == 0, straight(radius), self.limits(radius)) * narrow

    def _left(self, segments: Segments, s: Float) -> Array3f:
        """Return the flux that remains at a distance along segments."""
        if self.medium.tracked is not None:
            return segments.flux
        left = dr.exp(-opaque(self.medium.medium.extinction) * s)
        return segments.flux * (over_mean(left, segments.flux) if self.short else left)

    def _beams(
        self, segments: Segments, lead: Float, ends: tuple[Float, Float], radii: tuple[Float, Float], normal: Array3f
    ) -> Beams:
        result = Beams()
        result.start, result.end = (segments.origin + each * segments.direction for each in ends)
        result.radius_start, result.radius_end = radii
        result.power, result.end_normal = segments.flux, normal
        if segments.sides is not None:
            result.start_normal = dr.select(ends[0] <= 0, segments.sides.start, 0)
            result.side, result.side_normal = segments.sides.place, segments.sides.beside
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
    segments, fitted = joined(list(steps)), dict[int, list[Segments]]()
    for cutting in cuttings:
        number = cutting.medium.number
        if number not in fitted:  # those of all emitters at once: so many kernels do not depend on their number
            inside = compressed(segments.medium == dr.opaque(UInt32, number), segments)
            fitted[number] = [cutting.fitted(world, each) for each in inside]
        pieces: list[Piece] = []
        for every in fitted[number]:
            kept = compressed(cutting.own(every), every, every.sides)
            if not kept:
                continue
            mine, mine.sides = kept  # the sides are no field of the struct
            for piece in cutting.pieces(mine, dr.max(mine.flux) > 0, cutting.filters(cutting.source)):
                pieces += compressed(piece.there, piece)
        if not pieces:
            continue
        found = joined(pieces)
        if not cutting.source.tallied:
            result += _sets(cutting, found)
            continue
        for each in compressed(~found.scattered, found):
            result += _sets(cutting, each)
        for each in compressed(found.scattered, found):  # what a tally has straight ahead of cameras
            result.append(_set(cutting, None, each.beams, depth=each.depth)._replace(tallied=True))
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
                chains = cutting.filters(cutting.source), cutting.filters(later[cutting.source.number])
                states = [
                    cutting.pieces(segment, each, chain)
                    for each, segment, chain in zip(kept[:2], kept[2:], chains, strict=True)
                ]
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
    if result.power_end is not None:
        result.power_end = Array3f(dr.select(own.there, own.beams.power_end, 0))
    return result


def _set(
    cutting: Cutting, look: Look | None, beams: Beams, close: Beams | None = None, depth: UInt32 | None = None
) -> BeamSet:
    """Return beams as a set that belongs to their emitter, with a look."""
    source = cutting.source
    dr.eval(beams, close, depth)
    return BeamSet(
        group=source.group,
        look=look,
        beams=beams,
        close=close,
        name=source.name,
        light=source.number,
        to_world=source.to_world,
        medium=cutting.medium.number,
        depth=depth,
    )


def _sets(cutting: Cutting, found: Piece) -> list[BeamSet]:
    """Return an emitter's beams in a medium: two sets if its straight and its scattered light differ in look."""
    source = cutting.source
    like = source.look is None or source.scattered == "look"
    if like and source.scattered != "off" and not source.guides:
        return [_set(cutting, source.look, found.beams, None, found.depth)]
    straight, scattered = compressed(found.depth == 0, found), compressed(found.depth > 0, found)
    for each in straight if cutting.whole else ():
        each.beams.start_normal = each.beams.side = each.beams.side_normal = None
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
