"""Read image files with OpenImageIO: the pixels of their parts, or a summary of each part.

If a file does not exist or may not be read, its readers raise OSError; if it is no image or a broken one, SceneError.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenImageIO

from ..runtime.files import PathLike
from ..runtime.inputs import check_size, problem_of
from ..scene import Array, SceneError
from .display import is_encoded, srgb_decoded

if TYPE_CHECKING:
    from types import ModuleType

MOST_PIXELS = 1 << 28  # of an image that is read, or of a level of it: a small file may claim to hold more
_MOST_BYTES = 1 << 33  # of a file: OpenImageIO may read all of it to find out that it is no image
_STRIP = 64 * 2**20  # bytes of pixels that are decoded at a time


@dataclass(frozen=True)
class PartHeader:
    """The header of a part of an EXR, or of the whole of another image."""

    name: str  # "rgba" for a part without a name; to parts with the same name, the view or a number is appended
    channels: tuple[str, ...]  # their names
    types: tuple[str, ...]  # in which the channels are stored: half, float, uint8, …
    view: str  # "left", "right", or another view that the file names; empty if it names none

    @property
    def layer(self) -> str:
        """The name without the view at its end."""
        return self.name.removesuffix(f".{self.view}") if self.view else self.name


@dataclass(frozen=True)
class Part(PartHeader):
    """A part of an image with its `pixels`: (H, W, C) float32 as stored, no colour converted, first row on top."""

    pixels: Array


@dataclass(frozen=True)
class Summary(PartHeader):
    """A part of an image in a few numbers."""

    width: int  # in pixels
    height: int
    least: float | None = None  # of the finite values in all channels; None if there is none, and for deep parts
    mean: float | None = None
    greatest: float | None = None
    nans: int | None = None  # pixels that have one; None: not known, as for deep parts
    infinite: int | None = None  # pixels that have an infinite value


def read_parts(path: PathLike) -> list[Part]:
    """Return all parts of an image file, in its order."""
    with opened(path) as file:
        headers = _headers(path, file)
        check_decoded(path, sum(pixels_of(spec) * spec.nchannels for _, spec in headers))
        return [Part(**vars(header), pixels=read_pixels(path, file, i)) for i, (header, _) in enumerate(headers)]


def summaries(path: PathLike) -> list[Summary]:
    """Return a summary of each part of an image file, in its order, without all of its pixels in memory at once."""
    with opened(path) as file:
        return [
            Summary(**vars(header), width=spec.width, height=spec.height, **_statistics(path, file, index))
            for index, (header, spec) in enumerate(_headers(path, file))
        ]


def _statistics(path: PathLike, file: OpenImageIO.ImageInput, index: int) -> dict[str, Any]:
    """Return the fields of a `Summary` that depend on pixels."""
    file.seek_subimage(index, 0)
    if file.spec().deep:
        return {}
    channels = range(file.spec().nchannels)
    least, greatest, total, count, nans, infinite = np.inf, -np.inf, 0.0, 0, 0, 0
    for _, strip in strips(path, file, part=index, channels=channels):
        pixels = strip.reshape(-1, len(channels))
        finite = pixels[np.isfinite(pixels)]
        if finite.size:
            least, greatest = min(least, float(finite.min())), max(greatest, float(finite.max()))
        total, count = total + float(finite.sum(dtype=np.float64)), count + finite.size
        nans += int(np.isnan(pixels).any(axis=1).sum())
        infinite += int(np.isinf(pixels).any(axis=1).sum())
    ends = {"least": least, "mean": total / count, "greatest": greatest} if count else {}
    return {**ends, "nans": nans, "infinite": infinite}


def read_layers(path: PathLike, view: str | None = None) -> dict[str, Array]:
    """Return the pixels of `read_parts` by name, (H, W, C), or (H, W) where there is one channel.

    With a `view`, return only its layers, by names without the view; SceneError if there is no such view.
    """
    parts = read_parts(path)
    if view is not None and view not in {part.view for part in parts}:
        views = ", ".join(dict.fromkeys(part.view for part in parts if part.view)) or "none"
        raise SceneError(f"{path} has no view '{view}': its views are {views}")
    return {
        part.name if view is None else part.layer: part.pixels[..., 0] if len(part.channels) == 1 else part.pixels
        for part in parts
        if view is None or part.view == view
    }


def read_image(path: PathLike) -> Array:
    """Return an image file's (first) picture as scene-linear float32, (H, W, C), first row on top.

    8-bit images of three or four channels are taken as sRGB, others as linear.
    """
    with opened(path) as file:
        pixels = read_pixels(path, file, 0)
        kind = str(file.spec().format)
    if is_encoded(kind, pixels.shape[2]):
        pixels[..., :3] = srgb_decoded(pixels[..., :3])
    return pixels


@contextmanager
def opened(path: PathLike, config: OpenImageIO.ImageSpec | None = None) -> Iterator[OpenImageIO.ImageInput]:
    """Open an image file as an OpenImageIO input, for a `with` statement; no part of it is too large to be decoded."""
    if problem := problem_of(path, _MOST_BYTES):
        raise UnreadableImageError(path, problem)
    arguments = [] if config is None else [config]
    file: Any = OpenImageIO.ImageInput.open(str(path), *arguments)
    if not file:
        raise unreadable(path, complaint(OpenImageIO))
    try:
        yield file
        complaint(file)  # seeking past the last part is no error
    finally:
        file.close()


def specs_of(file: OpenImageIO.ImageInput) -> list[OpenImageIO.ImageSpec]:
    """Return OpenImageIO's descriptions of all parts of a file."""
    specs: list[OpenImageIO.ImageSpec] = []
    while file.seek_subimage(len(specs), 0):
        specs.append(file.spec())
    return specs


def check_image(path: PathLike, spec: OpenImageIO.ImageSpec) -> None:
    """Raise SceneError if a part of an image, or the picture that it is a part of, has too many pixels."""
    for width, height in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
        if width * height * max(spec.depth, 1) > MOST_PIXELS:
            problem = f"it has {width} x {height} pixels, which are more than {MOST_PIXELS:,}"
            raise UnreadableImageError(path, problem)


def check_decoded(path: PathLike, values: float, what: str = "its decoded pixels") -> None:
    """Raise SceneError if so many values of an image, as float32, are more than the memory here."""
    try:
        check_size(4.0 * values, np.inf, what)
    except SceneError as error:
        raise UnreadableImageError(path, str(error)) from None


def pixels_of(spec: OpenImageIO.ImageSpec) -> int:
    """Return the number of pixels that a part of an image holds."""
    return int(spec.width) * int(spec.height) * max(int(spec.depth), 1)


def strips(
    path: PathLike, file: OpenImageIO.ImageInput, *, part: int, channels: range, level: int = 0, factor: int = 1
) -> Iterator[tuple[int, Array]]:
    """Yield the first row and the pixels, (H, W, C) float32, of strips of a part's level, to which `file` is set.

    Their height is a multiple of `factor` and of the tiles' height.
    """
    spec, bounds = file.spec(), (channels.start, channels.stop)
    step = int(np.lcm(factor, spec.tile_height)) if spec.tile_width else factor
    step *= max(1, _STRIP // (4 * spec.width * len(channels) * step))
    for first in range(0, spec.height, step):
        rows = spec.y + first, spec.y + min(first + step, spec.height)
        if spec.tile_width:
            stored = file.read_tiles(part, level, spec.x, spec.x + spec.width, *rows, 0, 1, *bounds, "float")
        else:
            stored = file.read_scanlines(part, level, *rows, 0, *bounds, "float")
        message = complaint(file)
        if stored is None or message:
            raise unreadable(path, message)
        pixels = np.asarray(stored, dtype=np.float32).reshape(-1, spec.width, len(channels))
        if file.format_name() == "openexr":
            # Whole numbers count something, but OpenImageIO divides them by the largest one, as it does for colours.
            whole = [place for place, channel in enumerate(channels) if str(spec.channelformat(channel)) == "uint"]
            pixels[..., whole] *= np.float32(2**32 - 1)
        yield first, pixels


def _headers(path: PathLike, file: OpenImageIO.ImageInput) -> list[tuple[PartHeader, OpenImageIO.ImageSpec]]:
    """Return the header of each part, and OpenImageIO's description of it."""
    names: list[str] = []
    result = []
    for spec in specs_of(file):
        check_image(path, spec)
        name, view = spec.get_string_attribute("oiio:subimagename") or "rgba", spec.get_string_attribute("view")
        names.append(f"{name}.{view or len(names)}" if name in names else name)
        types = tuple(str(spec.channelformat(channel)) for channel in range(spec.nchannels))
        result.append((PartHeader(names[-1], tuple(spec.channelnames), types, view), spec))
    return result


def read_pixels(path: PathLike, file: OpenImageIO.ImageInput, index: int) -> Array:
    """Return the pixels of a part, (H, W, C) float32."""
    file.seek_subimage(index, 0)
    spec = file.spec()
    check_image(path, spec)
    if spec.deep:
        raise UnreadableImageError(path, "it is a deep one")
    pixels = np.empty((spec.height, spec.width, spec.nchannels), np.float32)
    for row, strip in strips(path, file, part=index, channels=range(spec.nchannels)):
        pixels[row : row + len(strip)] = strip
    return pixels


class UnreadableImageError(SceneError):
    """An image cannot be decoded, because of a `problem`: a clause about the file."""

    def __init__(self, path: PathLike, problem: str) -> None:
        super().__init__(f"{path} cannot be read: expected an image ({problem})")
        self.problem = problem


def unreadable(path: PathLike, message: str) -> UnreadableImageError:
    """Return the error to raise for an image that cannot be decoded, with OpenImageIO's message."""
    return UnreadableImageError(path, reason(message))


def complaint(decoder: OpenImageIO.ImageInput | ModuleType) -> str:
    """Return OpenImageIO's last error message, which may quote bytes of a broken file that are no valid text."""
    try:
        return str(decoder.geterror())
    except UnicodeDecodeError as error:
        return error.object.decode(errors="replace")


def reason(message: str) -> str:
    """Return the first line of the decoder's message, or "unknown format" if there is none."""
    return message.strip().splitlines()[0] if message.strip() else "unknown format"
