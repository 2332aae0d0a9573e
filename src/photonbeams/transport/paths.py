"""Light paths: segments in media, which become beams, and photons on surfaces.

Paths are traced as a wavefront: all of them take their next step at once, with one kernel for each step, and those that
go on are kept, in order. A segment carries the light that leaves a scattering event. It reaches to the next surface (a
*long* beam), or ends at the next event in the medium (*short*). Free flights are sampled by transmittance, directions
by phase functions and BSDFs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import compressed, joined, to_float, unaliased
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..world.differentials import RayDifferentials
from ..world.emitters.rays import OF_PATHS, EmittedRays
from ..world.media.interfaces import distance_to_medium, is_left
from ..world.media.phases import Phases
from ..world.warp import facing
from ..world.world import World
from .aiming import Aimed
from .bending import carry
from .interactions import (
    IDEAL,
    REFLECTED,
    SAMPLED,
    SCATTERED,
    TINTED,
    Interaction,
    Scatter,
    reflect,
    survival,
)
from .segments.narrowing import narrow
from .segments.radii import Width, width
from .segments.records import Counts, LightPaths, PhotonHits, Segments, tangent
from .splitting import continued, divisible, split
from .tally import TallyBeginnings
from .tracing import Tracing

# Greatest relative flux of a path by which its radius is chosen: see `_scattered_radius`.
_BRIGHTEST = 8.0

# Factor on the radius of photons whose paths were scattered at random: see `_photon_hits`.
_DOZEN = 3.0

# Tangent of the slant of light that reaches on beyond a boundary as far as there is room.
AS_FAR = 1e6

# Number of steps after which mirrors and lenses end ray differentials: light that is still specular then is faint.
_COHERENT = 8

# When at most _LAST paths are left, from step _LATE on, they take _TOGETHER steps in one kernel: light that is caught
# in glass may take hundreds of steps, and a kernel of few lanes takes as long as one of thousands.
_LAST, _TOGETHER, _LATE = 1024, 64, 12


# Fields that identify a path, and fields about its lamp: most steps leave them as they are.
_NAMES = ("number", "index", "key", "source")
_STRAIGHT = ("portal", "total", "against", "narrow", "clear")

#: Returns which segments are the last that matter of their paths, which are given as they go on.
Last = Callable[[Segments, LightPaths], Bool]


def begin(tracing: Tracing, emitted: Sequence[EmittedRays]) -> LightPaths | None:
    """Return light paths as they leave their emitters; None if there are none, or all would be too long."""
    paths = leaving(tracing, emitted)
    return None if paths is None else kept(paths.initial > 0, paths)


def leaving(tracing: Tracing, emitted: Sequence[EmittedRays]) -> LightPaths | None:
    """Return all light paths, including those without flux; None if there are none, or all would be too long."""
    if not emitted or (tracing.max_bounces is not None and tracing.max_bounces < 0):
        return None
    paths = LightPaths()
    for name, value in joined([{name: getattr(each, name) for name in OF_PATHS} for each in emitted]).items():
        setattr(paths, name, value)
    total = dr.width(paths.origin)
    # Not a bare counter: once it is evaluated, Dr.Jit uses it for every other counter of the same length, and kernels
    # for that length have another form than those for others.
    paths.number = dr.arange(UInt32, total) + dr.opaque(UInt32, 0)
    paths.depth, paths.branch, paths.part = (dr.zeros(UInt32, total) for _ in range(3))
    paths.straight = paths.coherent = dr.full(Bool, True, total)
    paths.radius, paths.offset, paths.slant = (dr.zeros(Float, total) for _ in range(3))
    paths.fraction, paths.narrow = dr.ones(Float, total), dr.ones(Float, total)
    paths.clear = dr.full(Float, dr.inf, total)
    paths.initial = dr.max(paths.flux)
    # For looks, light ends at the bounds.
    paths.total, paths.reach = paths.reach, tracing.escape(paths, paths.reach)
    paths.against = -paths.direction
    across = tracing.world.bounds.beyond(paths.origin, paths.direction)
    overlap = dr.opaque(Float, tracing.overlap)
    paths.width = width(paths.differentials, paths.direction, across, paths.count, overlap, paths.portal)
    if tracing.world.apart:
        halvings = joined(
            [dr.opaque(UInt32, each.halvings) + dr.zeros(UInt32, dr.width(each.index)) for each in emitted]
        )
        most = max(each.halvings for each in emitted)
        narrow(tracing.world, paths, dr.opaque(Float, tracing.scale), halvings, most)
    result: LightPaths = unaliased(paths)  # the first step runs the kernel of later steps
    return result


def trace(
    tracing: Tracing, paths: LightPaths | None, beginnings: TallyBeginnings | None = None
) -> Iterator[tuple[Segments | None, PhotonHits | None]]:
    """Yield segments in media and photons on surfaces, step by step; either is None if a step has none.

    Where walks of the tally begin is added to `beginnings`.
    """
    step = 0
    while paths is not None:
        if step >= _LATE and dr.width(paths.number) <= _LAST and not bool(dr.any(paths.coherent)):
            segments, in_medium, hits, on_surface, following, going = _several_steps(tracing, paths, step)
            step += _TOGETHER
        else:
            if beginnings is not None:
                beginnings.add(paths, step)
            paths = split(tracing, paths, step)
            segments, in_medium, hits, on_surface, following, going = _step(tracing, paths, step)
            step += 1
        yield kept(in_medium, segments), kept(on_surface, hits)
        paths = kept(going, following)


def straight(tracing: Tracing, paths: LightPaths, last: Last | None = None) -> Iterator[tuple[Segments, Bool]]:
    """Yield segments of light straight from its lamp, step by step, and which lanes have one that counts.

    In empty space there are segments, too, whose length is 0 if they end nowhere. Paths keep their lanes, so they can
    be paired with the same paths at another time. The segments are those of `trace`, up to the `last` of each path.
    """
    step, alive = 0, paths.initial > 0
    while True:
        paths.branch = continued(divisible(tracing, paths)) + dr.zeros(UInt32, dr.width(paths.branch))
        segments, _, _, _, following, going = _step(tracing, paths, step)
        yield segments, alive & (dr.max(paths.flux) > 0) & paths.beaming
        alive = alive & going
        if last is not None:
            alive &= ~last(segments, following)
        if not bool(dr.any(alive)):
            return
        following.flux = dr.select(alive, following.flux, 0)
        paths, step = following, step + 1


def kept(mask: Bool, value: Any) -> Any:
    """Return the entries of a struct where `mask` is true; None if there are none.

    A single entry gets a second one without flux, because Dr.Jit treats arrays of one entry as scalars, in other
    kernels.
    """
    found = compressed(mask, value)
    if not found:
        return None
    if dr.width(found[0].flux) == 1:
        twice = joined([found[0], found[0]])
        twice.flux = twice.flux * Float(dr.arange(UInt32, 2) == dr.opaque(UInt32, 0))
        dr.eval(twice)
        return twice
    return found[0]


def _step(tracing: Tracing, paths: LightPaths, step: int) -> tuple[Any, ...]:
    """Take one step of all paths; return segments, photons and continued paths, each followed by its mask."""
    stream = hash32(paths.key, dr.opaque(UInt32, step), paths.branch, paths.part)
    segments, in_medium, hits, on_surface, following, going, bent, width_there = _stepped(tracing, paths, stream)
    if tracing.world.reentrant:
        _reach_on(tracing.world, segments, paths.straight)
    dr.eval(segments, in_medium, hits, on_surface, following, going, bent, width_there)
    if step < _COHERENT:
        carry(tracing, paths, following, bent, stream)
    else:  # null collisions and boundaries, which are many in smoke, leave differentials as they are
        following.radius = dr.select(bent, width_there, following.radius)
        following.coherent &= ~bent
    return segments, in_medium, hits, on_surface, following, going


def _several_steps(tracing: Tracing, paths: LightPaths, step: int) -> tuple[Any, ...]:
    """Take many steps in one kernel, like `_step`; no path is coherent, so none splits or has differentials."""
    count = dr.width(paths.number)
    size, lane = count * _TOGETHER, dr.arange(UInt32, count) + dr.opaque(UInt32, 0)
    segments, hits = dr.zeros(Segments, size), dr.zeros(PhotonHits, size)
    in_medium, on_surface = dr.zeros(Bool, size), dr.zeros(Bool, size)
    first, stride = dr.opaque(UInt32, step), dr.opaque(UInt32, count)

    def body(paths: LightPaths, going: Bool, number: UInt32) -> tuple[LightPaths, Bool, UInt32]:
        stream = hash32(paths.key, first + number, UInt32(SAMPLED), paths.part)
        paths.branch = dr.zeros(UInt32, count)
        found, within, photons, there, following, goes, *_ = _stepped(tracing, paths, stream)
        slot = number * stride + lane
        for target, values, mask in ((segments, found, within), (hits, photons, there)):
            dr.scatter(target, values, slot, going & mask)
        dr.scatter(in_medium, within, slot, going)
        dr.scatter(on_surface, there, slot, going)
        return following, going & goes, number + 1

    state = paths, dr.full(Bool, True, count), dr.zeros(UInt32, count)
    following, going, _ = dr.while_loop(
        state, lambda _, going, number: going & (number < _TOGETHER), body, label="last paths"
    )
    dr.eval(segments, hits, in_medium, on_surface, following, going)
    return segments, in_medium, hits, on_surface, following, going


def _stepped(tracing: Tracing, paths: LightPaths, stream: UInt32) -> tuple[Any, ...]:
    """Take one step; return also which paths a mirror or lens has turned, and how wide these are there."""
    hit = tracing.world.intersect(paths.origin, paths.direction, Bool(True), hash32(stream, paths.index), paths.link)
    interaction = Interaction(tracing, paths, hit, stream)
    segments = _segments(tracing, paths, interaction)
    aimed = None
    if tracing.openings is not None:
        aimed = tracing.openings.aimed(interaction.position, paths.index, stream)
    scatter = reflect(tracing.world, hit, interaction.on_surface, paths.medium, paths.index, stream, aimed)
    passes = interaction.tinted | (interaction.on_surface & scatter.null)
    unfiltered = interaction.weight  # also of light that goes straight on, for what comes next
    interaction.weight = unfiltered * tracing.filtered(paths, interaction, stream)  # `*=` would change both
    following = _following(
        tracing=tracing,
        paths=paths,
        interaction=interaction,
        scatter=scatter,
        stream=stream,
        aimed=aimed,
        passes=passes,
        unfiltered=unfiltered,
    )
    hits = _photon_hits(paths, interaction, segments.width)
    # Of a path and the parts into which it splits, only one contributes the segment.
    whole = (paths.branch != SCATTERED) & (paths.branch != REFLECTED)
    in_medium = (paths.medium > 0) & (interaction.length > 0) & whole & (dr.max(paths.flux) > 0)
    shown = ~paths.straight & paths.counting(Counts.PHOTONS, Counts.CAUSTIC_PHOTONS)
    shown |= paths.straight & ((paths.counts & int(Counts.DIRECT_PHOTONS)) > 0)
    on_surface = interaction.on_surface & interaction.smooth & whole & shown
    in_medium &= tracing.within(paths.depth, paths.source)
    in_medium &= paths.beaming
    bent = interaction.going & interaction.on_surface & following.coherent & ~scatter.null
    width_there = segments.width(interaction.distance)
    return segments, in_medium, hits, on_surface, following, interaction.going, bent, width_there


def _following(
    tracing: Tracing, paths: LightPaths, interaction: Interaction, scatter: Scatter, stream: UInt32,
    aimed: Aimed | None, passes: Bool, unfiltered: Array3f,
) -> LightPaths:  # fmt: skip
    """Return the paths after their interaction; `interaction.going` is then false for those that end."""
    following = LightPaths()
    phases = Phases(interaction.position, paths.direction, paths.medium, interaction.scatters)
    lobe = unit_float(hash32(paths.index, stream, UInt32(Stream.LOBE)))
    u = pixel_sample(paths.index, hash32(stream, UInt32(Stream.TURN)))
    turned, weight, _ = phases.sample(lobe, Array2f(u), interaction.scatters)
    ratio = Float(1)
    if aimed is not None:
        taken = interaction.scatters & aimed.taken
        turned = dr.select(taken, aimed.direction, turned)
        value, density = phases.value(turned, interaction.scatters)
        weight = dr.select(taken, value * dr.rcp(dr.maximum(density, 1e-30)), weight)
        ratio = aimed.ratio(turned, density, Bool(True))
        weight *= ratio
    following.direction = _chosen(interaction, turned, scatter.direction, paths.direction)
    following.origin = dr.select(interaction.on_surface, scatter.origin, interaction.position)
    arriving = dr.select(passes, unfiltered, interaction.weight)
    following.flux = paths.flux * arriving * _chosen(interaction, weight, scatter.weight, Array3f(1))
    following.flux = tracing.linked(paths, interaction, scatter.delta, following.flux)
    following.depth = paths.depth + dr.select(passes, 0, 1)
    following.medium = dr.select(interaction.on_surface, scatter.medium, paths.medium)
    enters = interaction.on_surface & (following.medium != paths.medium)
    following.slant = dr.select(enters, tangent(interaction.hit.n, following.direction), 0)
    following.straight = paths.straight & passes
    following.coherent = paths.coherent & (interaction.tinted | (interaction.on_surface & scatter.delta))
    for name in (*_NAMES, *_STRAIGHT, "count", "part"):
        setattr(following, name, getattr(paths, name))
    # Directions toward openings are chosen more often and carry less light each; Russian roulette must not undo that.
    following.initial = paths.initial * _chosen(interaction, ratio, scatter.ratio, Float(1))
    following.narrow = dr.select(passes, paths.narrow, 1)
    following.clear = dr.select(passes, paths.clear, -dr.inf)
    following.link = dr.select(passes, paths.link, 0)
    following.offset = paths.offset + dr.dot(following.origin - paths.origin, paths.direction)
    following.reach = dr.select(
        passes, paths.reach - interaction.distance,
        tracing.escape(paths, tracing.world.escape(following.origin, following.direction)),
    )  # fmt: skip
    following.width = paths.width.later(interaction.distance)
    following.branch = dr.select(interaction.tinted, UInt32(TINTED), UInt32(SAMPLED))
    following.fraction = paths.fraction * dr.select(interaction.on_surface, scatter.probability, 1)
    # Along a segment, the derivative of the origin grows with the distance; `bending.carry` handles mirrors and lenses.
    following.differentials = RayDifferentials.of(
        [(p + interaction.distance * d, d) for p, d in paths.differentials.columns()]
    )
    going = interaction.going & (dr.max(following.flux) > 0)
    going &= tracing.within(following.depth, following.source)
    ideal = interaction.on_surface & scatter.delta
    following.counts = _counts(paths, interaction, passes, ideal)
    going &= following.counts > 0
    going &= dr.select(paths.branch == IDEAL, ideal, (paths.branch != REFLECTED) | ~ideal)
    _roulette(tracing, following, passes, stream, going)
    following.radius = dr.select(following.coherent | passes, paths.radius, _scattered_radius(tracing, following))
    interaction.going = going & (dr.max(following.flux) > 0)
    return following


def _counts(paths: LightPaths, interaction: Interaction, passes: Bool, ideal: Bool) -> UInt32:
    """Return what counts of paths after their interactions, which pass, or are turned by `ideal` mirrors or glass.

    A path that something else turns first brings no caustic. Behind a surface that scatters it, a path brings no
    photons of caustics any more.
    """
    lost = dr.select(interaction.on_surface, UInt32(int(Counts.CAUSTIC_PHOTONS)), UInt32(0))
    lost = dr.select(paths.straight, UInt32(int(Counts.CAUSTICS)), lost)
    lost |= UInt32(int(Counts.TALLIED))
    lost = dr.select(ideal, UInt32(0), lost) | UInt32(int(Counts.DIRECT_PHOTONS | Counts.DIRECT_BEAMS))
    return paths.counts & ~dr.select(passes, UInt32(0), lost)


def _chosen(interaction: Interaction, scattered: dr.ArrayT, reflected: dr.ArrayT, same: dr.ArrayT) -> dr.ArrayT:
    """Return, for each path, the value for its kind of interaction."""
    return dr.select(interaction.scatters, scattered, dr.select(interaction.on_surface, reflected, same))


def _scattered_radius(tracing: Tracing, following: LightPaths) -> Float:
    """Return the radius of beams that were scattered at random.

    N lines through a region of size ℓ are √(ℓ²/N) apart. They are placed at random, so they should overlap more than
    stratified ones. The radiance of a beam is its flux over its width. A path with more flux than others is therefore
    wider by the same factor; otherwise it would be a bright streak.
    """
    pairs = list(zip(tracing.paths, tracing.power, strict=True))
    # Two entries at least, because a gather from one entry is a broadcast, hence another kernel.
    rarity = to_float([*(count / max(power, 1e-30) for count, power in pairs), 0])
    usual = to_float([*(tracing.overlap * tracing.region / np.sqrt(max(count, 1)) for count, _ in pairs), 0])
    light = dr.max(following.flux) * dr.gather(Float, rarity, following.source)
    return dr.gather(Float, usual, following.source) * dr.clip(light, 1, _BRIGHTEST)


def _roulette(tracing: Tracing, paths: LightPaths, passes: Bool, stream: UInt32, active: Bool) -> None:
    """End paths by Russian roulette, according to the fraction of the initial flux that is left.

    Parts of split paths end earlier, with the root of that fraction as their survival probability: deep light is faint,
    but may be all the light that a corner has.
    """
    part = dr.max(paths.flux) * dr.rcp(dr.maximum(paths.initial, 1e-30))
    late = paths.depth >= dr.opaque(UInt32, tracing.rr_depth)
    surviving = dr.select(late, survival(part, paths.depth), dr.sqrt(dr.minimum(part, 1)))
    tried = active & ~passes & (late | (paths.part > 0))
    survives = unit_float(hash32(paths.index, stream, UInt32(Stream.ROULETTE))) < surviving
    factor: Any = dr.select(tried, dr.select(survives, dr.rcp(dr.maximum(surviving, 1e-30)), 0), 1)
    paths.flux = paths.flux * factor
    paths.fraction = dr.select(tried & survives, paths.fraction * surviving, paths.fraction)


def _segments(tracing: Tracing, paths: LightPaths, interaction: Interaction) -> Segments:
    """Return the segments of paths up to the next surface; short ones, up to the interaction."""
    result = Segments()
    result.origin, result.direction, result.flux = paths.origin, paths.direction, paths.flux
    short = Bool(tracing.short) | interaction.varying
    result.length = dr.select(short, interaction.distance, interaction.length)
    normal = Array3f(interaction.hit.n)
    ends = interaction.valid & (interaction.on_surface | ~short)
    result.normal = dr.select(ends, facing(normal, paths.direction), -paths.direction)
    leaves = ends & is_left(interaction.hit, paths.direction, paths.medium)
    result.room = result.room_end = dr.full(Float, dr.inf, dr.width(paths.number))
    result.slant, result.slant_end = paths.slant, dr.select(leaves, tangent(normal, paths.direction), 0)
    result.medium, result.depth, result.offset = paths.medium, paths.depth, paths.offset
    for name in (*_NAMES, *_STRAIGHT):
        setattr(result, name, getattr(paths, name))
    neighbours = paths.count * paths.fraction
    own = width(paths.differentials, paths.direction, interaction.length, neighbours, dr.opaque(Float, tracing.overlap))
    scattered = Width(Float(0), paths.radius, Float(0), Float(0))
    result.width = dr.select(paths.straight, paths.width, dr.select(paths.coherent, own, scattered))
    result.scattered = ~paths.straight & ~paths.coherent
    return result


def _reach_on(world: World, segments: Segments, straight: Bool) -> None:
    """Let light straight from its lamp reach on beyond its segments in re-entrant media, up to the middles of the gaps.

    Where the axis of a beam has left such a medium, its rim may still be in it, or may be in it again.
    """
    reentrant = dr.zeros(Bool, dr.width(segments.length))
    for each in world.reentrant:
        reentrant |= segments.medium == dr.opaque(UInt32, each)
    tried, plugin = straight & reentrant & (segments.length > 0), world.around
    half = 0.5 * dr.minimum(segments.length, world.radius)
    for sign, slant, room in ((-1, "slant", "room"), (1, "slant_end", "room_end")):
        at = half if sign < 0 else segments.length - half
        begin = dr.fma(segments.direction, at, segments.origin)
        open_ = tried & (getattr(segments, slant) > 0)
        gap = distance_to_medium(plugin, begin, sign * segments.direction, segments.medium, open_, world.size) - half
        setattr(segments, room, dr.select(open_, dr.maximum(0.5 * gap, 0), dr.inf))
        setattr(segments, slant, dr.select(open_, AS_FAR, getattr(segments, slant)))


def _photon_hits(paths: LightPaths, interaction: Interaction, across: Width) -> PhotonHits:
    """Return the photons of paths at their interactions."""
    result = PhotonHits()
    result.position, result.direction = interaction.position, paths.direction
    normal: Any = Array3f(interaction.hit.n)
    result.normal = normal
    # On a slanted surface the footprint is longer by 1 / cos, and so is its area.
    cosine = dr.maximum(dr.abs(dr.dot(normal, paths.direction)), 0.05)
    # A ray meets many beams, but a point has few photons. So photons at random places overlap more: a dozen at a point.
    result.radius = across(interaction.distance) * dr.rsqrt(cosine) * dr.select(paths.coherent, Float(1), Float(_DOZEN))
    result.flux, result.depth = paths.flux * interaction.weight, paths.depth
    result.coherent, result.straight = paths.coherent, paths.straight
    result.whole = (paths.counts & int(Counts.PHOTONS)) > 0
    result.number, result.source = paths.number, paths.source
    return result
