"""The emitters of a Mitsuba scene: samples of them, and what rays meet, behind images, filters and portals.

Shadow rays pass boundaries of media and other surfaces with null lobes. Light that is scattered or refracted on its way
comes from photons.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.arrays import padded, to_float, to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...numerics.streams import Stream
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import GroupedEmitters
from ...world.emitters.mitsuba_scene import by_emitter, emitter_number
from ...world.emitters.portal_lamps import EnvironmentPortal
from ...world.media.visibility import through
from ...world.shadow_rays import ShadowRay, to_point
from ...world.spectra import rgb
from ...world.world import World, passes
from .camera_paths import ShadingPoint
from .emitters import Chosen, EmitterChoice, EmitterSample, arriving
from .toward_lamps import Balls, around
from .walk_vertices import ScatteredRay, Vertex, interaction

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import EmitterPtr

mi = mitsuba()


class MitsubaEmitters:
    """Emitters of a Mitsuba scene; samples choose one of them mostly by its power.

    Parameters
    ----------
    world, chosen
        The scene, and the emitters.
    portal
        The portal before the scene's environment, or None.
    """

    def __init__(self, world: World, chosen: Chosen, portal: EnvironmentPortal | None = None) -> None:
        numbers = chosen.numbers
        emitters = world.plugin.emitters()
        table = partial(by_emitter, world.plugin)
        self.world, self.groups = world, chosen.groups(world)
        self._grouped = GroupedEmitters(world, self.groups)
        self._size, self._coarse = len(numbers), chosen.coarse
        self._portal = portal
        self._connected, self._sharp, self._unmet = (
            to_uint(table([*some], 1)) if some else None for some in (chosen.connected, chosen.sharp, chosen.unmet)
        )
        self._bounces = None if chosen.bounces is None else to_uint(table(numbers, chosen.bounces))
        self._tinted = [
            (dr.opaque(UInt32, int(emitter_number(mi.EmitterPtr(plugin))[0])), each)
            for plugin, each in zip(emitters, world.emitters, strict=True)
            if each.lamp.images or each.lamp.filters is not None
        ]
        if numbers:
            self._own = dr.gather(mi.EmitterPtr, world.plugin.emitters_dr(), to_uint(padded(numbers)))
            self.choice = EmitterChoice(chosen.power)
            self._table = to_float(table(numbers, self.choice.probabilities))
        self._visible = any(not mi.has_flag(emitters[each].flags(), mi.EmitterFlags.Delta) for each in numbers)

    @cached_property
    def balls(self) -> Balls | None:
        """The spheres around the emitters, by places from which they shine; None: no medium scatters light."""
        if not self.world.media.all:
            return None
        number, place, u = around(self.world.bounds, self._size)
        light, _ = dr.gather(mi.EmitterPtr, self._own, number).sample_direction(
            interaction(place, Array3f(0)), mi.Point2f(u), True
        )
        infinite = mi.has_flag(dr.gather(mi.EmitterPtr, self._own, number).flags(), mi.EmitterFlags.Infinite)
        return Balls.of(dr.select(infinite, dr.inf, Array3f(light.p)), self._size)

    def sampled(self, vertex: Vertex, lamp: UInt32, aim: Array2f, active: Bool) -> EmitterSample:
        """Return a sample of chosen emitters from active vertices."""
        reference = vertex.reference()
        probability = self.choice.probability(lamp, active)
        emitter = dr.gather(mi.EmitterPtr, self._own, lamp, active)
        light, radiance = emitter.sample_direction(reference, mi.Point2f(aim), active)
        light.pdf *= probability
        brought = rgb(radiance) * dr.rcp(dr.maximum(probability, 1e-30))
        if self._portal is not None:
            light, brought = self._portal.sampled(Array3f(reference.p), light, brought, aim, probability)
        lit = active & (light.pdf > 0)
        if self._bounces is not None:
            lit &= vertex.bounces <= dr.gather(UInt32, self._bounces, emitter_number(light.emitter), lit)
        direction = Array3f(light.d)
        brought *= self._colors(light.emitter, vertex.position, direction, light.dist, vertex.site)
        veiled, distance = self.world.veiled(light.emitter, vertex.position, direction, light.dist)
        alone = light.delta | veiled | _has(self._unmet, light.emitter, lit)
        lit &= dr.isfinite(distance)
        connected = _has(self._connected, light.emitter, lit)
        return EmitterSample(
            lit=lit,
            connected=connected,
            direction=direction,
            distance=distance,
            over=distance,
            radiance=brought,
            pdf=dr.select(alone, 0, light.pdf),
            group=self._grouped.group(light.emitter),
        )

    def _colors(
        self, emitter: EmitterPtr, place: Array3f, direction: Array3f, distance: Float, site: UInt32
    ) -> Array3f:  # fmt: skip
        """Return what images and filters leave of the light on its way from emitters to places at sites."""
        result = Array3f(1)
        for number, each in self._tinted:
            lamp = each.lamp.at(self.world.linking.acting(dr.opaque(UInt32, each.source), site))
            result = dr.select(emitter_number(emitter) == number, lamp.colors(place, direction, distance), result)
        return result

    def connected(
        self, ray: ShadowRay, hit: Any, medium: UInt32, seed: UInt32, active: Bool
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along rays from hits to the next surfaces that are no boundaries, and these."""
        # The rays end, since boundaries move them aside: they go on toward their ends.
        entered = self.world.media.beyond(hit, ray.direction, medium, active)
        return self._through(ray.across(), entered, seed, active, onto=True)

    def passed(self, vertex: Vertex, light: EmitterSample, seed: UInt32, active: Bool) -> Array3f:
        """Return the fraction of the light of a sample that arrives at active vertices."""
        reference = vertex.reference()
        entered = self.world.media.beyond(vertex.hit, light.direction, vertex.medium, active & vertex.smooth)
        medium = dr.select(vertex.scattered, vertex.medium, entered)
        ray = to_point(reference, vertex.position + light.distance * light.direction, self.world.size).ray()
        return self._through(ray, medium, seed, active)[0]

    def _through(
        self, ray: Any, medium: UInt32, seed: UInt32, active: Bool, onto: bool = False
    ) -> tuple[Array3f, Any]:  # fmt: skip
        """Return the transmittance along Mitsuba's rays, and the surfaces at which they end, as `through` does."""
        world, coarse = self.world, self._coarse
        return through(world.plugin, world.media, ray, medium, seed, active, coarse=coarse, size=world.size, onto=onto)

    def met(
        self, ray: ScatteredRay, hit: Any, weight: Array3f, arrives: Bool, active: Bool, seed: UInt32,
        kept: Float | None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance of these emitters where rays meet them, weighted against samples of emitters."""
        active &= arrives
        place, ideal = ray.place, ray.pdf <= 0
        if not self._visible:
            return GroupedLight.dark(len(self.groups), dr.width(place))
        emitter: Any = hit.emitter(self.world.plugin, active)
        numbers = emitter_number(emitter)
        probability = dr.gather(Float, self._table, numbers, active)
        distance = dr.select(hit.is_valid(), dr.norm(Array3f(hit.p) - place), dr.inf)
        veiled, _ = self.world.veiled(emitter, place, ray.direction, distance)
        own = active & (probability > 0) & ~veiled & ~_has(self._unmet, emitter, active)
        if self._bounces is not None:
            own &= ray.bounces <= dr.gather(UInt32, self._bounces, numbers, own)
        own &= ~(ideal & _has(self._sharp, emitter, active))
        reference = interaction(place, Array3f(0))
        light = mi.DirectionSample3f(self.world.plugin, hit, reference)
        pdf = emitter.pdf_direction(reference, light, own) * probability
        if self._portal is not None:
            pdf = self._portal.density(emitter, place, Array3f(light.d), pdf, probability)
        share = dr.select(ideal, 1, power_heuristic(ray.pdf, dr.select(own, pdf, 0)))
        if kept is not None:
            share *= dr.select(_has(self._connected, emitter, own), kept, 1)
        radiance = rgb(emitter.eval(hit, own)) * self._colors(emitter, place, ray.direction, distance, ray.site)
        return self._grouped.of(dr.select(own, weight * radiance * share, 0), emitter)

    # -- what cameras see, and their first surfaces -------------------------------------------------------------------

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> None:
        """Return None: all emitters are surfaces, or infinitely far away."""

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return the emitted radiance of surfaces, and of the environment."""
        emitter = hit.emitter(self.world.plugin, active)
        distance = dr.select(hit.is_valid(), dr.norm(Array3f(hit.p) - origin), dr.inf)
        value = rgb(emitter.eval(hit, active)) * self._colors(emitter, origin, direction, distance, UInt32(0))
        return self._grouped.of(dr.select(active & dr.isfinite(dr.sum(value)), value, 0), emitter)

    def direct(self, point: ShadingPoint, active: Bool) -> GroupedLight:
        """Return the direct light that smooth BSDFs reflect along the path."""
        if not self._size:
            return GroupedLight.dark(len(self.groups), dr.width(point.hit.t))
        samples, order, step = point.samples, point.order, point.step
        vertex = Vertex.of_surfaces(self.world, point.hit, point.medium, active)
        aim = samples.pair(order, Stream.EMITTER, step)
        lamp, aim.x = self.choice(aim.x)
        light = self.sampled(vertex, lamp, aim, active)
        lobe, turn = samples.single(order, Stream.EMITTER_LOBE, step), samples.pair(order, Stream.EMITTER_TURN, step)
        (value, pdf), chosen = vertex.evaluate(light.direction, light.lit), vertex.directed(lobe, turn)
        seed = samples.bits(order, Stream.EMITTER_SHADOW, step)
        result = GroupedLight.of(arriving(self.passed, vertex, light, value, pdf, seed), light.group, len(self.groups))
        if not self._visible:
            return result
        going = active & ~chosen.ideal & (chosen.pdf > 0) & (dr.max(chosen.weight) > 0)
        ray = vertex.ahead(chosen.direction, chosen.pdf, lamp)
        passed, hit = self._through(
            mi.Ray3f(mi.Point3f(ray.origin), mi.Vector3f(ray.direction)), ray.medium, ~seed, going
        )
        return result + self.met(ray, hit, passed * chosen.weight, Bool(True), going, seed, None)


def sampled_first(world: World, others: Collection[int]) -> Chosen:
    """Return all emitters but some `others`, as the first surfaces of camera paths sample them, by Mitsuba's weights.

    The ray along a sample of their BSDFs goes on past surfaces with null lobes, so it meets no emitters there. Its
    noise is seen, so its transmittance is not coarse.
    """
    plugins = world.plugin.emitters()
    shapes = {number: each.get_shape() for number, each in enumerate(plugins) if number not in others}
    passed = [number for number, shape in shapes.items() if shape is not None and passes(shape.bsdf())]
    power = [float(plugins[each].sampling_weight()) for each in shapes]
    return Chosen([*shapes], power, unmet=passed, grouped=True, coarse=False)


def _has(table: UInt32 | None, emitter: EmitterPtr, active: Bool) -> Bool:
    """Return which active emitters are marked in a table by Mitsuba's numbers of them; None: none is."""
    return Bool(False) if table is None else dr.gather(UInt32, table, emitter_number(emitter), active) > 0
