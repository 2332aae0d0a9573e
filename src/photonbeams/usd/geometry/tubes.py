"""Convert curves and points to surfaces: tubes, ribbons, spheres and discs."""

from __future__ import annotations

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Polygons, Tessellation, Values
from .primvars import find_primvar, read_declared
from .strands import Strands, read_strands
from .velocities import carried

# The most triangles of a prim: hair and particles come in millions, and each needs few.
_MOST_TRIANGLES = 1_000_000
_SIDES = (12, 8, 6, 4, 3)  # of a tube
_SPHERES = (4, 3, 2, 1, 0)  # subdivisions of an octahedron
_DISC = 8  # corners
_ALONG = 0.05  # a normal is parallel to a curve if the sine of the angle between them is below this
_THINNEST = 1 / 500  # width of curves and points without widths, as a fraction of the extent


def read_tubes(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return curves as tubes, or as ribbons if they have normals; None, with a warning, if there are none."""
    strands = read_strands(reading, prim, _MOST_TRIANGLES // (2 * _SIDES[-1]))
    if strands is None:
        return None
    radii = 0.5 * strands.at(_widths(reading, prim, strands.points, strands.lengths))[:, 0]
    normals = _normals(reading, prim, strands.lengths)
    sides = None if normals is None else _sides(strands, strands.at(normals))
    if normals is None or sides is None:
        rings = max((each for each in _SIDES if 2 * each * len(radii) <= _MOST_TRIANGLES), default=_SIDES[-1])
        polygons, node = _tubes(strands, radii, rings)
    else:
        polygons, node = _ribbons(strands, radii[:, None] * sides, strands.at(normals))
    return Tessellation(
        polygons,
        strands.lengths,
        lambda values: values if values.interpolation == "constant" else Values(strands.at(values)[node], "vertex"),
    )


def read_spheres(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return points as spheres, or as discs if they have normals; None, with a warning, if there are none."""
    moved = carried(reading, prim)
    points = moved.points if moved is not None else reading.array(prim, "points", 3)
    if points is None:
        reading.warn(prim, "has no points: it is skipped")
        return None
    total = len(points)
    lengths = {"constant": 1, "uniform": 1, "varying": total, "vertex": total, "faceVarying": total}
    widths = _widths(reading, prim, points, lengths)
    radii = np.broadcast_to(0.5 * widths.values[:, 0], (total,))
    step = max(1, -(-8 * total // _MOST_TRIANGLES))
    if step > 1:
        reading.warn(prim, f"has {total} values: one in {step} is rendered, to limit memory", "points")
    chosen = np.flatnonzero(radii > 0)[::step]
    normals = _normals(reading, prim, lengths)
    if normals is None:
        level = max((each for each in _SPHERES if 8 * 4**each * len(chosen) <= _MOST_TRIANGLES), default=0)
        directions, faces = _sphere(level)
        offsets = radii[chosen, None, None] * directions
        pointing = np.broadcast_to(directions, offsets.shape)
    else:
        axis = unit(np.broadcast_to(normals.values, (total, 3))[chosen])
        offsets, faces = _discs(axis, radii[chosen])
        pointing = np.broadcast_to(axis[:, None], offsets.shape)
    indices = np.arange(len(chosen))[:, None, None] * offsets.shape[1] + faces
    polygons = _of_triangles(points[chosen, None] + offsets, pointing, indices)
    owner = np.repeat(chosen, offsets.shape[1])
    return Tessellation(
        polygons,
        lengths,
        lambda values: (
            Values(values.values[:1], "constant")
            if values.interpolation in ("constant", "uniform")
            else Values(values.values[owner], "vertex")
        ),
    )


def _widths(reading: Reading, prim: Usd.Prim, points: Array, lengths: dict[str, int]) -> Values:
    """Return the widths, which are diameters, or thin ones if there are none, as viewports draw them."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
    found = read_declared(reading, prim, primvar, "widths", 1, lengths, any_fitting=True)
    if found is not None:
        if (least := float(found.values.min(initial=0))) < 0:
            reading.warn(prim, f"holds {least:g}: expected diameters of 0 or more; 0 is used", "widths")
        return Values(np.maximum(found.values, 0), found.interpolation)
    width = _THINNEST * float(np.linalg.norm(np.ptp(points, axis=0)))
    reading.warn(prim, f"is not given: {width:.3g} is used, a fraction of the extent", "widths")
    return Values(np.array([[width]]), "constant")


def _normals(reading: Reading, prim: Usd.Prim, lengths: dict[str, int]) -> Values | None:
    return read_declared(reading, prim, find_primvar(prim, "normals"), "normals", 3, lengths, any_fitting=True)


def _tubes(strands: Strands, radii: Array, sides: int) -> tuple[Polygons, Array]:
    """Return triangles around the strands, and the strands' point for each vertex."""
    first, last = _segments(strands.curve, strands.closed)
    tangents = _tangents(strands.points, first, last)
    across = _transported(tangents, strands.curve)
    other = np.cross(tangents, across)
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * other[:, None]  # (N, sides, 3)
    points = strands.points[:, None] + radii[:, None, None] * around
    here, there = np.arange(sides), np.roll(np.arange(sides), -1)
    a, b = first[:, None] * sides + here, first[:, None] * sides + there
    c, d = last[:, None] * sides + there, last[:, None] * sides + here
    return _triangles(points, around, a, b, c, d), np.repeat(np.arange(len(radii)), sides)


def _sides(strands: Strands, normals: Array) -> Array | None:
    """Return the directions across the curves in which ribbons that face the normals extend, (N, 3).

    Return None if most normals are parallel to their curves, as on hair that carries the normals of the skin: they do
    not tell how a ribbon faces.
    """
    across = np.cross(_tangents(strands.points, *_segments(strands.curve, strands.closed)), unit(normals))
    known = np.linalg.norm(across, axis=1) > _ALONG
    if np.count_nonzero(known) <= 0.5 * len(known):
        return None
    # A point whose normal is parallel to the curve takes the direction of the nearest one before it, or after it.
    order = np.arange(len(known))
    before = np.maximum.accumulate(np.where(known, order, -1))
    after = np.minimum.accumulate(np.where(known, order, len(known))[::-1])[::-1].clip(max=len(known) - 1)
    is_before = (before >= 0) & (strands.curve[before] == strands.curve)
    return unit(across[np.where(is_before, before, after)])


def _ribbons(strands: Strands, sides: Array, normals: Array) -> tuple[Polygons, Array]:
    """Return flat bands that face the normals, and the strands' point for each vertex."""
    first, last = _segments(strands.curve, strands.closed)
    points = np.stack([strands.points - sides, strands.points + sides], axis=1)
    facing = np.repeat(unit(normals)[:, None], 2, axis=1)
    first, last = 2 * first[:, None], 2 * last[:, None]
    return _triangles(points, facing, first, first + 1, last + 1, last), np.repeat(np.arange(len(sides)), 2)


def _triangles(points: Array, normals: Array, a: Array, b: Array, c: Array, d: Array) -> Polygons:
    """Return the triangles abc and acd of points (N, K, 3)."""
    return _of_triangles(points, normals, np.stack([a, b, c, a, c, d], axis=-1))


def _of_triangles(points: Array, normals: Array, indices: Array) -> Polygons:
    """Return triangles with normals at their points (N, K, 3)."""
    indices, facing = indices.reshape(-1), Values(normals.reshape(-1, 3), "vertex")
    return Polygons(points.reshape(-1, 3), np.full(len(indices) // 3, 3), indices, {"normals": facing})


def _segments(curve: Array, closed: bool) -> tuple[Array, Array]:
    """Return the points at both ends of each segment."""
    first = np.flatnonzero(np.diff(curve) == 0)
    last = first + 1
    if closed:
        begins = np.flatnonzero(np.diff(curve, prepend=-1))
        ends = np.append(begins[1:], len(curve)) - 1
        first, last = np.append(first, ends), np.append(last, begins)
    return first, last


def _tangents(points: Array, first: Array, last: Array) -> Array:
    """Return the direction of the curve at each point, (N, 3): the mean of the adjacent segments."""
    directions = unit(points[last] - points[first])
    sums = np.zeros_like(points)
    np.add.at(sums, first, directions)
    np.add.at(sums, last, directions)
    single = ~np.any(sums, axis=1)
    sums[single] = [0.0, 0.0, 1.0]
    return unit(sums)


def _transported(tangents: Array, curve: Array) -> Array:
    """Return a direction across each tangent that turns as little as possible along the curve."""
    result = np.cross(tangents, np.eye(3)[np.argmin(np.abs(tangents), axis=1)])
    begins = np.flatnonzero(np.diff(curve, prepend=-1))
    sizes = np.diff(np.append(begins, len(curve)))
    for step in range(1, int(sizes.max(initial=0))):
        here = begins[sizes > step] + step
        carried_on = result[here - 1]
        across = carried_on - np.einsum("ni,ni->n", carried_on, tangents[here])[:, None] * tangents[here]
        kept = np.linalg.norm(across, axis=1) > 1e-6 * np.linalg.norm(carried_on, axis=1)
        result[here[kept]] = across[kept]
    return unit(result)


def _sphere(level: int) -> tuple[Array, Array]:
    """Return directions (K, 3) and triangles (T, 3) of an octahedron whose faces are quartered `level` times."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(level):
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, edge = np.unique(ends, axis=0, return_inverse=True)
        middle = len(points) + edge.reshape(-1, 3)
        points = unit(np.concatenate([points, points[edges].sum(axis=1)]))
        outer = [np.stack([faces[:, k], middle[:, k], middle[:, k - 1]], axis=1) for k in range(3)]
        faces = np.concatenate([*outer, middle])
    return points, faces


def _discs(axis: Array, radii: Array) -> tuple[Array, Array]:
    """Return the corners (N, K, 3) of discs around their axes, and the triangles of one."""
    across = unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)]))
    other = np.cross(axis, across)
    angle = 2 * np.pi * np.arange(_DISC) / _DISC
    corners = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * other[:, None]
    faces = np.stack([np.zeros(_DISC - 2, int), np.arange(1, _DISC - 1), np.arange(2, _DISC)], axis=1)
    return radii[:, None, None] * corners, faces
