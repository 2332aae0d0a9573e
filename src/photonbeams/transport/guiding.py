"""Guided emission: which samples of an emitter reach what the camera sees (Jensen 1995; Vorba et al. 2014, simplified).

A pilot pass traces light with uniform emission samples, and tests points along its segments for visibility from the
camera. A histogram over the emission samples then tells where visible light comes from, and a map of the unit cube,
axis after axis, warps samples to that density. A fraction of the samples stays uniform, so that light which the pilot
missed is found too, and the estimate stays unbiased.

The map is piecewise linear in each dimension, so it keeps strata together, and scales ray differentials by known
factors.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..numerics.hashing import hash32
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..scene import Array
from ..world.visibility import through
from ..world.world import World

mi = mitsuba()

PILOT = 1 << 16  # light paths of the pilot pass
# Bins over the two dimensions of place and the two of direction, many for either: of a lamp it matters most where its
# light goes, of the sun where its light passes. And the fraction of samples that stay uniform.
_BINS = (4, 4, 32, 32), (32, 32, 4, 4)
_UNIFORM = 0.2
# Points along a segment that are tested.
_POINTS = 4
# Emission stays uniform where a greater fraction of it is visible: stratification is worth more then.
_ENOUGH = 0.6


class GuidingMap:
    """A map of the 4D unit cube onto itself, with a given density.

    Parameters
    ----------
    density
        Histogram over the cube, (4, 4, 32, 32) or any other shape of four axes, not negative.
    """

    def __init__(self, density: Array) -> None:
        weights = density / density.sum() * (1 - _UNIFORM) + _UNIFORM / density.size
        self._rows: list[Array] = []
        for axis in range(4):  # the probabilities along each axis, given the bins of those before it
            sums = weights.sum(axis=tuple(range(axis + 1, 4)))
            self._rows.append(sums / sums.sum(axis=-1, keepdims=True))

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return the images of points (N, 4), and the derivative of the map along each axis there, (N, 4)."""
        place, derivative = np.empty_like(points), np.empty_like(points)
        row = np.zeros(len(points), dtype=np.int64)
        for axis, rows in enumerate(self._rows):
            flat = rows.reshape(-1, rows.shape[-1])
            ends = np.cumsum(flat, axis=1)
            ends[:, -1] = 1.0
            bins = flat.shape[1]
            # One search in all rows: row r holds the numbers from r to r + 1.
            found = np.searchsorted((ends + np.arange(len(flat))[:, None]).ravel(), points[:, axis] + row, "right")
            chosen = np.clip(found - row * bins, 0, bins - 1)
            fraction = flat[row, chosen]
            begin = ends[row, chosen] - fraction
            inside = np.clip((points[:, axis] - begin) / fraction, 0, 1)
            place[:, axis] = (chosen + inside) / bins
            derivative[:, axis] = 1 / (bins * fraction)
            row = row * bins + chosen
        return np.minimum(place, np.nextafter(np.float32(1), np.float32(0))), derivative


def learn(points: Array, importance: Array) -> GuidingMap | None:
    """Return the guiding map for samples (N, 4) with importance (N,); None where uniform samples serve better."""
    if not importance.sum() > 0:
        return None
    density = min((_density(points, importance, bins) for bins in _BINS), key=_filled)
    return None if _filled(density) > _ENOUGH else GuidingMap(density)


def _filled(density: Array) -> float:
    """Return the fraction of the cube that a density fills: of one that is 0 or 1, its mean."""
    return float(density.sum() ** 2 / (density.size * (density**2).sum()))


def _density(points: Array, importance: Array, bins: tuple[int, ...]) -> Array:
    """Return the smoothed histogram of importance over the cube."""
    from scipy.ndimage import uniform_filter  # takes long to import

    index = [np.minimum((points[:, axis] * count).astype(int), count - 1) for axis, count in enumerate(bins)]
    density = np.zeros(bins)
    np.add.at(density, tuple(index), importance)
    # The histogram is noisy: neighbours of a visible bin may be visible, although the pilot did not find that. Of four
    # filters this one served the comparison scene best: the largest of the neighbours, and the roots of both, left a
    # tenth to a third more error.
    return np.maximum(uniform_filter(density, size=3, mode="nearest"), 0)  # by differences of sums: −1e-17 for 0


class CameraImportance:
    """The importance of light paths: how much of their light a camera sees."""

    def __init__(self, world: World, view: Any) -> None:
        self._world, self._media, self._view = world, world.media, view

    def importance(self, segments: Any, hits: Any, count: int) -> Array:
        """Return the importance of paths 0 … count − 1, (count,): their light that the camera sees scattered."""
        result = np.zeros(count)
        if segments is not None:
            for k in range(_POINTS):
                s = segments.length * dr.opaque(Float, (k + 0.5) / _POINTS)
                lit = segments.flux * self._media.absorbed(segments.medium, s)
                scattered = self._media.scattering(segments.medium) * segments.length
                value = self._importance(segments.origin + s * segments.direction, segments.medium, segments.number)
                light = dr.max(lit * scattered) * value
                np.add.at(result, segments.number.numpy(), light.numpy() / _POINTS)
        if hits is not None:
            value = self._importance(hits.position, UInt32(0), hits.number)
            np.add.at(result, hits.number.numpy(), (dr.max(hits.flux) * value).numpy())
        return result

    def _importance(self, point: Array3f, medium: UInt32, number: UInt32) -> Float:
        """Return the camera's importance at points: 0 outside of the picture, else transmittance over distance²."""
        view = self._view
        place = view.poses[0].to_camera(point)
        depth = dr.maximum(place.z, 1e-6)
        x, y = (view.center[0] + view.scale[0] * place.x / depth, view.center[1] - view.scale[1] * place.y / depth)
        if view.orthographic:
            x, y = view.center[0] + view.scale[0] * place.x, view.center[1] - view.scale[1] * place.y
        inside = (x > -0.5 * view.width) & (x < 1.5 * view.width) & (y > -0.5 * view.height) & (y < 1.5 * view.height)
        inside &= place.z > 0
        to = (view.origin - point) if not view.orthographic else -place.z * view.poses[0].forward
        distance = dr.maximum(dr.norm(to), 1e-6)
        ray = mi.Ray3f(mi.Point3f(point), mi.Vector3f(to / distance))
        ray.maxt = distance * (1 - 1e-4)
        # A ray that begins on a surface must not meet it.
        ray.o = ray.o + 1e-4 * distance * ray.d
        passed, _ = through(self._world.plugin, self._media, ray, medium + 0 * number, hash32(number), Bool(inside))
        near = dr.square(dr.maximum(distance, dr.opaque(Float, 1e-2) * distance + 1e-2))
        weight = Float(1) if view.orthographic else dr.rcp(near)
        return dr.select(inside, dr.max(passed) * weight, 0)
