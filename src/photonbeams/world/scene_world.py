"""The world of a Mitsuba scene, whose emitters may be shapes, and whose shapes bound its media."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from .. import scene
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..scene import Array
from .bounds import Bounds, box_around, endless_length
from .emitters.mitsuba_scene import emitters_of
from .emitters.rays import EmittedRays
from .emitters.sources import Source
from .media.discovery.surroundings import Place, Surroundings, places_of
from .media.media import Media
from .shadow_rays import gap_at
from .surfaces.shapes import is_null, scene_of
from .world import World, mirrors, perturbs, translucent

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import EmitterPtr, MiScene, SurfaceInteraction

mi = mitsuba()

# Greatest radius of a scene: squares and cubes of longer distances overflow float32.
LARGEST = 1e9


class SceneWorld(World):
    """What rays meet in a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin (see `surroundings.place_of_sensor`); None: no camera.
    sources
        What the beams of its emitters have in common; several emitters may share one.
    beams, numbers
        The settings of each emitter, in the scene's order, and the number of its source; () stands for the defaults.

    Raises
    ------
    SceneError
        A medium cannot be rendered, the scene is too large, or an emitter cannot have its gobo or its portal.
    """

    cutouts = narrows = glowing = False
    emits = True
    boundaries = ()

    def __init__(
        self, plugin: MiScene, eye: Place | None, sources: Sequence[Source] = (Source(),),
        beams: Sequence[scene.BeamSettings] = (), numbers: Sequence[int] = (),
    ) -> None:  # fmt: skip
        self.plugin = self.surfaces = self.host = plugin
        self.sources = tuple(sources)
        self.media = Media.of(plugin)
        places = places_of(plugin)
        finite = [each for each in [*places, *([] if eye is None else [eye])] if not each.infinite]
        ends = np.concatenate([np.zeros((0, 3)), *(each.origin for each in finite)])
        center, self.radius = _sphere(plugin, ends)
        self.bounds = Bounds(center, self.radius)
        settings = beams or [scene.BeamSettings()] * len(plugin.emitters())
        self.emitters = emitters_of(plugin, settings, self.bounds)
        own = numbers or [0] * len(self.emitters)
        self.emitters = [each._replace(source=source) for each, source in zip(self.emitters, own, strict=True)]
        self.perturbed, self.translucent = perturbs(plugin), translucent(plugin)
        self.mirrors = mirrors(plugin)
        self.surroundings = Surroundings(plugin, self.media, places, eye)
        self.sizes, self.boxes, self.reentrant = self.surroundings.sizes, {}, ()
        open_ = [each for each in self.media.all if each.number not in self.sizes and each.tracked is None]
        self.extent = max(self.radius, self.bounds.farthest(ends) if open_ else 0.0)
        self.endless = endless_length(self.extent, open_)
        self._fog_beyond = bool(open_) and (self.extent > self.radius or not plugin.shapes())
        self._escape = dr.opaque(Float, scene.ESCAPE * self.extent)

    def short_of_fog(self, emitters: Iterable[int]) -> list[int]:
        """Return those emitters at infinity whose beams, which begin around the shapes, do not reach all endless fog.

        This is so if a camera or a lamp is in endless fog and outside of the sphere around the shapes.
        """
        infinite = [mi.has_flag(each.flags(), mi.EmitterFlags.Infinite) for each in self.plugin.emitters()]
        return [each for each in emitters if infinite[each] and self._fog_beyond]

    def entered(self, number: int, rays: EmittedRays, bounds: Bounds, through: bool) -> EmittedRays:
        """Return rays of an emitter as they begin in the world; see `World.entered`."""
        if through:  # they begin off the emitter, beyond rounding errors
            step = gap_at(rays.origin, self.size)
            rays.origin, rays.flux = rays.origin + step * rays.direction, dr.select(rays.valid, rays.flux, 0)
            rays.portal = rays.portal - step
        rays.reach = self._escape
        rays.medium = self.surroundings.of_emitter(number, rays.origin, rays.direction)
        return rays

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the lengths of light paths that meet nothing."""
        return self._escape + 0 * origin.x

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin."""
        return self.surroundings.of_sensor(origin, direction)

    def colors(self, emitter: EmitterPtr, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return the colours of the images that light passes on its way from emitters (pointers) to points."""
        result = Array3f(1)
        for plugin, each in zip(self.plugin.emitters(), self.emitters, strict=True):
            if each.lamp.images:
                number: Any = dr.reinterpret_array(UInt32, mi.EmitterPtr(plugin))
                own = dr.reinterpret_array(UInt32, emitter) == dr.opaque(UInt32, int(number[0]))
                result = dr.select(own, each.lamp.colors(point, direction, distance), result)
        return result

    def without_surfaces(self) -> SceneWorld:
        """Return the world with its media alone."""
        result = copy(self)
        result.plugin = self._boundary_scene
        return result

    @cached_property
    def _boundary_scene(self) -> MiScene:
        boundaries = [each for each in self.plugin.shapes() if each.is_medium_transition() and is_null(each)]
        return scene_of(boundaries, self.plugin)

    def seen(self, origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that camera rays meet within `reach`."""
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = reach
        return self.plugin.ray_intersect(ray, active)


def _sphere(plugin: MiScene, ends: Array) -> tuple[np.ndarray, float]:
    """Return centre and radius of the shapes or, without any, of where light paths and camera paths begin, (N, 3).

    The radius is 1 if the scene is empty, or a point.
    """
    box = box_around(plugin)
    if not box.valid() and not len(ends):
        return np.zeros(3), 1.0
    low, high = ends.min(axis=0, initial=np.inf), ends.max(axis=0, initial=-np.inf)
    if box.valid():
        low, high = (np.ravel(np.asarray(each, dtype=float)) for each in (box.min, box.max))
    size = float(np.linalg.norm(high - low) / 2)
    if not size <= LARGEST:
        raise scene.SceneError(f"the scene has a radius of {size:g} units: expected {LARGEST:g} at most")
    return (low + high) / 2, size or 1.0
