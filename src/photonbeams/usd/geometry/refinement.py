"""Subdivision surfaces in NumPy: Catmull and Clark (1978) for polygons, Loop (1987) for triangles.

Edges and vertices may be sharp, for some or all levels (DeRose, Kass and Truong 1998). The rules are those of
OpenSubdiv's documentation: smooth, crease and corner masks, blended where a sharpness ends between two levels. A level
is a sparse matrix from the points of one mesh to those of the next, which refines points, their positions at other
times, and texture coordinates in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ...scene import Array

SHARP = np.inf  # sharpness of a crease or corner that is sharp at all levels, such as the boundary


@dataclass(frozen=True)
class Topology:
    """Faces of a mesh and the sharpness of their edges and vertices.

    Attributes
    ----------
    counts, indices
        (F,) vertices per face, at least 3, and (C,) the point of each face vertex; C is the sum of counts.
    size
        How many points there are.
    edge_sharpness
        (C,) sharpness of the edge from each face vertex to the next one of its face.
    point_sharpness
        (size,) sharpness of each point.
    loop
        Whether the scheme is Loop's, for triangles.
    """

    counts: Array
    indices: Array
    size: int
    edge_sharpness: Array
    point_sharpness: Array
    loop: bool = False

    @cached_property
    def faces(self) -> Array:
        """The face of each face vertex, (C,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def following(self) -> Array:
        """The next face vertex of the same face, (C,)."""
        result = np.arange(1, len(self.indices) + 1)
        ends = np.cumsum(self.counts)
        result[ends - 1] = ends - self.counts
        return result

    @cached_property
    def preceding(self) -> Array:
        """The previous face vertex of the same face, (C,)."""
        result = np.empty_like(self.following)
        result[self.following] = np.arange(len(result))
        return result

    @cached_property
    def edges(self) -> tuple[Array, Array, Array]:
        """The edge of each face vertex (C,), the ends of each edge (E, 2), in order, and its number of faces (E,)."""
        ends = np.sort(np.stack([self.indices, self.indices[self.following]], axis=1), axis=1)
        keys, edge, count = np.unique(ends @ [self.size, 1], return_inverse=True, return_counts=True)
        return edge, np.stack(np.divmod(keys, self.size), axis=1), count

    @cached_property
    def sharpness(self) -> Array:
        """Sharpness of each edge, (E,): infinite at the boundary and at edges with more than two faces."""
        edge, ends, count = self.edges
        result = np.zeros(len(ends))
        np.maximum.at(result, edge, self.edge_sharpness)
        return np.where(count == 2, result, SHARP)

    @property
    def creased(self) -> bool:
        """Whether an edge between faces is sharp."""
        return bool(np.any((self.sharpness > 0) & (self.edges[2] > 1)))

    @property
    def boundary(self) -> Array:
        """Whether a point is on the boundary, (size,)."""
        return self._incident(self.edges[2] == 1) > 0

    def _incident(self, chosen: Array | slice = slice(None)) -> Array:
        """Return how many of the chosen edges meet at each point."""
        return np.bincount(self.edges[1][chosen].reshape(-1), minlength=self.size)

    @property
    def face_counts(self) -> Array:
        """How many faces meet at each point, (size,)."""
        return np.bincount(self.indices, minlength=self.size)

    @property
    def pinched(self) -> Array:
        """Whether the faces at a point are not one fan, (size,); as in OpenSubdiv, it is then a corner."""
        extra = self._incident() - self.face_counts
        return (extra > 1) | ((extra == 1) != self.boundary) | (extra < 0) | (self.face_counts == 0)

    @property
    def children(self) -> int:
        """How many faces the next level has."""
        return 4 * len(self.counts) if self.loop else len(self.indices)

    # -- masks ---------------------------------------------------------------------------------------------------

    def _at_faces(self) -> sparse.csr_array:
        """Return the matrix of sums over the points of each face."""
        return _sums(self.faces, self.indices, (len(self.counts), self.size))

    def _face_points(self) -> sparse.csr_array:
        """Return the matrix of the faces' centers."""
        return _scaled(self._at_faces(), 1 / self.counts)

    def _midpoints(self) -> sparse.csr_array:
        ends = self.edges[1]
        return 0.5 * _sums(np.repeat(np.arange(len(ends)), 2), ends.reshape(-1), (len(ends), self.size))

    def _opposite(self) -> sparse.csr_array:
        """Return the matrix of the mean beside each edge, of face centers or (Loop) of triangles' third points."""
        edge, ends, count = self.edges
        if self.loop:
            beside = _sums(edge, self.indices[self.preceding], (len(ends), self.size))
        else:
            beside = _sums(edge, self.faces, (len(ends), len(self.counts))) @ self._face_points()
        return _scaled(beside, 1 / count)

    def _edge_points(self) -> sparse.csr_array:
        """Return the matrix of new points on edges."""
        inner = (0.25 if self.loop else 0.5) * (1 - np.clip(self.sharpness, 0, 1))
        return _scaled(self._midpoints(), 1 - inner) + _scaled(self._opposite(), inner)

    def _neighbors(self, chosen: Array | slice = slice(None)) -> sparse.csr_array:
        """Return the matrix of sums over the neighbors of each point along the chosen edges."""
        first, last = self.edges[1][chosen].T
        return _sums(np.append(first, last), np.append(last, first), (self.size, self.size))

    def _vertex_points(self) -> sparse.csr_array:
        """Return the matrix of the new positions of points."""
        valence = np.maximum(self._incident(), 1).astype(np.float64)
        if self.loop:
            smooth = self._weighted(_loop_weight(valence), valence)
        else:
            ring = _scaled(self._neighbors() + self._at_faces().T @ self._face_points(), valence**-2)
            smooth = sparse.diags_array(1 - 2 / valence) + ring
        # Where a sharpness ends before the next level, both levels' rules are mixed by the remaining sharpness.
        later, later_points = np.maximum(self.sharpness - 1, 0), np.maximum(self.point_sharpness - 1, 0)
        weight = self._remaining(later, later_points)
        result = _scaled(self._masked(smooth, self.sharpness, self.point_sharpness, 1 / 8), weight)
        if np.all(weight == 1):
            return result
        return result + _scaled(self._masked(smooth, later, later_points, 1 / 8), 1 - weight)

    def _remaining(self, later: Array, later_points: Array) -> Array:
        """Return the mean of the sharpnesses at each point, 0 to 1, that end before the next level; 1 without any."""
        ending, point_ending = (self.sharpness > 0) & (later == 0), (self.point_sharpness > 0) & (later_points == 0)
        total = np.bincount(self.edges[1][ending].reshape(-1), np.repeat(self.sharpness[ending], 2), self.size)
        total = total + np.where(point_ending, self.point_sharpness, 0)
        number = self._incident(ending) + point_ending
        return np.where(number > 0, total / np.maximum(number, 1), 1.0).clip(0, 1)

    def _weighted(self, weight: Array, valence: Array) -> sparse.csr_array:
        """Return the matrix of points and their neighbors, each of which has this weight."""
        return sparse.diags_array(1 - valence * weight) + _scaled(self._neighbors(), weight)

    def _masked(self, smooth: sparse.csr_array, edges: Array, points: Array, beside: float) -> sparse.csr_array:
        """Return the matrix of the smooth, crease and corner rules, each where these sharpnesses ask for it.

        On a crease, both neighbors along it have the weight `beside`.
        """
        sharp = self._incident(edges > 0)
        corner = (points > 0) | (sharp > 2)
        crease = (sharp == 2) & ~corner
        result = _scaled(smooth, ~(crease | corner)) + sparse.diags_array(corner + crease * (1 - 2 * beside))
        return sparse.csr_array(result + _scaled(self._neighbors(edges > 0), crease * beside))

    # -- refining --------------------------------------------------------------------------------------------------

    @cached_property
    def refined(self) -> tuple[Topology, sparse.csr_array]:
        """The mesh of the next level, and the matrix from the points of this mesh to its points."""
        return self._split(), self._stacked(self._vertex_points(), self._edge_points())

    @cached_property
    def linear(self) -> sparse.csr_array:
        """The matrix of the same refinement without smoothing."""
        return self._stacked(sparse.eye_array(self.size), self._midpoints())

    def _stacked(self, *blocks: sparse.csr_array) -> sparse.csr_array:
        return sparse.vstack(blocks if self.loop else [*blocks, self._face_points()], format="csr")

    @property
    def parents(self) -> Array:
        """The face of this level that contains each face of the next."""
        return np.append(self.faces, np.arange(len(self.counts))) if self.loop else self.faces

    def _split(self) -> Topology:
        edge, ends, _ = self.edges
        along, total, before = self.size + edge, self.size + len(ends), self.preceding
        later = np.maximum(self.sharpness - 1, 0)[edge]
        none = np.zeros_like(later)
        corners, sharpnesses = [self.indices, along, along[before]], [later, none, later[before]]
        if not self.loop:
            corners.insert(2, total + self.faces)
            sharpnesses.insert(2, none)
        faces, sharpness = np.stack(corners, axis=1), np.stack(sharpnesses, axis=1)
        if self.loop:  # a triangle in the middle of each
            faces, sharpness = (
                np.append(faces, along.reshape(-1, 3), axis=0),
                np.append(sharpness, none.reshape(-1, 3), axis=0),
            )
        points = np.zeros(total + (0 if self.loop else len(self.counts)))
        points[: self.size] = np.maximum(self.point_sharpness - 1, 0)
        return Topology(
            np.full(len(faces), faces.shape[1]), faces.reshape(-1), len(points),
            edge_sharpness=sharpness.reshape(-1), point_sharpness=points, loop=self.loop,
        )  # fmt: skip

    @cached_property
    def limit(self) -> sparse.csr_array:
        """The matrix from the points to their limit positions; faces must be quads, or triangles for Loop.

        Edges and points that are sharp now count as sharp at all further levels.
        """
        valence = np.maximum(self._incident(), 1).astype(np.float64)
        if self.loop:
            smooth = self._weighted(1 / (valence + 3 / (8 * _loop_weight(valence))), valence)
        else:
            across = self.indices[self.following[self.following]]
            ring = 4 * self._neighbors() + _sums(self.indices, across, (self.size, self.size))
            smooth = sparse.diags_array(valence / (valence + 5)) + _scaled(ring, 1 / (valence * (valence + 5)))
        return self._masked(smooth, self.sharpness, self.point_sharpness, 1 / 6)

    def smoothing_groups(self) -> Array:
        """Return a group number for each face vertex (C,): the same around a point up to sharp edges."""
        edge = self.edges[0]
        order = np.argsort(edge, kind="stable")
        first = np.flatnonzero(np.diff(edge[order]) == 0)
        first = first[self.sharpness[edge[order[first]]] == 0]
        first, second = order[first], order[first + 1]
        opposed = self.indices[first] == self.indices[self.following[second]]
        first, second = first[opposed], second[opposed]
        links = np.concatenate([[first, self.following[second]], [self.following[first], second]], axis=1)
        size = len(self.indices)
        graph = sparse.coo_array((np.ones(links.shape[1]), (links[0], links[1])), shape=(size, size))
        return csgraph.connected_components(graph, directed=False)[1]


def _sums(rows: Array, columns: Array, shape: tuple[int, int]) -> sparse.csr_array:
    """Return the matrix whose rows are sums of values at these columns."""
    return sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)


def _scaled(matrix: sparse.csr_array, rows: Array) -> sparse.csr_array:
    """Return a matrix with its rows scaled."""
    return sparse.diags_array(np.asarray(rows, dtype=np.float64)) @ matrix


def _loop_weight(valence: Array) -> Array:
    """Return Loop's weight of each neighbour of a point."""
    return (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence
