"""Virtual point lights: the places that lamps light, to which the vertices of walks are connected (Keller 1997).

Where the light of a room comes from a small part of it, such as sunlit stripes on its floor, few samples of BSDFs find
that part. But light paths end on it. With photons of flux Φ at points y of surfaces, each straight from its lamp, a
point x reflects the radiance

    L = Σ Φ · f(x) · f(y) · G · w,   G = cos(x) cos(y) / |x − y|²,   w = min(1, B / (f(x) f(y) G))

The weight w bounds what each photon brings. Walks bring the rest: what they meet at y, in the direction of a sample of
f(x), counts 1 − w (Kollig and Keller 2004). Of the sum one photon is sampled, in proportion to about what it brings
(resampling, Talbot 2005), and tested for visibility.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ...numerics.arrays import joined, packets, to_uint
from ...numerics.grouped import GroupedLight
from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array3f, Array4f, Bool, Float, UInt32, mitsuba
from ...transport.segments.records import PhotonHits
from ...world.shadow_rays import gap_at, rounding, to_point
from ...world.spectra import rgb
from ...world.world import World
from .emitters import Emitters
from .walk_vertices import steepness

mi = mitsuba()

# Photons among which one is chosen for each vertex.
_CANDIDATES = 16
# What a photon brings is bounded where surfaces of albedo 1 face each other at this distance, in radii of the world.
_NEAR = 0.1
# The least cosine that is assumed in choosing: normals of meshes may differ from those of their faces.
_LOW = 0.02
# How far from a photon a ray toward it may end, in usual gaps between surfaces and rays that leave them.
_TOLERANCE = 0.1


def bound(world: World) -> Float:
    """Return B: the greatest radiance that a photon of unit flux may bring."""
    return dr.opaque(Float, (dr.pi * _NEAR * world.radius) ** -2)


def weight(bright: Float, most: Float) -> Float:
    """Return w, the fraction of light that photons bring, where one of unit flux would bring `bright`, at most B."""
    return dr.minimum(most * dr.rcp(dr.maximum(bright, 1e-30)), 1)


class _Photon(NamedTuple):
    """A virtual point light: its position, the direction, the flux and the light group of its light."""

    position: Array3f
    direction: Array3f
    flux: Array3f
    group: UInt32


@dataclass(frozen=True)
class Point:
    """Where light is wanted.

    Attributes
    ----------
    hit, opacity, medium
        Mitsuba's interaction, its opacity as in `World.opacity`, and the medium in front.
    active, bounces, seed
        Which points are lit; how often light of lamps that the next vertex met would be scattered before it is
        scattered toward the camera; and random integers.
    """

    hit: Any
    opacity: Float
    medium: UInt32
    active: Bool
    bounces: UInt32
    seed: UInt32


def _entering(world: World, hits: PhotonHits) -> Array3f:
    """Return how much endless fog dims photons from infinity, on their way from the world's bounds.

    It does not dim direct light from infinity on surfaces, and so not the light that walks meet.
    """
    filling = dr.opaque(UInt32, world.media.filling)
    table = [0] * (len(world.sources) + 1)
    for each in world.emitters:
        table[each.source] |= int(each.lamp.infinite)
    infinite = (dr.gather(UInt32, to_uint(table), hits.source) > 0) & (filling > 0)
    dimmed = world.media.absorbed(filling, world.bounds.behind(hits.position, hits.direction))
    return Array3f(dr.select(infinite, dr.maximum(dimmed, 1e-30), 1))


class VirtualLights:
    """The virtual point lights of a pass.

    Parameters
    ----------
    world
        The surfaces.
    hits
        Photons straight from their emitters, of the steps of light paths; there may be none.
    bounces
        The most bounces of the light of each source; None: the longest path alone bounds them.
    most
        The greatest radiance that a photon of unit flux may bring: see `bound`.
    """

    def __init__(
        self, world: World, hits: Sequence[PhotonHits], bounces: Sequence[int] | None, most: Float
    ) -> None:  # fmt: skip
        self._bound, self._count = most, dr.opaque(UInt32, sum(dr.width(each.number) for each in hits))
        self._size, self._groups = world.size, len(world.groups)
        found = joined(list(hits)) if hits else dr.zeros(PhotonHits, 2)
        found.flux = found.flux * dr.rcp(_entering(world, found))
        depth = Float(1e9) if bounces is None else Float(dr.gather(UInt32, to_uint([*bounces, 0]), found.source))
        normal = dr.select(dr.dot(found.normal, found.direction) > 0, -found.normal, found.normal)
        self._data = packets(
            (found.position, dr.max(found.flux)),
            (normal, depth),
            (found.direction, 0),
            (found.flux, world.groups.of_sources(found.source)),
        )

    def radiance(self, walked: Emitters, point: Point) -> GroupedLight:
        """Return the radiance that points reflect of these lights, whose emitters are among those that walks meet."""
        photon, factor = self._chosen(point)
        hit, active = point.hit, point.active & (factor > 0)
        ray = to_point(hit, photon.position, self._size)
        direction, square = ray.direction, dr.maximum(dr.squared_norm(photon.position - Array3f(hit.p)), 1e-30)
        context = mi.BSDFContext()
        value = rgb(hit.bsdf().eval(context, hit, hit.to_local(mi.Vector3f(direction)), active)) / point.opacity
        active &= dr.max(value) > 0
        passed, met = walked.connected(ray, hit, point.medium, point.seed, active)
        active &= met.is_valid() & (dr.norm(Array3f(met.p) - photon.position) < self._tolerance(photon.position))
        incident = met.to_local(mi.Vector3f(-photon.direction))
        normal: Any = Array3f(met.n)
        other = rgb(met.bsdf().eval(context, met, incident, active))
        other = other * dr.rcp(steepness(met, photon.direction) * walked.world.opacity(met, active))
        other = other * (dr.abs(dr.dot(normal, direction)) * dr.rcp(square))
        share = weight(dr.max(value) * dr.max(other), self._bound)
        result = value * other * passed * photon.flux * (share * factor)
        result = dr.select(active & dr.isfinite(dr.sum(result)), result, 0)
        return GroupedLight.of(result, photon.group, self._groups)

    def _tolerance(self, place: Array3f) -> Float:
        """Return how far from a photon the surface may be met that it lies on: thin walls have another side."""
        return dr.maximum(_TOLERANCE * gap_at(place, self._size), rounding(dr.max(dr.abs(place)) + self._size))

    def _photon(self, number: UInt32, active: Bool) -> _Photon:
        place, turned, light = (dr.gather(Array4f, self._data, number * 4 + packet, active) for packet in (0, 2, 3))
        return _Photon(place.xyz, turned.xyz, light.xyz, UInt32(light.w))

    def _chosen(self, point: Point) -> tuple[_Photon, Float]:
        """Return a photon for each point, and one over the density with which it is chosen; 0: there is none."""
        position, active = Array3f(point.hit.p), point.active & (self._count > 0)
        normal = Array3f(point.hit.n)
        own = Float(point.bounces)

        def consider(number: UInt32, total: Float, chosen: UInt32, best: Float) -> tuple[Any, ...]:
            seed = hash32(point.seed, number)
            index = dr.minimum(UInt32(unit_float(seed) * Float(self._count)), self._count - 1)
            place, turned = (dr.gather(Array4f, self._data, index * 4 + packet, active) for packet in range(2))
            to = place.xyz - position
            square = dr.maximum(dr.squared_norm(to), 1e-30)
            along = to * dr.rsqrt(square)
            cosines = (dr.abs(dr.dot(along, normal)) + _LOW) * (dr.maximum(-dr.dot(along, turned.xyz), 0) + _LOW)
            geometry = cosines * dr.rcp(square) * dr.rcp(dr.square(dr.pi))
            weight = dr.select(turned.w >= own, place.w * dr.minimum(geometry, self._bound), 0)
            total = total + weight
            takes = unit_float(hash32(seed, UInt32(1))) * total < weight
            return number + 1, total, dr.select(takes, index, chosen), dr.select(takes, weight, best)

        width = dr.width(position)
        zeros = dr.zeros(Float, width)
        _, total, chosen, weight = dr.while_loop(
            (dr.zeros(UInt32, width), zeros, dr.zeros(UInt32, width), zeros),
            lambda number, *_: active & (number < _CANDIDATES), consider, label="virtual lights",
        )  # fmt: skip
        factor = total * dr.rcp(dr.maximum(weight, 1e-30)) * (Float(self._count) / _CANDIDATES)
        return self._photon(chosen, active), dr.select(active & (weight > 0), factor, 0)
