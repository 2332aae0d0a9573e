"""What a lamp does: it emits light paths, lights points, and is seen by rays.

Surfaces and beams share this code: a beam through a portal *is* the light that `illuminate` finds at a point of the
portal, so the two cannot disagree.

The parameters of a lamp are opaque Dr.Jit values, with one struct for each kind. Structs of one kind are packed into
arrays and gathered in a loop, so that a kernel depends neither on the number of lights nor on their values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import drjit as dr
import numpy as np
import numpy.typing as npt

from ... import scene
from ...numerics.structs import Struct
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..bounds import Bounds
from ..warp import disk, perpendicular
from .rays import EmittedRays
from .shaping import ShapingFactor


class Illumination(Struct):
    """Light that arrives at a point from one sample of a light.

    `direction` points to the light, `distance` may be infinite, and `weight` is the radiance over the `pdf` per solid
    angle. A light without extent, which no ray can meet, has a `pdf` of 0; `weight` is then the irradiance on a plane
    that faces the light.
    """

    direction: Array3f
    distance: Float
    weight: Array3f
    pdf: Float


class LightHit(Struct):
    """What a ray sees of a light: `distance` (infinite where it misses), `radiance`, and the pdf of `illuminate`."""

    hit: Bool
    distance: Float
    radiance: Array3f
    pdf: Float


class Lamp(Struct):
    """Base of lamps; the fields of a subclass are what is packed. Lamps without fields are not packed.

    Attributes
    ----------
    record, stretched
        The class of the `scene.Light` that describes the lamp, and whether the light has a linear map, `shape`.
    infinite, environment
        Whether the lamp is infinitely far away, and whether its light comes from all directions.
    central
        Whether its light goes out from one point, which is then `center`.
    flat
        Whether it shines to one side of a plane, along `axis`.
    seen, illuminates
        Whether rays may see it, and whether it lights points, rather than shines along one direction.
    met
        Whether rays that mirrors or glass have turned meet it in walks.
    covered
        1 − cos of half of the angle that a lamp at infinity covers; 2 is the whole sky.
    images, lit
        The images that it shines through, by name; and the fraction of its paths that passes them, once it is known: by
        whether the paths go through the portal.
    filters
        The filters of its light, a `FilterChain`, or None.
    bare
        The lamp without its images and filters.
    directions
        What samples directions in which its light leaves: `sample(v)` returns them with their density.
    """

    record: ClassVar[type[scene.Light]]
    stretched = False
    infinite = environment = central = flat = False
    seen = illuminates = True
    met = False
    covered = 2.0
    images: Mapping[str, Any] = {}
    filters: Any = None
    lit: dict[bool, float]
    directions: Any

    @classmethod
    def describes(cls, light: scene.Light) -> bool:
        """Return whether a light is of this kind."""
        return isinstance(light, cls.record) and (getattr(light, "shape", None) is not None) == cls.stretched

    @property
    def sharp(self) -> bool:
        """Whether it looks small from a point: a lamp or the sun, not a sky."""
        return not self.environment

    @property
    def bare(self) -> Any:
        """The lamp without its images."""
        return self

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths: `u` places them on the lamp, `v` chooses their directions.

        Light from infinity enters the sphere `bounds`.
        """
        raise NotImplementedError

    def at(self, acting: UInt32 | None) -> Any:
        """Return the lamp for sites where these of its filters act: see `Linking.acting`."""
        return self

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a sample of the light that reaches a point."""
        raise NotImplementedError

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the lamp."""
        raise NotImplementedError

    def without_portal_gobo(self, point: Array3f, u: Array2f) -> Illumination:
        """Return `illuminate` as if there were no image on the portal."""
        return self.illuminate(point, u)

    def portal_color(self, point: Array3f) -> Array3f:
        """Return the colour of the image on the portal at a point of it."""
        return Array3f(1)

    def colors(self, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return what images and filters leave between a point and the lamp, `distance` away along `direction`."""
        return Array3f(1)


class Body(Lamp):
    """Base of lamps with a surface, which radiates evenly and outward."""

    radiance: Array3f
    center: Array3f
    axis: Array3f
    shaping: ShapingFactor

    def emitted(self, direction: Array3f) -> Array3f:
        """Return the radiance (of a point: the intensity) that leaves along `direction`."""
        return self.radiance * self.shaping.factor(dr.dot(direction, self.axis))

    def silhouette(self, direction: Array3f) -> Float:
        """Return the area of the lamp's projection along `direction`."""
        raise NotImplementedError

    def position(self, u: Array2f, direction: Array3f) -> Array3f:
        """Return a point from which light leaves along `direction`, uniform over the silhouette."""
        raise NotImplementedError

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths; those along one direction begin uniformly over the silhouette."""
        direction, density = self.directions.sample(v)
        area = self.silhouette(direction)
        flux = self.emitted(direction) * (area / density)
        return EmittedRays.fanned(self.position(u, direction), direction, flux, dr.sqrt(area), density)


def emit_from_infinity(lamp: Lamp, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
    """Return paths that begin on a disc that touches the bounding sphere and covers it."""
    sample = lamp.illuminate(dr.zeros(Array3f, dr.width(u)), v)
    direction = -sample.direction
    s, t = perpendicular(direction)
    offset = disk(u)
    origin = bounds.center + bounds.radius * (s * offset.x + t * offset.y - direction)
    area = dr.pi * bounds.radius * bounds.radius
    density = dr.select(sample.pdf > 0, sample.pdf, dr.inf)
    return EmittedRays.fanned(origin, direction, sample.weight * area, dr.sqrt(area) + 0 * u.x, density)


def unit(vector: npt.ArrayLike) -> np.ndarray:
    """Return a vector, (3,), with length 1."""
    numbers = np.asarray(vector, dtype=np.float64)
    return numbers / np.linalg.norm(numbers)
