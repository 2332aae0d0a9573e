"""UsdGeom's implicit shapes as polygons: cube, plane, and surfaces of revolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd
from ..common.reading import Reading
from .polygons import Polygons, Values, grid_quads
from .triangles import polygon_normals

GPRIMS = ("Cube", "Sphere", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane")

# With 64 facets around, a silhouette is off by 0.12 % of the radius, less than a pixel for shapes of up to 1600 pixels.
_AROUND = 64
_ARC = 16  # rings from pole to equator
# By how many places coordinates are shifted to bring the tessellator's Z axis to X, Y or Z.
_SHIFTS = {"Z": 0, "X": 1, "Y": -1}
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def gprim_polygons(reading: Reading, prim: Usd.Prim) -> Polygons:
    """Return an implicit shape in its own space, with normals and texture coordinates."""
    kind = str(prim.GetTypeName())
    if kind == "Cube":
        return _cube(_size(reading, prim, "size", 2.0))
    if kind == "Plane":
        polygons = _plane(_size(reading, prim, "width", 2.0), _size(reading, prim, "length", 2.0))
    else:
        polygons = _revolved(_profile(reading, prim, kind))
    shift = _SHIFTS[reading.choice(prim, "axis", "Z", _SHIFTS)]
    normals = polygons.primvars["normals"]
    turned = {**polygons.primvars, "normals": replace(normals, values=np.roll(normals.values, shift, axis=1))}
    return replace(polygons, points=np.roll(polygons.points, shift, axis=1), primvars=turned)


def _size(reading: Reading, prim: Usd.Prim, name: str, default: float) -> float:
    return reading.number(prim, name, default, minimum=0.0)


def _cube(size: float) -> Polygons:
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    normals = unit(polygon_normals(corners[faces]))
    primvars = {"normals": Values(normals, "uniform"), "uvs": Values(np.tile(_SQUARE, (6, 1)), "faceVarying")}
    return Polygons(corners * size / 2, np.full(6, 4), faces.reshape(-1), primvars)


def _plane(width: float, length: float) -> Polygons:
    points = np.column_stack([(_SQUARE - 0.5) * [width, length], np.zeros(4)])
    up = Values(np.array([[0.0, 0.0, 1.0]]), "constant")
    return Polygons(points, np.array([4]), np.arange(4), {"normals": up, "uvs": Values(_SQUARE, "vertex")})


def _profile(reading: Reading, prim: Usd.Prim, kind: str) -> list[Array]:
    """Return the curves whose revolution makes the shape, from the bottom up: rows of r, z and the normal in r and z.

    Each curve is smooth; there is an edge where two curves meet.
    """
    if kind == "Sphere":
        return [_arc(-1.0, 1.0, _size(reading, prim, "radius", 1.0), 0.0)]
    round_ends = kind.startswith("Capsule")
    half = _size(reading, prim, "height", 1.0 if round_ends else 2.0) / 2
    names = ("radiusBottom", "radiusTop") if kind.endswith("_1") else ("radius", "radius")
    bottom, top = (_size(reading, prim, name, 0.5 if round_ends else 1.0) for name in names)
    top = 0.0 if kind == "Cone" else top
    side = _line((bottom, -half), (top, half))
    if round_ends:
        return [_arc(-1.0, 0.0, bottom, -half), side, _arc(0.0, 1.0, top, half)]
    lower = [_line((0.0, -half), (bottom, -half))] if bottom else []
    return [*lower, side, *([_line((top, half), (0.0, half))] if top else [])]


def _arc(begin: float, end: float, radius: float, z: float, rings: int = _ARC) -> Array:
    """Return an arc between two latitudes, which are given in quarter turns."""
    angle = np.linspace(begin, end, round((end - begin) * rings) + 1) * (np.pi / 2)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normal[np.abs(np.abs(angle) - np.pi / 2) < 1e-9, 0] = 0.0  # poles are exactly points
    return np.hstack([normal * radius + [0.0, z], normal])


def _line(begin: tuple[float, float], end: tuple[float, float]) -> Array:
    along, up = unit(np.subtract(end, begin))
    return np.array([[*begin, up, -along], [*end, up, -along]])


def unit_sphere(around: int) -> Polygons:
    """Return a sphere of radius 1 with so many facets around."""
    return _revolved([_arc(-1.0, 1.0, 1.0, 0.0, around // 4)], around)


def _revolved(curves: list[Array], around: int = _AROUND) -> Polygons:
    """Return the surface of revolution of curves about Z; neighbouring facets of a curve share normals."""
    rows, sizes = np.concatenate(curves), [len(curve) for curve in curves]
    number = np.repeat(np.arange(len(curves)), sizes)  # the curve of each row
    first = np.flatnonzero(np.diff(number) == 0)  # rows below a ring of facets
    column = np.arange(around + 1)
    angle = 2 * np.pi * (column % around) / around  # the last column lies exactly on the first: the shape is closed
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (C, 2)
    points, normals = (
        np.dstack([part[:, :1, None] * circle, np.broadcast_to(part[:, 1:, None], (len(rows), len(column), 1))])
        for part in (rows[:, :2], rows[:, 2:])
    )
    uvs = np.dstack(np.meshgrid(column / around, (np.arange(len(rows)) - number) / len(first)))
    quads = grid_quads(len(rows), len(column))[first].reshape(-1)
    primvars = {"normals": Values(normals.reshape(-1, 3), "vertex"), "uvs": Values(uvs.reshape(-1, 2), "vertex")}
    return Polygons(points.reshape(-1, 3), np.full(len(quads) // 4, 4), quads, primvars)
