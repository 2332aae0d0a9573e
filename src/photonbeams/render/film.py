"""Pixels: what one pass sees, and the sums over passes through the film's reconstruction filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import to_float
from ..numerics.sampling import z_order
from ..runtime.device import Array3f, Float, UInt32
from ..world.sensors import Sensor
from . import camera_paths as eye
from .passes import to_picture

_SUMS = ("surface", "beams", "alpha", "weight", "light", "squares", "depth")


class Picture:
    """What one pass sees, by pixels."""

    def __init__(self, count: int) -> None:
        self.beams, self.surface = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.depth = dr.zeros(Float, count), dr.full(Float, dr.inf, count)

    def add_surfaces(self, sight: eye.Sight, seen: eye.Seen) -> None:
        """Add what paths see of surfaces in one step."""
        dr.scatter_add(self.surface, seen.radiance, sight.pixel, sight.alive)
        first = sight.alive & sight.primary & seen.solid
        dr.scatter(self.alpha, Float(1), sight.pixel, first)
        dr.scatter(self.depth, seen.end, sight.pixel, first)
        dr.eval(self.surface, self.alpha, self.depth)


class Sums:
    """The weighted sums over passes of a picture, through the film's reconstruction filter."""

    def __init__(self, sensor: Sensor) -> None:
        self._filter, self._shape = sensor.film.rfilter(), (sensor.height, sensor.width)
        count = sensor.width * sensor.height
        index, columns = dr.arange(UInt32, count), dr.opaque(UInt32, sensor.width)
        left, top = (int(each) for each in sensor.film.crop_offset())
        self._x, self._y = index % columns, index // columns
        self.order = z_order(self._x + dr.opaque(UInt32, left), self._y + dr.opaque(UInt32, top))
        self.surface, self.beams = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.weight = dr.zeros(Float, count), dr.zeros(Float, count)
        self.light, self.squares = dr.zeros(Float, count), dr.zeros(Float, count)
        self.depth = dr.full(Float, dr.inf, count)
        self._empty = True
        dr.eval(self.order, self._x, self._y)

    def add(self, picture: Picture, offset: tuple[float, float]) -> None:
        """Add a pass whose samples lie at `offset` in each pixel.

        All pixels have the same offset, so the filter is a convolution; as gathers, whose order is always the same.
        """
        reach = int(np.ceil(self._filter.radius() - 0.5 - 1e-6)) if not self._filter.is_box_filter() else 0
        for down in range(-reach, reach + 1):
            for right in range(-reach, reach + 1):
                weight = self._weight(right + offset[0] - 0.5) * self._weight(down + offset[1] - 0.5)
                if weight != 0:
                    self._add(picture, right, down, weight)
        value = dr.dot(picture.surface + picture.beams, Array3f(1 / 3))
        self.light, self.squares = self.light + value, self.squares + value * value
        dr.eval(self.surface, self.beams, self.alpha, self.weight, self.light, self.squares)
        if self._empty:
            self.depth, self._empty = picture.depth, False

    def error(self, passes: int) -> float:
        """Return the median relative standard error of the mean."""
        if passes < 2:
            return float("nan")
        mean, squares = self.light.numpy() / passes, self.squares.numpy() / passes
        lit = mean > 0
        variance = np.maximum(squares - mean * mean, 0)[lit] / (passes - 1)
        return float(np.median(np.sqrt(variance) / mean[lit])) if lit.any() else 0.0

    def state(self) -> dict[str, np.ndarray]:
        """Return the sums."""
        return {name: getattr(self, name).numpy() for name in _SUMS}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take sums from elsewhere."""
        for name in _SUMS:
            own = getattr(self, name)
            if name not in state or state[name].shape != own.numpy().shape:
                raise scene.SceneError("the checkpoint is of another picture")
            kind: Any = type(own)
            setattr(self, name, kind(*map(to_float, state[name])) if kind is Array3f else to_float(state[name]))
        self._empty = False

    def _weight(self, distance: float) -> float:
        return 1.0 if self._filter.is_box_filter() else float(np.ravel(self._filter.eval(Float(distance)))[0])

    def _add(self, picture: Picture, right: int, down: int, weight: float) -> None:
        height, width = (dr.opaque(UInt32, each) for each in self._shape)
        x, y = self._x + dr.opaque(UInt32, right & 0xFFFFFFFF), self._y + dr.opaque(UInt32, down & 0xFFFFFFFF)
        inside = (x < width) & (y < height)  # a number below 0 is a large one
        index, factor = y * width + x, dr.opaque(Float, weight)
        self.surface = self.surface + factor * dr.gather(Array3f, picture.surface, index, inside)
        self.beams = self.beams + factor * dr.gather(Array3f, picture.beams, index, inside)
        self.alpha = self.alpha + factor * dr.gather(Float, picture.alpha, index, inside)
        self.weight = self.weight + dr.select(inside, factor, 0)

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers."""
        inverse = dr.rcp(self.weight)
        surface, beams, alpha = (
            to_picture(value * inverse, self._shape) for value in (self.surface, self.beams, self.alpha)
        )
        return {
            "rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams,
            "depth": to_picture(self.depth, self._shape),
        }  # fmt: skip
