"""Fewer rays behind mirrors and glass: what neighbouring pixels see by the same route is a picture of its own.

The rays of every second pixel are evenly spaced (`lanes.Lattice`). Beams are gathered along the rays of every 2ᵏ-th
pixel first. A ray in between is interpolated from four of these if rays twice as far apart predicted them well, and if
the ray lies and ends among its neighbours as on a smooth mirror. Beams are gathered along all other rays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..looks.factors import Value
from ..numerics.arrays import indices, taken, to_uint
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from .coarse import bilinear, corners_foretell
from .geometry import Rays
from .lanes import Lattice

_LEVELS = 3  # largest k of every 2ᵏ-th pixel
_FEW = 4096  # rays below which beams are gathered along all of them
_PART = 1 / 256  # least fraction of pixels for which a picture has rays
_MOST = 1 << 26  # entries of all pictures together
# As in `coarse`, but larger for lengths, because mirrors and glass bend.
_ENDS = 1.0
_NONE = 0xFFFFFFFF
_FAR = 1e18

#: Returns the radiance along the rays with the given indices.
Evaluate = Callable[[UInt32], Array3f]


@dataclass
class RayImages:
    """Rays (N,) that are parts of pictures."""

    lattice: Lattice  # the pixels whose rays are evenly spaced
    size: tuple[int, int]  # width and height of the pictures in pixels
    image: Any  # (N,) index of the ray's picture; a picture has at most one ray of a pixel
    pixel: Any  # (N,)
    film: Any  # (N, 2) where the camera ray passes the film, in pixels
    least: Any  # (N,) radiance below which errors may be as large as at this radiance
    tolerance: float  # relative error

    def taken(self, lanes: UInt32) -> RayImages:
        """Return some of the rays."""
        own = {name: taken(getattr(self, name), lanes) for name in ("image", "pixel", "film", "least")}
        dr.eval(own)
        return replace(self, **own)

    def radiance(self, rays: Rays, evaluate: Evaluate) -> Array3f:
        """Return the radiance along all rays; `evaluate` is called for as few of them as possible."""
        count = dr.width(self.pixel)
        result, waiting = dr.zeros(Array3f, count), dr.full(Bool, True, count)
        picture = self._pictures(rays) if count >= _FEW else None
        if picture is not None:
            for level in range(_LEVELS, 0, -1):
                in_step = waiting & picture.in_step(level)
                here = picture.interpolated(level + 1, result, in_step) if level < _LEVELS else in_step
                _look(result, here, evaluate)
                picture.judge(level, result)
                waiting &= ~in_step
                dr.eval(waiting)
            waiting = picture.interpolated(1, result, waiting)
        _look(result, waiting, evaluate)
        return result

    def _pictures(self, rays: Rays) -> _Pictures | None:
        """Return the pictures that have enough rays, or None."""
        image = self.image.numpy()
        counts = np.bincount(image)
        pixels = self.size[0] * self.size[1]
        enough = np.flatnonzero(counts >= max(_PART * pixels, _FEW // 16))[: _MOST // max(pixels // 4, 1)]
        if not len(enough):
            return None
        numbers = np.full(len(counts), _NONE, dtype=np.uint32)
        numbers[enough] = np.arange(len(enough))
        return _Pictures(self, rays, dr.gather(UInt32, to_uint(numbers), self.image), len(enough))


class _Pictures:
    """The lattice pixels of pictures: the table of their rays, and the cells in which rays may be interpolated."""

    def __init__(self, images: RayImages, rays: Rays, number: UInt32, count: int) -> None:
        self._images, self._rays, self._number = images, rays, number
        first = [-corner % 2 for corner in images.lattice.corner]
        self._across, self._down = ((size + 1 - own) // 2 for size, own in zip(images.size, first, strict=True))
        width = dr.opaque(UInt32, images.size[0])
        x, y = images.pixel % width, images.pixel // width
        left, top = (dr.opaque(UInt32, each) for each in first)
        self._even = (number != _NONE) & (x >= left) & (y >= top) & ((x - left) % 2 == 0) & ((y - top) % 2 == 0)
        self._column, self._row = (x - left) // 2, (y - top) // 2
        # Places of rays on the film, from the first ray of the lattice on, in units of the lattice's spacing.
        place = Array2f(images.lattice.place)
        self._at = (images.film - Array2f(Float(left), Float(top)) - place) * 0.5
        size = count * self._across * self._down
        self._table, self._good = dr.full(UInt32, _NONE, size), dr.full(Bool, False, size)
        dr.eval(self._even, self._column, self._row, self._at, self._table, self._good)
        dr.scatter(self._table, dr.arange(UInt32, dr.width(x)), self._entry(self._column, self._row), self._even)
        dr.eval(self._table)

    def _entry(self, column: UInt32, row: UInt32) -> UInt32:
        across, down = dr.opaque(UInt32, self._across), dr.opaque(UInt32, self._down)
        return (self._number * down + row) * across + column

    def in_step(self, level: int) -> Bool:
        """Return which rays belong to every 2ᵏ-th pixel, k = level, from the first pixel of the lattice on."""
        step = dr.opaque(UInt32, 1 << (level - 1))
        return self._even & (self._column % step == 0) & (self._row % step == 0)

    def judge(self, level: int, radiance: Array3f) -> None:
        """Find the cells between four rays of a level in which other rays may be interpolated.

        As in `coarse.foretold`, a block of 3 × 3 rays decides, whose corners are rays of the next coarser level.
        """
        step = dr.opaque(UInt32, 1 << (level - 1))
        here = self.in_step(level)
        column, row = ((each // (2 * step)) * (2 * step) for each in (self._column, self._row))
        whole = here & (column + 2 * step < dr.opaque(UInt32, self._across))
        whole &= row + 2 * step < dr.opaque(UInt32, self._down)
        found, least = {}, Float(0)
        for i in range(3):
            for j in range(3):
                ray = dr.gather(UInt32, self._table, self._entry(column + i * step, row + j * step), whole)
                whole &= ray != _NONE
                found[i, j] = dr.gather(Array3f, radiance, ray, whole)
                least = dr.maximum(least, dr.gather(Float, self._images.least, ray, whole))
        good = whole & corners_foretell(found, least, self._images.tolerance)
        dr.scatter(self._good, good, self._entry(self._column, self._row), here)
        dr.eval(self._good)

    def interpolated(self, level: int, radiance: Array3f, some: Bool) -> Bool:
        """Interpolate those of `some` rays (a mask) for which that is possible from a level's rays; return the others.

        A ray may be interpolated if it lies and ends among its four neighbours as on a smooth mirror. Its offset from
        there, in units of the distances between them, is an estimate of its error, in units of the differences between
        their radiances.
        """
        step, fine = dr.opaque(UInt32, 1 << (level - 1)), dr.opaque(Float, 1 / (1 << (level - 1)))
        place = self._at * fine
        low = dr.floor(place)
        known = some & (self._number != _NONE) & (place.x >= 0) & (place.y >= 0)
        column, row = UInt32(dr.maximum(low.x, 0)) * step, UInt32(dr.maximum(low.y, 0)) * step
        known &= (column + step < dr.opaque(UInt32, self._across)) & (row + step < dr.opaque(UInt32, self._down))
        known &= dr.gather(Bool, self._good, self._entry(column, row), known)
        corners = []
        for j in range(2):
            for i in range(2):
                ray = dr.gather(UInt32, self._table, self._entry(column + i * step, row + j * step), known)
                known &= ray != _NONE
                corners.append(ray)
        u, v = place.x - low.x, place.y - low.y

        def at(values: Value) -> list[Value]:
            return [dr.gather(type(values), values, ray, known) for ray in corners]

        rays = self._rays
        off, apart = Float(0), Float(0)
        for points in (rays.point(rays.t_min), rays.point(dr.minimum(rays.t_max, _FAR))):
            four = at(points)
            off = dr.maximum(off, dr.norm(bilinear(four, u, v) - points))
            apart = dr.maximum(apart, dr.maximum(dr.norm(four[3] - four[0]), dr.norm(four[2] - four[1])))
        values = at(radiance)
        told = dr.maximum(bilinear(values, u, v), 0)
        spread = dr.max(dr.maximum(dr.maximum(values[0], values[1]), dr.maximum(values[2], values[3]))
                        - dr.minimum(dr.minimum(values[0], values[1]), dr.minimum(values[2], values[3])))  # fmt: skip
        allowed = dr.opaque(Float, self._images.tolerance) * dr.maximum(dr.max(told), self._images.least)
        # Beams end where rays end: light that is missing there does not show in the differences between neighbours.
        length = rays.t_max - rays.t_min
        ends = dr.abs(bilinear(at(length), u, v) - length) <= dr.opaque(Float, _ENDS * self._images.tolerance) * length
        known &= ends & (off * spread <= allowed * apart)
        dr.eval(known)
        dr.scatter(radiance, told, dr.arange(UInt32, dr.width(known)), known)
        rest = some & ~known
        dr.eval(radiance, rest)
        return rest


def _look(radiance: Array3f, some: Bool, evaluate: Evaluate) -> None:
    """Set the radiance of `some` rays (a mask) by `evaluate`."""
    index = indices(some)
    if len(index):
        dr.scatter(radiance, evaluate(index), index)
        dr.eval(radiance)
