"""The radiance along single rays of a Mitsuba scene, for integrators that have their own film.

All rays are given at once, with the rays of a pixel side by side. They are distributed to as many passes as there are
rays for each pixel, so that each pass has one ray of every pixel, and light paths of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from ..numerics.arrays import indices
from ..runtime.device import Array3f, Bool, Float, UInt32, uncollected
from ..world.cameras.sensors import PrimaryRays, Sensor
from ..world.media.discovery.surroundings import place_of
from ..world.media.interfaces import number
from .passes import Statistics
from .ray_passes import PassRenderer, ViewRays
from .scene_light import light_of
from .settings import Settings


class RayRadiance(NamedTuple):
    """What rays see: the radiance of beams and of surfaces, (N, 3) each, and 1 if they meet a surface, else 0, (N,)."""

    beams: Any
    surface: Any
    alpha: Any


def _radiance(passes: PassRenderer, origin: Array3f, direction: Array3f, far: Float) -> RayRadiance:
    """Return what rays see up to the distances `far`."""
    count = dr.width(direction)
    result = RayRadiance(dr.zeros(Array3f, count), dr.zeros(Array3f, count), dr.zeros(Float, count))
    number = min(passes.settings.passes, count)
    for each in range(number):
        own = len(range(each, count, number))
        order = dr.arange(UInt32, own) + dr.opaque(UInt32, 0)
        lanes = order * dr.opaque(UInt32, number) + dr.opaque(UInt32, each)
        rays = PrimaryRays(
            dr.gather(Array3f, origin, lanes), dr.gather(Array3f, direction, lanes), dr.zeros(Float, own),
            dr.gather(Float, far, lanes), dr.ones(Array3f, own),
        )  # fmt: skip
        dr.eval(rays.origin, rays.direction, rays.far, order)
        light, photons = passes.lit(each)
        view, samples = ViewRays(rays, None), passes.samples(each)
        picture = passes.seen(light, view, order, samples, photons)
        gathered = passes.gathered(each, light, view, order, samples)
        beams = sum((*picture.scattered.values(), *gathered.values()), dr.zeros(Array3f, own))
        surface = sum(picture.surface.values(), dr.zeros(Array3f, own))
        for whole, part in zip(result, (beams, surface, picture.alpha), strict=True):
            dr.scatter(whole, part, lanes)
        dr.eval(result)
    return result


@uncollected()
def radiance(plugin: Any, ray: Any, active: Any, settings: Settings, warned: set[str]) -> RayRadiance:
    """Return what Mitsuba's rays see in a scene; those that are not `active` see nothing."""
    count = max(dr.width(each) for each in (ray.o, ray.d, active))
    origin, direction = (Array3f(each) + dr.zeros(Array3f, count) for each in (ray.o, ray.d))
    far = dr.minimum(Float(ray.maxt), dr.largest(Float)) + dr.zeros(Float, count)
    going = Bool(active) & dr.full(Bool, True, count)
    dr.eval(origin, direction, far, going)
    result = RayRadiance(dr.zeros(Array3f, count), dr.zeros(Array3f, count), dr.zeros(Float, count))
    lanes = indices(going)
    if not len(lanes):
        return result
    origin, direction = dr.gather(Array3f, origin, lanes), dr.gather(Array3f, direction, lanes)
    far = dr.gather(Float, far, lanes)
    # Mitsuba does not pass the medium to integrators within others: it is that of the sensors, if all name the same.
    named = {number(each.get_medium()): each.get_medium() for each in plugin.sensors()}
    eye = place_of("sensor", origin, direction, next(iter(named.values())) if len(named) == 1 else None)
    cameras = [view for each in plugin.sensors() if (view := Sensor(each).view) is not None]
    statistics = Statistics()
    light = light_of(plugin, eye, settings, {}, cameras, warned, statistics)
    found = _radiance(PassRenderer(settings, light, settings.depth(), statistics), origin, direction, far)
    for whole, part in zip(result, found, strict=True):
        dr.scatter(whole, part, lanes)
    dr.eval(result)
    return result
