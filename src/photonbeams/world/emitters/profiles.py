"""Angular profiles in Dr.Jit: a table over directions, and directions sampled from it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque
from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Float, UInt32, mitsuba
from .shaping import ShapingFactor

mi = mitsuba()

_FAINT = 1e-3  # least density of directions in which a profile may shine, as a fraction of the mean


class ProfileTable(Struct):
    """The profile of a light with the axes `side`, `up`, `back`; `first` is its first pixel's index in an array."""

    side: Array3f
    up: Array3f
    back: Array3f
    first: UInt32
    columns: Float
    rows: Float
    scale: Float

    @classmethod
    def of(cls, profile: scene.Profile, frame: np.ndarray) -> ProfileTable:
        """Return the table for a light with this frame, (4, 4)."""
        result = cls()
        axes = np.asarray(frame, dtype=np.float64)[:3, :3]
        result.side, result.up, result.back = (opaque(axes[:, each]) for each in range(3))
        result.first = dr.opaque(UInt32, 0)
        result.rows, result.columns = (opaque(each) for each in profile.image.shape[:2])
        result.scale = opaque(profile.angle_scale)
        return result

    def factor(self, direction: Array3f, pixels: Array3f) -> Array3f:
        """Return the profile's factor on light that leaves along a direction."""
        x, y, z = (-dr.dot(direction, axis) for axis in (self.side, self.up, self.back))
        theta = self._scaled(dr.safe_acos(z))
        phi = dr.atan2(y, x)
        beyond = (self.scale > 0) & (theta >= dr.pi)
        row = dr.select(beyond, self.rows - 1, theta * (self.rows - 2) * dr.inv_pi)
        column = dr.select(phi < 0, phi + dr.two_pi, phi) * (self.columns - 1) * dr.inv_two_pi
        there = (theta >= 0) & (beyond | (theta <= dr.pi * (1 + 1e-6)))
        top = dr.select(beyond, self.rows - 2, dr.clip(dr.floor(row), 0, self.rows - 3))
        left = dr.clip(dr.floor(column), 0, self.columns - 2)

        def pixel(down: int, right: int) -> Array3f:
            index = UInt32(top + down) * UInt32(self.columns) + UInt32(left + right)
            return dr.gather(Array3f, pixels, self.first + index, there)

        across = dr.clip(column - left, 0, 1)
        upper = dr.lerp(pixel(0, 0), pixel(0, 1), across)
        lower = dr.lerp(pixel(1, 0), pixel(1, 1), across)
        return dr.lerp(upper, lower, dr.clip(row - top, 0, 1))

    def direction(self, theta: Float, phi: Float) -> Array3f:
        """Return the direction at `theta` from the light's axis and `phi` around it, in radians."""
        sine, cosine = dr.sincos(theta)
        around, aside = dr.sincos(phi)
        return -(self.side * (sine * aside) + self.up * (sine * around) + self.back * cosine)

    def _scaled(self, theta: Float) -> Float:
        """Return the angle in the profile for an angle from the light's axis, by the profile's angle scale."""
        origin = dr.select(self.scale < 0, dr.pi, 0)
        return origin + (theta - origin) / dr.select(self.scale == 0, 1, dr.abs(self.scale))


class ProfileSampler:
    """Directions in proportion to what a light with a profile radiates, including its cone, and its cosine if flat."""

    def __init__(self, table: ProfileTable, shaping: scene.Shaping, flat: bool) -> None:
        self._table, self._warp = table, _warp(shaping, flat)

    def sample(self, v: Array2f) -> tuple[Array3f, Float]:
        """Return directions for points of the unit square, and their density per solid angle."""
        place, pdf = self._warp.sample(mi.Point2f(v))
        theta, phi = Float(place.y) * dr.pi, Float(place.x) * dr.two_pi
        density = Float(pdf) / (2 * dr.square(dr.pi) * dr.maximum(dr.sin(theta), 1e-7))
        return self._table.direction(theta, phi), density


@lru_cache(maxsize=16)  # a building has many luminaires of one kind
def _warp(shaping: scene.Shaping, flat: bool) -> Any:
    """Return the map from the unit square to angles around the axis and from it, in units of 360 and 180 degrees."""
    profile = shaping.profile
    assert profile is not None
    rows, columns = profile.image.shape[0] - 1, profile.image.shape[1]
    theta, phi = np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns)
    shape = ShapingFactor.of(shaping).factor(Float(np.cos(theta))).numpy().max(axis=0)
    if flat:
        shape = shape * np.maximum(np.cos(theta), 0)
    value = profile.at(np.degrees(theta)[:, None], np.degrees(phi)) * shape[:, None]
    # The edges of a scaled profile lie between rows: with the maximum of neighbouring rows, none of it is left out.
    padded = np.pad(value, ((1, 1), (0, 0)), mode="edge")
    value = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    sine = np.sin(theta)[:, None]
    mean = float((value * sine).mean() / sine.mean()) or 1.0
    weight = (value + _FAINT * mean) * sine
    if flat:
        weight[theta > np.pi / 2 + np.pi / (rows - 1)] = 0
    return mi.MarginalContinuous2D0(np.ascontiguousarray(weight, dtype=np.float32))  # read on the CPU on all devices
