"""Bend straight beams into pieces of curves, along a vector field or along guide curves.

This bends the path and not the light transport: a beam keeps its radii and its power, falloffs run along the bent path,
and surfaces on the bent path do not stop it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from ..numerics.arrays import near_one
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import SceneError
from . import Beams

# A piece shorter than this fraction of its path gets no power.
_SHORTEST = 1e-6


class BeamPaths:
    """Straight beams as whole light paths that begin at the light.

    Attributes
    ----------
    origin, direction
        Origin and unit direction of each beam's light path, (N, 3); the direction of a beam without length is 0.
    offset, length
        Distance along the path at which the beam begins, and the beam's length, (N,), in scene units.
    """

    def __init__(self, beams: Beams, user: str) -> None:
        if beams.start_tangent is not None:
            raise SceneError(f"{user} is given beams that are bent already: expected straight ones")
        step = beams.end - beams.start
        self.length = dr.norm(step)
        self.direction = step * dr.select(self.length > 0, dr.rcp(self.length), 0)
        self.offset = beams.offset if beams.offset is not None else dr.zeros(Float, len(beams))
        self.origin = beams.start - self.offset * self.direction
        dr.eval(self.length, self.direction, self.offset, self.origin)


def pieces(
    beams: Beams, paths: BeamPaths, points: Array3f, places: Float, ends: tuple[Array3f, Array3f], before: Float,
    steps: int,
) -> Beams:  # fmt: skip
    """Return beams cut into pieces that follow bent paths, path after path.

    Parameters
    ----------
    beams, paths
        The straight beams, and their light paths.
    points
        (N · (steps + 1), 3) bent positions of each path's nodes.
    places
        (N · (steps + 1),) distance of each node from its beam's start, on the straight path.
    ends
        Directions at the beams' starts and at their ends, (N, 3) each, on the bent path.
    before
        (N,) length of the bent path from the light to the beam's start.
    steps
        Number of pieces of each beam.
    """
    count, each = dr.opaque(UInt32, steps), len(beams)
    lane = dr.arange(UInt32, each * steps)
    path, number = lane // count, lane % count
    first = path * (count + 1) + number

    result = Beams()
    _set_ends(
        result, points, first, number > 0, number + 1 < count, [dr.gather(Array3f, value, path) for value in ends]
    )
    length = dr.gather(Float, paths.length, path)
    low, high = dr.gather(Float, places, first), dr.gather(Float, places, first + 1)
    inv = dr.rcp(dr.maximum(length, 1e-20))
    there = (high - low > _SHORTEST * length) & (dr.squared_norm(_unit(result.end - result.start)) > 0)

    def along(first_value: Float | Array3f, last_value: Float | Array3f, place: Float) -> Any:
        kind = type(first_value)
        a, b = dr.gather(kind, first_value, path), dr.gather(kind, last_value, path)
        return dr.fma(b - a, place * inv, a)

    result.radius_start = dr.maximum(along(beams.radius_start, beams.radius_end, low), 0)
    result.radius_end = dr.maximum(along(beams.radius_start, beams.radius_end, high), 0)
    # Beams need a width: one of the radii has to be above 0.
    result.radius_end = dr.maximum(result.radius_end, dr.select(result.radius_start > 0, 0, 1e-9 * length + 1e-20))
    last_power = beams.power if beams.power_end is None else beams.power_end
    result.power = dr.select(there, along(beams.power, last_power, low), 0)
    result.power_end = None if beams.power_end is None else dr.select(there, along(beams.power, last_power, high), 0)
    for name in ("random", "id", "generation"):
        value = getattr(beams, name)
        setattr(result, name, None if value is None else dr.gather(Float, value, path))
    if beams.id is None:  # all pieces of a path are one beam
        result.id = Float(path)
    if beams.end_normal is not None:
        # The surface that stops a path turns with it. Within the path, the normal is that of the plane between pieces.
        wall = dr.gather(Array3f, _turned(beams.end_normal, paths.direction, ends[1]), path)
        result.end_normal = dr.select(number + 1 < count, -result.end_tangent, wall)  # type: ignore[operator]
    along_path = lengths(points, each, steps, before)
    _set_distances(result, beams, paths, along_path, (path, first, path * (count + 1) + count), before)
    dr.eval(result)
    return result


def _set_distances(
    result: Beams, beams: Beams, paths: BeamPaths, along_path: Float, index: tuple[UInt32, UInt32, UInt32],
    before: Float,
) -> None:  # fmt: skip
    """Set the offset, total and entry of pieces.

    `along_path` is the distance of each node along its path, and `index` that of each piece's path, of its first node
    and of its path's last node.
    """
    path, first, last = index
    result.offset = dr.gather(Float, along_path, first)
    whole = dr.gather(Float, along_path, last)
    beyond = 0 if beams.total is None else dr.gather(Float, beams.total - paths.offset - paths.length, path)
    result.total = whole + beyond
    if beams.entry is not None:
        # The medium begins at the same fraction of the bent path before the beam as of the straight one. Where a
        # medium's boundary has cut the beam, that is the beam's start.
        factor = dr.select(paths.offset > 0, before / dr.maximum(paths.offset, 1e-20), 1)
        result.entry = dr.gather(Float, beams.entry * factor, path)


def _set_ends(
    result: Beams, points: Array3f, first: UInt32, joins: Bool, continues: Bool, ends: Sequence[Array3f]
) -> None:
    """Set the ends and tangents of pieces between nodes `first` and `first` + 1.

    `joins` and `continues` are where a piece precedes and follows, `ends` the directions (N, 3) where none does.
    """

    def node(index: UInt32) -> Array3f:
        return dr.gather(Array3f, points, index)

    start, end = node(first), node(first + 1)
    axis = _unit(end - start)
    # A path's ends have no neighbour: the path's own direction replaces the bisector there.
    back = _unit(start - node(dr.select(joins, first - 1, first)))
    ahead = _unit(node(dr.select(continues, first + 2, first + 1)) - end)
    result.start, result.end = start, end
    result.start_tangent = dr.select(joins, _halfway(back, axis), ends[0])
    result.end_tangent = dr.select(continues, _halfway(axis, ahead), ends[1])


def bent_length(points: Array3f, count: int, steps: int) -> Float:
    """Return the lengths, (N,), of the paths through these nodes."""
    nodes = dr.opaque(UInt32, steps + 1)
    last = dr.arange(UInt32, count) * nodes + (nodes - 1)
    return dr.gather(Float, lengths(points, count, steps, dr.zeros(Float, count)), last)


def lengths(points: Array3f, count: int, steps: int, before: Float) -> Float:
    """Return the distance of each node along its path, (N · (steps + 1),); that of a path's first node is `before`."""
    result, nodes = dr.zeros(Float, count * (steps + 1)), dr.opaque(UInt32, steps + 1)
    first = dr.arange(UInt32, count) * nodes
    place = dr.gather(Array3f, points, first)
    dr.scatter(result, before, first)

    def body(i: UInt32, place: Array3f, length: Float) -> tuple[UInt32, Array3f, Float]:
        following = dr.gather(Array3f, points, first + i)
        length = length + dr.norm(following - place)
        dr.scatter(result, length, first + i)
        return i + 1, following, length

    state = (UInt32(1), place, Float(before) + dr.zeros(Float, count))
    dr.while_loop(state, lambda i, *_: i < nodes, body, label="lengths")
    dr.eval(result)
    return result


def _turned(vector: Array3f, old: Array3f, new: Array3f) -> Array3f:
    """Return a vector, rotated by the shortest rotation from one unit direction to another (Rodrigues)."""
    cosine, axis = dr.dot(old, new), dr.cross(old, new)
    turned = cosine * vector + dr.cross(axis, vector) + axis * (dr.dot(axis, vector) / dr.maximum(1 + cosine, 1e-6))
    return dr.select(cosine > -0.99, turned, -new)


def _unit(vector: Array3f) -> Array3f:
    vector = near_one(vector)
    return vector * dr.rsqrt(dr.maximum(dr.squared_norm(vector), 1e-30))


def _halfway(one: Array3f, other: Array3f) -> Array3f:
    """Return the bisector of two unit directions.

    If they nearly oppose each other, return the second; if one of them is zero, return the other one.
    """
    both = one + other
    usable = (dr.squared_norm(both) > 0.25) & (dr.squared_norm(one) > 0) & (dr.squared_norm(other) > 0)
    return dr.select(usable, _unit(both), dr.select(dr.squared_norm(other) > 0, other, one))
