"""Outlines of surfaces, for bounds: corners of their convex hulls, read without faces, materials and primvars."""

from __future__ import annotations

import numpy as np

from ...scene import Array, Mesh
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .meshes import in_prototype, tessellation
from .skinning import is_skinned
from .velocities import carried

_FEW = 64  # so few points have a hull with hardly fewer corners


def read_outline(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> Mesh:
    """Return the corners of the convex hull of a prim's surface in world space, as a mesh without faces.

    A subdivision surface lies inside the hull of its cage.
    """
    skinned = is_skinned(prim)
    cache = reading.cache if skinned or reading.varies(prim) else reading.lasting
    key = ("outline", (prim if skinned else in_prototype(prim)).GetPath())
    if key not in cache:
        found = tessellation(reading, prim, carried(reading, prim) if prim.IsA(UsdGeom.Mesh) else None)
        empty = np.zeros((0, 3))
        cache[key] = empty if found is None else hull_corners(found.polygons.points[np.unique(found.polygons.indices)])
    points = cache[key] @ to_world[:3, :3].T + to_world[:3, 3]
    reading.within_reach(prim, points)
    return Mesh(name, points, np.zeros((0, 3), dtype=np.int64))


def hull_corners(points: Array) -> Array:
    """Return the points (P, 3) that are corners of their convex hull, or all if they lie in a plane or on a line."""
    if len(points) <= _FEW:
        return points
    from scipy.spatial import ConvexHull, QhullError  # takes long to import

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
