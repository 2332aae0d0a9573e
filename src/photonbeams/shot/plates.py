"""Pictures of other renderers: their depth, at which beams end, and the plate that beams are added to.

A file holds parts, and parts hold channels. What a channel is called differs from renderer to renderer, and is found by
what the names have in common; parts, views and data windows are read as OpenEXR means them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..display import is_encoded, srgb_decoded
from ..files import PathLike
from ..numbering import numbered
from ..scene import FARTHEST, Array, SceneError
from .images import HALF_MAX, REC709, opened, unreadable

if TYPE_CHECKING:
    from ..render.camera import View, Window
    from ..render.holdouts import Held

Warn = Callable[[str], None]
Size = tuple[int, int]  # width and height
Layer = tuple[int, str]  # a part, and the name that its channels share

KINDS = ("auto", "planar", "distance")
# From here on a depth means that there is nothing: Blender writes 1e10.
NOTHING = 1e10 * (1 - 1e-6)
# Names of layers that are a picture, the one that is meant first; a layer without a name comes before all.
_PICTURES = ("rgba", "combined", "beauty", "c", "color", "main")
_COLORS = (("r", "red"), ("g", "green"), ("b", "blue"))
_MOST_NAMES = 24


@dataclass(frozen=True)
class Depth:
    """Depths of one view's whole picture.

    Attributes
    ----------
    values
        (H, W) float32, in scene units, infinite where there is nothing.
    distance
        Whether they are distances from the camera, not along its axis.
    place
        Where in each pixel they are, 0 to 1 both ways.
    """

    values: Array
    distance: bool = False
    place: float = 0.5

    def seen_by(self, view: View) -> Held:
        """Return where beams end in what a view's window shows."""
        from ..render.holdouts import Held

        values, place = part_of(self.values, view.window), (self.place, self.place)
        # A lens, if there is one, is around the camera's place, from which distances are.
        return Held(values * view.cosines(place) if self.distance else values, view.window, place)


@dataclass(frozen=True)
class Holdout:
    """Another renderer's depth, at which beams end.

    Attributes
    ----------
    file
        An image, in whose name a run of # is the frame number and %V the view, "left" or "right"; or the depths
        themselves, (H, W) of the whole picture, for two eyes (2, H, W).
    channel
        Name of the channel or of its layer; None: found by its name, such as Z, ViewLayer.Depth.Z or distance.
    kind
        "planar", along the camera's axis; "distance", from the camera; "auto": planar unless the channel's name says
        otherwise, as `distance` and Mitsuba's `.T` do.
    scale
        Scene units in one unit of the file.

    Raises
    ------
    SceneError
        Another kind, or a scale that is not above 0, or beyond 1e12.
    """

    file: PathLike | Array
    channel: str | None = None
    kind: str = "auto"
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise SceneError(f"holdout-depth is {self.kind}: expected one of {', '.join(KINDS)}")
        if not 0 < self.scale <= FARTHEST:
            raise SceneError(f"holdout-scale is {self.scale}: expected more than 0 and no more than {FARTHEST:g}")

    @classmethod
    def of(cls, given: PathLike | Array | Holdout | None) -> Holdout | None:
        """Return the holdout that a file's path, planar depths or a holdout describe."""
        return given if given is None or isinstance(given, Holdout) else cls(_path_or_pixels(given))

    def size(self, frame: float, views: Sequence[str]) -> Size:
        """Return width and height of the picture that the depths are of; parameters and errors as in `read`."""
        return _size(self.file, frame, views, axes=2)

    def check(self, frame: float, views: Sequence[str], size: Size) -> None:
        """Raise what `read` would raise, as far as headers tell."""
        for file, view in _files(self.file, frame, views):
            _factor(file, file.size, size)
            self._channel(file, file.channels_of(view, views), _in_silence)

    def read(self, frame: float, views: Sequence[str], size: Size, warn: Warn) -> list[Depth]:
        """Return the depths of each view.

        There is nothing where the file says 0 or less, NaN, infinity, 1e10 or more, or the largest half.

        Parameters
        ----------
        frame, views, size
            Number of the frame; its views, one "" for a camera that is none of two eyes; width and height.
        warn
            Called with each warning.

        Raises
        ------
        OSError, SceneError
            No such file; no image; no depth in it, no such channel, or no such view; a size that is neither the
            picture's nor a whole multiple of it.
        """
        if isinstance(self.file, np.ndarray):
            depths = _arrays(self.file, 2, views, "the holdout", "(H, W)")
            return [self._depth(each, "float", size, "the holdout", self.kind == "distance") for each in depths]
        result = []
        for file, view in _files(self.file, frame, views):
            channel = self._channel(file, file.channels_of(view, views), warn)
            distance = self.kind == "distance" or (self.kind == "auto" and _says_distance(channel))
            depth = self._depth(file.pixels([channel], np.inf)[..., 0], channel.kind, size, file, distance)
            if not np.isfinite(depth.values).any():
                warn(f"{file}: {channel.name} holds no depth, and no beam ends: expected some pixels from 0 to 1e10")
            result.append(depth)
        return result

    def _channel(self, file: _File, channels: Sequence[_Channel], warn: Warn) -> _Channel:
        """Return the channel that holds the depth."""
        found = _named(channels, self.channel) if self.channel is not None else _least(_depth_rank, channels)
        if not found:
            wanted = f"no channel '{self.channel}'" if self.channel is not None else "no channel that is called a depth"
            names = ", ".join(each.name for each in channels[:_MOST_NAMES])
            more = ", ..." if len(channels) > _MOST_NAMES else ""
            chosen = "" if self.channel is not None else ", chosen by --holdout-channel"
            raise SceneError(f"{file} has {wanted}: expected one of {names}{more}{chosen}")
        if len(found) > 1 and self.channel is None:
            names = ", ".join(each.name for each in found)
            warn(f"{file} has the depths {names}: the first is taken, --holdout-channel chooses another")
        if found[0].kind not in ("half", "float", "double"):
            text = f"{file} holds {found[0].name} as {found[0].kind}"
            raise SceneError(f"{text}: expected a depth of half or single precision")
        return found[0]

    def _depth(self, values: Array, stored: str, size: Size, where: Any, distance: bool) -> Depth:
        """Return depths of the picture's size in scene units."""
        factor = _factor(where, (values.shape[1], values.shape[0]), size)
        # One of the pixels that come together, never their mean: between a near and a far surface there is none.
        middle = factor // 2
        values = np.asarray(values[middle::factor, middle::factor], dtype=np.float64)
        there = (values > 0) & (values < (HALF_MAX if stored == "half" else NOTHING))
        values = np.where(there, values * self.scale, np.inf).astype(np.float32)
        return Depth(values, distance, (middle + 0.5) / factor)


@dataclass(frozen=True)
class Plate:
    """A picture that beams are added to.

    Attributes
    ----------
    file
        An image, named as in `Holdout`, sRGB where it has 8 bits and else scene-linear; or its pixels, (H, W, 3 or 4)
        of the whole picture, for two eyes (2, H, W, 3 or 4).
    fog
        Whether the fog dims it, too.
    """

    file: PathLike | Array
    fog: bool = False

    @classmethod
    def of(cls, given: PathLike | Array | Plate | None) -> Plate | None:
        """Return the plate that a file's path, pixels or a plate describe."""
        return given if given is None or isinstance(given, Plate) else cls(_path_or_pixels(given))

    def size(self, frame: float, views: Sequence[str]) -> Size:
        """Return width and height; parameters and errors as in `Holdout.read`."""
        return _size(self.file, frame, views, axes=3)

    def check(self, frame: float, views: Sequence[str], size: Size) -> None:
        """Raise what `read` would raise, as far as headers tell."""
        for file, view in _files(self.file, frame, views):
            _factor(file, file.size, size)
            _picture(file, file.channels_of(view, views), _in_silence)

    def read(self, frame: float, views: Sequence[str], size: Size, warn: Warn) -> list[Array]:
        """Return for each view the pixels, (H, W, 4) float32, scene-linear; parameters and errors as `Holdout.read`."""
        if isinstance(self.file, np.ndarray):
            plates = _arrays(self.file, 3, views, "the plate", "(H, W, 3) or (H, W, 4)")
            return [_shrunk(each, size, "the plate") for each in plates]
        result = []
        for file, view in _files(self.file, frame, views):
            channels = _picture(file, file.channels_of(view, views), warn)
            _factor(file, file.size, size)
            file.warn_of_primaries(channels[0].part, warn)
            pixels = file.pixels(channels, 0.0)
            if is_encoded(channels[0].kind, len(channels)):
                pixels[..., :3] = srgb_decoded(pixels[..., :3])
            result.append(_shrunk(pixels, size, file))
        return result

    def under(self, layers: dict[str, Array], pixels: Array) -> Array:
        """Return plate + beams, or plate · transmittance + beams, (H, W, 4), with the plate's alpha."""
        color = pixels[..., :3] * layers["transmittance"] if self.fog else pixels[..., :3]
        return np.concatenate([color + layers["beams"], pixels[..., 3:]], axis=2)


def part_of(pixels: Array, window: Window) -> Array:
    """Return what a window shows of a whole picture."""
    x0, y0, x1, y1 = window.crop
    return pixels[y0:y1, x0:x1]


def _shrunk(pixels: Array, size: Size, where: Any) -> Array:
    """Return colours at the picture's size, means of the pixels that come together, with an alpha."""
    factor = _factor(where, (pixels.shape[1], pixels.shape[0]), size)
    pixels = np.asarray(pixels, dtype=np.float32)
    if factor > 1:
        pixels = pixels.reshape(size[1], factor, size[0], factor, -1).mean(axis=(1, 3))
    alpha = pixels[..., 3:] if pixels.shape[2] > 3 else np.ones_like(pixels[..., :1])
    return np.concatenate([pixels[..., :3], alpha], axis=2)


def _arrays(pixels: Array, axes: int, views: Sequence[str], what: str, shape: str) -> list[Array]:
    """Return the pixels of each view."""
    each = [pixels] if pixels.ndim == axes and len(views) == 1 else list(pixels) if pixels.ndim == axes + 1 else []
    if len(each) != len(views) or (axes == 3 and pixels.shape[-1] not in (3, 4)):
        expected = shape if len(views) == 1 else f"{len(views)} of {shape}"
        raise SceneError(f"{what} is of shape {pixels.shape}: expected {expected}")
    return each


def _factor(where: Any, found: Size, size: Size) -> int:
    """Return how many pixels of a file, each way, come to one of the picture; SceneError where that is no number."""
    factor = found[0] // size[0]
    if factor and found == (factor * size[0], factor * size[1]):
        return factor
    raise SceneError(
        f"{where} is {found[0]} x {found[1]} pixels, and the picture {size[0]} x {size[1]}: expected one size, or a "
        f"whole multiple (--res {found[0]} {found[1]} would do)"
    )


def _size(file: PathLike | Array, frame: float, views: Sequence[str], axes: int) -> Size:
    if not isinstance(file, np.ndarray):
        return next(_files(file, frame, views))[0].size
    if file.ndim < axes:
        raise SceneError(f"the pixels are of shape {file.shape}: expected at least {axes} axes")
    height, width = file.shape[-axes:][:2]
    return (int(width), int(height))


def _path_or_pixels(given: Any) -> PathLike | Array:
    return given if isinstance(given, str | os.PathLike) else np.asarray(given)


def _in_silence(_: str) -> None:
    """Leave a warning for when pixels are read."""


# -- channels --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Channel:
    """A channel: its part and place in the file, its name with the layer's in front, its type and its view."""

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
        """Where its siblings are: the part, and the name without the last word."""
        return self.part, self.name.lower().rpartition(".")[0]


def _named(channels: Sequence[_Channel], name: str) -> list[_Channel]:
    """Return the channels of a name, or whose name ends or begins with it; the first are the likeliest."""
    wanted = name.lower()
    tests: tuple[Callable[[str], bool], ...] = (
        lambda found: found == wanted,
        lambda found: found.endswith(f".{wanted}"),
        lambda found: found.startswith(f"{wanted}."),
    )
    return [each for test in tests for each in channels if test(each.name.lower())]


def _least(rank: Callable[[_Channel, set[Layer]], int | None], channels: Sequence[_Channel]) -> list[_Channel]:
    """Return the channels of the least rank, of those that have one."""
    vectors = {each.layer for each in channels if each.words[-1] == "x"}
    ranks = [(rank(each, vectors), each) for each in channels]
    least = min((found for found, _ in ranks if found is not None), default=None)
    if least is None and len(channels) == 1:
        return list(channels)  # a picture of one channel is what it is
    return [each for found, each in ranks if found is not None and found == least]


def _depth_rank(channel: _Channel, vectors: set[Layer]) -> int | None:
    """Return how much a channel's name is that of a depth, 0 the most; None: not at all.

    A Z beside an X is that of a vector: of a normal, a position or a motion.
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
    return 4 if last == "t" and not vector else None  # Mitsuba's


def _is_depth(word: str) -> bool:
    return word == "z" or word.endswith(("pz", "dist")) or "depth" in word or "distance" in word


def _says_distance(channel: _Channel) -> bool:
    return channel.words[-1] == "t" or any(word.endswith("dist") or "distance" in word for word in channel.words)


def _picture(file: _File, channels: Sequence[_Channel], warn: Warn) -> list[_Channel]:
    """Return red, green, blue, and alpha if there is one, of the layer that is the picture."""
    layers: dict[Layer, dict[str, _Channel]] = {}
    for each in channels:
        layers.setdefault(each.layer, {})[each.words[-1]] = each
    found = {}
    for layer, named in layers.items():
        colors = [next((named[name] for name in names if name in named), None) for names in _COLORS]
        if all(colors):
            found[layer] = [each for each in (*colors, named.get("a", named.get("alpha"))) if each is not None]
    if not found:
        raise SceneError(f"{file} has no red, green and blue: expected a picture")

    def rank(layer: Layer) -> int:
        word = layer[1].rpartition(".")[2]
        return _PICTURES.index(word) + 1 if word in _PICTURES else len(_PICTURES) + 1 if word else 0

    best = min(found, key=rank)
    equal = [each for each in found if rank(each) == rank(best)]
    if len(equal) > 1:
        names = ", ".join(found[each][0].name.rpartition(".")[0] for each in equal)
        warn(f"{file} has the pictures {names}: the first is taken, expected one that is called {_PICTURES[0]}")
    return found[best]


# -- files -----------------------------------------------------------------------------------------------------------


class _File:
    """The headers of an image file, and its channels over all of its display window.

    `apart` is whether its name says the view.
    """

    def __init__(self, path: Path, apart: bool) -> None:
        self._path, self._apart = path, apart
        self._specs: list[Any] = []
        with opened(path) as file:
            while file.seek_subimage(len(self._specs), 0):
                self._specs.append(file.spec())
        if any(spec.deep for spec in self._specs):
            raise SceneError(f"{path} is a deep image: expected a flat one, with one value a pixel")

    def __str__(self) -> str:
        return str(self._path)

    @property
    def size(self) -> Size:
        """Width and height of the display window, which OpenEXR wants alike in all parts."""
        return self._specs[0].full_width, self._specs[0].full_height

    @cached_property
    def _channels(self) -> list[_Channel]:
        several = len(self._specs) > 1
        return [each for part, spec in enumerate(self._specs) for each in _channels_of(part, spec, several)]

    def channels_of(self, view: str, views: Sequence[str]) -> list[_Channel]:
        """Return the channels of one view of the frame's; where that is "", those of the file's first view."""
        own = list(dict.fromkeys(each.view for each in self._channels if each.view))
        if len(views) > 1 and not own and not self._apart:
            wanted = f"expected parts of the views {' and '.join(views)}, or a name with %V for the view"
            raise SceneError(f"{self} has no views, and the frame has two: {wanted}")
        if view and own and view not in own:
            raise SceneError(f"{self} has no view '{view}': its views are {', '.join(own)}")
        chosen = view or (own[0] if own else "")
        return [each for each in self._channels if each.view in ("", chosen)]

    def pixels(self, channels: Sequence[_Channel], outside: float) -> Array:
        """Return channels of one part, (H, W, C) float32; beyond the data window they are `outside`."""
        part = channels[0].part
        spec = self._specs[part]
        with opened(self._path) as file:
            data = file.read_image(part, 0, 0, spec.nchannels, "float")
            message = file.geterror()
        if data is None or message:
            raise unreadable(self._path, message)
        data = np.asarray(data, np.float32).reshape(spec.height, spec.width, spec.nchannels)
        left, top = spec.x - spec.full_x, spec.y - spec.full_y
        x0, y0 = max(left, 0), max(top, 0)
        x1, y1 = max(min(left + spec.width, self.size[0]), x0), max(min(top + spec.height, self.size[1]), y0)
        result = np.full((self.size[1], self.size[0], len(channels)), outside, np.float32)
        result[y0:y1, x0:x1] = data[y0 - top : y1 - top, x0 - left : x1 - left, [each.index for each in channels]]
        return result

    def warn_of_primaries(self, part: int, warn: Warn) -> None:
        """Warn of colours that are not those of the beams: the sum is then neither's."""
        found = self._specs[part].getattribute("chromaticities") or self._specs[0].getattribute("chromaticities")
        if found is not None and not np.allclose(found, REC709, atol=2e-3):
            numbers = " ".join(f"{value:.4g}" for value in found)
            warn(f"{self} has the chromaticities {numbers}: expected Rec. 709, which is what the beams are")


def _channels_of(part: int, spec: Any, several: bool) -> Iterator[_Channel]:
    """Yield a part's channels, views taken out of their names; of `several` parts, each is a layer of its name."""
    view = spec.get_string_attribute("view")
    layer = spec.get_string_attribute("oiio:subimagename")
    layer = layer.removesuffix(f".{view}") if view else layer
    # OpenEXR's older form, one part for all views: Z and depth.Z of the first, right.Z and depth.right.Z.
    views = spec.getattribute("multiView") or ()
    for index, name in enumerate(spec.channelnames):
        words = name.split(".")
        own = next((word for word in words[:-1] if word in views), "")
        name = ".".join(word for word in words if not own or word != own)
        if several and layer and not name.lower().startswith(f"{layer.lower()}."):
            name = f"{layer}.{name}"
        yield _Channel(part, index, name, str(spec.channelformat(index)), view or own or (views[0] if views else ""))


def _files(place: PathLike | Array, frame: float, views: Sequence[str]) -> Iterator[tuple[_File, str]]:
    """Yield the file of each view of a frame, and the view; none where there are pixels."""
    if isinstance(place, np.ndarray):
        return
    path = numbered(Path(place), frame)
    for view in views:
        apart = bool(view) and "%V" in path.name
        yield _File(path.with_name(path.name.replace("%V", view)) if apart else path, apart), view
