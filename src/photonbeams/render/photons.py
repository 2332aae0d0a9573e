"""Surfaces lit by photons: light that was scattered, mirrored or refracted on its way (Jensen 1996)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..estimators.photons import PhotonMap, Photons
from ..numerics.arrays import compressed, joined
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..transport.paths import Landed
from ..transport.radii import Limits
from ..world.media import parts

mi = mitsuba()


class Arrived:
    """The photons of a pass on surfaces.

    Parameters
    ----------
    steps
        What the steps of light paths left.
    limits
        Bounds of radii.
    most
        Most events on a light path that ends in the eye: of a path over mirrors there may be fewer. None: any.
    translucent
        Whether light passes surfaces of the scene and is scattered by them.
    """

    def __init__(self, steps: list[Landed], limits: Limits, most: int | None, translucent: bool) -> None:
        self._all: Any = joined(steps) if steps else None
        self._most, self._translucent = most, translucent
        self._limits = limits
        self._maps: dict[int, PhotonMap | None] = {}

    def __call__(self, hit: Any, events: UInt32, active: Bool) -> Array3f:
        """Return what surfaces reflect of photons toward paths that have had so many events on their way to the eye."""
        result = dr.zeros(Array3f, dr.width(hit.t))
        if self._all is None:
            return result
        if self._most is None:
            return self._reflected(self._map(0), hit, active)
        for count in range(int(dr.max(events)[0]) + 1):
            own = active & (events == dr.opaque(UInt32, count))
            result += dr.select(own, self._reflected(self._map(count), hit, own), 0)
        return result

    def _map(self, events: int) -> PhotonMap | None:
        """Return the photons for paths with so many events; None where there are none."""
        if events not in self._maps:
            kept = [self._all]
            if self._most is not None:
                few = dr.opaque(UInt32, max(self._most - events, 0))
                kept = compressed(self._all.events <= few, self._all) if self._most >= events else []
            self._maps[events] = PhotonMap(_photons(kept[0], self._limits)) if kept else None
        return self._maps[events]

    def _reflected(self, photons: PhotonMap | None, hit: Any, active: Bool) -> Array3f:
        if photons is None:
            return Array3f(0)
        bsdf, context = hit.bsdf(), mi.BSDFContext()
        context.type_mask = mi.BSDFFlags.Smooth

        def reflect(direction: Any) -> Array3f:
            local = hit.to_local(mi.Vector3f(direction))
            value = Array3f(bsdf.eval(context, hit, local, active))
            return value * dr.rcp(dr.maximum(dr.abs(mi.Frame3f.cos_theta(local)), 1e-3))

        position, normal = Array3f(hit.p), Array3f(hit.n)
        front = dr.dot(normal, Array3f(hit.to_world(hit.wi))) > 0
        facing = dr.select(front, normal, -normal)
        result = photons.radiance(position, facing, reflect, active)
        if self._translucent:
            result += photons.radiance(position, -facing, reflect, active)
        return result


def _photons(landed: Landed, limits: Limits) -> Photons:
    """Return photons whose normals are on the side that the light came from."""
    away = dr.dot(landed.normal, landed.direction) > 0
    normal = dr.select(away, -landed.normal, landed.normal)
    radius = limits(landed.radius) + Float(0)
    dr.eval(normal, radius)
    return Photons(landed.position, radius, normal, landed.direction, landed.flux)


def translucent(plugin: Any) -> bool:
    """Return whether a scene has surfaces that light passes through and is scattered by."""
    flags = [each.flags() for each in parts(plugin, mi.BSDF)]
    kinds = (mi.BSDFFlags.DiffuseTransmission, mi.BSDFFlags.GlossyTransmission)
    return any(mi.has_flag(int(each), kind) for each in flags for kind in kinds)
