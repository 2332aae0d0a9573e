"""Flat lamps: rectangles and ellipses that radiate to one side."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Float
from ...bounds import Bounds
from ...warp import disk
from ..lamp import Illumination, Lamp, LightHit, unit
from ..rays import EmittedRays
from ..shaping import ConeSampler, ShapingFactor


class FlatLamp(Lamp):
    """A rectangle or ellipse that radiates to one side, along `axis`."""

    record = scene.FlatLight
    flat = True
    radiance: Array3f
    center: Array3f
    half_x: Array3f
    half_y: Array3f
    dual_x: Array3f
    dual_y: Array3f
    axis: Array3f
    area: Float
    disk: Float
    shaping: ShapingFactor

    @classmethod
    def of(cls, light: scene.FlatLight, *_: object) -> FlatLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        halves = np.array([light.half_x, light.half_y], dtype=np.float64)
        dual = np.linalg.pinv(halves)  # each column has the dot product 1 with one half axis, and 0 with the other
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.half_x, result.half_y = opaque(halves[0]), opaque(halves[1])
        result.dual_x, result.dual_y = opaque(dual[:, 0]), opaque(dual[:, 1])
        result.axis, result.area = opaque(unit(light.axis)), opaque(light.area)
        result.disk = opaque(1.0 if light.disk else 0.0)
        result.shaping = ShapingFactor.of(light.shaping)
        result.directions = ConeSampler(light, result.axis, flat=True)
        return result

    def emitted(self, direction: Array3f) -> Array3f:
        """Return the radiance that leaves along `direction`; none leaves to the back."""
        cosine = dr.dot(direction, self.axis)
        return dr.select(cosine > 0, self.radiance * self.shaping.factor(cosine), 0)

    def position(self, u: Array2f) -> Array3f:
        """Return a point of the light, uniform in area."""
        local = dr.select(self.disk > 0, disk(u), 2 * u - 1)
        return self.center + self.half_x * local.x + self.half_y * local.y

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths: `u` places them on the light, `v` chooses their directions."""
        direction, density = self.directions.sample(v)
        cosine = dr.dot(direction, self.axis)
        flux = self.emitted(direction) * (cosine * self.area / dr.maximum(density, 1e-30))
        return EmittedRays.of_face(self.position(u), direction, flux, self.area, cosine, density)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return the direction to a point of the light, uniform in area: weight L cos θ A / d²."""
        to = self.position(u) - point
        squared = dr.maximum(dr.squared_norm(to), 1e-30)
        distance = dr.sqrt(squared)
        towards = to / distance
        cosine = dr.maximum(-dr.dot(towards, self.axis), 0)
        weight = self.emitted(-towards) * (cosine * self.area / squared)
        return Illumination(towards, distance, weight, squared / dr.maximum(cosine * self.area, 1e-30))

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the light's front."""
        cosine = -dr.dot(direction, self.axis)
        distance = dr.dot(origin - self.center, self.axis) / dr.select(cosine > 0, cosine, 1)
        offset = origin + distance * direction - self.center
        x, y = dr.dot(offset, self.dual_x), dr.dot(offset, self.dual_y)
        inside = dr.select(self.disk > 0, x * x + y * y, dr.square(dr.maximum(dr.abs(x), dr.abs(y)))) <= 1
        hit = (cosine > 0) & (distance > 0) & inside & (self.area > 0)
        radiance = dr.select(hit, self.emitted(-direction), 0)
        pdf = distance * distance / dr.maximum(cosine * self.area, 1e-30)
        return LightHit(hit, dr.select(hit, distance, dr.inf), radiance, pdf)
