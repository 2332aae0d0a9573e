"""Pictures of other renderers: holdouts, whose depth ends the beams, and plates, to which beams are added."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, ClassVar, Self

import numpy as np

from ..render.seen.depth_layers import DepthLayers
from ..runtime.files import PathLike
from ..scene import FARTHEST, Array, SceneError, choice, numbers
from .channels import (
    Box,
    Channel,
    ImageFile,
    Size,
    Warn,
    channels_named,
    coverage_channel,
    depth_channels,
    image_files,
    picture_channels,
    placed,
    says_distance,
)
from .color_spaces import REC709, USUAL_SPACES, ColorSpaces, converted
from .depths import Depth
from .display import is_encoded, srgb_decoded
from .writing import HALF_MAX

KINDS = ("auto", "planar", "distance")
# Depths from here on mean that there is no surface: Blender writes 1e10.
NOTHING = 1e10 * (1 - 1e-6)
_MOST_NAMES = 24


@dataclass(frozen=True)
class _ImageInput(ABC):
    """What holdouts and plates have in common: a file of another renderer, or pixels."""

    file: PathLike | Array
    axes: ClassVar[int]  # of the pixels of one view
    shape: ClassVar[str]  # of these pixels, in messages

    @classmethod
    def of(cls, given: Any) -> Self | None:
        """Return what is `given`, a file's path or pixels or one of these, as one of these; None for None."""
        if given is None or isinstance(given, cls):
            return given
        return cls(given)

    def __post_init__(self) -> None:
        if not isinstance(self.file, str | os.PathLike):
            object.__setattr__(self, "file", numbers(self.file, "a holdout or a plate", "a file's name, or pixels"))

    def size(self, frame: float, views: Sequence[str]) -> Size:
        """Return the width and height for `frame` and `views`, which are as for `read`."""
        if not isinstance(self.file, np.ndarray):
            return next(image_files(self.file, frame, views))[0].size
        if self.file.ndim < self.axes:
            raise SceneError(f"the pixels are of shape {self.file.shape}: expected at least {self.axes} axes")
        height, width = self.file.shape[-self.axes :][:2]
        return int(width), int(height)

    def check(self, frame: float, views: Sequence[str], size: Size) -> None:
        """Raise what `read` would raise for `frame`, `views` and `size`, as far as headers show it."""
        for file, view in image_files(self.file, frame, views):
            _factor(file, file.size, size)
            self._channels(file, file.channels_of(view, views), lambda _: None)

    def _arrays(self, pixels: Array, views: Sequence[str], what: str) -> list[Array]:
        """Return the pixels of each view."""
        parts = list(pixels) if pixels.ndim == self.axes + 1 else []
        if pixels.ndim == self.axes and len(views) == 1:
            parts = [pixels]
        if len(parts) != len(views) or (self.axes == 3 and pixels.shape[-1] not in (3, 4)):
            expected = self.shape if len(views) == 1 else f"{len(views)} of {self.shape}"
            raise SceneError(f"{what} is of shape {pixels.shape}: expected {expected}")
        return parts

    @abstractmethod
    def _channels(self, file: ImageFile, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
        """Return the channels that are read; SceneError if there are none."""


@dataclass(frozen=True)
class Holdout(_ImageInput):
    """Another renderer's depth, at which beams end.

    Attributes
    ----------
    file
        An image, in whose name a run of # is the frame number and %V the view, "left" or "right"; or the depths
        themselves, (H, W) for the whole picture, or (2, H, W) for two eyes.
    channel
        Name of the channel or of its layer. None, the default: it is found by a name such as Z, ViewLayer.Depth.Z or
        distance.
    kind
        "planar", along the camera's axis; "distance", from the camera; "auto", the default: planar unless the
        channel's name says otherwise, as `distance` and Mitsuba's `.T` do.
    scale
        Scene units in one unit of the file. Default 1.
    coverage
        How much of each pixel is covered: the name of a channel, an array of the depths' shape, or "none": all of it
        where there is a depth. Default "auto": the alpha beside the depth, if the file has one.

    Raises
    ------
    SceneError
        Another kind, or a scale that is not above 0, or beyond 1e12.

    Examples
    --------
    >>> depth = np.full((18, 32), 5.0)  # metres, where the scene has centimetres
    >>> holdout = pb.Holdout(depth, scale=100)
    >>> float(holdout.read(1, [""], (32, 18), print)[0].values.max())
    500.0

    `shot.render(holdout=holdout)` ends the beams there; `pb.Holdout("depth.####.exr")` reads a file for each frame.
    """

    channel: str | None = None
    kind: str = "auto"
    scale: float = 1.0
    coverage: str | Array = "auto"
    axes, shape = 2, "(H, W)"

    def __post_init__(self) -> None:
        super().__post_init__()
        choice(self.kind, "holdout-depth", KINDS)
        if not (isinstance(self.scale, Real) and 0 < self.scale <= FARTHEST):
            raise SceneError(f"holdout-scale is {self.scale}: expected more than 0 and no more than {FARTHEST:g}")

    def read(self, frame: float, views: Sequence[str], size: Size, warn: Warn, box: Box | None = None) -> list[Depth]:
        """Return the depths of each view, several of a pixel if the holdout is larger than the picture.

        A depth of 0 or less, NaN, infinity, 1e10 or more, or the largest half means that there is no surface. Coverages
        beyond 0 and 1, as sharpening filters write them, count as these; NaN counts as 0.

        Parameters
        ----------
        frame
            Number of the frame.
        views
            Its views: "left", "right" or both, or one "" for a camera that is not split.
        size
            Width and height of the picture in pixels.
        warn
            Called with each warning.
        box
            The part of the picture to return, (left, top, right, bottom); None: the whole. Beyond the picture there is
            no surface, except in the data window of an EXR with overscan.

        Raises
        ------
        SceneError
            No file, or one that may not be read; no image; no depth in it, no such channel, or no such view; a size
            that is neither the picture's nor a whole multiple of it.
        """
        if isinstance(self.file, np.ndarray):
            depths = self._arrays(self.file, views, "the holdout")
            factor = _factor("the holdout", self.size(frame, views), size)
            depth = [self._depth(each, "float", self.kind == "distance") for each in depths]
            if not isinstance(self.coverage, str):
                if self.coverage.shape != self.file.shape:
                    raise SceneError(f"the coverage is of shape {self.coverage.shape}: expected {self.file.shape}")
                alphas = self._arrays(self.coverage, views, "the coverage")
                depth = [each.covered(alpha) for each, alpha in zip(depth, alphas, strict=True)]
            return [each.placed((0, 0), _finer(box, size, factor)) for each in depth]
        return [
            self._read(file, file.channels_of(view, views), size, warn, box)
            for file, view in image_files(self.file, frame, views)
        ]

    def _read(self, file: ImageFile, channels: Sequence[Channel], size: Size, warn: Warn, box: Box | None) -> Depth:
        """Return the depths of a view in a file, of its `channels`; the others are as for `read`."""
        channel, *more = self._channels(file, channels, warn)
        alpha = more[0] if more else None
        distance = self.kind == "distance" or (self.kind == "auto" and says_distance(channel))
        factor, around = _factor(file, file.size, size), _around(box, size)
        inside = _finer(box or around, size, factor)
        if file.is_deep(channel):
            depth = replace(self._deep(file, channels, channel, alpha, inside), distance=distance)
        else:
            finer = _finer(around, size, factor)
            depth = self._depth(file.pixels([channel], np.inf, finer)[..., 0], channel.kind, distance)
            if not np.isfinite(depth.values).any():
                warn(f"{file}: {channel.name} holds no depth, so no beam ends: expected some pixels between 0 and 1e10")
            elif alpha is not None:
                depth = depth.covered(file.pixels([alpha], 0.0, finer)[..., 0])
            depth = depth.placed((factor * around[0], factor * around[1]), inside)
        if box is None and depth.layers is not None and not len(depth.layers.front):
            text = "covers nothing, so no beam ends: expected some pixels above 0, or the holdout's coverage none"
            warn(f"{file}: {alpha.name if alpha else channel.name} {text}")
        return depth

    def _alpha(self, file: ImageFile, channels: Sequence[Channel], depth: Channel, warn: Warn) -> Channel | None:
        """Return the channel that tells how much is covered; None: all is."""
        if not isinstance(self.coverage, str):
            raise SceneError(f"{file} is a file, and the coverage is an array: expected the name of a channel")
        if self.coverage == "none":
            return None
        if self.coverage != "auto":
            if not (found := channels_named(channels, self.coverage)):
                names = _names(channels)
                raise SceneError(f"{file} has no channel '{self.coverage}': expected one of {names}, auto or none")
            return found[0]
        alpha = coverage_channel(channels, depth)
        if alpha is None and file.is_deep(depth):
            warn(f"{file} has no A beside {depth.name}: its deep samples are taken to be opaque")
        return alpha

    def _deep(
        self, file: ImageFile, channels: Sequence[Channel], front: Channel, alpha: Channel | None, box: Box
    ) -> Depth:
        """Return the layers of a deep part's pixels in a box, which may reach beyond the picture."""
        backs = [each for each in channels if each.part == front.part and each.words[-1] == "zback"]
        if alpha is not None and alpha.part != front.part:
            raise SceneError(f"{file} has {alpha.name} in another part than {front.name}: expected one deep part")
        counts, values, numbers = file.deep_samples([front, *backs[:1], *([alpha] if alpha else [])], box)
        begin, end = values[0], np.fmax(values[0], values[1] if backs else values[0])
        most = HALF_MAX if front.kind == "half" else NOTHING
        there = (begin >= 0) & (end > 0) & (end < most)
        covered = np.where(there, np.nan_to_num(values[-1]), 0.0) if alpha else there.astype(np.float64)
        begin, end = (np.where(there, each, 1.0) * self.scale for each in (begin, end))
        layers = DepthLayers.of_samples(counts, begin, end, np.clip(covered, 0, 1)).taken(numbers)
        return Depth(layers.nearest().astype(np.float32), layers=layers)

    def _channels(self, file: ImageFile, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
        """Return the channel that holds the depth, and the one that tells how much is covered, if there is one."""
        found = channels_named(channels, self.channel) if self.channel is not None else depth_channels(channels)
        if not found:
            wanted = f"no channel '{self.channel}'" if self.channel is not None else "no channel that is called a depth"
            chosen = "" if self.channel is not None else ", chosen by --holdout-channel"
            raise SceneError(f"{file} has {wanted}: expected one of {_names(channels)}{chosen}")
        if len(found) > 1 and self.channel is None:
            warn(f"{file} has the depths {_names(found)}: the first is used, --holdout-channel chooses another")
        if found[0].kind not in ("half", "float", "double"):
            text = f"{file} holds {found[0].name} as {found[0].kind}"
            raise SceneError(f"{text}: expected a depth of half or single precision")
        alpha = self._alpha(file, channels, found[0], warn)
        return found[:1] if alpha is None else [found[0], alpha]

    def _depth(self, values: Array, stored: str, distance: bool) -> Depth:
        """Return depths in scene units."""
        values = np.asarray(values, dtype=np.float64)
        there = (values > 0) & (values < (HALF_MAX if stored == "half" else NOTHING))
        values = np.where(there, values * self.scale, np.inf).astype(np.float32)
        return Depth(values, distance)


@dataclass(frozen=True)
class Plate(_ImageInput):
    """A picture that beams are added to.

    Attributes
    ----------
    file
        An image, named as in `Holdout`, which is sRGB if it has 8 bits, and scene-linear if not; or scene-linear
        pixels, (H, W, 3 or 4) for the whole picture, or (2, H, W, 3 or 4) for two eyes.
    fog
        Whether the fog dims the plate. Default False.

    Examples
    --------
    >>> plate = pb.Plate(np.full((18, 32, 3), 0.2), fog=True)
    >>> pixels = plate.read(1, [""], (32, 18), print)[0]
    >>> layers = {"beams": np.full((18, 32, 3), 0.05), "transmittance": np.full((18, 32, 3), 0.5)}
    >>> plate.composite(layers, pixels)[0, 0].round(2)
    array([0.15, 0.15, 0.15, 1.  ])

    `shot.render(over=plate)` does that for its `rgba`; `pb.Plate("plate.####.exr")` reads a file for each frame.
    """

    fog: bool = False
    axes, shape = 3, "(H, W, 3) or (H, W, 4)"

    def _channels(self, file: ImageFile, channels: Sequence[Channel], warn: Warn) -> list[Channel]:
        found = picture_channels(file, channels, warn)
        if file.is_deep(found[0]):
            raise SceneError(f"{file} is a deep image: expected a flat one, with one value a pixel")
        return found

    def read(
        self, frame: float, views: Sequence[str], size: Size, warn: Warn, box: Box | None = None,
        spaces: ColorSpaces = USUAL_SPACES,
    ) -> list[Array]:  # fmt: skip
        """Return the pixels of each view in the working space, (H, W, 4) float32, black beyond the plate.

        `frame`, `views`, `size`, `warn` and `box`, and what is raised, are as for `Holdout.read`. `spaces` are the
        working space and that of files which name none. Given pixels are in the working space.
        """
        if isinstance(self.file, np.ndarray):
            plates = self._arrays(self.file, views, "the plate")
            factor = _factor("the plate", self.size(frame, views), size)
            return [_shrunk(placed(each, (0, 0), _finer(box, size, factor), 0.0), factor) for each in plates]
        result = []
        for file, view in image_files(self.file, frame, views):
            channels = self._channels(file, file.channels_of(view, views), warn)
            factor = _factor(file, file.size, size)
            pixels = file.pixels(channels, 0.0, _finer(box, size, factor))
            if is_encoded(channels[0].kind, len(channels)):
                pixels[..., :3], space = srgb_decoded(pixels[..., :3]), REC709
            else:
                space = file.color_space(channels[0].part, spaces.untagged, warn)
            result.append(_shrunk(converted(pixels, space, spaces.working), factor))
        return result

    def read_whole(
        self, frame: float, views: Sequence[str], size: Size, warn: Warn, box: Box | None = None,
        spaces: ColorSpaces = USUAL_SPACES,
    ) -> list[Array]:  # fmt: skip
        """Return what `read` returns; for a truncated file nothing, with a warning, since beams do not depend on it.

        `frame`, `views`, `size`, `warn`, `box` and `spaces` are as for `read`.
        """
        self.check(frame, views, size)
        try:
            return self.read(frame, views, size, warn, box, spaces)
        except SceneError as error:
            warn(f"{error}; rgba is what it is without a plate")
            return []

    def composite(self, layers: dict[str, Array], pixels: Array) -> Array:
        """Return plate + beams, or plate · transmittance + beams if the fog dims it, with the plate's alpha.

        Parameters
        ----------
        layers
            The layers of a view: `beams` and `transmittance`, (H, W, 3).
        pixels
            (H, W, 4) pixels of the plate.
        """
        color = pixels[..., :3] * layers["transmittance"] if self.fog else pixels[..., :3]
        return np.concatenate([color + layers["beams"], pixels[..., 3:]], axis=2)


def _names(channels: Sequence[Channel]) -> str:
    return ", ".join([*(each.name for each in channels[:_MOST_NAMES]), *(["..."] if channels[_MOST_NAMES:] else [])])


def _around(box: Box | None, size: Size) -> Box:
    """Return the whole picture, with a box that may reach beyond it."""
    left, top, right, bottom = box or (0, 0, *size)
    return min(left, 0), min(top, 0), max(right, size[0]), max(bottom, size[1])


def _finer(box: Box | None, size: Size, factor: int) -> Box:
    """Return a part of the picture, or the whole of it, in a file's pixels, of which `factor` make one along a side."""
    left, top, right, bottom = box or (0, 0, *size)
    return factor * left, factor * top, factor * right, factor * bottom


def _shrunk(pixels: Array, factor: int) -> Array:
    """Return colours with an alpha: means over the pixels that are merged, `factor` along each side."""
    pixels = np.asarray(pixels, dtype=np.float32)
    if factor > 1:
        height, width = pixels.shape[:2]
        pixels = pixels.reshape(height // factor, factor, width // factor, factor, -1).mean(axis=(1, 3))
    alpha = pixels[..., 3:] if pixels.shape[2] > 3 else np.ones_like(pixels[..., :1])
    return np.concatenate([pixels[..., :3], alpha], axis=2)


def _factor(where: ImageFile | str, found: Size, size: Size) -> int:
    """Return how many pixels of a file, along each side, make one of the picture; SceneError if that is not whole."""
    factor = found[0] // size[0]
    if factor and found == (factor * size[0], factor * size[1]):
        return factor
    raise SceneError(
        f"{where} is {found[0]} x {found[1]} pixels, and the picture {size[0]} x {size[1]}: expected one size, or a "
        f"whole multiple (--res {found[0]} {found[1]} would do)"
    )
