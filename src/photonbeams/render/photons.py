"""Surfaces lit by photons: light that was scattered, mirrored or refracted on its way (Jensen 1996)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from scipy.spatial import KDTree

from ..estimators.photons import PhotonMap, Photons
from ..numerics.arrays import compressed, joined, to_float, to_numpy
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..transport.coverage import surface_coverage
from ..transport.radii import Limits
from ..transport.records import PhotonHits
from ..world.spectra import rgb
from ..world.world import World

mi = mitsuba()

# Photons that were scattered at random reach as far as this neighbour, counted from the nearest. With a smaller number
# single photons are visible as dots; with a larger one the light is blurred.
_NEIGHBOURS = 16


class PhotonMaps:
    """The photon maps of a pass, one for each depth of camera paths.

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
        self._all: PhotonHits = joined(list(hits))
        self._most, self._translucent = most, world.translucent
        _fit(self._all, world, limits)
        self._maps: dict[int, PhotonMap | None] = {}

    def __call__(self, hit: Any, depth: UInt32, active: Bool) -> Array3f:
        """Return the radiance of photons that surfaces reflect toward camera paths of these depths."""
        result = dr.zeros(Array3f, dr.width(hit.t))
        if self._most is None:
            return self._reflected(self._map(0), hit, active)
        for count in range(int(dr.max(depth)[0]) + 1):
            own = active & (depth == dr.opaque(UInt32, count))
            result += dr.select(own, self._reflected(self._map(count), hit, own), 0)
        return result

    def _map(self, depth: int) -> PhotonMap | None:
        """Return the photon map for paths of a depth; None if it has no photons."""
        if depth not in self._maps:
            kept = [self._all]
            if self._most is not None:
                few = dr.opaque(UInt32, max(self._most - depth, 0))
                kept = compressed(self._all.depth <= few, self._all) if self._most >= depth else []
            self._maps[depth] = PhotonMap(_photons(kept[0])) if kept else None
        return self._maps[depth]

    def _reflected(self, photons: PhotonMap | None, hit: Any, active: Bool) -> Array3f:
        if photons is None:
            return Array3f(0)
        bsdf, context = hit.bsdf(), mi.BSDFContext()
        context.type_mask = mi.BSDFFlags.Smooth

        def reflect(direction: Any) -> Array3f:
            local = hit.to_local(mi.Vector3f(direction))
            value = rgb(bsdf.eval(context, hit, local, active))
            return value * dr.rcp(dr.maximum(dr.abs(mi.Frame3f.cos_theta(local)), 1e-3))

        position, normal = Array3f(hit.p), Array3f(hit.n)
        front = dr.dot(normal, Array3f(hit.to_world(hit.wi))) > 0
        facing = dr.select(front, normal, -normal)
        result = photons.radiance(position, facing, reflect, active)
        if self._translucent:
            result += photons.radiance(position, -facing, reflect, active)
        return result


def _fit(hits: PhotonHits, world: World, limits: Limits) -> None:
    """Turn photons' normals toward the incident light, and fit their discs to the surfaces on which they lie."""
    away = dr.dot(hits.normal, hits.direction) > 0
    hits.normal = dr.select(away, -hits.normal, hits.normal)
    radius = limits(dr.maximum(hits.radius, _neighbourhood(hits))) + Float(0)
    dr.eval(hits.normal, radius)
    hits.radius, covered = surface_coverage(world, hits.position, hits.normal, radius)
    hits.flux = hits.flux * dr.rcp(covered)
    dr.eval(hits.radius, hits.flux)


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


def _photons(hits: PhotonHits) -> Photons:
    return Photons(hits.position, hits.radius, hits.normal, hits.direction, hits.flux)
