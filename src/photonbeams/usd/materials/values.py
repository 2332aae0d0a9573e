"""Values in a network of shader nodes (constants, images over UVs, primvars), and functions of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...scene import Array, rgb
from ..common.openusd import Usd


def identity(values: Array) -> Array:
    """Return values unchanged."""
    return values


@dataclass(frozen=True, eq=False)
class Tiles:
    """The tiles of a UDIM texture that an attribute names: those that are there, (column, row), and how they lie.

    `transform`, (3, 3), applied to (u, v, 1), gives columns and rows.
    """

    attribute: Usd.Attribute
    there: frozenset[tuple[int, int]]
    transform: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Image:
    """An image over UVs: `pixels` (H, W, C) float32, first row at v = 1.

    Attributes
    ----------
    wrap
        How the image continues beyond its square in u and in v: repeat, clamp, mirror or black.
    transform
        (3, 3), applied to (u, v, 1).
    uv_name
        Primvar of the UVs.
    beyond
        The value beyond the square of an image that wraps to black, (C,).
    tiles
        The tiles of the UDIM textures from which the image is made.
    """

    pixels: Array
    wrap: tuple[str, str]
    transform: Array
    uv_name: str
    beyond: Array = field(default_factory=lambda: np.zeros(4))
    tiles: tuple[Tiles, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "beyond", self.beyond[: self.pixels.shape[-1]])

    def moved(self, transform: Array) -> Image:
        """Return the image over UVs to which another transform, (3, 3), is applied first."""
        tiles = tuple(replace(each, transform=each.transform @ transform) for each in self.tiles)
        return replace(self, transform=self.transform @ transform, tiles=tiles)

    def placed_as(self, other: Image) -> bool:
        """Return whether two images lie on a surface in the same way."""
        same = self.wrap == other.wrap and self.uv_name == other.uv_name
        return same and np.allclose(self.transform, other.transform)


@dataclass(frozen=True)
class PrimvarValue:
    """A function of a primvar of the gprim, (N, C); `fallback` (C,) is its result if there is no such primvar."""

    name: str
    fallback: Array
    function: Callable[[Array], Array] = identity


#: A constant is an array (C,).
Value = Array | Image | PrimvarValue


def mapped(function: Callable[..., Array], *values: Value) -> Value:
    """Apply a function, which takes arrays (…, C) with any leading axes, to values.

    Images that are placed like the largest one are scaled to the greatest height and width among them. If images are
    combined with primvars, or with images that are placed differently, only the largest image stays an image; all
    others are replaced by their means or fallbacks. The number of channels is the least among values with several.
    """
    counts = (len(_beyond(each)) for each in values)
    least = min((count for count in counts if count > 1), default=None)

    def cut(*arrays: Array) -> Array:
        return function(*(each[..., :least] for each in arrays))

    images = [each for each in values if isinstance(each, Image)]
    primvars = [each.name for each in values if isinstance(each, PrimvarValue)]
    if images:
        largest = max(images, key=lambda each: each.pixels[..., 0].size)
        placed = [each.pixels.shape[:2] for each in images if each.placed_as(largest)]
        size = tuple(np.max(placed, axis=0).tolist())
        pixels = cut(*(_over(each, largest, size) for each in values))
        tiles = dict.fromkeys(own for each in images if each.uv_name == largest.uv_name for own in each.tiles)
        pixels = np.broadcast_to(pixels, (*size, pixels.shape[-1])).astype(np.float32)
        return replace(largest, pixels=pixels, beyond=cut(*map(_beyond, values)), tiles=tuple(tiles))
    fallback = np.atleast_1d(cut(*map(constant, values)))
    if not primvars:
        return fallback

    def composed(raw: Array) -> Array:
        result = cut(*(_at(each, primvars[0], raw) for each in values))
        return np.broadcast_to(result, (len(raw), result.shape[-1]))

    return PrimvarValue(primvars[0], fallback, composed)


def mix(first: Array, second: Array, part: Array) -> Array:
    """Return the linear mix of two values."""
    return first + part * (second - first)


def combinable(values: Sequence[Value]) -> bool:
    """Return whether `mapped` combines these values without loss."""
    images = [each for each in values if isinstance(each, Image)]
    names = {each.name for each in values if isinstance(each, PrimvarValue)}
    return len(names) + bool(images) <= 1 and all(each.placed_as(images[0]) for each in images)


def constant(value: Value) -> Array:
    """Return the mean of an image, the fallback of a primvar, or a constant itself, (C,)."""
    if isinstance(value, Image):
        return value.pixels.mean(axis=(0, 1), dtype=np.float64)
    return value.fallback if isinstance(value, PrimvarValue) else value


def channels(value: Value, chosen: list[int]) -> Value:
    """Return some channels of a value; a missing channel is replaced by the last."""
    return mapped(lambda values: values[..., [min(each, values.shape[-1] - 1) for each in chosen]], value)


def as_color(value: Value) -> Value:
    """Return a value with three channels."""
    return mapped(rgb, value)


def as_number(value: Value) -> Value:
    """Return a value's first channel."""
    return channels(value, [0])


def _beyond(value: Value) -> Array:
    """Return what a value is beyond the square of an image, (C,)."""
    return value.beyond if isinstance(value, Image) else constant(value)


def _at(value: Value, name: str, raw: Array) -> Array:
    """Return a value where a primvar has these numbers, (N, C), or its constant, (C,), if it is another's."""
    return value.function(raw) if isinstance(value, PrimvarValue) and value.name == name else constant(value)


def _over(value: Value, image: Image, size: tuple[int, ...]) -> Array:
    """Return a value in the pixels of an image, (H, W, C), or its constant, (C,), if it is placed differently."""
    if not isinstance(value, Image) or not value.placed_as(image):
        return constant(value)
    return resized(value.pixels, size)


def resized(pixels: Array, size: tuple[int, ...]) -> Array:
    """Return an image of another height and width, whose pixels are the nearest ones."""
    if pixels.shape[:2] == size:
        return pixels
    rows, columns = (np.arange(count) * own // count for count, own in zip(size, pixels.shape[:2], strict=True))
    return pixels[np.ix_(rows, columns)]
