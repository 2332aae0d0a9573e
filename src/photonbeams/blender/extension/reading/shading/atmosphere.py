"""The skies of Sky Textures: light that air scatters once, and the fit of Preetham, Shirley and Smits (1999).

Blender's Single and Multiple Scattering are after Nishita et al. (1993), with air, aerosol and ozone whose densities
fall with height (as in Bruneton and Neyret 2008). Colours are those of a few wavelengths, by the fit of Wyman, Sloan
and Shirley (2013) to the observer of the CIE.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, pi, sin
from typing import Any

import numpy as np

from ..nodes import Told

_WAVES = np.linspace(400.0, 720.0, 17)  # nm
_EARTH, _TOP = 6_360_000.0, 6_420_000.0  # m
_AIR = 13.5e-6 * (550 / _WAVES) ** 4  # scattering per metre at the ground
_AEROSOL, _ALBEDO, _FORWARD = 1.9e-5, 0.9, 0.76  # extinction; Henyey and Greenstein's g
_OZONE = 1.5e-6 * np.exp(-(((_WAVES - 600) / 75) ** 2))  # Chappuis' band, at the height with the most
_RGB = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                 [0.0556434, -0.2040259, 1.0572252]])  # fmt: skip
_STEPS, _INNER = 40, 12
_ROWS, _COLUMNS = 40, 48
# Measured against Cycles 5.0, over suns of 6° to 60°: its wavelengths and steps are others, as is the unit of Hosek's.
_SINGLE, _MULTIPLE, _HOSEK = np.full(3, 0.935), np.array([0.92, 1.2, 1.64]), np.full(3, 1 / 7.0)
_LIMB = 0.8  # the mean of a disc whose brightness falls by 0.6 to its edge


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
    """A sky: its sun, and how much of what is in the air."""

    sun: Any  # the direction to it
    air: float = 1.0
    aerosol: float = 1.0
    ozone: float = 1.0
    altitude: float = 0.0  # m
    turbidity: float | None = None  # of a sky by Preetham's fit
    gain: Any = 1.0  # on each channel
    #: The irradiance of the sun's disc and the angle that it is wide; None without it.
    disc: tuple[Any, float] | None = None

    @classmethod
    def of(cls, node: Any, told: Told) -> Sky:
        """Return the sky of a Sky Texture."""
        if node.sky_type in ("PREETHAM", "HOSEK_WILKIE"):
            if node.sky_type == "HOSEK_WILKIE":
                told(f"{node.name} is by Hosek and Wilkie, which is rendered as a sky by Preetham of the same light")
            sun = np.array(node.sun_direction)
            gain = _HOSEK if node.sky_type == "HOSEK_WILKIE" else np.ones(3)
            return cls(sun / max(np.linalg.norm(sun), 1e-9), turbidity=max(node.turbidity, 1.7), gain=gain)
        if node.sky_type == "MULTIPLE_SCATTERING":
            told(f"{node.name} is by Multiple Scattering: it is rendered by Single Scattering, of about the same light")
        gain = _MULTIPLE if node.sky_type == "MULTIPLE_SCATTERING" else _SINGLE
        up, turn = node.sun_elevation, node.sun_rotation
        sun = np.array([cos(up) * sin(turn), cos(up) * cos(turn), sin(up)])
        altitude = float(np.clip(node.altitude, 1, 59_999))
        sky = cls(sun, node.air_density, node.aerosol_density, node.ozone_density, altitude, gain=gain)
        if not node.sun_disc or up < -node.sun_size / 2:
            return sky
        light = _SUN * np.exp(-sky._depth(sky._eye()[None], sun[None]))[0]
        irradiance = np.maximum(_RGB @ (light @ _XYZ), 0) * node.sun_intensity * _LIMB
        return replace(sky, disc=(irradiance, node.sun_size))

    def radiance(self, directions: Any) -> Any:
        """Return the radiance (N, 3) in directions (N, 3), without the sun's disc; below the horizon it fades."""
        if self.turbidity is not None:
            return _preetham(self.sun, self.turbidity, directions) * self.gain
        up = np.arcsin(np.clip(directions[:, 2], -1, 1))
        fade = np.clip(1 + np.minimum(up, 0) / 0.2, 0, 1) ** 2
        around = np.arctan2(directions[:, 0], directions[:, 1]) - np.arctan2(self.sun[0], self.sun[1])
        around = np.abs((around + pi) % (2 * pi) - pi)
        table = np.maximum(self._table() @ _XYZ @ _RGB.T, 0) * self.gain
        return _interpolated(table, np.sqrt(np.maximum(up, 0) / (pi / 2)), around / pi) * fade[:, None]

    def _table(self) -> Any:
        """Return spectra by the square root of the elevation, and by the angle from the sun around the vertical."""
        up, around = np.meshgrid(np.linspace(0, 1, _ROWS) ** 2 * pi / 2, np.linspace(0, pi, _COLUMNS), indexing="ij")
        around = around + np.arctan2(self.sun[0], self.sun[1])
        found = np.stack([np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)], axis=-1)
        return self._scattered(found.reshape(-1, 3)).reshape(_ROWS, _COLUMNS, -1)

    def _eye(self) -> Any:
        return np.array([0.0, 0.0, _EARTH + self.altitude])

    def _densities(self, height: Any) -> Any:
        """Return the densities (…, 3) of air, aerosol and ozone at heights, as multiples of the usual."""
        ozone = np.clip(np.minimum((height - 10e3) / 15e3, (40e3 - height) / 15e3), 0, 1)
        amounts = np.exp(-height / 8e3) * self.air, np.exp(-height / 1.2e3) * self.aerosol, ozone * self.ozone
        return np.stack(amounts, axis=-1)

    def _depth(self, places: Any, directions: Any) -> Any:
        """Return the optical depth (N, 17) from places (N, 3) to the top of the atmosphere."""
        length = _reach(places, directions)
        at = (np.arange(_INNER) + 0.5) / _INNER
        points = places[:, None] + (directions * length[:, None])[:, None] * (at**2)[:, None]
        steps = 2 * at / _INNER * length[:, None]  # more of them where the air is dense
        height = np.maximum(np.linalg.norm(points, axis=-1) - _EARTH, 0)
        return (self._densities(height) * steps[..., None]).sum(axis=1) @ np.stack([_AIR, 0 * _AIR + _AEROSOL, _OZONE])

    def _scattered(self, directions: Any) -> Any:
        """Return the spectrum (N, 17) that is scattered once toward the eye."""
        cosine = directions @ self.sun
        rayleigh = 3 / (16 * pi) * (1 + cosine**2)
        g = _FORWARD
        mie = (1 - g * g) / (4 * pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        eye = self._eye()
        length = _reach(np.broadcast_to(eye, directions.shape), directions)
        total, depth = np.zeros((len(directions), len(_WAVES))), np.zeros((len(directions), len(_WAVES)))
        coefficients = np.stack([_AIR, 0 * _AIR + _AEROSOL, _OZONE])
        for k in range(_STEPS):
            low, high = (k / _STEPS) ** 2, ((k + 1) / _STEPS) ** 2
            step = (high - low) * length
            points = eye + directions * (0.5 * (low + high) * length)[:, None]
            density = self._densities(np.maximum(np.linalg.norm(points, axis=1) - _EARTH, 0))
            own = density @ coefficients * step[:, None]
            lit = ~_hits_earth(points, self.sun)
            reached = np.exp(-(depth + own / 2 + self._depth(points, np.broadcast_to(self.sun, points.shape))))
            scattered = density[:, :1] * _AIR * rayleigh[:, None] + density[:, 1:2] * _AEROSOL * _ALBEDO * mie[:, None]
            total += scattered * reached * (lit * step)[:, None]
            depth += own
        return total * _SUN


def _interpolated(table: Any, row: Any, column: Any) -> Any:
    """Return values of a table (H, W, C) at rows and columns from 0 to 1, linearly between entries."""
    y, x = row * (len(table) - 1), column * (table.shape[1] - 1)
    low, left = np.minimum(y.astype(int), len(table) - 2), np.minimum(x.astype(int), table.shape[1] - 2)
    v, u = (y - low)[:, None], (x - left)[:, None]
    upper, lower = (table[low + k, left] * (1 - u) + table[low + k, left + 1] * u for k in (0, 1))
    return upper * (1 - v) + lower * v


def _reach(places: Any, directions: Any) -> Any:
    """Return the distances (N,) from places inside of the atmosphere to its top."""
    along = (places * directions).sum(axis=1)
    return -along + np.sqrt(np.maximum(along**2 - (places**2).sum(axis=1) + _TOP**2, 0))


def _hits_earth(places: Any, direction: Any) -> Any:
    along = places @ direction
    return (along < 0) & (along**2 - (places**2).sum(axis=1) + _EARTH**2 > 0)


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


_PREETHAM = 0.06  # Blender's factor on luminances in kcd / m²
