"""What cameras see of surfaces: how far away they are, and how much light lamps send to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np

from ..numerics.arrays import to_numpy
from ..numerics.hashing import hash32
from ..numerics.sampling import pixel_sample, sobol_block
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Array
from ..world.emitters.emitter import Emitter
from ..world.shadow_rays import to_lamp
from ..world.world import World
from .guiding.importance import Views

if TYPE_CHECKING:
    from ..estimators.projection import Projection

# Number of camera rays, and of samples of each lamp at what they meet; how far above surfaces these are taken, as a
# fraction of the distance from the camera.
_RAYS, _SAMPLES, _ABOVE = 1 << 12, 4, 1e-4


class Sight(NamedTuple):
    """What a camera sees of surfaces.

    Attributes
    ----------
    distance
        The median distance of the surfaces in scene units; None if it sees none.
    light
        By the names of lamps: the radiance that white paper would have in place of the surfaces by the lamp's direct
        light, (N, 3), for rays all over the picture that meet surfaces.
    """

    distance: float | None
    light: dict[str, Array]


def sight_of(world: World, views: Sequence[Projection]) -> Sight:
    """Return what a camera with these views sees of surfaces, on rays all over its picture."""
    number = dr.arange(UInt32, _RAYS)
    place, _ = sobol_block(_RAYS, 0, (_RAYS,))
    origin, direction = Views(views)(number % dr.opaque(UInt32, len(views))).ray(place)
    hit = world.solids.first(origin, direction, Bool(True), number)
    there, distance = hit.is_valid(), Float(hit.t)
    normal: Any = Array3f(hit.n)
    normal = dr.select(dr.dot(normal, direction) > 0, -normal, normal)
    point = Array3f(hit.p) + _ABOVE * distance * normal
    site = world.linking.of_surfaces(hit) + dr.zeros(UInt32, _RAYS)
    dr.eval(there, distance, point, normal, site)
    met = np.flatnonzero(there.numpy())
    light = {each.name: _light(world, each, point, normal, site, there)[met] for each in world.emitters}
    return Sight(float(np.median(distance.numpy()[met])) if len(met) else None, light)


def _light(
    world: World, emitter: Emitter, point: Array3f, normal: Array3f, site: UInt32, there: Bool
) -> Array:  # fmt: skip
    """Return the radiance of white paper at points, (N, 3), by the direct light of an emitter."""
    total, number = dr.zeros(Array3f, _RAYS), dr.arange(UInt32, _RAYS)
    if not (emitter.lamp.illuminates and emitter.beams.lights_surfaces):
        return np.zeros((_RAYS, 3))
    link = dr.zeros(UInt32, _RAYS) + dr.opaque(UInt32, emitter.link)
    source = dr.opaque(UInt32, emitter.source)
    lamp, there = emitter.lamp.at(world.linking.acting(source, site)), world.linking.lights(source, site, there)
    for each in range(_SAMPLES):
        seed = hash32(number, dr.opaque(UInt32, each))
        sample = lamp.illuminate(point, pixel_sample(number, seed))
        toward: Any = sample.direction
        cosine = dr.maximum(dr.dot(toward, normal), 0)
        distance = dr.minimum(to_lamp(point, toward, sample.distance).length, dr.largest(Float))
        lit = there & (dr.max(sample.weight) * cosine > 0)
        lit &= ~world.solids.blocked(point, toward, distance, lit, seed, link)
        total += dr.select(lit, sample.weight * cosine, 0)
        dr.eval(total)
    factor = emitter.links.surface_scale / (np.pi * _SAMPLES)
    return np.nan_to_num(factor * to_numpy(total).T.astype(np.float64), posinf=0)
