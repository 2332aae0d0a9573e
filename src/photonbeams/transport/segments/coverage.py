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
from ...numerics.syntax import syntax
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
        return (
            _on_surface(
                meet=meet,
                opacity=opacity,
                position=position,
                normal=normal,
                radius=factor * radius,
                gap=gap,
                disc=disc,
                active=tried,
            )
            / own
        )

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


@syntax
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
    sides = segments.sides
    cut = active & sides.any() if sides is not None else Bool(False)

    def within(lines: _BeamLines, tried: Bool, shift: Array3f) -> Float:
        result = _in_medium(world.intersect, lines, segments.medium, shift, tried & active)
        if sides is not None:
            result *= _uncut(sides, lines, shift, tried & cut)
        return dr.select(active, result, 1)

    def covered(factor: Float, tried: Bool) -> Float:
        return within(_BeamLines(segments, shape(factor), decay), tried, dr.zeros(Array3f))

    least = 0.5 / _LINES
    factor, result = _enough(covered, dr.width(segments.length), _ENOUGH_OF_BEAM, least)
    tried = active & (result < dr.select(cut, 1 - 0.5 / _CUT_LINES, 1 - least))
    if not bool(dr.any(tried)):
        return factor, result, Array3f(0)
    lines = _BeamLines(segments, shape(factor), decay)
    shift = _to_image(world.intersect, lines, segments.medium, tried)
    if sides is not None:
        mirrored = _behind_wall(sides, lines)
        shift = dr.select(tried & (dr.squared_norm(mirrored) > 0), mirrored, shift)
    image = within(lines, tried & (dr.squared_norm(shift) > 0), shift)
    # At an edge, or where a beam leaves the boundary at a slant, the image may lie outside, too: it would be a streak.
    reflected = tried & (dr.squared_norm(shift) > 0) & (image > _ENOUGH_OF_BEAM)
    return factor, dr.select(reflected, image, result), dr.select(reflected, shift, 0)


class _BeamLines:
    """Lines along beams that share their light equally; each beam's are turned by an angle of its own.

    A line is known by its place across the beam, in radii. Places on it are distances along the axis.
    """

    def __init__(self, segments: Segments, shape: tuple[Any, ...], decay: Float) -> None:
        self.first, self.last, self._lead, self._end, self.plane = shape
        self.origin, self.direction = segments.origin, segments.direction
        self.length = dr.minimum(segments.length, 1e18)
        self.slope = (self.last - self.first) * dr.rcp(dr.maximum(self.length, 1e-20))
        self.seed = hash32(segments.index, segments.key, segments.depth)
        self._decay, self._lost = decay, 1 - dr.exp(-decay * self.length)
        across, up = perpendicular(self.direction)
        sine, cosine = dr.sincos(2 * dr.pi * unit_float(self.seed))
        self._across, self._up = cosine * across + sine * up, cosine * up - sine * across
        level = dr.dot(self.direction, self.plane)
        self._slant = self.last * dr.rcp(dr.select(dr.abs(level) > 1e-6, level, dr.inf))

    def aside(self, disc: Float, line: UInt32) -> Array3f:
        """Return where a line is, of those through points of a disc."""
        at = dr.gather(Array2f, disc, line)
        return at.x * self._across + at.y * self._up

    def chosen(self, count: int) -> Array3f:
        """Return where one line of so many is, chosen at random for each beam."""
        return self.aside(to_float(_disc(count)), hash32(self.seed, UInt32(count + 1)) % count)

    def radius(self, s: Float) -> Float:
        """Return the radius of beams."""
        return dr.fma(self.slope, s, self.first)

    def axis(self, s: Float) -> Array3f:
        """Return points on the axis."""
        return dr.fma(self.direction, s, self.origin)

    def ends(self, aside: Array3f) -> tuple[Float, Float]:
        """Return where lines begin and end."""
        return -self._lead, self.tip - dr.clip(dr.dot(aside, self.plane) * self._slant, -self.last, self.last)

    @property
    def tip(self) -> Float:
        """Where the axis ends."""
        return self.length + self._end

    def place(self, part: float) -> Float:
        """Return where a part is lost of the light that the axis loses."""
        faded = -dr.log(1 - part * self._lost) * dr.rcp(dr.maximum(self._decay, 1e-30))
        return dr.select(self._lost > 1e-3, dr.minimum(faded, self.length), part * self.length)

    def light(self, begin: Float, stop: Float) -> Float:
        """Return the light that is lost between two places, relative to what the axis loses."""
        fading = (dr.exp(-self._decay * begin) - dr.exp(-self._decay * stop)) / self._lost
        return dr.select(self._lost > 1e-3, fading, (stop - begin) / self.length)


def _to_image(meet: Meet, lines: _BeamLines, medium: UInt32, active: Bool) -> Array3f:
    """Return shifts of beams to their mirror images, 0 for those that stay.

    One line of each is chosen at random. If it lies outside of the medium, the boundary before it is the mirror.
    """
    aside = lines.chosen(_LINES)
    rho, s = dr.norm(aside), lines.place(_PLACES[0])
    hit = meet(lines.axis(s), aside / rho, active, lines.seed)
    beyond = active & _leaves(hit, aside, medium) & (hit.t < lines.radius(s) * rho)
    normal = Array3f(hit.n)
    return dr.select(beyond, 2 * hit.t * dr.dot(aside / rho, normal) * normal, 0)


def _behind_wall(sides: Sides, lines: _BeamLines) -> Array3f:
    """Return shifts of beams to their mirror images by the walls beside them, 0 for those that stay."""
    s = lines.place(_PLACES[0])
    hop = lines.chosen(_CUT_LINES) * lines.radius(s)
    height = dr.dot(sides.beside, lines.axis(s) - sides.place)
    return dr.select(height + dr.dot(sides.beside, hop) < 0, -2 * height * sides.beside, 0)


@syntax
def _uncut(sides: Sides, lines: _BeamLines, shift: Array3f, active: Bool) -> Float:
    """Return the fraction of the light of beams that is before the planes that cut them, if they are shifted."""
    disc, planes = to_float(_disc(_CUT_LINES)), (*sides.planes(), (lines.axis(lines.tip) + shift, lines.plane))
    whole, total, line = Float(0), Float(0), UInt32(0)
    while active & (line < _CUT_LINES):
        aside = lines.aside(disc, line)
        begin, stop = lines.ends(aside)
        whole += lines.light(begin, stop)
        stop = lines.tip + lines.last
        for place, normal in planes:
            height = dr.dot(normal, dr.fma(aside, lines.first, lines.origin + shift) - place)
            rising = dr.dot(normal, dr.fma(lines.slope, aside, lines.direction))
            there = -height * dr.rcp(dr.select(rising == 0, 1, rising))
            begin = dr.select(rising > 0, dr.maximum(begin, there), begin)
            stop = dr.select(rising < 0, dr.minimum(stop, there), stop)
            stop = dr.select((rising == 0) & (height < 0), begin, stop)
        total += lines.light(begin, dr.maximum(begin, stop))
        line += 1
    return dr.select(active, total * dr.rcp(dr.maximum(whole, 1e-30)), 1)


@syntax
def _in_medium(meet: Meet, lines: _BeamLines, medium: UInt32, shift: Array3f, active: Bool) -> Float:
    """Return the fraction of beams' light that is in their medium, if they are shifted."""
    disc, total, line = to_float(_disc(_LINES)), Float(0), UInt32(0)
    while line < _LINES:
        aside = lines.aside(disc, line)
        least, most = lines.ends(aside)
        tilted, seed = dr.fma(lines.slope, aside, lines.direction), hash32(lines.seed, line)
        stretch = dr.norm(tilted)
        found, begin, stop = Bool(False), Float(0), Float(0)
        for part in _PLACES:
            s = lines.place(part)
            hop = aside * lines.radius(s) + shift
            far = dr.norm(hop)
            point = lines.axis(s)
            there = point + hop
            free = _free(meet, point, hop * dr.rcp(dr.maximum(far, 1e-30)), medium, seed, active & ~found)
            inside = active & ~found & (free > far)
            ahead = _free(meet, there, tilted / stretch, medium, seed, inside) / stretch
            back = _free(meet, there, -tilted / stretch, medium, seed, inside) / stretch
            begin = dr.select(inside, dr.maximum(s - back, least), begin)
            stop = dr.select(inside, dr.minimum(s + ahead, most), stop)
            found |= inside
        total += dr.select(found, lines.light(begin, stop), 0)
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
