"""Lamps whose light walks meet, which are no surfaces: those of a stage."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import copy
from typing import Any

import drjit as dr

from ...numerics.arrays import to_float
from ...numerics.hashing import hash32
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.portal_lamps import behind
from ...world.emitters.stage_lamps import Lamps
from ...world.shadow_rays import ShadowRay, leaving, to_lamp
from ...world.spectra import rgb
from ...world.world import World
from .camera_paths import ShadingPoint
from .lighting import scattered
from .walk_vertices import Vertex, Walk
from .walked_emitters import chances

mi = mitsuba()


class WalkedLamps:
    """The lamps of a world that walks meet; samples choose a lamp mostly by its power.

    At each vertex one sample of a lamp and one of the phase function or BSDF are weighted against each other, as for
    direct light on surfaces. What a walk meets later counts only behind mirrors and glass.

    Parameters
    ----------
    world, numbers, power, sharp
        As in `WalkedEmitters`.
    """

    def __init__(
        self, world: World, numbers: Sequence[int], power: Sequence[float], sharp: Collection[int] = ()
    ) -> None:  # fmt: skip
        self.world = world.feeling_all()
        kinds: dict[Any, list[int]] = {}
        for place, number in enumerate(numbers):
            lamp = world.emitters[number].lamp
            kinds.setdefault(type(lamp) if lamp.bare.DRJIT_STRUCT else number, []).append(place)
        part, first = chances(power), 0
        self._groups: list[tuple[Any, UInt32, UInt32]] = []
        for places in kinds.values():
            emitters = [world.emitters[numbers[each]] for each in places]
            lamps = [behind(each.lamp, each.portal) for each in emitters]
            group = Lamps.of(lamps, None) if emitters[0].lamp.bare.DRJIT_STRUCT else lamps[0]
            stop = first + len(places)
            self._groups.append((group, dr.opaque(UInt32, first), dr.opaque(UInt32, stop)))
            first = stop
        order = [place for places in kinds.values() for place in places]
        self._choice = mi.DiscreteDistribution(mi.Float(to_float([*part[order], 0.0])))
        self._size = len(numbers)
        lamps = [world.emitters[each].lamp for each in numbers if each not in sharp]
        self._environments = [each for each in lamps if each.environment]

    def __len__(self) -> int:
        """Return how many lamps there are."""
        return self._size

    def direct(self, vertex: Vertex, samples: Samples, name: tuple[Any, ...], active: Bool) -> Array3f:
        """Return the light of one sample of the lamps that vertices scatter along the path, over its density."""
        points = _WalkPoints(self.world, vertex, samples, name, active)
        which = samples.single(vertex.walk.order, Stream.PATH_WHICH_EMITTER, *name)
        index, probability = self._choice.sample_pmf(mi.Float(which), active)
        result = Array3f(0)
        for group, first, stop in self._groups:
            own = active & (index >= first) & (index < stop)
            lamp = group.light(dr.select(own, UInt32(index) - first, 0)) if isinstance(group, Lamps) else group
            result += scattered(self.world, points.among(own), lamp, (UInt32(Stream.PATH_EMITTER),))
        return result * dr.rcp(dr.maximum(Float(probability), 1e-30))

    def met(self, walk: Walk, hit: Any, active: Bool) -> Array3f:
        """Return the radiance of environments that walks meet straight behind mirrors or glass."""
        result, away = Array3f(0), active & (walk.pdf <= 0) & ~hit.is_valid()
        for each in self._environments:
            result += each.see(walk.origin, walk.direction).radiance
        return dr.select(away, result, 0)


class _WalkPoints:
    """The vertices of walks, and one sample of the phase function or the smooth BSDF at each: see `lighting`."""

    def __init__(
        self, world: World, vertex: Vertex, samples: Samples, name: tuple[Any, ...], active: Bool
    ) -> None:  # fmt: skip
        walk, hit = vertex.walk, vertex.hit
        self.point = ShadingPoint(hit, walk.medium, walk.order, hash32(*(UInt32(each) for each in name)), samples)
        self.place, self.active, self._vertex, self._size = vertex.position, active, vertex, world.size
        self._reference = vertex.reference()
        self.shadow_reach, self.shadow = Float(dr.inf), None
        self._opacity = world.opacity(hit, vertex.smooth)
        lobe = samples.single(walk.order, Stream.PATH_REFLECTION, *name)
        turn = mi.Point2f(samples.pair(walk.order, Stream.PATH_REFLECTION_TURN, *name))
        turned, own, pdf = vertex.phase().sample(
            mi.PhaseFunctionContext(), vertex.place(), lobe, turn, active & vertex.scattered
        )
        sample, weight = hit.bsdf().sample(
            mi.BSDFContext(), hit, lobe * self._opacity, turn, active & vertex.smooth
        )  # fmt: skip
        self.direction = Array3f(dr.select(vertex.scattered, turned, hit.to_world(sample.wo)))
        self.pdf = dr.select(vertex.scattered, Float(pdf), sample.pdf / self._opacity)
        good = active & (self.pdf > 0) & (vertex.scattered | ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta))
        self.weight = dr.select(good, dr.select(vertex.scattered, rgb(own), rgb(weight)), 0)
        self._origin = leaving(self._reference, self.direction, self._size)
        self._seed = samples.bits(walk.order, Stream.PATH_SHADOW, *name)
        alive = good & (dr.max(self.weight) > 0)
        self._open = alive & ~world.blocked(self._origin, self.direction, Float(dr.inf), alive, self._seed)

    def among(self, own: Bool) -> _WalkPoints:
        """Return the points that are lit by the lamps of one kind."""
        result = copy(self)
        result.active, result.weight = self.active & own, dr.select(own, self.weight, 0)
        return result

    def toward(self, direction: Array3f, distance: Float) -> ShadowRay:
        """Return the shadow rays to light at a distance, which may be infinite."""
        return to_lamp(self._reference, direction, distance, self._size)

    def sees(self, world: World, met: Bool, distance: Float) -> Bool:
        """Return which samples that meet a lamp, at this distance, are not blocked."""
        behind_it = met & ~self._open & dr.isfinite(distance)
        ray = self.toward(self.direction, distance)
        blocked = world.blocked(ray.origin, ray.direction, ray.length, behind_it, self._seed)
        return met & (self._open | (behind_it & ~blocked))

    def left(self, free: Bool, lit: Bool) -> Array3f:
        """Return 1 where nothing blocks the light, else 0."""
        return dr.select(free, Array3f(1), 0)

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return the factor on light from a direction, and the pdf with which that direction is sampled."""
        vertex, towards = self._vertex, mi.Vector3f(direction)
        value, pdf = vertex.phase().eval_pdf(
            mi.PhaseFunctionContext(), vertex.place(), towards, self.active & vertex.scattered
        )
        reflected, density = vertex.hit.bsdf().eval_pdf(
            mi.BSDFContext(), vertex.hit, vertex.hit.to_local(towards), self.active & vertex.smooth
        )  # fmt: skip
        scattered_there = vertex.scattered
        result = dr.select(scattered_there, rgb(value), rgb(reflected) / self._opacity)
        return Array3f(result), dr.select(scattered_there, Float(pdf), density / self._opacity)
