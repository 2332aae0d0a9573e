"""Refine subdivision meshes of a stage to the limit surface, as UsdGeomMesh describes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd
from ..common.reading import Reading
from .polygons import Polygons, Values
from .refinement import SHARP, Topology
from .strands import floats

# The most faces of a mesh after refinement: more would fill memory, and meshes as dense as this are already smooth.
MOST_FACES = 250_000
_SHARPEST = 10.0  # a sharpness from here on is infinite, as in OpenSubdiv


def subdivided(reading: Reading, prim: Usd.Prim, polygons: Polygons, scheme: str, level: int) -> Polygons:
    """Return a subdivision mesh refined `level` times, with its points on the limit surface, and normals.

    Polygons that no rule changes, such as single quads, are returned as they are, and so are dense meshes.
    """
    if scheme == "loop" and np.any(polygons.counts != 3):
        reading.warn(prim, "is 'loop': expected only triangles; the mesh is not subdivided", "subdivisionScheme")
        return polygons
    cage = polygons.chosen(polygons.counts >= 3)
    if not len(cage.counts) or _repeats(cage):
        return polygons
    topology = _topology(reading, prim, cage, scheme == "loop")
    if reading.value(prim, "interpolateBoundary", "edgeAndCorner") == "none":
        inner = ~np.isin(np.arange(len(cage.counts)), topology.faces[topology.boundary[cage.indices]])
    else:
        inner = np.ones(len(cage.counts), dtype=bool)
    refined = _Refined(cage, topology)
    if _connected(reading, prim, topology):
        channels = str(reading.value(prim, "faceVaryingLinearInterpolation", "cornersPlus1"))
        refined = refined.to(level, channels)
    result = refined.smoothed()
    return result.chosen(inner[refined.parents])


def _connected(reading: Reading, prim: Usd.Prim, topology: Topology) -> bool:
    """Return whether faces share points or have rounded corners; other faces stay as they are."""
    rounded = reading.value(prim, "interpolateBoundary", "edgeAndCorner") != "edgeAndCorner"
    return rounded or bool(np.any(topology.face_counts() > 1))


def _repeats(cage: Polygons) -> bool:
    """Return whether a face has the same point twice in a row, for which the rules of subdivision do not hold."""
    ends = np.cumsum(cage.counts)
    following = np.roll(cage.indices, -1)
    following[ends - 1] = cage.indices[ends - cage.counts]
    return bool(np.any(following == cage.indices))


def _topology(reading: Reading, prim: Usd.Prim, cage: Polygons, loop: bool) -> Topology:
    """Return the mesh's topology with its creases, corners and boundary."""
    size = len(cage.points)
    flat = Topology(cage.counts, cage.indices, size, np.zeros(len(cage.indices)), np.zeros(size), loop)
    points = np.zeros(size)
    corners = reading.integers(prim, "cornerIndices")
    sharpness = _sharpness(reading, prim, "cornerSharpnesses", len(corners))
    if sharpness is not None:
        valid = (corners >= 0) & (corners < size)
        np.maximum.at(points, corners[valid], sharpness[valid])
    points[flat.pinched()] = SHARP
    if reading.value(prim, "interpolateBoundary", "edgeAndCorner") == "edgeAndCorner":
        points[flat.boundary & (flat.face_counts() == 1)] = SHARP
    edges = _creases(reading, prim, flat)
    return replace(flat, edge_sharpness=edges, point_sharpness=points)


def _creases(reading: Reading, prim: Usd.Prim, flat: Topology) -> Array:
    """Return the sharpness of the edge from each face vertex to the next, (C,)."""
    result = np.zeros(len(flat.indices))
    indices, lengths = reading.integers(prim, "creaseIndices"), reading.integers(prim, "creaseLengths")
    if not len(lengths):
        return result
    if np.any(lengths < 2) or lengths.sum() != len(indices):
        text = f"sums to {lengths.sum()}: expected {len(indices)}, as many as creaseIndices; creases are left out"
        reading.warn(prim, text, "creaseLengths")
        return result
    # A crease of n points has n − 1 edges; it has one sharpness, or one for each of them.
    last = np.cumsum(lengths) - 1
    first = np.setdiff1d(np.arange(len(indices)), last)
    crease = np.repeat(np.arange(len(lengths)), lengths)[first]
    authored = floats(reading, prim, "creaseSharpnesses")
    sharpness = _sharpness(reading, prim, "creaseSharpnesses", len(first if len(authored) == len(first) else lengths))
    if sharpness is None:
        return result
    sharpness = sharpness if len(authored) == len(first) else sharpness[crease]
    ends = np.sort(np.stack([indices[first], indices[first + 1]], axis=1), axis=1)
    own = np.sort(np.stack([flat.indices, flat.indices[flat.following]], axis=1), axis=1)
    keys, authored_keys = own @ [flat.size, 1], ends @ [flat.size, 1]
    order = np.argsort(authored_keys, kind="stable")
    place = np.minimum(np.searchsorted(authored_keys[order], keys), len(order) - 1)
    found = order[place]
    return np.where(authored_keys[found] == keys, sharpness[found], 0.0)


def _sharpness(reading: Reading, prim: Usd.Prim, name: str, count: int) -> Array | None:
    """Return `count` sharpnesses, or None, with a warning if their number is another."""
    if not count:
        return None
    values = floats(reading, prim, name)
    if len(values) != count:
        reading.warn(prim, f"has {len(values)} values: expected {count} numbers; they are left out", name)
        return None
    return np.where(values >= _SHARPEST, SHARP, np.maximum(values, 0))


class _Refined:
    """A mesh at some level, with its topology, and the face of the cage that contains each face."""

    def __init__(self, polygons: Polygons, topology: Topology, parents: Array | None = None) -> None:
        self.polygons, self.topology = polygons, topology
        self.parents = np.arange(len(polygons.counts)) if parents is None else parents

    def to(self, level: int, channels: str) -> _Refined:
        """Return the mesh refined `level` times, or as often as memory allows, moved to the limit."""
        if not level or _children(self.topology) > MOST_FACES:
            return self
        # Normals of the cage are not those of the surface: UsdGeomMesh ignores them on subdivision meshes.
        primvars = {name: values for name, values in self.polygons.primvars.items() if name != "normals"}
        refined = _Refined(replace(self.polygons, primvars=primvars), self.topology, self.parents)
        seams = {
            name: _Seams.of(values, self.topology, channels)
            for name, values in primvars.items()
            if values.interpolation == "faceVarying"
        }
        while level and _children(refined.topology) <= MOST_FACES:
            refined = refined._next(seams)
            seams = {name: each.next() for name, each in seams.items()}
            level -= 1
        return refined._at_limit(seams)

    def _next(self, seams: dict[str, _Seams]) -> _Refined:
        topology, matrix = self.topology.refined()
        primvars = dict(self.polygons.primvars)
        for name, values in self.polygons.primvars.items():
            if values.interpolation in ("vertex", "varying"):
                own = matrix if values.interpolation == "vertex" else self.topology.linear()
                primvars[name] = Values(own @ values.values, values.interpolation)
            elif values.interpolation == "uniform":
                primvars[name] = Values(values.values[self.topology.parents()], "uniform")
        parents, own = self.topology.parents(), self.polygons.origin
        polygons = replace(
            self.polygons, points=matrix @ self.polygons.points, counts=topology.counts, indices=topology.indices,
            origin=parents if own is None else own[parents], primvars=primvars,
        )  # fmt: skip
        return _Refined(polygons, topology, self.parents[parents])

    def _at_limit(self, seams: dict[str, _Seams]) -> _Refined:
        matrix = self.topology.limit()
        primvars = {
            name: Values(matrix @ own.values, "vertex") if own.interpolation == "vertex" else own
            for name, own in self.polygons.primvars.items()
        }
        primvars |= {name: each.at_limit() for name, each in seams.items()}
        polygons = replace(self.polygons, points=matrix @ self.polygons.points, primvars=primvars)
        return _Refined(polygons, self.topology, self.parents)

    def smoothed(self) -> Polygons:
        """Return the polygons, with normals that are split at sharp inner edges, if there are any."""
        topology, polygons = self.topology, self.polygons
        if "normals" in polygons.primvars or not topology.creased:
            return replace(polygons, smooth=True)
        groups = topology.smoothing_groups()
        corners = polygons.points[topology.indices]
        ahead, behind = corners[topology.following] - corners, corners[topology.preceding] - corners
        cosines = np.einsum("ij,ij->i", unit(ahead), unit(behind)).clip(-1, 1)
        weighted = np.arccos(cosines)[:, None] * unit(np.cross(ahead, behind))
        sums = np.stack([np.bincount(groups, weighted[:, axis]) for axis in range(3)], axis=1)
        normals = unit(sums)[groups] * (-1 if polygons.left_handed else 1)
        return replace(polygons, primvars={"normals": Values(normals, "faceVarying"), **polygons.primvars})


class _Seams:
    """Face-varying values as the points of a mesh of their own, which has seams where values differ between faces."""

    def __init__(self, values: Array, topology: Topology, linear: bool) -> None:
        self.values, self.topology, self.linear = values, topology, linear

    @classmethod
    def of(cls, values: Values, topology: Topology, channels: str) -> _Seams:
        """Return the mesh of a primvar on a cage; `channels` is its faceVaryingLinearInterpolation."""
        together = np.column_stack([topology.indices, values.values])
        points, first, index = np.unique(together, axis=0, return_index=True, return_inverse=True)
        index = index.reshape(-1)
        owner = topology.indices[first]
        flat = Topology(
            topology.counts, index, len(first), topology.edge_sharpness, np.zeros(len(first)), topology.loop
        )
        sharp = topology.point_sharpness[owner].copy()
        seams = flat.boundary
        sharp[seams] = 0
        if channels == "boundaries":
            sharp[seams] = SHARP
        elif channels != "none":
            sharp[seams & (flat.face_counts() == 1)] = SHARP
            if channels != "cornersOnly":
                # Where three charts or more meet, and where charts meet the end of a seam.
                charts = np.bincount(owner, minlength=topology.size)
                sharp[seams & (charts[owner] > 2)] = SHARP
        sharp[flat.pinched()] = SHARP
        return cls(points[:, 1:], replace(flat, point_sharpness=sharp), channels == "all")

    def next(self) -> _Seams:
        """Return the mesh of the next level."""
        topology, matrix = self.topology.refined()
        return _Seams((self.topology.linear() if self.linear else matrix) @ self.values, topology, self.linear)

    def at_limit(self) -> Values:
        """Return the values at the limit, for each face vertex."""
        values = self.values if self.linear else self.topology.limit() @ self.values
        return Values(values[self.topology.indices], "faceVarying")


def _children(topology: Topology) -> int:
    return 4 * len(topology.counts) if topology.loop else len(topology.indices)
