"""Vectors and points in NumPy: directions, and the plane that points lie in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

FLAT = 1e-4  # points are in one plane if they leave it by less than this fraction of their extent


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) scaled to length 1; zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1.0)


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
