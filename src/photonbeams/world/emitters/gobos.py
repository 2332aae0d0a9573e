"""Gobos: images that a light shines through, and images on its portal.

A gobo is a rectangle in a plane, and a light path takes the colour of the image where its line crosses that plane.
Where the rectangle lies depends on the light. Before a point, a spot or a sphere it is a slide, projected from the
light's centre. On a rectangle or a disc it is the light's own face. Before a distant light it is a slide square to the
light, of a given width. On a portal it is the portal's bounding rectangle, or that of each of its openings.

A light with images is a lamp of its own class, which wraps the bare lamp; so lights without images cost no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cache
from typing import Any, ClassVar

import drjit as dr
import numpy as np
import numpy.typing as npt

from ... import scene
from ...numerics.arrays import opaque, padded, to_uint, to_vectors
from ...numerics.structs import Struct, pack
from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..bounds import Bounds
from .filters import FilterChain, filter_of, seed_of
from .lamp import Illumination, Lamp, LightHit
from .portals import Portal
from .profiles import ProfileSampler, ProfileTable
from .rays import EmittedRays

#: Device images by the `id` of the host's images, which are kept with them, so that no other image gets that `id`.
Images = dict[int, tuple[Any, Any]]


class Slide(Struct):
    """An image in a rectangle; `first` is the index of its first pixel in an array of the pixels of many images.

    A place q has the coordinates u = (q − center) · dual_x + ½, and v likewise. They go from 0 to 1 over the image, and
    its first row is at v = 1. `normal` is the direction in which light passes the slide.
    """

    center: Array3f
    dual_x: Array3f
    dual_y: Array3f
    normal: Array3f
    first: UInt32
    columns: Float
    rows: Float
    repeat: Float

    @classmethod
    def of(
        cls, gobo: scene.Gobo, center: npt.ArrayLike, edge_x: npt.ArrayLike, edge_y: npt.ArrayLike,
        normal: npt.ArrayLike,
    ) -> Slide:  # fmt: skip
        """Return a slide whose image goes along `edge_x` and, upward, along `edge_y`."""
        result = cls()
        dual = np.linalg.pinv(np.array([edge_x, edge_y], dtype=np.float64))
        result.center, result.normal = opaque(center), opaque(normal)
        result.dual_x, result.dual_y = opaque(dual[:, 0]), opaque(dual[:, 1])
        rows, columns = np.shape(gobo.image)[:2]
        result.first = dr.opaque(UInt32, 0)
        result.columns, result.rows = opaque(columns), opaque(rows)
        result.repeat = opaque(1.0 if gobo.repeat else 0.0)
        return result

    def crossing(self, origin: Array3f, direction: Array3f) -> tuple[Float, Array2f]:
        """Return the distance along a line to the slide's plane, and the coordinates at the crossing."""
        cosine: Any = dr.dot(direction, self.normal)
        cosine = dr.copysign(dr.maximum(dr.abs(cosine), 1e-9), cosine)
        distance = dr.dot(self.center - origin, self.normal) / cosine
        offset = origin + distance * direction - self.center
        return distance, Array2f(dr.dot(offset, self.dual_x) + 0.5, dr.dot(offset, self.dual_y) + 0.5)

    def within(self, place: Array2f) -> Bool:
        """Return whether coordinates are on the image."""
        return (dr.minimum(place.x, place.y) >= 0) & (dr.maximum(place.x, place.y) <= 1)

    def color(self, place: Array2f, pixels: Array3f) -> Array3f:
        """Return the image at coordinates, interpolated bilinearly; it is black around the image, or repeats."""
        again = self.repeat > 0
        u = dr.select(again, place.x - dr.floor(place.x), dr.clip(place.x, 0, 1))
        v = dr.select(again, place.y - dr.floor(place.y), dr.clip(place.y, 0, 1))
        x, y = u * self.columns - 0.5, (1 - v) * self.rows - 0.5
        left, top = dr.floor(x), dr.floor(y)

        def pixel(column: Float, row: Float) -> Array3f:
            index = self._wrapped(row, self.rows) * UInt32(self.columns) + self._wrapped(column, self.columns)
            return dr.gather(Array3f, pixels, self.first + index, self.within(place) | again)

        upper = dr.lerp(pixel(left, top), pixel(left + 1, top), x - left)
        lower = dr.lerp(pixel(left, top + 1), pixel(left + 1, top + 1), x - left)
        return dr.lerp(upper, lower, y - top)

    def _wrapped(self, index: Float, count: Float) -> UInt32:
        around = dr.select(index < 0, index + count, dr.select(index >= count, index - count, index))
        return UInt32(dr.select(self.repeat > 0, around, dr.clip(index, 0, count - 1)))


class ProjectedLamp(Lamp):
    """A lamp with a slide, an image on its portal, a profile or filters; `_kind` makes a class for each combination.

    Attributes
    ----------
    bare
        The lamp without images.
    slide, profile
        The images' places. An attribute exists only if the lamp has that image: see `has`. Those of the images on its
        portal have the names `portal_names`.
    pixels
        The pixels of the images. They are not part of the struct, because all lamps of a kind share them.
    images
        The scene's images, by the same names.
    acting
        Which of the filters act: see `Linking.acting`.
    """

    has: ClassVar[frozenset[str]] = frozenset()
    filter_names: ClassVar[tuple[str, ...]] = ()
    portal_names: ClassVar[tuple[str, ...]] = ()

    bare: Any = None
    slide: Any
    profile: Any
    pixels: dict[str, Any]
    acting: Any = None

    def at(self, acting: UInt32 | None) -> Any:
        """Return the lamp for sites where these of its filters act: see `Linking.acting`."""
        if acting is None or not self.filter_names:
            return self
        result = copy(self)
        result.acting = acting
        return result

    def with_pixels(self, pixels: dict[str, Array3f]) -> ProjectedLamp:
        """Set the pixels of the images, and return the light itself."""
        self.pixels = pixels
        return self

    def emit(self, u: Array2f, v: Array2f, bounds: Bounds) -> EmittedRays:
        """Return light paths in the colours of slide and profile."""
        rays: EmittedRays = self.bare.emit(u, v, bounds)
        rays.flux = rays.flux * self.tint(rays.origin, rays.direction)
        return rays

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a sample of the light, in the colours of the images that it passes."""
        sample = self.without_portal_gobo(point, u)
        direction, distance = sample.direction, sample.distance
        passing = self._passing(point, direction, distance) * self._unfiltered(point, direction, distance)
        sample.weight = sample.weight * passing
        return sample

    def without_portal_gobo(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a sample of the light as if there were no filters, and no image on its portal."""
        sample = self.bare.illuminate(point, u)
        sample.weight = sample.weight * self.tint(point, -sample.direction)
        return sample

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the light through its images."""
        hit = self.bare.see(origin, direction)
        hit.radiance = hit.radiance * self.colors(origin, direction, hit.distance)
        return hit

    @property
    def filters(self) -> FilterChain | None:
        """The filters of its light."""
        parts = tuple(getattr(self, name) for name in self.filter_names)
        return FilterChain(parts, bool(self.infinite)) if parts else None

    def _unfiltered(self, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return the fraction of the light that its filters leave at a point."""
        chain = self.filters
        if chain is None:
            return Array3f(1)
        return chain.factor(point, direction, distance, seed_of(point, direction), acting=self.acting)

    def colors(self, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return what images and filters leave between a point and the light, `distance` away along `direction`."""
        passing = self._passing(point, direction, distance) * self._unfiltered(point, direction, distance)
        return self.tint(point, -direction) * passing

    def tint(self, point: Array3f, direction: Array3f) -> Array3f:
        """Return the colour of slide and profile for the light that passes a point along a direction."""
        color = Array3f(1)
        if "profile" in self.has:
            color *= self.profile.factor(direction, self.pixels["profile"])
        return color * self._slide_color(point, direction) if "slide" in self.has else color

    def _slide_color(self, point: Array3f, direction: Array3f) -> Array3f:
        if self.bare.central:
            point = self.bare.center  # light from beside the centre has the colour of that from the centre
        _, place = self.slide.crossing(point, direction)
        color = self.slide.color(place, self.pixels["slide"])
        return dr.select(dr.dot(direction, self.slide.normal) > 0, color, 0)

    def portal_color(self, point: Array3f) -> Array3f:
        """Return the colour of the image on the portal at a point of it."""
        result, nearest = Array3f(0 if self.portal_names else 1), Float(dr.inf)
        for name in self.portal_names:
            slide = getattr(self, name)
            away, place = slide.crossing(point, slide.normal)
            away = dr.abs(away)
            near = slide.within(place) & (away < nearest)
            result = dr.select(near, slide.color(place, self.pixels[name]), result)
            nearest = dr.select(near, away, nearest)
        return result

    def _passing(self, origin: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return the colour of the images on the portal where segments cross them, else 1."""
        result = Array3f(1)
        for name in self.portal_names:
            slide = getattr(self, name)
            crossing, place = slide.crossing(origin, direction)
            passes = (crossing > 0) & (crossing < distance) & slide.within(place)
            result *= dr.select(passes, slide.color(place, self.pixels[name]), 1)
        return result


@cache
def _kind(bare: type, has: frozenset[str], filters: tuple[type, ...] = ()) -> type[ProjectedLamp]:
    """Return the class for lights of class `bare` with the images `has`, and filters of these classes."""
    on_portal = tuple(sorted(has - {"slide", "profile"}))
    kinds = {"slide": Slide, **dict.fromkeys(on_portal, Slide), "profile": ProfileTable}
    parts = {"bare": bare} | {name: kind for name, kind in kinds.items() if name in has}
    named = {f"filter{number}": kind for number, kind in enumerate(filters)}
    name = "".join(each.title().replace("_", "") for each in (*kinds, *named) if each in {*has, *named}) + bare.__name__
    own = {"__annotations__": parts | named, "has": has, "filter_names": tuple(named), "portal_names": on_portal,
           "__module__": __name__}  # fmt: skip
    return type(name, (ProjectedLamp,), own)


def projected(bare: Lamp, light: scene.Light, portal: Portal | None, images: Images) -> Any:
    """Return a lamp behind its images and filters, or the bare lamp where it has none.

    Parameters
    ----------
    bare, portal
        The lamp, and its portal in Dr.Jit.
    images
        Images that are already on the device; new ones are added.

    Raises
    ------
    SceneError
        There is an image on a portal that is not flat.
    """
    place = None if light.gobo is None else light.slide(light.gobo)
    slide = None if place is None else light.gobo
    on_portal = {
        f"portal{number}": gobo for number, gobo in enumerate(light.portal_gobos if portal is not None else ())
    }
    images_of = {"slide": slide, **on_portal, "profile": light.profile}
    there = {name: image for name, image in images_of.items() if image is not None}
    filters = [filter_of(each) for each in light.filters]
    if not (there or filters):
        return bare
    kind: Any = type(bare)
    result = _kind(kind, frozenset(there), tuple(map(type, filters)))()
    for name, each in zip(result.filter_names, filters, strict=True):
        setattr(result, name, each)
    result.bare, result.lit = bare, {}
    result.infinite, result.environment, result.flat = bare.infinite, bare.environment, bare.flat
    result.seen, result.covered = bare.seen, bare.covered
    result.images = there
    result.pixels = {name: _on_device(image, images) for name, image in there.items()}
    if slide is not None and place is not None:
        result.slide = Slide.of(slide, *place)
    for name, gobo in on_portal.items():
        sides = gobo.over.rectangle() if gobo.over is not None else getattr(portal, "sides", None)
        if sides is None:
            text = "the portal is not flat: expected a planar one to hold the image photonbeams:portal:gobo"
            raise scene.SceneError(f"{light.name}: {text}")
        setattr(result, name, Slide.of(gobo, *light.on_portal(gobo, sides)))
    if light.profile is not None and light.shaping is not None:
        result.profile = ProfileTable.of(light.profile, light.frame)
        bare.directions = ProfileSampler(result.profile, light.shaping, bare.flat)
    return result


def pack_projected(sources: Sequence[Any]) -> tuple[Any, dict[str, Any]]:
    """Return lights of one kind with gobos as one struct of arrays, and their images, concatenated."""
    packed = pack(sources)
    if len(sources) == 1:
        return packed, sources[0].pixels
    pixels = {}
    for name in sources[0].pixels:
        keys = [id(source.images[name].image) for source in sources]
        images = {key: _pixels(source.images[name]) for key, source in zip(keys, sources, strict=True)}
        starts = np.cumsum([0] + [len(image) for image in images.values()])
        first = dict(zip(images, starts[:-1], strict=True))
        getattr(packed, name).first = to_uint([first[key] for key in padded(keys)])
        pixels[name] = to_vectors(np.concatenate(list(images.values())))
    return packed, pixels


def _on_device(gobo: scene.Gobo | scene.Profile, images: Images) -> Array3f:
    key = id(gobo.image)
    if key not in images:
        images[key] = gobo.image, to_vectors(_pixels(gobo))
    return images[key][1]


def _pixels(gobo: scene.Gobo | scene.Profile) -> np.ndarray:
    """Return an image's pixels, (N, 3), `padded`."""
    return padded(gobo.colors.reshape(-1, 3))
