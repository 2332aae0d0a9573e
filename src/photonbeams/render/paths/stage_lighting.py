"""The emitters of a stage, as camera paths see them and as they light points straight.

Direct light takes one sample of each lamp, and one sample of the BSDF or phase function for all lamps, combined by
multiple importance sampling (power heuristic, Veach 1997). Lamps occlude what is behind them from the camera, and cast
no shadows.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from typing import Any

import drjit as dr

from ...numerics.grouped import GroupedLight
from ...numerics.hashing import hash32
from ...numerics.sampling import power_heuristic
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import gathered_group
from ...world.emitters.linking import by_shape, shape_number
from ...world.shadow_rays import to_lamp
from ...world.world import World
from .camera_paths import NearestLamp, ShadingPoint
from .emitters import arriving
from .stage_emitters import LampGroup, lamp_groups
from .walk_vertices import Vertex

mi = mitsuba()


class StageLighting:
    """The light of a stage's emitters: lamps, environments, and surfaces that glow.

    The emitters with numbers `unsampled` are not sampled.
    """

    def __init__(self, world: World, unsampled: Collection[int] = ()) -> None:
        self._world = world
        shining = [each.beams.lights_surfaces and each.beams.shines for each in world.emitters]
        lighting = [number for number, shines in enumerate(shining) if shines]
        sampled = [each for each in lighting if each not in unsampled]
        self._all = lamp_groups(world, lighting, world.groups, linked=True)
        same = sampled == lighting
        self._sampled = self._all if same else lamp_groups(world, sampled, world.groups, linked=True)
        glow = {name: world.groups.number(world.glow.get(name, "")) for name, _ in world.shapes}
        self._glowing = by_shape(world, glow) if len(world.groups) > 1 else None

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> NearestLamp | None:
        """Return the nearest lamp that emits toward rays which have come the distance `flown`."""
        shown = [each for each in self._all if each.seen and not each.bare.infinite]
        if not shown:
            return None
        # Images on portals also tint light that passed them before the ray's segment begins.
        straight_from = origin - flown * direction
        width, count = max(dr.width(origin), dr.width(direction)), len(self._world.groups)
        state: tuple[Any, ...] = (dr.full(Float, dr.inf, width), dr.zeros(Array3f, width), dr.zeros(UInt32, width))

        def nearer(
            lamps: LampGroup, number: UInt32, distance: Float, radiance: Array3f, group: UInt32
        ) -> tuple[Any, ...]:
            found = lamps.lamp(number).see(straight_from, direction)
            beyond = found.distance - flown
            front = found.hit & (beyond > 0) & (beyond < distance) & (dr.max(found.radiance) > 0)
            own = beyond, found.radiance, lamps.group(number)
            return tuple(dr.select(front, *each) for each in zip(own, (distance, radiance, group), strict=True))

        for lamps in shown:
            state = lamps.each(state, partial(nearer, lamps))
        distance, radiance, group = state
        return NearestLamp(distance, GroupedLight.of(radiance, group, count))

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return the radiance that surfaces emit, on both sides, or of the background where rays meet nothing."""
        met = hit.is_valid()
        return self._glow(hit, active & met) + self._background(origin, direction).where(active & ~met)

    def _background(self, origin: Array3f, direction: Array3f) -> GroupedLight:
        """Return the radiance at infinity: environments and the discs of distant lights."""
        count = len(self._world.groups)
        total = GroupedLight.dark(count, max(dr.width(origin), dr.width(direction)))
        for lamps in self._all:
            if lamps.seen and lamps.bare.infinite:
                total = lamps.added(total, partial(_at_infinity, lamps, origin, direction))
        return total

    def _glow(self, hit: Any, active: Bool) -> GroupedLight:
        groups = self._world.groups
        if not self._world.glowing:
            return GroupedLight.dark(len(groups), dr.width(hit.t))
        incident = mi.Vector3f(hit.wi)
        front = mi.SurfaceInteraction3f(hit)
        front.wi = mi.Vector3f(incident.x, incident.y, dr.abs(incident.z))  # Mitsuba's emitters are one-sided
        light = Array3f(front.emitter(self._world.plugin).eval(front, active))
        return GroupedLight.of(light, gathered_group(self._glowing, shape_number(hit.shape)), len(groups))

    def direct(self, point: ShadingPoint, active: Bool) -> GroupedLight:
        """Return the direct light that surfaces reflect along the path."""
        total = GroupedLight.dark(len(self._world.groups), dr.width(point.hit.t))
        if not self._sampled:
            return total
        vertex = Vertex.of_surfaces(self._world, point.hit, point.medium, active)
        lit = LitVertex(point, vertex, active, Stream.REFLECTION, Stream.REFLECTION)
        for kind, lamps in enumerate(self._sampled):
            names = UInt32(Stream.LAMP), UInt32(kind)
            light = partial(lit.scattered, lamps, lit.open(lamps), names)
            total = lamps.added(total, light, vertex.position, active)
        return total


class LitVertex:
    """Vertices with one sample of a direction each, for the light of all lamps.

    `lobe` and `turn` are the streams of the sample. Ideal lobes are none: camera paths follow these.
    """

    def __init__(self, point: ShadingPoint, vertex: Vertex, active: Bool, lobe: Stream, turn: Stream) -> None:
        samples, order, step = point.samples, point.order, point.step
        chosen = vertex.directed(samples.single(order, lobe, step), samples.pair(order, turn, step))
        usable = active & (chosen.pdf > 0) & ~chosen.ideal
        self._point, self._vertex, self._active, self._chosen = point, vertex, active, chosen
        self._weight = dr.select(usable, chosen.weight, 0)
        self._seed = samples.bits(order, lobe, step)
        self._origin, self._size = vertex.leaving(chosen.direction), vertex.world.size

    def open(self, lamps: LampGroup) -> Array3f:
        """Return what surfaces let through on the samples: this takes half the time of finding the nearest surface."""
        alive = self._active & (dr.max(self._weight) > 0)
        return lamps.open(self._origin, self._chosen.direction, Float(dr.inf), self._seed, alive)

    def scattered(self, lamps: LampGroup, open: Array3f, names: tuple[UInt32, ...], number: UInt32) -> Array3f:
        """Return the light of one lamp that vertices scatter toward the camera; `open` is that of the group.

        A sample of the lamp and the sample of a direction are weighted by the power heuristic.
        """
        point, vertex, chosen = self._point, self._vertex, self._chosen
        place, stream = vertex.position, (*names, number - lamps.first, point.step)
        lamp, active = lamps.lighting(number, self._active, place=place, inside=vertex.scattered, site=vertex.site)
        light = lamps.sampled(lamp, number, vertex, point.samples.pair(point.order, *stream), active)
        seed = point.samples.bits(point.order, *stream)
        value, pdf = vertex.evaluate(light.direction, active)
        result = arriving(lamps.passed, vertex, light, value, pdf, seed)

        found = lamp.see(place, chosen.direction)
        met = active & found.hit & (dr.max(self._weight) > 0)
        left = lamps.shadowed(self._seen(lamps, open, met, found.distance), met)
        over = lamps.dimmed_over(place, vertex.scattered, chosen.direction, found.distance)
        dimming = vertex.world.dimming(
            self._origin, chosen.direction, over, vertex.medium, hash32(seed), met & (dr.max(left) > 0)
        )
        weight = self._weight * lamps.scale(vertex) * power_heuristic(chosen.pdf, found.pdf)
        return result + dr.select(met, weight * found.radiance * dimming * left, 0)

    def _seen(self, lamps: LampGroup, open: Array3f, met: Bool, distance: Float) -> Array3f:
        """Return what surfaces let through to samples of directions that meet a lamp at this distance."""
        # Small lamps are met seldom. The seed is that of `open`: a cut-out that lets one ray through lets the other.
        before = met & (dr.min(open) < 1) & dr.isfinite(distance)
        ray = to_lamp(self._vertex.reference(), self._chosen.direction, distance, self._size)
        passed = lamps.open(ray.origin, ray.direction, ray.length, self._seed, before)
        return dr.select(met, dr.select(before, passed, open), 0)


def _at_infinity(lamps: LampGroup, origin: Array3f, direction: Array3f, number: UInt32) -> Array3f:
    """Return the radiance at infinity of a lamp along rays."""
    found = lamps.lamp(number).see(origin, direction)
    return dr.select(dr.isfinite(found.distance), 0, found.radiance)
