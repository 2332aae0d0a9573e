"""Dome lights: environments, sampled by Mitsuba."""

from __future__ import annotations

import numpy as np

from .... import scene
from ....runtime.device import Array2f, mitsuba
from ...bounds import Bounds
from ..lamp import emit_from_infinity
from ..mitsuba_emitter import MitsubaEmitter
from ..rays import EmittedRays

mi = mitsuba()


class DomeLamp(MitsubaEmitter):
    """An environment, sampled by its brightness.

    Mitsuba's `envmap` has the convention of UsdLuxDomeLight's latlong format: +Y is up, the middle of the image looks
    along +Z and its first quarter along +X. So only the light's own rotation is applied. Mitsuba puts the first and the
    last row at the poles themselves, not half a row from them. The error is at most half a pixel of latitude, and is
    accepted.
    """

    record = scene.DomeLight
    environment = True

    @classmethod
    def of(cls, light: scene.DomeLight, *_: object) -> DomeLamp:
        """Return the light's environment."""
        image = np.ones((1, 1, 3)) if light.image is None else np.asarray(light.image)[..., :3]
        pixels = np.ascontiguousarray(image * np.asarray(light.radiance, dtype=np.float64), dtype=np.float32)
        if light.image is None or not pixels.any():  # a black image cannot be sampled by its brightness
            value = [float(each) for each in pixels[0, 0]]
            return cls(mi.load_dict({"type": "constant", "radiance": {"type": "rgb", "value": value}}))
        to_world = np.eye(4)
        to_world[:3, :3] = light.to_world
        transform = mi.ScalarTransform4f(to_world)
        return cls(mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": transform}))

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths: `u` places them in the world, `v` chooses their directions."""
        return emit_from_infinity(self, u, v, bounds)
