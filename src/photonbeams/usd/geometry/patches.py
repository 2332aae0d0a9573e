"""Convert NURBS patches and tetrahedra to polygons."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...scene import Array
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Polygons, Tessellation, Values, grid_quads
from .strands import floats, nurbs_basis, rational

_PIECES = 8  # between two knots, in u and in v


def read_patch(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return a NurbsPatch evaluated on a grid, without trimming; None, with a warning, if it has no points."""
    from scipy import sparse  # takes long to import

    points = reading.array(prim, "points", 3)
    if points is None:
        reading.warn(prim, "has no points: it is skipped")
        return None
    (rows, v), (columns, u) = (_direction(reading, prim, name) for name in "vu")
    if rows.shape[1] * columns.shape[1] != len(points):
        text = f"has {len(points)} values: expected {rows.shape[1] * columns.shape[1]}, uVertexCount times vVertexCount"
        raise reading.fail(prim, "points", text)
    if len(reading.value(prim, "trimCurve:counts", ())):
        reading.warn(prim, "is not rendered: the patch is rendered without trimming", "trimCurve:counts")
    # Points go by rows of v, u first.
    weighted = rational(reading, prim, sparse.kron(rows, columns, format="csr"))
    corners = np.kron(*(np.stack([1 - each, each], axis=1) for each in (v, u)))  # of the parameters' square
    quads = grid_quads(len(v), len(u)).reshape(-1)
    across, up = np.meshgrid(u, v)
    left_handed = reading.value(prim, "orientation") == "leftHanded"
    uvs = {"uvs": Values(np.stack([across, up], axis=-1).reshape(-1, 2), "vertex")}
    faces = np.full(len(quads) // 4, 4)
    polygons = Polygons(weighted @ points, faces, quads, uvs, left_handed=left_handed, smooth=True)

    def spread(values: Values) -> Values:
        if values.interpolation in ("constant", "uniform"):
            return Values(values.values[:1], "constant")
        return Values((weighted if values.interpolation == "vertex" else corners) @ values.values, "vertex")

    return Tessellation(polygons, {"constant": 1, "uniform": 1, "varying": 4, "vertex": len(points)}, spread)


def _direction(reading: Reading, prim: Usd.Prim, name: str) -> tuple[Any, Array]:
    """Return the matrix of basis functions at parameters along u or v, and the parameters scaled to 0 to 1."""
    count, order = (int(reading.value(prim, f"{name}{each}", 0)) for each in ("VertexCount", "Order"))
    knots = floats(reading, prim, f"{name}Knots")
    if not 2 <= order <= count:
        raise reading.fail(prim, f"{name}Order", f"is {order}: expected 2 to {name}VertexCount, {count}")
    if len(knots) != count + order or np.any(np.diff(knots) < 0):
        text = f"has {len(knots)} values: expected {count + order} that do not decrease"
        raise reading.fail(prim, f"{name}Knots", text)
    ends = np.array(reading.value(prim, f"{name}Range", (0.0, 0.0)))
    basis = nurbs_basis(knots, order, ends if ends[0] < ends[1] else knots[[0, -1]], _PIECES)
    if basis is None:
        raise reading.fail(prim, f"{name}Range", f"is {ends[0]:g} to {ends[1]:g}: expected an interval of the knots")
    return basis


def read_tetrahedra(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return the surface of a TetMesh: the faces that it names, or those that belong to only one tetrahedron."""
    points = reading.array(prim, "points", 3)
    if points is None:
        reading.warn(prim, "has no points: it is skipped")
        return None
    named = reading.array(prim, "surfaceFaceVertexIndices", 3)
    outer = UsdGeom.TetMesh.ComputeSurfaceFaces(UsdGeom.TetMesh(prim), reading.time) if named is None else named
    faces = np.array(outer, dtype=np.int64).reshape(-1, 3)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        text = f"names point {faces.max()}: expected points from 0 to {len(points) - 1}"
        raise reading.fail(prim, "tetVertexIndices", text)
    left_handed = reading.value(prim, "orientation") == "leftHanded"
    polygons = Polygons(points, np.full(len(faces), 3), faces.reshape(-1), left_handed=left_handed)
    return Tessellation(polygons, polygons.lengths, lambda values: values)
