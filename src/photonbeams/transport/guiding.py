"""Guided emission: which samples of an emitter reach what the camera sees (Jensen 1995; Vorba et al. 2014, simplified).

A pilot pass traces light evenly, and asks for points along its segments whether the camera sees them. A histogram over
the four numbers of emission tells then where light that is seen comes from, and a map of the unit cube, axis after
axis, sends samples there as often. A part of all samples stays even, so that what the pilot missed is found too: the
picture's mean is the same.

The map is piecewise linear in each number, so it keeps strata together, and stretches photon differentials by known
factors.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from ..numerics.hashing import hash32
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.visibility import through
from ..world.world import World

mi = mitsuba()

Numbers = npt.NDArray[Any]

PILOT = 1 << 16  # light paths of the pilot pass
# Bins over the two numbers of place and the two of direction, and the share of samples that stay even.
_BINS = (4, 4, 32, 32)
_EVEN = 0.2
# Points along a segment that are looked at.
_POINTS = 4
# Emission is left even where the part of it that is seen is greater than this: strata are worth more then.
_ENOUGH = 0.6


class GuidingMap:
    """A map of the 4D unit cube onto itself, denser where samples are wanted.

    Parameters
    ----------
    density
        Histogram over the cube, (4, 4, 32, 32) or any other shape of four axes, not negative.
    """

    def __init__(self, density: Numbers) -> None:
        weights = density / density.sum() * (1 - _EVEN) + _EVEN / density.size
        self._rows: list[Numbers] = []
        for axis in range(4):  # each axis' share, given the bins of those before it
            sums = weights.sum(axis=tuple(range(axis + 1, 4)))
            self._rows.append(sums / sums.sum(axis=-1, keepdims=True))

    def __call__(self, points: Numbers) -> tuple[Numbers, Numbers]:
        """Return where points (N, 4) go, and by how much the map stretches each axis there, (N, 4)."""
        place, stretch = np.empty_like(points), np.empty_like(points)
        row = np.zeros(len(points), dtype=np.int64)
        for axis, rows in enumerate(self._rows):
            flat = rows.reshape(-1, rows.shape[-1])
            ends = np.cumsum(flat, axis=1)
            ends[:, -1] = 1.0
            bins = flat.shape[1]
            # One search in all rows: row r holds the numbers from r to r + 1.
            found = np.searchsorted((ends + np.arange(len(flat))[:, None]).ravel(), points[:, axis] + row, "right")
            chosen = np.clip(found - row * bins, 0, bins - 1)
            share = flat[row, chosen]
            begin = ends[row, chosen] - share
            inside = np.clip((points[:, axis] - begin) / share, 0, 1)
            place[:, axis] = (chosen + inside) / bins
            stretch[:, axis] = 1 / (bins * share)
            row = row * bins + chosen
        return np.minimum(place, np.nextafter(np.float32(1), np.float32(0))), stretch


def learn(points: Numbers, importance: Numbers) -> GuidingMap | None:
    """Return the guide to samples (N, 4) of this importance (N,); None where it is not worth having."""
    if not importance.sum() > 0:
        return None
    bins = [np.minimum((points[:, axis] * count).astype(int), count - 1) for axis, count in enumerate(_BINS)]
    density = np.zeros(_BINS)
    np.add.at(density, tuple(bins), importance)
    # A bin's neighbours may be seen as well, though the pilot has not hit what is seen of them, and what it has hit of
    # one bin is chance. Of four filters this one served the comparison scene best: the largest of the neighbours, and
    # the roots of both, left a tenth to a third more error.
    density = np.maximum(uniform_filter(density, size=3, mode="nearest"), 0)  # by differences of sums: −1e-17 for 0
    if density.sum() ** 2 > _ENOUGH * density.size * (density**2).sum():
        return None
    return GuidingMap(density)


class CameraImportance:
    """How much of light paths a camera sees."""

    def __init__(self, world: World, view: Any) -> None:
        self._world, self._media, self._view = world, world.media, view

    def importance(self, segments: Any, hits: Any, count: int) -> Numbers:
        """Return the importance of paths 0 … count − 1: the light of theirs that the camera can see, (count,)."""
        result = np.zeros(count)
        if segments is not None:
            for k in range(_POINTS):
                s = segments.length * dr.opaque(Float, (k + 0.5) / _POINTS)
                lit = segments.flux * self._media.absorbed(segments.medium, s)
                scattered = self._media.scattering(segments.medium) * segments.length
                value = self._seen(segments.origin + s * segments.direction, segments.medium, segments.number)
                light = dr.max(lit * scattered) * value
                np.add.at(result, segments.number.numpy(), light.numpy() / _POINTS)
        if hits is not None:
            value = self._seen(hits.position, UInt32(0), hits.number)
            np.add.at(result, hits.number.numpy(), (dr.max(hits.flux) * value).numpy())
        return result

    def _seen(self, point: Array3f, medium: UInt32, number: UInt32) -> Float:
        """Return what a camera sees of light at points: 0 beside the picture, else transmittance over distance²."""
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
        # From a surface the ray begins on it, which stops nothing of what is seen.
        ray.o = ray.o + 1e-4 * distance * ray.d
        passed, _ = through(self._world.plugin, self._media, ray, medium + 0 * number, hash32(number), Bool(inside))
        near = dr.square(dr.maximum(distance, dr.opaque(Float, 1e-2) * distance + 1e-2))
        weight = Float(1) if view.orthographic else dr.rcp(near)
        return dr.select(inside, dr.max(passed) * weight, 0)
