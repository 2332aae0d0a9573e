"""The rays that Mitsuba's emitters send out."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..runtime.device import Float, mitsuba
from .shadow_rays import leaving

mi = mitsuba()

#: A sphere: its center, and its radius.
Sphere = tuple[Any, Float]


def sampled_ray(emitter: Any, u: Any, v: Any, entry: Sphere | None) -> Any:
    """Return rays that leave an emitter, and their weights: of light from infinity, from the sphere `entry` on.

    Paths of environment maps begin on a disc across their direction. Mitsuba turns the place on the disc with the map
    once more, after it has turned the disc with the direction: paths of a turned map would begin anywhere, in rooms,
    too. So the place is chosen here. Paths of a shape that shines begin as near to it as its size allows: Mitsuba's
    own gap grows with the distance from the origin, and the light within it would be missing in fog. Directions have
    the scale of the emitter's `to_world` in them; a projector's direct light grows with it, and so do its paths.
    """
    ray, weight = emitter.sample_ray(Float(0), Float(0.5), u, v, True)
    scale = dr.norm(ray.d)
    ray.d *= dr.rcp(scale)
    if emitter.class_name() == "Projector":
        weight *= scale
    shape = emitter.get_shape()
    if shape is not None:
        place, _ = emitter.sample_position(Float(0), u)
        size = opaque(float(np.linalg.norm(np.ravel(shape.bbox().extents()))))
        ray.o = mi.Point3f(leaving(mi.SurfaceInteraction3f(place, []), ray.d, size))
    if entry is not None and emitter.class_name() == "EnvironmentMapEmitter":
        center, radius = entry
        disc = mi.warp.square_to_uniform_disk_concentric(u)
        ray.o = center + radius * (mi.Frame3f(ray.d).to_world(mi.Vector3f(disc.x, disc.y, 0)) - ray.d)
    return ray, weight


def entry_sphere(plugin: Any) -> Sphere:
    """Return the sphere by which Mitsuba's light from infinity enters a scene; merged meshes may be outside."""
    box = plugin.bbox()
    sphere = box.bounding_sphere() if box.valid() else mi.ScalarBoundingSphere3f(mi.ScalarPoint3f(0), 0.0)
    radius = max(mi.math.RayEpsilon, float(sphere.radius) * (1 + mi.math.RayEpsilon))  # as in Mitsuba's emitters
    return mi.Point3f(*(dr.opaque(Float, each) for each in np.ravel(sphere.center))), dr.opaque(Float, float(radius))
