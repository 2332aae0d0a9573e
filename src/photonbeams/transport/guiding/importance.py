"""What cameras see of light paths: the importance by which emission is guided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...numerics.arrays import padded, to_float, to_uint, to_vectors
from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...scene import Array
from ...world.media.visibility import through
from ...world.shadow_rays import rounding
from ...world.world import World

if TYPE_CHECKING:
    from ...estimators.projection import Projection
    from ..segments.records import PhotonHits, Segments

mi = mitsuba()

# Number of points on each segment at which it is tested for visibility.
_POINTS = 4
# Light beside the picture counts, within this fraction of its width and height, because beams are wide.
_MARGIN = 0.15
# The picture is divided into columns and rows of parts. A dark part counts as if it had about this fraction of their
# mean light.
_COLUMNS, _ROWS, _DARKEST = 16, 9, 0.1
# Light nearer to the camera than this fraction of the median distance counts as if it were that far away.
_NEAREST = 0.1


@dataclass(frozen=True)
class Sightings:
    """Points of light paths that cameras see, (M,): the path's number, the part of the picture, light and distance.

    `distance` is 0 for orthographic cameras, for which it does not matter. `straight` says whether the light comes
    straight from its emitter.
    """

    path: Array
    part: Array
    light: Array
    distance: Array
    straight: Array

    @classmethod
    def joined(cls, several: Sequence[Sightings]) -> Sightings:
        """Return several sightings as one."""
        names = ("path", "part", "light", "distance", "straight")
        columns = ([getattr(each, name) for each in several] for name in names)
        path, part, light, distance, straight = (
            np.concatenate(each) if each else np.zeros(0, dtype=int) for each in columns
        )
        return cls(path, part, light, distance, straight.astype(bool))

    def of(self, which: Array, first: int) -> Sightings:
        """Return the sightings at `which`, with `first` subtracted from the numbers of paths."""
        part, light, distance = self.part[which], self.light[which], self.distance[which]
        return Sightings(self.path[which] - first, part, light, distance, self.straight[which])

    def later(self, first: int) -> Sightings:
        """Return the same sightings with `first` added to the numbers of paths."""
        return replace(self, path=self.path + first)

    @cached_property
    def in_picture(self) -> Array:
        """The light that arrives in the picture: it falls with the square of the distance, down to a least distance."""
        if not len(self.distance):
            return self.light
        nearest = max(_NEAREST * float(np.median(self.distance)), 1e-12)
        return self.light / np.where(self.distance > 0, np.maximum(self.distance, nearest), 1) ** 2

    def totals(self, count: int) -> Array:
        """Return how much light of each of `count` paths is in the picture, (count,)."""
        return np.bincount(self.path, self.in_picture, minlength=count)

    def importance(self, density: Array) -> Array:
        """Return the importance of paths whose samples have this `density`, (N,).

        Light counts relative to the light of its part of the picture, so a bright part gets no more paths than a dark
        one: noise is visible relative to light. Contributions to different parts add up as variances do.
        """
        if not len(self.path):
            return np.zeros(len(density))
        own = relative(self.in_picture / density[self.path], self.part) * density[self.path]
        return np.sqrt(np.bincount(self.path, own**2, minlength=len(density)))


def relative(light: Array, part: Array) -> Array:
    """Return light, (N,), relative to all the light in its part of the picture."""
    whole = np.bincount(part, light)
    return light / (whole + _DARKEST * whole[whole > 0].mean())[part] if len(light) else light


class Views:
    """Cameras, packed for gathering and `padded`."""

    def __init__(self, views: Sequence[Projection]) -> None:
        views = padded(views)
        self.count = dr.opaque(UInt32, len(views) - 1)
        poses = [each.poses[0] for each in views]
        self._axes = [
            to_vectors([np.ravel(getattr(each, name).numpy()) for each in poses])
            for name in ("right", "up", "forward", "origin")
        ]
        sizes = [(each.width, each.height) for each in views]

        def per_size(name: str) -> list[Float]:
            values = [[float(each.numpy()[0]) for each in getattr(view, name)] for view in views]
            return [to_float(column) for column in (np.array(values) / np.array(sizes)).T]

        self._scale, self._center = per_size("scale"), per_size("center")
        self._orthographic = to_uint([each.orthographic for each in views])

    def __call__(self, number: UInt32) -> ViewOfLane:
        """Return the views with these numbers."""
        axes = [dr.gather(Array3f, each, number) for each in self._axes]
        scale, center = ([dr.gather(Float, each, number) for each in both] for both in (self._scale, self._center))
        right, up, forward, origin = axes
        return ViewOfLane(right, up, forward, origin, scale, center, dr.gather(UInt32, self._orthographic, number) > 0)


@dataclass
class ViewOfLane:
    """A camera for each lane; its picture is the unit square, with the first row on top."""

    right: Any
    up: Any
    forward: Any
    origin: Any
    scale: Any
    center: Any
    orthographic: Any

    def ray(self, place: Array2f) -> tuple[Array3f, Array3f]:
        """Return rays through points of the picture."""
        x = (place.x - self.center[0]) / self.scale[0] * self.right
        across = x + (self.center[1] - place.y) / self.scale[1] * self.up
        origin = self.origin + dr.select(self.orthographic, across, 0)
        return origin, dr.select(self.orthographic, self.forward, dr.normalize(across + self.forward))

    def clipped(self, origin: Array3f, direction: Array3f, length: Float) -> tuple[Float, Float]:
        """Return between which distances segments are in the picture or its margin; the second is less if nowhere."""
        z, dz = dr.dot(origin - self.origin, self.forward), dr.dot(direction, self.forward)
        low, high = Float(0) + 0 * length, Float(length)
        w, dw = dr.select(self.orthographic, 1, z), dr.select(self.orthographic, 0, dz)
        halfspaces = [(z, dz)]
        for axis, scale, center in ((self.right, *self._of(0)), (-self.up, *self._of(1))):
            x, dx = scale * dr.dot(origin - self.origin, axis), scale * dr.dot(direction, axis)
            halfspaces.append((x + (center + _MARGIN) * w, dx + (center + _MARGIN) * dw))
            halfspaces.append(((1 + _MARGIN - center) * w - x, (1 + _MARGIN - center) * dw - dx))
        for value, slope in halfspaces:
            zero = -value / dr.select(slope == 0, 1, slope)
            low = dr.select(slope > 0, dr.maximum(low, zero), low)
            high = dr.select(slope < 0, dr.minimum(high, zero), high)
            high = dr.select((slope == 0) & (value < 0), -1, high)
        return low, high

    def _of(self, k: int) -> tuple[Float, Float]:
        return self.scale[k], self.center[k]

    def part(self, point: Array3f) -> UInt32:
        """Return the numbers of the parts of the picture in which points lie."""
        to = point - self.origin
        depth = dr.select(self.orthographic, 1, dr.maximum(dr.dot(to, self.forward), 1e-30))
        x = self.center[0] + self.scale[0] * dr.dot(to, self.right) / depth
        y = self.center[1] - self.scale[1] * dr.dot(to, self.up) / depth
        return self.part_at(Array2f(x, y))

    def part_at(self, place: Array2f) -> UInt32:
        """Return the numbers of the parts of the picture in which places of the picture lie."""
        column, row = (UInt32(dr.clip(each * n, 0, n - 1)) for each, n in ((place.x, _COLUMNS), (place.y, _ROWS)))
        return row * _COLUMNS + column


class CameraImportance:
    """How much light of paths cameras see; points are divided among the cameras at random."""

    def __init__(self, world: World, views: Sequence[Projection]) -> None:
        self._world, self._media, self._views = world, world.media, Views(views)

    def seen(self, segments: Segments | None, hits: PhotonHits | None) -> Sightings:
        """Return sightings of light that is scattered along segments, and of photons that hit surfaces."""
        found = []
        if segments is not None:
            found.append(self._along(segments))
        if hits is not None:
            found.append(self._at(hits))
        return Sightings.joined(found)

    def _along(self, segments: Segments) -> Sightings:
        """Return sightings of several points on each segment; in empty space, all light counts."""
        lane = dr.arange(UInt32, _POINTS * dr.width(segments.length))
        which, place = lane // _POINTS, lane % _POINTS
        origin, direction, flux = (
            dr.gather(Array3f, each, which) for each in (segments.origin, segments.direction, segments.flux)
        )
        length = dr.gather(Float, segments.length, which)
        medium, number, depth = (
            dr.gather(UInt32, each, which) for each in (segments.medium, segments.number, segments.depth)
        )
        view = self._views(hash32(number, place, UInt32(1)) % self._views.count)
        low, high = view.clipped(origin, direction, length)
        s = low + (Float(place) + unit_float(hash32(number, place, UInt32(2)))) * (1 / _POINTS) * (high - low)
        scattering = self._media.scattering(medium)
        lit = flux * self._media.absorbed(medium, s) * dr.select(scattering > 0, scattering, 1)
        light = dr.max(lit) * (high - low)
        return self._sighted(view, origin + s * direction, medium, number, light, high > low, depth == 0)

    def _at(self, hits: PhotonHits) -> Sightings:
        """Return sightings of photons."""
        view = self._views(hash32(hits.number, UInt32(3)) % self._views.count)
        point = Array3f(hits.position)
        low, high = view.clipped(point, Array3f(hits.direction), Float(0) * point.x)
        medium = dr.zeros(UInt32, dr.width(hits.number))
        dr.make_opaque(medium)
        straight = dr.zeros(Bool, dr.width(hits.number))
        return self._sighted(view, point, medium, hits.number, dr.max(hits.flux), high >= low, straight)

    def _sighted(
        self, view: ViewOfLane, point: Array3f, medium: UInt32, number: UInt32, light: Float, active: Bool,
        straight: Bool,
    ) -> Sightings:  # fmt: skip
        """Return the sightings of points that are active."""
        to = view.origin - point
        away = dr.dot(to, view.forward)
        to = dr.select(view.orthographic, away * view.forward, to)
        distance = dr.maximum(dr.norm(to), 1e-30)
        ray = mi.Ray3f(mi.Point3f(point), mi.Vector3f(to / distance))
        # A ray that begins on a surface must not meet it.
        gap = dr.maximum(1e-4 * distance, rounding(dr.max(dr.abs(point))))
        ray.maxt = distance - gap
        ray.o = ray.o + gap * ray.d
        passed, _ = through(self._world.plugin, self._media, ray, medium, hash32(number), Bool(active))
        light = dr.select(active & (away < 0), light * dr.max(passed), 0)
        part, distance = view.part(point), dr.select(view.orthographic, 0, distance)
        dr.eval(light, part, distance, number, straight)
        index = np.flatnonzero(light.numpy() > 0)
        columns: list[Array] = [np.asarray(each.numpy())[index] for each in (number, part, light, distance, straight)]
        return Sightings(
            columns[0].astype(np.int64), columns[1].astype(np.int64), columns[2].astype(float), *columns[3:]
        )
