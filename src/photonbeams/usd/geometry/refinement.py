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
    def _edges(self) -> tuple[Array, Array, Array]:
        """The edge of each face vertex (C,), the ends of each edge (E, 2), and its number of faces (E,)."""
        ends = np.sort(np.stack([self.indices, self.indices[self.following]], axis=1), axis=1)
        keys, edge, count = np.unique(ends[:, 0] * self.size + ends[:, 1], return_inverse=True, return_counts=True)
        return edge, np.stack(np.divmod(keys, self.size), axis=1), count

    @cached_property
    def sharpness(self) -> Array:
        """Sharpness of each edge, (E,): infinite at the boundary and at edges with more than two faces."""
        edge, ends, count = self._edges
        result = np.zeros(len(ends))
        np.maximum.at(result, edge, self.edge_sharpness)
        return np.where(count == 2, result, SHARP)

    @property
    def creased(self) -> bool:
        """Whether an edge between faces is sharp."""
        return bool(np.any((self.sharpness > 0) & (self._edges[2] > 1)))

    @property
    def boundary(self) -> Array:
        """Whether a point is on the boundary, (size,)."""
        return self._incident(self._edges[2] == 1) > 0

    def _incident(self, chosen: Array) -> Array:
        """Return how many of the chosen edges meet at each point."""
        return np.bincount(self._edges[1][chosen].reshape(-1), minlength=self.size)

    def face_counts(self) -> Array:
        """Return how many faces meet at each point, (size,)."""
        return np.bincount(self.indices, minlength=self.size)

    def pinched(self) -> Array:
        """Return whether the faces at a point are not one fan, (size,); as in OpenSubdiv, it is then a corner."""
        extra = self._incident(np.ones(len(self._edges[1]), dtype=bool)) - self.face_counts()
        return (extra > 1) | ((extra == 1) != self.boundary) | (extra < 0) | (self.face_counts() == 0)

    # -- masks ---------------------------------------------------------------------------------------------------

    def _rules(self, sharpness: Array, points: Array) -> tuple[Array, Array]:
        """Return whether each point follows the crease rule, and whether the corner rule."""
        sharp = self._incident(sharpness > 0)
        corner = (points > 0) | (sharp > 2)
        return (sharp == 2) & ~corner, corner

    def _blended(self) -> list[tuple[Array, Array, Array, Array]]:
        """Return (weight, crease, corner, sharp edges) for the rules of this level and of the next, for each point."""
        later, later_points = np.maximum(self.sharpness - 1, 0), np.maximum(self.point_sharpness - 1, 0)
        own = self._rules(self.sharpness, self.point_sharpness)
        next_ = self._rules(later, later_points)
        # Where a sharpness ends before the next level, the two rules are mixed by the remaining sharpness.
        ending = (self.sharpness > 0) & (later == 0)
        ends = self._edges[1]
        total = np.bincount(ends[ending].reshape(-1), np.repeat(self.sharpness[ending], 2), self.size)
        number = self._incident(ending).astype(np.float64)
        vertex_ending = (self.point_sharpness > 0) & (later_points == 0)
        total, number = total + np.where(vertex_ending, self.point_sharpness, 0), number + vertex_ending
        weight = np.where(number > 0, total / np.maximum(number, 1), 1.0).clip(0, 1)
        return [(weight, *own, self.sharpness > 0), (1 - weight, *next_, later > 0)]

    def _face_points(self) -> sparse.csr_array:
        """Return the matrix of the faces' centers."""
        return sparse.csr_array(
            (1 / self.counts[self.faces], (self.faces, self.indices)), shape=(len(self.counts), self.size)
        )

    def _midpoints(self) -> sparse.csr_array:
        ends = self._edges[1]
        rows = np.repeat(np.arange(len(ends)), 2)
        return sparse.csr_array((np.full(len(rows), 0.5), (rows, ends.reshape(-1))), shape=(len(ends), self.size))

    def _opposite(self) -> sparse.csr_array:
        """Return the matrix of the mean beside each edge, of face centers or (Loop) of triangles' third points."""
        edge, ends, count = self._edges
        shape = (len(ends), len(self.counts))
        weight = 1 / count[edge]
        if self.loop:
            return sparse.csr_array((weight, (edge, self.indices[self.preceding])), shape=(len(ends), self.size))
        return sparse.csr_array((weight, (edge, self.faces)), shape=shape) @ self._face_points()

    def _edge_points(self) -> sparse.csr_array:
        """Return the matrix of new points on edges."""
        sharp = np.clip(self.sharpness, 0, 1)
        smooth = 0.75 * self._midpoints() + 0.25 * self._opposite()
        if not self.loop:
            smooth = 0.5 * self._midpoints() + 0.5 * self._opposite()
        return _scaled(smooth, 1 - sharp) + _scaled(self._midpoints(), sharp)

    def _neighbors(self, chosen: Array | None = None) -> sparse.csr_array:
        """Return the matrix of sums over the neighbors of each point along the chosen edges."""
        ends = self._edges[1] if chosen is None else self._edges[1][chosen]
        both = np.concatenate([ends, ends[:, ::-1]])
        return sparse.csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(self.size, self.size))

    def _around(self, values: sparse.csr_array) -> sparse.csr_array:
        """Return the matrix of sums of face values over the faces at each point."""
        shape = (self.size, len(self.counts))
        return sparse.csr_array((np.ones(len(self.indices)), (self.indices, self.faces)), shape=shape) @ values

    def _vertex_points(self) -> sparse.csr_array:
        """Return the matrix of the new positions of points."""
        valence = np.maximum(self._incident(np.ones(len(self._edges[1]), dtype=bool)), 1).astype(np.float64)
        if self.loop:
            weight = _loop_weight(valence)
            smooth = sparse.diags_array(1 - valence * weight) + _scaled(self._neighbors(), weight)
        else:
            ring = _scaled(self._neighbors() + self._around(self._face_points()), valence**-2)
            smooth = sparse.diags_array(1 - 2 / valence) + ring
        return self._mixed(smooth, (6 / 8, 1 / 8))

    def _mixed(self, smooth: sparse.csr_array, crease_mask: tuple[float, float]) -> sparse.csr_array:
        """Return the matrix of the smooth, crease and corner rules, each where it applies."""
        result = sparse.csr_array((self.size, self.size))
        for weight, crease, corner, sharp in self._blended():
            if not weight.any():
                continue
            own, beside = crease_mask
            result += _scaled(smooth, weight * ~(crease | corner))
            result += sparse.diags_array(weight * (corner + own * crease))
            result += _scaled(self._neighbors(sharp), weight * crease * beside)
        return result

    # -- refining --------------------------------------------------------------------------------------------------

    def refined(self) -> tuple[Topology, sparse.csr_array]:
        """Return the mesh of the next level, and the matrix from the points of this mesh to its points."""
        blocks = [self._vertex_points(), self._edge_points(), *([] if self.loop else [self._face_points()])]
        return self._split(), sparse.vstack(blocks, format="csr")

    def linear(self) -> sparse.csr_array:
        """Return the matrix of the same refinement without smoothing."""
        blocks = [sparse.eye_array(self.size), self._midpoints(), *([] if self.loop else [self._face_points()])]
        return sparse.vstack(blocks, format="csr")

    def parents(self) -> Array:
        """Return the face of this level that contains each face of the next."""
        return np.repeat(np.arange(len(self.counts)), 4) if self.loop else self.faces

    def _split(self) -> Topology:
        edge, ends, _ = self._edges
        along, total = self.size + edge, self.size + len(ends)
        later = np.maximum(self.sharpness - 1, 0)[edge]
        none = np.zeros_like(later)
        before = self.preceding
        faces = np.stack([self.indices, along, total + self.faces, along[before]], axis=1)
        sharpness = np.stack([later, none, none, later[before]], axis=1)
        if self.loop:
            corners = np.stack([self.indices, along, along[before]], axis=1).reshape(-1, 3, 3)
            faces = np.concatenate([corners, along.reshape(-1, 1, 3)], axis=1).reshape(-1, 3)
            outer = np.stack([later, none, later[before]], axis=1).reshape(-1, 3, 3)
            sharpness = np.concatenate([outer, np.zeros((len(outer), 1, 3))], axis=1).reshape(-1, 3)
        size = total + (0 if self.loop else len(self.counts))
        points = np.zeros(size)
        points[: self.size] = np.maximum(self.point_sharpness - 1, 0)
        return Topology(
            np.full(len(faces), faces.shape[1]), faces.reshape(-1), size, sharpness.reshape(-1), points, self.loop
        )

    def limit(self) -> sparse.csr_array:
        """Return the matrix from the points to their limit positions; faces must be quads, or triangles for Loop.

        Edges and points that are sharp now count as sharp at all further levels.
        """
        lasting = np.where(self.sharpness > 0, SHARP, 0.0)
        crease, corner = self._rules(lasting, self.point_sharpness)
        valence = np.maximum(self._incident(np.ones(len(lasting), dtype=bool)), 1).astype(np.float64)
        if self.loop:
            ring = 1 / (valence + 3 / (8 * _loop_weight(valence)))
            smooth = sparse.diags_array(1 - valence * ring) + _scaled(self._neighbors(), ring)
        else:
            across = self.indices[self.following[self.following]]
            diagonal = sparse.csr_array((np.ones(len(across)), (self.indices, across)), shape=(self.size, self.size))
            smooth = sparse.diags_array(valence / (valence + 5)) + _scaled(
                4 * self._neighbors() + diagonal, 1 / (valence * (valence + 5))
            )
        result = _scaled(smooth, ~(crease | corner)) + sparse.diags_array(corner + crease * (4 / 6))
        return sparse.csr_array(result + _scaled(self._neighbors(lasting > 0), crease / 6))

    def smoothing_groups(self) -> Array:
        """Return a group number for each face vertex (C,): the same around a point up to sharp edges."""
        edge = self._edges[0]
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


def _scaled(matrix: sparse.csr_array, rows: Array) -> sparse.csr_array:
    """Return a matrix with its rows scaled."""
    return sparse.diags_array(np.asarray(rows, dtype=np.float64)) @ matrix


def _loop_weight(valence: Array) -> Array:
    """Return Loop's weight of each neighbour of a point."""
    return (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence
