"""Camera paths: straight on through interfaces of media, mirrored and refracted, to the first surface that scatters light.

Each pixel has one path a pass. Its segments in media gather beams; at surfaces it gathers emission, direct light and
photons, and goes on where a BSDF has ideal mirrors, refracts, or lets light through, by one sample of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr

from ..numerics.arrays import compressed
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.media import Media
from ..world.sensors import Primary
from ..world.surroundings import Surroundings
from .direct import direct

mi = mitsuba()

_LOBE, _TURN, _ROULETTE, _WAY = 301, 302, 303, 304  # names of samples in seeds

# What makes a surface more than a interface of media; to Mitsuba going straight on (Null) is one of `Delta`.
_VISIBLE = int(mi.BSDFFlags.Smooth | mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission)

# Steps after which a path ends that meets nothing that ends it, as between two mirrors.
_STEPS = 128


class Sight:
    """Camera paths on their way: rays from `near` on, what their light counts, where they are.

    `pixel` is the path's pixel, `order` names its samples; `primary` are paths that are still the pixel's own ray;
    `events` counts mirrors and refractions.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "near": Float, "far": Float, "throughput": Array3f, "medium": UInt32,
        "pixel": UInt32, "order": UInt32, "primary": Bool, "events": UInt32, "alive": Bool,
    }  # fmt: skip

    origin: Any
    direction: Any
    near: Any
    far: Any
    throughput: Any
    medium: Any
    pixel: Any
    order: Any
    primary: Any
    events: Any
    alive: Any


class Seen:
    """What paths see in one step: radiance of surfaces (times the throughput), where they are, and whether they show.

    `seed` is that of the transmittance up to there.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"radiance": Array3f, "solid": Bool, "end": Float, "seed": UInt32}

    radiance: Any
    solid: Any
    end: Any
    seed: Any


@dataclass(frozen=True)
class Looking:
    """How camera paths are followed: the Mitsuba scene, its media, and what Mitsuba's integrators let be chosen."""

    plugin: Any
    volumes: Media
    max_depth: int | None
    rr_depth: int
    hide_emitters: bool
    surfaces: bool = True


def begin(looking: Looking, primary: Primary, order: UInt32, surroundings: Surroundings) -> Sight:
    """Return the camera paths of a pass; `surroundings` tells the medium around the sensor."""
    count = dr.width(primary.direction)
    sight = Sight()
    sight.origin = primary.origin + dr.zeros(Array3f, count)
    sight.direction, sight.near, sight.far = primary.direction, primary.near, primary.far
    sight.throughput = primary.weight
    sight.pixel = dr.arange(UInt32, count) + dr.opaque(UInt32, 0)
    sight.order = UInt32(order)
    sight.primary = sight.alive = dr.full(Bool, True, count)
    sight.events = dr.zeros(UInt32, count)
    start = sight.origin + sight.near * sight.direction
    sight.medium = surroundings.of_sensor(start, sight.direction)
    dr.eval(sight)
    return sight


def follow(looking: Looking, sight: Sight, samples: Samples, lit: Any) -> Iterator[tuple[Sight, Seen]]:
    """Yield camera paths and what they see, step by step; `lit(hit, events, active)` is the light of photons."""
    step = 0
    while step < _STEPS:
        seen, following = _step(looking, sight, samples, dr.opaque(UInt32, step), lit)
        dr.eval(seen, following)
        yield sight, seen
        if not bool(dr.any(following.alive)):
            return
        sight = following
        if not bool(dr.any(following.alive & following.primary)):
            (sight,) = compressed(following.alive, following)
        step += 1


def _step(looking: Looking, sight: Sight, samples: Samples, step: UInt32, lit: Any) -> tuple[Seen, Sight]:
    plugin, volumes, alive = looking.plugin, looking.volumes, sight.alive
    start = sight.origin + sight.near * sight.direction
    ray = mi.Ray3f(mi.Point3f(start), mi.Vector3f(sight.direction))
    ray.maxt = dr.minimum(sight.far - sight.near, dr.largest(Float))
    hit = plugin.ray_intersect(ray, alive)
    met = alive & hit.is_valid()
    way = dr.select(met, hit.t, ray.maxt)
    seen = Seen()
    seen.end = sight.near + way
    seen.seed = samples.bits(sight.order, _WAY, step)
    passed = volumes.transmittance(sight.medium, start, sight.direction, way, seen.seed, alive)
    throughput = sight.throughput * passed
    seen.radiance = _emission(looking, hit, alive, sight)
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    smooth = met & mi.has_flag(flags, mi.BSDFFlags.Smooth) & _within(looking, sight.events, 2)
    if looking.surfaces:
        own = direct(plugin, volumes, hit, sight.medium, sight.order, samples, step, smooth)
        seen.radiance += own + lit(hit, sight.events, smooth)
    seen.radiance = dr.select(alive, seen.radiance * throughput, 0)
    visible = (UInt32(flags) & _VISIBLE) != 0
    seen.solid = met & (visible | ~mi.has_flag(flags, mi.BSDFFlags.Null))
    return seen, _onward(looking, sight, hit, throughput, met, samples, step)


def _within(looking: Looking, events: UInt32, more: int) -> Any:
    """Return whether paths of so many events and more edges are no longer than asked for."""
    return Bool(True) if looking.max_depth is None else events + more <= dr.opaque(UInt32, looking.max_depth)


def _emission(looking: Looking, hit: Any, alive: Bool, sight: Sight) -> Array3f:
    """Return the radiance of emitters that paths see, near and far."""
    emitter = hit.emitter(looking.plugin, alive)
    shown = alive & _within(looking, sight.events, 1)
    if looking.hide_emitters:
        shown &= sight.events > 0
    value = dr.select(shown, Array3f(emitter.eval(hit, shown)), 0)
    return dr.select(dr.isfinite(dr.sum(value)), value, 0)


def _onward(
    looking: Looking, sight: Sight, hit: Any, throughput: Array3f, met: Bool, samples: Samples, step: UInt32
) -> Sight:
    """Return paths behind the surface that they met: mirrored, refracted, or straight on."""
    context = mi.BSDFContext()
    context.type_mask = mi.BSDFFlags.Delta | mi.BSDFFlags.Null
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    sharp = met & (mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null))
    # In strata over the passes: as often mirrored and as often refracted as the glass would have it.
    lobe, turn = samples.pair(sight.order, _LOBE, step).x, samples.pair(sight.order, _TURN, step)
    sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(turn), sharp)
    direction = hit.to_world(sample.wo)
    null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    straight = sight.primary & null
    following = Sight()
    following.throughput = throughput * dr.select(sharp & (sample.pdf > 0), Array3f(weight), 0)
    spawned = hit.spawn_ray(direction)
    # A primary ray keeps its origin, from which tiles see it; it begins anew where it passed the surface.
    way = dr.dot(Array3f(spawned.o) - sight.origin, sight.direction)
    following.origin = dr.select(straight, sight.origin, Array3f(spawned.o))
    following.direction = dr.select(straight, sight.direction, Array3f(direction))
    following.near = dr.select(straight, way, 0)
    following.far = dr.select(straight, sight.far, dr.largest(Float))
    following.medium = looking.volumes.beyond(hit, direction, sight.medium, sharp)
    following.events = sight.events + dr.select(null, 0, 1)
    following.pixel, following.order, following.primary = sight.pixel, sight.order, straight
    alive = sharp & (dr.max(following.throughput) > 0) & _within(looking, following.events, 1)
    chance = dr.minimum(dr.max(following.throughput), 0.95)
    tried = following.events >= dr.opaque(UInt32, looking.rr_depth)
    lives = samples.single(sight.order, _ROULETTE, step) < chance
    following.throughput *= dr.select(tried, dr.rcp(dr.maximum(chance, 1e-30)), 1)
    following.alive = alive & (~tried | lives)
    return following
