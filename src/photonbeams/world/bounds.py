"""The sphere around a scene, which light from infinity enters, and boxes around Mitsuba's shapes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from .. import scene
from ..numerics.arrays import opaque
from ..runtime.device import Array3f, Bool, Float, mitsuba
from ..scene.places import origin_near

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import BoundingBox, MiScene, MiShape
    from .media.rendered import RenderedMedium

mi = mitsuba()


#: A box: two corners, (3,) each.
Box = tuple[np.ndarray, np.ndarray]

# Light in endless media no longer matters at this optical depth, because it has to come back, too. Where media are so
# thin that it goes on for longer, it ends at this many radii: of the light that a camera sees of a point lamp, at most
# 2 / _FARTHEST comes from beyond.
_DEEPEST, _FARTHEST = 3.0, 1024.0


def endless_length(extent: float, media: Sequence[RenderedMedium]) -> float:
    """Return the length at which light in endless media no longer matters; 0 if that is not beyond `scene.ESCAPE`.

    Parameters
    ----------
    extent
        Radius of a region with all finite lamps and cameras.
    media
        The endless media. Media that scatter no light are left out.
    """
    extinctions = [min(each.medium.extinction) for each in media if max(each.medium.scattering) > 0]
    if not extinctions:
        return 0.0
    length = min(_FARTHEST * extent, _DEEPEST / max(min(extinctions), 1e-30))
    return length if length > scene.ESCAPE * extent else 0.0


class Bounds:
    """The world's bounding sphere, which light from infinity enters; `center` and `radius` are opaque."""

    def __init__(self, center: npt.ArrayLike, radius: float) -> None:
        self.center = opaque(center)
        self.radius = opaque(radius)

    def contains(self, points: np.ndarray) -> bool:
        """Return whether all `points`, (N, 3), are inside, up to rounding."""
        center, radius = np.ravel(self.center.numpy()), float(self.radius.numpy()[0])
        return bool(np.all(np.linalg.norm(np.asarray(points) - center, axis=1) <= radius * (1 + 1e-4)))

    def around(self, boxes: Iterable[tuple[Box, float]], radius: float) -> Bounds:
        """Return a sphere that contains boxes, each with a margin, at least this one.

        A margin is `radius` times the sphere's own radius, at most the number that stands with the box.
        """
        center, result = np.ravel(self.center.numpy()), float(self.radius.numpy()[0])
        for (low, high), most in boxes:
            farthest = float(np.linalg.norm(np.maximum(high - center, center - low)))
            result = max(result, min(farthest / max(1 - radius, 0.4), farthest + most))
        return Bounds(center, result)

    def farthest(self, points: np.ndarray) -> float:
        """Return the distance of the farthest of `points`, (N, 3), from the centre; 0 if all are inside."""
        distances = np.linalg.norm(np.asarray(points) - np.ravel(self.center.numpy()), axis=1)
        return 0.0 if self.contains(points) else float(distances.max())

    def holds(self, point: Array3f) -> Bool:
        """Return which points are in the sphere."""
        return dr.squared_norm(point - self.center) <= dr.square(self.radius)

    def behind(self, point: Array3f, direction: Array3f) -> Float:
        """Return the distance from a point, back along `direction`, to the plane that touches the sphere."""
        return dr.dot(point - self.center, direction) + self.radius

    def beyond(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the distance along rays to the point nearest to the sphere's center, at least half of its radius."""
        return dr.maximum(dr.dot(self.center - origin, direction), 0.5 * self.radius)

    def exit(self, origin: Array3f, direction: Array3f, scale: Float | float = 1.0) -> Float:
        """Return the distance at which a ray leaves the sphere scaled by `scale`, at least the radius itself."""
        to = self.center - origin
        along = dr.dot(to, direction)
        radius = scale * self.radius
        room = radius * radius - dr.squared_norm(to - along * direction)
        return dr.maximum(along + dr.safe_sqrt(room), self.radius)


def box_of(shape: MiShape) -> BoundingBox:
    """Return the box around one of Mitsuba's shapes; also around a merged mesh, for which Mitsuba has none."""
    box = shape.bbox()
    if not box.valid() and isinstance(shape, mi.Mesh) and shape.vertex_count():
        points = np.asarray(mi.traverse(shape)["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        box = mi.ScalarBoundingBox3f(points.min(axis=0), points.max(axis=0))
    return box


def box_around(plugin: MiScene) -> BoundingBox:
    """Return the box around all shapes of a Mitsuba scene; Mitsuba's own box lacks merged meshes."""
    box = mi.ScalarBoundingBox3f()
    for each in plugin.shapes():
        box.expand(box_of(each))
    return box


def bounding_sphere(states: Sequence[scene.Scene], viewpoints: Sequence[npt.ArrayLike]) -> tuple[np.ndarray, float]:
    """Return centre and radius of a sphere around all states of a scene, and the viewpoints."""
    points = _points(states, viewpoints)
    if not len(points):
        return np.zeros(3), 1.0
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = 1.001 * float(np.linalg.norm(points - center, axis=1).max())
    return center, radius or 1.0


def box_of_states(states: Sequence[scene.Scene]) -> Box | None:
    """Return the box around all states of a scene; None if nothing in it has a place."""
    points = _points(states)
    return (points.min(axis=0), points.max(axis=0)) if len(points) else None


def _points(states: Sequence[scene.Scene], viewpoints: Sequence[npt.ArrayLike] = ()) -> np.ndarray:
    """Return points (N, 3) whose box is around all states of a scene, and the viewpoints."""
    clouds = [cloud for state in states for cloud in _clouds(state)] + [np.asarray(point) for point in viewpoints]
    return np.concatenate([np.asarray(cloud, dtype=np.float64).reshape(-1, 3) for cloud in [*clouds, np.empty(0)]])


def origin_of(states: Sequence[scene.Scene], viewpoints: Sequence[npt.ArrayLike]) -> np.ndarray:
    """Return the point from which a shot is measured, (3,), near the middle of its viewpoints: see `scene.places`.

    Its size is about how far from the nearest viewpoint things are, the median: huge grounds, and things that somebody
    left far away, do not count.
    """
    eyes = np.array([np.zeros(3)] if not len(viewpoints) else viewpoints, dtype=np.float64)
    sizes: list[float] = []
    for clouds_of in (_solids, _lamps):
        clouds = [cloud for state in states for cloud in clouds_of(state) if len(cloud)]
        boxes = [(cloud.min(axis=0), cloud.max(axis=0)) for cloud in map(np.asarray, clouds)]
        farthest = [np.linalg.norm(np.maximum(high - eyes, eyes - low), axis=1).min() for low, high in boxes]
        sizes = sizes or sorted(map(float, farthest))
    size = sizes[(len(sizes) - 1) // 2] if sizes else 1.0
    return origin_near(0.5 * (eyes.min(axis=0) + eyes.max(axis=0)), size or 1.0)


def _clouds(description: scene.Scene) -> list[np.ndarray]:
    """Return points around surfaces, finite lights, portals, fog and drawn beams."""
    return _solids(description) + _lamps(description)


def _solids(description: scene.Scene) -> list[np.ndarray]:
    """Return points around surfaces, fog and drawn beams."""
    clouds: list[Any] = [mesh.points for mesh in description.meshes]
    clouds += [boundary.points for each in description.media if (boundary := each.boundary) is not None]
    return clouds + [np.concatenate([drawn.start, drawn.end]) for drawn in description.drawn]


def _lamps(description: scene.Scene) -> list[np.ndarray]:
    """Return points around finite lights and portals."""
    portals = [light.portal.points for light in description.lights if light.portal is not None]
    return [light.points for light in description.lights] + portals
