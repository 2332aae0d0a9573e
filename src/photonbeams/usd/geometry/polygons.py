"""Polygons in a prim's own space, and their triangles: the step between USD's meshes and the renderer's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from .triangles import triangulate

#: The most faces of a mesh after refinement: more would fill memory, and meshes as dense as this are already smooth.
MOST_FACES = 250_000


@dataclass(frozen=True)
class Values:
    """A flattened primvar: `values` (K, d), and the `interpolation` as UsdGeom names it."""

    values: Array
    interpolation: str

    @property
    def per_point(self) -> bool:
        """Whether all corners at a point have the same value."""
        return self.interpolation in ("constant", "vertex", "varying")

    def of_parts(self, number: Array) -> Array:
        """Return the value of the curve or face with each number, or the constant, (N, d)."""
        return self.values[number if self.interpolation == "uniform" else np.zeros_like(number)]

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

    `origin` are the `origins` of faces; None: the faces are the stage's.
    """

    points: Array  # (P, 3)
    counts: Array  # (F,)
    indices: Array  # (sum of counts,)
    primvars: Mapping[str, Values] = field(default_factory=dict)  # normals, uvs, and those for fields of the material
    left_handed: bool = False
    smooth: bool = False  # whether to compute normals if there are none
    origin: Array | None = None

    @property
    def origins(self) -> Array:
        """The face of the stage's mesh that each face is part of, (F,)."""
        return np.arange(len(self.counts)) if self.origin is None else self.origin

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
        kept = {"uniform": faces, "faceVarying": corners}
        primvars = {
            name: replace(own, values=own.values[kept[own.interpolation]]) if own.interpolation in kept else own
            for name, own in self.primvars.items()
        }
        counts, indices, origin = self.counts[faces], self.indices[corners], self.origins[faces]
        return replace(self, counts=counts, indices=indices, origin=origin, primvars=primvars)


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
    lasting: bool = False  # whether they are the same at all times
    parts: dict[bytes, Triangles] = field(default_factory=dict, init=False)  # those of some faces

    def of_faces(self, faces: Array) -> Triangles:
        """Return only the triangles of the stage's polygons with these numbers: the same object for the same faces."""
        key = faces.tobytes()
        if key not in self.parts:
            chosen = np.isin(self.faces, faces)
            kept, vertices = np.unique(self.vertices[chosen], return_inverse=True)
            values = {name: own[kept] for name, own in self.values.items()}
            part = replace(self, points=self.points[kept], vertices=vertices.reshape(-1, 3), values=values)
            self.parts[key] = replace(part, faces=self.faces[chosen])
        return self.parts[key]


def grid_quads(rows: int, columns: int) -> Array:
    """Return the quads between points that are numbered by rows, (rows − 1, columns − 1, 4)."""
    points = np.arange(rows * columns).reshape(rows, columns)
    return np.stack([points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]], axis=-1)


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
        points = polygons.points[positions]  # (T, 3, 3)
        edges = np.roll(points, -1, axis=1) - points, np.roll(points, 1, axis=1) - points
        primvars["normals"] = mean_normals(positions, *edges, len(polygons.points))[positions]
    split = [primvars[name] for name, own in polygons.primvars.items() if not own.per_point]
    vertices, kept = _welded(positions, split)
    return Triangles(
        points=polygons.points[positions.reshape(-1)[kept]],
        vertices=vertices,
        faces=polygons.origins[faces],
        values={name: own.reshape(-1, own.shape[-1])[kept] for name, own in primvars.items()},
        dropped=dropped,
    )


def mean_normals(groups: Array, ahead: Array, behind: Array, count: int) -> Array:
    """Return the mean normals (count, 3) of groups of corners, or zero for a group without any.

    Weights are the angles at the corners (Thürmer and Wüthrich 1998), so that the mean does not depend on how the
    polygons were cut.

    Parameters
    ----------
    groups
        (…) the group of each corner.
    ahead, behind
        (…, 3) the edges from each corner to the next and the previous one of its face.
    """
    ahead, behind = unit(ahead), unit(behind)
    angles = np.arccos(np.sum(ahead * behind, axis=-1).clip(-1, 1))
    weighted = (angles[..., None] * unit(np.cross(ahead, behind))).reshape(-1, 3)
    sums = [np.bincount(groups.reshape(-1), weighted[:, axis], count) for axis in range(3)]
    return unit(np.stack(sums, axis=1))


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
