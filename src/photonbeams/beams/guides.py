"""Beams led along guide curves.

A guide bends space along the line on which it leaves its first point. A point at the distance s along that line, and u
and v beside it, moves to the guide's point at the arc length s, and u and v beside that. The frame of u and v follows
the guide without turning about it (parallel transport; Bishop 1975, by the double reflection of Wang et al. 2008).
So a parallel bundle becomes a bent tube, and a straight guide changes nothing. Space before the guide's first point is
not bent; beyond its last point the guide continues straight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque, padded, to_float, to_vectors
from ..runtime.device import Array3f, Float, UInt32
from ..scene import Array, SceneError, numbers, shown
from ..scene.vectors import unit
from . import Beams
from .bending import BeamPaths, bent_length, pieces

_ROWS = 512  # of a guide's table
# A polyline is a smooth curve where its edges deviate by less than this from the bisector between them (half the turn).
_SMOOTH = float(np.cos(np.radians(10)))
_DEGREES = 4.0  # that a guide turns for each piece of a beam along it
_MOST_PIECES = 96  # of a beam


@dataclass(frozen=True)
class Guide:
    """A guide as tables over its arc length, (_ROWS, 3) each: its points, and the frame that follows it."""

    points: Array
    tangents: Array  # unit vectors
    sides: Array  # unit vectors across the tangents
    length: float  # arc length in scene units

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Guide:
        """Return the guide through `points` (M, 3) of a smooth curve; raise SceneError if it has no length."""
        given = numbers(points, "a guide", "(M, 3) points").astype(np.float64)
        if given.size % 3:
            raise SceneError(f"a guide is {shown(points)}: expected (M, 3) points")
        given = given.reshape(-1, 3)
        given = given[np.append(True, np.any(np.diff(given, axis=0) != 0, axis=1))]
        if len(given) < 2:
            raise SceneError("a guide has fewer than two different points: expected a curve with a length above 0")
        at = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1)))
        s = np.linspace(0, at[-1], _ROWS)
        table = np.stack([np.interp(s, at, axis) for axis in given.T], axis=1)
        edges = np.diff(given, axis=0) / np.diff(at)[:, None]
        # At a point, the polyline's direction is the bisector of its edges; between points it is interpolated.
        between = unit(edges[1:] + edges[:-1])
        directions = np.concatenate([_at_end(edges[:1], between[:1]), between, _at_end(edges[-1:], between[-1:])])
        tangents = unit(np.stack([np.interp(s, at, axis) for axis in directions.T], axis=1))
        return cls(table, tangents, _transported(table, tangents), float(at[-1]))

    @property
    def turn(self) -> float:
        """Total angle by which the guide turns, in degrees."""
        cosine = np.clip(np.sum(self.tangents[1:] * self.tangents[:-1], axis=1), -1, 1)
        return float(np.degrees(np.arccos(cosine)).sum())


def _at_end(edge: Array, inner: Array) -> Array:
    """Return a curve's direction at its end, (1, 3), from its last edge and its direction at the point before.

    A smooth curve continues to turn over its last edge as it did before; after a corner, the last edge is straight.
    """
    if len(inner) and float(edge[0] @ inner[0]) > _SMOOTH:
        return 2 * (edge @ inner.T) * edge - inner
    return edge


def _transported(points: Array, tangents: Array) -> Array:
    """Return a direction across each tangent, carried along without turning about it, by double reflection.

    References
    ----------
    Wang, Jüttler, Zheng, Liu, "Computation of Rotation Minimizing Frames" (2008).
    """
    first = tangents[0]
    side = np.eye(3)[np.argmin(np.abs(first))]
    sides = [unit(side - side @ first * first)]
    for here, there, tangent, following in zip(points, points[1:], tangents, tangents[1:], strict=False):
        step = there - here
        squared = max(float(step @ step), 1e-30)
        left = sides[-1] - 2 / squared * (step @ sides[-1]) * step
        turned = tangent - 2 / squared * (step @ tangent) * step
        second = following - turned
        squared = float(second @ second)
        carried = left if squared < 1e-30 else left - 2 / squared * (second @ left) * second
        sides.append(unit(carried - carried @ following * following))
    return np.array(sides)


def pieces_along(guides: Sequence[Guide]) -> int:
    """Return the number of pieces into which guides bend beams."""
    turn = max((guide.turn for guide in guides), default=0.0)
    return int(np.clip(np.ceil(turn / _DEGREES), 1, _MOST_PIECES))


@lru_cache(maxsize=64)
def _known(points: bytes) -> Guide:
    return Guide.through(np.frombuffer(points, dtype=np.float64))


def known_guides(curves: Sequence[Array]) -> list[Guide]:
    """Return the guides through the points of curves, from a cache, so that passes share them."""
    return [_known(np.ascontiguousarray(points, dtype=np.float64).tobytes()) for points in curves]


def led(beams: Beams, guides: Sequence[Guide], inner: int | None = None) -> Beams:
    """Return beams bent along guides. A light path follows the guide whose first point is nearest to the path's origin.

    `inner` is the number of pieces beside the guide; the default is `pieces_along(guides)`.
    """
    if not guides or not len(beams):
        return beams
    inner = pieces_along(guides) if inner is None else inner
    paths = BeamPaths(beams, "guides")
    table = _GuideTable(guides, paths.origin)
    steps = inner + 2  # one piece before the guide, and one beyond it
    way, _ = _nodes(table, paths, dr.zeros(Float, len(beams)), paths.offset, inner)
    points, places = _nodes(table, paths, paths.offset, paths.length, inner)
    ends = tuple(
        table.bent(paths.origin + at * paths.direction, paths.direction)[1]
        for at in (paths.offset, paths.offset + paths.length)
    )
    dr.eval(ends)
    return pieces(beams, paths, points, places, (ends[0], ends[1]), bent_length(way, len(beams), steps), steps)


def _nodes(table: _GuideTable, paths: BeamPaths, begin: Float, length: Float, inner: int) -> tuple[Array3f, Float]:
    """Return the bent nodes of a part of each path, and their distances from its beginning before bending.

    The part begins at the distance `begin` along the path and has the length `length`. The first and the last node are
    its ends; the others are spread over what lies beside the guide.
    """
    count, each = dr.opaque(UInt32, inner + 2), dr.width(length)
    node = dr.arange(UInt32, each * (inner + 3))
    path, number = node // (count + 1), node % (count + 1)
    low, high = (dr.gather(Float, value, path) for value in table.within(paths, begin, length))
    fraction = (Float(number) - 1) * dr.rcp(Float(dr.opaque(UInt32, inner)))
    end = dr.gather(Float, length, path)
    place = dr.select(number == 0, 0, dr.select(number == count, end, dr.lerp(low, high, fraction)))
    origin, direction = (dr.gather(Array3f, value, path) for value in (paths.origin, paths.direction))
    begun = dr.gather(Float, begin, path)
    points, _ = table.of_paths(path).bent(origin + (begun + place) * direction, direction)
    dr.eval(points, place)
    return points, place


class _GuideTable:
    """The guides' tables, one after the other in device memory, and the index of the guide that each path follows."""

    def __init__(self, guides: Sequence[Guide], origin: Array3f) -> None:
        columns = [
            np.concatenate([getattr(guide, name) for guide in guides]) for name in ("points", "tangents", "sides")
        ]
        self._rows = [to_vectors(column) for column in columns]
        self._lengths = to_float(padded([guide.length for guide in guides]))
        nearest, distance = dr.zeros(UInt32, dr.width(origin)), dr.full(Float, dr.inf, dr.width(origin))
        for index, guide in enumerate(guides):
            away = dr.squared_norm(origin - opaque(guide.points[0]))
            nearest = dr.select(away < distance, dr.opaque(UInt32, index), nearest)
            distance = dr.minimum(away, distance)
        self.chosen = nearest
        dr.eval(self.chosen)

    def of_paths(self, path: UInt32) -> _GuideTable:
        """Return the same tables with a lane for each of these path indices."""
        result = object.__new__(_GuideTable)
        result._rows, result._lengths = self._rows, self._lengths
        result.chosen = dr.gather(UInt32, self.chosen, path)
        return result

    def _row(self, column: int, row: UInt32) -> Array3f:
        return dr.gather(Array3f, self._rows[column], self.chosen * _ROWS + row)

    def within(self, paths: BeamPaths, begin: Float, length: Float) -> tuple[Float, Float]:
        """Return where the parts of paths that lie beside their guide begin and end, as distances from `begin`.

        Both are within 0 and `length`.
        """
        start, axis = self._row(0, UInt32(0)), self._row(1, UInt32(0))
        rate: Any = dr.dot(paths.direction, axis)
        here = dr.dot(paths.origin - start, axis) + begin * rate
        inv = dr.rcp(dr.select(dr.abs(rate) < 1e-6, dr.copysign(1e-6, rate), rate))
        stop = dr.gather(Float, self._lengths, self.chosen)
        ends = [dr.clip(each * inv, 0, length) for each in (-here, stop - here)]
        low, high = dr.minimum(*ends), dr.maximum(*ends)
        dr.eval(low, high)
        return low, high

    def bent(self, point: Array3f, direction: Array3f) -> tuple[Array3f, Array3f]:
        """Return a point and a direction, bent by the guide."""
        start, axis, side = (self._row(column, UInt32(0)) for column in range(3))
        other = dr.cross(axis, side)
        apart = point - start
        s, u, v = dr.dot(apart, axis), dr.dot(apart, side), dr.dot(apart, other)
        length = dr.gather(Float, self._lengths, self.chosen)
        place = dr.clip(s * dr.rcp(length), 0, 1) * (_ROWS - 1)
        row = dr.minimum(UInt32(place), _ROWS - 2)
        weight = place - Float(row)
        middle, tangent, across = (dr.lerp(self._row(c, row), self._row(c, row + 1), weight) for c in range(3))
        tangent = dr.normalize(tangent)
        across = dr.normalize(across - dr.dot(across, tangent) * tangent)
        beside = dr.cross(tangent, across)
        beyond = s - dr.clip(s, 0, length)
        turned = _combined(direction, (axis, side, other), (tangent, across, beside))
        return middle + beyond * tangent + u * across + v * beside, dr.normalize(turned)


def _combined(vector: Array3f, old: Sequence[Array3f], new: Sequence[Array3f]) -> Array3f:
    return sum((dr.dot(vector, a) * b for a, b in zip(old, new, strict=True)), start=Array3f(0))
