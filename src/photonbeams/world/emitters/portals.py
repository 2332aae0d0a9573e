"""Portals: the openings through which light reaches a shot, and points on them.

Nearly all portals are planar. Stratified points are sampled in the tight bounding rectangle of such a portal, and those
that miss the portal are dropped: an outline such as a keyhole's costs candidates, but not stratification.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque
from ...runtime.device import Array2f, Array3f, Bool, Float, mitsuba
from ...scene.vectors import FLAT
from ..bounds import Bounds
from ..surfaces.shapes import scene_of, shape_of
from .lamp import Lamp
from .rays import GRAZING, EmittedRays, isotropic
from .rectangles import Rectangle, mesh_of, widened

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene

mi = mitsuba()

# How much wider than the portal its surround is on each side, as a fraction of the portal's width.
_SURROUND = 0.3


class Portal:
    """An opening, as a small Mitsuba scene of its own; `host` is explained in `scene_of`.

    Attributes
    ----------
    area
        The area over which sampled points are uniform: that of the bounding rectangle; if not planar, of the portal.
    fill
        The fraction of candidates that lie on the portal.
    sides
        A corner of the bounding rectangle and the two edges from it, float64; None if the portal is not planar.
    """

    def __init__(self, mesh: scene.Mesh, shape: Any, host: MiScene) -> None:
        area = mesh.area
        if not area > 0:
            raise scene.SceneError(f"{mesh.name}: the portal has no area, so no light passes it")
        self.shape, self._host = shape, host
        self.scene = scene_of([shape], host)
        plane = mesh.plane()
        self.sides = mesh.rectangle()
        self.area = area if self.sides is None else float(np.linalg.norm(np.cross(self.sides[1], self.sides[2])))
        self.fill = min(1.0, area / self.area)
        if plane is not None and self.sides is not None:
            self._rectangle, self._normal = Rectangle.of(self.sides), opaque(plane.normal)
            self._lift = opaque(2 * FLAT * plane.extent)  # from where rays look for the portal

    @cached_property
    def surround(self) -> Portal | None:
        """The bounding rectangle, widened on each side, to include the edges of the hole around the portal.

        None if the portal is not planar.
        """
        if self.sides is None:
            return None
        mesh = mesh_of("portal", widened(self.sides, _SURROUND))
        return Portal(mesh, shape_of(mesh), self._host)

    def sample(self, u: Array2f) -> tuple[Array3f, Array3f, Bool]:
        """Return points uniform over `area`, the unit normals there, and which of the points lie on the portal."""
        if self.sides is None:
            sample = self.shape.sample_position(0.0, mi.Point2f(u))
            return Array3f(sample.p), Array3f(sample.n), dr.full(Bool, True, dr.width(u))
        point = self._rectangle.point(u)
        normal = self._normal + 0 * u.x
        ray = mi.Ray3f(mi.Point3f(point - self._lift * normal), mi.Vector3f(normal))
        ray.maxt = 2 * self._lift
        return point, normal, self.scene.ray_test(ray)

    def crosses(self, origin: Array3f, direction: Array3f, distance: Float | None = None) -> Bool:
        """Return which rays pass the portal within `distance`."""
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        if distance is not None:
            ray.maxt = distance
        return self.scene.ray_test(ray)


def emit_through(lamp: Lamp, portal: Portal, bounds: Bounds, u: Array2f, v: Array2f) -> EmittedRays:
    """Return light paths through a portal: `v` places them on it, `u` chooses the point or direction of the lamp.

    The flux is (radiance / pdf) · |cos θ| · area, where θ is the angle at the portal. Candidates that miss the portal
    are not valid.
    """
    point, normal, valid = portal.sample(v)
    sample = lamp.without_portal_gobo(point, u)
    cosine = dr.abs(dr.dot(normal, sample.direction))
    area, infinite, width = opaque(portal.area), lamp.infinite, dr.width(u)
    direction = -sample.direction
    distance: Any = bounds.behind(point, direction) if infinite else sample.distance
    flux = sample.weight * (cosine * area) * lamp.portal_color(point)
    extent_x: Any = dr.select(sample.pdf > 0, dr.rsqrt(dr.maximum(sample.pdf, 1e-30)), 0)
    extent_y = dr.sqrt(area * dr.maximum(cosine, GRAZING))
    # The shift from a lamp at distance d is x d |1 - s/d| + y s/d, with x an angle at the portal; from infinity, it is
    # x |s - d| + y.
    y0 = dr.full(Float, 1 if infinite else 0, width)
    y1: Any = dr.full(Float, 0, width) if infinite else dr.rcp(distance)
    differentials = isotropic(direction, (extent_x, distance, dr.full(Float, -1, width)), (extent_y, y0, y1))
    return EmittedRays(point - distance * direction, direction, flux, differentials, distance, valid)


def count_candidates(fill: float, count: int) -> int:
    """Return how many candidates are needed to keep about `count`, if the fraction `fill` of them is kept."""
    return max(1, round(count / fill))
