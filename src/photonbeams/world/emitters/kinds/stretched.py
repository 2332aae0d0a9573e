"""Spheres and cylinders under a linear map: ellipsoids, and elliptic or oblique cylinders.

Their light is sampled on the round shape, in its own space, and directions are mapped to the world. A solid angle dω
around a unit vector d there is |det M| / |M d|³ dω here, so that densities are multiplied by |M d|³ / |det M|.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Float
from ..lamp import Body, Illumination, LightHit, unit
from ..shaping import ConeSampler, ShapingFactor
from .cylinder import CylinderLamp
from .sphere import SphereLamp


class StretchedLamp(Body):
    """A lamp of a round `shape`, mapped to the world by the columns `x`, `y`, `z` (and back by `u`, `v`, `w`)."""

    stretched = True
    x: Array3f
    y: Array3f
    z: Array3f
    u: Array3f
    v: Array3f
    w: Array3f
    det: Float
    shape: Any

    @classmethod
    def of(cls, light: scene.SphereLight | scene.CylinderLight, *_: object) -> StretchedLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        linear = np.asarray(light.shape, dtype=np.float64)
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.axis, result.shaping = opaque(unit(light.axis)), ShapingFactor.of(light.shaping)
        result.x, result.y, result.z = (opaque(linear[:, each]) for each in range(3))
        result.u, result.v, result.w = (opaque(np.linalg.inv(linear)[:, each]) for each in range(3))
        result.det = opaque(abs(np.linalg.det(linear)))
        result.shape = cls.round()
        result.directions = ConeSampler(light, result.axis)
        return result

    @classmethod
    def round(cls) -> Any:
        """Return the lamp before it is stretched, around the origin."""
        raise NotImplementedError

    def silhouette(self, direction: Array3f) -> Float:
        """Return the area of the lamp's projection along `direction`."""
        local, length = self._local(direction)
        return self.shape.silhouette(local) * (self.det * length)

    def position(self, u: Array2f, direction: Array3f) -> Array3f:
        """Return a point from which light leaves along `direction`, uniform over the silhouette."""
        local, _ = self._local(direction)
        return self.center + self._to_world(self.shape.position(u, local))

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return the direction to a point of the lamp, as the round lamp is sampled."""
        local = self.shape.illuminate(self._to_local(point - self.center), u)
        to = self._to_world(local.direction)
        stretch = dr.norm(to)
        direction = to / stretch
        pdf = dr.select(dr.max(local.weight) > 0, local.pdf * (stretch * stretch * stretch / self.det), 0)
        weight = dr.select(pdf > 0, self.emitted(-direction) / dr.maximum(pdf, 1e-30), 0)
        return Illumination(direction, local.distance * stretch, weight, pdf)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the lamp's outer side."""
        local, length = self._local(direction)
        found = self.shape.see(self._to_local(origin - self.center), local)
        pdf = found.pdf / (length * length * length * self.det)
        radiance = dr.select(found.hit, self.emitted(-direction), 0)
        return LightHit(found.hit, dr.select(found.hit, found.distance / length, dr.inf), radiance, pdf)

    def _local(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return a direction in the round lamp's space, and the length that a unit vector has there."""
        vector = self._to_local(direction)
        length = dr.norm(vector)
        return vector / length, length

    def _to_local(self, vector: Array3f) -> Array3f:
        return self.u * vector.x + self.v * vector.y + self.w * vector.z

    def _to_world(self, vector: Array3f) -> Array3f:
        return self.x * vector.x + self.y * vector.y + self.z * vector.z


class EllipsoidLamp(StretchedLamp):
    """A stretched sphere."""

    record = scene.SphereLight
    central = True
    shape: SphereLamp

    @classmethod
    def round(cls) -> SphereLamp:
        """Return a sphere of radius 1."""
        return SphereLamp.of(scene.SphereLight("", scene.WHITE, radius=1.0))


class EllipticCylinderLamp(StretchedLamp):
    """A stretched cylinder, which may be oblique."""

    record = scene.CylinderLight
    shape: CylinderLamp

    @classmethod
    def round(cls) -> CylinderLamp:
        """Return a cylinder of radius 1 along X, from -1 to 1."""
        return CylinderLamp.of(scene.CylinderLight("", scene.WHITE, half=np.array([1.0, 0.0, 0.0]), radius=1.0))
