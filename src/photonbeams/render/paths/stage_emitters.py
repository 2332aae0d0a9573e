"""The lamps of a stage: samples of them, and what rays meet. Lamps are no surfaces, and cast no shadows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any

import drjit as dr

from ...numerics.arrays import padded, to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.build import KINDS
from ...world.emitters.emitter import Links
from ...world.emitters.groups import LightGroups, gathered_group
from ...world.emitters.lamp_boxes import LampBoxes
from ...world.emitters.packed import LinkedSurfaces
from ...world.emitters.portal_lamps import behind
from ...world.shadow_rays import ShadowRay, rounding, to_lamp
from ...world.world import World
from .emitters import Chosen, EmitterChoice, EmitterSample
from .toward_lamps import Balls, around
from .walk_vertices import ScatteredRay, Vertex

mi = mitsuba()


class LampGroup:
    """Lamps of one kind with the same links, of which kernels gather one by its number, or a single one.

    Attributes
    ----------
    numbers, first, stop
        Their numbers in the world; in kernels they are those from `first` to before `stop`.
    bare, seen
        One of the lamps without its images, and whether pictures show them.
    """

    def __init__(self, world: World, numbers: Sequence[int], groups: LightGroups, first: int, linked: bool) -> None:
        emitters = [world.emitters[each] for each in numbers]
        own, self.numbers = emitters[0], numbers
        self._world, self._linking = world, world.linking  # built before it is used in a loop
        self._links = LinkedSurfaces.of(world, own.links) if linked else None
        self.bare, self._looped = own.lamp.bare, bool(own.lamp.bare.DRJIT_STRUCT)
        alone = behind(own.lamp, own.portal)
        self._light = world.lamps.among(numbers) if self._looped else lambda _: alone
        self.first, self.stop = (dr.opaque(UInt32, each) for each in (first, first + len(emitters)))
        self._groups = groups.table([each.beams.group for each in emitters])
        self._sources = to_uint(padded([each.source for each in emitters]))
        near = linked and self._looped and not own.lamp.infinite
        self._boxes = LampBoxes([each.beams for each in emitters], world.bounds) if near else None
        self.seen = own.lamp.seen and own.links.seen

    def holds(self, number: UInt32) -> Bool:
        """Return which numbers are those of its lamps."""
        return (number >= self.first) & (number < self.stop)

    def _index(self, number: UInt32) -> UInt32:
        return dr.select(self.holds(number), number - self.first, 0)

    def lamp(self, number: UInt32) -> Any:
        """Return the lamp with a number, if that is one of its lamps."""
        return self._light(self._index(number))

    def group(self, number: UInt32) -> UInt32:
        """Return the number of the light group of a lamp."""
        return gathered_group(self._groups, self._index(number))

    def each(
        self, state: tuple[Any, ...], body: Callable[..., tuple[Any, ...]], place: Array3f | None = None,
        active: Bool | bool = True,
    ) -> tuple[Any, ...]:  # fmt: skip
        """Return the `state` after body(number, *state) for each lamp, as a loop in the kernel.

        With active places, it is for each of those lamps that can light them.
        """
        if not self._looped:
            return body(self.first, *state)
        # The counter is as wide as the other variables, because a loop has one width.
        entry, stop, boxes = dr.zeros(UInt32, dr.width(state)), self.stop - self.first, self._boxes
        if boxes is not None and place is not None:
            first, stop = boxes.lists(place, Bool(active))
            entry += first

        def step(entry: UInt32, *state: Any) -> tuple[Any, ...]:
            lamp = entry if boxes is None or place is None else boxes.lamp(entry)
            return (entry + 1, *body(self.first + lamp, *state))

        label = type(self.bare).__name__
        return dr.while_loop((entry, *state), lambda entry, *_: entry < stop, step, label=label)[1:]

    def added(
        self, total: GroupedLight, light: Callable[[UInt32], Array3f], place: Array3f | None = None,
        active: Bool | bool = True,
    ) -> GroupedLight:  # fmt: skip
        """Return the `total` and the light of all lamps, light(number), by light groups; see `each`."""

        def add(number: UInt32, total: GroupedLight) -> tuple[GroupedLight]:
            return (total + GroupedLight.of(light(number), self.group(number), len(total.parts)),)

        result: GroupedLight = self.each((total,), add, place, active)[0]
        return result

    def lighting(
        self, number: UInt32, active: Bool, *, place: Array3f, inside: Bool, site: UInt32
    ) -> tuple[Any, Bool]:  # fmt: skip
        """Return lamps as they light places at sites, and which of the active places they light.

        Lamps at infinity light no media outside of the bounds; `inside` are the places in media.
        """
        source = dr.gather(UInt32, self._sources, self._index(number))
        lit = self._linking.lights(source, site, active & self.holds(number))
        if self.bare.infinite:
            lit &= self._world.bounds.holds(place) | ~inside
        return self.lamp(number).at(self._linking.acting(source, site)), lit

    def dimmed_over(self, place: Array3f, inside: Bool, direction: Array3f, distance: Float) -> Float:
        """Return the distance over which media dim the light: in media as that of beams, which enter the bounds."""
        if not self.bare.infinite:
            return distance
        return dr.select(inside, self._world.bounds.behind(place, -direction), distance)

    def sampled(self, lamp: Any, number: UInt32, vertex: Vertex, aim: Array2f, lit: Bool) -> EmitterSample:
        """Return samples of lamps from vertices, which they light if these are `lit`."""
        light = lamp.illuminate(vertex.position, aim)
        over = self.dimmed_over(vertex.position, vertex.scattered, light.direction, light.distance)
        radiance = light.weight if self._links is None else light.weight * self.scale(vertex)
        return EmitterSample(
            lit=lit,
            connected=Bool(False),
            direction=light.direction,
            distance=light.distance,
            over=over,
            radiance=radiance,
            pdf=light.pdf,
            group=self.group(number),
        )

    def scale(self, vertex: Vertex) -> Any:
        """Return the factor on the light that surfaces reflect."""
        return 1 if self._links is None else dr.select(vertex.scattered, 1, self._links.scale)

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""
        ray = to_lamp(vertex.reference(), light.direction, light.distance, self._world.size)
        left = self.shadowed(self.open(ray.origin, ray.direction, ray.length, seed, active), active)
        shown = dr.max(left) > 0
        return left * self._world.dimming(ray.origin, light.direction, light.over, vertex.medium, seed, shown)

    def open(self, origin: Array3f, direction: Array3f, length: Float, seed: UInt32, active: Bool) -> Array3f:
        """Return what surfaces that block the lamps let through along rays: 0, or the colour of panes."""
        world, reach = self._world, length
        if self._links is not None:
            world, reach = self._links.world, dr.minimum(length, self._links.reach)
        return dr.select(active, world.solids.passed(origin, direction, reach, active, seed), 0)

    def shadowed(self, passed: Array3f, lit: Bool) -> Array3f:
        """Return the factor on light at points that are `lit`: what passes surfaces, and the shadow of the rest."""
        return passed if self._links is None else dr.select(lit, passed + (1 - passed) * self._links.shadow, 0)


def lamp_groups(world: World, numbers: Iterable[int], groups: LightGroups, linked: bool) -> list[LampGroup]:
    """Return the lamps with these numbers in groups; those of `linked` lamps have the same links each."""
    alike: dict[Any, list[int]] = {(kind, Links()): [] for kind in KINDS}
    for number in numbers:
        lamp, links = world.emitters[number].lamp, world.emitters[number].links if linked else Links()
        alike.setdefault((type(lamp) if lamp.bare.DRJIT_STRUCT else number, links), []).append(number)
    result: list[LampGroup] = []
    for own in filter(None, alike.values()):
        result.append(LampGroup(world, own, groups, sum(len(each.numbers) for each in result), linked))
    return result


class StageEmitters:
    """Lamps of a stage; samples choose one of them mostly by its power.

    Rays that go on from vertices may meet the lamp that was sampled there. Links of shadows do not count.

    Parameters
    ----------
    world, chosen
        The world, and those of its lamps.
    """

    def __init__(self, world: World, chosen: Chosen) -> None:
        self.world, self.groups = world, chosen.groups(world)
        self._lamps = lamp_groups(world, chosen.numbers, self.groups, linked=False)
        order = [number for lamps in self._lamps for number in lamps.numbers]
        known = {number: place for place, number in enumerate(chosen.numbers)}
        self.choice = EmitterChoice([chosen.power[known[each]] for each in order])
        self._connected = self._bounces = None
        if chosen.connected:
            self._connected = to_uint(padded([int(each in chosen.connected) for each in order]))
        if chosen.bounces is not None:
            self._bounces = to_uint(padded([chosen.bounces[known[each]] for each in order]))
        emitters = [world.emitters[each] for each in order if each not in chosen.sharp]
        self._environments = [each for each in emitters if each.lamp.environment]
        self._size = len(order)

    @cached_property
    def balls(self) -> Balls | None:
        """The spheres around the lamps, by places from which they shine; None: no medium scatters light."""
        if not self.world.media.all:
            return None
        number, place, u = around(self.world.bounds, self._size)
        found = dr.full(Array3f, dr.inf, dr.width(number))
        for lamps in self._lamps:
            light = lamps.lamp(number).illuminate(place, u)
            found = dr.select(lamps.holds(number), place + light.distance * light.direction, found)
        return Balls.of(found, self._size)

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen lamps from active vertices."""
        probability = self.choice.probability(lamp, active)
        active = self._within(lamp, vertex.bounces, active)
        result: Any = None
        for lamps in self._lamps:
            own, lit = lamps.lighting(
                lamp, active, place=vertex.position, inside=vertex.scattered, site=vertex.site
            )  # fmt: skip
            light = lamps.sampled(own, lamp, vertex, aim, lit)
            chosen = lit if result is None else (dr.select(lit, *each) for each in zip(light, result, strict=True))
            result = light if result is None else EmitterSample(*chosen)
        radiance = result.radiance * dr.rcp(dr.maximum(probability, 1e-30))
        return result._replace(radiance=radiance, connected=self._is_connected(lamp, result.lit))

    def _is_connected(self, number: UInt32, active: Bool) -> Bool:
        return Bool(False) if self._connected is None else dr.gather(UInt32, self._connected, number, active) > 0

    def _within(self, number: UInt32, bounces: UInt32, active: Bool) -> Bool:
        """Return which active places the light of lamps may reach after so many bounces."""
        if self._bounces is None:
            return active
        return active & (bounces <= dr.gather(UInt32, self._bounces, number, active))

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces, and these."""
        met, tint = self.world.solids.behind_panes(ray.origin, ray.direction, active, seed)
        dimming = self.world.dimming(ray.origin, ray.direction, met.t, medium, seed, active & met.is_valid())
        return tint * dimming, met

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""
        return self._lamps[0].passed(vertex, light, seed, active)  # the same surfaces block all of them

    def met(
        self, ray: ScatteredRay, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of the lamp that was sampled where rays were last scattered, if they meet it now.

        Behind mirrors and glass, that of all environments.
        """
        world, groups, result, named = self.world, self.groups, Array3f(0), UInt32(0)
        away = active & arrives & (ray.pdf <= 0) & ~hit.is_valid()
        seen = GroupedLight.dark(len(groups))
        for each in self._environments:
            seen = seen + groups.grouped(each.lamp.see(ray.origin, ray.direction).radiance, each.beams.group)
        # Boundaries of media that the ray has passed since then lie behind it.
        passed = dr.dot(ray.origin - ray.place, ray.direction)
        length = dr.select(hit.is_valid(), hit.t, dr.inf)
        probability = self.choice.probability(ray.lamp, active)
        active = self._within(ray.lamp, ray.bounces, active & (ray.pdf > 0))
        for lamps in self._lamps:
            lamp, own = lamps.lighting(ray.lamp, active, place=ray.place, inside=ray.inside, site=ray.site)
            found = lamp.see(ray.place, ray.direction)
            distance = dr.maximum(found.distance - passed, 0)
            slack = rounding(dr.select(dr.isfinite(distance), distance, 0) + dr.max(dr.abs(ray.origin)) + world.size)
            there = own & found.hit & (found.distance > passed) & (distance - slack <= length)
            over = lamps.dimmed_over(ray.place, ray.inside, ray.direction, found.distance) - passed
            dimming = world.dimming(ray.origin, ray.direction, over, ray.medium, seed, there)
            share = power_heuristic(ray.pdf, found.pdf) * dr.rcp(dr.maximum(probability, 1e-30))
            if kept is not None:
                share *= dr.select(self._is_connected(ray.lamp, there), kept, 1)
            result += dr.select(there, found.radiance * dimming * share, 0)
            named = dr.select(own, lamps.group(ray.lamp), named)
        return (seen * weight).where(away) + GroupedLight.of(result, named, len(groups))
