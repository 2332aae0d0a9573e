"""Images as textures: decoded by OpenImageIO, scene-linear, and no larger than a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import OpenImageIO

from ..scene import Array, SceneError
from .display import DECODED, srgb_decoded
from .files import UnreadableImageError, check_image, complaint, decoded_rows, opened, reason, strips

#: Textures with more pixels along a side are scaled down, unless a user sets another limit.
TEXTURE_LIMIT = 4096

_LARGEST = 16384  # megabytes of uncompressed pixels: even a small file may claim to hold more

OpenImageIO.attribute("limits:imagesize_MB", _LARGEST)

#: A function of stored pixels, and of the type in which they are stored, that returns scene-linear pixels.
Linearize = Callable[[Array, str], Array]


@dataclass(frozen=True)
class Decoded:
    """An image file's pixels, (H, W, C) float32 scene-linear, and the file's size; or None and the decoder's error."""

    pixels: Array | None
    width: int = 0
    height: int = 0
    error: str = ""


def decoded(path: str, linearize: Linearize, limit: int = TEXTURE_LIMIT) -> Decoded:
    """Return an image of at most `limit` pixels along a side: a smaller level of the file, or means over pixels.

    This takes no more memory than four times the result and a strip of the file.
    """
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # where alpha is 0, the colour is still that of the surface
    width = height = 0
    try:
        with opened(path, config) as file:
            part, first = _colors(file)
            file.seek_subimage(part, 0)
            width, height, level = file.spec().full_width, file.spec().full_height, 0
            while max(file.spec().width, file.spec().height) > limit and file.seek_subimage(part, level + 1):
                level += 1
            complaint(file)
            file.seek_subimage(part, level)
            check_image(path, file.spec())
            pixels = _read(file, part, level, first, linearize=linearize, limit=limit)
            return Decoded(pixels, width, height, "" if pixels is not None else reason(complaint(file)))
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


def _colors(file: OpenImageIO.ImageInput) -> tuple[int, int]:
    """Return the part of a file and its channel with which colours begin, R, G and B; 0 if none are named."""
    part = 0
    while file.seek_subimage(part, 0):
        names = [each.rpartition(".")[2].upper() for each in file.spec().channelnames]
        for first in range(len(names) - 2):
            if names[first : first + 3] == ["R", "G", "B"]:
                return part, first
        part += 1
    return 0, 0


def _read(
    file: OpenImageIO.ImageInput, part: int, level: int, first: int, *, linearize: Linearize, limit: int
) -> Array | None:
    """Return the pixels of a level, scaled down by a whole number if it is too large; None if that fails."""
    spec = file.spec()
    kind, width, height = str(spec.format), spec.width, spec.height
    # A fourth channel may be alpha; if it is not, it is no part of the colour.
    count = spec.nchannels - first
    count = count if count <= 3 else 4 if spec.alpha_channel in (first + 3, -1) else 3
    channels = range(first, first + count)
    factor = max(1, max(spec.full_width, spec.full_height) // limit)
    if factor == 1:
        stored = file.read_image(part, level, channels.start, channels.stop, "float")
        if stored is None or not np.size(stored):
            return None
        return _limited(_whole(linearize(decoded_rows(file, stored, channels), kind), spec, 1), limit)
    result = np.empty((-(-height // factor), -(-width // factor), count), np.float32)
    for row, strip in strips(file, part, level, channels, factor=factor):
        if strip is None:
            return None
        scaled = _means(linearize(decoded_rows(file, strip, channels), kind), factor)
        result[row // factor : row // factor + len(scaled)] = scaled
    return _limited(_whole(result, spec, factor), limit)


def _whole(pixels: Array, spec: OpenImageIO.ImageSpec, factor: int) -> Array:
    """Return the whole picture, of whose pixels a file holds some: it is black and transparent elsewhere."""
    shape = -(-spec.full_height // factor), -(-spec.full_width // factor), pixels.shape[2]
    top, left = round((spec.y - spec.full_y) / factor), round((spec.x - spec.full_x) / factor)
    if (top, left, *shape) == (0, 0, *pixels.shape):
        return pixels
    result = np.zeros(shape, np.float32)
    rows, columns = (
        slice(max(begin, 0), max(min(begin + size, most), 0))
        for begin, size, most in zip((top, left), pixels.shape, shape, strict=False)
    )
    result[rows, columns] = pixels[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return result


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


def _means(pixels: Array, factor: int) -> Array:
    """Return the means over squares of pixels; squares at the right and lower edges may be incomplete."""
    for _ in (0, 1):  # over rows, then over columns
        whole = len(pixels) // factor * factor
        parts = [sum(pixels[first:whole:factor] for first in range(factor)) / np.float32(factor)]
        if whole < len(pixels):
            parts.append(pixels[whole:].mean(axis=0, keepdims=True))
        pixels = np.concatenate(parts).swapaxes(0, 1)
    return pixels
