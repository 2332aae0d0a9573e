"""Records of light transport: paths, their segments in media, and photon hits on surfaces."""

from __future__ import annotations

from enum import IntFlag
from typing import Any

import drjit as dr

from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...world.differentials import RayDifferentials
from .radii import Width
from .sides import Sides


class Counts(IntFlag):
    """Which light of a path counts: its segments in media as beams, its hits on surfaces as photons.

    Light that only counts as caustics must first be turned by mirrors or glass, before anything else turns it. Photons
    of such light count up to the first surface that scatters it: what that surface reflects is met by walks. Direct
    photons are those straight from their emitter, as virtual lights.
    """

    NOTHING = 0
    BEAMS = 1
    PHOTONS = 2
    CAUSTIC_BEAMS = 4
    CAUSTIC_PHOTONS = 8
    DIRECT_PHOTONS = 16
    DIRECT_BEAMS = 32
    TALLIED = 64
    FURTHER = BEAMS | PHOTONS
    ALL = FURTHER | DIRECT_BEAMS | TALLIED
    CAUSTICS = CAUSTIC_BEAMS | CAUSTIC_PHOTONS


class LightPaths(Struct):
    """Light paths after a scattering event, or as they leave their emitter.

    Attributes
    ----------
    origin, direction
        Where a path is, and where it goes.
    flux, initial
        Its flux, and the largest channel of its initial flux: as emitted or, for a part of a split path, as it began.
    medium
        The number of the medium around it.
    number, index, key, source, link
        Its number in the pass; its number in its sample sequence, and a key of that sequence; the number of its source;
        and the number of the set of surfaces that block its light.
    depth, counts
        The number of scattering events so far, in media and on surfaces; and which of its light counts, a `Counts`.
    straight
        Whether it has met nothing but boundaries of media.
    coherent, differentials, radius
        Whether all its interactions were specular; its ray differentials, which then say how far apart its neighbours
        are; and the radius of paths that are not coherent.
    count, fraction
        The length of its sequence, and the probability of the specular lobes that it took: a few hundredths for a
        reflection on glass.
    branch, part
        The kind of its next interaction, and its number among the parts that split off the same path; else 0.
    reach
        Its length if it meets nothing.
    offset, portal, total
        For light straight from a lamp: its distance from the lamp; the portal's distance from the lamp, or infinity;
        and the distance from the lamp to the surface that stops it.
    against
        The normal of that surface, toward the light, or the direction to the lamp.
    narrow, clear
        A factor on its radius, and the distance from the lamp at which it begins to apply: where the first surface is
        that blocks the rim. Light that was scattered has it all along.
    width
        The width of light straight from a lamp, whatever it meets: beams past an edge are as wide as those beside them.
    slant
        If it has just entered its medium, the tangent of its angle to the normal of the boundary; else 0.
    """

    origin: Array3f
    direction: Array3f
    flux: Array3f
    initial: Float
    medium: UInt32
    number: UInt32
    index: UInt32
    key: UInt32
    source: UInt32
    link: UInt32
    depth: UInt32
    counts: UInt32
    straight: Bool
    coherent: Bool
    differentials: RayDifferentials
    radius: Float
    count: Float
    fraction: Float
    branch: UInt32
    part: UInt32
    reach: Float
    offset: Float
    portal: Float
    total: Float
    against: Array3f
    narrow: Float
    clear: Float
    width: Width
    slant: Float

    @property
    def beaming(self) -> Bool:
        """Whose segments in media count."""
        further = self.counting(Counts.BEAMS, Counts.CAUSTIC_BEAMS) & ~self.straight
        return further | (self.straight & ((self.counts & int(Counts.DIRECT_BEAMS)) > 0))

    def counting(self, always: Counts, caustics: Counts) -> Bool:
        """Return whose light counts: with a flag of `always`, or with one of `caustics` if mirrors or glass turned it.

        What else turns a path takes its flags of caustics away.
        """
        return ((self.counts & int(always)) > 0) | (((self.counts & int(caustics)) > 0) & ~self.straight)


class Segments(Struct):
    """Segments of light paths, with the `flux` at the start, and the `length`, `width` and `normal` at the end.

    `slant_end` is the tangent of the angle to the boundary's normal where light leaves the medium, else 0. Other
    attributes are those of `LightPaths`; `scattered` says whose neighbours are not known. `room` and `room_end` say how
    far light straight from its lamp may reach before the start and beyond the end: no further than where another
    segment of the path in the medium does. `sides` are the walls beside scattered light, once these are known.
    """

    origin: Array3f
    direction: Array3f
    flux: Array3f
    length: Float
    normal: Array3f
    width: Width
    scattered: Bool
    medium: UInt32
    depth: UInt32
    number: UInt32
    index: UInt32
    key: UInt32
    source: UInt32
    offset: Float
    portal: Float
    total: Float
    against: Array3f
    narrow: Float
    clear: Float
    slant: Float
    slant_end: Float
    room: Float
    room_end: Float
    sides: Sides | None = None


class PhotonHits(Struct):
    """Photons on surfaces; `direction` is that of the light, and `straight` whether it comes so from its emitter.

    `whole` are those of emitters of which photons find all further light.
    """

    position: Array3f
    normal: Array3f
    direction: Array3f
    flux: Array3f
    radius: Float
    coherent: Bool
    straight: Bool
    whole: Bool
    depth: UInt32
    number: UInt32
    source: UInt32


def tangent(normal: Any, direction: Array3f) -> Float:
    """Return the tangent of the angle between a ray and a surface's normal."""
    cosine2 = dr.square(dr.dot(Array3f(normal), direction))
    return dr.safe_sqrt((1 - cosine2) * dr.rcp(dr.maximum(cosine2, 1e-6)))
