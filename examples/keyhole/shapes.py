"""Polygon shapes for the keyhole stage: chamfered boxes, extruded outlines with a hole, surfaces of revolution.

A `Shape` has points, faces and one UV pair per face corner, V along the grain of the wood. It needs only numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

TILE = np.array([0.45, 1.8])  # metres of wood that the texture covers, across and along the grain


@dataclass
class Shape:
    """A polygon mesh: `points` (V, 3), `faces` as lists of indices, `uvs` (corners, 2), `normals` (V, 3) if smooth."""

    points: Array
    faces: list[list[int]]
    uvs: Array
    normals: Array | None = None


def merge(shapes: Sequence[Shape]) -> Shape:
    """Return all `shapes` as one mesh, which is smooth if the first shape is."""
    offsets = np.cumsum([0] + [len(s.points) for s in shapes])
    faces = [[int(o) + i for i in face] for s, o in zip(shapes, offsets, strict=False) for face in s.faces]
    smooth = shapes[0].normals is not None
    return Shape(
        np.concatenate([s.points for s in shapes]),
        faces,
        np.concatenate([s.uvs for s in shapes]),
        np.concatenate([s.normals for s in shapes if s.normals is not None]) if smooth else None,
    )


def placed(shape: Shape, matrix: Array, offset: Sequence[float]) -> Shape:
    """Return `shape` turned by the rotation `matrix` (3, 3) and moved by `offset`."""
    normals = None if shape.normals is None else shape.normals @ matrix.T
    return Shape(shape.points @ matrix.T + np.asarray(offset), shape.faces, shape.uvs, normals)


def _box_uvs(points: Array, faces: list[list[int]], grain: int, shift: Array) -> Array:
    """Project each face along its dominant axis; V follows the `grain` axis, end grain is squeezed to one spot."""
    uvs = []
    for face in faces:
        corners = points[face]
        normal = np.abs(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        across = [axis for axis in range(3) if axis != grain and axis != int(np.argmax(normal))]
        uv = corners[:, [across[0], grain]] / TILE
        uvs.append(uv + shift)
    return np.concatenate(uvs)


def box(
    low: Sequence[float],
    high: Sequence[float],
    chamfer: float = 0.0,
    grain: int = 1,
    shift: Sequence[float] = (0.0, 0.0),
) -> Shape:
    """Return the box between two corners with chamfered edges; `grain` is the axis the wood grows along."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    center, half = (low + high) / 2, (high - low) / 2
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    # Each corner has three points; the k-th lies on the face across axis k. Without a chamfer they coincide.
    keep = 1 if chamfer == 0.0 else 3
    points = np.concatenate([s * (half - chamfer * (1 - np.eye(3)[:keep])) for s in signs])
    quad = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    where = {tuple(s): i for i, s in enumerate(signs)}

    def corner(axis: int, value: float, a: float, b: float) -> int:
        s = np.empty(3)
        s[axis], s[(axis + 1) % 3], s[(axis + 2) % 3] = value, a, b
        return where[tuple(s)]

    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for value in (-1, 1):
            faces.append([keep * corner(axis, value, a, b) + axis % keep for a, b in quad])
        for a, b in quad if chamfer else ():  # the four edges along this axis
            ends = [corner(axis, v, a, b) for v in (-1, 1)]
            faces.append([3 * ends[0] + first, 3 * ends[0] + second, 3 * ends[1] + second, 3 * ends[1] + first])
    if chamfer:
        faces += [[3 * i, 3 * i + 1, 3 * i + 2] for i in range(8)]
    for face in faces:  # the box is convex, so outward is away from its middle
        corners = points[face]
        if np.dot(np.cross(corners[1] - corners[0], corners[2] - corners[0]), corners.mean(axis=0)) < 0:
            face.reverse()
    return Shape(points + center, faces, _box_uvs(points + center, faces, grain, np.asarray(shift)))


def keyhole_outline(center: Sequence[float], height: float, steps: int = 40) -> Array:
    """Return the keyhole's outline (N, 2), counter-clockwise from the lower right corner: a disc above a flared slot.

    `center` is the neck's upper edge, from which every point of the outline is visible; `height` is the total height.
    """
    radius, neck, foot = 0.27 * height, 0.11 * height, 0.24 * height  # half widths of disc, neck and foot
    rise = np.sqrt(radius**2 - neck**2)  # from the neck up to the disc's middle
    bottom = -(height - radius - rise)
    start = -np.arctan2(rise, neck)
    angles = np.linspace(start, np.pi - start, steps)
    disc = np.stack([radius * np.cos(angles), rise + radius * np.sin(angles)], axis=1)
    side = np.linspace((foot, bottom), disc[0], 5)[:-1]
    base = np.linspace((-foot, bottom), (foot, bottom), 5)[1:-1]
    return np.concatenate([side, disc, (side * [-1, 1])[::-1], base]) + np.asarray(center)


def square_outline(low: Sequence[float], high: Sequence[float], center: Sequence[float], rays: Array) -> Array:
    """Return where rays from `center` through the points `rays` (N, 2) leave the rectangle, with its corners hit.

    To hit a corner, the nearest ray's point is moved onto it, so that the outline has as many points as there are rays.
    """
    low, high, center = np.asarray(low), np.asarray(high), np.asarray(center)
    direction = rays - center
    bound = np.where(direction > 0, high - center, low - center)
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.where(np.abs(direction) > 1e-12, bound / direction, np.inf)
    outline = center + direction * steps.min(axis=1, keepdims=True)
    for corner in np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]):
        toward = corner - center
        cosine = (direction @ toward) / np.linalg.norm(direction, axis=1) / np.linalg.norm(toward)
        outline[int(np.argmax(cosine))] = corner
    return outline


def pierced(outer: Array, inner: Array, back: float, front: float, chamfer: float, shift: Sequence[float]) -> Shape:
    """Return the slab between two outlines (N, 2) and two depths along Z: a plank with a hole and its inner wall.

    `chamfer` bevels the edges of hole and slab on the front, and those of the hole on the back.
    """
    count = len(outer)
    hole = inner.mean(axis=0)
    wide = inner + chamfer * (inner - hole) / np.linalg.norm(inner - hole, axis=1, keepdims=True)
    middle = (outer.min(axis=0) + outer.max(axis=0)) / 2
    half = (outer.max(axis=0) - outer.min(axis=0)) / 2
    small = middle + (outer - middle) * (1 - chamfer / half)
    rings = [
        (inner, back + chamfer),
        (wide, back),
        (outer, back),
        (outer, front - chamfer),
        (small, front),
        (wide, front),
        (inner, front - chamfer),
    ]
    points = np.concatenate([np.column_stack([outline, np.full(count, z)]) for outline, z in rings])
    faces = []
    for ring in range(len(rings)):
        a, b = ring * count, (ring + 1) % len(rings) * count
        for i in range(count):
            j = (i + 1) % count
            faces.append([a + i, a + j, b + j, b + i])
    return Shape(points, faces, _box_uvs(points, faces, 1, np.asarray(shift)))


def lathe(profile: Sequence[Sequence[float]], steps: int = 32) -> Shape:
    """Return the smooth surface of revolution about Y of a profile of (radius, height), which runs upward outside."""
    outline = np.asarray(profile, dtype=float)
    tangent = np.gradient(outline, axis=0)
    slope = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    angles = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    turn = np.column_stack([np.cos(angles), np.zeros(steps), -np.sin(angles)])
    up = np.array([0.0, 1.0, 0.0])
    points = np.concatenate([r * turn + y * up for r, y in outline])
    normals = np.concatenate([nr * turn + ny * up for nr, ny in slope])
    faces, uvs = [], []
    for row in range(len(outline) - 1):
        for i in range(steps):
            j = (i + 1) % steps
            faces.append([row * steps + i, row * steps + j, (row + 1) * steps + j, (row + 1) * steps + i])
            uvs += [(i / steps, row), ((i + 1) / steps, row), ((i + 1) / steps, row + 1), (i / steps, row + 1)]
    return Shape(points, faces, np.asarray(uvs, dtype=float) / [1, len(outline) - 1], normals)


def torus(radius: float, thickness: float, steps: int = 36, sides: int = 10) -> Shape:
    """Return a smooth ring about Y of the given radius, `thickness` being the radius of its wire."""
    angles = np.linspace(0, 2 * np.pi, sides + 1)
    shape = lathe(np.column_stack([radius + thickness * np.cos(angles), thickness * np.sin(angles)]), steps)
    a = np.repeat(angles, steps)
    turn = shape.points * [1, 0, 1]
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    shape.normals = np.cos(a)[:, None] * turn + np.sin(a)[:, None] * [0, 1, 0]
    return shape
