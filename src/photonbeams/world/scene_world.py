"""A Mitsuba scene as a world: its emitters are shapes among the others, its media are where its shapes say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from .media import Media, medium_at, number, parts
from .sources import Source
from .world import World, perturbs, translucent

mi = mitsuba()

# Greatest radius of a scene: the squares and cubes of what is longer are beyond the numbers that there are.
LARGEST = 1e9

_UNSEEN = 0xFFFFFFFF  # stands for a medium that is not known


class SceneWorld(World):
    """What rays meet in a Mitsuba scene.

    Parameters
    ----------
    plugin, sensor
        The scene, and the sensor that looks at it.
    sources
        What the beams of its emitters have in common; several emitters may share one.

    Raises
    ------
    SceneError
        A medium that cannot be rendered, a scene that is too large.
    """

    cutouts = narrows = False

    def __init__(self, plugin: Any, sensor: Any, sources: Sequence[Source] = (Source(),)) -> None:
        self.plugin, self.sources = plugin, tuple(sources)
        self.media = Media.of(plugin)
        self.everywhere = _everywhere(plugin, sensor)
        self.filling = dr.opaque(UInt32, number(self.everywhere))
        self.radius = _radius(plugin)
        self.perturbed, self.translucent = perturbs(plugin), translucent(plugin)
        self.reach = scene.ESCAPE * self.radius
        self._escape = dr.opaque(Float, self.reach)

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return how far light goes that meets nothing."""
        return self._escape + 0 * origin.x

    def medium_of_emission(self, origin: Array3f, direction: Array3f, source: UInt32, active: Bool) -> UInt32:
        """Return the numbers of the media in which light paths begin."""
        return medium_at(self.plugin, origin, direction, self.filling, active)

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin.

        Of rays that have seen no boundary: what fills the space; if nothing does, where most of the others are, for a
        ray may miss a boundary on which another surface lies.
        """
        found = medium_at(self.plugin, origin, direction, UInt32(_UNSEEN), Bool(True))
        unseen = found == _UNSEEN
        if not bool(dr.any(unseen)):
            return found
        known, counts = np.unique(dr.select(unseen, 0, found).numpy()[~unseen.numpy()], return_counts=True)
        usual = int(known[counts.argmax()]) if len(counts) else 0
        return dr.select(unseen, dr.select(self.filling > 0, self.filling, dr.opaque(UInt32, usual)), found)

    def seen(self, origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32) -> Any:
        """Return the first surface, or boundary of a medium, that camera rays meet within `reach`."""
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = reach
        return self.plugin.ray_intersect(ray, active)


def _radius(plugin: Any) -> float:
    """Return the radius of a scene, 1 of one that is a point or nothing."""
    box = plugin.bbox()
    if not box.valid():
        return 1.0
    low, high = (np.ravel(np.asarray(each, dtype=float)) for each in (box.min, box.max))
    size = float(np.linalg.norm(high - low) / 2)
    if not size <= LARGEST:
        raise scene.SceneError(f"the scene has a radius of {size:g} units: expected {LARGEST:g} at most")
    return size or 1.0


def _everywhere(plugin: Any, sensor: Any) -> Any:
    """Return the medium that fills the whole space: what sensor or emitters name, and no shape has inside."""
    bounded = {number(each.interior_medium()) for each in parts(plugin, mi.Shape)}
    named = [each.get_medium() for each in (sensor, *plugin.emitters())]
    return next((each for each in named if each is not None and number(each) not in bounded), None)
