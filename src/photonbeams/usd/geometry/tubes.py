"""Convert curves and points to surfaces: tubes, ribbons, spheres and discs."""

from __future__ import annotations

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd
from ..common.reading import Reading
from .gprims import unit_sphere
from .polygons import Polygons, Tessellation, Values
from .primvars import read_primvar
from .strands import Strands, read_strands
from .velocities import PointSample

# The most triangles of a prim: hair and particles come in millions, and each needs few.
_MOST_TRIANGLES = 1_000_000
_SIDES = (12, 8, 6, 4, 3)  # of a tube
_SPHERES = (64, 32, 16, 8, 4)  # facets around
_DISC = 8  # corners
_CUT = [0, 1, 2, 0, 2, 3]  # of a quad, two triangles
_ALONG = 0.05  # a normal is parallel to a curve if the sine of the angle between them is below this
_THINNEST = 1 / 500  # width of curves and points without widths, as a fraction of the extent


def read_tubes(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return curves as tubes, or as ribbons if they have normals; None, with a warning, if there are none."""
    strands = read_strands(reading, prim, _MOST_TRIANGLES // (2 * _SIDES[-1]))
    if strands is None:
        return None
    radii = 0.5 * strands.at(_widths(reading, prim, strands.points, strands.lengths))[:, 0]
    normals = _normals(reading, prim, strands.lengths)
    facing = None if normals is None else unit(strands.at(normals))
    sides = None if facing is None else _sides(strands, facing)
    if facing is None or sides is None:
        count = max((each for each in _SIDES if 2 * each * len(radii) <= _MOST_TRIANGLES), default=_SIDES[-1])
        around = _circles(strands.tangents, _transported(strands.tangents, strands.curve), count)
        polygons = _swept(strands, radii[:, None, None] * around, around)
    else:
        across = radii[:, None] * sides
        polygons = _swept(strands, np.stack([-across, across], axis=1), np.stack([facing, facing], axis=1))
    node = np.repeat(np.arange(len(radii)), len(polygons.points) // len(radii))
    return Tessellation(
        polygons,
        strands.lengths,
        lambda values: values if values.interpolation == "constant" else Values(strands.at(values)[node], "vertex"),
    )


def read_spheres(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return points as spheres, or as discs if they have normals; None, with a warning, if there are none."""
    points = PointSample.of(reading, prim).points
    if points is None:
        reading.warn(prim, "has no points: it is skipped")
        return None
    total = len(points)
    lengths = {"constant": 1, "uniform": 1, "varying": total, "vertex": total, "faceVarying": total}
    radii = np.broadcast_to(0.5 * _widths(reading, prim, points, lengths).values[:, 0], (total,))
    step = max(1, -(-8 * total // _MOST_TRIANGLES))
    if step > 1:
        reading.warn(prim, f"has {total} values: one in {step} is rendered, to limit memory", "points")
    chosen = np.flatnonzero(radii > 0)[::step]
    normals = _normals(reading, prim, lengths)
    if normals is None:
        around = max((each for each in _SPHERES if each**2 * len(chosen) <= _MOST_TRIANGLES), default=_SPHERES[-1])
        sphere = unit_sphere(around)
        directions = np.broadcast_to(sphere.points, (len(chosen), *sphere.points.shape))
        facing, faces = directions, sphere.indices.reshape(-1, 4)[:, _CUT]
    else:
        axis = unit(np.broadcast_to(normals.values, (total, 3))[chosen])
        directions = _circles(axis, _perpendicular(axis), _DISC)
        facing = np.broadcast_to(axis[:, None], directions.shape)
        faces = np.stack([np.zeros(_DISC - 2, int), np.arange(1, _DISC - 1), np.arange(2, _DISC)], axis=1)
    count = directions.shape[1]
    indices = np.arange(len(chosen))[:, None, None] * count + faces
    polygons = _triangles(points[chosen, None] + radii[chosen, None, None] * directions, facing, indices)
    owner = np.repeat(chosen, count)

    def spread(values: Values) -> Values:
        if values.interpolation in ("constant", "uniform"):
            return Values(values.values[:1], "constant")
        return Values(values.values[owner], "vertex")

    return Tessellation(polygons, lengths, spread)


def _widths(reading: Reading, prim: Usd.Prim, points: Array, lengths: dict[str, int]) -> Values:
    """Return the widths, which are diameters, or thin ones if there are none, as viewports draw them."""
    widths = read_primvar(reading, prim, "widths", 1, lengths=lengths, any_fitting=True)
    if widths is not None:
        if (least := float(widths.values.min(initial=0))) < 0:
            reading.warn(prim, f"holds {least:g}: expected diameters of 0 or more; 0 is used", "widths")
        return Values(np.maximum(widths.values, 0), widths.interpolation)
    width = _THINNEST * float(np.linalg.norm(np.ptp(points, axis=0)))
    reading.warn(prim, f"is not given: {width:.3g} is used, a fraction of the extent", "widths")
    return Values(np.array([[width]]), "constant")


def _normals(reading: Reading, prim: Usd.Prim, lengths: dict[str, int]) -> Values | None:
    return read_primvar(reading, prim, "normals", 3, lengths=lengths, any_fitting=True)


def _swept(strands: Strands, offsets: Array, normals: Array) -> Polygons:
    """Return the surface through cross-sections of curves, which are closed if they have more than two points.

    `offsets` and `normals`, (N, K, 3), are those of the cross-section at each point.
    """
    count = offsets.shape[1]
    here = np.arange(count if count > 2 else 1)
    there = (here + 1) % count
    first, last = (count * each[:, None] for each in strands.segments)
    quads = np.stack([first + here, first + there, last + there, last + here], axis=-1)
    return _triangles(strands.points[:, None] + offsets, normals, quads[..., _CUT])


def _circles(axis: Array, across: Array, count: int) -> Array:
    """Return directions (N, count, 3) around axes, from a direction across each."""
    angle = 2 * np.pi * np.arange(count) / count
    other = np.cross(axis, across)
    return np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * other[:, None]


def _perpendicular(axis: Array) -> Array:
    """Return a direction across each axis."""
    return unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)]))


def _sides(strands: Strands, normals: Array) -> Array | None:
    """Return the directions across the curves in which ribbons that face the normals extend, (N, 3).

    Return None if most normals are parallel to their curves, as on hair that carries the normals of the skin: they do
    not tell how a ribbon faces.
    """
    across = np.cross(strands.tangents, normals)
    known = np.linalg.norm(across, axis=1) > _ALONG
    if np.count_nonzero(known) <= 0.5 * len(known):
        return None
    # A point whose normal is parallel to the curve takes the direction of the nearest one before it, or after it.
    order = np.arange(len(known))
    before = np.maximum.accumulate(np.where(known, order, -1))
    after = np.minimum.accumulate(np.where(known, order, len(known))[::-1])[::-1].clip(max=len(known) - 1)
    is_before = (before >= 0) & (strands.curve[before] == strands.curve)
    return unit(across[np.where(is_before, before, after)])


def _triangles(points: Array, normals: Array, indices: Array) -> Polygons:
    """Return triangles with normals at their points (N, K, 3)."""
    indices, facing = indices.reshape(-1), Values(normals.reshape(-1, 3), "vertex")
    return Polygons(points.reshape(-1, 3), np.full(len(indices) // 3, 3), indices, {"normals": facing})


def _transported(tangents: Array, curve: Array) -> Array:
    """Return a direction across each tangent that turns as little as possible along the curve."""
    result = _perpendicular(tangents)
    begins = np.flatnonzero(np.diff(curve, prepend=-1))
    sizes = np.diff(np.append(begins, len(curve)))
    for step in range(1, int(sizes.max(initial=0))):
        here = begins[sizes > step] + step
        before = result[here - 1]
        across = before - np.sum(before * tangents[here], axis=1, keepdims=True) * tangents[here]
        turned = np.linalg.norm(across, axis=1) > 1e-6 * np.linalg.norm(before, axis=1)
        result[here[turned]] = across[turned]
    return unit(result)
