"""Surfaces lit by photons: light that was scattered, mirrored or refracted on its way (Jensen 1996)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from scipy.spatial import KDTree

from ...estimators.photons import PhotonMap, Photons
from ...numerics.arrays import joined, to_float, to_numpy
from ...numerics.grouped import GroupedLight
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...transport.segments.coverage import surface_coverage
from ...transport.segments.radii import Limits
from ...transport.segments.records import PhotonHits
from ...world.spectra import rgb
from ...world.world import World

mi = mitsuba()

# Photons that were scattered at random reach as far as this neighbour, counted from the nearest. The noise of a pass is
# about 1/√N: with a quarter of this number the flask's shadow is blotched; with a larger one light is blurred.
_NEIGHBOURS = 64

# Photons with much flux have at most so many times the usual radius: about that of the world.
_WIDEST = 16.0


class PhotonLighting:
    """The photons of a pass, and the light that surfaces reflect of them toward camera paths.

    Parameters
    ----------
    world
        The surfaces.
    hits
        Photon hits of the steps of light paths; at least one.
    limits
        Bounds of radii.
    most
        Most bounces on the whole path from the light to the camera; None: any number.
    """

    def __init__(self, world: World, hits: Sequence[PhotonHits], limits: Limits, most: int | None) -> None:
        found: PhotonHits = joined(list(hits))
        self._most, self._world = most, world
        _fit(found, world, limits)
        photons = Photons(found.position, found.radius, found.normal, found.direction, found.flux, found.depth)
        photons.group = world.groups.of_sources(found.source)
        self._map = PhotonMap(photons, len(world.groups))

    def __call__(self, hit: Any, depth: UInt32, active: Bool) -> GroupedLight:
        """Return the radiance of photons that surfaces reflect toward camera paths of these depths."""
        if self._most is None:
            most = None
        else:
            # One map serves all depths, so that each step of the camera paths runs the same kernel.
            limit = dr.opaque(UInt32, self._most)
            active, most = active & (depth <= limit), limit - depth
        bsdf, context = hit.bsdf(), mi.BSDFContext()
        context.type_mask = mi.BSDFFlags.Smooth
        # A cut-out surface was already sampled as opaque: undo the opacity factor of Mitsuba's `mask`.
        scale = dr.rcp(self._world.opacity(hit, active))

        def reflect(direction: Any) -> Array3f:
            local = hit.to_local(mi.Vector3f(direction))
            value = rgb(bsdf.eval(context, hit, local, active)) * scale
            return value * dr.rcp(dr.maximum(dr.abs(mi.Frame3f.cos_theta(local)), 1e-3))

        position, normal = Array3f(hit.p), Array3f(hit.n)
        front = dr.dot(normal, Array3f(hit.to_world(hit.wi))) > 0
        facing = dr.select(front, normal, -normal)
        result = self._map.radiance(position, facing, reflect, active, most)
        if self._world.translucent:
            result = result + self._map.radiance(position, -facing, reflect, active, most)
        return result


def _fit(hits: PhotonHits, world: World, limits: Limits) -> None:
    """Turn photons' normals toward the incident light, and fit their discs to the surfaces on which they lie."""
    away = dr.dot(hits.normal, hits.direction) > 0
    hits.normal = dr.select(away, -hits.normal, hits.normal)
    heavy = _heaviness(hits.flux)
    radius = limits.raised(heavy)(dr.maximum(hits.radius, heavy * _neighbourhood(hits))) + Float(0)
    dr.eval(hits.normal, radius)
    hits.radius, covered = surface_coverage(world, hits.position, hits.normal, radius)
    hits.flux = hits.flux * dr.rcp(covered)
    dr.eval(hits.radius, hits.flux)


def _heaviness(flux: Array3f) -> Float:
    """Return factors on radii, 1 to `_WIDEST`, with which discs are no brighter than those of the median flux.

    Few paths are sent where little light is expected. One that finds more, as at the silhouette of a glass ball, has a
    hundred times the flux of others. Its own differentials say that it is spread widely; the usual bound of radii would
    make it a bright disc.
    """
    largest = dr.max(flux)
    lit = largest.numpy()
    lit = lit[(lit > 0) & np.isfinite(lit)]
    usual = dr.opaque(Float, float(np.median(lit)) if len(lit) else 1.0)
    ratio: Float = dr.select(dr.isfinite(largest), largest / usual, 1)
    return dr.sqrt(dr.clip(ratio, 1, _WIDEST**2))


def _neighbourhood(hits: PhotonHits) -> Float:
    """Return the distance from each photon that was scattered at random to its neighbours; 0 for other photons.

    For these photons no differentials tell how far apart they are: the number of paths is known, but not the area on
    which their light arrives. The distance to a neighbour tells it (Jensen 1996). Each photon keeps its own flux.
    """
    dr.eval(hits)
    places, flux = to_numpy(hits.position).T, to_numpy(hits.flux)
    tried = ~hits.coherent.numpy() & (flux.max(axis=0) > 0) & np.isfinite(places).all(axis=1)
    result = np.zeros(len(tried))
    if np.count_nonzero(tried) > _NEIGHBOURS:
        tree = KDTree(places[tried])
        result[tried] = tree.query(places[tried], [_NEIGHBOURS + 1], workers=dr.thread_count())[0][:, 0]
    return to_float(result)
