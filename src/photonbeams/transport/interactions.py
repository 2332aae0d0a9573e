"""Interactions of light paths: free flights, and scattering by media and surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import drjit as dr

from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ..world.media.interfaces import pointers
from ..world.media.media import Media
from ..world.media.tracking import free_flight
from ..world.shadow_rays import leaving
from ..world.spectra import rgb
from ..world.warp import outward

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import BsdfSample, Spectrum, SurfaceInteraction
    from ..world.world import World
    from .aiming import Aimed
    from .paths import Tracing
    from .segments.records import LightPaths

mi = mitsuba()

# Number of scattering events after which even paths that lose no flux end by Russian roulette.
_LONG = 256

#: Kinds of a path's next interaction. SAMPLED: as it comes, or so after a null collision (TINTED). SCATTERED: in the
#: medium. Others are on the next surface, from which the path goes on by ideal lobes alone (IDEAL), or by all others
#: (REFLECTED).
SAMPLED, SCATTERED, TINTED, IDEAL, REFLECTED = 0, 1, 2, 3, 4


class Interaction:
    """The next interaction of each path.

    Attributes
    ----------
    scatters, tinted, on_surface
        Whether the medium scatters the light; whether the medium only changes its colour (a null collision); and
        whether the light meets a surface.
    distance, weight
        Distance to the interaction, and the weight of the free flight up to it.
    length
        Distance to the next surface.
    fractions
        The fraction of the path's flux in each channel.
    varying
        Whether the medium is heterogeneous.
    position, site
        Where the interaction is, and with what: see `Linking`.
    smooth
        Whether the next surface has lobes other than ideal ones.
    hit, valid
        Mitsuba's record of the next surface, and whether there is one.
    going
        Whether the path goes on.
    """

    def __init__(self, tracing: Tracing, paths: LightPaths, hit: SurfaceInteraction, stream: UInt32) -> None:
        media, index = tracing.world.media, paths.index
        self.hit = hit
        self.valid = hit.is_valid()
        self.length = dr.select(self.valid, hit.t, dr.select(paths.medium > 0, paths.reach, 0))
        self.fractions = paths.flux * dr.rcp(dr.maximum(dr.sum(paths.flux), 1e-30))
        own = flown(
            media, paths, self.length, branch=paths.branch, fractions=self.fractions, active=Bool(True), stops=True,
            u=pixel_sample(index, hash32(stream, UInt32(Stream.FLIGHT))),
            seed=hash32(index, stream, UInt32(Stream.FLIGHT)),
        )  # fmt: skip
        self.scatters, self.tinted, self.varying, self.weight = own.scatters, own.tinted, own.varying, own.weight
        self.on_surface = self.valid & ~self.scatters & ~self.tinted
        self.distance = dr.minimum(own.distance, self.length)
        self.position = paths.origin + self.distance * paths.direction
        self.site = dr.select(self.on_surface, tracing.world.linking.of_surfaces(hit), paths.medium)
        self.smooth = self.valid & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Smooth)
        self.going = self.scatters | self.tinted | self.on_surface


class MediumRays(Protocol):
    """Rays, and the numbers of the media in which they begin."""

    origin: Array3f
    direction: Array3f
    medium: UInt32


@dataclass(frozen=True)
class Flown:
    """Free flights: distances, weights, and how they end; `varying` says whose media vary."""

    distance: Float
    weight: Array3f
    scatters: Bool
    tinted: Bool
    varying: Bool


def flown(
    media: Media, rays: MediumRays, length: Float, *, branch: UInt32, fractions: Array3f,
    active: Bool, u: Array2f, seed: UInt32, stops: bool = False,
) -> Flown:  # fmt: skip
    """Return the free flights of rays in their media, up to a length.

    Parameters
    ----------
    branch, fractions, u
        As for `flight`, in homogeneous media; in those that vary, flights are sampled with the `seed` where `active`.
    stops
        Whether flights end at each tentative collision in media whose extinction varies and has a colour.
    """
    distance, weight = flight(media, rays.medium, branch, fractions, length, u)
    scatters, nowhere = distance < length, dr.zeros(Bool, dr.width(distance))
    if not media.any_varying:
        return Flown(distance, weight, scatters, tinted=nowhere, varying=nowhere)
    varying, colored = media.varying(rays.medium)
    varying &= active
    other, collided, scattered, color = free_flight(
        media=pointers(dr.select(varying, rays.medium, 0)),
        origin=rays.origin,
        direction=rays.direction,
        length=length,
        fractions=fractions,
        seed=seed,
        active=varying,
        stops=colored & Bool(stops),
    )
    return Flown(
        dr.select(varying, other, distance), dr.select(varying, color, weight),
        dr.select(varying, scattered, scatters), tinted=varying & collided & ~scattered, varying=varying,
    )  # fmt: skip


def flight(
    media: Media, medium: UInt32, branch: UInt32, fractions: Array3f, length: Float, u: Array2f
) -> tuple[Float, Array3f]:
    """Return the distances of free flights in homogeneous media, and their weights.

    A channel is chosen with a probability proportional to its flux, so that no colour is carried by few paths. `branch`
    says whether a flight is sampled, or is certain to end before `length`, or at it. `u` are points of the unit square.
    """
    extinction = media.extinction(medium)
    own = dr.select(
        u.x < fractions.x, extinction.x, dr.select(u.x < fractions.x + fractions.y, extinction.y, extinction.z)
    )
    surely = branch == SCATTERED
    # The probability that a flight ends before the surface.
    depth = own * dr.minimum(length, 1e30)
    ending = dr.select(surely, _ending(depth), 1)
    distance = dr.select(own > 0, -dr.log(1 - u.y * ending) * dr.rcp(dr.maximum(own, 1e-30)), dr.inf)
    distance = dr.select(surely & (own > 0), dr.minimum(distance, length * (1 - 1e-6)), distance)
    passes = branch >= IDEAL
    distance = dr.select(passes, dr.inf, distance)
    scatters = distance < length
    passed = media.absorbed(medium, dr.minimum(distance, length))
    rate = dr.select(surely, _surely(extinction, length), extinction)
    density = dr.sum(fractions * passed * dr.select(scatters, rate, 1))
    scattering = dr.select(scatters, media.scattering(medium), Array3f(1))
    weight = dr.select(density > 0, passed * scattering * dr.rcp(density), 0)
    weight = dr.select(surely & ~scatters, 0, weight)
    return distance, dr.select(passes, passed, weight)


def scattering_density(media: Media, medium: UInt32, fractions: Array3f, length: Float, distance: Float) -> Float:
    """Return the density of `distance` for a `flight` that is certain to end before `length`."""
    rate = _surely(media.extinction(medium), length)
    return dr.sum(fractions * rate * media.absorbed(medium, distance))


def _surely(extinction: Array3f, length: Float) -> Array3f:
    """Return the rates, at its beginning, of flights that are certain to end before `length`."""
    return extinction * dr.rcp(dr.maximum(_ending(extinction * dr.minimum(length, 1e30)), 1e-30))


def _ending(depth: dr.ArrayT) -> dr.ArrayT:
    """Return 1 − exp(−x), by its series where float32 would cancel."""
    return dr.select(depth < 1e-3, depth * (1 - 0.5 * depth), 1 - dr.exp(-depth))


def survival(part: Float, depth: UInt32) -> Float:
    """Return the probability with which paths survive Russian roulette: the fraction `part` of their flux that is left.

    So no path gets more flux than it began with. Only for long paths is the probability at most 0.95, because paths in
    a closed white room would never end. With that limit from the start, the longest paths through white fog, twenty
    free paths deep, were a thousand times as bright as the others.
    """
    return dr.minimum(part, dr.select(depth < dr.opaque(UInt32, _LONG), Float(1), Float(0.95)))


class Scatter:
    """A sample of the BSDF at hits: the ray that leaves, its weight, and the `probability` of its lobe if ideal.

    `ratio` is the density of directions without openings over that with them (see `aiming`); the weight includes it.
    """

    def __init__(
        self, origin: Array3f, direction: Array3f, weight: Array3f, delta: Bool, null: Bool, medium: UInt32,
        probability: Float, ratio: Float,
    ) -> None:  # fmt: skip
        self.origin, self.direction, self.weight = origin, direction, weight
        self.delta, self.null, self.medium = delta, null, medium
        self.probability, self.ratio = probability, ratio


def reflect(
    world: World, hit: Any, active: Bool, medium: UInt32, index: UInt32, stream: UInt32,
    aimed: Aimed | None = None,
) -> Scatter:  # fmt: skip
    """Return a sample of the BSDF for light that comes through `medium` (Veach 1997, section 5.3: shading normals).

    Parameters
    ----------
    aimed
        Directions to openings, which are mixed with those of the BSDF; None: no openings.
    """
    sample, weight = sampled(world, hit, active, index, stream)
    ratio = Float(1)
    if aimed is not None:
        sample, weight, ratio = _mixed(world, hit, active, sample, weight, aimed)
    direction = hit.to_world(sample.wo)
    incoming = hit.to_world(hit.wi)
    kind = sample.sampled_type
    delta, null = mi.has_flag(kind, mi.BSDFFlags.Delta), mi.has_flag(kind, mi.BSDFFlags.Null)
    normal = outward(hit)
    geometric_in, geometric_out = dr.dot(normal, incoming), dr.dot(normal, direction)
    shading_in, shading_out = dr.dot(hit.sh_frame.n, incoming), dr.dot(hit.sh_frame.n, direction)
    leak = (geometric_in * shading_in <= 0) | (geometric_out * shading_out <= 0)
    value = rgb(weight) * dr.abs(shading_in * geometric_out * dr.rcp(shading_out * geometric_in))
    if world.perturbed:
        turned = _of_own_normal(hit, sample, weight, delta & ~null, active)
        value = dr.select(null, value, turned * dr.abs(geometric_out * dr.rcp(geometric_in)))
    value *= ratio
    good = active & (sample.pdf > 0) & ~leak & dr.isfinite(dr.sum(value))
    origin = leaving(hit, direction, world.size)
    probability = dr.select(good & (delta | null), dr.clip(sample.pdf, 1e-4, 1), 1)
    entered = world.media.beyond(hit, direction, medium, good)
    value = dr.select(good, value, 0)
    return Scatter(
        origin=origin,
        direction=Array3f(direction),
        weight=value,
        delta=delta | null,
        null=null,
        medium=entered,
        probability=probability,
        ratio=ratio,
    )


def _mixed(
    world: World, hit: Any, active: Bool, sample: BsdfSample, weight: Spectrum, aimed: Aimed
) -> tuple[Any, Any, Float]:
    """Return samples of a BSDF mixed with directions to openings, their weights, and the ratio of their densities."""
    bsdf, context = hit.bsdf(), mi.BSDFContext(mi.TransportMode.Importance)
    smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    taken = smooth & aimed.taken
    sample.wo = dr.select(taken, hit.to_local(mi.Vector3f(aimed.direction)), sample.wo)
    sample.sampled_type = dr.select(taken, UInt32(int(mi.BSDFFlags.Glossy)), sample.sampled_type)
    sample.eta = dr.select(taken, 1, sample.eta)
    ideal = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta) | mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    value, density = bsdf.eval_pdf(context, hit, sample.wo, smooth & ~ideal)
    known = density > 0
    weight = dr.select(taken, dr.select(known, value * dr.rcp(dr.select(known, density, 1)), 0), weight)
    sample.pdf = dr.select(taken, density, sample.pdf)
    if world.cutouts:  # the density given that the surface is opaque: see `sampled`
        density *= dr.rcp(dr.maximum(world.opacity(hit, active), 1e-6))
    ratio = aimed.ratio(hit.to_world(sample.wo), density, ~ideal)
    return sample, weight, dr.select(smooth, ratio, 1)


def _of_own_normal(hit: SurfaceInteraction, sample: BsdfSample, weight: Spectrum, ideal: Bool, active: Bool) -> Array3f:
    """Return the weight of a sample without the cosines to the geometric normal, for a BSDF with its own normal N.

    In importance mode, Mitsuba's BSDFs multiply by the cosine between N and the outgoing direction, although that of
    the incident direction belongs there. The value for the reverse direction has the right cosine, and is divided by
    the sample's pdf. An ideal lobe has no such value, but its N is known: for reflection and refraction, the incident
    direction plus η times the outgoing one is a multiple of N.
    """
    seen = type(hit)(hit)
    seen.wi = sample.wo
    bsdf = hit.bsdf()
    value = rgb(bsdf.eval(mi.BSDFContext(), seen, hit.wi, active))
    pdf = bsdf.pdf(mi.BSDFContext(mi.TransportMode.Importance), hit, sample.wo, active)
    normal = hit.wi + sample.eta * sample.wo
    ratio = dr.abs(dr.dot(normal, hit.wi) * dr.rcp(dr.dot(normal, sample.wo)))
    return dr.select(ideal, rgb(weight) * ratio, dr.select(pdf > 0, value * dr.rcp(pdf), 0))


def sampled(world: World, hit: SurfaceInteraction, active: Any, index: UInt32, stream: UInt32) -> Any:
    """Return Mitsuba's sample of the BSDF and its weight.

    That a cut-out surface stops a path was already decided, with the probability of its opacity.
    """
    lobe = unit_float(hash32(index, stream, UInt32(Stream.LOBE)))
    if world.cutouts:
        lobe *= world.opacity(hit, active)
    u = pixel_sample(index, hash32(stream, UInt32(Stream.TURN)))
    return hit.bsdf().sample(mi.BSDFContext(mi.TransportMode.Importance), hit, lobe, mi.Point2f(u), active)
