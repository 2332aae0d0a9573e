"""Points that scatter light toward the camera, and walks, which go on from them: see `walks`."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any

import drjit as dr

from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ...world.media.phases import Phases
from ...world.shadow_rays import leaving
from ...world.spectra import rgb
from ...world.world import World

mi = mitsuba()


class Walk(Struct):
    """Walks.

    Attributes
    ----------
    origin, direction, medium
        The current rays of walks, and the media in which these begin.
    first, length
        Whether a walk is still on the camera's own segment. It ends there unless it is scattered before `length`.
    throughput, initial
        The path's throughput, and its largest channel after the first scattering event. Where that event is certain,
        the latter is small.
    depth, before
        How often the path was scattered; and how often so before the walk began, by mirrors and glass.
    counts
        Whether emitters that the ray meets count: not after the first surface, whose direct light is counted elsewhere.
    place, pdf, inside, site
        Where the walk was last scattered, the density of its direction per solid angle, 0 after ideal lobes, whether
        that was in a medium, and at which site (see `Linking`).
    lamp
        The emitter that was chosen there: it is sampled there and along the segment that begins there, toward which
        that may go, and of lamps that are no surfaces it is the one that the segment may meet.
    value, bright
        BSDF times cosine for the walk's direction, its largest channel, 0 after ideal lobes and in media; and the
        radiance that a virtual light of unit flux where the walk was last scattered would bring, if the walk now meets
        its lamp, infinite if there cannot be one: see `virtual_lights`.
    order, pixel, branch
        The pixel's place in the sample sequences, the pixel, and the branch of its camera paths.
    name
        The name of the camera vertex at which the walk began.
    """

    origin: Array3f
    direction: Array3f
    medium: UInt32
    first: Bool
    length: Float
    throughput: Array3f
    initial: Float
    depth: UInt32
    before: UInt32
    counts: Bool
    place: Array3f
    pdf: Float
    inside: Bool
    site: UInt32
    lamp: UInt32
    value: Float
    bright: Float
    order: UInt32
    pixel: UInt32
    branch: UInt32
    name: UInt32

    @property
    def bounces(self) -> UInt32:
        """How often light that a walk now meets was scattered before it is scattered toward the camera.

        The walk's first scattering event is the one toward the camera.
        """
        return self.depth - self.before - 1

    @property
    def ray(self) -> ScatteredRay:
        """The current rays."""
        result = ScatteredRay()
        for each in result.DRJIT_STRUCT:
            setattr(result, each, getattr(self, each))
        return result


class ScatteredRay(Struct):
    """Rays in directions in which vertices scatter light toward the camera, as in `Walk`."""

    origin: Array3f
    direction: Array3f
    medium: UInt32
    place: Array3f
    pdf: Float
    inside: Bool
    site: UInt32
    lamp: UInt32
    bounces: UInt32


class DirectionSample(Struct):
    """A sample of a direction at a vertex.

    Attributes
    ----------
    direction
        The direction, in world space.
    value, weight, pdf
        The phase function, or BSDF times cosine; that over the density of the sample; and the density that the phase
        function or BSDF by itself has there, against which samples of emitters are weighted; 0: there is no sample.
    ideal, null
        Whether an ideal lobe was sampled, which has no value, and whether that goes straight through.
    """

    direction: Array3f
    value: Array3f
    weight: Array3f
    pdf: Float
    ideal: Bool
    null: Bool


class Vertex:
    """Points that scatter light toward the camera, `scattered` in a medium or `on_surface`.

    Attributes
    ----------
    world, hit, medium, incident
        The world, Mitsuba's interactions with surfaces, the media before these, and the directions in which rays
        arrive.
    position, opacity, site
        Where the points are, the opacity of surfaces as in `World.opacity`, and the sites of `Linking`.
    bounces
        How often light that arrives here is scattered before it is scattered toward the camera.
    """

    def __init__(
        self, world: World, hit: Any, *, medium: UInt32, incident: Array3f, bounces: UInt32, position: Array3f,
        scattered: Bool, on_surface: Bool,
    ) -> None:  # fmt: skip
        self.world, self.hit, self.medium, self.incident, self.bounces = world, hit, medium, incident, bounces
        self.scattered, self.on_surface = scattered, on_surface
        self.position = dr.select(on_surface, Array3f(hit.p), position)
        # A cut-out surface was already sampled as opaque: undo the opacity factor of Mitsuba's `mask`.
        self.opacity = world.opacity(hit, on_surface)
        self.site = dr.select(on_surface, world.linking.of_surfaces(hit), medium)

    @classmethod
    def of_surfaces(cls, world: World, hit: Any, medium: UInt32, active: Bool) -> Vertex:
        """Return the first smooth surfaces of camera paths, where they are active."""
        place, incident = Array3f(hit.p), -Array3f(hit.to_world(hit.wi))
        result = cls(
            world, hit, medium=medium, incident=incident, bounces=UInt32(0), position=place, scattered=Bool(False),
            on_surface=active,
        )  # fmt: skip
        result.smooth = active
        return result

    @cached_property
    def smooth(self) -> Bool:
        """Which vertices are on surfaces that scatter light other than by ideal lobes."""
        return self.on_surface & mi.has_flag(self.hit.bsdf().flags(), mi.BSDFFlags.Smooth)

    def reference(self) -> Any:
        """Return the places as Mitsuba's interactions, with a normal where they are on smooth surfaces."""
        return interaction(self.position, dr.select(self.smooth, Array3f(self.hit.n), 0))

    @property
    def _phases(self) -> Phases:
        """The phase functions of the media in which light is scattered."""
        return Phases(self.position, self.incident, self.medium, self.scattered)

    def inside(self, position: Array3f, scattered: Bool) -> Vertex:
        """Return vertices in media elsewhere on the same segments."""
        result = copy(self)
        result.__dict__.pop("smooth", None)
        result.position, result.scattered, result.on_surface = position, scattered, Bool(False)
        result.site = self.medium
        return result

    def leaving(self, direction: Array3f) -> Array3f:
        """Return the origins of rays that leave in directions."""
        return dr.select(self.on_surface, leaving(self.hit, direction, self.world.size), self.position)

    def ahead(self, direction: Array3f, pdf: Float, lamp: UInt32) -> ScatteredRay:
        """Return the rays that leave in directions of a density; of emitters that are no surfaces they meet `lamp`."""
        result, beyond = ScatteredRay(), self.world.media.beyond(self.hit, direction, self.medium, self.on_surface)
        result.origin = self.leaving(direction)
        result.medium = dr.select(self.on_surface, beyond, self.medium)
        result.direction, result.pdf, result.place = direction, pdf, self.position
        result.inside, result.site, result.lamp, result.bounces = self.scattered, self.site, lamp, self.bounces
        return result

    def evaluate(self, direction: Array3f, active: Bool) -> tuple[Array3f, Float]:
        """Return the phase function, or BSDF times cosine, for a direction, and its density."""
        towards = mi.Vector3f(direction)
        value, pdf = self.hit.bsdf().eval_pdf(
            mi.BSDFContext(), self.hit, self.hit.to_local(towards), active & self.on_surface
        )
        value, pdf = rgb(value) / self.opacity, pdf / self.opacity
        other = self.phased(direction, active & self.scattered)
        return dr.select(self.scattered, other[0], value), dr.select(self.scattered, other[1], pdf)

    def phased(self, direction: Array3f, active: Bool) -> tuple[Array3f, Float]:
        """Return the phase function in media for a direction, and its density."""
        return self._phases.value(direction, active)

    def directed(self, lobe: Float, turn: Array2f) -> DirectionSample:
        """Return samples of the phase functions or BSDFs, by a number that chooses the lobe and a point."""
        u, own = mi.Point2f(turn), self.on_surface
        # Sample all lobes: with a mask, Mitsuba's cut-out surfaces sample only the light that passes them.
        sample, weight = self.hit.bsdf().sample(mi.BSDFContext(), self.hit, lobe * self.opacity, u, own)
        chosen: list[Any] = [Array3f(self.hit.to_world(sample.wo)), rgb(weight), sample.pdf / self.opacity]
        kind = sample.sampled_type
        # Mitsuba's `Delta` includes `Null`.
        ideal, null = (own & mi.has_flag(kind, flag) for flag in (mi.BSDFFlags.Delta, mi.BSDFFlags.Null))
        if self.world.media.all:
            others = self._phases.sample(lobe, turn, self.scattered)
            chosen = [dr.select(self.scattered, *each) for each in zip(others, chosen, strict=True)]
        direction, factor, density = chosen
        return DirectionSample(direction, factor * density, factor, density, ideal, null)


def steepness(hit: Any, direction: Array3f) -> Float:
    """Return the cosine between a direction and the plane's normal at hits, above 0."""
    normal: Any = Array3f(hit.n)
    return dr.maximum(dr.abs(dr.dot(normal, direction)), 1e-4)


def interaction(place: Array3f, normal: Array3f) -> Any:
    """Return Mitsuba's interactions at places."""
    result = dr.zeros(mi.Interaction3f, dr.width(place))
    result.p, result.n = mi.Point3f(place), mi.Normal3f(normal)
    return result
