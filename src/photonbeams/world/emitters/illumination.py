"""What reaches a point from a lamp, what a ray sees of the lamp, and its shaping over the directions."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque
from ...runtime.device import Array3f, Bool, Float

_UNSHAPED = 10.0  # an angle beyond 180 degrees: no cutoff


class Illumination:
    """Light that arrives at a point from one sample of a light.

    `direction` points to the light, `distance` may be infinite, and `weight` is the radiance over the `pdf` per solid
    angle. A light without extent, which no ray can meet, has a `pdf` of 0; `weight` is then the irradiance on a plane
    that faces the light.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "direction": Array3f, "distance": Float, "weight": Array3f, "pdf": Float,
    }  # fmt: skip

    def __init__(self, direction: Any = None, distance: Any = None, weight: Any = None, pdf: Any = None) -> None:
        self.direction: Any = direction
        self.distance: Any = distance
        self.weight: Any = weight
        self.pdf: Any = pdf


class LightHit:
    """What a ray sees of a light: `distance` (infinite where it misses), `radiance`, and the pdf of `illuminate`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"hit": Bool, "distance": Float, "radiance": Array3f, "pdf": Float}

    def __init__(self, hit: Any = None, distance: Any = None, radiance: Any = None, pdf: Any = None) -> None:
        self.hit: Any = hit
        self.distance: Any = distance
        self.radiance: Any = radiance
        self.pdf: Any = pdf


class ShapingFactor:
    """A light's cone and focus: a factor on its radiance as a function of the angle from its axis."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"start": Float, "cutoff": Float, "focus": Float, "tint": Array3f}

    start: Any
    cutoff: Any
    focus: Any
    tint: Any

    @classmethod
    def of(cls, shaping: scene.Shaping | None) -> ShapingFactor:
        """Return the shaping of a light; None has no effect."""
        result = cls()
        given = shaping or scene.Shaping()
        cutoff = float(np.radians(given.cone_angle)) if shaping else _UNSHAPED
        result.start = opaque(cutoff * (1 - given.cone_softness))
        result.cutoff = opaque(cutoff)
        result.focus = opaque(given.focus if shaping else 0.0)
        result.tint = opaque(given.focus_tint)
        return result

    def factor(self, cosine: Float) -> Array3f:
        """Return the factor at the angle with this cosine from the axis.

        It is lerp(focusTint, 1, |cos|^focus) · (1 − smoothstep(start, cutoff, angle)), with start = lerp(softness,
        cutoff, 0). A soft edge without width is a hard edge; above a softness of 1, it begins beyond the axis.
        """
        focus = dr.select(self.focus > 0, dr.power(dr.maximum(dr.abs(cosine), 1e-20), self.focus), 1)
        angle = dr.safe_acos(cosine)
        x = dr.clip((angle - self.start) / dr.maximum(self.cutoff - self.start, 1e-6), 0, 1)
        return dr.lerp(self.tint, Array3f(1), focus) * (1 - x * x * (3 - 2 * x))


class Lamp:
    """Base of lamps: whether it is infinitely far away, and whether its light goes out from a centre."""

    infinite: ClassVar[bool] = False
    central: ClassVar[bool] = False


def unit(vector: Any) -> np.ndarray:
    """Return a vector, (3,), with length 1."""
    numbers = np.asarray(vector, dtype=np.float64)
    return numbers / np.linalg.norm(numbers)
