"""Cylinder lights: tubes that radiate from their mantle but not from their ends, as UsdLuxCylinderLight does."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Float
from ..lamp import Body, Illumination, LightHit, unit
from ..shaping import ConeSampler, ShapingFactor


class CylinderLamp(Body):
    """The mantle of a cylinder, which radiates evenly and outward; `along` is the unit vector of the cylinder's axis.

    From a point, a strip of the mantle is visible. Along the axis it is sampled uniformly in the angle that it covers
    (equiangular sampling, Kulla and Fajardo 2012), and across the axis uniformly in the silhouette.
    """

    record = scene.CylinderLight
    along: Array3f
    half_length: Float
    radius: Float

    @classmethod
    def of(cls, light: scene.CylinderLight, *_: object) -> CylinderLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.along, result.half_length = opaque(unit(light.half)), opaque(np.linalg.norm(light.half))
        result.radius, result.axis = opaque(light.radius), opaque(unit(light.axis))
        result.shaping = ShapingFactor.of(light.shaping)
        result.directions = ConeSampler(light, result.axis)
        return result

    def silhouette(self, direction: Array3f) -> Float:
        """Return the area of the lamp's projection along `direction`."""
        sine = dr.norm(dr.cross(self.along, direction))
        return 4 * self.half_length * self.radius * sine

    def position(self, u: Array2f, direction: Array3f) -> Array3f:
        """Return a point from which light leaves along `direction`, uniform over the silhouette."""
        front = direction - self.along * dr.dot(self.along, direction)
        front *= dr.rsqrt(dr.maximum(dr.squared_norm(front), 1e-20))
        sine = 2 * u.y - 1
        normal = dr.cross(self.along, front) * sine + front * dr.safe_sqrt(1 - sine * sine)
        return self.center + self.along * (self.half_length * (2 * u.x - 1)) + self.radius * normal

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return the direction to a point of the visible strip of the mantle."""
        height, away, distance = self._from_axis(point)
        outside = distance > self.radius
        low, angle = self._covered(height, distance)
        z = height + distance * dr.tan(low + u.x * angle)
        z = dr.clip(z, -self.half_length, self.half_length)
        sine = (2 * u.y - 1) * self._widest(distance)
        cosine = dr.safe_sqrt(1 - sine * sine)
        normal = away * cosine + dr.cross(self.along, away) * sine
        to = self.center + self.along * z + self.radius * normal - point
        squared = dr.maximum(dr.squared_norm(to), 1e-30)
        length = dr.sqrt(squared)
        towards = to / length
        pdf = dr.select(outside, self._pdf(height, distance, z, cosine, squared, length), 0)
        weight = dr.select(pdf > 0, self.emitted(-towards) / dr.maximum(pdf, 1e-30), 0)
        return Illumination(towards, length, weight, pdf)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the mantle's outer side."""
        to = origin - self.center
        speed = dr.dot(direction, self.along)
        across, start = direction - speed * self.along, to - dr.dot(to, self.along) * self.along
        squared = dr.maximum(dr.squared_norm(across), 1e-20)
        nearest = -dr.dot(start, across) / squared
        room = self.radius * self.radius - dr.squared_norm(start + nearest * across)
        distance = nearest - dr.safe_sqrt(room / squared)
        height, away, axial = self._from_axis(origin)
        z = height + distance * speed
        hit = (axial > self.radius) & (room >= 0) & (distance > 0) & (dr.abs(z) <= self.half_length)
        normal = (start + distance * across) / self.radius
        pdf = self._pdf(height, axial, z, dr.dot(normal, away), distance * distance, distance)
        radiance = dr.select(hit, self.emitted(-direction), 0)
        return LightHit(hit, dr.select(hit, distance, dr.inf), radiance, pdf)

    def _from_axis(self, point: Array3f) -> tuple[Float, Array3f, Float]:
        """Return a point's coordinate along the axis, the direction from the axis to it, and the distance there."""
        to = point - self.center
        height = dr.dot(to, self.along)
        away = to - height * self.along
        distance = dr.maximum(dr.norm(away), 1e-20)
        return height, away / distance, distance

    def _covered(self, height: Float, distance: Float) -> tuple[Float, Float]:
        """Return the angle to the axis's lower end, and the angle between both ends, as a point sees them."""
        low, high = -self.half_length - height, self.half_length - height
        # Written as a difference, atan(high / d) − atan(low / d), it would cancel far away.
        angle = dr.atan2(distance * 2 * self.half_length, distance * distance + low * high)
        return dr.atan2(low, distance), angle

    def _widest(self, distance: Float) -> Float:
        """Return the sine of the angle around the axis up to which the mantle is visible."""
        return dr.safe_sqrt(1 - dr.square(self.radius / distance))

    def _pdf(self, height: Float, distance: Float, z: Float, cosine: Float, squared: Float, length: Float) -> Float:
        """Return the pdf per solid angle of a place on the mantle, at `cosine` of the angle around the axis."""
        _, angle = self._covered(height, distance)
        along = distance / ((distance * distance + dr.square(z - height)) * angle)
        around = cosine / (2 * self.radius * dr.maximum(self._widest(distance), 1e-10))
        facing = (distance * cosine - self.radius) / length  # the cosine at the lamp
        return dr.select(facing > 0, along * around * squared / dr.maximum(facing, 1e-20), 0)
