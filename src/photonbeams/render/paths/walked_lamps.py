"""Lamps whose light walks meet, which are no surfaces: those of a stage."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import drjit as dr

from ...numerics.arrays import padded, to_float, to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import gathered_group
from ...world.emitters.packed import Lamps
from ...world.emitters.portal_lamps import behind
from ...world.shadow_rays import ShadowRay, rounding, to_lamp
from ...world.world import World
from .emitters import Chosen, EmitterSample, chances
from .toward_lamps import Balls, around
from .walk_vertices import ScatteredRay, Vertex

mi = mitsuba()


class WalkedLamps:
    """The lamps of a world that walks meet; samples choose a lamp mostly by its power.

    At each vertex a lamp is chosen. One sample of it is weighted against the direction in which the walk goes on, which
    may meet it.

    Parameters
    ----------
    world, chosen
        The world, and those of its lamps.
    """

    def __init__(self, world: World, chosen: Chosen) -> None:
        numbers = chosen.numbers
        self.world = world.feeling_all()
        self._linking = self.world.linking  # built before it is used in a loop
        kinds: dict[Any, list[int]] = {}
        for place, number in enumerate(numbers):
            lamp = world.emitters[number].lamp
            kinds.setdefault(type(lamp) if lamp.bare.DRJIT_STRUCT else number, []).append(place)
        part, first = chances(chosen.power), 0
        self._groups: list[_Group] = []
        for places in kinds.values():
            emitters = [world.emitters[numbers[each]] for each in places]
            lamps = [behind(each.lamp, each.portal) for each in emitters]
            packed = emitters[0].lamp.bare.DRJIT_STRUCT
            lamp_of = Lamps.of(lamps, None).light if packed else partial(_single, lamps[0])
            stop = first + len(places)
            infinite = emitters[0].lamp.infinite
            self._groups.append(_Group(lamp_of, infinite, dr.opaque(UInt32, first), dr.opaque(UInt32, stop)))
            first = stop
        order = [place for places in kinds.values() for place in places]
        self._choice = mi.DiscreteDistribution(mi.Float(to_float([*part[order], 0.0])))
        self._connected = None
        if chosen.connected:
            self._connected = to_uint(padded([int(numbers[place] in chosen.connected) for place in order]))
        self._bounces = None
        if chosen.bounces is not None:
            self._bounces = to_uint(padded([chosen.bounces[place] for place in order]))
        self._sources = to_uint(padded([world.emitters[numbers[place]].source for place in order]))
        self._size, self.groups = len(numbers), chosen.groups(world)
        self.balls = self._balls() if world.media.all else None
        self._group_of = self.groups.table([world.emitters[numbers[place]].beams.group for place in order])
        emitters = [world.emitters[each] for each in numbers if each not in chosen.sharp]
        self._environments = [each for each in emitters if each.lamp.environment]

    def __len__(self) -> int:
        """Return how many lamps there are."""
        return self._size

    def _balls(self) -> Balls:
        """Return the spheres around the lamps, by places from which they shine."""
        number, place, u = around(self.world.bounds, self._size)
        found = dr.full(Array3f, dr.inf, dr.width(number))
        for group in self._groups:
            own = (number >= group.first) & (number < group.stop)
            light = group.lamp(number, own).illuminate(place, u)
            found = dr.select(own, place + light.distance * light.direction, found)
        return Balls.of(found, self._size)

    def choose(self, which: Float) -> tuple[UInt32, Float]:
        """Return the lamp that a number in [0, 1) chooses, and what is left of that number, in [0, 1) again."""
        lamp, rest = self._choice.sample_reuse(mi.Float(which))
        return UInt32(lamp), Float(rest)

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen lamps from active vertices."""
        place, inside, number = vertex.position, vertex.scattered, lamp
        probability: Any = self._choice.eval_pmf_normalized(lamp, active)
        active, acting = self._acting(lamp, vertex.bounces, vertex.site, active)
        lit: Any = Bool(False)
        found: Any = (Array3f(0, 0, 1), Float(0), Float(0), Array3f(0), Float(0))
        for group in self._groups:
            own = group.lights(self.world, number, place, inside, active)
            light = group.lamp(number, own).at(acting).illuminate(place, aim)
            over = group.dimmed_over(self.world, place, inside, light.direction, light.distance)
            each = (light.direction, light.distance, over, light.weight, light.pdf)
            found = tuple(dr.select(own, one, other) for one, other in zip(each, found, strict=True))
            lit |= own
        direction, distance, over, radiance, pdf = found
        radiance = radiance * dr.rcp(dr.maximum(Float(probability), 1e-30))
        connected, named = self._is_connected(number, lit), gathered_group(self._group_of, number)
        return EmitterSample(lit, connected, direction, distance, over, radiance, pdf, named)

    def _is_connected(self, number: UInt32, active: Bool) -> Bool:
        return Bool(False) if self._connected is None else dr.gather(UInt32, self._connected, number, active) > 0

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces, and these."""
        met, tint = self.world.solids.behind_panes(ray.origin, ray.direction, active, seed)
        dimming = self.world.dimming(ray.origin, ray.direction, met.t, medium, seed, active & met.is_valid())
        return tint * dimming, met

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""
        world, ray = self.world, to_lamp(vertex.reference(), light.direction, light.distance, self.world.size)
        tint = dr.select(active, world.solids.passed(ray.origin, ray.direction, ray.length, active, seed), 0)
        dimming = world.dimming(ray.origin, light.direction, light.over, vertex.medium, seed, dr.max(tint) > 0)
        return tint * dimming

    def met(
        self, ray: ScatteredRay, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of the lamp that was sampled where walks were last scattered, if they meet it now.

        Behind mirrors and glass, that of all environments.
        """
        world, groups, result = self.world, self.groups, Array3f(0)
        away = active & arrives & (ray.pdf <= 0) & ~hit.is_valid()
        seen = GroupedLight.dark(len(groups))
        for each in self._environments:
            seen = seen + groups.grouped(each.lamp.see(ray.origin, ray.direction).radiance, each.beams.group)
        # Boundaries of media that the walk has passed since then lie behind it.
        passed = dr.dot(ray.origin - ray.place, ray.direction)
        length = dr.select(hit.is_valid(), hit.t, dr.inf)
        active, acting = self._acting(ray.lamp, ray.bounces, ray.site, active & (ray.pdf > 0))
        probability = self._choice.eval_pmf_normalized(ray.lamp, active)
        for group in self._groups:
            own = group.lights(world, ray.lamp, ray.place, ray.inside, active)
            found = group.lamp(ray.lamp, own).at(acting).see(ray.place, ray.direction)
            distance = dr.maximum(found.distance - passed, 0)
            slack = rounding(dr.select(dr.isfinite(distance), distance, 0) + dr.max(dr.abs(ray.origin)) + world.size)
            there = own & found.hit & (found.distance > passed) & (distance - slack <= length)
            over = group.dimmed_over(world, ray.place, ray.inside, ray.direction, found.distance) - passed
            dimming = world.dimming(ray.origin, ray.direction, over, ray.medium, seed, there)
            share = power_heuristic(ray.pdf, found.pdf) * dr.rcp(dr.maximum(Float(probability), 1e-30))
            if kept is not None:
                share *= dr.select(self._is_connected(ray.lamp, there), kept, 1)
            result += dr.select(there, found.radiance * dimming * share, 0)
        sampled = GroupedLight.of(result, gathered_group(self._group_of, ray.lamp), len(groups))
        return (seen * weight).where(away) + sampled

    def _acting(self, number: UInt32, bounces: UInt32, site: UInt32, active: Bool) -> tuple[Bool, UInt32 | None]:
        """Return which active sites these lamps light after so many bounces, and which of the lamps' filters act."""
        if self._bounces is not None:
            active &= bounces <= dr.gather(UInt32, self._bounces, number, active)
        source = dr.gather(UInt32, self._sources, number, active)
        return self._linking.lights(source, site, active), self._linking.acting(source, site)


class _Group(NamedTuple):
    """The lamps of one kind, with the numbers from `first` to before `stop`.

    `of` returns one of them, and `infinite` says whether they are infinitely far away.
    """

    of: Callable[[UInt32], Any]
    infinite: bool
    first: UInt32
    stop: UInt32

    def lamp(self, number: UInt32, own: Bool) -> Any:
        """Return the lamp with a number, where it is `own`."""
        return self.of(dr.select(own, number - self.first, 0))

    def lights(self, world: World, number: UInt32, place: Array3f, inside: Bool, active: Bool) -> Bool:
        """Return which of the active places these lamps light: at infinity, no media outside of the bounds."""
        own = active & (number >= self.first) & (number < self.stop)
        if not self.infinite:
            return own
        return own & (world.bounds.holds(place) | ~inside)

    def dimmed_over(
        self, world: World, place: Array3f, inside: Bool, direction: Array3f, distance: Float
    ) -> Float:  # fmt: skip
        """Return the distance over which media dim the light: in media as that of beams, which enter the bounds."""
        if not self.infinite:
            return distance
        return dr.select(inside, world.bounds.behind(place, -direction), distance)


def _single(lamp: Any, _: UInt32) -> Any:
    """Return a lamp that is not packed."""
    return lamp
