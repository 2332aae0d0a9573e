"""Mitsuba's emitters, as camera paths see them and as they light surfaces through boundaries of media.

Direct light takes one sample of an emitter and one of the BSDF, combined by multiple importance sampling (power
heuristic, Veach 1997), as in Mitsuba's `volpath`. Light that is scattered or refracted on its way comes from photons.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.arrays import to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.sampling import power_heuristic
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.groups import GroupedEmitters
from ...world.emitters.mitsuba_scene import by_emitter, emitter_number
from ...world.emitters.portal_lamps import EnvironmentPortal
from ...world.media.visibility import through
from ...world.shadow_rays import leaving, to_point
from ...world.spectra import rgb
from ...world.world import World
from .branches import IDEAL
from .camera_paths import ShadingPoint

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import EmitterPtr

mi = mitsuba()


class MitsubaLighting:
    """The emitters of a Mitsuba scene; `portal` is the portal before its environment, or None.

    Those with numbers `unsampled` do not light surfaces.
    """

    def __init__(self, world: World, portal: EnvironmentPortal | None = None, unsampled: Collection[int] = ()) -> None:
        self._world, self._portal = world, portal
        emitters = world.plugin.emitters()
        self._unsampled = to_uint(by_emitter(world.plugin, [*unsampled], 1)) if unsampled else None
        self._visible = any(not mi.has_flag(each.flags(), mi.EmitterFlags.Delta) for each in emitters)
        shapes = [each.get_shape() for each in emitters]
        passed = [shape is not None and mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.Null) for shape in shapes]
        # Samples of BSDFs go on past surfaces with null lobes, so that emitters there are met by samples of them alone.
        self._passed = to_uint(by_emitter(world.plugin, range(len(emitters)), passed)) if any(passed) else None
        self._groups = GroupedEmitters(world, world.groups)

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return the emitted radiance of surfaces, and of the environment."""
        emitter = hit.emitter(self._world.plugin, active)
        distance = dr.select(hit.is_valid(), dr.norm(Array3f(hit.p) - origin), dr.inf)
        value = rgb(emitter.eval(hit, active)) * _colors(self._world, emitter, origin, direction, distance, UInt32(0))
        return self._groups.of(dr.select(active & dr.isfinite(dr.sum(value)), value, 0), emitter)

    def direct(self, point: ShadingPoint, active: Bool) -> GroupedLight:
        """Return the direct light that smooth BSDFs reflect along the path."""
        plugin, media, hit, samples = self._world.plugin, self._world.media, point.hit, point.samples
        order, step = point.order, point.step
        bsdf, site = hit.bsdf(), self._world.linking.of_surfaces(hit)
        # Sample all lobes: with a mask, Mitsuba's cut-out surfaces sample only the light that passes them.
        context = mi.BSDFContext()
        aim = samples.pair(order, Stream.EMITTER, step)
        light, radiance = plugin.sample_emitter_direction(hit, mi.Point2f(aim), False, active)
        radiance = rgb(radiance)
        if self._portal is not None:
            aim = samples.pair(order, Stream.EMITTER_PORTAL, step)
            light, radiance = self._portal.sampled(Array3f(hit.p), light, radiance, aim, self._portal.chosen)
        lit = self._lights(light.emitter, active & (light.pdf > 0))
        value, pdf = bsdf.eval_pdf(context, hit, hit.to_local(light.d), lit)
        place, toward = Array3f(hit.p), Array3f(light.d)
        veiled, distance = self._world.veiled(light.emitter, place, toward, light.dist)
        lit, alone = lit & dr.isfinite(distance), light.delta | veiled
        if self._passed is not None:
            alone |= dr.gather(UInt32, self._passed, emitter_number(light.emitter), lit) > 0
        weight = dr.select(alone, 1, power_heuristic(light.pdf, pdf))
        colors = _colors(self._world, light.emitter, place, toward, light.dist, site)
        value = rgb(value) * radiance * colors * weight
        lit &= dr.max(value) > 0
        end = dr.select(veiled, place + distance * toward, Array3f(light.p))
        ray = to_point(hit, end, self._world.size).ray()
        seed = samples.bits(order, Stream.EMITTER_SHADOW, step)
        passed, _ = through(
            plugin, media, ray, media.beyond(hit, light.d, point.medium, lit), seed, lit, size=self._world.size
        )
        result = self._groups.of(dr.select(lit, value * passed, 0), light.emitter)
        if not self._visible:
            return result

        lobe, turn = samples.single(order, Stream.EMITTER_LOBE, step), samples.pair(order, Stream.EMITTER_TURN, step)
        sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(turn), active)
        smooth = (UInt32(sample.sampled_type) & IDEAL) == 0
        reflected = active & smooth & (sample.pdf > 0) & (dr.max(rgb(weight)) > 0)
        direction = hit.to_world(sample.wo)
        start = media.beyond(hit, direction, point.medium, reflected)
        ray = mi.Ray3f(mi.Point3f(leaving(hit, direction, self._world.size)), direction)
        passed, met = through(plugin, media, ray, start, ~seed, reflected, size=self._world.size)
        emitter = met.emitter(plugin, reflected)
        reflected = self._lights(emitter, reflected)
        seen = mi.DirectionSample3f(plugin, met, hit)
        other = plugin.pdf_emitter_direction(hit, seen, reflected & (emitter != None))  # noqa: E711 - of arrays
        if self._portal is not None:
            other = self._portal.density(emitter, Array3f(hit.p), Array3f(direction), other, self._portal.chosen)
        value = rgb(weight) * rgb(emitter.eval(met, reflected)) * passed * power_heuristic(sample.pdf, other)
        distance = dr.select(met.is_valid(), dr.norm(met.p - hit.p), dr.inf)
        colors = _colors(self._world, emitter, place, Array3f(direction), distance, site)
        reflected &= ~self._world.veiled(emitter, place, Array3f(direction), distance)[0]
        return result + self._groups.of(dr.select(reflected, value * colors, 0), emitter)

    def _lights(self, emitter: EmitterPtr, active: Bool) -> Bool:
        """Return where emitters light active points by samples."""
        if self._unsampled is None:
            return active
        return active & (dr.gather(UInt32, self._unsampled, emitter_number(emitter), active) == 0)


def _colors(
    world: World, emitter: EmitterPtr, point: Array3f, direction: Array3f, distance: Float, site: UInt32
) -> Array3f:  # fmt: skip
    """Return what images and filters leave of the light on its way from emitters to points at sites."""
    result = Array3f(1)
    for plugin, each in zip(world.plugin.emitters(), world.emitters, strict=True):
        if each.lamp.images or each.lamp.filters is not None:
            own = emitter_number(emitter) == dr.opaque(UInt32, int(emitter_number(mi.EmitterPtr(plugin))[0]))
            lamp = each.lamp.at(world.linking.acting(dr.opaque(UInt32, each.source), site))
            result = dr.select(own, lamp.colors(point, direction, distance), result)
    return result
