"""Light that passes close beside a bounded medium: beams whose rim is in the medium although their axis is not.

Beams estimate a density of light, each with a kernel across its axis. At the boundary of a medium, half of the kernels
that cover a point belong to light paths that run outside. Without these, up to half of the light would be missing at
the boundary, and all of it where a medium is thinner than beams are wide. With them, the estimate of light straight
from a lamp is the same everywhere, and the medium only says which part of it is seen.

Such a beam needs to know where its light enters the medium and how it fades there. A line through the part of the beam
that is in the medium says so: it is traced like a light path, and its segments in the medium become segments on the
axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.bounds import Box
from ..world.media.interfaces import distance_to_medium
from ..world.warp import perpendicular
from .paths import AS_FAR, Last, Tracing, straight
from .segments.radii import Limits
from .segments.records import LightPaths, Segments

if TYPE_CHECKING:
    from ..world.world import World

# Steps of the bisection that finds the point of a box nearest to an axis.
_STEPS = 24

# Lines that are tried one after the other: whether they lie toward the nearest point of the medium's box or toward its
# center, and how far, as a fraction of the way that the beam covers there. The first suits boxes, the others what
# fills its box only in part.
_LINES = ((True, 0.4), (False, 0.6), (False, 0.95))

# Places in radii from the axis of further lines, which are tried for re-entrant media.
_TURNS = np.arange(8) * (np.pi / 4)
_MORE_LINES = tuple((float(part * np.cos(each)), float(part * np.sin(each))) for part in (0.75, 0.4) for each in _TURNS)

_SHORT = 1e-3  # length of segments that stand for a whole beam, as a fraction of its length

#: Returns the radius of beams at a distance from their lamps.
RadiusAt = Callable[[Any], Any]

#: Segments of light paths that keep their lanes, step by step, and which lanes have one.
Steps = Sequence[tuple[Segments, Bool]]


def unscattered(tracing: Tracing, paths: LightPaths, last: Last | None = None) -> Steps:
    """Return the segments of light straight from a lamp, in media and between them, up to the `last` of each path."""
    return list(straight(replace(tracing, max_bounces=0, openings=None), copy(paths), last))


def entering(medium: int) -> Last:
    """Return a function that says which segments are in a medium."""
    own = dr.opaque(UInt32, medium)
    return lambda segments, following: segments.medium == own


def _leaving(medium: UInt32) -> Last:
    """Return a function that says which segments are the last in a medium."""
    return lambda segments, following: (segments.medium == medium) & (following.medium != medium)


def fringe(
    tracing: Tracing, paths: LightPaths, steps: Steps, number: int, box: Box, limits: Limits, reentrant: bool = False
) -> Iterator[tuple[Segments, Bool]]:
    """Yield segments of light straight from a lamp that passes beside a medium, and which lanes have one.

    Parameters
    ----------
    paths, steps
        Light paths as they leave their lamps, and their `unscattered` segments; of paths that meet the medium, some.
    number, box
        The medium's number, and the box around it.
    limits
        The bounds of radii.
    reentrant
        Whether a line may leave the medium and enter it again. More lines are tried then, and a beam of which none is
        in the medium has its light all along.
    """

    def radius(s: Float) -> Float:
        return limits(paths.width(s)) * dr.select(s > paths.clear, paths.narrow, 1)

    medium = dr.opaque(UInt32, number)
    beside = paths.initial > 0
    for segments, there in steps:
        beside &= ~(there & (segments.medium == medium))
    shifted, found, grazing = _shifted(
        world=tracing.world,
        paths=paths,
        steps=steps,
        beside=beside,
        medium=medium,
        box=box,
        radius=radius,
        reentrant=reentrant,
    )
    if not bool(dr.any(found | grazing)):
        return
    if reentrant:
        yield _along(paths, steps, shifted.flux, medium, box), grazing
    shifted.initial = dr.select(found, shifted.initial, 0)
    for segments, there in unscattered(tracing, shifted, None if reentrant else _leaving(medium)):
        inside = there & found & (segments.medium == medium) & (segments.length > 0)
        yield _on_axis(paths, segments), inside & (segments.offset < paths.total)


def _on_axis(paths: LightPaths, segments: Segments) -> Segments:
    """Return segments of shifted paths moved back to the axes of the paths, which end at the surfaces there."""
    result = copy(segments)
    start = segments.offset
    result.origin, result.direction = paths.origin + start * paths.direction, paths.direction
    result.width = paths.width.later(start)
    left = paths.total - start
    result.length = dr.minimum(segments.length, left)
    for name in ("portal", "total", "against", "narrow", "clear"):
        setattr(result, name, getattr(paths, name))
    return result


def _shifted(
    world: World, paths: LightPaths, steps: Steps, beside: Bool, medium: UInt32, box: Box,
    radius: RadiusAt, reentrant: bool,
) -> tuple[LightPaths, Bool, Bool]:  # fmt: skip
    """Return paths along lines through the parts of beams that are in a medium, and which beams have such a part.

    Also return for which beams near the medium's box no such line is known.
    """
    low, high = (opaque(each) for each in box)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    origin, direction = paths.origin, paths.direction
    middle, extent = dr.dot(center - origin, direction), dr.dot(half, abs(direction))
    first, last = (dr.clip(middle + sign * extent, 0, paths.total) for sign in (-1, 1))
    s = _nearest(origin, direction, low, high, first, last)
    point = dr.fma(direction, s, origin)
    widest = radius(s)
    gap = dr.clip(point, low, high) - point
    gap -= direction * dr.dot(gap, direction)
    inward = center - point
    inward -= direction * dr.dot(inward, direction)
    apart, depth = dr.norm(gap), dr.norm(inward)
    gap = dr.select(apart > 1e-5 * depth, gap / dr.maximum(apart, 1e-30), inward / dr.maximum(depth, 1e-30))
    inward /= dr.maximum(depth, 1e-30)
    beside = beside & (apart < widest) & (last > first)
    # Just before the box: what lies between the lamp and the medium is met by the axis.
    begin = dr.maximum(dr.minimum(first, s) - 1e-3 * dr.maximum(extent, widest), 0)
    shift, found = Array3f(0), Bool(False)
    places = []
    for nearest, part in _LINES:
        way = gap if nearest else inward
        inside = dr.dot(half, abs(way))
        covered = dr.minimum(part * (widest - apart), inside) + apart if nearest else dr.minimum(part * widest, depth)
        places.append(way * covered * dr.rcp(dr.maximum(widest, 1e-30)))
    across, up = perpendicular(direction)
    places += [x * across + y * up for x, y in _MORE_LINES] if reentrant else []
    for aside in places:
        start, along = _line(origin, direction, aside, radius, begin, s)
        tried = beside & ~found
        enters = _enters(world, start, along, medium, tried)
        shift = dr.select(enters, aside, shift)
        found |= enters
    result = copy(paths)
    result.origin, result.direction = _line(origin, direction, shift, radius, begin, s)
    flux = Array3f(0)
    for segments, there in steps:
        endless = segments.length <= 0  # in empty space
        here = there & (segments.offset <= begin) & (endless | (begin < segments.offset + segments.length))
        faded = world.media.absorbed(segments.medium, dr.maximum(begin - segments.offset, 0))
        flux = dr.select(here, segments.flux * faded, flux)
    result.flux = dr.select(beside, flux, 0)
    result.medium = world.medium_of_view(result.origin, result.direction)
    result.offset, result.reach = Float(begin), paths.reach - begin
    dr.eval(result, found)
    lit = beside & (dr.max(result.flux) > 0)
    return result, lit & found, lit & ~found


def _along(paths: LightPaths, steps: Steps, flux: Array3f, medium: UInt32, box: Box) -> Segments:
    """Return short segments in the middle of a medium's box, from which beams reach as far as the box does."""
    result, (low, high) = copy(steps[0][0]), (opaque(each) for each in box)
    middle = dr.dot(0.5 * (low + high) - paths.origin, paths.direction)
    result.offset = dr.clip(middle, 0, (1 - _SHORT) * paths.total)
    result.length = dr.minimum(_SHORT * dr.norm(high - low), paths.total - result.offset)
    result.origin, result.width = dr.fma(paths.direction, result.offset, paths.origin), paths.width.later(result.offset)
    result.flux, result.medium = flux, medium + dr.zeros(UInt32, dr.width(paths.number))
    result.slant, result.slant_end = (dr.full(Float, AS_FAR, dr.width(paths.number)) for _ in range(2))
    result.room, result.room_end = (dr.full(Float, dr.inf, dr.width(paths.number)) for _ in range(2))
    return result


def _line(
    origin: Array3f, direction: Array3f, aside: Array3f, radius: RadiusAt, begin: Float, s: Float
) -> tuple[Array3f, Array3f]:
    """Return the line that is `aside` radii from an axis, from the distance `begin` on: its origin and direction."""
    start, there = radius(begin), radius(s)
    slope = dr.select(s - begin > 1e-6 * s, (there - start) / dr.maximum(s - begin, 1e-30), 0)
    return dr.fma(direction, begin, origin) + start * aside, dr.normalize(direction + slope * aside)


@syntax
def _nearest(origin: Array3f, direction: Array3f, low: Array3f, high: Array3f, first: Float, last: Float) -> Float:
    """Return the distances along rays, between `first` and `last`, at which they are nearest to a box.

    The distance to a box is a convex function of position, so the sign of its derivative says on which side to go on.
    """
    begin, end, step = Float(first), Float(last), UInt32(0)
    while step < _STEPS:
        s = 0.5 * (begin + end)
        point = dr.fma(direction, s, origin)
        recedes = dr.dot(point - dr.clip(point, low, high), direction) > 0
        begin, end = dr.select(recedes, begin, s), dr.select(recedes, s, end)
        step += 1
    return 0.5 * (begin + end)


def _enters(world: World, origin: Array3f, direction: Array3f, medium: UInt32, active: Bool) -> Bool:
    """Return which rays meet a boundary behind which a medium begins, or before which it ends."""
    plugin = world.around
    return dr.isfinite(distance_to_medium(plugin, origin, direction, medium, active, world.size, ends=True))
