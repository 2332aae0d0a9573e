"""Polygons in a prim's own space, and their triangles: the step between USD's meshes and the renderer's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from .triangles import triangulate


@dataclass(frozen=True)
class Values:
    """A flattened primvar: `values` (K, d), and the `interpolation` as UsdGeom names it."""

    values: Array
    interpolation: str

    @property
    def per_point(self) -> bool:
        """Whether all corners at a point have the same value."""
        return self.interpolation in ("constant", "vertex", "varying")

    def at(self, corners: Array, faces: Array, indices: Array) -> Array:
        """Return the value at each triangle corner, (T, 3, d)."""
        if self.interpolation == "constant":
            return np.broadcast_to(self.values[0], (*corners.shape, self.values.shape[1]))
        if self.interpolation == "uniform":
            return np.repeat(self.values[faces][:, None], 3, axis=1)
        return self.values[corners if self.interpolation == "faceVarying" else indices[corners]]


@dataclass(frozen=True)
class Polygons:
    """A polygon mesh in local space, faces counter-clockwise around the outward normal unless `left_handed`.

    `origin` (F,) is the face of the stage's mesh that each face is part of; None: the faces are the stage's.
    """

    points: Array  # (P, 3)
    counts: Array  # (F,)
    indices: Array  # (sum of counts,)
    primvars: Mapping[str, Values] = field(default_factory=dict)  # normals, uvs, and those for fields of the material
    left_handed: bool = False
    smooth: bool = False  # whether to compute normals if there are none
    origin: Array | None = None

    @property
    def lengths(self) -> dict[str, int]:
        """How many values a primvar of each interpolation has."""
        points = len(self.points)
        return {
            "constant": 1, "uniform": len(self.counts), "varying": points, "vertex": points,
            "faceVarying": len(self.indices),
        }  # fmt: skip

    def chosen(self, faces: Array) -> Polygons:
        """Return only the chosen faces, (F,) bool, which keep their `origin`."""
        if faces.all():
            return self
        corners = np.repeat(faces, self.counts)
        kept: dict[str, Any] = {"uniform": faces, "faceVarying": corners}
        return replace(
            self,
            counts=self.counts[faces],
            indices=self.indices[corners],
            origin=np.flatnonzero(faces) if self.origin is None else self.origin[faces],
            primvars={
                name: Values(own.values[kept.get(own.interpolation, slice(None))], own.interpolation)
                for name, own in self.primvars.items()
            },
        )


@dataclass(frozen=True)
class Tessellation:
    """Polygons that represent a prim.

    Attributes
    ----------
    lengths
        How many values a primvar of each interpolation has on the prim.
    spread
        A function from a primvar's values on the prim to its values on the polygons.
    """

    polygons: Polygons
    lengths: Mapping[str, int]
    spread: Callable[[Values], Values]


@dataclass(frozen=True)
class Triangles:
    """Triangles in local space: vertices split wherever a normal or UV is not shared, and each triangle's face."""

    points: Array  # (V, 3)
    vertices: Array  # (T, 3) indices of points
    faces: Array  # (T,) the stage's polygon that each triangle belongs to
    values: Mapping[str, Array]  # (V, d): primvars, as in `Polygons`
    dropped: int = 0  # faces without area

    def chosen(self, triangles: Array) -> Triangles:
        """Return only the chosen triangles, (T,) bool, with their points."""
        kept, vertices = np.unique(self.vertices[triangles], return_inverse=True)
        values = {name: own[kept] for name, own in self.values.items()}
        return replace(
            self,
            points=self.points[kept],
            vertices=vertices.reshape(-1, 3),
            faces=self.faces[triangles],
            values=values,
        )


def triangles_of(polygons: Polygons) -> Triangles:
    """Triangulate polygons, look up normals and UVs, and weld shared vertices."""
    corners, faces, dropped = triangulate(polygons.counts, polygons.indices, polygons.points)
    if polygons.left_handed:
        corners = corners[:, ::-1]
    positions = polygons.indices[corners]  # (T, 3)
    primvars = {name: own.at(corners, faces, polygons.indices) for name, own in polygons.primvars.items()}
    if "normals" in primvars:
        primvars["normals"] = _mended(primvars["normals"], polygons.points[positions])
    elif polygons.smooth and len(corners):
        primvars["normals"] = vertex_normals(polygons.points, positions)[positions]
    split = [primvars[name] for name, own in polygons.primvars.items() if not own.per_point]
    vertices, kept = _welded(positions, split)
    return Triangles(
        points=polygons.points[positions.reshape(-1)[kept]],
        vertices=vertices,
        faces=faces if polygons.origin is None else polygons.origin[faces],
        values={name: own.reshape(-1, own.shape[-1])[kept] for name, own in primvars.items()},
        dropped=dropped,
    )


def vertex_normals(points: Array, vertices: Array) -> Array:
    """Return normals (P, 3): the mean over the triangles at each point, or zero if there are none.

    Weights are the angles at the point (Thürmer and Wüthrich 1998), so that the mean does not depend on how the
    polygons were cut.
    """
    corners = points[vertices]  # (T, 3, 3)
    ahead = unit(np.roll(corners, -1, axis=1) - corners)
    behind = unit(np.roll(corners, 1, axis=1) - corners)
    angles = np.arccos(np.clip(np.sum(ahead * behind, axis=2), -1.0, 1.0))  # (T, 3)
    faces = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    weighted = (angles[..., None] * faces[:, None]).reshape(-1, 3)
    flat = vertices.reshape(-1)
    sums = np.stack([np.bincount(flat, weighted[:, axis], len(points)) for axis in range(3)], axis=1)
    return unit(sums)


def _mended(normals: Array, triangles: Array) -> Array:
    """Return unit normals (T, 3, 3), with zero normals, which some exporters write, replaced by the triangle's own."""
    missing = ~np.any(normals, axis=-1)
    if missing.any():
        flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normals = np.where(missing[..., None], flat[:, None], normals)
    return unit(normals)


def _welded(positions: Array, values: list[Array]) -> tuple[Array, Array]:
    """Return new vertex indices (T, 3), and for each new vertex the flat index of a corner that it is taken from.

    Corners become one vertex if they share a point and agree in all `values` (T, 3, d) that can differ there.
    """
    identity = positions.reshape(-1).astype(np.int64)
    for each in values:
        for column in each.reshape(-1, each.shape[-1]).T:
            # Combined two at a time, ranks of columns stay small integers, which sort faster than rows.
            _, rank = np.unique(column, return_inverse=True)
            _, identity = np.unique(identity * (int(rank.max(initial=0)) + 1) + rank, return_inverse=True)
    _, kept, inverse = np.unique(identity, return_index=True, return_inverse=True)
    return inverse.reshape(-1, 3), kept
