"""Coverage: the fraction of a photon's disc that lies on its surface, and of a beam that lies in its medium.

Beyond edges, in walls and outside of a medium nothing is gathered, so light that a kernel spreads there is lost. To
keep its flux, a kernel is divided by the fraction that is covered (boundary-corrected kernels). A kernel of which
little is covered is narrowed first.

That keeps the sum, but within a radius of the boundary a third of the light would be missing, and lie farther in. So
kernels of beams are also reflected at the boundary (Schuster 1985; Silverman 1986, section 2.10): what lies beyond it
is folded back. A beam does not become two for that; it is either where it is or at its mirror image, with probabilities
that are the fractions of the medium's part and of the other. The same holds for the planes of walls that cut beams
(`sides`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...estimators.photons import FACING, THICKNESS
from ...numerics.arrays import to_float
from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.media.interfaces import is_boundary, is_left, transmits
from ...world.shadow_rays import gap_at, leaving
from ...world.warp import perpendicular
from ...world.world import World
from .records import Segments

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import SurfaceInteraction
    from .sides import Sides

mi = mitsuba()

# Numbers of points on a photon's disc, which are tested for the surface, and of lines along a beam, for the medium and
# for the planes that cut it.
_POINTS, _LINES, _CUT_LINES = 12, 8, 64

# Kernels with less coverage than this are halved, at most this many times: few points say little about a small object.
# Beside an edge, half of a photon is covered however narrow it is; if it were narrowed, it would be a bright dot.
_ENOUGH_OF_DISC, _ENOUGH_OF_BEAM, _HALVINGS = 0.3, 0.3, 4

# Most boundaries of media that a ray passes on its way from or to a point of a disc.
_LAYERS = 8

# Places along a beam from which a line is looked for, in this order, as fractions of the light lost along the beam.
_PLACES = (0.5, 0.05, 0.95)

#: Returns what rays meet, as `World.intersect` does; loops in kernels can take functions, but not worlds.
Meet = Callable[[Any, Any, Any, Any], Any]

#: The same, for rays that pass boundaries of media nearer than the distance that follows their directions.
MeetSurface = Callable[[Any, Any, Any, Any, Any], Any]


def surface_coverage(world: World, position: Array3f, normal: Array3f, radius: Float) -> tuple[Float, Float]:
    """Return the radii of photons' discs, narrowed if too little of a disc is on a surface, and the fraction that is.

    A point of the disc counts if a photon map would find the photon from there (`estimators.photons`), and nothing
    stands between the point and the photon. On cut-out surfaces it counts as much as its opacity; whether enough of a
    disc is covered is asked relative to the opacity where the photon is.
    """
    disc, gap = to_float(_disc(_POINTS)), gap_at(position, world.size)
    meet = _past_boundaries(world.uncut if world.cutouts else world)
    own, opacity = Float(1), world.opacity
    if world.cutouts:
        above = position + THICKNESS * radius * normal
        here = meet(above, -normal, THICKNESS * radius - gap, Bool(True), dr.arange(UInt32, dr.width(position)))
        own = dr.select(here.is_valid(), opacity(here, here.is_valid()), 1)
        dr.eval(own)

    def covered(factor: Float, tried: Bool) -> Float:
        return _on_surface(meet, opacity, position, normal, factor * radius, gap, disc, tried) / own

    factor, result = _enough(covered, dr.width(position), _ENOUGH_OF_DISC, 1 / _POINTS)
    return factor * radius, result * own


def _past_boundaries(world: World) -> MeetSurface:
    """Return what rays meet that pass boundaries of media, which a photon map does not know."""
    size = world.size

    def meet(origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32) -> SurfaceInteraction:
        hit = world.intersect(origin, direction, active, seed)
        if not world.media.all:
            return hit

        def further(hit: SurfaceInteraction, layer: UInt32, going: Bool) -> tuple[Any, ...]:
            beyond = leaving(hit, direction, size)
            passed = dr.dot(beyond - origin, direction)
            found = world.intersect(beyond, direction, going, seed)
            found.t += passed
            hit = dr.select(going, found, hit)
            return hit, layer + 1, going & is_boundary(hit) & (hit.t < reach)

        state = hit, UInt32(0), active & is_boundary(hit) & (hit.t < reach)
        return dr.while_loop(state, lambda *each: each[2] & (each[1] < _LAYERS), further, label="boundaries")[0]

    return meet


def _enough(covered: Callable[[Float, Bool], Float], count: int, enough: float, least: float) -> tuple[Float, Float]:
    """Return factors on radii with which enough of each kernel is covered, and that fraction, at least `least`."""
    factor, result = dr.ones(Float, count), dr.zeros(Float, count)
    for number in range(_HALVINGS + 1):
        tried = result < enough
        factor = dr.select(tried & (dr.opaque(UInt32, number) > 0), 0.5 * factor, factor)
        dr.eval(factor, tried)
        if not bool(dr.any(tried)):
            break
        result = dr.select(tried, covered(factor, tried), result)
        dr.eval(result)
    return factor, dr.maximum(result, least)


def _disc(count: int) -> np.ndarray:
    """Return points on the unit disc, (count, 2), with the density of Epanechnikov's kernel."""
    u = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.sqrt(1 - np.sqrt(1 - u))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@dr.syntax
def _on_surface(
    meet: MeetSurface, opacity: Callable[[Any, Bool], Float], position: Array3f, normal: Array3f, radius: Float,
    gap: Float, disc: Float, active: Bool,
) -> Float:  # fmt: skip
    """Return the fraction of each disc that is on a surface, times its opacity; discs are turned by different angles.

    A boundary of a medium is passed, but not within `gap` of the disc: there it may coincide with the surface.
    """
    lane = dr.arange(UInt32, dr.width(position))
    sine, cosine = dr.sincos(2 * dr.pi * unit_float(hash32(lane)))
    across, up = perpendicular(normal)
    across, up = cosine * across + sine * up, cosine * up - sine * across
    height = THICKNESS * radius
    total, point = Float(0), UInt32(0)
    while point < _POINTS:
        at = dr.gather(Array2f, disc, point)
        aside = (at.x * across + at.y * up) * radius
        above = position + aside + height * normal
        start = position + 1e-3 * height * normal
        way = above - start
        length = dr.norm(way)
        between = meet(start, way / length, length, active, hash32(lane, point))
        free = ~(between.is_valid() & (between.t < length) & ~transmits(between))
        below = meet(above, -normal, height - gap, active, hash32(lane, point))
        offset = Array3f(below.p) - position
        facing = dr.abs(dr.dot(Array3f(below.n), normal))
        there = free & below.is_valid() & (below.t < 2 * height) & (facing > FACING)
        # A slanted surface has more area than its projection onto the disc, and is farther from the photon.
        left = dr.maximum(1 - dr.squared_norm(offset) / dr.square(radius), 0)
        weight = left * dr.rcp((1 - dr.squared_norm(at)) * dr.maximum(facing, FACING))
        total += dr.select(there, weight * opacity(below, there), 0)
        point += 1
    return total * (1 / _POINTS)


#: Returns, for a factor on all radii: radii of beams at both ends, how far they reach beyond these, and the normal of
#: the plane in which they end.
BeamShape = Callable[[Any], tuple[Any, ...]]


def medium_coverage(
    world: World, segments: Segments, shape: BeamShape, decay: Float, active: Bool
) -> tuple[Float, Float, Array3f]:
    """Return factors that narrow beams of which too little is in their medium, the fraction that is, and shifts.

    What the planes of walls cut off is not in it.

    The fraction is the light on lines along the beam, until they leave the medium, over the light on the axis. A beam
    that crosses a plane at a slant loses nothing: what one side lacks, the other has beyond the axis' end. A shift
    moves a beam to its mirror image; the fraction is then that of the image.

    Parameters
    ----------
    decay
        Rate at which beams fade.
    active
        Which beams are tested; others are assumed to lie in the medium.
    """
    disc, cut = to_float(_disc(_LINES)), to_float(_disc(_CUT_LINES))

    def covered(factor: Float, tried: Bool, shift: Array3f | None = None) -> Float:
        aside = dr.zeros(Array3f) if shift is None else shift
        within = _in_medium(world.intersect, segments, shape(factor), aside, disc, decay, tried & active)
        if segments.sides is not None:
            within *= _uncut(segments.sides, segments, shape(factor), aside, cut, decay)
        return dr.select(active, within, 1)

    least = 0.5 / _LINES
    factor, result = _enough(covered, dr.width(segments.length), _ENOUGH_OF_BEAM, least)
    tried = active & (result < 1 - (least if segments.sides is None else 0.5 / _CUT_LINES))
    if not bool(dr.any(tried)):
        return factor, result, Array3f(0)
    shift = _to_image(world.intersect, segments, shape(factor), disc, decay, tried)
    if segments.sides is not None:
        mirrored = _behind_wall(segments.sides, segments, shape(factor), cut, decay)
        shift = dr.select(tried & (dr.squared_norm(mirrored) > 0), mirrored, shift)
    image = covered(factor, tried & (dr.squared_norm(shift) > 0), shift)
    # At an edge, or where a beam leaves the boundary at a slant, the image may lie outside, too: it would be a streak.
    reflected = tried & (dr.squared_norm(shift) > 0) & (image > _ENOUGH_OF_BEAM)
    return factor, dr.select(reflected, image, result), dr.select(reflected, shift, 0)


def _to_image(
    meet: Meet, segments: Segments, shape: tuple[Any, ...], disc: Float, decay: Float, active: Bool
) -> Array3f:
    """Return shifts of beams to their mirror images, 0 for those that stay.

    One line of each is chosen at random. If it lies outside of the medium, the boundary before it is the mirror.
    """
    own = hash32(segments.index, segments.key, segments.depth)
    across, up = _turned(segments.direction, own)
    at = dr.gather(Array2f, disc, hash32(own, UInt32(_LINES + 1)) % _LINES)
    aside = at.x * across + at.y * up
    rho = dr.norm(aside)
    first, slope, length, ending = _straightened(segments, shape, decay)
    s = _place(_PLACES[0], length, ending, decay)
    hit = meet(dr.fma(segments.direction, s, segments.origin), aside / rho, active, own)
    beyond = active & _leaves(hit, aside, segments.medium) & (hit.t < dr.fma(slope, s, first) * rho)
    normal = Array3f(hit.n)
    return dr.select(beyond, 2 * hit.t * dr.dot(aside / rho, normal) * normal, 0)


def _behind_wall(sides: Sides, segments: Segments, shape: tuple[Any, ...], disc: Float, decay: Float) -> Array3f:
    """Return shifts of beams to their mirror images by the walls beside them, 0 for those that stay."""
    own = hash32(segments.index, segments.key, segments.depth)
    across, up = _turned(segments.direction, own)
    at = dr.gather(Array2f, disc, hash32(own, UInt32(_CUT_LINES + 1)) % _CUT_LINES)
    first, slope, length, ending = _straightened(segments, shape, decay)
    s = _place(_PLACES[0], length, ending, decay)
    axis = dr.fma(segments.direction, s, segments.origin)
    hop = (at.x * across + at.y * up) * dr.fma(slope, s, first)
    height = dr.dot(sides.beside, axis - sides.place)
    return dr.select(height + dr.dot(sides.beside, hop) < 0, -2 * height * sides.beside, 0)


@dr.syntax
def _uncut(
    sides: Sides, segments: Segments, shape: tuple[Any, ...], shift: Array3f, disc: Float, decay: Float
) -> Float:  # fmt: skip
    """Return the fraction of the light of beams that is before the planes that cut them, if they are shifted."""
    _, last, lead, end, plane = shape
    first, slope, length, _ = _straightened(segments, shape, decay)
    origin, direction = segments.origin + shift, segments.direction
    across, up = _turned(direction, hash32(segments.index, segments.key, segments.depth))
    slant = last * dr.rcp(dr.select(dr.abs(dr.dot(direction, plane)) > 1e-6, dr.dot(direction, plane), dr.inf))
    thin = decay * length <= 1e-3
    whole, total, line = Float(0), Float(0), UInt32(0)
    while line < _CUT_LINES:
        at = dr.gather(Array2f, disc, line)
        aside = at.x * across + at.y * up
        begin, stop = -lead, length + end - dr.clip(dr.dot(aside, plane) * slant, -last, last)
        whole += dr.select(thin, stop - begin, dr.exp(-decay * begin) - dr.exp(-decay * stop))
        stop = length + end + last
        for place, normal in (*sides.planes(), (dr.fma(direction, length + end, origin), plane)):
            height = dr.dot(normal, dr.fma(aside, first, origin) - place)
            rising = dr.dot(normal, dr.fma(slope, aside, direction))
            there = -height * dr.rcp(dr.select(rising == 0, 1, rising))
            begin = dr.select(rising > 0, dr.maximum(begin, there), begin)
            stop = dr.select(rising < 0, dr.minimum(stop, there), stop)
            stop = dr.select((rising == 0) & (height < 0), begin, stop)
        stop = dr.maximum(begin, stop)
        total += dr.select(thin, stop - begin, dr.exp(-decay * begin) - dr.exp(-decay * stop))
        line += 1
    return total * dr.rcp(dr.maximum(whole, 1e-30))


def _straightened(segments: Segments, shape: tuple[Any, ...], decay: Float) -> tuple[Float, Float, Float, Float]:
    """Return the first radius of beams, by how much it grows, their length, and the fraction of light lost there."""
    length = dr.minimum(segments.length, 1e18)
    slope = (shape[1] - shape[0]) * dr.rcp(dr.maximum(length, 1e-20))
    return shape[0], slope, length, 1 - dr.exp(-decay * length)


def _place(part: float, length: Float, ending: Float, decay: Float) -> Float:
    """Return the distance along beams at which a part of the light that they lose is lost."""
    faded = -dr.log(1 - part * ending) * dr.rcp(dr.maximum(decay, 1e-30))
    return dr.select(ending > 1e-3, dr.minimum(faded, length), part * length)


def _turned(direction: Array3f, seed: UInt32) -> tuple[Array3f, Array3f]:
    """Return two axes across beams, turned by different angles."""
    across, up = perpendicular(direction)
    sine, cosine = dr.sincos(2 * dr.pi * unit_float(seed))
    return cosine * across + sine * up, cosine * up - sine * across


@dr.syntax
def _in_medium(
    meet: Meet, segments: Segments, shape: tuple[Any, ...], shift: Array3f, disc: Float, decay: Float,
    active: Bool,
) -> Float:  # fmt: skip
    """Return the fraction of beams' light that is in their medium, if they are shifted."""
    _, last, lead, end, plane = shape
    first, slope, length, ending = _straightened(segments, shape, decay)
    origin, direction, medium = segments.origin, segments.direction, segments.medium
    own = hash32(segments.index, segments.key, segments.depth)
    across, up = _turned(direction, own)
    slant = last * dr.rcp(dr.select(dr.abs(dr.dot(direction, plane)) > 1e-6, dr.dot(direction, plane), dr.inf))
    total, line = Float(0), UInt32(0)
    while line < _LINES:
        at = dr.gather(Array2f, disc, line)
        aside = at.x * across + at.y * up
        most = length + end - dr.clip(dr.dot(aside, plane) * slant, -last, last)
        tilted = dr.fma(slope, aside, direction)
        stretch = dr.norm(tilted)
        found, begin, stop = Bool(False), Float(0), Float(0)
        for part in _PLACES:
            s = _place(part, length, ending, decay)
            point = dr.fma(direction, s, origin)
            hop = aside * dr.fma(slope, s, first) + shift
            far = dr.norm(hop)
            there = point + hop
            free = _free(meet, point, hop * dr.rcp(dr.maximum(far, 1e-30)), medium, hash32(own, line), active & ~found)
            inside = active & ~found & (free > far)
            ahead = _free(meet, there, tilted / stretch, medium, hash32(own, line), inside) / stretch
            back = _free(meet, there, -tilted / stretch, medium, hash32(own, line), inside) / stretch
            begin = dr.select(inside, dr.maximum(s - back, -lead), begin)
            stop = dr.select(inside, dr.minimum(s + ahead, most), stop)
            found |= inside
        thin = ending <= 1e-3
        light = dr.exp(-decay * begin) - dr.exp(-decay * stop)
        total += dr.select(found, dr.select(thin, (stop - begin) / length, light / ending), 0)
        line += 1
    return total * (1 / _LINES)


def _free(meet: Meet, origin: Array3f, direction: Array3f, medium: UInt32, seed: UInt32, active: Bool) -> Float:
    """Return the distance at which rays leave a medium.

    Walls within the medium do not count: the part of a beam behind a board, or beside the hole that it came through, is
    visible.
    """
    hit = meet(origin, direction, active, seed)
    return dr.select(active & _leaves(hit, direction, medium), hit.t, dr.inf)


def _leaves(hit: SurfaceInteraction, direction: Array3f, medium: UInt32) -> Bool:
    """Return which rays leave a medium where they meet something."""
    return hit.is_valid() & is_left(hit, direction, medium)
