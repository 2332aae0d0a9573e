"""Angular profiles of lights, such as those of IES files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from .checks import Array, Finite, SceneError, numbers

# Rows of a profile's table from 0 to 180 degrees, and columns around the axis: every 0.25 and 1 degrees, which includes
# the angles of nearly all files.
_ROWS, _COLUMNS = 721, 361


def _table(value: object, name: str) -> Array:
    return np.atleast_1d(numbers(value, name, "numbers").astype(np.float64))


@dataclass(frozen=True, eq=False)
class Profile:
    """A factor on a light's radiance by direction: the intensity of an IES profile, linear between its angles.

    Attributes
    ----------
    vertical
        (V,) degrees from the light's axis, local −Z, ascending, from 0 to 180. Outside of them there is no light.
    horizontal
        (H,) degrees around the axis, ascending, from 0 to 360; or one angle, for a profile that is the same all around.
        At 0 the light shines toward its −X, at 90 toward its −Y, as in hdEmbree, OpenUSD's reference renderer.
    intensity
        (H, V) numbers, 0 or more.
    angle_scale
        `inputs:shaping:ies:angleScale` of UsdLux. Above 0: a factor on vertical angles from the light's axis. Below 0:
        the negative of a factor on vertical angles from the opposite direction. 0, the default, is the same as 1. A
        factor from 0 to 1 leaves directions over, which have the profile's last value, as in hdEmbree; a factor from -1
        to 0 leaves such that are dark.

    Raises
    ------
    SceneError
        Arrays that do not fit each other, angles that do not ascend, intensities that are negative or not finite.

    Examples
    --------
    >>> downlight = pb.scene.Profile(vertical=[0, 30, 60], horizontal=[0], intensity=[[100, 50, 0]])
    >>> downlight.at([0, 45, 90], 0)
    array([100.,  25.,   0.])
    >>> lamp = pb.scene.SphereLight("/Lamp", 1.0, shaping=pb.scene.Shaping(profile=downlight))
    """

    called = "{field} of a profile"

    vertical: Annotated[Array, _table]
    horizontal: Annotated[Array, _table]
    intensity: Annotated[Array, _table]
    angle_scale: Finite = 0.0

    def __post_init__(self) -> None:
        if self.intensity.shape != (len(self.horizontal), len(self.vertical)) or not self.intensity.size:
            raise SceneError(
                f"a profile has {len(self.horizontal)} horizontal and {len(self.vertical)} vertical angles, and "
                f"intensities of shape {self.intensity.shape}: expected (horizontal, vertical)"
            )
        if not (np.all(np.isfinite(self.intensity)) and np.min(self.intensity) >= 0):
            raise SceneError("a profile has intensities that are negative or not finite: expected at least 0")
        for angles in (self.vertical, self.horizontal):
            if not (np.all(np.isfinite(angles)) and np.all(np.diff(angles) > 0)):
                raise SceneError("a profile has angles that do not ascend: expected ascending degrees")

    def at(self, theta: Array, phi: Array) -> Array:
        """Return the factor at angles in degrees: `theta` from the axis and `phi` around it, arrays of one shape."""
        theta, phi = np.broadcast_arrays(self.scaled(np.asarray(theta, dtype=np.float64)), np.mod(phi, 360.0))
        row, down = _between(self.vertical, theta)
        column, aside = _between(self.horizontal, phi)
        values = self.intensity
        below, above = np.minimum(row + 1, values.shape[1] - 1), np.minimum(column + 1, values.shape[0] - 1)
        first = (1 - down) * values[column, row] + down * values[column, below]
        second = (1 - down) * values[above, row] + down * values[above, below]
        slack = 1e-6
        there = (theta >= self.vertical[0] - slack) & (theta <= self.vertical[-1] + slack)
        there |= (self.angle_scale > 0) & (theta >= 180)
        return np.where(there, (1 - aside) * first + aside * second, 0.0)

    def scaled(self, theta: Array) -> Array:
        """Return the profile's vertical angle for `theta`, the angle from the light's axis, both in degrees."""
        if self.angle_scale == 0:
            return theta
        origin = 0.0 if self.angle_scale > 0 else 180.0
        return origin + (theta - origin) / abs(self.angle_scale)

    def normalized(self) -> Profile:
        """Return the profile divided by its mean over the sphere, or over the hemisphere if it ends at the equator.

        The mean is computed as hdEmbree does, from the intensity in the middle of each patch between the angles.
        """
        around = np.array([0.0, 360.0]) if len(self.horizontal) == 1 else self.horizontal
        values = np.repeat(self.intensity, 2, axis=0) if len(self.horizontal) == 1 else self.intensity
        width, height = np.radians(np.diff(around)), np.radians(np.diff(self.vertical))
        middle = np.radians(self.vertical[:-1]) + 0.5 * height
        mean = 0.25 * (values[1:, 1:] + values[:-1, 1:] + values[1:, :-1] + values[:-1, :-1])
        total = float(np.sum(mean * width[:, None] * (height * np.sin(middle))))
        whole = np.ptp(np.radians(self.vertical)) > np.pi / 2 + 0.1
        if not total > 0:
            return self
        factor = np.pi * (4 if whole else 2) / total
        return Profile(self.vertical, self.horizontal, self.intensity * factor, self.angle_scale)

    @cached_property
    def image(self) -> Array:
        """The profile without its angle scale as a table (rows, columns, 1).

        Rows are 0 to 180°, and a last one for what is beyond, by the angle scale; columns are 0 to 360°.
        """
        plain = Profile(self.vertical, self.horizontal, self.intensity)
        columns = 2 if len(self.horizontal) == 1 else _COLUMNS
        theta, phi = np.linspace(0, 180, _ROWS), np.linspace(0, 360, columns)
        last = self.vertical[-1]
        table = plain.at(np.append(theta, last)[:, None], phi)
        table[:, -1] = table[:, 0]
        return table[..., None].astype(np.float32)

    @cached_property
    def colors(self) -> Array:
        """The table as colours, (rows, columns, 3)."""
        return np.repeat(self.image, 3, axis=2)


def _between(knots: Array, value: Array) -> tuple[Array, Array]:
    """Return the index of the knot before each value, and the value's fraction of the way to the next knot."""
    if len(knots) == 1:
        return np.zeros(np.shape(value), dtype=np.int64), np.zeros(np.shape(value))
    index = np.clip(np.searchsorted(knots, value, side="right") - 1, 0, len(knots) - 2)
    return index, np.clip((value - knots[index]) / (knots[index + 1] - knots[index]), 0.0, 1.0)
