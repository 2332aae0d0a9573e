"""Images as textures: decoded by OpenImageIO, scene-linear, and no larger than a limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import OpenImageIO

from ..scene import Array, SceneError
from .channels import Channel, color_channels, corner_of, overlap
from .display import DECODED, srgb_decoded
from .files import UnreadableImageError, check_image, complaint, opened, strips

#: Textures with more pixels along a side are scaled down, unless a user sets another limit.
TEXTURE_LIMIT = 4096

_LARGEST = 16384  # megabytes of uncompressed pixels: even a small file may claim to hold more

OpenImageIO.attribute("limits:imagesize_MB", _LARGEST)

#: A function of stored pixels, and of the type in which they are stored, that returns scene-linear pixels.
Linearize = Callable[[Array, str], Array]


@dataclass(frozen=True)
class Decoded:
    """An image file's pixels, (H, W, C) float32 scene-linear, and the file's size; or None and the decoder's error.

    `warnings` are about the choice among several pictures in the file.
    """

    pixels: Array | None
    width: int = 0
    height: int = 0
    error: str = ""
    warnings: tuple[str, ...] = ()


def decoded(path: str, linearize: Linearize, limit: int = TEXTURE_LIMIT) -> Decoded:
    """Return an image of at most `limit` pixels along a side: a smaller level of the file, or means over pixels.

    This takes no more memory than four times the result and a strip of the file.
    """
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # where alpha is 0, the colour is still that of the surface
    width = height = 0
    try:
        with opened(path, config) as file:
            warnings: list[str] = []
            channels = color_channels(path, file, warnings.append)
            part = channels[0].part
            file.seek_subimage(part, 0)
            width, height, level = file.spec().full_width, file.spec().full_height, 0
            while max(file.spec().width, file.spec().height) > limit and file.seek_subimage(part, level + 1):
                level += 1
            complaint(file)
            file.seek_subimage(part, level)
            check_image(path, file.spec())
            factor = max(1, max(file.spec().full_width, file.spec().full_height) // limit)
            pixels = _limited(_read(path, file, level, channels, linearize=linearize, factor=factor), limit)
            return Decoded(pixels, width, height, warnings=tuple(warnings))
    except MemoryError:
        return Decoded(None, width, height, f"its {width} x {height} pixels do not fit into memory")
    except UnreadableImageError as error:
        return Decoded(None, width, height, error.problem)
    except OSError as error:
        return Decoded(None, width, height, error.strerror or str(error))


def wrap_modes(path: str) -> tuple[str, str] | None:
    """Return a texture file's wrap modes in u and v, "black", "clamp", "periodic" or "mirror"; None if it has none."""
    try:
        with opened(path) as file:
            first, _, second = str(file.spec().getattribute("wrapmodes") or "").partition(",")
    except (SceneError, OSError):
        return None
    return (first, second or first) if first else None


def linear(pixels: Array, kind: str) -> Array:
    """Return the linear values of stored sRGB pixels, whose type in the file is `kind`."""
    channels, result = pixels.shape[2], pixels.copy()
    count = channels if channels not in (2, 4) else channels - 1  # alpha is never encoded
    if kind == "uint8":
        result[..., :count] = DECODED[(pixels[..., :count] * 255 + 0.5).astype(np.uint8)]
    else:
        result[..., :count] = srgb_decoded(result[..., :count])
    return result


def _read(
    path: str, file: OpenImageIO.ImageInput, level: int, channels: Sequence[Channel], *, linearize: Linearize,
    factor: int,
) -> Array:  # fmt: skip
    """Return channels of a level over the whole picture, black where the file holds none of it.

    It is scaled down by a whole number, the `factor`: pixels are means over squares.
    """
    spec, indices = file.spec(), [each.index for each in channels]
    (width, height), (left, top) = (spec.full_width, spec.full_height), corner_of(spec)
    both = range(min(indices), max(indices) + 1)
    chosen = [index - both.start for index in indices]
    sums = np.zeros((-(-height // factor), -(-width // factor), len(indices)), np.float32)
    for row, strip in strips(path, file, part=channels[0].part, level=level, channels=both, factor=factor):
        _add_squares(sums, linearize(strip[..., chosen], str(spec.format)), (left, top + row), factor)
    if factor > 1:
        rows, across = (np.minimum(factor, size - factor * np.arange(-(-size // factor))) for size in (height, width))
        sums /= (rows[:, None] * across)[..., None].astype(np.float32)
    return sums


def _add_squares(sums: Array, pixels: Array, corner: tuple[int, int], factor: int) -> None:
    """Add pixels, whose first one has a place (x, y) in the picture, to the sums over squares in which they are."""
    for axis, place in ((0, corner[1]), (1, corner[0])) if factor > 1 else ():
        squares = np.append(0, np.arange(factor - place % factor, pixels.shape[axis], factor))
        pixels = np.add.reduceat(pixels, squares, axis=axis)
    inside, shown = overlap(pixels, (corner[0] // factor, corner[1] // factor), (0, 0, sums.shape[1], sums.shape[0]))
    sums[inside] += pixels[shown]


def _limited(pixels: Array, limit: int) -> Array:
    """Return pixels, with less than twice the limit along a side, scaled down to it; the aspect ratio stays."""
    height, width, _ = pixels.shape
    size = max(height, width)
    if size <= limit:
        return pixels
    return resized(pixels, max(1, round(height * limit / size)), max(1, round(width * limit / size)))


def resized(pixels: Array, height: int, width: int) -> Array:
    """Return pixels, (H, W, C) float32, at a smaller size; each is the mean of those that it covers."""
    region = OpenImageIO.ROI(0, width, 0, height, 0, 1, 0, pixels.shape[2])
    source = OpenImageIO.ImageBuf(np.ascontiguousarray(pixels))
    made = OpenImageIO.ImageBufAlgo.resize(source, filtername="box", roi=region)
    return np.asarray(made.get_pixels("float"), dtype=np.float32).reshape(height, width, -1)
