"""Emitters whose light walks meet: what is known of them, and those of a Mitsuba scene."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from ...numerics.arrays import padded, to_float, to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import ONE_GROUP, GroupedEmitters, LightGroups
from ...world.emitters.mitsuba_scene import by_emitter, emitter_number
from ...world.emitters.portal_lamps import EnvironmentPortal
from ...world.media.visibility import through
from ...world.shadow_rays import ShadowRay, to_point
from ...world.spectra import rgb
from ...world.world import World
from .toward_lamps import Balls, around
from .walk_vertices import Vertex, Walk, interaction

mi = mitsuba()

# The fraction of samples that is spread evenly over all emitters: a weak one may be near.
_EVENLY = 0.25


class Chosen(NamedTuple):
    """Emitters that walks meet.

    Attributes
    ----------
    numbers, power
        Their numbers in the world, at least one, and the power of each.
    bounces
        The most bounces of the light of each; None: the longest path alone bounds them.
    sharp, connected
        The emitters whose caustics are left to photons and beams, and those that have virtual lights.
    grouped
        Whether their light is known by light groups.
    """

    numbers: Sequence[int]
    power: Sequence[float]
    bounces: Sequence[int] | None = None
    sharp: Collection[int] = ()
    connected: Collection[int] = ()
    grouped: bool = False

    def groups(self, world: World) -> LightGroups:
        """Return the light groups of what walks find."""
        return world.groups if self.grouped else ONE_GROUP


class EmitterSample(NamedTuple):
    """A sample of the emitters from vertices.

    Attributes
    ----------
    lit, connected
        Whether there is light, and whether its emitter has virtual lights.
    direction, distance, over
        Where the light comes from, its distance, and the distance over which media dim it.
    radiance, pdf
        The radiance over the density, and the density against which that of walks is weighted; 0: walks cannot meet it.
    group
        The number of its light group.
    """

    lit: Bool
    connected: Bool
    direction: Array3f
    distance: Float
    over: Float
    radiance: Array3f
    pdf: Float
    group: UInt32


class Walked(Protocol):
    """Emitters whose light walks meet.

    `balls` are the spheres around them; None: no medium scatters light.
    """

    world: World
    groups: LightGroups
    balls: Balls | None

    def __len__(self) -> int:
        """Return how many emitters there are."""

    def choose(self, which: Float) -> UInt32:
        """Return the emitter that a number in [0, 1) chooses: see `Walk.lamp`."""

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen emitters from active vertices, as if nothing were between."""

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces, and these.

        `medium` is that in which the camera path arrives at the hits.
        """

    def met(
        self, walk: Walk, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of these emitters where walks meet them, weighted against that of `sampled`.

        Parameters
        ----------
        walk, hit
            The walks, and the surfaces ahead of them.
        weight, arrives
            The weights of their free flights, and which flights end at these surfaces.
        active, seed
            The walks whose light counts, and seeds for the transmittance of media.
        kept
            Factors on the light of emitters that have virtual lights; None: no emitter has any.
        """


def chances(power: Sequence[float]) -> np.ndarray:
    """Return the probabilities with which emitters of these powers are sampled."""
    part = np.asarray(power) / sum(power) if sum(power) > 0 else np.zeros(len(power))
    part = _EVENLY / len(power) + (1 - _EVENLY) * part
    result: np.ndarray = part / part.sum()
    return result


class WalkedEmitters:
    """The emitters of a Mitsuba scene that walks meet; their samples choose an emitter mostly by its power.

    Parameters
    ----------
    world, chosen
        The scene, and the emitters.
    portal
        The portal before the scene's environment, or None.
    """

    def __init__(self, world: World, chosen: Chosen, portal: EnvironmentPortal | None = None) -> None:
        numbers = chosen.numbers
        emitters, part = world.plugin.emitters(), chances(chosen.power)
        table = partial(by_emitter, world.plugin)
        self.world, self.groups, self._table = world, chosen.groups(world), to_float(table(numbers, part))
        self._grouped = GroupedEmitters(world, self.groups)
        self._size = len(numbers)
        self._portal = portal
        self._connected, self._sharp = (
            to_uint(table([*some], 1)) if some else None for some in (chosen.connected, chosen.sharp)
        )
        self._bounces = None if chosen.bounces is None else to_uint(table(numbers, chosen.bounces))
        places = to_uint(padded(numbers))
        self._own = dr.gather(mi.EmitterPtr, world.plugin.emitters_dr(), places)
        self._choice = mi.DiscreteDistribution(mi.Float(to_float([*part, 0.0])))
        self.balls = self._balls() if world.media.all else None
        self._visible = any(not mi.has_flag(emitters[each].flags(), mi.EmitterFlags.Delta) for each in numbers)

    def __len__(self) -> int:
        """Return how many emitters there are."""
        return self._size

    def _balls(self) -> Balls:
        """Return the spheres around the emitters, by places from which they shine."""
        number, place, u = around(self.world.bounds, self._size)
        light, _ = dr.gather(mi.EmitterPtr, self._own, number).sample_direction(
            interaction(place, Array3f(0)), mi.Point2f(u), True
        )
        infinite = mi.has_flag(dr.gather(mi.EmitterPtr, self._own, number).flags(), mi.EmitterFlags.Infinite)
        return Balls.of(dr.select(infinite, dr.inf, Array3f(light.p)), self._size)

    def choose(self, which: Float) -> UInt32:
        """Return the emitter that a number in [0, 1) chooses."""
        return UInt32(self._choice.sample(mi.Float(which)))

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen emitters from active vertices."""
        walk, reference = vertex.walk, vertex.reference()
        probability: Any = self._choice.eval_pmf_normalized(lamp, active)
        emitter = dr.gather(mi.EmitterPtr, self._own, lamp, active)
        light, radiance = emitter.sample_direction(reference, mi.Point2f(aim), active)
        light.pdf *= probability
        brought = rgb(radiance) * dr.rcp(dr.maximum(probability, 1e-30))
        if self._portal is not None:
            light, brought = self._portal.sampled(Array3f(reference.p), light, brought, aim, probability)
        lit = active & (light.pdf > 0)
        if self._bounces is not None:
            lit &= walk.bounces + 1 <= dr.gather(UInt32, self._bounces, emitter_number(light.emitter), lit)
        pdf = dr.select(light.delta, 0, light.pdf)
        connected = self._is_connected(light.emitter, lit)
        veiled, distance = self.world.veiled(light.emitter, vertex.position, Array3f(light.d), light.dist)
        pdf = dr.select(veiled, 0, pdf)
        lit &= dr.isfinite(distance)
        return EmitterSample(
            lit, connected, Array3f(light.d), distance, distance, brought, pdf, self._grouped.group(light.emitter),
        )  # fmt: skip

    def _is_connected(self, emitter: Any, active: Bool) -> Bool:
        if self._connected is None:
            return Bool(False)
        return dr.gather(UInt32, self._connected, emitter_number(emitter), active) > 0

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces that are no boundaries, and these."""
        # The rays end, since boundaries move them aside: they go on toward their ends.
        world, along = self.world, ray.across()
        entered = world.media.beyond(hit, ray.direction, medium, active)
        return through(world.plugin, world.media, along, entered, seed, active, coarse=True, size=world.size, onto=True)

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""
        walk, world, reference = vertex.walk, self.world, vertex.reference()
        entered = world.media.beyond(vertex.hit, light.direction, walk.medium, active & vertex.smooth)
        medium = dr.select(vertex.scattered, walk.medium, entered)
        ray = to_point(reference, vertex.position + light.distance * light.direction, world.size).ray()
        passed, _ = through(world.plugin, world.media, ray, medium, seed, active, coarse=True, size=world.size)
        return Array3f(passed)

    def met(
        self, walk: Walk, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of these emitters where walks meet them, weighted against samples of emitters."""
        active &= arrives
        place, ideal = walk.place, walk.pdf <= 0
        if not self._visible:
            return GroupedLight.dark(len(self.groups), dr.width(place))
        emitter: Any = hit.emitter(self.world.plugin, active)
        numbers = emitter_number(emitter)
        probability = dr.gather(Float, self._table, numbers, active)
        veiled, _ = self.world.veiled(emitter, place, walk.direction, hit.t)
        own = active & (probability > 0) & ~veiled
        if self._bounces is not None:
            own &= walk.bounces <= dr.gather(UInt32, self._bounces, numbers, own)
        if self._sharp is not None:
            own &= ~(ideal & (dr.gather(UInt32, self._sharp, numbers, active) > 0))
        reference = interaction(place, Array3f(0))
        light = mi.DirectionSample3f(self.world.plugin, hit, reference)
        pdf = emitter.pdf_direction(reference, light, own) * probability
        if self._portal is not None:
            pdf = self._portal.density(emitter, place, Array3f(light.d), pdf, probability)
        share = dr.select(ideal, 1, power_heuristic(walk.pdf, dr.select(own, pdf, 0)))
        if kept is not None:
            share *= dr.select(self._is_connected(emitter, own), kept, 1)
        return self._grouped.of(dr.select(own, weight * rgb(emitter.eval(hit, own)) * share, 0), emitter)
