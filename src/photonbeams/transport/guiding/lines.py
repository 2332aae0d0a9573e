"""Lines: where emitters light what cameras see straight, and whether anything is in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ...numerics.arrays import taken, to_numpy
from ...numerics.hashing import hash32
from ...numerics.sampling import pixel_sample
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...scene import Array
from ...world.emitters.emitter import Emitter
from ...world.shadow_rays import to_lamp
from ...world.world import World
from ..emission import PathEmitter
from .eye_points import FogPoints, SurfacePoints, fog_before, fog_seen, surfaces_seen
from .importance import relative

if TYPE_CHECKING:
    from ...estimators.projection import Projection

# Samples of a lamp at each point of a surface.
_SAMPLES = 4


@dataclass(frozen=True)
class FogLines:
    """Lines from an emitter to points in the picture: the points, and the directions of light, (N, 3).

    `weight`, (N,), is how much light in the picture each stands for; `free`, (N,), is whether nothing blocks the line.
    """

    point: Array
    direction: Array
    weight: Array
    free: Array

    def chosen(self, free: bool, most: int) -> tuple[Array, Array]:
        """Return points and directions of at most `most` lines that are free, or that are not, chosen by weight."""
        index = np.flatnonzero(self.free == free)
        number = min(most, len(index))
        if not number:
            return self.point[:0], self.direction[:0]
        ends = np.cumsum(self.weight[index])
        places = np.searchsorted(ends, (np.arange(number) + 0.5) / number * ends[-1])
        index = index[np.minimum(places, len(index) - 1)]
        return self.point[index], self.direction[index]


@dataclass(frozen=True)
class LightLines:
    """The lines along which the emitters of a world light what cameras with these views see."""

    world: World
    views: Sequence[Projection]

    @cached_property
    def fog(self) -> FogPoints | None:
        """Points in fog that the cameras see."""
        return fog_seen(self.world, self.views)

    @cached_property
    def surfaces(self) -> SurfacePoints | None:
        """Points on surfaces that the cameras see."""
        return surfaces_seen(self.world, self.views)

    def to_fog(self, emitter: PathEmitter) -> FogLines:
        """Return the lines along which an emitter lights fog."""
        return _to_fog(self.world, emitter, self.fog)

    def seen_past_portals(self) -> frozenset[str]:
        """Return the names of the lights that light visible fog by paths that miss their portal."""
        return frozenset(
            each.name for number, each in enumerate(self.world.emitters) if self._is_seen_past(number, each)
        )

    def _is_seen_past(self, number: int, emitter: Emitter) -> bool:
        if emitter.portal is None:
            return False
        past = PathEmitter(self.world, number).at(emitter.portal, False)
        return any(
            _to_fog(self.world, past, points).free.any()
            for points in (self.fog, fog_before(self.world, self.views, emitter.portal))
        )

    def free(self, emitter: PathEmitter) -> float:
        """Return the fraction of the lines to fog that an emitter would light in whose way nothing is; 1 for none."""
        free = self.to_fog(emitter).free
        return float(np.mean(free)) if len(free) else 1.0

    def lit(self, emitter: Emitter) -> float:
        """Return which fraction of the surfaces in the picture an emitter lights; 1 if there are none."""
        white = self.white(emitter)
        return float(np.mean(white.max(axis=1) > 0)) if len(white) else 1.0

    def white(self, emitter: Emitter) -> Array:
        """Return the radiance of white paper above surfaces by the direct light of an emitter, (N, 3)."""
        points, world, lamp = self.surfaces, self.world, emitter.lamp
        if points is None or not (lamp.illuminates and emitter.beams.lights_surfaces):
            return np.zeros((0 if points is None else dr.width(points.number), 3))
        count = dr.width(points.number)
        each = dr.arange(UInt32, _SAMPLES * count)
        there = taken(points, each % dr.opaque(UInt32, count))
        seed = hash32(there.number, each // dr.opaque(UInt32, count))
        source = dr.opaque(UInt32, emitter.source)
        acting = world.linking.acting(source, there.site)
        sample = lamp.at(acting).illuminate(there.position, pixel_sample(there.number, seed))
        cosine = dr.maximum(dr.dot(sample.direction, there.normal), 0)
        lit = world.linking.lights(source, there.site, Bool(True)) & (dr.max(sample.weight) * cosine > 0)
        medium = world.medium_at(there.position, there.normal, Bool(True))
        free, _ = world.unblocked(
            to_lamp(there.position, sample.direction, sample.distance), medium, seed, lit, emitter.link
        )
        lit &= free
        light = dr.select(lit, sample.weight * cosine, Array3f(0))
        total = to_numpy(light).astype(np.float64).reshape(3, _SAMPLES, count).sum(axis=1).T
        return np.nan_to_num(emitter.links.surface_scale / (np.pi * _SAMPLES) * total, posinf=0)


def _to_fog(world: World, emitter: PathEmitter, points: FogPoints | None) -> FogLines:
    """Return the lines along which an emitter lights points in fog."""
    if points is None:
        return FogLines(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=bool))
    acting = world.linking.acting(dr.opaque(UInt32, emitter.source), points.medium)
    sample = emitter.lamp.at(acting).illuminate(points.position, pixel_sample(points.number, dr.opaque(UInt32, 7)))
    direction = sample.direction + dr.zeros(Array3f, dr.width(points.number))
    active = dr.max(sample.weight) > 0
    dr.eval(sample, direction, active)
    # Endless fog would take all light from infinity.
    ends = world.bounds.exit(points.position, direction)
    ray = to_lamp(points.position, direction, dr.minimum(sample.distance, ends))
    if emitter.portal is not None:
        passes = emitter.portal.crosses(points.position, direction, dr.minimum(ray.length, dr.largest(Float)))
        active &= passes if emitter.through else ~passes
    free, reached = world.unblocked(ray, points.medium, hash32(points.number, UInt32(8)), active, emitter.link)
    light = dr.select(active, dr.max(sample.weight * reached) * points.light, 0)
    dr.eval(light, free)
    weight, index = light.numpy().astype(np.float64), np.flatnonzero(light.numpy() > 0)
    lit, part = free.numpy()[index], points.part.numpy()[index]
    weight = weight[index]
    for each in (lit, ~lit):
        weight[each] = relative(weight[each], part[each])
    return FogLines(to_numpy(points.position).T[index], -to_numpy(direction).T[index], weight, lit)
