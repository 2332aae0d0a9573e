"""Walks: camera paths that continue after they are scattered, as in a path tracer, for the light of some emitters.

Light of large lamps and of the sky comes to every point of a cloud, and of a room, from everywhere: there a walk from
the camera is more likely to find the light than a beam or a photon is to find the camera. In media, each emitter's
light is either traced into beams or met by walks, never both; on surfaces walks meet it, except for caustics: see
`techniques`. For all emitters, `camera_paths` handles what the camera sees of the emitters themselves, and their
direct light on the first surface. At each vertex a walk takes one sample of an emitter and one of the phase function or
BSDF, combined by the power heuristic (Veach 1997), as in Mitsuba's `volpath`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import drjit as dr

from ...estimators.estimate import ENDLESS
from ...numerics.arrays import compressed
from ...numerics.grouped import GroupedLight
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...transport.interactions import SAMPLED, SCATTERED, flown, survival
from .branches import CameraPaths, add_to_pixels
from .camera_paths import Bounce, CameraVertex
from .emitters import Emitters, EmitterSample, arriving
from .fog_segments import FogSegment
from .surface_light import NO_LIGHT, SurfaceLight
from .toward_lamps import Toward, aimed
from .virtual_lights import Point, weight
from .walk_vertices import DirectionSample, Vertex, Walk, steepness

mi = mitsuba()

# Steps after which walks end if nothing else ends them, as in a box of mirrors.
_STEPS = 1024


@dataclass(frozen=True)
class Walks:
    """The walks of a frame: those that begin in media, by light groups, and those that begin at surfaces, or None."""

    media: Sequence[tuple[str, Walking]] = ()
    surfaces: Walking | None = None

    @property
    def walked(self) -> Emitters | None:
        """The emitters that walks from surfaces meet; None: there are no such walks."""
        return None if self.surfaces is None else self.surfaces.emitters


@dataclass(frozen=True)
class Walking:
    """How walks are followed: the emitters that they meet, and depths as in `CameraTracing`.

    `bound` is that of virtual lights; None: no emitter has any. `media` are the numbers of those in which walks begin;
    None: all.
    """

    emitters: Emitters
    max_depth: int | None
    rr_depth: int
    bound: Float | None = None
    media: Collection[int] | None = None

    def add_scattered(self, paths: CameraPaths, vertex: CameraVertex, samples: Samples, result: GroupedLight) -> None:
        """Add the radiance of walks that begin in the media of one step of camera paths."""
        self._add(self._in_media(paths, vertex, samples), samples, NO_LIGHT, result)

    def add_reflected(
        self, paths: CameraPaths, vertex: CameraVertex, samples: Samples, surfaces: SurfaceLight,
        result: GroupedLight,
    ) -> None:  # fmt: skip
        """Add the radiance of walks that begin at the surfaces of one step of camera paths, if these are shaded.

        Where they meet surfaces, walks also find the light of photons and virtual lights there.
        """
        if vertex.bounce is not None:
            self._add(self._from_surfaces(paths, vertex, vertex.bounce), samples, surfaces, result)

    def _add(self, walks: Walk | None, samples: Samples, surfaces: SurfaceLight, result: GroupedLight) -> None:
        if walks is not None:
            found = self.radiance(walks, samples, surfaces).finite()
            dr.eval(found)
            for total, own in zip(result.parts, found.parts, strict=True):
                add_to_pixels(total, own, walks.pixel, walks.branch)

    def _in_media(self, paths: CameraPaths, vertex: CameraVertex, samples: Samples) -> Walk | None:
        """Return the walks that begin in the media of a step of camera paths; None if there are none."""
        media, width = self.emitters.world.media, dr.width(paths.pixel)
        zeros, none = dr.zeros(Float, width), dr.zeros(UInt32, width)
        lamp, _ = self.emitters.choice(samples.single(paths.order, Stream.FOG_FIRST_EMITTER, vertex.name))
        inside = paths.alive & (dr.max(media.scattering(paths.medium)) > 0) & (vertex.end > paths.near)
        inside &= self.within(paths.depth, 2)
        if self.media is not None:
            inside &= reduce(or_, (paths.medium == dr.opaque(UInt32, each) for each in self.media))
        start = paths.origin + paths.near * paths.direction
        scattered = Walk(
            origin=start,
            direction=paths.direction,
            medium=paths.medium,
            first=inside,
            length=dr.minimum(vertex.end, ENDLESS) - paths.near,
            throughput=paths.throughput,
            initial=zeros,
            depth=paths.depth,
            before=paths.depth,
            counts=inside,
            place=start,
            pdf=zeros,
            inside=inside,
            site=none,
            lamp=lamp,
            value=zeros,
            bright=zeros,
            order=paths.order,
            pixel=paths.pixel,
            branch=paths.branch,
            name=vertex.name,
        )
        return next(iter(compressed(inside, scattered)), None)

    def _from_surfaces(self, paths: CameraPaths, vertex: CameraVertex, bounce: Bounce) -> Walk | None:
        """Return the walks that begin with these samples of BSDFs; None if there are none."""
        width = dr.width(paths.pixel)
        zeros, none = dr.zeros(Float, width), dr.zeros(UInt32, width)
        going = (dr.max(bounce.throughput) > 0) & self.within(paths.depth, 3)
        reflected = Walk(
            origin=bounce.origin,
            direction=bounce.direction,
            medium=bounce.medium,
            first=~going,
            length=zeros,
            throughput=bounce.throughput,
            initial=dr.max(bounce.throughput),
            depth=paths.depth + 1,
            before=paths.depth,
            counts=~going,
            place=bounce.place,
            pdf=zeros,
            inside=~going,
            site=none,
            lamp=bounce.lamp,
            value=bounce.value,
            bright=zeros,
            order=paths.order,
            pixel=paths.pixel,
            branch=paths.branch,
            name=vertex.name,
        )
        return next(iter(compressed(going, reflected)), None)

    def within(self, depth: UInt32, more: int) -> Any:
        """Return whether paths that were scattered `depth` times, with `more` edges, are not too long."""
        return Bool(True) if self.max_depth is None else depth + more <= dr.opaque(UInt32, self.max_depth)

    def radiance(self, walks: Walk, samples: Samples, surfaces: SurfaceLight = NO_LIGHT) -> GroupedLight:
        """Return the radiance that each walk brings, with that of photons where it meets surfaces."""

        def further(walk: Walk, going: Bool, number: UInt32, found: GroupedLight) -> tuple[Any, ...]:
            brought, following, goes = self._step(walk, going, samples, (walk.name, number), surfaces)
            return following, goes, number + 1, found + brought

        width, _ = dr.width(walks.order), self.emitters.balls  # which are not to be found in the loop
        dark = GroupedLight.dark(len(self.emitters.groups), width)
        state = (walks, dr.full(Bool, True, width), dr.zeros(UInt32, width), dark)
        return dr.while_loop(
            state, lambda walk, going, number, found: going & (number < _STEPS), further, label="walks"
        )[3]

    def _step(
        self, walk: Walk, going: Bool, samples: Samples, name: tuple[Any, ...], surfaces: SurfaceLight
    ) -> tuple[GroupedLight, Walk, Bool]:  # fmt: skip
        world = self.emitters.world
        seed = samples.bits(walk.order, Stream.PATH_CUTOUT, *name)
        hit = world.intersect(walk.origin, walk.direction, going & ~walk.first, seed)
        beyond = dr.select(hit.is_valid(), hit.t, dr.largest(Float))
        length = dr.select(walk.first, walk.length, beyond)
        distance, factor, scattered = self._flown(walk, length, going, samples, name)
        throughput = walk.throughput * factor
        ahead = going & ~walk.first
        on = ahead & ~scattered
        tracking = samples.bits(walk.order, Stream.PATH_TRACKING, *name)
        kept = None if self.bound is None else 1 - weight(walk.bright, self.bound)
        active = ahead & walk.counts & self.within(walk.depth, 1)
        found = self.emitters.met(walk.ray, hit, factor, on, active, tracking, kept)
        result = (found * walk.throughput).where(dr.max(found.total) > 0)
        vertex = Vertex(
            world, hit, medium=walk.medium, incident=walk.direction, bounces=walk.bounces + 1,
            position=walk.origin + distance * walk.direction, scattered=scattered, on_surface=on & hit.is_valid(),
        )  # fmt: skip
        lit, left = vertex.scattered | vertex.smooth, Float(1)
        if self.emitters.balls is not None:
            fog = going & (dr.max(world.media.scattering(walk.medium)) > 0) & self.within(walk.depth, 2)
            span = dr.minimum(dr.select(walk.first, walk.length, beyond), ENDLESS)
            segment = FogSegment(world.media, walk, span, self.emitters.balls(walk.lamp, fog))
            result = result + self._from_fog(walk, vertex, segment, fog, samples, name)
            left = dr.select(vertex.scattered, segment.left(distance), 1)
        lit &= (left > 0) & self.within(walk.depth, 2)
        square = dr.squared_norm(vertex.position - walk.place)
        geometry = walk.value * dr.abs(dr.dot(Array3f(hit.n), walk.direction)) * dr.rcp(dr.maximum(square, 1e-30))
        geometry = dr.select(vertex.smooth & (walk.value > 0), geometry, dr.inf)
        lamp, _ = self.emitters.choice(samples.single(walk.order, Stream.PATH_WHICH_EMITTER, *name))
        own = dr.select(vertex.scattered, walk.lamp, lamp)
        light, chosen = self._direct(walk, vertex, own, samples, name, lit, geometry)
        if surfaces.caustics is not None:
            light = light + surfaces.caustics(hit, walk.depth, lit & vertex.smooth)
        if surfaces.virtual is not None:
            light = light + surfaces.virtual.radiance(self.emitters, Point(
                hit, vertex.opacity, walk.medium, lit & vertex.smooth & self.within(walk.depth, 3),
                walk.bounces + 2, samples.bits(walk.order, Stream.PATH_VIRTUAL, *name),
            ))  # fmt: skip
        result = result + light * (throughput * left)
        if self.emitters.balls is not None:
            ball = self.emitters.balls(lamp, (vertex.scattered | vertex.smooth) & self.within(walk.depth, 3))
            pick, u = samples.single(walk.order, Stream.TOWARD, *name), samples.pair(walk.order, Stream.TOWARD, *name)
            toward = Toward(vertex.position, ball)
            chosen = aimed(
                world.media, walk.medium, toward, ball.near, plain=chosen, pick=pick, u=u, evaluate=vertex.evaluate
            )  # fmt: skip
        following, factor, goes = self._onward(walk, vertex, chosen, lamp, geometry)
        following.throughput = throughput * factor
        following.length = walk.length - distance
        for each in ("order", "pixel", "branch", "name", "before"):
            setattr(following, each, getattr(walk, each))
        following.initial = dr.select(walk.first & scattered, dr.max(throughput), walk.initial)
        return result, following, self._roulette(following, goes, samples, name)

    def _flown(
        self, walk: Walk, length: Float, going: Bool, samples: Samples, name: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        """Return free flights: their distances and weights, and whether they end with scattering."""
        media = self.emitters.world.media
        if not media.all:
            return length, Array3f(1), Bool(False)
        fractions = walk.throughput * dr.rcp(dr.maximum(dr.sum(walk.throughput), 1e-30))
        varying, _ = media.varying(walk.medium)
        branch = dr.select(walk.first & ~varying, UInt32(SCATTERED), UInt32(SAMPLED))
        own = flown(
            media, walk, length, branch=branch, fractions=fractions, active=going,
            u=samples.pair(walk.order, Stream.PATH_FLIGHT, *name),
            seed=samples.bits(walk.order, Stream.PATH_FLIGHT, *name),
        )  # fmt: skip
        return dr.minimum(own.distance, length), own.weight, going & own.scatters

    def _from_fog(
        self, walk: Walk, vertex: Vertex, segment: FogSegment, active: Bool, samples: Samples, name: tuple[Any, ...]
    ) -> GroupedLight:  # fmt: skip
        """Return the light of the walks' emitters that media scatter at one place of each segment."""
        media, own = self.emitters.world.media, (*name, UInt32(Stream.FOG))
        u, flown = (samples.pair(walk.order, each, *name) for each in (Stream.FOG, Stream.FOG_FLIGHT))
        distance, weight = segment.sample(u, flown)
        place = vertex.inside(walk.origin + distance * walk.direction, active)
        seed = samples.bits(walk.order, Stream.FOG_FLIGHT, *name)
        passed = media.transmittance(
            walk.medium, walk.origin, walk.direction, distance, seed=seed, active=active & (dr.max(weight) > 0)
        )
        light = self.emitters.sampled(place, walk.lamp, samples.pair(walk.order, Stream.PATH_EMITTER, *own), active)
        value, pdf = place.phased(light.direction, light.lit)
        seed = samples.bits(walk.order, Stream.PATH_SHADOW, *own)
        return self._arriving(place, light, value, pdf, seed) * (walk.throughput * weight * passed)

    def _arriving(
        self, vertex: Vertex, light: EmitterSample, value: Array3f, pdf: Float, seed: UInt32
    ) -> GroupedLight:  # fmt: skip
        """Return what `arriving` does, by light groups."""
        result = arriving(self.emitters.passed, vertex, light, value, pdf, seed)
        return GroupedLight.of(result, light.group, len(self.emitters.groups))

    def _direct(
        self, walk: Walk, vertex: Vertex, lamp: UInt32, samples: Samples, name: tuple[Any, ...], lit: Bool,
        geometry: Float,
    ) -> tuple[GroupedLight, DirectionSample]:  # fmt: skip
        """Return the light of one sample of emitters that vertices scatter, and a sample of a new direction."""
        order = walk.order
        light = self.emitters.sampled(vertex, lamp, samples.pair(order, Stream.PATH_EMITTER, *name), lit)
        lobe, turn = samples.single(order, Stream.PATH_LOBE, *name), samples.pair(order, Stream.PATH_TURN, *name)
        (value, pdf), chosen = vertex.evaluate(light.direction, light.lit), vertex.directed(lobe, turn)
        if self.bound is not None:
            bright = geometry * dr.max(value) * dr.rcp(steepness(vertex.hit, light.direction))
            value *= dr.select(light.connected, 1 - weight(bright, self.bound), 1)
        seed = samples.bits(order, Stream.PATH_SHADOW, *name)
        return self._arriving(vertex, light, value, pdf, seed), chosen

    def _onward(
        self, walk: Walk, vertex: Vertex, chosen: DirectionSample, lamp: UInt32, geometry: Float
    ) -> tuple[Walk, Array3f, Bool]:  # fmt: skip
        """Return the walks after their vertices, the weights of their new directions, and which walks continue."""
        hit, null, following = vertex.hit, chosen.null, Walk()
        ray = vertex.ahead(chosen.direction, dr.select(chosen.ideal, 0, chosen.pdf), lamp)
        following.origin, following.direction, following.medium = ray.origin, ray.direction, ray.medium
        following.first = Bool(False)
        following.depth = walk.depth + dr.select(null, 0, 1)
        following.counts = walk.counts | ~null
        for each in ("place", "pdf", "inside", "site", "lamp"):  # those of the last vertex that was no boundary
            setattr(following, each, dr.select(null, getattr(walk, each), getattr(ray, each)))
        own = dr.select(vertex.smooth & (following.pdf > 0), dr.max(chosen.value), 0)
        following.value = dr.select(null, walk.value, own)
        bright = dr.select(own > 0, geometry * own * dr.rcp(steepness(hit, chosen.direction)), dr.inf)
        following.bright = dr.select(null, walk.bright, bright)
        factor = chosen.weight
        good = vertex.scattered | (vertex.on_surface & (chosen.pdf > 0))
        good &= dr.isfinite(dr.sum(factor)) & self.within(following.depth, 1)
        return following, dr.select(good, factor, 0), good

    def _roulette(self, walk: Walk, going: Bool, samples: Samples, name: tuple[Any, ...]) -> Bool:
        """Return which walks continue, by Russian roulette; their throughput makes up for the walks that end."""
        most = dr.max(walk.throughput)
        surviving: Any = survival(most * dr.rcp(dr.maximum(walk.initial, 1e-30)), walk.depth)
        tried = going & (walk.depth >= dr.opaque(UInt32, self.rr_depth))
        survives = samples.single(walk.order, Stream.PATH_ROULETTE, *name) < surviving
        walk.throughput = walk.throughput * dr.select(tried, dr.rcp(dr.maximum(surviving, 1e-30)), 1)
        return going & (most > 0) & (~tried | survives)
