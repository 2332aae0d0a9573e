"""Channels of other renderers' images: which of them are a depth or a picture, and their pixels.

A file holds parts, and parts hold channels. Renderers name their channels differently, so they are recognized by what
these names have in common. Parts, views and data windows are read as OpenEXR defines them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO

from ..runtime.files import PathLike
from ..runtime.inputs import why_unreadable
from ..scene import Array, SceneError
from .color_spaces import COLOR_SPACE, named, primaries, space_of
from .deep import read_deep
from .exr import deep_sizes
from .files import UnreadableImageError, check_decoded, check_image, opened, pixels_of, read_pixels, specs_of
from .numbering import numbered

Warn = Callable[[str], None]
Size = tuple[int, int]  # width and height
Box = tuple[int, int, int, int]  # left, top, right, bottom of a part of a picture; the last two are not included
Layer = tuple[int, str]  # a part, and the name that its channels share

#: The places of colours, by the names of channels without their layers: other programs' too.
COLORS = {"r": 0, "red": 0, "g": 1, "green": 1, "b": 2, "blue": 2, "a": 3, "alpha": 3}
_ALPHA = COLORS["alpha"]
# Names of layers that hold the picture, the likeliest first: a layer without a name.
_PICTURES = ("", "rgba", "combined", "beauty", "c", "color", "main")
# Memory that a deep holdout takes at most, in bytes a sample and a pixel's array of a channel: measured.
_SAMPLE_BYTES, _ARRAY_BYTES = 180, 210


@dataclass(frozen=True)
class Channel:
    """A channel: its part, its index in it, its name with the layer's in front, its type and its view."""

    part: int
    index: int
    name: str
    kind: str
    view: str

    @property
    def words(self) -> list[str]:
        """The parts of the name."""
        return self.name.lower().split(".")

    @property
    def layer(self) -> Layer:
        """The channel's layer: the part, and the name without the last word."""
        return self.part, self.name.lower().rpartition(".")[0]

    @property
    def color(self) -> int | None:
        """The place among red, green, blue and alpha; None for what is none of them."""
        return COLORS.get(self.words[-1])

    @property
    def picture_rank(self) -> int:
        """How much its layer is called like a picture, from 0, the most; the number of such names: not at all."""
        word = self.layer[1].rpartition(".")[2]
        return _PICTURES.index(word) if word in _PICTURES else len(_PICTURES)

    @property
    def in_picture(self) -> bool:
        """Whether its layer has a name of pictures, or none."""
        return self.picture_rank < len(_PICTURES)


def channels_named(channels: Sequence[Channel], name: str) -> list[Channel]:
    """Return the channels with a name, then those whose names end with it, then those whose names begin with it."""
    wanted = name.lower()
    tests: tuple[Callable[[str], bool], ...] = (
        lambda found: found == wanted,
        lambda found: found.endswith(f".{wanted}"),
        lambda found: found.startswith(f"{wanted}."),
    )
    return [each for test in tests for each in channels if test(each.name.lower())]


def depth_channels(channels: Sequence[Channel]) -> list[Channel]:
    """Return the channels whose names are the most like that of a depth; if a file has only one channel, that."""
    vectors = _vectors(channels)
    ranks = [(_depth_rank(each, vectors), each) for each in channels]
    least = min((found for found, _ in ranks if found is not None), default=None)
    if least is None and len(channels) == 1:
        return list(channels)  # the only channel of a file needs no particular name
    return [each for found, each in ranks if found is not None and found == least]


def _vectors(channels: Sequence[Channel]) -> set[Layer]:
    """Return the layers that hold vectors."""
    return {each.layer for each in channels if each.words[-1] == "x"}


def _depth_rank(channel: Channel, vectors: set[Layer]) -> int | None:
    """Return how much a channel's name is like that of a depth, from 0, the most; None: not at all.

    A Z beside an X is part of a vector, such as a normal, a position or a motion.
    """
    *layers, last = channel.words
    layer = layers[-1] if layers else ""
    vector = channel.layer in vectors
    if last == "z" and not vector:
        return 0 if not layers or _is_depth(layer) else 2
    if last != "z" and _is_depth(last):
        return 1
    if _is_depth(layer) and last in ("r", "y", "v"):
        return 3
    return 4 if last == "t" and not vector else None  # Mitsuba's name


def coverage_channel(channels: Sequence[Channel], depth: Channel) -> Channel | None:
    """Return the alpha beside a depth: in its layer, or else in the picture of the same view layer, or without one."""
    alphas = [each for each in channels if each.color == _ALPHA]
    beside = [each for each in alphas if each.layer == depth.layer]
    pictures = [each for each in alphas if each.in_picture and each.words[:-2] in (depth.words[:-2], [])]
    return next(iter(beside + pictures), None)


def _is_depth(word: str) -> bool:
    return word == "z" or word.endswith(("pz", "dist")) or "depth" in word or "distance" in word


def says_distance(channel: Channel) -> bool:
    """Return whether a channel's name says that its depth is a distance from the camera."""
    return channel.words[-1] == "t" or any(word.endswith("dist") or "distance" in word for word in channel.words)


def picture_channels(file: ImageFile | PathLike, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
    """Return red, green, blue, and alpha if it exists, of the layer that holds the picture; SceneError without one."""
    picture = _picture(file, channels, warn)
    if not picture:
        raise SceneError(f"{file} has no red, green and blue: expected a picture")
    return picture


def _picture(file: ImageFile | PathLike, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
    """Return what `picture_channels` does, or nothing if no layer has red, green and blue."""
    layers: dict[Layer, dict[int, Channel]] = {}
    for each in channels:
        if each.color is not None:
            layers.setdefault(each.layer, {}).setdefault(each.color, each)
    pictures = [[colors[place] for place in sorted(colors)] for colors in layers.values() if {0, 1, 2} <= colors.keys()]
    least = min((colors[0].picture_rank for colors in pictures), default=0)
    likeliest = [colors for colors in pictures if colors[0].picture_rank == least]
    if len(likeliest) > 1:
        names = ", ".join(colors[0].name.rpartition(".")[0] for colors in likeliest)
        warn(f"{file} has the pictures {names}: the first is used, expected one that is called {_PICTURES[1]}")
    return likeliest[0] if likeliest else []


def color_channels(path: PathLike, file: OpenImageIO.ImageInput, warn: Warn) -> list[Channel]:
    """Return the channels of a texture, which are in one part: of its picture, or else grey, with alpha if it exists.

    An EXR may hold other layers, and more channels. If nothing in its first part is called a picture, that is all of
    it. Of other images, the first channels are red, green and blue.
    """
    specs = specs_of(file)
    channels = [each for each in _channels_of(specs) if not specs[each.part].deep]
    if not channels:
        raise UnreadableImageError(path, "it is a deep one")
    spec = specs[channels[0].part]
    first = [each for each in channels if each.part == channels[0].part]
    if file.format_name() != "openexr":
        return first[: 4 if spec.nchannels == 4 or spec.alpha_channel == 3 else 3]
    channels = _of_view(channels)
    picture, vectors = _picture(path, channels, warn), _vectors(channels)
    greys = [each for each in channels if each.words[-1] == "y" and each.in_picture and each.layer not in vectors]
    if greys and not (picture and picture[0].in_picture):
        return [greys[0], *(each for each in channels if each.layer == greys[0].layer and each.color == _ALPHA)]
    return picture or [each for each in first if each.color != _ALPHA][:3] or first[:1]


def _of_view(channels: Sequence[Channel], view: str = "") -> list[Channel]:
    """Return the channels of a view, and those that belong to none; for "", those of the first view."""
    chosen = view or next((each.view for each in channels if each.view), "")
    return [each for each in channels if each.view in ("", chosen)]


class ImageFile:
    """An image file: its headers, and its channels over the whole display window.

    `apart` is whether each view has a file of its own, whose name contains the view.
    """

    def __init__(self, path: Path, apart: bool) -> None:
        self._path, self._apart = path, apart
        if problem := why_unreadable(path):
            raise UnreadableImageError(path, problem)
        with opened(path) as file:
            self._specs: list[Any] = specs_of(file)
            for spec in self._specs:
                check_image(path, spec)
            is_exr = file.format_name() == "openexr"
        # Of an EXR whose end is missing, OpenImageIO tells only once pixels are read, which may be hours later.
        self._deep_sizes = deep_sizes(path) if is_exr else []

    def __str__(self) -> str:
        return str(self._path)

    @property
    def size(self) -> Size:
        """Width and height of the display window, which OpenEXR requires to be the same in all parts."""
        return self._specs[0].full_width, self._specs[0].full_height

    @cached_property
    def _channels(self) -> list[Channel]:
        return list(_channels_of(self._specs))

    def channels_of(self, view: str, views: Sequence[str]) -> list[Channel]:
        """Return the channels of `view`, one of the frame's `views`; for "", those of the file's first view."""
        own = list(dict.fromkeys(each.view for each in self._channels if each.view))
        if len(views) > 1 and not own and not self._apart:
            wanted = f"expected parts of the views {' and '.join(views)}, or a name with %V for the view"
            raise SceneError(f"{self} has no views, and the frame has two: {wanted}")
        if view and own and view not in own:
            raise SceneError(f"{self} has no view '{view}': its views are {', '.join(own)}")
        return _of_view(self._channels, view)

    def is_deep(self, channel: Channel) -> bool:
        """Return whether a channel is one of a deep part."""
        return bool(self._specs[channel.part].deep)

    def deep_samples(self, channels: Sequence[Channel], box: Box) -> tuple[Array, list[Array], Array]:
        """Return samples of channels of one deep part, and where pixels of a box are among those that have them.

        These are how many samples each pixel of the data window has, (H, W); their values, (N,) for each channel; and
        the number of that pixel for each one in the box, (H', W'), -1 outside of the data window.
        """
        spec = self._specs[channels[0].part]
        sizes, specs = self._deep_sizes, self._specs
        samples = sum(size / each.pixel_bytes(True) for each, size in zip(specs, sizes, strict=True))
        arrays = sum(pixels_of(each) * each.nchannels for each in specs)
        memory = sum(sizes) + _SAMPLE_BYTES * samples + _ARRAY_BYTES * arrays
        check_decoded(self._path, memory / 4, "reading its deep samples")
        counts, values = read_deep(self._path, channels[0].part, [spec.channelnames[each.index] for each in channels])
        return counts, values, placed_indices(counts.shape, corner_of(spec), box)

    def pixels(self, channels: Sequence[Channel], outside: float, box: Box) -> Array:
        """Return channels of one part, (H, W, C) float32, in a box of pixels of the display window or beyond it.

        Outside of the data window they have the value `outside`.
        """
        spec = self._specs[channels[0].part]
        check_decoded(self._path, pixels_of(spec) * spec.nchannels + self.size[0] * self.size[1] * len(channels))
        with opened(self._path) as file:
            data = read_pixels(self._path, file, channels[0].part)
        return placed(data[..., [each.index for each in channels]], corner_of(spec), box, outside)

    def color_space(self, part: int, untagged: str, warn: Warn) -> str:
        """Return the linear colour space of a part, by its chromaticities or its name; without one, `untagged`."""
        specs = self._specs[part], self._specs[0]
        found = next((each for spec in specs if (each := spec.getattribute("chromaticities")) is not None), None)
        if found is None:
            given = named(str(self._specs[part].getattribute(COLOR_SPACE) or ""))
            return given if given and primaries(given) else untagged
        space = space_of(found)
        if space is None:
            numbers = " ".join(f"{value:.4g}" for value in found)
            warn(f"{self} has the chromaticities {numbers}: expected those of a colour space that OpenColorIO knows; "
                 f"it is taken as {untagged}")  # fmt: skip
        return space or untagged


def placed(pixels: Array, corner: Size, box: Box, outside: float) -> Array:
    """Return the part of a picture in a box; `corner` is the left and top of its `pixels`, (H, W, ...).

    Beyond the pixels it has the value `outside`.
    """
    left, top, right, bottom = box
    shape = (bottom - top, right - left, *pixels.shape[2:])
    result = np.full(shape, outside, np.result_type(pixels, np.float32))
    inside, shown = overlap(pixels, corner, box)
    result[inside] = pixels[shown]
    return result


def overlap(pixels: Array, corner: Size, box: Box) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return which pixels of a box a picture covers, and which of its pixels these are; `corner` is as for `placed`."""
    left, top, right, bottom = box
    x0, y0 = max(left, corner[0]), max(top, corner[1])
    x1, y1 = max(min(right, corner[0] + pixels.shape[1]), x0), max(min(bottom, corner[1] + pixels.shape[0]), y0)

    def slices(x: int, y: int) -> tuple[slice, slice]:
        return np.s_[y0 - y : y1 - y, x0 - x : x1 - x]

    return slices(left, top), slices(*corner)


def placed_indices(shape: tuple[int, ...], corner: Size, box: Box) -> Array:
    """Return which entry of an array, (H, W), flattened, each pixel of a box shows, as `placed`; -1 beyond it."""
    return placed(np.arange(np.prod(shape)).reshape(shape), corner, box, -1).astype(np.int64)


def corner_of(spec: OpenImageIO.ImageSpec) -> Size:
    """Return where the left and top of a part's pixels are in the picture."""
    return int(spec.x) - int(spec.full_x), int(spec.y) - int(spec.full_y)


def _channels_of(specs: Sequence[OpenImageIO.ImageSpec]) -> Iterator[Channel]:
    """Yield the channels of parts, with views removed from their names; each of several parts is a layer."""
    for part, spec in enumerate(specs):
        view = spec.get_string_attribute("view")
        layer = spec.get_string_attribute("oiio:subimagename") if len(specs) > 1 else ""
        layer = layer.removesuffix(f".{view}") if view else layer
        # OpenEXR's older form has one part for all views: Z and depth.Z are the first view's, right.Z and depth.right.Z
        # the other's.
        views = spec.getattribute("multiView") or ()
        for index, name in enumerate(spec.channelnames):
            words = name.split(".")
            own = next((word for word in words[:-1] if word in views), "")
            name = ".".join(word for word in words if not own or word != own)
            if layer and not name.lower().startswith(f"{layer.lower()}."):
                name = f"{layer}.{name}"
            kind, shown = str(spec.channelformat(index)), view or own or (views[0] if views else "")
            yield Channel(part=part, index=index, name=name, kind=kind, view=shown)


def image_paths(place: PathLike | Array, frame: float, views: Sequence[str]) -> Iterator[tuple[Path, str]]:
    """Yield the path of the file of each view of a frame, and the view; nothing if `place` is pixels."""
    if isinstance(place, np.ndarray):
        return
    path = numbered(Path(place), frame)
    for view in views:
        yield path.with_name(path.name.replace("%V", view)) if view else path, view


def image_files(place: PathLike | Array, frame: float, views: Sequence[str]) -> Iterator[tuple[ImageFile, str]]:
    """Yield the file of each view of a frame, and the view; nothing if `place` is pixels."""
    for path, view in image_paths(place, frame, views):
        yield ImageFile(path, bool(view) and "%V" in Path(place).name), view  # type: ignore[arg-type]
