"""Lamps whose light walks meet, which are no surfaces: those of a stage."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Any

import drjit as dr

from ...numerics.arrays import padded, to_float, to_uint
from ...numerics.hashing import hash32
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.packed import Lamps
from ...world.emitters.portal_lamps import behind
from ...world.world import World
from .camera_paths import ShadingPoint
from .lighting import LitPoints, scattered
from .walk_vertices import Vertex, Walk
from .walked_emitters import Chosen, chances

mi = mitsuba()


class WalkedLamps:
    """The lamps of a world that walks meet; samples choose a lamp mostly by its power.

    At each vertex one sample of a lamp and one of the phase function or BSDF are weighted against each other, as for
    direct light on surfaces. What a walk meets later counts only behind mirrors and glass.

    Parameters
    ----------
    world, chosen
        The world, and those of its lamps.
    """

    def __init__(self, world: World, chosen: Chosen) -> None:
        numbers = chosen.numbers
        self.world = world.feeling_all()
        kinds: dict[Any, list[int]] = {}
        for place, number in enumerate(numbers):
            lamp = world.emitters[number].lamp
            kinds.setdefault(type(lamp) if lamp.bare.DRJIT_STRUCT else number, []).append(place)
        part, first = chances(chosen.power), 0
        self._groups: list[tuple[Callable[[UInt32], Any], bool, UInt32, UInt32]] = []
        for places in kinds.values():
            emitters = [world.emitters[numbers[each]] for each in places]
            lamps = [behind(each.lamp, each.portal) for each in emitters]
            packed = emitters[0].lamp.bare.DRJIT_STRUCT
            lamp_of = Lamps.of(lamps, None).light if packed else partial(_single, lamps[0])
            stop = first + len(places)
            self._groups.append((lamp_of, emitters[0].lamp.infinite, dr.opaque(UInt32, first), dr.opaque(UInt32, stop)))
            first = stop
        order = [place for places in kinds.values() for place in places]
        self._choice = mi.DiscreteDistribution(mi.Float(to_float([*part[order], 0.0])))
        self._bounces = None
        if chosen.bounces is not None:
            self._bounces = to_uint(padded([chosen.bounces[place] for place in order]))
        self._size = len(numbers)
        lamps = [world.emitters[each].lamp for each in numbers if each not in chosen.sharp]
        self._environments = [each for each in lamps if each.environment]

    def __len__(self) -> int:
        """Return how many lamps there are."""
        return self._size

    def direct(self, vertex: Vertex, samples: Samples, name: tuple[Any, ...], active: Bool) -> Array3f:
        """Return the light of one sample of the lamps that vertices scatter along the path, over its density."""
        points = _WalkPoints(self.world, vertex, samples, name, active)
        which = samples.single(vertex.walk.order, Stream.PATH_WHICH_EMITTER, *name)
        index, probability = self._choice.sample_pmf(mi.Float(which), active)
        if self._bounces is not None:
            active &= vertex.walk.bounces + 1 <= dr.gather(UInt32, self._bounces, UInt32(index), active)
        result = Array3f(0)
        for lamp_of, infinite, first, stop in self._groups:
            own = active & (index >= first) & (index < stop)
            lamp = lamp_of(dr.select(own, UInt32(index) - first, 0))
            result += scattered(self.world, points.among(own, infinite), lamp, (UInt32(Stream.PATH_EMITTER),))
        return result * dr.rcp(dr.maximum(Float(probability), 1e-30))

    def met(self, walk: Walk, hit: Any, active: Bool) -> Array3f:
        """Return the radiance of environments that walks meet straight behind mirrors or glass."""
        result, away = Array3f(0), active & (walk.pdf <= 0) & ~hit.is_valid()
        for each in self._environments:
            result += each.see(walk.origin, walk.direction).radiance
        return dr.select(away, result, 0)


def _single(lamp: Any, _: UInt32) -> Any:
    """Return a lamp that is not packed."""
    return lamp


class _WalkPoints(LitPoints):
    """The vertices of walks, and one sample of the phase function or the smooth BSDF at each."""

    def __init__(
        self, world: World, vertex: Vertex, samples: Samples, name: tuple[Any, ...], active: Bool
    ) -> None:  # fmt: skip
        walk = vertex.walk
        step = hash32(*(UInt32(each) for each in name))
        self.point = ShadingPoint(vertex.hit, walk.medium, walk.order, step, samples)
        self.place, self._vertex, self.shadow_reach = vertex.position, vertex, Float(dr.inf)
        self._bounds, to = world.bounds, vertex.position - world.bounds.center
        self._within = ~vertex.scattered | (dr.squared_norm(to) <= dr.square(world.bounds.radius))
        self.reference, self.size, self.active = vertex.reference(), world.size, active
        lobe = samples.single(walk.order, Stream.PATH_REFLECTION, *name)
        turn = mi.Point2f(samples.pair(walk.order, Stream.PATH_REFLECTION_TURN, *name))
        chosen = vertex.sampled(lobe, turn, active)
        self.direction, self.pdf = chosen.direction, Float(chosen.pdf)
        ideal = mi.has_flag(chosen.bsdf.sampled_type, mi.BSDFFlags.Delta)
        good = active & (self.pdf > 0) & (vertex.scattered | ~ideal)
        self.weight = dr.select(good, chosen.weight, 0)
        self.seed = samples.bits(walk.order, Stream.PATH_SHADOW, *name)
        self.open = self.unblocked(world)

    def among(self, own: Bool, infinite: Bool) -> _WalkPoints:
        """Return the points that lamps of one kind light: `infinite` ones light no media outside of the bounds."""
        result = copy(self)
        own = own & (self._within | ~infinite)
        result.active, result.weight = self.active & own, dr.select(own, self.weight, 0)
        return result

    def dimmed_over(self, direction: Array3f, distance: Float) -> Float:
        """Return the distance over which media dim the light: that of beams, which enter the bounds from infinity."""
        entered = self._bounds.behind(self.place, -direction)
        return dr.select(self._vertex.scattered & dr.isinf(distance), entered, distance)

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return the factor on light from a direction, and the pdf with which that direction is sampled."""
        value, pdf = self._vertex.evaluate(direction, self.active)
        return Array3f(value), Float(pdf)
