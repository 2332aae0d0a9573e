"""The emitters of a world, as camera paths see them and as they light surfaces.

Direct light takes one sample of each lamp, and one sample of the BSDF for all lamps, combined by multiple importance
sampling (power heuristic, Veach 1997). Lamps occlude what is behind them from the camera, and cast no shadows.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from copy import copy
from typing import Any

import drjit as dr

from ...numerics.grouped import GroupedLight
from ...numerics.hashing import hash32
from ...numerics.sampling import power_heuristic
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import gathered_group
from ...world.emitters.linking import shape_number
from ...world.emitters.packed import LampGroups, Lamps, LinkedSurfaces
from ...world.shadow_rays import ShadowRay, to_lamp
from ...world.world import World
from .camera_paths import NearestLamp, ShadingPoint

mi = mitsuba()


class EmitterLighting:
    """The light of a stage's emitters: lamps, environments, and surfaces that glow.

    The emitters with numbers `unsampled` are not sampled.
    """

    def __init__(self, world: World, unsampled: Collection[int] = ()) -> None:
        self._world, self._lamps = world, world.lamps
        self._sampled = LampGroups.of(world, unsampled) if unsampled else world.lamps

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> NearestLamp | None:
        """Return the nearest lamp that emits toward rays which have come the distance `flown`."""
        packed = [lamps for lamps in self._lamps.packed if lamps.seen]
        single = [each for each in self._lamps.meshes if each.lamp.seen and (each.links is None or each.links.seen)]
        if not packed and not single:
            return None
        # Images on portals also tint light that passed them before the ray's segment begins.
        straight_from = origin - flown * direction

        def nearer(light: Any, _: UInt32, group: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
            distance, radiance, of = state
            found = light.see(straight_from, direction)
            beyond = found.distance - flown
            front = found.hit & (beyond > 0) & (beyond < distance) & (dr.max(found.radiance) > 0)
            return (
                dr.select(front, beyond, distance),
                dr.select(front, found.radiance, radiance),
                dr.select(front, group, of),
            )

        width, groups = max(dr.width(origin), dr.width(direction)), self._world.groups
        state: tuple[Any, ...] = (dr.full(Float, dr.inf, width), dr.zeros(Array3f, width), dr.zeros(UInt32, width))
        for lamps in packed:
            state = _each(lamps, state, nearer)
        for each in single:
            state = nearer(each.lamp, UInt32(0), UInt32(groups.number(each.group)), state)
        distance, radiance, group = state
        return NearestLamp(distance, GroupedLight.of(radiance, group, len(groups)))

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return the radiance that surfaces emit, on both sides, or of the background where rays meet nothing."""
        met = hit.is_valid()
        return self._glow(hit, active & met) + self._background(origin, direction).where(active & ~met)

    def _background(self, origin: Array3f, direction: Array3f) -> GroupedLight:
        """Return the radiance at infinity: environments and the discs of distant lights."""
        groups = self._world.groups
        result = GroupedLight.dark(len(groups), max(dr.width(origin), dr.width(direction)))
        for dome in self._lamps.domes:
            if dome.links is None or dome.links.seen:
                result = result + groups.grouped(dome.lamp.see(origin, direction).radiance, dome.group)

        def add(light: Any, _: UInt32, group: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
            found = light.see(origin, direction)
            own = dr.select(dr.isfinite(found.distance), 0, found.radiance)
            return (state[0] + GroupedLight.of(own, group, len(groups)),)

        for lamps in self._lamps.packed:
            if lamps.seen:
                (result,) = _each(lamps, (result,), add)
        return result

    def _glow(self, hit: Any, active: Bool) -> GroupedLight:
        groups = self._world.groups
        if not self._world.glowing:
            return GroupedLight.dark(len(groups), dr.width(hit.t))
        incident = mi.Vector3f(hit.wi)
        front = mi.SurfaceInteraction3f(hit)
        front.wi = mi.Vector3f(incident.x, incident.y, dr.abs(incident.z))  # Mitsuba's emitters are one-sided
        light = Array3f(front.emitter(self._world.plugin).eval(front, active))
        return GroupedLight.of(light, gathered_group(self._lamps.glow, shape_number(hit.shape)), len(groups))

    def direct(self, point: ShadingPoint, active: Bool) -> GroupedLight:
        """Return the direct light that surfaces reflect along the path, by one sample of each lamp."""
        world, lights = self._world, self._sampled
        radiance = GroupedLight.dark(len(world.groups), dr.width(point.hit.t))
        if not lights.packed and not lights.domes and not lights.meshes:
            return radiance
        reflection = _Reflection(world, point, active)
        for kind, lamps in enumerate(lights.packed):
            (radiance,) = _each(lamps, (radiance,), _adding(world, reflection, lamps, kind))
        for number, each in enumerate([*lights.domes, *lights.meshes]):
            lamp = each.lamp.at(world.linking.acting(each.source, reflection.site))
            names = UInt32(Stream.SINGLE_LAMP), UInt32(number)
            own = scattered(*_linked(world, reflection, each.links), lamp, names)
            radiance = radiance + world.groups.grouped(own, each.group)
        return radiance


def _each(lamps: Lamps, state: tuple[Any, ...], body: Any) -> tuple[Any, ...]:
    """Return the `state` after body(light, number, group, state) for each light of a kind, as a loop in the kernel."""

    def step(number: UInt32, *state: Any) -> tuple[Any, ...]:
        return (number + 1, *body(lamps.light(number), number, gathered_group(lamps.groups, number), state))

    # The counter is as wide as the other variables, because a loop has one width.
    start = dr.zeros(UInt32, dr.width(state))
    return dr.while_loop((start, *state), lambda number, *_: number < lamps.count, step, label=lamps.kind.__name__)[1:]


class LitPoints:
    """Points that scatter light toward the camera, on surfaces or in media, each with one sample of a direction.

    Attributes
    ----------
    point, place, active
        The samples' numbers and the medium of each point, where it is, and whether it is lit at all.
    reference, size
        The points, or hits on surfaces of a scene with this diameter, from which shadow rays begin: see `to_lamp`.
    direction, weight, pdf, seed, open
        The sample of a direction, its weight and density, the seed of its ray, and what of light surfaces let through
        on that: 0 where one blocks it, the colour of panes.
    shadow_reach, shadow
        Surfaces farther away cast no shadow; and what a shadow leaves of the light, None: nothing.
    """

    point: ShadingPoint
    place: Array3f
    active: Bool
    reference: Any
    size: Float | None
    direction: Array3f
    weight: Array3f
    pdf: Float
    seed: UInt32
    open: Array3f
    shadow_reach: Any
    shadow: Any = None

    def toward(self, direction: Array3f, distance: Float) -> ShadowRay:
        """Return the shadow rays to light at a distance, which may be infinite."""
        return to_lamp(self.reference, direction, distance, self.size)

    def dimmed_over(self, direction: Array3f, distance: Float) -> Float:
        """Return the distance over which media dim light from a `distance`."""
        return distance

    def sees(self, world: World, met: Bool, distance: Float) -> Array3f:
        """Return what surfaces let through to samples that meet a light, at this distance."""
        # Small lights are met seldom. The seed is that of `open`: a cut-out that lets one ray through lets the other.
        before = met & (dr.min(self.open) < 1) & dr.isfinite(distance)
        ray = self.toward(self.direction, distance)
        reach = dr.minimum(ray.length, self.shadow_reach)
        passed = world.solids.passed(ray.origin, ray.direction, reach, before, self.seed)
        return dr.select(met, dr.select(before, passed, self.open), 0)

    def left(self, passed: Array3f, lit: Bool) -> Array3f:
        """Return the factor on light at points that are `lit`: what passes surfaces, and the shadow of the rest."""
        return passed if self.shadow is None else dr.select(lit, passed + (1 - passed) * self.shadow, 0)

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return the factor on light from a direction, and the pdf with which that direction is sampled."""
        raise NotImplementedError

    def unblocked(self, world: World) -> Array3f:
        """Return what surfaces let through to the sample: this takes half the time of finding the nearest surface."""
        alive = self.active & (dr.max(self.weight) > 0)
        origin = self.toward(self.direction, Float(dr.inf)).origin
        return dr.select(alive, world.solids.passed(origin, self.direction, self.shadow_reach, alive, self.seed), 0)


class _Reflection(LitPoints):
    """The BSDFs at camera vertices, and one sample of each."""

    def __init__(self, world: World, point: ShadingPoint, active: Bool) -> None:
        hit = point.hit
        self.point, self.hit, self.active = point, hit, active
        self.bsdf = hit.bsdf()
        self.context = mi.BSDFContext()
        # A cut-out surface was already sampled as opaque: undo the opacity factor of Mitsuba's `mask`.
        self.opacity = world.opacity(hit, active)
        lobe = point.samples.single(point.order, Stream.REFLECTION, point.step)
        u = point.samples.pair(point.order, Stream.REFLECTION, point.step)
        sample, weight = self.bsdf.sample(self.context, hit, lobe * self.opacity, mi.Point2f(u), active)
        self.pdf = sample.pdf / self.opacity
        ideal = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)  # which camera paths follow
        self.weight = dr.select(active & (self.pdf > 0) & ~ideal, Array3f(weight), 0)
        self.direction = Array3f(hit.to_world(sample.wo))
        self.seed = point.samples.bits(point.order, Stream.REFLECTION, point.step)
        self.place, self.reference, self.size = Array3f(hit.p), hit, world.size
        self.site = world.linking.of_surfaces(hit)
        self.shadow_reach: Any = Float(dr.inf)
        self.scale: Any = Float(1)
        self.open = self.unblocked(world)

    def of_lights(self, world: World, links: LinkedSurfaces) -> _Reflection:
        """Return the reflection of lights with links: they light some surfaces, and some surfaces block them."""
        result = copy(self)
        result.active = world.linking.lights(links.source, self.site, self.active)
        result.scale, result.shadow_reach, result.shadow = links.scale, links.reach, links.shadow
        result.weight = dr.select(result.active, self.weight * links.scale, 0)
        result.open = result.unblocked(links.world)
        return result

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return BSDF times cosine, and the pdf of sampling that direction."""
        wo = self.hit.to_local(mi.Vector3f(direction))
        value, pdf = self.bsdf.eval_pdf(self.context, self.hit, wo, self.active)
        return Array3f(value) * (self.scale / self.opacity), pdf / self.opacity


def _adding(world: World, reflection: _Reflection, lamps: Lamps, kind: int) -> Callable[..., tuple[Any, ...]]:
    """Return the body of a loop over the lights of one kind, which adds a light to the radiance."""
    stopping, linked = _linked(world, reflection, lamps.links)

    def add(light: Any, number: UInt32, group: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
        acting = world.linking.acting(dr.gather(UInt32, lamps.sources, number), reflection.site)
        own = scattered(stopping, linked, light.at(acting), (UInt32(Stream.LAMP), UInt32(kind), number))
        return (state[0] + GroupedLight.of(own, group, len(world.groups)),)

    return add


def _linked(world: World, reflection: _Reflection, links: LinkedSurfaces | None) -> tuple[World, _Reflection]:
    """Return the surfaces that block lights with these links, and the hits that these lights light."""
    return (world, reflection) if links is None else (links.world, reflection.of_lights(world, links))


def scattered(world: World, reflection: LitPoints, light: Any, names: tuple[Any, ...]) -> Array3f:
    """Return the scattered radiance of one light: a sample of the light and the sample of a direction, weighted."""
    point, place = reflection.point, reflection.place
    medium = point.medium
    stream = (*names, point.step)
    sample = light.illuminate(place, point.samples.pair(point.order, *stream))
    value, pdf = reflection.evaluate(sample.direction)
    weight = dr.select(sample.pdf > 0, power_heuristic(sample.pdf, pdf), 1)
    value = value * sample.weight * weight
    useful = reflection.active & (dr.max(value) > 0)
    ray = reflection.toward(sample.direction, sample.distance)
    reach = dr.minimum(ray.length, reflection.shadow_reach)
    seed = point.samples.bits(point.order, *stream)
    left = reflection.left(world.solids.passed(ray.origin, ray.direction, reach, useful, seed), useful)
    shown = useful & (dr.max(left) > 0)
    over = reflection.dimmed_over(sample.direction, sample.distance)
    dimming = world.dimming(ray.origin, sample.direction, over, medium, seed, shown)
    result = dr.select(shown, value * dimming * left, 0)

    found = light.see(place, reflection.direction)
    hit = found.hit & (dr.max(reflection.weight) > 0)
    left = reflection.left(reflection.sees(world, hit, found.distance), hit)
    shown = hit & (dr.max(left) > 0)
    weight = power_heuristic(reflection.pdf, found.pdf)
    start = reflection.toward(reflection.direction, found.distance).origin
    over = reflection.dimmed_over(reflection.direction, found.distance)
    dimming = world.dimming(start, reflection.direction, over, medium, hash32(seed), shown)
    value = reflection.weight * found.radiance * weight * dimming * left
    return result + dr.select(shown, value, 0)
