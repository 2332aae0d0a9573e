"""Light paths through a Mitsuba scene: segments in media, which become beams, and photons on surfaces.

A wavefront: all paths take their next step at once, one kernel a step; those that go on are kept, in order. A segment
reaches from one event to the next surface, and carries the light that leaves the event (a *long* beam); or it ends at
the next event in the medium (*short*). Events in the medium follow the transmittance, on surfaces the BSDF.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr

from ..arrays import compressed, joined
from ..device import Array3f, Bool, Float, UInt32, mitsuba
from ..hashing import hash32, unit_float
from ..simulation.sampling import pixel_sample
from .emission import Emitted, Tangents, differentiate
from .footprints import Width, width
from .volumes import Volumes, medium_at, numbers, pointers

mi = mitsuba()

# Names of samples in seeds.
_FLIGHT, _LOBE, _TURN, _ROULETTE = 1, 2, 3, 4

# After so many events photon differentials are carried no further: what is still sharp then is faint.
_COHERENT = 8


class Paths:
    """Light paths after an event.

    `events` counts scattering in media and on surfaces; `straight` are paths that have passed nothing but borders of
    media; `coherent` are those whose neighbours take the same way, and whose `tangents` tell how far apart they are;
    the others have a `radius`. `first` is the flux at the emitter, `count` the size of the path's sequence.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "flux": Array3f, "medium": UInt32, "number": UInt32, "events": UInt32,
        "straight": Bool, "coherent": Bool, "tangents": Tangents, "radius": Float, "first": Float, "count": Float,
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
        "events": UInt32,
    }  # fmt: skip

    position: Any
    normal: Any
    direction: Any
    flux: Any
    radius: Any
    events: Any


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
    spread
        Radius of beams that were scattered, as a function of the flight's density: see `_scattered_radius`.
    escape
        Length of segments that meet no surface.
    short
        Whether beams end at the path's next event.
    """

    plugin: Any
    volumes: Volumes
    max_events: int | None
    rr_depth: int
    overlap: float
    reach: float
    escape: float
    short: bool = False


def begin(tracing: Tracing, emitted: list[Emitted], otherwise: Any) -> Paths | None:
    """Return light paths as they leave their emitters, or None where there are none.

    `otherwise` is the medium of the whole space, for emitters from which no border of a medium is seen.
    """
    if not emitted:
        return None
    paths = Paths()
    for name in ("origin", "direction", "flux", "tangents", "count"):
        setattr(paths, name, joined([getattr(each, name) for each in emitted]))
    total = dr.width(paths.origin)
    paths.number = dr.arange(UInt32, total) + dr.opaque(UInt32, 0)
    paths.events = dr.zeros(UInt32, total)
    paths.straight = paths.coherent = dr.full(Bool, True, total)
    paths.radius = dr.zeros(Float, total)
    paths.first = dr.max(paths.flux)
    alive = paths.first > 0
    paths.medium = medium_at(tracing.plugin, paths.origin, paths.direction, otherwise, alive)
    kept = compressed(alive, paths)
    return kept[0] if kept else None


def trace(tracing: Tracing, paths: Paths | None, seed: Any, first: Any) -> Iterator[tuple[Segments | None, Any]]:
    """Yield segments in media and photons on surfaces, step by step; either may be None.

    `seed` and `first` are opaque: the seed of all samples and the place of the pass's first path in their sequences.
    """
    step = 0
    while paths is not None:
        segments, in_medium, landed, on_surface, following, going = _step(tracing, paths, seed, first, step)
        dr.eval(segments, in_medium, landed, on_surface, following, going)
        yield (
            (compressed(in_medium, segments) or [None])[0],
            (compressed(on_surface, landed) or [None])[0],
        )
        paths = (compressed(going, following) or [None])[0]
        step += 1


def _step(tracing: Tracing, paths: Paths, seed: Any, first: Any, step: int) -> tuple[Any, ...]:
    """Return what one step of all paths leaves: segments, photons, the paths after it, and masks of which are there."""
    index, stream = paths.number + first, hash32(seed, dr.opaque(UInt32, step))
    # Coherence ends for good somewhere: two kinds of kernels, and no more.
    coherent = step < _COHERENT and bool(dr.any(paths.coherent))
    origin, direction = mi.Point3f(paths.origin), mi.Vector3f(paths.direction)
    if coherent:
        dr.enable_grad(origin, direction)
    with dr.resume_grad():
        ray = mi.Ray3f(origin, direction)
        found = tracing.plugin.ray_intersect_preliminary(dr.detach(ray), coherent=False)
        hit = found.compute_surface_interaction(ray, mi.RayFlags.All)
    event = _Event(tracing, paths, dr.detach(hit), index, stream)
    segments = _segments(tracing, paths, event)
    with dr.resume_grad():
        scatter = _reflect(hit, event.on_surface, index, stream)
    following = _following(tracing, paths, event, scatter, index, stream)
    if coherent:
        _carry(paths, following, event, [origin, direction], scatter)
    landed = _landed(paths, event, segments.width)
    in_medium = (paths.medium > 0) & (event.length > 0)
    on_surface = event.on_surface & ~paths.straight & event.smooth
    if tracing.max_events is not None:
        in_medium &= paths.events <= tracing.max_events
    return segments, in_medium, landed, on_surface, following, event.going


class _Event:
    """What happens next on paths: scattering in the medium, or a surface."""

    def __init__(self, tracing: Tracing, paths: Paths, hit: Any, index: UInt32, stream: UInt32) -> None:
        self.hit = hit
        self.valid = hit.is_valid()
        self.length = dr.select(self.valid, hit.t, dr.select(paths.medium > 0, Float(tracing.escape), 0))
        extinction = tracing.volumes.extinction(paths.medium)
        u = pixel_sample(index, hash32(stream, UInt32(_FLIGHT)))
        # A channel by the light that is left in it, so that no colour is carried by few paths.
        total = dr.sum(paths.flux)
        share = paths.flux * dr.rcp(dr.maximum(total, 1e-30))
        own = dr.select(u.x < share.x, extinction.x, dr.select(u.x < share.x + share.y, extinction.y, extinction.z))
        self.distance = -dr.log(1 - u.y) * dr.rcp(own)
        self.in_medium = (paths.medium > 0) & (own > 0) & (self.distance < self.length)
        self.on_surface = self.valid & ~self.in_medium
        way = dr.select(self.in_medium, self.distance, self.length)
        passed = tracing.volumes.transmittance(paths.medium, way)
        pdf = dr.sum(share * passed * dr.select(self.in_medium, extinction, 1))
        scattering = dr.select(self.in_medium, tracing.volumes.scattering(paths.medium), Array3f(1))
        self.weight = dr.select(pdf > 0, passed * scattering * dr.rcp(pdf), 0)
        self.way = way
        self.share = share
        self.position = paths.origin + way * paths.direction
        self.smooth = self.valid & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Smooth)
        self.going = self.in_medium | self.on_surface


class _Scatter:
    """A sample of the BSDF at hits: the ray that leaves, and what it weighs."""

    def __init__(self, origin: Any, direction: Any, weight: Any, delta: Any, null: Any, medium: Any) -> None:
        self.origin, self.direction, self.weight = origin, direction, weight
        self.delta, self.null, self.medium = delta, null, medium


def _reflect(hit: Any, active: Bool, index: UInt32, stream: UInt32) -> _Scatter:
    """Return a sample of the BSDF for light (Veach 1997, section 5.3: shading normals of adjoint BSDFs)."""
    lobe = unit_float(hash32(index, stream, UInt32(_LOBE)))
    u = pixel_sample(index, hash32(stream, UInt32(_TURN)))
    context = mi.BSDFContext(mi.TransportMode.Importance)
    sample, weight = hit.bsdf().sample(context, hit, lobe, mi.Point2f(u), active)
    direction = hit.to_world(sample.wo)
    now = dr.detach(direction)
    normal, shading = dr.detach(hit.n), dr.detach(hit.sh_frame.n)
    incoming = dr.detach(hit.to_world(hit.wi))
    geometric_in, geometric_out = dr.dot(normal, incoming), dr.dot(normal, now)
    shading_in, shading_out = dr.dot(shading, incoming), dr.dot(shading, now)
    leak = (geometric_in * shading_in <= 0) | (geometric_out * shading_out <= 0)
    correction = dr.abs(shading_in * geometric_out * dr.rcp(shading_out * geometric_in))
    value = Array3f(dr.detach(weight)) * correction
    good = active & (dr.detach(sample.pdf) > 0) & ~leak & dr.isfinite(dr.sum(value))
    value = dr.select(good, value, 0)
    border = hit.is_medium_transition()
    medium = dr.select(border, numbers(hit.target_medium(now)), UInt32(0xFFFFFFFF))
    kind = sample.sampled_type
    delta, null = mi.has_flag(kind, mi.BSDFFlags.Delta), mi.has_flag(kind, mi.BSDFFlags.Null)
    ray = hit.spawn_ray(direction)
    return _Scatter(ray.o, direction, value, delta | null, null, medium)


def _following(
    tracing: Tracing, paths: Paths, event: _Event, scatter: _Scatter, index: UInt32, stream: UInt32
) -> Paths:
    """Return the paths after their event; `event.going` loses those that end."""
    following = Paths()
    place = dr.zeros(mi.MediumInteraction3f, dr.width(paths.origin))
    place.p, place.wi = mi.Point3f(event.position), mi.Vector3f(-paths.direction)
    place.sh_frame = mi.Frame3f(place.wi)
    place.medium = pointers(dr.select(event.in_medium, paths.medium, 0))
    phase = place.medium.phase_function()
    lobe = unit_float(hash32(index, stream, UInt32(_LOBE)))
    u = pixel_sample(index, hash32(stream, UInt32(_TURN)))
    turned, weight, _ = phase.sample(mi.PhaseFunctionContext(), place, lobe, mi.Point2f(u), event.in_medium)
    following.direction = dr.select(event.in_medium, Array3f(turned), Array3f(dr.detach(scatter.direction)))
    following.origin = dr.select(event.in_medium, event.position, Array3f(dr.detach(scatter.origin)))
    following.flux = paths.flux * event.weight * dr.select(event.in_medium, Array3f(weight), scatter.weight)
    passes = event.on_surface & scatter.null
    following.events = paths.events + dr.select(passes, 0, 1)
    kept = event.in_medium | (scatter.medium == 0xFFFFFFFF)
    following.medium = dr.select(kept, paths.medium, scatter.medium)
    following.straight = paths.straight & passes
    following.coherent = paths.coherent & event.on_surface & scatter.delta
    following.number, following.first, following.count = paths.number, paths.first, paths.count
    following.tangents = paths.tangents
    following.radius = _scattered_radius(tracing, paths)
    going = event.going & (dr.max(following.flux) > 0)
    if tracing.max_events is not None:
        going &= following.events <= tracing.max_events
    _roulette(tracing, following, passes, index, stream, going)
    event.going = going & (dr.max(following.flux) > 0)
    return following


def _scattered_radius(tracing: Tracing, paths: Paths) -> Float:
    """Return the radius of beams that were scattered at random.

    N lines through a region of size ℓ cross it √(ℓ²/N) apart. They lie at random, so that they should overlap twice as
    far as those in strata.
    """
    return dr.opaque(Float, tracing.overlap * tracing.reach) * dr.rsqrt(paths.count)


def _roulette(
    tracing: Tracing, paths: Paths, passes: Bool, index: UInt32, stream: UInt32, active: Bool
) -> None:
    """End paths at random that have lost most of their light, and give theirs to the others."""
    chance = dr.minimum(dr.max(paths.flux) * dr.rcp(dr.maximum(paths.first, 1e-30)), 0.95)
    tried = active & ~passes & (paths.events >= dr.opaque(UInt32, tracing.rr_depth))
    lives = unit_float(hash32(index, stream, UInt32(_ROULETTE))) < chance
    factor = dr.select(tried, dr.select(lives, dr.rcp(dr.maximum(chance, 1e-30)), 0), 1)
    paths.flux = paths.flux * factor


def _carry(paths: Paths, following: Paths, event: _Event, inputs: list[Any], scatter: _Scatter) -> None:
    """Carry the tangents of paths over mirrors, lenses and borders, by forward-mode differentiation."""
    columns = [
        [mi.Vector3f(each) for each in column] for column in paths.tangents.columns()
    ]
    derived = differentiate(inputs, [scatter.origin, scatter.direction], columns)
    following.tangents = Tangents.of([(Array3f(p), Array3f(d)) for p, d in derived])


def _segments(tracing: Tracing, paths: Paths, event: _Event) -> Segments:
    """Return the stretches of paths up to the next surface, or event."""
    result = Segments()
    result.origin, result.direction, result.flux = paths.origin, paths.direction, paths.flux
    result.length = event.way if tracing.short else event.length
    normal = Array3f(event.hit.n)
    against = dr.select(dr.dot(normal, paths.direction) > 0, -normal, normal)
    ends = event.valid & ~event.in_medium if tracing.short else event.valid
    result.normal = dr.select(ends, against, -paths.direction)
    result.medium, result.events, result.number = paths.medium, paths.events, paths.number
    own = width(paths.tangents, paths.direction, event.length, paths.count, dr.opaque(Float, tracing.overlap))
    squared = dr.square(paths.radius)
    result.width = Width(
        dr.select(paths.coherent, own.a, squared), dr.select(paths.coherent, own.b, 0),
        dr.select(paths.coherent, own.c, 0),
    )  # fmt: skip
    return result


def _landed(paths: Paths, event: _Event, across: Width) -> Landed:
    """Return what arrives at surfaces."""
    result = Landed()
    result.position, result.direction = event.position, paths.direction
    result.normal = Array3f(event.hit.n)
    # On a slant the footprint is longer by 1 / cos, and its area with it.
    cosine = dr.maximum(dr.abs(dr.dot(result.normal, paths.direction)), 0.05)
    result.radius = across(event.way) * dr.rsqrt(cosine)
    result.flux, result.events = paths.flux * event.weight, paths.events
    return result
