"""Measure-preserving maps from the unit square to discs, cones and spheres.

All maps keep neighbours together, so samples that are stratified in the square are stratified on the light, and a
beam's footprint is the size of its cell. Sources: Shirley and Chiu 1997 (square to disc), Clarberg 2008 (square to
sphere).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr

from ..runtime.device import Array2f, Array3f, Float, mitsuba

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import SurfaceInteraction

mi = mitsuba()


def disk(u: Array2f) -> Array2f:
    """Return the point of the unit disc for a point of the unit square, area-preserving."""
    return Array2f(mi.warp.square_to_uniform_disk_concentric(mi.Point2f(u)))


def sphere(u: Array2f) -> Array3f:
    """Return the unit vector for a point of the unit square, area-preserving (octahedral, Clarberg 2008)."""
    p = 2 * u - 1
    a = dr.abs(p)
    signed = 1 - (a.x + a.y)
    r = 1 - dr.abs(signed)
    phi = dr.select(r > 0, (a.y - a.x) / dr.maximum(r, 1e-12) + 1, 1) * (dr.pi / 4)
    s, c = dr.sincos(phi)
    f = r * dr.safe_sqrt(2 - r * r)
    return Array3f(dr.copysign(c * f, p.x), dr.copysign(s * f, p.y), dr.copysign(1 - r * r, signed))


def perpendicular(axis: Array3f) -> tuple[Array3f, Array3f]:
    """Return two unit vectors that make a right-handed frame with the unit vector `axis`."""
    s, t = mi.coordinate_system(mi.Vector3f(axis))
    return Array3f(s), Array3f(t)


def facing(normal: Array3f, direction: Array3f) -> Array3f:
    """Return normals turned toward the side from which rays along `direction` arrive."""
    return dr.select(dr.dot(normal, direction) > 0, -normal, normal)


def outward(hit: SurfaceInteraction) -> Array3f:
    """Return the normals of surfaces at hits, on the side of their shading normals.

    BSDFs know the side of a surface from its shading normal. Many exporters write normals on the other side than the
    winding of a mesh says.
    """
    normal = Array3f(hit.n)
    return dr.mulsign(normal, dr.dot(normal, Array3f(hit.sh_frame.n)))


def cone(u: Array2f, axis: Array3f, one_minus_cos: Float) -> Array3f:
    """Return a direction around `axis`, uniform in the solid angle 2π(1 − cos) of a cone.

    The parameter is 1 − cos, not cos, for precision: at half a degree it is 4e-5, of which a float32 cosine keeps two
    digits.
    """
    p = disk(u)
    return around(p, axis, Float(dr.squared_norm(p) * one_minus_cos))


def power_cone(u: Array2f, axis: Array3f, power: Float, q: Float) -> tuple[Array3f, Float]:
    """Return a direction with density ∝ cos^power within a cone, and that density per solid angle.

    The density is (k + 1) cos^k θ / (2π q), with k = `power` and q = 1 − cos^(k+1) at the cone's edge. It is uniform in
    solid angle for k = 0, uniform in projected solid angle for k = 1, and follows a focused light for k = focus.
    """
    p = disk(u)
    x = Float(dr.squared_norm(p) * q)
    series = x / (power + 1) * (1 + 0.5 * x * power / (power + 1))  # of 1 - (1 - x)^(1/(k+1)), which cancels in float32
    root = Float(dr.power(dr.maximum(1 - x, 0), 1 / (power + 1)))
    h = Float(dr.select(x < 1e-3, series, 1 - root))
    falloff = Float(dr.select(power > 0, dr.power(dr.maximum(1 - h, 1e-20), power), 1))
    density = (power + 1) * falloff / (dr.two_pi * q)
    return around(p, axis, h), density


def around(p: Array2f, axis: Array3f, h: Float) -> Array3f:
    """Return the direction at 1 − cos = `h` from `axis`, on the side where `p` lies."""
    s, t = perpendicular(axis)
    scale = dr.safe_sqrt(h * (2 - h)) * dr.rcp(dr.maximum(dr.norm(p), 1e-12))
    return dr.normalize(s * (p.x * scale) + t * (p.y * scale) + axis * (1 - h))
