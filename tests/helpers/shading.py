"""The radiance of a stage's surfaces along given rays, without a picture."""

from typing import Any, NamedTuple

import drjit as dr

from photonbeams.numerics.samples import Samples
from photonbeams.render.paths import camera_paths
from photonbeams.render.paths.stage_lighting import StageLighting
from photonbeams.render.paths.surface_light import NO_LIGHT
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32
from photonbeams.world.cameras.sensors import PrimaryRays


class Shaded(NamedTuple):
    """Radiance, alpha, distance and transmittance of rays."""

    radiance: Any
    alpha: Any
    depth: Any
    transmittance: Any


def shade(world, origin, direction, index, seed=1, active=None, max_depth=2):
    """Return what rays see; `index` are their positions in the sequence of samples."""
    count = dr.width(direction)
    ones = dr.ones(Array3f, count)
    primary = PrimaryRays(origin, direction, dr.zeros(Float, count), dr.full(Float, dr.largest(Float), count), ones)
    tracing = camera_paths.CameraTracing(world, StageLighting(world), max_depth, 5, False, sharp=world.sharp)
    paths = camera_paths.begin(tracing, primary, UInt32(index))
    if active is not None:
        paths.alive = Bool(active)
    result = Shaded(*(dr.zeros(kind, count) for kind in (Array3f, Float)), dr.full(Float, dr.inf, count), ones)
    for step, vertex in camera_paths.follow(tracing, paths, Samples(seed, 0, 0), NO_LIGHT):
        dr.scatter_add(result.radiance, vertex.radiance.total, step.pixel, step.alive)
        own = step.alive & step.primary
        dr.scatter(result.transmittance, vertex.transmittance, step.pixel, own)
        dr.scatter(result.alpha, Float(1), step.pixel, own & vertex.solid)
        dr.scatter(result.depth, vertex.end, step.pixel, own & vertex.solid)
    dr.eval(result)
    return result
