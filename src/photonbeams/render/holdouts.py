"""Holdouts: another picture's depth, at which camera rays end.

The rays of a pixel differ in their places in the pixel and on the lens, but the pixel's depth is that of one ray. So
each pixel is taken as a piece of a plane, on which 1/Z is linear in the picture. Without the slope of 1/Z, rays would
end behind slanted surfaces and show beams that lie there. The slope is the smaller of those to the neighbours on either
side, and 0 if these differ in sign (the minmod limiter, Roe 1986): at the edge of an object it is the object's own, and
a depth never lies between a near object and a far one.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import to_float
from ..runtime.device import Array2f, Float, UInt32
from ..world.cameras.cameras import View, Window


class HoldoutDepth:
    """The holdout of one view: planar depths, (H, W), positive, infinite for the background.

    `place` is the point within each pixel at which the depths were sampled, from 0 to 1 along x and y.
    """

    def __init__(self, depth: np.ndarray, window: Window, place: tuple[float, float] = (0.5, 0.5)) -> None:
        if np.shape(depth) != window.shape:
            raise scene.SceneError(f"the holdout has shape {np.shape(depth)}: expected {window.shape}")
        inverse = 1.0 / np.asarray(depth, dtype=np.float64)
        self.depth = to_float(depth)
        self._inverse = to_float(inverse)
        self._slopes = [to_float(_slopes_in(inverse, window, axis)) for axis in (1, 0)]
        self._place = place
        dr.eval(self.depth, self._inverse, self._slopes)

    def distances(
        self, view: View, facing: Any, places: Array2f, on_lens: tuple[Any, Any, Any] | None = None,
        some: UInt32 | None = None,
    ) -> Float:  # fmt: skip
        """Return the distances at which the rays of `view` end, for rays from points `on_lens`, as `View.on_lens`.

        `facing` is the planar depth per unit of distance; `places` are the rays' places in their pixels, which are all
        pixels or `some`.
        """
        own, rise, numerator = self._inverse, self._slopes, Float(1)
        if some is not None:
            own, *rise = (dr.gather(Float, each, some) for each in (own, *rise))
        inverse = own
        for slope, there, here in zip(rise, places, self._place, strict=True):
            inverse = dr.fma(slope, there - dr.opaque(Float, here), inverse)
        if on_lens is not None:
            # The plane is 1 = a Z + b X + c Y, and the ray X = x + Z (right − x / focus), Y alike, with a place (x, y)
            # on the lens; a + b right + c up is the inverse depth of the ray through the lens's centre.
            scale, (x, y, focus) = view.projection.scale, on_lens
            moved = rise[0] * scale[0] * x - rise[1] * scale[1] * y
            inverse, numerator = inverse - moved / focus, dr.maximum(1 - moved, 0.25)
        # The slopes may add up to more than the inverse depth itself.
        return numerator / dr.maximum(inverse, 0.25 * own) / facing


def _slopes_in(values: np.ndarray, window: Window, axis: int) -> np.ndarray:
    """Return the slopes of a window; those of the picture do not depend on overscan."""
    result = slopes(values, axis)
    left, top, right, bottom = window.inside()
    if (bottom - top, right - left) != window.shape and top < bottom and left < right:
        result[top:bottom, left:right] = slopes(values[top:bottom, left:right], axis)
    return result


def slopes(values: Any, axis: int) -> np.ndarray:
    """Return the change of values from pixel to pixel along an axis: the smaller of those to either side, or 0."""
    values = np.moveaxis(np.asarray(values, dtype=np.float64), axis, 0)
    if len(values) == 1:
        return np.zeros_like(np.moveaxis(values, 0, axis))
    steps = np.diff(values, axis=0)
    before, after = np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]])
    smaller = np.sign(before) * np.minimum(np.abs(before), np.abs(after))
    return np.moveaxis(np.where(before * after > 0, smaller, 0.0), 0, axis)
