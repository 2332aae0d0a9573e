"""Triangulate polygons: fans for convex faces, ear clipping (Meisters 1975) for the others.

Triangles are returned as corners, which are indices into the mesh's list of face vertices, so that values of every
interpolation can be looked up afterwards.
"""

from __future__ import annotations

import numpy as np

from ...scene import Array


def triangulate(counts: Array, indices: Array, points: Array) -> tuple[Array, Array, int]:
    """Return triangles' corners (T, 3), their faces (T,), and how many faces were dropped for having no area.

    Parameters
    ----------
    counts, indices
        (F,) vertices per face, and their points' indices, (sum of counts,).
    points
        (P, 3).
    """
    offsets = np.cumsum(counts) - counts
    scale = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    corners, faces = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    dropped = int(np.count_nonzero((counts > 0) & (counts < 3)))
    for size in np.unique(counts[counts >= 3]):
        chosen = np.flatnonzero(counts == size)
        vertices = offsets[chosen][:, None] + np.arange(size)  # (K, size)
        polygons = points[indices[vertices]] / (scale or 1.0)  # (K, size, 3)
        normals = polygon_normals(polygons)
        # Float32 points of extent 1 are rounded to about 1e-7, so an area below 1e-14 is a rounding error squared.
        solid = np.linalg.norm(normals, axis=1) > 1e-14
        dropped += int(np.count_nonzero(~solid))
        polygons = polygons[solid]
        local, owner = _split(polygons, normals[solid])
        # A quad with two vertices in one place, at a sphere's pole say, is one triangle.
        place = polygons[owner[:, None], local]
        real = ~(place == np.roll(place, 1, axis=1)).all(axis=2).any(axis=1)
        corners.append(np.take_along_axis(vertices[solid][owner], local, axis=1)[real])
        faces.append(chosen[solid][owner][real])
    all_corners, all_faces = np.concatenate(corners), np.concatenate(faces)
    order = np.argsort(all_faces, kind="stable")
    return all_corners[order], all_faces[order], dropped


def polygon_normals(polygons: Array) -> Array:
    """Return Newell normals (K, 3) of polygons (K, N, 3); their lengths are the polygons' areas."""
    centered = polygons - polygons[:, :1]
    return 0.5 * np.cross(centered, np.roll(centered, -1, axis=1)).sum(axis=1)


def _split(polygons: Array, normals: Array) -> tuple[Array, Array]:
    """Split polygons of one size; return triangles (T, 3), as indices of vertices, and their polygons (T,)."""
    count, size = polygons.shape[:2]
    fan = np.stack([np.zeros(size - 2, int), np.arange(1, size - 1), np.arange(2, size)], axis=1)  # (size - 2, 3)
    local = np.tile(fan, (count, 1, 1))
    if size > 3:
        edges = np.roll(polygons, -1, axis=1) - polygons
        turns = np.einsum("knj,kj->kn", np.cross(np.roll(edges, 1, axis=1), edges), normals)
        slack = 1e-9 * np.einsum("kj,kj->k", normals, normals)
        for index in np.flatnonzero((turns < -slack[:, None]).any(axis=1)):
            local[index] = _ear_clipped(_flattened(polygons[index], normals[index]))
    return local.reshape(-1, 3), np.repeat(np.arange(count), size - 2)


def _flattened(polygon: Array, normal: Array) -> Array:
    """Project a polygon (N, 3) along the axis nearest to its normal: (N, 2), counter-clockwise."""
    axis = int(np.argmax(np.abs(normal)))
    flat = np.roll(polygon, -axis, axis=1)[:, 1:]
    return flat if normal[axis] > 0 else flat[:, ::-1]


def _ear_clipped(polygon: Array) -> Array:
    """Return triangles (N − 2, 3) of a counter-clockwise polygon (N, 2), which may have holes connected by bridges."""
    remaining = list(range(len(polygon)))
    triangles = []
    while len(remaining) > 3:
        ear = _ear(polygon, remaining)
        triangles.append([remaining[ear - 1], remaining[ear], remaining[(ear + 1) % len(remaining)]])
        del remaining[ear]
    return np.array([*triangles, remaining])


def _ear(polygon: Array, remaining: list[int]) -> int:
    """Return the position in `remaining` of the vertex to cut off: the best-shaped ear."""
    ring = polygon[remaining]
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    turn = _cross(ring - before, after - ring)  # (N,) twice the area of the triangle at each vertex
    longest = np.max([np.sum(side**2, axis=1) for side in (after - before, ring - before, after - ring)], axis=0)
    for position in np.argsort(-turn / np.maximum(longest, 1e-300)):
        if turn[position] <= 0:
            break
        triangle = np.stack([before[position], ring[position], after[position]])
        if not _any_inside(triangle, ring):
            return int(position)
    # The polygon crosses itself, or the rest is flat: cut anywhere, so that the loop ends.
    return int(np.argmax(turn))


def _any_inside(triangle: Array, points: Array) -> bool:
    """Return whether a point other than its corners lies in a counter-clockwise triangle."""
    a, b, c = triangle
    inside = (_cross(b - a, points - a) >= 0) & (_cross(c - b, points - b) >= 0) & (_cross(a - c, points - c) >= 0)
    corner = (points[:, None, :] == triangle[None]).all(axis=2).any(axis=1)
    return bool(np.any(inside & ~corner))


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
