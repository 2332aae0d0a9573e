"""Holdouts: another picture's depth, at which camera rays end.

The rays of a pixel differ in their places in the pixel and on the lens, but a depth is that of one ray, for the pixel
or, in a holdout that is larger than the picture, for a part of it. So each part is taken as a piece of a plane, on
which 1/Z is linear in the picture. Without the slope of 1/Z, rays would end behind slanted surfaces and show beams that
lie there. The slope is the smaller of those to the neighbours on either side, and 0 if these differ in sign (the minmod
limiter, Roe 1986): at the edge of an object it is the object's own, and a depth never lies between a near object and a
far one.

Where a holdout covers only a part of a pixel, or has several depths, each ray draws one of them, as often as it is what
ends the light there, or none. So the mean over passes is right, and the noise is that of edges of surfaces.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import to_float, to_uint
from ..runtime.device import Array2f, Float, UInt32
from ..world.cameras.cameras import View, Window
from .seen.depth_layers import DepthLayers


class HoldoutDepth:
    """The holdout of one view: planar depths, positive, infinite for the background.

    Depths are (f H, f W), with f along each side of a pixel: each of its rays ends at the nearest. They may be layers,
    of which each ray draws one. `place` is the point within each of these parts of a pixel at which depths were
    sampled, from 0 to 1 along x and y.

    Attributes
    ----------
    content
        All that tells the holdout from another.
    depth
        A depth of each pixel, the nearest of a part near its middle.
    layered
        Whether rays draw layers.
    """

    def __init__(
        self, depth: np.ndarray | DepthLayers, window: Window, place: tuple[float, float] = (0.5, 0.5)
    ) -> None:
        layers, depth = (depth, depth.nearest()) if isinstance(depth, DepthLayers) else (None, depth)
        shape, self.layered = np.shape(depth), layers is not None
        self._parts = max(1, shape[0] // window.shape[0]) if shape else 1
        if shape != tuple(self._parts * each for each in window.shape):
            raise scene.SceneError(f"the holdout has shape {shape}: expected {window.shape}")
        middle = self._parts // 2
        self.depth = to_float(np.asarray(depth)[middle :: self._parts, middle :: self._parts])
        self._place, self._columns = place, window.shape[1]
        if layers is None:
            inverse = 1.0 / np.asarray(depth, dtype=np.float64)
            self._inverse = to_float(inverse)
            self.content: list[Float | UInt32] = [to_float(depth)]
            self._slopes = [to_float(_slopes_in(inverse, window, self._parts, axis)) for axis in (1, 0)]
        else:
            left, top, right, bottom = (self._parts * each for each in window.inside())
            inside = left, top, right, bottom
            self._slopes = [to_float(_some(layers.slopes(axis, inside))) for axis in (1, 0)]
            self._starts = to_uint(layers.starts())
            self.content = [to_float(_some(each)) for each in (layers.front, layers.back, layers.optical)]
            self.content.append(self._starts)
        dr.eval(self.depth, self.content, self._slopes)

    def distances(
        self, view: View, facing: Any, places: Array2f, on_lens: tuple[Any, Any, Any] | None = None,
        some: UInt32 | None = None, chance: Float | None = None,
    ) -> Float:  # fmt: skip
        """Return the distances at which the rays of `view` end, for rays from points `on_lens`, as `View.on_lens`.

        `facing` is the planar depth per unit of distance; `places` are the rays' places in their pixels, which are all
        pixels or `some`. Of layers, `chance`, uniform in [0, 1), draws the one at which a ray ends.
        """
        part, within = self._part_of(dr.arange(UInt32, dr.width(places)) if some is None else some, places)
        if chance is None:
            own, *rise = (dr.gather(Float, each, part) for each in (self._inverse, *self._slopes))
        else:
            own, *rise = self._drawn(part, chance)
        inverse, numerator = own, Float(1)
        for slope, there, here in zip(rise, within, self._place, strict=True):
            inverse = dr.fma(slope, there - dr.opaque(Float, here), inverse)
        if on_lens is not None:
            # The plane is 1 = a Z + b X + c Y, and the ray X = x + Z (right − x / focus), Y alike, with a place (x, y)
            # on the lens; a + b right + c up is the inverse depth of the ray through the lens's centre.
            scale, (x, y, focus) = view.projection.scale, on_lens
            moved = (rise[0] * scale[0] * x - rise[1] * scale[1] * y) * dr.opaque(Float, self._parts)
            inverse, numerator = inverse - moved / focus, dr.maximum(1 - moved, 0.25)
        # The slopes may add up to more than the inverse depth itself.
        return numerator / dr.maximum(inverse, 0.25 * own) / facing

    def _drawn(self, part: UInt32, chance: Float) -> tuple[Float, Float, Float]:
        """Return the inverse depths at which rays end, and their slopes; 0 for rays that pass all layers."""
        front, back, optical = self.content[:3]
        begin, end = dr.gather(UInt32, self._starts, part), dr.gather(UInt32, self._starts, part + 1)
        wanted = -dr.log(1 - chance)

        def halve(low: UInt32, high: UInt32) -> tuple[UInt32, UInt32]:
            middle = (low + high) >> 1
            behind = dr.gather(Float, optical, middle, low < high) <= wanted
            return dr.select(behind, middle + 1, low), dr.select(behind, high, middle)

        layer, _ = dr.while_loop((begin, end), lambda low, high: low < high, halve, label="layer")
        met = layer < end
        before = dr.select(layer > begin, dr.gather(Float, optical, layer - 1, met & (layer > begin)), 0)
        within = (wanted - before) / dr.maximum(dr.gather(Float, optical, layer, met) - before, 1e-12)
        begins, ends = (dr.gather(Float, each, layer, met) for each in (front, back))
        depth = dr.lerp(begins, ends, within)
        across, down = (dr.gather(Float, each, layer, met) for each in self._slopes)
        return Float(dr.select(met, dr.rcp(dr.maximum(depth, 1e-30)), 0)), across, down

    def _part_of(self, pixel: UInt32, places: Array2f) -> tuple[UInt32, Array2f]:
        """Return in which parts of pixels rays are, and the places in these."""
        parts, columns = dr.opaque(UInt32, self._parts), dr.opaque(UInt32, self._columns)
        number = [dr.minimum(UInt32(each * Float(parts)), parts - 1) for each in places]
        within = Array2f(*(each * Float(parts) - Float(own) for each, own in zip(places, number, strict=True)))
        row = pixel // columns * parts + number[1]
        return row * columns * parts + pixel % columns * parts + number[0], within


def _some(values: np.ndarray) -> np.ndarray:
    """Return values, or a single 0 for none: arrays are never empty."""
    return values if len(values) else np.zeros(1)


def _slopes_in(values: np.ndarray, window: Window, parts: int, axis: int) -> np.ndarray:
    """Return the slopes in a window, whose pixels have `parts`; those in the picture do not depend on overscan."""
    result = slopes(values, axis)
    left, top, right, bottom = (parts * each for each in window.inside())
    if (bottom - top, right - left) != values.shape and top < bottom and left < right:
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
