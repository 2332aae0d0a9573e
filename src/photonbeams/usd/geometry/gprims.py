"""UsdGeom's implicit shapes as polygons: cube, plane, and surfaces of revolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd
from ..common.reading import Reading
from .polygons import Polygons, Values

GPRIMS = ("Cube", "Sphere", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane")

# With 64 facets around, a silhouette is off by 0.12 % of the radius, less than a pixel for shapes of up to 1600 pixels.
_AROUND = 64
_ARC = 16  # rings from pole to equator
# Rotations that bring the tessellator's Z axis to X, Y or Z by cycling the axes, so that no shape is mirrored.
_TURNS = {"Z": (0, 1, 2), "X": (2, 0, 1), "Y": (1, 2, 0)}


def gprim_polygons(reading: Reading, prim: Usd.Prim) -> Polygons:
    """Return an implicit shape in its own space, with normals and texture coordinates."""
    kind = str(prim.GetTypeName())
    if kind == "Cube":
        return _cube(_size(reading, prim, "size", 2.0))
    if kind == "Plane":
        polygons = _plane(_size(reading, prim, "width", 2.0), _size(reading, prim, "length", 2.0))
    else:
        polygons = _revolved(_profile(reading, prim, kind))
    turn = list(_TURNS[reading.choice(prim, "axis", "Z", _TURNS)])
    normals = polygons.primvars["normals"]
    turned = {**polygons.primvars, "normals": replace(normals, values=normals.values[:, turn])}
    return replace(polygons, points=polygons.points[:, turn], primvars=turned)


def _size(reading: Reading, prim: Usd.Prim, name: str, default: float) -> float:
    return reading.number(prim, name, default, minimum=0.0)


def _cube(size: float) -> Polygons:
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    normals = np.array([[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], dtype=float)
    square = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float), (6, 1))
    return Polygons(
        corners * size / 2,
        np.full(6, 4),
        faces.reshape(-1),
        {"normals": Values(normals, "uniform"), "uvs": Values(square, "faceVarying")},
    )


def _plane(width: float, length: float) -> Polygons:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    points = np.column_stack([(square - 0.5) * [width, length], np.zeros(4)])
    up = Values(np.array([[0.0, 0.0, 1.0]]), "constant")
    return Polygons(points, np.array([4]), np.arange(4), {"normals": up, "uvs": Values(square, "vertex")})


def _profile(reading: Reading, prim: Usd.Prim, kind: str) -> list[Array]:
    """Return the curves whose revolution makes the shape, from the bottom up: rows of r, z and the normal in r and z.

    Each curve is smooth; there is an edge where two curves meet.
    """
    if kind == "Sphere":
        return [_arc(-1.0, 1.0, _size(reading, prim, "radius", 1.0), 0.0)]
    half = _size(reading, prim, "height", 1.0 if kind.startswith("Capsule") else 2.0) / 2
    fallback = 0.5 if kind.startswith("Capsule") else 1.0
    if kind.endswith("_1"):
        bottom = _size(reading, prim, "radiusBottom", fallback)
        top = _size(reading, prim, "radiusTop", fallback)
    else:
        bottom = top = _size(reading, prim, "radius", fallback)
    top = 0.0 if kind == "Cone" else top
    side = _line((bottom, -half), (top, half))
    if kind.startswith("Capsule"):
        return [_arc(-1.0, 0.0, bottom, -half), side, _arc(0.0, 1.0, top, half)]
    lower = [_line((0.0, -half), (bottom, -half))] if bottom else []
    return [*lower, side, *([_line((top, half), (0.0, half))] if top else [])]


def _arc(begin: float, end: float, radius: float, z: float) -> Array:
    """Return an arc between two latitudes, which are given in quarter turns."""
    angle = np.linspace(begin, end, round((end - begin) * _ARC) + 1) * (np.pi / 2)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normal[np.abs(np.abs(angle) - np.pi / 2) < 1e-9, 0] = 0.0  # poles are exactly points
    return np.hstack([normal * radius + [0.0, z], normal])


def _line(begin: tuple[float, float], end: tuple[float, float]) -> Array:
    tangent = unit(np.subtract(end, begin))
    return np.array([[*begin, tangent[1], -tangent[0]], [*end, tangent[1], -tangent[0]]])


def _revolved(curves: list[Array]) -> Polygons:
    """Return the surface of revolution of curves about Z; neighbouring facets of a curve share normals."""
    rows, sizes = np.concatenate(curves), [len(curve) for curve in curves]
    number = np.repeat(np.arange(len(curves)), sizes)  # the curve of each row
    first = np.flatnonzero(np.diff(number) == 0)  # rows below a ring of facets
    column = np.arange(_AROUND + 1)
    angle = 2 * np.pi * (column % _AROUND) / _AROUND  # the last column lies exactly on the first: the shape is closed
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (C, 2)
    points, normals = (
        np.dstack([part[:, :1, None] * around, np.broadcast_to(part[:, 1:, None], (len(rows), len(column), 1))])
        for part in (rows[:, :2], rows[:, 2:])
    )
    uvs = np.dstack(np.meshgrid(column / _AROUND, (np.arange(len(rows)) - number) / len(first)))
    grid = np.arange(len(rows) * len(column)).reshape(len(rows), -1)
    low, high = grid[first], grid[first + 1]
    quads = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=-1).reshape(-1)
    primvars = {"normals": Values(normals.reshape(-1, 3), "vertex"), "uvs": Values(uvs.reshape(-1, 2), "vertex")}
    return Polygons(points.reshape(-1, 3), np.full(len(quads) // 4, 4), quads, primvars)
