"""Bend straight beams into curved ones, pieces along a vector field or along guide curves.

What bends is the path, not the light's transport: it keeps its radii and its power, falloffs run along it as it is now,
and surfaces on the bent path do not stop it.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..runtime.device import Array3f, Float, UInt32
from ..scene import SceneError
from . import Beams

# A piece shorter than this fraction of its path gets no power.
_SHORTEST = 1e-6


class BeamPaths:
    """Straight beams as whole light paths, from the light on.

    Attributes
    ----------
    origin, direction
        Where the light path of each beam begins, and where it goes.
    offset, length
        Where on it the beam begins, and how long the beam is.
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
    beams: Beams, paths: BeamPaths, points: Any, places: Any, ends: tuple[Any, Any], before: Any, steps: int
) -> Beams:
    """Return beams in so many pieces each, path after path.

    Parameters
    ----------
    points, places
        (N · (steps + 1),) where the nodes of each path are, and how far from the beam's start they were on it.
    ends
        (N,) directions at the beams' starts and ends.
    before
        (N,) how long the bent path is from the light to the beam's start.
    """
    count, each = dr.opaque(UInt32, steps), len(beams)
    lane = dr.arange(UInt32, each * steps)
    path, number = lane // count, lane % count
    first = path * (count + 1) + number

    def node(index: Any) -> Any:
        return dr.gather(Array3f, points, index)

    start, end = node(first), node(first + 1)
    axis = _unit(end - start)
    # Of the neighbours at a path's ends there is none: its own direction there takes the place of a bisector.
    back = _unit(start - node(dr.select(number > 0, first - 1, first)))
    ahead = _unit(node(dr.select(number + 1 < count, first + 2, first + 1)) - end)
    begin, stop = (dr.gather(Array3f, value, path) for value in ends)
    result = Beams()
    result.start, result.end = start, end
    result.start_tangent = dr.select(number > 0, _halfway(back, axis), begin)
    result.end_tangent = dr.select(number + 1 < count, _halfway(axis, ahead), stop)
    length = dr.gather(Float, paths.length, path)
    low, high = dr.gather(Float, places, first), dr.gather(Float, places, first + 1)
    inv = dr.rcp(dr.maximum(length, 1e-20))
    there = (high - low > _SHORTEST * length) & (dr.squared_norm(axis) > 0)

    def along(first_value: Any, last_value: Any, place: Any) -> Any:
        kind = type(first_value)
        a, b = dr.gather(kind, first_value, path), dr.gather(kind, last_value, path)
        return dr.fma(b - a, place * inv, a)

    result.radius_start = dr.maximum(along(beams.radius_start, beams.radius_end, low), 0)
    result.radius_end = dr.maximum(along(beams.radius_start, beams.radius_end, high), 0)
    # Beams without any width are none, whatever their power.
    result.radius_end = dr.maximum(result.radius_end, dr.select(result.radius_start > 0, 0, 1e-9 * length + 1e-20))
    last_power = beams.power if beams.power_end is None else beams.power_end
    result.power = dr.select(there, along(beams.power, last_power, low), 0)
    result.power_end = None if beams.power_end is None else dr.select(there, along(beams.power, last_power, high), 0)
    for name in ("random", "id", "generation"):
        value = getattr(beams, name)
        setattr(result, name, None if value is None else dr.gather(Float, value, path))
    if beams.id is None:  # a path is one beam, whatever its pieces
        result.id = Float(path)
    if beams.end_normal is not None:
        # What stops a path turns with it; within the path it is the plane that two pieces share.
        wall = dr.gather(Array3f, _turned(beams.end_normal, paths.direction, ends[1]), path)
        result.end_normal = dr.select(number + 1 < count, -result.end_tangent, wall)
    along_path = lengths(points, each, steps, before)
    result.offset = dr.gather(Float, along_path, first)
    whole = dr.gather(Float, along_path, path * (count + 1) + count)
    beyond = 0 if beams.total is None else dr.gather(Float, beams.total - paths.offset - paths.length, path)
    result.total = whole + beyond
    if beams.entry is not None:
        # As far into the bent path as it was into the straight one: where the beam begins, for what fog has cut.
        factor = dr.select(paths.offset > 0, before / dr.maximum(paths.offset, 1e-20), 1)
        result.entry = dr.gather(Float, beams.entry * factor, path)
    dr.eval(result)
    return result


def bent_length(points: Any, count: int, steps: int) -> Any:
    """Return (N,) how long the paths through these nodes are."""
    nodes = dr.opaque(UInt32, steps + 1)
    last = dr.arange(UInt32, count) * nodes + (nodes - 1)
    return dr.gather(Float, lengths(points, count, steps, dr.zeros(Float, count)), last)


def lengths(points: Any, count: int, steps: int, before: Any) -> Any:
    """Return (N · (steps + 1),) how far along its path each node is, where the first is `before`."""
    result, nodes = dr.zeros(Float, count * (steps + 1)), dr.opaque(UInt32, steps + 1)
    first = dr.arange(UInt32, count) * nodes
    place = dr.gather(Array3f, points, first)
    dr.scatter(result, before, first)

    def body(i: Any, place: Any, length: Any) -> tuple[Any, Any, Any]:
        following = dr.gather(Array3f, points, first + i)
        length = length + dr.norm(following - place)
        dr.scatter(result, length, first + i)
        return i + 1, following, length

    state = (UInt32(1), place, Float(before) + dr.zeros(Float, count))
    dr.while_loop(state, lambda i, *_: i < nodes, body, label="lengths")
    dr.eval(result)
    return result


def _turned(vector: Any, old: Any, new: Any) -> Any:
    """Return a vector turned as the shortest way from one direction to another turns it (Rodrigues)."""
    cosine, axis = dr.dot(old, new), dr.cross(old, new)
    turned = cosine * vector + dr.cross(axis, vector) + axis * (dr.dot(axis, vector) / dr.maximum(1 + cosine, 1e-6))
    return dr.select(cosine > -0.99, turned, -new)


def _unit(vector: Any) -> Any:
    return vector * dr.rsqrt(dr.maximum(dr.squared_norm(vector), 1e-30))


def _halfway(one: Any, other: Any) -> Any:
    """Return the direction between two; the second, where they are opposed or the first is none."""
    both = one + other
    usable = (dr.squared_norm(both) > 0.25) & (dr.squared_norm(one) > 0) & (dr.squared_norm(other) > 0)
    return dr.select(usable, _unit(both), dr.select(dr.squared_norm(other) > 0, other, one))
