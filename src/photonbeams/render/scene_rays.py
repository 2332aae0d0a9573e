"""The radiance along single rays of a Mitsuba scene, for integrators that have their own film.

All rays are given at once, with the rays of a pixel side by side. They are distributed to as many passes as there are
rays for each pixel, so that each pass has one ray of every pixel, and light paths of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from ..numerics.arrays import indices
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.cameras.sensors import PrimaryRays, Sensor
from ..world.media.interfaces import number
from ..world.media.surroundings import Place, place_of
from .choice import Pixels
from .frame import ViewRays
from .scene_light import ScenePasses, light_of
from .settings import Settings


class RayRadiance(NamedTuple):
    """What rays see: the radiance of beams and of surfaces, (N, 3) each, and 1 if they meet a surface, else 0, (N,)."""

    beams: Any
    surface: Any
    alpha: Any


class SceneRays(ScenePasses):
    """Passes over single rays of a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where the rays begin.
    settings
        How it is rendered; `passes` is the number of passes to which the rays are distributed.
    pixels
        How many rays a pass has.
    warned
        Texts of warnings that have been given already.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered.
    """

    def __init__(self, plugin: Any, eye: Place, settings: Settings, pixels: int, warned: set[str]) -> None:
        super().__init__(settings, settings.depth())
        cameras = [Sensor(each).view for each in plugin.sensors()]
        self.light = light_of(
            plugin, eye, settings, self._tuning, {}, [each for each in cameras if each is not None], Pixels(pixels),
            warned, self.statistics, self._max_depth,
        )  # fmt: skip

    def radiance(self, origin: Array3f, direction: Array3f, far: Float) -> RayRadiance:
        """Return what rays see up to the distances `far`."""
        count = dr.width(direction)
        result = RayRadiance(dr.zeros(Array3f, count), dr.zeros(Array3f, count), dr.zeros(Float, count))
        passes = min(self.settings.passes, count)
        for each in range(passes):
            own = len(range(each, count, passes))
            order = dr.arange(UInt32, own) + dr.opaque(UInt32, 0)
            lanes = order * dr.opaque(UInt32, passes) + dr.opaque(UInt32, each)
            rays = PrimaryRays(
                dr.gather(Array3f, origin, lanes), dr.gather(Array3f, direction, lanes), dr.zeros(Float, own),
                dr.gather(Float, far, lanes), dr.ones(Array3f, own),
            )  # fmt: skip
            dr.eval(rays.origin, rays.direction, rays.far, order)
            light, photons = self._lit(each)
            view, samples = ViewRays(rays, None), self._samples(each)
            picture = self._seen(light, view, order, samples, photons)
            gathered = self._gathered(each, light, view, order, samples)
            beams = sum((*picture.scattered.values(), *gathered.values()), dr.zeros(Array3f, own))
            for whole, part in zip(result, (beams, picture.surface, picture.alpha), strict=True):
                dr.scatter(whole, part, lanes)
            dr.eval(result)
        return result


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
    found = SceneRays(plugin, eye, settings, -(-len(lanes) // settings.passes), warned).radiance(origin, direction, far)
    for whole, part in zip(result, found, strict=True):
        dr.scatter(whole, part, lanes)
    dr.eval(result)
    return result
