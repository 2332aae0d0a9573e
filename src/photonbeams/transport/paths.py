"""Light paths through a Mitsuba scene: segments in media, which become beams, and photons on surfaces.

A wavefront: all paths take their next step at once, one kernel a step; those that go on are kept, in order. A segment
reaches from one event to the next surface, and carries the light that leaves the event (a *long* beam); or it ends at
the next event in the medium (*short*). Events in the medium follow the transmittance, on surfaces the BSDF.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ..numerics.arrays import compressed, joined
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.media import Media, pointers
from ..world.surroundings import Surroundings
from .emission import Emitted, Tangents, copies, differentiate, of_copies
from .events import CHANCE, LOBE, PASSES, SCATTERS, TURN, Event, Scatter, ray_of, reflect, sampled
from .radii import Width, width

mi = mitsuba()

# Name of samples in seeds, beside those of events.
_ROULETTE = 4

# Most that a path counts for when its radius is chosen: see `_scattered_radius`.
_BRIGHTEST = 8.0

# Factor on the radius of photons on surfaces that arrive there at random: see `_landed`.
_DOZEN = 3.0

# After so many events photon differentials are carried no further: what is still sharp then is faint.
_COHERENT = 8


class Paths:
    """Light paths after an event.

    `events` counts scattering in media and on surfaces; `straight` are paths that have passed nothing but interfaces of
    media; `coherent` are those whose neighbours take the same way, and whose `tangents` tell how far apart they are;
    the others have a `radius`. `first` is the flux at the emitter, `count` the size of the path's sequence, `share` the
    part of a path's neighbours that took the same way where chance chose: of a glass' reflection few hundredths.
    `fate` says what becomes of it next, if chance does not decide.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "flux": Array3f, "medium": UInt32, "number": UInt32, "events": UInt32,
        "straight": Bool, "coherent": Bool, "tangents": Tangents, "radius": Float, "first": Float, "count": Float,
        "share": Float, "fate": UInt32,
    }  # fmt: skip

    origin: Any
    direction: Any
    flux: Any
    medium: Any
    number: Any
    events: Any
    straight: Any
    coherent: Any
    tangents: Any
    radius: Any
    first: Any
    count: Any
    share: Any
    fate: Any


class Segments:
    """Stretches of light paths in media: `flux` at the start, `normal` of the surface at the end."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "flux": Array3f, "length": Float, "normal": Array3f, "width": Width,
        "medium": UInt32, "events": UInt32, "number": UInt32,
    }  # fmt: skip

    origin: Any
    direction: Any
    flux: Any
    length: Any
    normal: Any
    width: Any
    medium: Any
    events: Any
    number: Any


class Landed:
    """Photons on surfaces that do not come straight from an emitter: `direction` is that of the light."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "position": Array3f, "normal": Array3f, "direction": Array3f, "flux": Array3f, "radius": Float,
        "events": UInt32, "number": UInt32,
    }  # fmt: skip

    position: Any
    normal: Any
    direction: Any
    flux: Any
    radius: Any
    events: Any
    number: Any


@dataclass(frozen=True)
class Tracing:
    """How light paths are traced.

    Attributes
    ----------
    plugin, volumes
        The Mitsuba scene and its media.
    max_events, rr_depth
        Most events on a light path (None: any number), and after how many Russian roulette begins.
    overlap
        Width of a beam in spacings of its neighbours.
    reach, paths, power
        Size of the region that scattered light crosses, and how many paths of how much light there are: see
        `_scattered_radius`.
    escape
        Length of segments that meet no surface.
    short
        Whether beams end at the path's next event; in media that vary they always do.
    perturbed
        Whether BSDFs may have normals of their own, as `events.perturbs` tells.
    """

    plugin: Any
    volumes: Media
    max_events: int | None
    rr_depth: int
    overlap: float
    reach: float
    paths: int
    power: float
    escape: float
    short: bool = False
    perturbed: bool = False


def begin(tracing: Tracing, emitted: list[Emitted], surroundings: Surroundings) -> Paths | None:
    """Return light paths as they leave their emitters, or None where there are none, or all would be too long.

    `surroundings` tells the medium around each emitter.
    """
    if not emitted or (tracing.max_events is not None and tracing.max_events < 0):
        return None
    paths = Paths()
    for name in ("origin", "direction", "flux", "tangents", "count"):
        setattr(paths, name, joined([getattr(each, name) for each in emitted]))
    total = dr.width(paths.origin)
    paths.number = dr.arange(UInt32, total) + dr.opaque(UInt32, 0)
    paths.events = dr.zeros(UInt32, total)
    paths.straight = paths.coherent = dr.full(Bool, True, total)
    paths.radius, paths.share = dr.zeros(Float, total), dr.ones(Float, total)
    paths.first, paths.fate = dr.max(paths.flux), dr.zeros(UInt32, total)
    alive = paths.first > 0
    paths.medium = joined([surroundings.of_emitter(each.emitter, each.origin, each.direction) for each in emitted])
    kept = compressed(alive, paths)
    return kept[0] if kept else None


def trace(tracing: Tracing, paths: Paths | None, seed: Any, first: Any) -> Iterator[tuple[Segments | None, Any]]:
    """Yield segments in media and photons on surfaces, step by step; either may be None.

    `seed` and `first` are opaque: the seed of all samples and the place of the pass's first path in their sequences.
    """
    step = 0
    while paths is not None:
        paths = _split(tracing, paths)
        segments, in_medium, landed, on_surface, following, going = _step(tracing, paths, seed, first, step)
        yield _kept(in_medium, segments), _kept(on_surface, landed)
        paths = _kept(going, following)
        step += 1


def _split(tracing: Tracing, paths: Paths) -> Paths:
    """Return paths with those in two whose light is sharp: what is scattered before the next surface, and what is not.

    In thin fog few paths would be scattered, each of them bright. Of one that is split both parts carry what they
    should, so that as many paths are scattered as there are; it makes as many more, for one event each.
    """
    varying, _ = tracing.volumes.varying(paths.medium)
    both = paths.coherent & (paths.medium > 0) & ~varying & Bool(not tracing.short)
    scattered = _kept(both, paths)
    if scattered is None:
        return paths
    whole, scattered = copy(paths), copy(scattered)
    whole.fate = dr.select(both, UInt32(PASSES), UInt32(CHANCE))
    scattered.fate = dr.full(UInt32, SCATTERS, dr.width(scattered.fate))
    result: Paths = joined([whole, scattered])
    dr.eval(result)
    return result


def _kept(mask: Bool, value: Any) -> Any:
    """Return the entries of a struct where `mask`, None where there are none.

    One alone has a dark one beside it: to Dr.Jit arrays of one entry are numbers, and want kernels of their own.
    """
    kept = compressed(mask, value)
    if not kept:
        return None
    if dr.width(kept[0].flux) == 1:
        twice = joined([kept[0], kept[0]])
        twice.flux = twice.flux * Float(dr.arange(UInt32, 2) == dr.opaque(UInt32, 0))
        dr.eval(twice)
        return twice
    return kept[0]


def _step(tracing: Tracing, paths: Paths, seed: Any, first: Any, step: int) -> tuple[Any, ...]:
    """Return what one step of all paths leaves: segments, photons, the paths after it, and masks of which are there."""
    index, stream = paths.number + first, hash32(seed, dr.opaque(UInt32, step), paths.fate)
    hit = tracing.plugin.ray_intersect(ray_of(paths.origin, paths.direction))
    event = Event(tracing, paths, hit, index, stream)
    segments = _segments(tracing, paths, event)
    scatter = reflect(tracing, hit, event.on_surface, paths.medium, index, stream)
    following = _following(tracing, paths, event, scatter, index, stream)
    landed = _landed(paths, event, segments.width)
    in_medium = (paths.medium > 0) & (event.length > 0) & (paths.fate != SCATTERS)
    on_surface = event.on_surface & ~paths.straight & event.smooth
    if tracing.max_events is not None:
        in_medium &= paths.events <= tracing.max_events
    bent = event.going & event.on_surface & following.coherent & ~scatter.null
    dr.eval(segments, in_medium, landed, on_surface, following, event.going, bent)
    if step < _COHERENT:
        _carry(tracing, paths, following, bent, index, stream)
    else:
        following.coherent = dr.zeros(Bool, dr.width(bent))
    return segments, in_medium, landed, on_surface, following, event.going


def _following(tracing: Tracing, paths: Paths, event: Event, scatter: Scatter, index: UInt32, stream: UInt32) -> Paths:
    """Return the paths after their event; `event.going` loses those that end."""
    following = Paths()
    place = dr.zeros(mi.MediumInteraction3f, dr.width(paths.origin))
    place.p, place.wi = mi.Point3f(event.position), mi.Vector3f(-paths.direction)
    place.sh_frame = mi.Frame3f(place.wi)
    place.medium = pointers(dr.select(event.scatters, paths.medium, 0))
    phase = place.medium.phase_function()
    lobe = unit_float(hash32(index, stream, UInt32(LOBE)))
    u = pixel_sample(index, hash32(stream, UInt32(TURN)))
    turned, weight, _ = phase.sample(mi.PhaseFunctionContext(), place, lobe, mi.Point2f(u), event.scatters)
    following.direction = _chosen(event, Array3f(turned), scatter.direction, paths.direction)
    following.origin = dr.select(event.on_surface, scatter.origin, event.position)
    following.flux = paths.flux * event.weight * _chosen(event, Array3f(weight), scatter.weight, Array3f(1))
    passes = event.tinted | (event.on_surface & scatter.null)
    following.events = paths.events + dr.select(passes, 0, 1)
    following.medium = dr.select(event.on_surface, scatter.medium, paths.medium)
    following.straight = paths.straight & passes
    following.coherent = paths.coherent & (event.tinted | (event.on_surface & scatter.delta))
    following.number, following.first, following.count = paths.number, paths.first, paths.count
    following.fate = dr.zeros(UInt32, dr.width(paths.number))
    following.share = paths.share * dr.select(event.on_surface, scatter.chance, 1)
    # Straight on, a shift grows with the way; mirrors and lenses see to theirs later.
    following.tangents = Tangents.of([(p + event.way * d, d) for p, d in paths.tangents.columns()])
    going = event.going & (dr.max(following.flux) > 0)
    if tracing.max_events is not None:
        going &= following.events <= tracing.max_events
    _roulette(tracing, following, passes, index, stream, going)
    following.radius = dr.select(following.coherent | passes, paths.radius, _scattered_radius(tracing, following))
    event.going = going & (dr.max(following.flux) > 0)
    return following


def _chosen(event: Event, scattered: Any, reflected: Any, same: Any) -> Any:
    """Return the value that belongs to what happens to each path."""
    return dr.select(event.scatters, scattered, dr.select(event.on_surface, reflected, same))


def _scattered_radius(tracing: Tracing, following: Paths) -> Float:
    """Return the radius of beams that were scattered at random.

    N lines through a region of size ℓ cross it √(ℓ²/N) apart. They lie at random, so that they should overlap more than
    those in strata. What a ray sees of one is its light over its width; a path with more light than others is wider by
    as much, or it would be a bright streak.
    """
    light = dr.max(following.flux) * dr.opaque(Float, tracing.paths / max(tracing.power, 1e-30))
    usual = dr.opaque(Float, tracing.overlap * tracing.reach / np.sqrt(tracing.paths))
    return usual * dr.clip(light, 1, _BRIGHTEST)


def _roulette(tracing: Tracing, paths: Paths, passes: Bool, index: UInt32, stream: UInt32, active: Bool) -> None:
    """End paths at random that have lost most of their light, and give theirs to the others."""
    chance = dr.minimum(dr.max(paths.flux) * dr.rcp(dr.maximum(paths.first, 1e-30)), 0.95)
    tried = active & ~passes & (paths.events >= dr.opaque(UInt32, tracing.rr_depth))
    lives = unit_float(hash32(index, stream, UInt32(_ROULETTE))) < chance
    factor = dr.select(tried, dr.select(lives, dr.rcp(dr.maximum(chance, 1e-30)), 0), 1)
    paths.flux = paths.flux * factor
    paths.share = dr.select(tried & lives, paths.share * chance, paths.share)


def _carry(tracing: Tracing, paths: Paths, following: Paths, bent: Bool, index: UInt32, stream: UInt32) -> None:
    """Carry the tangents of paths over mirrors and through lenses, by forward-mode differentiation.

    Each path stands there four times, once for each tangent: a graph with calls of BSDFs is traversed but once.
    """
    lanes: Any = dr.compress(bent)
    if not len(lanes):
        return
    count = len(lanes)
    copy, which = copies(count)
    lane = dr.gather(UInt32, lanes, copy)
    shift, turn = Array3f(0), Array3f(0)
    for k, (p, d) in enumerate(paths.tangents.columns()):
        shift = dr.select(which == k, dr.gather(Array3f, p, lane), shift)
        turn = dr.select(which == k, dr.gather(Array3f, d, lane), turn)
    origin = mi.Point3f(dr.gather(Array3f, paths.origin, lane))
    direction = mi.Vector3f(dr.gather(Array3f, paths.direction, lane))
    with dr.resume_grad():
        dr.enable_grad(origin, direction)
        hit = tracing.plugin.ray_intersect(ray_of(origin, direction))
        sample, _ = sampled(hit, True, dr.gather(UInt32, index, lane), dr.gather(UInt32, stream, lane))
        p, d = differentiate([origin, direction], [hit.p, hit.to_world(sample.wo)], [shift, turn])
    shift, turn = Array3f(p), Array3f(d)
    dr.eval(shift, turn)
    columns = []
    bent_columns = of_copies(shift, turn, count).columns()
    for straight, changed in zip(following.tangents.columns(), bent_columns, strict=True):
        column = [Array3f(each) for each in straight]
        for each, value in zip(column, changed, strict=True):
            dr.scatter(each, value, lanes)
        columns.append((column[0], column[1]))
    following.tangents = Tangents.of(columns)
    dr.eval(following.tangents)


def _segments(tracing: Tracing, paths: Paths, event: Event) -> Segments:
    """Return the stretches of paths up to the next surface, or event."""
    result = Segments()
    result.origin, result.direction, result.flux = paths.origin, paths.direction, paths.flux
    short = Bool(tracing.short) | event.varying
    result.length = dr.select(short, event.way, event.length)
    normal = Array3f(event.hit.n)
    against = dr.select(dr.dot(normal, paths.direction) > 0, -normal, normal)
    result.normal = dr.select(event.valid & (event.on_surface | ~short), against, -paths.direction)
    result.medium, result.events, result.number = paths.medium, paths.events, paths.number
    neighbours = paths.count * paths.share
    own = width(paths.tangents, paths.direction, event.length, neighbours, dr.opaque(Float, tracing.overlap))
    squared = dr.square(paths.radius)
    result.width = Width(
        dr.select(paths.coherent, own.a, squared), dr.select(paths.coherent, own.b, 0),
        dr.select(paths.coherent, own.c, 0),
    )  # fmt: skip
    return result


def _landed(paths: Paths, event: Event, across: Width) -> Landed:
    """Return what arrives at surfaces."""
    result = Landed()
    result.position, result.direction = event.position, paths.direction
    result.normal = Array3f(event.hit.n)
    # On a slant the footprint is longer by 1 / cos, and its area with it.
    cosine = dr.maximum(dr.abs(dr.dot(result.normal, paths.direction)), 0.05)
    # Photons that arrive at random should overlap more than lines do, of which a ray meets many: a dozen a place.
    result.radius = across(event.way) * dr.rsqrt(cosine) * dr.select(paths.coherent, Float(1), Float(_DOZEN))
    result.flux, result.events, result.number = paths.flux * event.weight, paths.events, paths.number
    return result
