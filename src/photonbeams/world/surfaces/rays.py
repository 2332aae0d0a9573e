"""Rays in Mitsuba scenes: what they meet first, and what blocks them, past cut-out surfaces and panes of glass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.arrays import channel_mean
from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..shadow_rays import rounding
from ..spectra import rgb
from .normal_maps import consistent

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import Ray, SurfaceInteraction

mi = mitsuba()

_LAYERS = 32  # most cut-out surfaces and panes that a ray may pass


@dataclass(frozen=True)
class RayScenes:
    """Mitsuba scenes that rays meet.

    Light goes straight through cut-out surfaces and through panes, which also mirror it. It passes a cut-out surface or
    not, by chance; a pane always gives it another colour. The methods take a `seed`, which decides which cut-out
    surfaces a ray passes, and a `link`, which selects the scene: 0 or None is `plugin`.

    Attributes
    ----------
    plugin, others
        The usual scene, and those that rays with the links 1, 2, … meet.
    cutouts
        Whether cut-out surfaces stop rays with the probability of their opacity, and rays to lamps pass panes; if not,
        both stop all rays.
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
        """Return what rays meet first, as a SurfaceInteraction3f; that may be a pane."""
        return self._met(origin, direction, active, seed, link, panes=False)[0]

    def behind_panes(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> tuple[SurfaceInteraction, Array3f]:
        """Return what rays meet first that is no pane, and the transmittance of the panes before it."""
        return self._met(origin, direction, active, seed, link, panes=True)

    def passed(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Array3f:  # fmt: skip
        """Return the transmittance of panes up to `distance`; 0 for rays that something blocks."""
        result = Array3f(1)
        for plugin, own in self._by_link(link):
            skip, tint = self._skipped(plugin, origin, direction, active & own, seed, panes=True)
            ray = _beyond(origin, direction, skip)
            ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
            tint = dr.select(plugin.ray_test(ray, active & own & (ray.maxt > 0)), 0, tint)
            result = dr.select(own, tint, result)
        return result

    def blocked(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Bool:  # fmt: skip
        """Return which rays meet something before `distance` that is no pane."""
        return dr.max(self.passed(origin, direction, distance, active, seed, link)) == 0

    def clear(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Float:  # fmt: skip
        """Return the distances at which rays meet something before `distance` that is no pane, else infinity."""
        result = Float(dr.inf)
        for plugin, own in self._by_link(link):
            skip, _ = self._skipped(plugin, origin, direction, active & own, seed, panes=True)
            ray = _beyond(origin, direction, skip)
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
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None, panes: bool
    ) -> tuple[SurfaceInteraction, Array3f]:
        """Return what rays meet first, past `panes` or not, and the transmittance of these."""
        result: Any = None
        for plugin, own in self._by_link(link):
            skip, tint = self._skipped(plugin, origin, direction, active & own, seed, panes)
            hit = consistent(plugin.ray_intersect(_beyond(origin, direction, skip), active & own))
            if self.cutouts:
                hit.t += skip
            met = hit, tint
            result = met if result is None else tuple(map(dr.select, (own, own), met, result))
        return result  # type: ignore[no-any-return]

    def _skipped(
        self, plugin: Any, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, panes: bool
    ) -> tuple[Any, Array3f]:
        """Return the distance to the last surface that rays pass, and its transmittance with that of those before.

        They pass cut-out surfaces and, if told so, `panes`; boundaries of media stop them.
        """
        if not self.cutouts:
            return 0, Array3f(1)
        origin, direction = dr.detach(Array3f(origin)), dr.detach(Array3f(direction))
        # More than the rounding error of a hit's place.
        extent = dr.max(dr.abs(origin))
        step = 1e-5 * extent

        def passing(skip: Float, tint: Array3f, layer: UInt32, going: Bool) -> tuple[Float, Array3f, UInt32, Bool]:
            hit = plugin.ray_intersect(_beyond(origin, direction, skip), going)
            clear, pane = rgb(hit.bsdf().eval_null_transmission(hit, going)), _is_pane(hit)
            lucky = unit_float(hash32(seed, layer)) < channel_mean(clear)
            passes = dr.select(pane, Bool(panes) & (dr.max(clear) > 0), lucky)
            going = going & hit.is_valid() & ~hit.is_medium_transition() & passes
            # No further than the next leaf, in small scenes and far from the origin.
            most = dr.maximum(mi.math.RayEpsilon * self.size, rounding(hit.t + extent))
            usual = 1e-5 * hit.t + step <= most
            beyond = dr.select(usual, skip + hit.t * (1 + 1e-5) + step, skip + hit.t + most)
            return dr.select(going, beyond, skip), dr.select(going & pane, tint * clear, tint), layer + 1, going

        width = dr.width(origin)
        state = (0 * origin.x + 0 * direction.x, dr.ones(Array3f, width), dr.zeros(UInt32, width), Bool(active))
        skip, tint, _, _ = dr.while_loop(state, lambda *each: each[3] & (each[2] < _LAYERS), passing, label="cutouts")
        return skip, tint


def _beyond(origin: Array3f, direction: Array3f, skip: Any) -> Ray:
    """Return rays moved forward by a distance."""
    return mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))


def _is_pane(hit: SurfaceInteraction) -> Bool:
    """Return which hits are on panes: light goes straight through them, and is mirrored."""
    flags = hit.bsdf().flags()
    return mi.has_flag(flags, mi.BSDFFlags.Null) & mi.has_flag(flags, mi.BSDFFlags.DeltaReflection)


def opacity(hit: SurfaceInteraction, active: Bool) -> Float:
    """Return the probability with which surfaces stop rays."""
    return dr.select(_is_pane(hit), 1, 1 - channel_mean(rgb(hit.bsdf().eval_null_transmission(hit, active))))
