"""Spheres that radiate, and points."""

from __future__ import annotations

import drjit as dr

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Bool, Float
from ...bounds import Bounds
from ...warp import cone, disk, perpendicular
from ..lamp import Body, Illumination, LightHit, unit
from ..rays import EmittedRays
from ..shaping import ConeSampler, ShapingFactor


class SphereLamp(Body):
    """A sphere that radiates evenly; with radius 0, a point, whose `radiance` is a radiant intensity."""

    record = scene.SphereLight
    central = True
    radius: Float

    @classmethod
    def of(cls, light: scene.SphereLight, *_: object) -> SphereLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.radius, result.axis = opaque(light.radius), opaque(unit(light.axis))
        result.shaping = ShapingFactor.of(light.shaping)
        result.directions = ConeSampler(light, result.axis)
        return result

    def silhouette(self, direction: Array3f) -> Float:
        """Return the area of the sphere's projection along `direction`."""
        return dr.pi * self.radius * self.radius + 0 * direction.x

    def position(self, u: Array2f, direction: Array3f) -> Array3f:
        """Return a point from which light leaves along `direction`, uniform over the silhouette."""
        s, t = perpendicular(direction)
        offset = disk(u)
        lift = dr.safe_sqrt(1 - dr.squared_norm(offset))
        return self.center + self.radius * (s * offset.x + t * offset.y + direction * lift)

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths: `u` places them on the light, `v` chooses their directions."""
        direction, density = self.directions.sample(v)
        area = dr.pi * self.radius * self.radius
        flux = self.emitted(direction) * (dr.select(self.radius > 0, area, 1) / density)
        return EmittedRays.fanned(self.position(u, direction), direction, flux, dr.sqrt(area) + 0 * u.x, density)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction in the cone that the sphere subtends, uniform in solid angle."""
        to = self.center - point
        squared = dr.squared_norm(to)
        axis = to * dr.rsqrt(squared)
        one_minus_cos, outside = self._subtended(squared)
        towards = dr.select(self.radius > 0, cone(u, axis, one_minus_cos), axis)
        along = dr.dot(to, towards)
        across = dr.squared_norm(to - along * towards)
        distance = along - dr.safe_sqrt(self.radius * self.radius - across)
        pdf = dr.select(self.radius > 0, dr.rcp(dr.two_pi * one_minus_cos), 0)
        scale = dr.select(self.radius > 0, dr.two_pi * one_minus_cos, dr.rcp(squared))
        weight = dr.select(outside, self.emitted(-towards) * scale, 0)
        return Illumination(towards, distance, weight, pdf)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the sphere; a point is not seen."""
        to = self.center - origin
        along = dr.dot(to, direction)
        room = self.radius * self.radius - dr.squared_norm(to - along * direction)
        distance = along - dr.safe_sqrt(room)
        one_minus_cos, outside = self._subtended(dr.squared_norm(to))
        hit = (self.radius > 0) & outside & (room >= 0) & (distance > 0)
        radiance = dr.select(hit, self.emitted(-direction), 0)
        return LightHit(hit, dr.select(hit, distance, dr.inf), radiance, dr.rcp(dr.two_pi * one_minus_cos))

    def _subtended(self, squared_distance: Float) -> tuple[Float, Bool]:
        """Return 1 − cos of the half angle that the sphere subtends, and whether the point is outside of the sphere."""
        sine2 = self.radius * self.radius / squared_distance
        outside = sine2 < 1
        sine2 = dr.select(outside, sine2, 1)
        return dr.maximum(sine2 / (1 + dr.safe_sqrt(1 - sine2)), 1e-30), outside
