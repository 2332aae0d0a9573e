"""Mitsuba's own emitters as lamps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr

from ... import scene
from ...runtime.device import Array2f, Array3f, Float, mitsuba
from ...scene import WHITE
from ..bounds import Bounds
from ..differentials import RayDifferentials, copies, differentiate, of_copies
from ..emission import entry_sphere, sampled_ray
from ..shadow_rays import leaving
from ..spectra import rgb
from .kinds.sphere import SphereLamp
from .lamp import Illumination, Lamp, LightHit
from .rays import EmittedRays

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene

mi = mitsuba()


class MitsubaEmitter(Lamp):
    """A Mitsuba emitter, with ray differentials of its `sample_ray` by forward-mode differentiation.

    `plugin` is the scene that it is in: an emitter alone does not keep its shape alive. None: it is in no scene.
    """

    center: Any

    def __init__(self, emitter: Any, plugin: MiScene | None = None) -> None:
        self.emitter, self._plugin = emitter, plugin
        self.infinite = mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)
        self.met = not mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta)
        self.illuminates = self.met or not mi.has_flag(emitter.flags(), mi.EmitterFlags.Surface)
        self._entry = entry_sphere(plugin) if self.infinite and plugin is not None else None

    @property
    def sharp(self) -> bool:
        """Whether it looks small from a point: a lamp or the sun, not a sky."""
        return not self.infinite or bool(mi.has_flag(self.emitter.flags(), mi.EmitterFlags.Delta))

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths as Mitsuba samples them, with `u` and `v` for position and direction."""
        differentials = self._differentials(u, v, bounds)
        ray, weight = self._ray(mi.Point2f(u), mi.Point2f(v), bounds)
        return EmittedRays.whole(Array3f(ray.o), Array3f(ray.d), rgb(weight), differentials)

    def _ray(self, u: Array2f, v: Array2f, bounds: Bounds) -> Any:
        ray, weight = sampled_ray(self.emitter, u, v, self._entry)
        if self._entry is not None:
            center, radius = self._entry
            scale = bounds.radius / radius
            ray.o = mi.Point3f(bounds.center) + (ray.o - center) * scale
            weight *= dr.square(scale)
        return ray, weight

    def _differentials(self, u: Array2f, v: Array2f, bounds: Bounds) -> RayDifferentials:
        count = dr.width(u)
        lane, which = copies(count)
        inputs = [mi.Point2f(dr.gather(Array2f, each, lane)) for each in (u, v)]
        units = [
            mi.Point2f(dr.select(which == 2 * k, Float(1), 0), dr.select(which == 2 * k + 1, Float(1), 0))
            for k in range(2)
        ]
        with dr.resume_grad():  # the caller may have suspended gradients, as `mi.render` does
            dr.enable_grad(inputs)
            ray, _ = self._ray(inputs[0], inputs[1], bounds)
            shift, turn = differentiate(inputs, [ray.o, ray.d], units)
        shift, turn = (Array3f(each) + dr.zeros(Array3f, 4 * count) for each in (shift, turn))
        dr.eval(shift, turn)
        return of_copies(shift, turn, count)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction, sampled by the emitter; by brightness if it is an environment."""
        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.p = mi.Point3f(point)
        sample, weight = self.emitter.sample_direction(interaction, mi.Point2f(u))
        nowhere = 0 * point.x
        weight = dr.select(sample.pdf > 0, rgb(weight), 0)
        distance = dr.inf if self.infinite else sample.dist
        pdf = dr.select(sample.delta, 0, sample.pdf)
        return Illumination(Array3f(sample.d), distance + nowhere, weight + nowhere, pdf + nowhere)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return the light of an environment along a ray that meets nothing else."""
        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.wi = mi.Vector3f(-direction)
        sample = dr.zeros(mi.DirectionSample3f)
        sample.d = mi.Vector3f(direction)
        radiance = rgb(self.emitter.eval(interaction))
        nowhere = 0 * origin.x
        pdf = self.emitter.pdf_direction(interaction, sample) + nowhere
        return LightHit(nowhere == 0, dr.inf + nowhere, radiance + nowhere, pdf)


class MitsubaSphere(MitsubaEmitter):
    """A sphere that shines outward, whose paths are chosen by direction first.

    Mitsuba chooses a place first, then a direction around its normal: what light paths toward a thing have in common
    is then a curved region of all four numbers of the emission sample, which no guide can describe.
    """

    def __init__(self, emitter: Any, light: scene.SphereLight, plugin: MiScene | None = None) -> None:
        super().__init__(emitter, plugin)
        self._body = SphereLamp.of(replace(light, radiance=WHITE))

    def _ray(self, u: Array2f, v: Array2f, bounds: Bounds) -> Any:
        """Return rays; those along one direction begin uniformly over the silhouette."""
        rays = self._body.emit(Array2f(u), Array2f(v), bounds)
        origin, direction = mi.Point3f(rays.origin), mi.Vector3f(rays.direction)
        with dr.suspend_grad():
            place = self.emitter.get_shape().ray_intersect(mi.Ray3f(origin + self._body.radius * direction, -direction))
            near = mi.Point3f(leaving(place, direction, 2 * self._body.radius))
            off = dr.select(place.is_valid(), near - origin, 0)
            radiance = self.emitter.eval(place)
        return mi.Ray3f(origin + off, direction), radiance * rays.flux.x
