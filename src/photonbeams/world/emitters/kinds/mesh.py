"""Mesh lights: surfaces that emit light from their outer side, or from both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Bool, Float, mitsuba
from ...bounds import Bounds
from ...shadow_rays import leaving, rounding, size_of
from ...surfaces.shapes import radiance_of, scene_of, shape_of
from ...warp import power_cone
from ..lamp import Illumination, Lamp, LightHit, unit
from ..rays import EmittedRays
from ..shaping import ShapingFactor

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiScene, PositionSample, SurfaceInteraction

mi = mitsuba()


class MeshLamp(Lamp):
    """A mesh that radiates from its outer side or both, sampled uniformly in area by Mitsuba.

    Kernels treat each mesh light by itself: it is not packed with others. `around` are the Mitsuba scenes in which it
    shines.
    """

    record = scene.MeshLight

    @classmethod
    def of(cls, light: scene.MeshLight, host: MiScene | None = None, around: Sequence[MiScene] = ()) -> MeshLamp:
        """Return the light's lamp; `host` is explained in `scene_of`."""
        return cls(light, host, around)

    def __init__(self, light: scene.MeshLight, host: MiScene | None = None, around: Sequence[MiScene] = ()) -> None:
        assert light.mesh is not None
        emitter = mi.load_dict({"type": "area", "radiance": radiance_of(light.radiance, light.image)})
        # Without normals: faces radiate evenly, whatever normals they are shaded with.
        self._shape: Any = shape_of(replace(light.mesh, normals=None), emitter=emitter)
        self._emitter = emitter
        self._scene = scene_of([self._shape], host)
        self._size = size_of(self._scene, *around)
        self.axis, self.shaping = opaque(unit(light.axis)), ShapingFactor.of(light.shaping)
        self.both_sides = light.both_sides
        self.area = opaque(light.mesh.area * (2 if light.both_sides else 1))
        self.textured = light.image is not None
        self.radiance = opaque(light.radiance)
        self.seen = not light.surface

    def emitted(self, direction: Array3f) -> Array3f:
        """Return the factor on the radiance that leaves along `direction`."""
        return self.shaping.factor(dr.dot(direction, self.axis))

    def position(self, u: Array2f) -> tuple[Array3f, Array3f, Array3f]:
        """Return points uniform in area, with normal and radiance, moved off the surface by its rounding error."""
        outer = u.x >= 0.5
        if self.both_sides:
            u = Array2f(2 * u.x - dr.select(outer, 1, 0), u.y)
        sample = self._shape.sample_position(0.0, mi.Point2f(u))
        if self.both_sides:
            sample.n = dr.select(outer, sample.n, -sample.n)
        place = self._place(sample)
        radiance = Array3f(self._emitter.eval(place)) if self.textured else self.radiance + 0 * u.x
        return leaving(place, sample.n, self._size), Array3f(sample.n), radiance

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return paths whose directions, at each point of the mesh, have a density proportional to the cosine."""
        origin, normal, radiance = self.position(u)
        direction, density = power_cone(v, normal, opaque(1.0), opaque(1.0))
        cosine = dr.dot(direction, normal)
        flux = radiance * self.emitted(direction) * (self.area * dr.pi)
        return EmittedRays.of_face(origin, direction, flux, self.area, cosine, density)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return the direction to a point of the mesh, uniform in area."""
        if self.both_sides:
            sample = self._shape.sample_direction(_at(point), mi.Point2f(u))
            weight = self._emitter.eval(self._place(sample)) / sample.pdf
        else:
            sample, weight = self._emitter.sample_direction(_at(point), mi.Point2f(u))
        direction = Array3f(sample.d)
        lit = (sample.pdf > 0) & dr.isfinite(sample.pdf) & self._shines(sample.n, direction, point, Float(sample.dist))
        weight = dr.select(lit, Array3f(weight) * self.emitted(-direction), 0)
        return Illumination(direction, Float(sample.dist), weight, dr.select(lit, Float(sample.pdf), 0))

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the mesh's shining sides."""
        hit = self._scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        there = hit.is_valid()
        front = there & self._shines(hit.n, direction, origin, hit.t)
        sample = mi.DirectionSample3f(self._scene, hit, _at(origin))
        if self.both_sides:
            hit.wi = mi.Vector3f(hit.wi.x, hit.wi.y, dr.abs(hit.wi.z))  # Mitsuba's emitters are one-sided
            pdf = self._shape.pdf_direction(_at(origin), sample, front)
        else:
            pdf = self._emitter.pdf_direction(_at(origin), sample, front)
        radiance = Array3f(self._emitter.eval(hit, front)) * self.emitted(-direction)
        return LightHit(front, dr.select(front, hit.t, dr.inf), dr.select(front, radiance, 0), Float(pdf))

    def _shines(self, normal: Any, direction: Array3f, point: Array3f, distance: Float) -> Bool:
        """Return whether light of the mesh reaches points along `direction`, which points to it.

        It does not reach those in its plane: rounding puts them on either side, at no distance from its light.
        """
        height = -distance * dr.dot(Array3f(normal), direction)
        return (dr.abs(height) if self.both_sides else height) > rounding(dr.max(dr.abs(point)))

    def _place(self, sample: PositionSample) -> SurfaceInteraction:
        """Return Mitsuba's interaction at a sampled point, as seen from the side of its normal."""
        place = dr.zeros(mi.SurfaceInteraction3f, dr.width(sample.p))
        place.p, place.n, place.uv, place.wi = sample.p, sample.n, sample.uv, mi.Vector3f(0, 0, 1)
        return place


def _at(point: Array3f) -> Any:
    """Return Mitsuba's interaction at a point that is lit."""
    result = dr.zeros(mi.SurfaceInteraction3f, dr.width(point))
    result.p = mi.Point3f(point)
    return result
