"""Views of a frame: cameras over the shutter interval, and sensors of Mitsuba's that are no cameras."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from ..estimators.lanes import Lattice
from ..numerics.arrays import taken, to_uint
from ..numerics.samples import Samples
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Array3f, Float, UInt32
from ..world.cameras.cameras import CameraRays, View, Window
from ..world.cameras.sensors import PrimaryRays, sampled_rays
from ..world.shutter import CameraMotion, turn, with_lens
from .holdouts import HoldoutDepth
from .ray_passes import ViewRays

LOG = logging.getLogger("photonbeams")
_WIDEST_TURN = 30.0  # degrees: interpolated axes of the camera are then 3.4 % too short in the middle of the turn


class FrameView:
    """A view of a frame.

    Parameters
    ----------
    window
        The picture's size and its crop.
    camera
        Returns the camera in a pass, by the pass's number; None if a sensor is given.
    holdout
        The depth at which beams end. The scene's own surfaces are then not seen, but still stop light.
    sensor
        A sensor of Mitsuba's that is neither perspective nor orthographic.
    clips
        Whether rays begin and end at the camera's clipping planes.
    turned
        Names of cameras that turn too far for straight motion blur, of which a warning has been given.
    """

    def __init__(
        self, window: Window, camera: Callable[[int], CameraMotion] | None, holdout: HoldoutDepth | None = None,
        sensor: Any = None, clips: bool = False, turned: set[str] | None = None,
    ) -> None:  # fmt: skip
        self.window, self.holdout = window, holdout
        self._camera, self._sensor, self._clips = camera, sensor, clips
        self._turned: set[str] = set() if turned is None else turned

    def rays(self, number: int, places: Array2f, order: Any, samples: Samples, moving: bool = False) -> ViewRays:
        """Return the rays of pass `number`, through `places` in the pixels.

        `order` has the pixels' numbers for their samples. If beams are `moving`, rays have times, and are otherwise the
        same.
        """
        if self._camera is None:
            return ViewRays(sampled_rays(self._sensor, self.window, places, order, samples), None)
        own = self._view(number, self.window)
        sample = (lambda groups: _on_lens(samples, groups)) if own.film or moving else None
        rays = own.rays(places, sample)
        far = None
        if self.holdout is not None:
            far = self.holdout.distances(own, rays.facing, places, own.on_lens(sample))
        return ViewRays(self._primary(own, rays, far), own.projection, own.camera.exposure_scale, far)

    def inside(
        self, number: int, rays: ViewRays, places: Array2f, samples: Samples, moving: bool
    ) -> tuple[UInt32, ViewRays] | None:
        """Return the part of the view's rays, with a lattice, that is inside the picture; None if all rays are."""
        left, top, right, bottom = self.window.inside()
        (height, width), (x, y) = self.window.shape, self.window.crop[:2]
        if (left, top, right, bottom) == (0, 0, width, height) or left >= right or top >= bottom:
            return None
        row, column = np.mgrid[top:bottom, left:right]
        index = to_uint((row * width + column).ravel())
        own = self._view(number, replace(self.window, crop=(x + left, y + top, x + right, y + bottom)))
        found = own.rays(taken(places, index), (lambda groups: _on_lens(samples, groups)) if moving else None)
        far = None if rays.holdout is None else taken(rays.primary.far, index)
        assert rays.lattice is not None
        lattice = Lattice.of(own.window.width, own.window.height, own.window.crop[:2], rays.lattice.place)
        return index, ViewRays(self._primary(own, found, far), own.projection, rays.exposure, far, lattice)

    def pinhole(self, places: Array2f, order: Any, samples: Samples) -> ViewRays:
        """Return the rays of a pinhole at shutter open through places in the pixels, with the holdout's depth."""
        holdout = None if self.holdout is None else self.holdout.depth
        if self._camera is None:
            return ViewRays(sampled_rays(self._sensor, self.window, places, order, samples), None, holdout=holdout)
        own = View(replace(self._camera(0).opened, lens_radius=0.0), self.window)
        return ViewRays(self._primary(own, own.rays(places)), own.projection, holdout=holdout)

    def _view(self, number: int, window: Window) -> View:
        """Return the camera of a pass in a window of the picture."""
        assert self._camera is not None
        opened, middle, closed = self._camera(number)
        angle = turn(opened, closed)
        if angle > _WIDEST_TURN and opened.name not in self._turned:
            self._turned.add(opened.name)
            text = "%s turns by %.0f degrees within one pass, but its motion blur is straight: expected more passes"
            LOG.warning(text, opened.name, angle)
        return View(with_lens(opened, middle), window, None if closed is opened else closed)

    def _primary(self, view: View, rays: CameraRays, far: Any = None) -> PrimaryRays:
        count = dr.width(rays.direction)
        near, end = dr.zeros(Float, count), dr.full(Float, dr.largest(Float), count)
        if self._clips:
            near, end = (dr.opaque(Float, each) / rays.facing for each in view.camera.clipping)
        ones = dr.ones(Array3f, count)
        far = end if far is None else far
        return PrimaryRays(rays.origin, rays.direction, near, far, ones, rays.facing, rays.origins, rays.times)


def _on_lens(samples: Samples, groups: UInt32) -> tuple[Any, Any]:
    """Return the place on the lens, in the unit square, and the time in the pass of groups of pixels."""
    return samples.pair(groups, Stream.LENS), samples.pair(groups, Stream.TIME).x
