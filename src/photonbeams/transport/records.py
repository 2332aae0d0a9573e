"""Records of light transport: paths, their segments in media, and photon hits on surfaces."""

from __future__ import annotations

from ..numerics.structs import Struct
from ..runtime.device import Array3f, Bool, Float, UInt32
from .differentials import RayDifferentials
from .radii import Width


class LightPaths(Struct):
    """Light paths after a scattering event, or as they leave their emitter.

    Attributes
    ----------
    flux, initial
        The flux of a path, and the largest channel of the flux that it was emitted with, or that a part had at first.
    medium
        Number of the medium around it.
    number, index, key, source, link
        The path's place in its pass; its place in its sample sequence, and a key of that sequence; its emitter's
        number, and the number of the surfaces that stop its emitter's light.
    depth
        Scattering events so far, in media and on surfaces.
    straight
        Whether it has met nothing but boundaries of media.
    coherent, tangents, radius
        Whether all its interactions were specular, so that its differentials tell how far apart its neighbours are; and
        the radius of other paths.
    count, fraction
        Length of the path's sequence, and the probability of the specular lobes that it took: of a reflection on glass,
        a few hundredths.
    branch, part
        The kind of its next interaction; its number among the parts that split off the same path, else 0.
    reach
        Its length where it meets nothing.
    offset, portal, total, narrow
        Of light straight from a lamp: distance from the lamp; distance of the portal from the lamp, or infinity;
        distance from the lamp to the surface that stops it; a factor on its radius.
    slant
        Tangent of its angle to the normal of the boundary where it has just entered its medium; 0 of other paths.
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
    narrow: Float
    slant: Float


class Segments(Struct):
    """Segments of light paths: `flux` at the start, `normal` at the end; other attributes are those of `LightPaths`.

    `slant_end` is the tangent of the angle to the normal of the boundary where light leaves the medium, else 0.
    """

    origin: Array3f
    direction: Array3f
    flux: Array3f
    length: Float
    normal: Array3f
    width: Width
    medium: UInt32
    depth: UInt32
    number: UInt32
    index: UInt32
    key: UInt32
    source: UInt32
    offset: Float
    portal: Float
    total: Float
    narrow: Float
    slant: Float
    slant_end: Float


class PhotonHits(Struct):
    """Photons on surfaces that do not come straight from an emitter: `direction` is that of the light."""

    position: Array3f
    normal: Array3f
    direction: Array3f
    flux: Array3f
    radius: Float
    coherent: Bool
    depth: UInt32
    number: UInt32
    source: UInt32
