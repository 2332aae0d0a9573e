"""Interfaces of media: which media a surface names, and which medium is at a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..shadow_rays import leaving, size_of
from ..warp import facing

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MediumPtr, MiMedium, MiScene, SurfaceInteraction

mi = mitsuba()

# The number that stands for an unknown medium.
UNKNOWN = 0xFFFFFFFF

# Most surfaces that a ray passes before an interface, and most steps of a random walk to one.
_LAYERS, _STEPS = 64, 32

# Lobes of surfaces that transmit light. Where such a surface names no medium, the medium goes on behind it.
_TRANSMITS = int(
    mi.BSDFFlags.Null | mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.GlossyTransmission
    | mi.BSDFFlags.DiffuseTransmission
)  # fmt: skip


def number(plugin: MiMedium | None) -> int:
    """Return the number of a medium, 0 for None."""
    return 0 if plugin is None else int(numbers(mi.MediumPtr(plugin))[0])


def numbers(media: MediumPtr) -> UInt32:
    """Return the numbers of an array of media."""
    return UInt32(dr.reinterpret_array(mi.UInt32, media))


def pointers(media: UInt32) -> Any:
    """Return pointers to the media with these numbers."""
    return dr.reinterpret_array(mi.MediumPtr, mi.UInt32(media))


@dataclass(frozen=True)
class Met:
    """The surfaces that rays meet, and the media that they name.

    Attributes
    ----------
    hit
        Mitsuba's surface interaction.
    interface
        Whether the surface names media.
    near, far
        The numbers of the media before and behind it, UNKNOWN where it names none.
    transmits
        Whether a ray may pass the surface.
    """

    hit: Any
    interface: Any
    near: Any
    far: Any
    transmits: Any


def meet(plugin: MiScene, origin: Array3f, direction: Array3f, active: Any) -> Met:
    """Return the surfaces that rays meet in a Mitsuba scene, and the media that these name."""
    along = mi.Vector3f(direction)
    hit = plugin.ray_intersect(mi.Ray3f(mi.Point3f(origin), along), active)
    valid = active & hit.is_valid()
    interface = valid & hit.is_medium_transition()
    near, far = (dr.select(interface, numbers(hit.target_medium(each)), UNKNOWN) for each in (-along, along))
    return Met(hit, interface, near, far, valid & transmits(hit))


def is_left(hit: SurfaceInteraction, direction: Array3f, medium: UInt32) -> Bool:
    """Return whether a hit is on a boundary by which rays may leave their medium, transparent or of glass."""
    return transmits(hit) & hit.is_medium_transition() & (numbers(hit.target_medium(mi.Vector3f(direction))) != medium)


def is_boundary(hit: SurfaceInteraction) -> Bool:
    """Return which hits are on boundaries of media that are no surfaces: light passes them, and nothing else."""
    lobes = UInt32(hit.bsdf().flags()) & int(mi.BSDFFlags.All)
    return hit.is_valid() & hit.is_medium_transition() & (lobes == int(mi.BSDFFlags.Null))


def transmits(hit: SurfaceInteraction) -> Bool:
    """Return whether light may pass a surface: glass, a translucent one, or a boundary with a null BSDF."""
    return (UInt32(hit.bsdf().flags()) & _TRANSMITS) != 0


def reflected(hit: SurfaceInteraction, direction: Array3f, aside: Array3f) -> Array3f:
    """Return directions reflected by surfaces: cosine-distributed, from random unit vectors `aside`."""
    normal = facing(Array3f(hit.n), direction)
    result = normal * 1.001 + aside
    return result * dr.rsqrt(dr.maximum(dr.squared_norm(result), 1e-12))


def medium_at(
    plugin: MiScene, origin: Array3f, direction: Array3f, otherwise: UInt32, everywhere: UInt32,
    active: Bool | bool = True, size: Float | None = None,
) -> UInt32:  # fmt: skip
    """Return the number of the medium at points, found by a random walk from each.

    Surfaces reflect a walk; it passes those that transmit light and name no medium. So it stays in the medium in which
    it began, and the first interface that it meets names that medium. If the interface has no medium on the near side,
    the point is in empty space, unless a later interface of the walk names a medium.

    Parameters
    ----------
    plugin
        The Mitsuba scene.
    origin, direction
        Rays along which walks begin.
    otherwise
        The medium of points whose walks find no interface.
    everywhere
        The medium of the background.
    active
        The points for which the medium is wanted.
    size
        The scene's diameter, if it is known: see `shadow_rays`.
    """
    diameter = size_of(plugin) if size is None else size
    width = max(dr.width(origin), dr.width(direction))
    lane = dr.arange(UInt32, width) + dr.opaque(UInt32, 0)

    def further(here: Array3f, along: Array3f, medium: UInt32, step: UInt32, going: Bool) -> tuple[Any, ...]:
        met = meet(plugin, here, along, going)
        escaped = going & ~met.hit.is_valid()
        medium = dr.select(met.interface, met.near, medium)
        medium = dr.select(escaped, everywhere, medium)
        going = going & ~escaped & ~(met.interface & (met.near > 0))
        along = dr.select(met.transmits & ~met.interface, along, reflected(met.hit, along, _unit(hash32(lane, step))))
        here = dr.select(going, leaving(met.hit, along, diameter), here)
        return here, along, medium, step + 1, going

    state = (
        origin + dr.zeros(Array3f, width), direction + dr.zeros(Array3f, width), dr.full(UInt32, UNKNOWN, width),
        dr.zeros(UInt32, width), active & dr.full(Bool, True, width),
    )  # fmt: skip
    end: Any = dr.while_loop(state, lambda *each: each[4] & (each[3] < _STEPS), further, label="medium_at")
    found = UInt32(end[2])
    return dr.select(found == UNKNOWN, otherwise, found)


def _unit(seed: UInt32) -> Array3f:
    """Return random unit vectors."""
    z = 2 * unit_float(seed) - 1
    sine, cosine = dr.sincos(2 * dr.pi * unit_float(hash32(seed)))
    across = dr.safe_sqrt(1 - z * z)
    return Array3f(across * cosine, across * sine, z)


def distance_to_medium(
    plugin: MiScene, origin: Array3f, direction: Array3f, medium: UInt32, active: Bool, size: Float, ends: bool = False
) -> Float:
    """Return the distance along rays to the first boundary behind which a medium begins; infinite if there is none.

    With `ends`, boundaries before which it ends count, too. `plugin` has boundaries alone, and `size` is the scene's
    diameter.
    """

    def further(here: Array3f, distance: Float, layer: UInt32, going: Bool) -> tuple[Any, ...]:
        hit = plugin.ray_intersect(mi.Ray3f(mi.Point3f(here), mi.Vector3f(direction)), going)
        going = going & hit.is_valid()
        found = going & (numbers(hit.target_medium(mi.Vector3f(direction))) == medium)
        if ends:
            found |= going & (numbers(hit.target_medium(mi.Vector3f(-direction))) == medium)
        distance = dr.select(found, dr.dot(Array3f(hit.p) - origin, direction), distance)
        going = going & ~found
        here = dr.select(going, leaving(hit, direction, size), here)
        return here, distance, layer + 1, going

    width = dr.width(origin)
    state = Array3f(origin), dr.full(Float, dr.inf, width), dr.zeros(UInt32, width), Bool(active)
    return dr.while_loop(state, lambda *each: each[3] & (each[2] < _LAYERS), further, label="to medium")[1]


def medium_ahead(plugin: MiScene, origin: Array3f, direction: Array3f, active: Bool, size: Float) -> UInt32:
    """Return the medium that the next interface along rays names on its near side, by number; 0 if there is none.

    Rays pass surfaces that transmit light and name no medium; opaque ones stop them. `size` is the scene's diameter.
    """

    def further(here: Array3f, medium: UInt32, layer: UInt32, going: Bool) -> tuple[Any, ...]:
        met = meet(plugin, here, direction, going)
        medium = dr.select(met.interface, met.near, medium)
        going = going & met.hit.is_valid() & met.transmits & ~met.interface
        here = dr.select(going, leaving(met.hit, direction, size), here)
        return here, medium, layer + 1, going

    width = max(dr.width(origin), dr.width(direction))
    state = (
        origin + dr.zeros(Array3f, width), dr.zeros(UInt32, width), dr.zeros(UInt32, width),
        active & dr.full(Bool, True, width),
    )  # fmt: skip
    return dr.while_loop(state, lambda *each: each[3] & (each[2] < _LAYERS), further, label="ahead")[1]
