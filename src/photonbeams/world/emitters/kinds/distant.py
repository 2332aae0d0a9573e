"""Distant lights, such as the sun: directions in a cone, from infinity."""

from __future__ import annotations

import drjit as dr
import numpy as np

from .... import scene
from ....numerics.arrays import opaque
from ....runtime.device import Array2f, Array3f, Float
from ...bounds import Bounds
from ...warp import cone
from ..lamp import Illumination, Lamp, LightHit, emit_from_infinity, unit
from ..rays import EmittedRays


class DistantLamp(Lamp):
    """Light from a cone of directions around −`axis`; if the cone has no angle, `radiance` is an irradiance."""

    record = scene.DistantLight
    infinite = True
    radiance: Array3f
    axis: Array3f
    one_minus_cos: Float

    @classmethod
    def of(cls, light: scene.DistantLight, *_: object) -> DistantLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        result.covered = float(2 * np.sin(np.radians(light.angle) / 4) ** 2)
        result.radiance, result.axis = opaque(light.radiance), opaque(unit(light.axis))
        result.one_minus_cos = opaque(result.covered)
        return result

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths: `u` places them in the world, `v` chooses their directions."""
        return emit_from_infinity(self, u, v, bounds)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction in the light's cone, uniform in solid angle."""
        wide = self.one_minus_cos > 0
        towards = dr.select(wide, cone(u, -self.axis, self.one_minus_cos), -self.axis)
        solid_angle = dr.two_pi * self.one_minus_cos
        weight = self.radiance * dr.select(wide, solid_angle, 1)
        nowhere = 0 * point.x  # as wide as the points
        return Illumination(
            towards + nowhere, dr.inf + nowhere, weight + nowhere, dr.select(wide, dr.rcp(solid_angle), 0) + nowhere
        )

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the light, at infinity."""
        hit = dr.squared_norm(direction + self.axis) < 2 * self.one_minus_cos  # chord² = 2 (1 − cos)
        pdf = dr.rcp(dr.maximum(dr.two_pi * self.one_minus_cos, 1e-30))
        return LightHit(hit, dr.inf + 0 * origin.x, dr.select(hit, self.radiance, 0), pdf + 0 * origin.x)
