"""Convert NURBS patches and tetrahedra to polygons."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline

from ...scene import Array
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Polygons, Tessellation, Values
from .strands import floats, rational

_PIECES = 8  # between two knots, in u and in v


def read_patch(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return a NurbsPatch evaluated on a grid, without trimming; None, with a warning, if it has no points."""
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
    corners = sparse.kron(_ends(rows), _ends(columns), format="csr")
    numbers = np.arange(len(u) * len(v)).reshape(len(v), len(u))
    quads = np.stack([numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]], axis=-1).reshape(-1)
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


def _direction(reading: Reading, prim: Usd.Prim, name: str) -> tuple[sparse.csr_array, Array]:
    """Return the matrix of basis functions at parameters along u or v, and the parameters scaled to 0 to 1."""
    count, order = (int(reading.value(prim, f"{name}{each}", 0)) for each in ("VertexCount", "Order"))
    knots = floats(reading, prim, f"{name}Knots")
    if not 2 <= order <= count:
        raise reading.fail(prim, f"{name}Order", f"is {order}: expected 2 to {name}VertexCount, {count}")
    if len(knots) != count + order or np.any(np.diff(knots) < 0):
        text = f"has {len(knots)} values: expected {count + order} that do not decrease"
        raise reading.fail(prim, f"{name}Knots", text)
    first, last = knots[order - 1], knots[count]
    given = reading.value(prim, f"{name}Range")
    if given is not None and given[0] < given[1]:
        first, last = max(first, given[0]), min(last, given[1])
    if not first < last:
        raise reading.fail(prim, f"{name}Range", f"is {first:g} to {last:g}: expected an interval of the knots")
    places = np.linspace(first, last, _PIECES * (count - order + 1) + 1)
    return BSpline.design_matrix(places, knots, order - 1), (places - first) / (last - first)


def _ends(basis: sparse.csr_array) -> sparse.csr_array:
    """Return the matrix of linear interpolation between the two ends of a direction."""
    t = np.linspace(0, 1, basis.shape[0])
    return sparse.csr_array(np.stack([1 - t, t], axis=1))


def read_tetrahedra(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return the surface of a TetMesh: the faces that it names, or those that belong to only one tetrahedron."""
    points = reading.array(prim, "points", 3)
    if points is None:
        reading.warn(prim, "has no points: it is skipped")
        return None
    given = reading.array(prim, "surfaceFaceVertexIndices", 3)
    faces = np.zeros((0, 3), dtype=np.int64) if given is None else given.astype(np.int64)
    if given is None:
        outer = UsdGeom.TetMesh.ComputeSurfaceFaces(UsdGeom.TetMesh(prim), reading.time)
        faces = np.array(outer, dtype=np.int64).reshape(-1, 3)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        text = f"names point {faces.max()}: expected points from 0 to {len(points) - 1}"
        raise reading.fail(prim, "tetVertexIndices", text)
    left_handed = reading.value(prim, "orientation") == "leftHanded"
    polygons = Polygons(points, np.full(len(faces), 3), faces.reshape(-1), left_handed=left_handed)
    return Tessellation(polygons, polygons.lengths, lambda values: values)
