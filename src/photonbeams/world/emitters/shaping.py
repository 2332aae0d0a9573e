"""Shaping of a light: its cone and focus as a factor on its radiance, and directions sampled within them.

The formulas are those of UsdLuxShapingAPI and hdEmbree's reference code.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque
from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Float
from ..warp import power_cone, sphere

_UNSHAPED = 10.0  # an angle beyond 180 degrees: no cutoff
_WIDE = 2 * np.pi / 3  # a cone wider than this is sampled as part of the whole sphere, which distorts less


class ShapingFactor(Struct):
    """A light's cone and focus: a factor on its radiance as a function of the angle from its axis."""

    start: Float
    cutoff: Float
    focus: Float
    tint: Array3f

    @classmethod
    def of(cls, shaping: scene.Shaping | None) -> ShapingFactor:
        """Return the shaping of a light; None has no effect."""
        given = shaping or scene.Shaping()
        cutoff = float(np.radians(given.cone_angle)) if shaping else _UNSHAPED
        start, focus = cutoff * (1 - given.cone_softness), given.focus if shaping else 0.0
        return cls(opaque(start), opaque(cutoff), opaque(focus), opaque(given.focus_tint))

    def factor(self, cosine: Float) -> Array3f:
        """Return the factor at the angle with this cosine from the axis.

        It is lerp(focusTint, 1, |cos|^focus) · (1 − smoothstep(start, cutoff, angle)), with start = lerp(softness,
        cutoff, 0). A soft edge without width is a hard edge; above a softness of 1, it begins beyond the axis.
        """
        focus: Any = dr.select(self.focus > 0, dr.power(dr.maximum(dr.abs(cosine), 1e-20), self.focus), 1)
        angle = dr.safe_acos(cosine)
        x = dr.clip((angle - self.start) / dr.maximum(self.cutoff - self.start, 1e-6), 0, 1)
        result: Array3f = dr.lerp(self.tint, Array3f(1), focus) * (1 - x * x * (3 - 2 * x))
        return result


class ConeSampler:
    """Directions within a light's cone, and before its slide, around an axis.

    The density follows what the light radiates: the cos θ of a `flat` light, and the focus if that darkens other
    directions.
    """

    def __init__(self, light: scene.Light, axis: Array3f, flat: bool = False) -> None:
        shaping = light.shaping or scene.Shaping(cone_angle=180.0)
        # |cos|^focus is symmetric: sample it only if the light shines to one side.
        focused = shaping.focus > 0 and max(shaping.focus_tint) == 0 and (flat or shaping.cone_angle <= 90)
        widest = np.pi / 2 if flat or focused else np.pi
        cutoff = min(np.radians(shaping.cone_angle), widest if flat else min(widest, light.spread))
        power = (1.0 if flat else 0.0) + (shaping.focus if focused else 0.0)
        if power == 0:
            q = 2 * np.sin(cutoff / 2) ** 2
        else:
            q = -np.expm1((power + 1) * np.log(np.cos(cutoff))) if cutoff < np.pi / 2 else 1.0
        self._axis, self._whole = axis, cutoff > _WIDE
        self._power, self._q = opaque(power), opaque(q)

    def sample(self, v: Array2f) -> tuple[Array3f, Float]:
        """Return directions for points of the unit square, and their density per solid angle."""
        if self._whole:
            return sphere(v), dr.full(Float, 1 / (4 * np.pi), dr.width(v))
        return power_cone(v, self._axis, self._power, self._q)
