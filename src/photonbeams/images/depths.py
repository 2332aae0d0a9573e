"""Depths of another picture for a view: opaque, or with how much of each pixel is covered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..render.seen.depth_layers import DepthLayers
from ..scene import Array
from .channels import Box, Size, placed, placed_indices

if TYPE_CHECKING:
    from ..render.holdouts import HoldoutDepth
    from ..world.cameras.cameras import View


_ROUNDS = 4  # how many pixels away the depth of a pixel that is covered in part may be


@dataclass(frozen=True)
class Depth:
    """Depths of one view's window."""

    values: Array  # (f H, f W) float32, f along each side of a pixel, in scene units; infinite: there is no surface
    distance: bool = False  # whether they are distances from the camera, rather than along its axis
    layers: DepthLayers | None = None  # of the same shape, where parts of pixels are covered; None: all is opaque

    def seen_by(self, view: View) -> HoldoutDepth:
        """Return the holdout depth in a view's window, for which the depths were read."""
        from ..render.holdouts import HoldoutDepth

        values, layers = self.values, self.layers
        if self.distance:  # from the camera's position; a lens, if there is one, is centred there
            parts, cosines = len(values) // view.window.shape[0], np.ones(values.shape, np.float32)
            for row, column in np.ndindex(parts, parts):
                cosines[row::parts, column::parts] = view.cosines(((column + 0.5) / parts, (row + 0.5) / parts))
            values, layers = values * cosines, layers and layers.times(cosines)
        return HoldoutDepth(values if layers is None else layers, view.window)

    def covered(self, alpha: Array) -> Depth:
        """Return depths that cover `alpha` of their pixels, of the same shape.

        A pixel that is covered in part may have no depth, if it was sampled beside the surface: it has the nearest of
        the pixels around it, which may have been found in this way up to four pixels away.
        """
        alpha, values = np.clip(np.nan_to_num(np.asarray(alpha, np.float64)), 0, 1), self.values
        part = (alpha > 0) & (alpha < 1)
        if not part.any() and not (np.isfinite(values) & (alpha == 0)).any():
            return self
        from scipy.ndimage import minimum_filter

        for _ in range(_ROUNDS):
            nearest = minimum_filter(values, 3, mode="constant", cval=np.inf)
            values = np.where(part & ~np.isfinite(values), nearest, values)
        return replace(self, values=values, layers=DepthLayers.of_surfaces(values, alpha))

    def placed(self, corner: Size, box: Box) -> Depth:
        """Return the depths in a box, as `channels.placed`; beyond them there is no surface."""
        layers = self.layers
        if layers is not None:
            layers = layers.taken(placed_indices(layers.counts.shape, corner, box))
        return replace(self, values=placed(self.values, corner, box, np.inf), layers=layers)
