"""Transmittance along rays, through media and through surfaces with null lobes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.hashing import hash32
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..shadow_rays import leaving, size_of
from ..spectra import rgb
from ..surfaces.normal_maps import consistent
from .media import Media

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene, Ray, SurfaceInteraction

mi = mitsuba()


# Most surfaces with a null lobe that a ray may pass.
_LAYERS = 64


def through(
    plugin: MiScene, media: Media, ray: Ray, medium: UInt32, seed: UInt32, active: Bool, coarse: bool = False,
    size: Float | None = None, onto: bool = False,
) -> tuple[Array3f, SurfaceInteraction]:  # fmt: skip
    """Return the transmittance along rays up to their ends, and the surface that each meets there, if any.

    Surfaces transmit light by their null lobes alone.

    Parameters
    ----------
    plugin, media
        The Mitsuba scene and its media.
    ray, medium
        Mitsuba's rays, and the numbers of the media in which they begin.
    seed, active
        Seeds for tracking heterogeneous media, and which rays are wanted.
    coarse
        As in `Media.transmittance`.
    size
        The scene's diameter, if it is known: see `shadow_rays`.
    onto
        Whether rays that have an end lead to a surface, which then does not block them, as that of those without one.
    """
    diameter = size_of(plugin) if size is None else size
    end = dr.minimum(ray.maxt, dr.largest(Float))

    def further(
        place: Array3f, along: Array3f, left: Float, medium: UInt32, passed: Array3f, layer: UInt32, going: Bool,
        hit: SurfaceInteraction,
    ) -> tuple[Any, ...]:  # fmt: skip
        step = mi.Ray3f(place, along)
        step.maxt = left
        found = plugin.ray_intersect(step, going)
        distance = dr.select(found.is_valid(), found.t, left)
        dimmed = media.transmittance(
            medium, Array3f(place), Array3f(along), distance, hash32(seed, layer), going, coarse
        )
        passed = dr.select(going, passed * media.felt(medium, dimmed), passed)
        hit = dr.select(going, found, hit)
        going = going & found.is_valid()
        clear = rgb(found.bsdf().eval_null_transmission(found, going))
        endless = left >= dr.largest(Float)
        # A ray without an end stops at the surface itself; one toward a lamp is blocked by it.
        solid = going & (dr.max(clear) <= 0)
        if not onto:
            passed = dr.select(solid & ~endless, 0, passed)
        going = going & ~solid
        passed = dr.select(going, passed * clear, passed)
        medium = dr.select(going, media.beyond(found, along, medium, going), medium)
        place, along, left, going = _onward(place, along, left, mi.Point3f(leaving(found, along, diameter)), going)
        return place, along, left, medium, passed, layer + 1, going & (dr.max(passed) > 0), hit

    width = dr.width(ray.o)
    nothing = dr.zeros(mi.SurfaceInteraction3f, width)
    nothing.t = dr.full(Float, dr.inf, width)
    state = (
        mi.Point3f(ray.o), ray.d + dr.zeros(mi.Vector3f, width), end + dr.zeros(Float, width), UInt32(medium),
        dr.ones(Array3f, width), dr.zeros(UInt32, width), Bool(active), nothing,
    )  # fmt: skip
    result = dr.while_loop(state, lambda *each: each[6] & (each[5] < _LAYERS), further, label="through")
    return result[4], consistent(result[7])


def _onward(place: Any, along: Any, left: Float, beyond: Any, going: Bool) -> tuple[Any, Any, Float, Bool]:
    """Return rays that go on `beyond` a surface: where, in which direction and how far, and which still do.

    A ray still ends where it did, though it begins beside its line; it may end before that.
    """
    endless = left >= dr.largest(Float)
    to = place + dr.select(endless, 1, left) * along - beyond
    going &= endless | (dr.dot(to, along) > 0)
    on = going & ~endless
    left = dr.select(on, dr.norm(to), left)
    along = dr.select(on, to * dr.rcp(dr.maximum(left, 1e-30)), along)
    return dr.select(going, beyond, place), along, left, going
