"""Refine subdivision meshes of a stage to the limit surface, as UsdGeomMesh describes it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...scene import Array
from ..common.openusd import Usd
from ..common.reading import Reading
from .polygons import MOST_FACES, Polygons, Values, mean_normals
from .refinement import SHARP, Topology
from .strands import floats

_SHARPEST = 10.0  # a sharpness from here on is infinite, as in OpenSubdiv


def subdivided(reading: Reading, prim: Usd.Prim, polygons: Polygons, level: int) -> Polygons:
    """Return a subdivision mesh refined `level` times, with its points on the limit surface, and normals.

    Polygons that no rule changes, such as single quads, are returned as they are, and so are dense meshes.
    """
    loop = reading.value(prim, "subdivisionScheme") == "loop"
    if loop and np.any(polygons.counts != 3):
        reading.warn(prim, "is 'loop': expected only triangles; the mesh is not subdivided", "subdivisionScheme")
        return polygons
    cage = polygons.chosen(polygons.counts >= 3)
    size, corners = len(cage.points), len(cage.indices)
    flat = Topology(cage.counts, cage.indices, size, np.zeros(corners), point_sharpness=np.zeros(size), loop=loop)
    # The rules do not hold for a face that has the same point twice in a row.
    if not corners or np.any(cage.indices[flat.following] == cage.indices):
        return polygons
    boundary = reading.value(prim, "interpolateBoundary", "edgeAndCorner")
    topology = _sharpened(reading, prim, flat, boundary)
    inner = np.ones(len(cage.counts), dtype=bool)
    if boundary == "none":
        inner[topology.faces[topology.boundary[cage.indices]]] = False
    # Faces that share no points, and have no rounded corners, stay as they are.
    changes = boundary != "edgeAndCorner" or bool(np.any(topology.face_counts > 1))
    if not changes or topology.children > MOST_FACES:
        return _with_normals(cage, topology).chosen(inner)
    channels = str(reading.value(prim, "faceVaryingLinearInterpolation", "cornersPlus1"))
    refined, topology = _refined(cage, topology, level, channels)
    result = _with_normals(refined, topology).chosen(inner[refined.origins])
    return replace(result, origin=cage.origins[result.origins])


def _sharpened(reading: Reading, prim: Usd.Prim, flat: Topology, boundary: str) -> Topology:
    """Return a mesh's topology with its creases, corners and boundary; `boundary` is its interpolateBoundary."""
    points = np.zeros(flat.size)
    corners = reading.integers(prim, "cornerIndices")
    sharpness = _sharpness(reading, prim, "cornerSharpnesses", len(corners))
    if sharpness is not None:
        valid = (corners >= 0) & (corners < flat.size)
        np.maximum.at(points, corners[valid], sharpness[valid])
    points[flat.pinched] = SHARP
    if boundary == "edgeAndCorner":
        points[flat.boundary & (flat.face_counts == 1)] = SHARP
    return replace(flat, edge_sharpness=_creases(reading, prim, flat), point_sharpness=points)


def _creases(reading: Reading, prim: Usd.Prim, flat: Topology) -> Array:
    """Return the sharpness of the edge from each face vertex to the next, (C,)."""
    edge, ends, _ = flat.edges
    result = np.zeros(len(ends))
    indices, lengths = reading.integers(prim, "creaseIndices"), reading.integers(prim, "creaseLengths")
    if len(lengths) and (np.any(lengths < 2) or lengths.sum() != len(indices)):
        text = f"sums to {lengths.sum()}: expected {len(indices)}, as many as creaseIndices; creases are left out"
        reading.warn(prim, text, "creaseLengths")
        return result[edge]
    # A crease of n points has n − 1 edges; it has one sharpness, or one for each of them.
    first = np.setdiff1d(np.arange(len(indices)), np.cumsum(lengths) - 1)
    sharpness = _sharpness(reading, prim, "creaseSharpnesses", len(lengths), len(first))
    if sharpness is None:
        return result[edge]
    if len(sharpness) != len(first):
        sharpness = np.repeat(sharpness, lengths)[first]
    keys = ends @ [flat.size, 1]
    creased = np.sort(np.stack([indices[first], indices[first + 1]], axis=1), axis=1) @ [flat.size, 1]
    place = np.searchsorted(keys, creased).clip(max=len(keys) - 1)
    there = keys[place] == creased
    result[place[there]] = sharpness[there]
    return result[edge]


def _sharpness(reading: Reading, prim: Usd.Prim, name: str, *counts: int) -> Array | None:
    """Return sharpnesses, or None, with a warning if their number is none of these."""
    if not counts[0]:
        return None
    values = floats(reading, prim, name)
    if len(values) not in counts:
        reading.warn(prim, f"has {len(values)} values: expected {counts[0]} numbers; they are left out", name)
        return None
    return np.where(values >= _SHARPEST, SHARP, np.maximum(values, 0))


@dataclass(frozen=True)
class _RefinedValues:
    """Values at the points of a mesh, which are refined with it; `linear` ones are not smoothed.

    Face-varying values have a mesh of their own, with seams where they differ between faces.
    """

    topology: Topology
    values: Array
    linear: bool = False

    def refined(self) -> _RefinedValues:
        """Return the values of the next level."""
        finer, smooth = self.topology.refined
        return _RefinedValues(finer, (self.topology.linear if self.linear else smooth) @ self.values, self.linear)

    def limit(self) -> Array:
        """Return the values on the limit surface."""
        return self.values if self.linear else self.topology.limit @ self.values


def _refined(cage: Polygons, topology: Topology, level: int, linear: str) -> tuple[Polygons, Topology]:
    """Return a mesh refined `level` times, or as memory allows, at the limit; its origins are faces of the cage.

    `linear` is its faceVaryingLinearInterpolation.
    """
    # Normals of the cage are not those of the surface: UsdGeomMesh ignores them on subdivision meshes.
    primvars = {name: values for name, values in cage.primvars.items() if name != "normals"}
    points, channels = _RefinedValues(topology, cage.points), {}
    for name, values in primvars.items():
        if values.interpolation == "faceVarying":
            channels[name] = _with_seams(values.values, topology, linear)
        elif values.interpolation in ("vertex", "varying"):
            channels[name] = _RefinedValues(topology, values.values, values.interpolation == "varying")
    origin = np.arange(len(cage.counts))
    while level and points.topology.children <= MOST_FACES:
        origin = origin[points.topology.parents]
        points, channels = points.refined(), {name: each.refined() for name, each in channels.items()}
        level -= 1
    for name, values in primvars.items():
        kind, numbers = values.interpolation, channels[name].limit() if name in channels else values.values
        if kind == "uniform":
            numbers = numbers[origin]
        elif kind == "faceVarying":
            numbers = numbers[channels[name].topology.indices]
        primvars[name] = Values(numbers, kind)
    finest = points.topology
    refined = replace(cage, points=points.limit(), counts=finest.counts, indices=finest.indices)
    return replace(refined, primvars=primvars, origin=origin), finest


def _with_seams(values: Array, topology: Topology, linear: str) -> _RefinedValues:
    """Return face-varying values of a cage as points of a mesh; `linear` is its faceVaryingLinearInterpolation."""
    together = np.column_stack([topology.indices, values])
    points, first, index = np.unique(together, axis=0, return_index=True, return_inverse=True)
    owner = topology.indices[first]
    flat = replace(topology, indices=index.reshape(-1), size=len(first), point_sharpness=np.zeros(len(first)))
    sharp, seams = topology.point_sharpness[owner], flat.boundary
    sharp[seams] = 0
    if linear == "boundaries":
        sharp[seams] = SHARP
    elif linear != "none":
        sharp[seams & (flat.face_counts == 1)] = SHARP
        if linear != "cornersOnly":
            # Where three charts or more meet, and where charts meet the end of a seam.
            charts = np.bincount(owner, minlength=topology.size)
            sharp[seams & (charts[owner] > 2)] = SHARP
    sharp[flat.pinched] = SHARP
    return _RefinedValues(replace(flat, point_sharpness=sharp), points[:, 1:], linear == "all")


def _with_normals(polygons: Polygons, topology: Topology) -> Polygons:
    """Return smooth polygons, with normals that are split at sharp inner edges, if there are any."""
    if "normals" in polygons.primvars or not topology.creased:
        return replace(polygons, smooth=True)
    groups = topology.smoothing_groups()
    corners = polygons.points[topology.indices]
    ahead, behind = corners[topology.following] - corners, corners[topology.preceding] - corners
    means = mean_normals(groups, ahead, behind, int(groups.max()) + 1)
    normals = means[groups] * (-1 if polygons.left_handed else 1)
    return replace(polygons, primvars={"normals": Values(normals, "faceVarying"), **polygons.primvars})
