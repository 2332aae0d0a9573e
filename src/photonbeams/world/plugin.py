"""The world of a Mitsuba scene, whose emitters may be shapes, and whose shapes bound its media."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .. import scene
from ..scene import Array
from .bounds import Bounds, box_around, endless_length
from .checks import wrong_mesh
from .emitters.mitsuba_scene import emitters_of
from .emitters.sources import Source
from .media.discovery.surroundings import Place, Surroundings, places_of
from .media.media import Media
from .surfaces.shapes import is_null, scene_of
from .world import World, mirrors, passes, perturbs, translucent

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiScene, MiShape

# Greatest radius of a scene: squares and cubes of longer distances overflow float32.
LARGEST = 1e9


def world_of_plugin(
    plugin: MiScene, eye: Place | None = None, sources: Sequence[Source] = (Source(),),
    beams: Sequence[scene.BeamSettings] = (), numbers: Sequence[int] = (), short: bool = False,
) -> World:  # fmt: skip
    """Build the world of a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin (see `surroundings.place_of_sensor`); None: no camera.
    sources
        What the beams of its emitters have in common; several emitters may share one.
    beams, numbers
        The settings of each emitter, in the scene's order, and the number of its source; () stands for the defaults.
    short
        Whether beams end where their light is scattered.

    Raises
    ------
    SceneError
        A medium cannot be rendered, the scene is too large, or an emitter cannot have its gobo or its portal.
    """
    for shape in plugin.shapes():
        if problem := shape.is_mesh() and wrong_mesh(shape):
            raise scene.SceneError(f"shape {shape.id()}: {problem}: expected faces of its own finite vertices")
    media = Media.of(plugin)
    places = places_of(plugin)
    finite = [each for each in [*places, *([] if eye is None else [eye])] if not each.infinite]
    ends = np.concatenate([np.zeros((0, 3)), *(each.origin for each in finite)])
    center, radius = _sphere(plugin, ends)
    bounds = Bounds(center, radius)
    own = emitters_of(plugin, beams or [scene.BeamSettings()] * len(plugin.emitters()), bounds)
    emitters = [each._replace(source=source) for each, source in zip(own, numbers or [0] * len(own), strict=True)]
    surroundings = Surroundings(plugin, media, places, eye)
    open_ = [each for each in media.all if each.number not in surroundings.boxes and each.tracked is None]
    extent = max(radius, bounds.farthest(ends) if open_ else 0.0)
    if short:
        media.all = tuple(each.for_short_beams() for each in media.all)
    boundaries = [each for each in plugin.shapes() if each.is_medium_transition() and is_null(each)]
    return World(
        plugin=plugin,
        surfaces=plugin,
        around=scene_of(boundaries, plugin),
        host=plugin,
        media=media,
        emitters=emitters,
        sources=tuple(sources),
        bounds=bounds,
        radius=radius,
        extent=extent,
        endless=endless_length(extent, open_),
        surroundings=surroundings,
        emits=True,
        nested=True,
        fog_beyond=bool(open_) and (extent > radius or not plugin.shapes()),
        reach_from_infinity=scene.ESCAPE * extent / radius,
        perturbed=perturbs(plugin),
        translucent=translucent(plugin),
        mirrors=mirrors(plugin),
        boundaries=[each for each in plugin.shapes() if _goes_on(each)],
        boxes=surroundings.boxes,
    )


def _goes_on(shape: MiShape) -> bool:
    """Return whether camera paths may go straight on at a shape; an instance does not tell what is in it."""
    return shape.class_name() == "Instance" or shape.is_medium_transition() or passes(shape.bsdf())


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
