"""The world of a Mitsuba scene, whose emitters may be shapes, and whose shapes bound its media."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from .bounds import Bounds, box_around
from .media import Media
from .scene_lamps import lamps_of
from .shapes import is_null, scene_of
from .sources import Source
from .surroundings import Place, Surroundings, places_of
from .world import World, mirrors, perturbs, translucent

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
    beams
        The settings of each emitter, in the scene's order; () stands for the defaults.

    Raises
    ------
    SceneError
        A medium cannot be rendered, the scene is too large, or an emitter cannot have its gobo or its portal.
    """

    cutouts = narrows = False

    def __init__(
        self, plugin: Any, eye: Place | None, sources: Sequence[Source] = (Source(),),
        beams: Sequence[scene.BeamSettings] = (),
    ) -> None:  # fmt: skip
        self.plugin, self.host, self.sources = plugin, plugin, tuple(sources)
        self.media = Media.of(plugin)
        center, self.radius = _sphere(plugin)
        self.bounds = Bounds(center, self.radius)
        self.beams = beams or [scene.BeamSettings()] * len(plugin.emitters())
        self.lamps = lamps_of(plugin, self.beams, self.bounds)
        self.perturbed, self.translucent = perturbs(plugin), translucent(plugin)
        self.mirrors = mirrors(plugin)
        self.reach = scene.ESCAPE * self.radius
        self.surroundings = Surroundings(plugin, self.media, places_of(plugin), eye)
        self.sizes, self.boxes = self.surroundings.sizes, {}
        self._escape = dr.opaque(Float, self.reach)

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the lengths of light paths that meet nothing."""
        return self._escape + 0 * origin.x

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin."""
        return self.surroundings.of_sensor(origin, direction)

    def colors(self, emitter: Any, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return the colours of the images that light passes on its way from emitters (pointers) to points."""
        result = Array3f(1)
        for plugin, lamp in zip(self.plugin.emitters(), self.lamps, strict=True):
            if lamp is not None:
                number: Any = dr.reinterpret_array(UInt32, mi.EmitterPtr(plugin))
                own = dr.reinterpret_array(UInt32, emitter) == dr.opaque(UInt32, int(number[0]))
                result = dr.select(own, lamp.colors(point, direction, distance), result)
        return result

    def without_surfaces(self) -> SceneWorld:
        """Return the world with its media alone."""
        result = copy(self)
        result.plugin = self._boundary_scene
        return result

    @cached_property
    def _boundary_scene(self) -> Any:
        boundaries = [each for each in self.plugin.shapes() if each.is_medium_transition() and is_null(each)]
        return scene_of(boundaries, self.plugin)

    def seen(self, origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32) -> Any:
        """Return the first surface, or boundary of a medium, that camera rays meet within `reach`."""
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = reach
        return self.plugin.ray_intersect(ray, active)


def _sphere(plugin: Any) -> tuple[np.ndarray, float]:
    """Return centre and radius of a scene; the radius is 1 if the scene is empty, or a point."""
    box = box_around(plugin)
    if not box.valid():
        return np.zeros(3), 1.0
    low, high = (np.ravel(np.asarray(each, dtype=float)) for each in (box.min, box.max))
    size = float(np.linalg.norm(high - low) / 2)
    if not size <= LARGEST:
        raise scene.SceneError(f"the scene has a radius of {size:g} units: expected {LARGEST:g} at most")
    return (low + high) / 2, size or 1.0
