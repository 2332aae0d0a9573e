"""The skies of Sky Textures: light that air scatters once, and the fit of Preetham, Shirley and Smits (1999).

Blender's Single and Multiple Scattering are after Nishita et al. (1993), with air, aerosol and ozone whose densities
fall with height (as in Bruneton and Neyret 2008). Colours are those of a few wavelengths, by the fit of Wyman, Sloan
and Shirley (2013) to the observer of the CIE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin
from typing import Any

import numpy as np

from ..prims import Told

_WAVES = np.linspace(400.0, 720.0, 17)  # nm
_EARTH, _TOP = 6_360_000.0, 6_420_000.0  # m
_AIR = 13.5e-6 * (550 / _WAVES) ** 4  # scattering per metre at the ground
_AEROSOL, _ALBEDO, _FORWARD = 1.9e-5, 0.9, 0.76  # extinction; Henyey and Greenstein's g
_OZONE = 1.5e-6 * np.exp(-(((_WAVES - 600) / 75) ** 2))  # Chappuis' band, at the height with the most
_EXTINCTION = np.stack([_AIR, np.full(len(_WAVES), _AEROSOL), _OZONE])
_RGB = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                 [0.0556434, -0.2040259, 1.0572252]])  # fmt: skip
_STEPS, _INNER = 40, 12
_ROWS, _COLUMNS = 40, 48
# Measured against Cycles 5.0, over suns of 6° to 60°: its wavelengths and steps are others, as is the unit of Hosek's.
_GAINS = {
    "SINGLE_SCATTERING": np.full(3, 0.935), "MULTIPLE_SCATTERING": np.array([0.92, 1.2, 1.64]), "PREETHAM": np.ones(3),
    "HOSEK_WILKIE": np.full(3, 1 / 7.0),
}  # fmt: skip
_OTHERS = {
    "MULTIPLE_SCATTERING": "by Multiple Scattering: it is rendered by Single Scattering, of about the same light",
    "HOSEK_WILKIE": "by Hosek and Wilkie, which is rendered as a sky by Preetham of the same light",
}
_LIMB = 0.8  # the mean of a disc whose brightness falls by 0.6 to its edge
_PREETHAM = 0.06  # Blender's factor on luminances in kcd / m²


def _lobe(mean: float, left: float, right: float) -> Any:
    away = _WAVES - mean
    return np.exp(-0.5 * (away * np.where(away < 0, left, right)) ** 2)


#: From a spectrum to XYZ, (17, 3), and Planck's spectrum of the sun (5778 K), in W / m² / nm.
_XYZ = np.stack([
    1.056 * _lobe(599.8, 0.0264, 0.0323) + 0.362 * _lobe(442.0, 0.0624, 0.0374) - 0.065 * _lobe(501.1, 0.0490, 0.0382),
    0.821 * _lobe(568.8, 0.0213, 0.0247) + 0.286 * _lobe(530.9, 0.0613, 0.0322),
    1.217 * _lobe(437.0, 0.0845, 0.0278) + 0.681 * _lobe(459.0, 0.0385, 0.0725),
], axis=1) * (_WAVES[1] - _WAVES[0])  # fmt: skip
_SUN = 1.79 * (500 / _WAVES) ** 5 * np.expm1(14388 / (0.5 * 5778)) / np.expm1(14388e3 / (_WAVES * 5778))


@dataclass(frozen=True)
class Sky:
    """A sky.

    Attributes
    ----------
    sun
        The direction to its sun.
    radiance
        Returns the radiance (N, 3) in directions (N, 3), without the sun's disc.
    irradiance, angle
        Of the sun's disc, and how wide it is; None and 0 without a disc.
    """

    sun: Any
    radiance: Callable[[Any], Any]
    irradiance: Any = None
    angle: float = 0.0


def sky_of(node: Any, told: Told) -> Sky:
    """Return the sky of a Sky Texture."""
    gain = _GAINS[node.sky_type]
    if node.sky_type in _OTHERS:
        told(f"{node.name} is {_OTHERS[node.sky_type]}")
    if node.sky_type in ("PREETHAM", "HOSEK_WILKIE"):
        sun = np.array(node.sun_direction) / max(np.linalg.norm(node.sun_direction), 1e-9)
        return Sky(sun, lambda directions: _preetham(sun, max(node.turbidity, 1.7), directions) * gain)
    up, turn = node.sun_elevation, node.sun_rotation
    sun = np.array([cos(up) * sin(turn), cos(up) * cos(turn), sin(up)])
    eye = np.array([[0.0, 0.0, _EARTH + np.clip(node.altitude, 1, 59_999)]])
    air = _Air(sun, np.array([node.air_density, node.aerosol_density, node.ozone_density]))
    radiance = partial(_interpolated, air, eye, gain)
    if not node.sun_disc or up < -node.sun_size / 2:
        return Sky(sun, radiance)
    light = _SUN * np.exp(-air.depth(eye, sun[None]))
    irradiance = _color(light)[0] * node.sun_intensity * _LIMB
    return Sky(sun, radiance, irradiance, node.sun_size)


def _color(spectra: Any) -> Any:
    """Return the colours (…, 3) of spectra (…, 17)."""
    return np.maximum(spectra @ _XYZ @ _RGB.T, 0)


def _interpolated(air: _Air, eye: Any, gain: Any, directions: Any) -> Any:
    """Return the radiance in directions, between those of a table; below the horizon it fades.

    The table is by the square root of the elevation, and by the angle from the sun around the vertical.
    """
    toward_sun = np.arctan2(air.sun[0], air.sun[1])
    up, turn = np.meshgrid(np.linspace(0, 1, _ROWS) ** 2 * pi / 2, np.linspace(0, pi, _COLUMNS), indexing="ij")
    axes = np.cos(up) * np.sin(turn + toward_sun), np.cos(up) * np.cos(turn + toward_sun), np.sin(up)
    table = _color(air.scattered(eye, np.stack(axes, axis=-1).reshape(-1, 3))).reshape(_ROWS, _COLUMNS, 3) * gain
    height = np.arcsin(np.clip(directions[:, 2], -1, 1))
    turn = np.arctan2(directions[:, 0], directions[:, 1]) - toward_sun
    y = np.sqrt(np.maximum(height, 0) / (pi / 2)) * (_ROWS - 1)
    x = np.abs((turn + pi) % (2 * pi) - pi) / pi * (_COLUMNS - 1)
    low, left = np.minimum(y.astype(int), _ROWS - 2), np.minimum(x.astype(int), _COLUMNS - 2)
    v, u = (y - low)[:, None], (x - left)[:, None]
    upper, lower = (table[low + k, left] * (1 - u) + table[low + k, left + 1] * u for k in (0, 1))
    fade = np.clip(1 + np.minimum(height, 0) / 0.2, 0, 1) ** 2
    return (upper * (1 - v) + lower * v) * fade[:, None]


class _Air:
    """The atmosphere: its sun, and how much of air, aerosol and ozone it has, as multiples of the usual."""

    def __init__(self, sun: Any, amounts: Any) -> None:
        self.sun, self._amounts = sun, amounts

    def depth(self, places: Any, directions: Any) -> Any:
        """Return the optical depth (N, 17) from places (N, 3) to the top of the atmosphere."""
        points, steps = _ray(places, directions, _INNER)
        return (self._densities(points) * steps).sum(axis=1) @ _EXTINCTION

    def scattered(self, eye: Any, directions: Any) -> Any:
        """Return the spectrum (N, 17) that is scattered once toward the eye (1, 3)."""
        cosine, g = (directions @ self.sun)[:, None, None], _FORWARD
        rayleigh = 3 / (16 * pi) * (1 + cosine**2) * _AIR
        mie = (1 - g * g) / (4 * pi * (1 + g * g - 2 * g * cosine) ** 1.5) * _AEROSOL * _ALBEDO
        points, steps = _ray(eye, directions, _STEPS)
        density = self._densities(points)
        crossed = density @ _EXTINCTION * steps
        to_sun = self.depth(points.reshape(-1, 3), self.sun[None]).reshape(crossed.shape)
        reached = np.exp(crossed / 2 - np.cumsum(crossed, axis=1) - to_sun)
        light = (density[..., :1] * rayleigh + density[..., 1:2] * mie) * reached * ~self._is_in_shadow(points) * steps
        return light.sum(axis=1) * _SUN

    def _densities(self, points: Any) -> Any:
        """Return the densities (…, 3) of air, aerosol and ozone at points, as multiples of the usual."""
        height = np.maximum(np.linalg.norm(points, axis=-1) - _EARTH, 0)
        ozone = np.clip(np.minimum((height - 10e3) / 15e3, (40e3 - height) / 15e3), 0, 1)
        return np.stack([np.exp(-height / 8e3), np.exp(-height / 1.2e3), ozone], axis=-1) * self._amounts

    def _is_in_shadow(self, points: Any) -> Any:
        """Return whether the earth hides the sun from points, (…, 1)."""
        along = (points @ self.sun)[..., None]
        return (along < 0) & (along**2 - (points**2).sum(axis=-1, keepdims=True) + _EARTH**2 > 0)


def _ray(places: Any, directions: Any, count: int) -> tuple[Any, Any]:
    """Return points (N, count, 3) from places to the top of the atmosphere, and steps (N, count, 1) around them.

    There are more of them where the air is dense.
    """
    along = (places * directions).sum(axis=1)
    length = np.sqrt(along**2 - (places**2).sum(axis=1) + _TOP**2) - along
    ends = length[:, None, None] * np.linspace(0, 1, count + 1)[:, None] ** 2
    return places[:, None] + directions[:, None] * (ends[:, 1:] + ends[:, :-1]) / 2, np.diff(ends, axis=1)


def _preetham(sun: Any, turbidity: float, directions: Any) -> Any:
    """Return the radiance of a sky by the fit of Preetham, Shirley and Smits, in Blender's unit."""
    t, theta_s = turbidity, np.arccos(np.clip(sun[2], -1, 1))
    slopes = np.array([[0.1787, -0.3554, -0.0227, 0.1206, -0.0670], [-0.0193, -0.0665, -0.0004, -0.0641, -0.0033],
                       [-0.0167, -0.0950, -0.0079, -0.0441, -0.0109]])  # fmt: skip
    starts = np.array([[-1.4630, 0.4275, 5.3251, -2.5771, 0.3703], [-0.2592, 0.0008, 0.2125, -0.8989, 0.0452],
                       [-0.2608, 0.0092, 0.2102, -1.6537, 0.0529]])  # fmt: skip
    a, b, c, d, e = (slopes * t + starts).T[:, :, None]
    chi = (4 / 9 - t / 120) * (pi - 2 * theta_s)
    powers = theta_s ** np.arange(3, -1, -1.0)
    x = np.array([[0.00166, -0.00375, 0.00209, 0], [-0.02903, 0.06377, -0.03202, 0.00394],
                  [0.11693, -0.21196, 0.06052, 0.25886]])  # fmt: skip
    y = np.array([[0.00275, -0.00610, 0.00317, 0], [-0.04214, 0.08970, -0.04153, 0.00516],
                  [0.15346, -0.26756, 0.06670, 0.26688]])  # fmt: skip
    orders = np.array([t * t, t, 1])
    zenith = np.array([((4.0453 * t - 4.9710) * np.tan(chi) - 0.2155 * t + 2.4192) * _PREETHAM, orders @ x @ powers,
                       orders @ y @ powers])[:, None]  # fmt: skip

    def perez(cos_theta: Any, gamma: Any) -> Any:
        return (1 + a * np.exp(b / cos_theta)) * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)

    gamma = np.arccos(np.clip(directions @ sun, -1, 1))
    height = np.maximum(directions[:, 2], 1e-3)
    luminance, cx, cy = zenith * perez(height, gamma) / perez(1.0, theta_s)
    factor = luminance / np.maximum(cy, 1e-9)
    return np.maximum(np.stack([factor * cx, luminance, factor * (1 - cx - cy)], axis=1) @ _RGB.T, 0)
