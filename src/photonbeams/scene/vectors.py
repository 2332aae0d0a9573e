"""Vectors and points in NumPy: directions, and the plane that points lie in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .checks import Array

FLAT = 1e-4  # points are in one plane if they leave it by less than this fraction of their extent


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) scaled to length 1; zero vectors stay zero."""
    vectors = near_one(vectors)
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1.0)


def near_one(vectors: Array) -> Array:
    """Return vectors (..., 3) times powers of 2 that bring them near length 1: squares are in range, no bit is lost."""
    _, exponents = np.frexp(np.abs(vectors).max(axis=-1, keepdims=True, initial=0))
    scaled: Array = np.ldexp(vectors, -exponents)
    return scaled


def ellipsoid_area(axes: Array) -> float:
    """Return the area of an ellipsoid with these half axes, (3,), by Carlson's integral R_G (DLMF 19.33.1)."""
    from scipy.special import elliprg  # takes long to import

    x, y, z = np.square(np.asarray(axes, dtype=np.float64))
    return float(4 * np.pi * elliprg(y * z, z * x, x * y))


def ellipse_perimeter(wide: float, narrow: float) -> float:
    """Return the perimeter of an ellipse with these half axes, by Carlson's integral R_G (DLMF 19.30.5)."""
    from scipy.special import elliprg  # takes long to import

    return float(8 * elliprg(0, wide**2, narrow**2))


#: A rectangle: a corner, (3,), and the two edges from it, (3,) each, float64.
Sides = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Plane:
    """A plane fitted to points, by least squares.

    Attributes
    ----------
    center, normal
        The mean of the points, (3,), and a unit normal, (3,), which may point to either side.
    extent
        Root of the sum of squared distances from `center`, along the axis in which that is largest.
    """

    center: Array
    normal: Array
    extent: float


def plane_of(points: Array) -> Plane | None:
    """Return the plane that points (P, 3) lie in, or None if they are not in one plane."""
    center = points.mean(axis=0)
    _, extent, axes = np.linalg.svd(points - center, full_matrices=False)
    if len(extent) == 3 and extent[2] > FLAT * extent[0]:
        return None
    return Plane(center, np.cross(axes[0], axes[1]), float(extent[0]))
