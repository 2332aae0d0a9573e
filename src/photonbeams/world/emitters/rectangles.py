"""Openings as rectangles: points of them, directions to them, and the density of these.

Emission, scattering and direct light all send samples to openings: through a portal, to a portal with a margin, and
to the window through which an environment lights a point. Directions have the density per solid angle

    p(ω) = t² / |ω · N|,

where t is the distance to the rectangle and N the cross product of its edges, whose length is the area.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque
from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Float
from ...scene.vectors import Sides


def widened(sides: Sides, margin: float) -> Sides:
    """Return a rectangle that is wider on each side, by a fraction of its width."""
    corner, x, y = sides
    return corner - margin * (x + y), (1 + 2 * margin) * x, (1 + 2 * margin) * y


def mesh_of(name: str, sides: Sides) -> scene.Mesh:
    """Return a rectangle as two triangles."""
    corner, x, y = sides
    points = np.array([corner, corner + x, corner + x + y, corner + y])
    return scene.Mesh(name, points, np.array([[0, 1, 2], [0, 2, 3]]))


class Rectangle(Struct):
    """Rectangles: a corner of each, and the two edges from it."""

    corner: Array3f
    across: Array3f
    up: Array3f

    @classmethod
    def of(cls, sides: Sides) -> Rectangle:
        """Return one rectangle, with opaque numbers."""
        return cls(*map(opaque, sides))

    def point(self, u: Array2f) -> Array3f:
        """Return points, uniform over the rectangle."""
        return self.corner + u.x * self.across + u.y * self.up

    def depth(self, point: Array3f) -> Float:
        """Return the height of points behind the rectangle, times its area: above 0 where N points away from them."""
        return dr.dot(self.corner - point, dr.cross(self.across, self.up))

    def density(self, point: Array3f, direction: Array3f) -> Float:
        """Return the density, per solid angle, of directions from `point` to uniform points; 0 for those that miss."""
        normal: Any = dr.cross(self.across, self.up)
        cosine = dr.dot(direction, normal)
        distance = self.depth(point) * dr.rcp(dr.select(cosine == 0, 1, cosine))
        place: Any = point + distance * direction - self.corner
        area2 = dr.squared_norm(normal)
        x, y = dr.dot(dr.cross(place, self.up), normal), dr.dot(dr.cross(self.across, place), normal)
        met = (cosine != 0) & (distance > 0) & (x >= 0) & (x <= area2) & (y >= 0) & (y <= area2)
        return dr.select(met, dr.square(distance) * dr.rcp(dr.abs(cosine)), 0)
