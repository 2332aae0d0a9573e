"""Channels of other renderers' images: which of them are a depth or a picture, and their pixels.

A file holds parts, and parts hold channels. Renderers name their channels differently, so they are recognized by what
these names have in common. Parts, views and data windows are read as OpenEXR defines them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
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
from .files import UnreadableImageError, check_decoded, check_image, opened, pixels_of, read_pixels
from .numbering import numbered

Warn = Callable[[str], None]
Size = tuple[int, int]  # width and height
Box = tuple[int, int, int, int]  # left, top, right, bottom of a part of a picture; the last two are not included
Layer = tuple[int, str]  # a part, and the name that its channels share

# Names of layers that hold the picture, the likeliest first; a layer without a name is likelier still.
_PICTURES = ("rgba", "combined", "beauty", "c", "color", "main")
# Memory that a deep holdout takes at most, in bytes a sample and a pixel's array of a channel: measured.
_SAMPLE_BYTES, _ARRAY_BYTES = 180, 210
_COLORS = (("r", "red"), ("g", "green"), ("b", "blue"))


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
    vectors = {each.layer for each in channels if each.words[-1] == "x"}
    ranks = [(_depth_rank(each, vectors), each) for each in channels]
    least = min((found for found, _ in ranks if found is not None), default=None)
    if least is None and len(channels) == 1:
        return list(channels)  # the only channel of a file needs no particular name
    return [each for found, each in ranks if found is not None and found == least]


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
    alphas = [each for each in channels if each.words[-1] in ("a", "alpha")]
    beside = [each for each in alphas if each.layer == depth.layer]
    if beside:
        return beside[0]
    before = depth.words[:-2]
    named = [(each.words[-2] if len(each.words) > 1 else "", each) for each in alphas]
    pictures = [each for name, each in named if name in ("", *_PICTURES) and each.words[:-2] in (before, [])]
    return pictures[0] if pictures else None


def _is_depth(word: str) -> bool:
    return word == "z" or word.endswith(("pz", "dist")) or "depth" in word or "distance" in word


def says_distance(channel: Channel) -> bool:
    """Return whether a channel's name says that its depth is a distance from the camera."""
    return channel.words[-1] == "t" or any(word.endswith("dist") or "distance" in word for word in channel.words)


def picture_channels(file: ImageFile | PathLike, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
    """Return red, green, blue, and alpha if it exists, of the layer that holds the picture; SceneError without one."""
    layers: dict[Layer, dict[str, Channel]] = {}
    for each in channels:
        layers.setdefault(each.layer, {})[each.words[-1]] = each
    found = {}
    for layer, own in layers.items():
        colors = [next((own[name] for name in names if name in own), None) for names in _COLORS]
        if all(colors):
            found[layer] = [each for each in (*colors, own.get("a", own.get("alpha"))) if each is not None]
    if not found:
        raise SceneError(f"{file} has no red, green and blue: expected a picture")

    def rank(layer: Layer) -> int:
        word = layer[1].rpartition(".")[2]
        return _PICTURES.index(word) + 1 if word in _PICTURES else len(_PICTURES) + 1 if word else 0

    best = min(found, key=rank)
    equal = [each for each in found if rank(each) == rank(best)]
    if len(equal) > 1:
        names = ", ".join(found[each][0].name.rpartition(".")[0] for each in equal)
        warn(f"{file} has the pictures {names}: the first is used, expected one that is called {_PICTURES[0]}")
    return found[best]


def color_channels(path: PathLike, file: OpenImageIO.ImageInput, warn: Warn) -> list[Channel]:
    """Return the channels of a texture, which are in one part: of its picture, or else grey, with alpha if it exists.

    An EXR may hold other layers, and more channels. If nothing in its first part is called a picture, that is all of
    it. Of other images, the first channels are red, green and blue.
    """
    specs: list[Any] = []
    while file.seek_subimage(len(specs), 0):
        specs.append(file.spec())
    flat = [part for part, spec in enumerate(specs) if not spec.deep]
    if not flat:
        raise UnreadableImageError(path, "it is a deep one")
    channels = [each for part in flat for each in _channels_of(part, specs[part], len(specs) > 1)]
    first, count = [each for each in channels if each.part == flat[0]], specs[flat[0]].nchannels
    if file.format_name() != "openexr":
        return first[: 4 if count == 4 or specs[flat[0]].alpha_channel == 3 else 3]
    view = next((each.view for each in channels if each.view), "")
    channels = [each for each in channels if each.view in ("", view)]
    named: list[list[Channel]] = []
    with suppress(SceneError):
        named.append(picture_channels(path, channels, warn))
    vectors = {each.layer for each in channels if each.words[-1] == "x"}
    greys = [each for each in channels if each.words[-1] == "y" and _is_picture(each) and each.layer not in vectors]
    if greys and not (named and _is_picture(named[0][0])):
        layer = greys[0].layer
        return [greys[0], *(each for each in channels if each.layer == layer and each.words[-1] in ("a", "alpha"))]
    return named[0] if named else [each for each in first if each.words[-1] not in ("a", "alpha")][:3] or first[:1]


def _is_picture(channel: Channel) -> bool:
    """Return whether a channel's layer has a name of pictures, or none."""
    return channel.layer[1].rpartition(".")[2] in ("", *_PICTURES)


class ImageFile:
    """An image file: its headers, and its channels over the whole display window.

    `apart` is whether each view has a file of its own, whose name contains the view.
    """

    def __init__(self, path: Path, apart: bool) -> None:
        self._path, self._apart = path, apart
        self._specs: list[Any] = []
        if problem := why_unreadable(path):
            raise UnreadableImageError(path, problem)
        with opened(path) as file:
            while file.seek_subimage(len(self._specs), 0):
                self._specs.append(file.spec())
                check_image(path, self._specs[-1])
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
        several = len(self._specs) > 1
        return [each for part, spec in enumerate(self._specs) for each in _channels_of(part, spec, several)]

    def channels_of(self, view: str, views: Sequence[str]) -> list[Channel]:
        """Return the channels of `view`, one of the frame's `views`; for "", those of the file's first view."""
        own = list(dict.fromkeys(each.view for each in self._channels if each.view))
        if len(views) > 1 and not own and not self._apart:
            wanted = f"expected parts of the views {' and '.join(views)}, or a name with %V for the view"
            raise SceneError(f"{self} has no views, and the frame has two: {wanted}")
        if view and own and view not in own:
            raise SceneError(f"{self} has no view '{view}': its views are {', '.join(own)}")
        chosen = view or (own[0] if own else "")
        return [each for each in self._channels if each.view in ("", chosen)]

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
        numbers = np.arange(counts.size, dtype=np.float64).reshape(counts.shape)
        corner = spec.x - spec.full_x, spec.y - spec.full_y
        return counts, values, placed(numbers, corner, box, -1).astype(np.int64)

    def pixels(self, channels: Sequence[Channel], outside: float, box: Box) -> Array:
        """Return channels of one part, (H, W, C) float32, in a box of pixels of the display window or beyond it.

        Outside of the data window they have the value `outside`.
        """
        part = channels[0].part
        spec = self._specs[part]
        check_decoded(self._path, pixels_of(spec) * spec.nchannels + self.size[0] * self.size[1] * len(channels))
        with opened(self._path) as file:
            data = read_pixels(self._path, file, part)
        corner = spec.x - spec.full_x, spec.y - spec.full_y
        return placed(data[..., [each.index for each in channels]], corner, box, outside)

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
    x0, y0 = max(left, corner[0]), max(top, corner[1])
    x1, y1 = max(min(right, corner[0] + pixels.shape[1]), x0), max(min(bottom, corner[1] + pixels.shape[0]), y0)
    shape = (bottom - top, right - left, *pixels.shape[2:])
    result = np.full(shape, outside, np.result_type(pixels, np.float32))
    result[y0 - top : y1 - top, x0 - left : x1 - left] = pixels[
        y0 - corner[1] : y1 - corner[1], x0 - corner[0] : x1 - corner[0]
    ]
    return result


def _channels_of(part: int, spec: OpenImageIO.ImageSpec, several: bool) -> Iterator[Channel]:
    """Yield a part's channels, with views removed from their names; each of `several` parts is a layer."""
    view = spec.get_string_attribute("view")
    layer = spec.get_string_attribute("oiio:subimagename")
    layer = layer.removesuffix(f".{view}") if view else layer
    # OpenEXR's older form has one part for all views: Z and depth.Z are the first view's, right.Z and depth.right.Z the
    # other's.
    views = spec.getattribute("multiView") or ()
    for index, name in enumerate(spec.channelnames):
        words = name.split(".")
        own = next((word for word in words[:-1] if word in views), "")
        name = ".".join(word for word in words if not own or word != own)
        if several and layer and not name.lower().startswith(f"{layer.lower()}."):
            name = f"{layer}.{name}"
        yield Channel(part, index, name, str(spec.channelformat(index)), view or own or (views[0] if views else ""))


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
