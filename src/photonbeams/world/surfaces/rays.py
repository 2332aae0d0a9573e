"""Rays in Mitsuba scenes: what they meet first, and what blocks them, past cut-out surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.arrays import channel_mean
from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..shadow_rays import rounding

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene, SurfaceInteraction

mi = mitsuba()

_LAYERS = 32  # most cut-out surfaces that a ray may pass


@dataclass(frozen=True)
class RayScenes:
    """Mitsuba scenes that rays meet.

    The methods take a `seed`, which decides which cut-out surfaces a ray passes, and a `link`, which selects the scene:
    0 or None is `plugin`.

    Attributes
    ----------
    plugin, others
        The usual scene, and those that rays with the links 1, 2, … meet.
    cutouts
        Whether cut-out surfaces stop rays with the probability of their opacity; if not, they stop all rays.
    size
        The diameter of the world.
    """

    plugin: Any
    others: Sequence[Any]
    cutouts: bool
    size: Float

    def first(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return what rays meet first, as a SurfaceInteraction3f."""
        first, *more = self._by_link(link)
        hit = self._met(first[0], origin, direction, active & first[1], seed)
        for each, own in more:
            hit = dr.select(own, self._met(each, origin, direction, active & own, seed), hit)
        return hit

    def blocked(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Bool:  # fmt: skip
        """Return which rays meet something before `distance`."""
        first, *more = self._by_link(link)
        result = self._stopped(first[0], origin, direction, distance, active & first[1], seed)
        for each, own in more:
            result |= self._stopped(each, origin, direction, distance, active & own, seed)
        return result

    def clear(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Float:  # fmt: skip
        """Return the distances at which rays meet something before `distance`, else infinity."""
        result = Float(dr.inf)
        for plugin, own in self._by_link(link):
            ray, skip = self._beyond_cutouts(plugin, origin, direction, active & own, seed)
            ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
            tried = active & own & (ray.maxt > 0)
            # What lies there does not matter, and takes long to compute for many shapes.
            found = plugin.ray_intersect_preliminary(ray, False, tried)
            result = dr.select(tried & found.is_valid(), found.t + skip, result)
        return result

    def _by_link(self, link: UInt32 | None) -> list[tuple[Any, Bool]]:
        """Return the scenes, and which rays meet each."""
        if not self.others or link is None:
            return [(self.plugin, Bool(True))]
        linked = [(each, link == dr.opaque(UInt32, number)) for number, each in enumerate(self.others, 1)]
        return [(self.plugin, link == 0), *linked]

    def _met(
        self, plugin: MiScene, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32
    ) -> SurfaceInteraction:
        ray, skip = self._beyond_cutouts(plugin, origin, direction, active, seed)
        hit = plugin.ray_intersect(ray, active)
        if self.cutouts:
            hit.t += skip
        return hit

    def _stopped(
        self, plugin: Any, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32
    ) -> Bool:
        ray, skip = self._beyond_cutouts(plugin, origin, direction, active, seed)
        ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
        return plugin.ray_test(ray, active & (ray.maxt > 0))

    def _beyond_cutouts(
        self, plugin: MiScene, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32
    ) -> tuple[Any, Any]:
        """Return rays moved beyond the cut-out surfaces that they pass, and the distances by which they were moved."""
        skip = self._skipped(plugin, origin, direction, active, seed) if self.cutouts else 0
        return mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction)), skip

    def _skipped(self, plugin: Any, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32) -> Float:
        """Return the distance to the last cut-out surface that rays pass; boundaries of media stop them."""
        origin, direction = dr.detach(Array3f(origin)), dr.detach(Array3f(direction))
        # More than the rounding error of a hit's place.
        extent = dr.max(dr.abs(origin))
        step = 1e-5 * extent

        def passing(skip: Float, layer: UInt32, going: Bool) -> tuple[Float, UInt32, Bool]:
            ray = mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))
            hit = plugin.ray_intersect(ray, going)
            clear = channel_mean(hit.bsdf().eval_null_transmission(hit, going))
            passes = hit.is_valid() & ~hit.is_medium_transition() & (unit_float(hash32(seed, layer)) < clear)
            going = going & passes
            # No further than the next leaf, in small scenes and far from the origin.
            most = dr.maximum(mi.math.RayEpsilon * self.size, rounding(hit.t + extent))
            usual = 1e-5 * hit.t + step <= most
            beyond = dr.select(usual, skip + hit.t * (1 + 1e-5) + step, skip + hit.t + most)
            return dr.select(going, beyond, skip), layer + 1, going

        state = (0 * origin.x + 0 * direction.x, dr.zeros(UInt32, dr.width(origin)), Bool(active))
        skip, _, _ = dr.while_loop(state, lambda _, layer, going: going & (layer < _LAYERS), passing, label="cutouts")
        return skip
