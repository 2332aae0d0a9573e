"""Image files: layered EXRs and tone-mapped PNGs are written, layers and pictures are read.

Files are written whole or not at all: see `runtime.files`.
"""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO

from ..runtime.files import PathLike, try_path, write_bytes
from ..runtime.inputs import check_size, is_special, why_unreadable
from ..scene import Array, SceneError
from .display import dithered, is_encoded, srgb_decoded, srgb_encoded, tone_mapped

Views = Mapping[str, tuple[Mapping[str, Array], Mapping[str, Any]]]  # view to its layers and metadata

LOG = logging.getLogger("photonbeams")

HALF_MAX, HALF_MIN = 65504.0, 2.0**-24  # the largest finite half, and the smallest above 0
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # red, green, blue, white: the `chromaticities` of EXR
# Attributes of a frame that must be the same in all parts of an EXR.
SHARED = ("displayWindow", "pixelAspectRatio", "chromaticities")
_PNG_UNIT = 10_000  # pixels in the unit of length in which a PNG gives the shape of its pixels
MOST_PIXELS = 1 << 28  # of an image that is read, or of a level of it: a small file may claim to hold more
_MOST_BYTES = 1 << 33  # of a file: OpenImageIO may read all of it to find out that it is no image
_STRIP = 64 * 2**20  # bytes of pixels that are decoded at a time


# -- files -----------------------------------------------------------------------------------------------------------


def prepare_output(path: PathLike) -> Path:
    """Check, before hours of rendering, that a picture can be written to `path`, and return it.

    The check leaves no trace. When the picture is written its folder is made, if it does not exist, as by usdrecord.

    Raises
    ------
    SceneError
        A name that ends neither in .exr nor in .png.
    OSError
        The folder cannot be made or written to, or there is a folder with the file's name.
    """
    path = _picture_path(path)
    try_path(path)
    return path


def _picture_path(path: PathLike) -> Path:
    path = Path(path)
    if path.suffix.lower() not in (".exr", ".png"):
        raise SceneError(f"cannot write {path}: expected a name that ends in .exr (layers) or .png (a picture)")
    return path


# -- out -------------------------------------------------------------------------------------------------------------


def write_frame(
    path: PathLike,
    layers: Mapping[str, Array],
    metadata: Mapping[str, Any] | None = None,
    layer: str = "rgba",
    exposure: float = 0.0,
    views: Views | None = None,
) -> None:
    """Write a frame by the file's suffix: all layers to an .exr, or one `layer` tone-mapped to a .png.

    Parameters
    ----------
    views
        As for `write_exr`; a .png shows them side by side at full size, the first on the left.

    Raises
    ------
    SceneError
        Another suffix, no such layer, or a .png of a layer without colours, such as `depth`.
    ValueError
        As `write_exr` and `write_png`.
    OSError
        As `atomic_path`.
    """
    write_bytes(path, encoded_frame(path, layers, metadata, layer, exposure, views))


def encoded_frame(
    path: PathLike,
    layers: Mapping[str, Array],
    metadata: Mapping[str, Any] | None = None,
    layer: str = "rgba",
    exposure: float = 0.0,
    views: Views | None = None,
) -> bytes | memoryview:
    """Return the file that `write_frame` writes to `path`, which decides the kind and is named in messages."""
    path = _picture_path(path)
    if path.suffix.lower() == ".exr":
        return encoded_exr(path, layers, metadata, views)
    eyes = [each for each, _ in views.values()] if views else [layers]
    for each in eyes:
        if layer not in each:
            raise SceneError(f"cannot write {path}: there is no layer '{layer}', only {', '.join(each)}")
        if each[layer].shape[2] < 3:
            raise SceneError(f"cannot write {path}: '{layer}' has no colours: expected another layer, or an .exr")
    ratio = (metadata or {}).get("pixelAspectRatio", 1.0)
    return png_of(*(each[layer] for each in eyes), exposure=exposure, pixel_aspect=ratio)


def write_exr(
    path: PathLike,
    layers: Mapping[str, Array],
    metadata: Mapping[str, Any] | None = None,
    views: Views | None = None,
) -> None:
    """Write a multi-part EXR with a part for each layer, `rgba` first: ZIP, half for colours, float for others.

    Parameters
    ----------
    path
        Its folder is made if it does not exist.
    layers
        Pixels by name, all of one size, first row on top: (H, W, 4) and (H, W, 3) become R, G, B(, A), those of
        `normal` X, Y, Z, and (H, W) or (H, W, 1) becomes Z. Colours beyond ±65504, the largest half, are clamped,
        with a warning; infinite depth stays.
    metadata
        Header attributes for every part: str, int, float, `Fraction` (framesPerSecond), lists of str, and (2,) and
        (4, 4) arrays. The matrices worldToCamera and worldToNDC are for row vectors, as in Imath and USD. For a cropped
        frame, or one with overscan, `dataWindow` and `displayWindow` are (x0, y0, x1, y1), the last pixel included.
        Chromaticities are Rec. 709 unless given.
    views
        Layers and metadata of each view, instead of `layers` and `metadata`: "left" and "right", the default one
        first. Each part has the attribute `view`; if there are several views, the part's name ends with it, as in
        beams.left, since names must be unique.

    Raises
    ------
    ValueError
        Layers of several sizes or of other shapes, metadata for which EXR has no type, views with different display
        windows or chromaticities, or one without a name among several.
    OSError
        As `atomic_path`.

    References
    ----------
    Storing multi-view images, https://openexr.com/en/latest/MultiViewOpenEXR.html: this is the preferred one of its two
    forms.
    """
    write_bytes(path, encoded_exr(path, layers, metadata, views))


def encoded_exr(
    path: PathLike,
    layers: Mapping[str, Array],
    metadata: Mapping[str, Any] | None = None,
    views: Views | None = None,
) -> memoryview:
    """Return the file that `write_exr` writes to `path`, which is named in messages."""
    views = views or {"": (layers, metadata or {})}
    views = {
        view: (seen, {"chromaticities": REC709, **about, **({"view": view} if view else {})})
        for view, (seen, about) in views.items()
    }
    _check_views(path, views)
    _warn_of_range(path, views)
    parts = [
        OpenEXR.Part(_header(about), _channels(name, seen[name]), _part_name(name, view, views))
        for view, (seen, about) in views.items()
        for name in sorted(seen, key=lambda name: name != "rgba")  # the sort is stable: the others keep their order
    ]
    return encoded_parts(path, parts)


def encoded_parts(path: PathLike, parts: list[OpenEXR.Part]) -> memoryview:
    """Return the parts of an EXR as the file that will be at `path`, which is named in messages."""
    data = BytesIO()  # OpenEXR reports no error if the last bytes of a file cannot be written
    try:
        OpenEXR.File(parts).write(data)
    except RuntimeError as error:  # OpenEXR raises no other kind
        raise SceneError(f"{path} cannot be written: {reason(str(error))}") from error
    return data.getbuffer()


def _warn_of_range(path: PathLike, views: Views) -> None:
    """Warn about layers with colours that half floats cannot hold."""
    bright, dark = [], []
    for view, (seen, _) in views.items():
        for name in (name for name in seen if _is_half(name, np.shape(seen[name]))):
            colors = np.asarray(seen[name])[..., :3]
            peak = max(np.fmax.reduce(colors, axis=None), -np.fmin.reduce(colors, axis=None))  # NaN is left out
            if peak > HALF_MAX:
                bright.append(_part_name(name, view, views))
            elif 0 < peak <= HALF_MIN / 2:
                dark.append(_part_name(name, view, views))
    if bright:
        text = "colours beyond 65504, the largest half float: they are clamped, and layers do not add up there"
        LOG.warning("%s: %s: %s", path, _listed(bright), text)
    if dark:
        LOG.warning("%s: %s: all light is below 6e-8, the smallest half float: it is black", path, _listed(dark))


def _listed(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _is_half(name: str, shape: tuple[int, ...]) -> bool:
    """Return whether a layer is written in half floats: it has colours."""
    return name != "normal" and len(shape) == 3 and shape[2] in (3, 4)


def _part_name(layer: str, view: str, views: Views) -> str:
    return f"{layer}.{view}" if len(views) > 1 else layer


def _check_views(path: PathLike, views: Views) -> None:
    """Raise ValueError for views that OpenEXR would refuse with an unclear message, or write wrongly."""
    if len(views) > 1 and "" in views:
        raise ValueError(f"while writing {path}, got views {', '.join(map(repr, views))}: expected a name for each")
    for name in SHARED:
        values = {view: tuple(np.ravel(about.get(name, ())).tolist()) for view, (_, about) in views.items()}
        if len(set(values.values())) > 1:
            text = " and ".join(f"{value} for {view}" for view, value in values.items())
            raise ValueError(f"while writing {path}, got {name} {text}: expected one for all views")
    shapes = {
        _part_name(name, view, views): np.shape(pixels)
        for view, (seen, _) in views.items()
        for name, pixels in seen.items()
    }
    if not all(seen for seen, _ in views.values()) or len({shape[:2] for shape in shapes.values()}) > 1:
        text = ", ".join(f"{name} {shape}" for name, shape in shapes.items()) or "none"
        raise ValueError(f"while writing {path}, got layers {text}: expected some for each view, all of one size")


def _header(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return metadata as attributes of the types that the OpenEXR module takes."""
    result: dict[str, Any] = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    for name, value in metadata.items():
        if name in ("dataWindow", "displayWindow"):
            x0, y0, x1, y1 = value
            result[name] = (np.array([x0, y0], np.int32), np.array([x1, y1], np.int32))
        elif isinstance(value, np.ndarray) and value.shape in ((4, 4), (2,)):
            result[name] = np.ascontiguousarray(value, dtype=np.float32)
        elif isinstance(value, str | Fraction | tuple) or (isinstance(value, list) and _all_text(value)):
            result[name] = value
        elif isinstance(value, int | np.integer):
            number = int(value)
            result[name] = number if abs(number) < 2**31 else str(number)  # EXR's int has 32 bits
        elif isinstance(value, float | np.floating):
            result[name] = float(value)
        else:
            raise ValueError(f"while writing an EXR header, got {name} = {value!r}: no attribute type fits it")
    return result


def _all_text(values: list[Any]) -> bool:
    return bool(values) and all(isinstance(each, str) for each in values)


def _channels(name: str, pixels: Array) -> dict[str, Array]:
    """Return the layer's channels by name; "RGB", "RGBA" and "Z" are OpenEXR's names for interleaved arrays."""
    pixels = np.asarray(pixels)
    if name == "normal" and pixels.ndim == 3 and pixels.shape[2] == 3:
        return {axis: np.ascontiguousarray(pixels[..., i], dtype=np.float32) for i, axis in enumerate("XYZ")}
    if _is_half(name, pixels.shape):
        key = "RGBA" if pixels.shape[2] == 4 else "RGB"
        return {key: np.ascontiguousarray(np.clip(pixels, -HALF_MAX, HALF_MAX), dtype=np.float16)}
    if pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 1):
        return {"Z": np.ascontiguousarray(pixels.reshape(pixels.shape[:2]), dtype=np.float32)}
    raise ValueError(f"while writing layer {name}, got shape {pixels.shape}: expected (H, W), (H, W, 3) or (H, W, 4)")


def write_png(path: PathLike, *eyes: Array, exposure: float = 0.0, pixel_aspect: float = 1.0) -> None:
    """Write the picture that `png_of` encodes; raise ValueError as it does, and OSError as `atomic_path` does."""
    write_bytes(path, png_of(*eyes, exposure=exposure, pixel_aspect=pixel_aspect))


def png_of(*eyes: Array, exposure: float = 0.0, pixel_aspect: float = 1.0) -> bytes:
    """Return scene-linear colours (H, W, 3 or 4), premultiplied, as an opaque 8-bit sRGB picture over black, a PNG.

    Several eyes are shown side by side, the first on the left; each has the bits that it would have alone.

    Alpha is left out: beams add light where alpha is 0, which PNG's alpha cannot express.

    Parameters
    ----------
    exposure
        In stops: the colours are multiplied by 2^exposure.
    pixel_aspect
        Width of a pixel over its height.

    Raises
    ------
    ValueError
        Eyes of different heights.

    References
    ----------
    Portable Network Graphics (PNG) Specification, https://www.w3.org/TR/png-3/.
    """
    heights = [np.shape(eye)[0] for eye in eyes]
    if len(set(heights)) != 1:
        raise ValueError(f"while encoding a picture, got eyes {heights} pixels high: expected one height")
    picture = np.hstack([dithered(srgb_encoded(tone_mapped(np.asarray(eye)[..., :3], exposure))) for eye in eyes])
    height, width, _ = picture.shape
    rows = np.diff(picture, axis=1, prepend=np.uint8(0)).reshape(height, -1)  # filter 1, "Sub", modulo 256
    data = zlib.compress(np.insert(rows, 0, 1, axis=1).tobytes())
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # 8 bits, red, green and blue, not interlaced
    chunks = {b"IHDR": head, b"sRGB": b"\0", b"IDAT": data, b"IEND": b""}
    if pixel_aspect != 1:  # pixels in a unit, across and down
        shape = struct.pack(">IIB", _PNG_UNIT, round(_PNG_UNIT * pixel_aspect), 0)
        chunks = {b"IHDR": head, b"pHYs": shape, **chunks}
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in chunks.items()
    )


# -- in --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Part:
    """A part of an EXR, or the whole of another image.

    Attributes
    ----------
    name
        "rgba" for a part without a name; to parts with the same name, the view or a number is appended.
    channels, types
        The channels' names, and the types in which they are stored: half, float, uint8, …
    pixels
        (H, W, C) float32 as stored, no colour converted, first row on top.
    view
        "left", "right", or another view that the file names; empty if it names none.
    """

    name: str
    channels: tuple[str, ...]
    types: tuple[str, ...]
    pixels: Array
    view: str = ""

    @property
    def layer(self) -> str:
        """The name without the view at its end."""
        return _layer(self.name, self.view)


def read_parts(path: PathLike) -> list[Part]:
    """Return all parts of an image file, in its order.

    Raises
    ------
    OSError
        The file does not exist, or may not be read.
    SceneError
        The file is no image, or a broken one.
    """
    with opened(path) as file:
        headers = list(_headers(path, file))
        check_decoded(path, sum(pixels_of(spec) * spec.nchannels for *_, spec in headers))
        return [
            Part(name, channels, types, _pixels(path, file, index), view)
            for index, (name, channels, types, view, _) in enumerate(headers)
        ]


@dataclass(frozen=True)
class Summary:
    """A part of an EXR, or the whole of another image, in a few numbers.

    Attributes
    ----------
    name, channels, types, view
        As in `Part`.
    width, height
        Its size in pixels.
    least, mean, greatest
        Of the finite values in all channels; None if there is none.
    nans, infinite
        How many pixels have a NaN or an infinite value.
    """

    name: str
    channels: tuple[str, ...]
    types: tuple[str, ...]
    view: str
    width: int
    height: int
    least: float | None
    mean: float | None
    greatest: float | None
    nans: int
    infinite: int

    @property
    def layer(self) -> str:
        """The name without the view at its end."""
        return _layer(self.name, self.view)


def summaries(path: PathLike) -> list[Summary]:
    """Return a summary of each part of an image file, in its order, without all of its pixels in memory at once.

    Raises
    ------
    OSError, SceneError
        As `read_parts`.
    """
    with opened(path) as file:
        return [
            Summary(name, channels, types, view, spec.width, spec.height, *_statistics(path, file, index))
            for index, (name, channels, types, view, spec) in enumerate(list(_headers(path, file)))
        ]


def _layer(name: str, view: str) -> str:
    return name.removesuffix(f".{view}") if view else name


def _statistics(path: PathLike, file: Any, index: int) -> tuple[float | None, float | None, float | None, int, int]:
    """Return the last five fields of a `Summary`."""
    file.seek_subimage(index, 0)
    channels, least, greatest, total, count, nans, infinite = file.spec().nchannels, np.inf, -np.inf, 0.0, 0, 0, 0
    for _, strip in strips(file, index, 0, channels):
        if strip is None or (message := complaint(file)):
            raise unreadable(path, complaint(file) if strip is None else message)
        pixels = np.asarray(strip, dtype=np.float32).reshape(-1, channels)
        finite = pixels[np.isfinite(pixels)]
        if finite.size:
            least, greatest = min(least, float(finite.min())), max(greatest, float(finite.max()))
        total, count = total + float(finite.sum(dtype=np.float64)), count + finite.size
        nans += int(np.isnan(pixels).any(axis=1).sum())
        infinite += int(np.isinf(pixels).any(axis=1).sum())
    return (least, total / count, greatest, nans, infinite) if count else (None, None, None, nans, infinite)


def read_layers(path: PathLike, view: str | None = None) -> dict[str, Array]:
    """Return the pixels of `read_parts` by name, (H, W, C), or (H, W) where there is one channel.

    With a `view`, return only its layers, by names without the view.

    Raises
    ------
    OSError
        As `read_parts`.
    SceneError
        As `read_parts`, or no such view.
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

    Raises
    ------
    OSError, SceneError
        As `read_parts`.
    """
    with opened(path) as file:
        pixels = _pixels(path, file, 0)
        kind = str(file.spec().format)
    if is_encoded(kind, pixels.shape[2]):
        pixels[..., :3] = srgb_decoded(pixels[..., :3])
    return pixels


@contextmanager
def opened(path: PathLike, config: Any = None) -> Iterator[Any]:
    """Open an image file as an OpenImageIO input, for a `with` statement; no part of it is too large to be decoded.

    Raises
    ------
    OSError, SceneError
        As `read_parts`.
    """
    path = Path(path)
    if problem := why_unreadable(path, _MOST_BYTES):
        if not (is_special(path) or path.is_dir()):
            path.open("rb").close()  # for the system's own error if the file does not exist or may not be read
        raise UnreadableImageError(path, problem)
    given = [] if config is None else [config]
    file: Any = OpenImageIO.ImageInput.open(str(path), *given)
    if not file:
        raise unreadable(path, complaint(OpenImageIO))
    try:
        yield file
        complaint(file)  # seeking past the last part is no error
    finally:
        file.close()


def check_image(path: PathLike, spec: Any) -> None:
    """Raise SceneError if a part of an image, or the picture that it is a part of, has too many pixels."""
    for width, height in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
        if width * height * max(spec.depth, 1) > MOST_PIXELS:
            problem = f"it has {width} x {height} pixels, which are more than {MOST_PIXELS:,}"
            raise UnreadableImageError(path, problem)


def check_decoded(path: PathLike, values: float) -> None:
    """Raise SceneError if so many values of an image, as float32, are more than the memory here."""
    try:
        check_size(4.0 * values, np.inf, "its decoded pixels")
    except SceneError as error:
        raise UnreadableImageError(path, str(error)) from None


def pixels_of(spec: Any) -> int:
    """Return the number of pixels that a part of an image holds."""
    return int(spec.width) * int(spec.height) * max(int(spec.depth), 1)


def strips(file: Any, index: int, level: int, channels: int, factor: int = 1) -> Iterator[tuple[int, Any]]:
    """Yield the first row and the pixels of strips, whose height is a multiple of `factor` and of the tiles' height."""
    spec = file.spec()
    step = int(np.lcm(factor, spec.tile_height)) if spec.tile_width else factor
    step *= max(1, _STRIP // (4 * spec.width * channels * step))
    for first in range(0, spec.height, step):
        end = min(first + step, spec.height)
        x, y = spec.x, spec.y
        if spec.tile_width:
            columns = (x, x + spec.width)
            yield first, file.read_tiles(index, level, *columns, y + first, y + end, 0, 1, 0, channels, "float")
        else:
            yield first, file.read_scanlines(index, level, y + first, y + end, 0, 0, channels, "float")


def _headers(path: PathLike, file: Any) -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...], str, Any]]:
    """Yield name, channels, types, view and description of each part, as in `Part`."""
    names: list[str] = []
    while file.seek_subimage(len(names), 0):
        spec = file.spec()
        check_image(path, spec)
        name, view = spec.get_string_attribute("oiio:subimagename") or "rgba", spec.get_string_attribute("view")
        names.append(f"{name}.{view or len(names)}" if name in names else name)
        types = tuple(str(spec.channelformat(channel)) for channel in range(spec.nchannels))
        yield names[-1], tuple(spec.channelnames), types, view, spec


def _pixels(path: PathLike, file: Any, index: int) -> Array:
    """Return the pixels of a part, (H, W, C) float32."""
    file.seek_subimage(index, 0)
    spec = file.spec()
    check_image(path, spec)
    pixels = file.read_image(index, 0, 0, spec.nchannels, "float")
    message = complaint(file)
    if pixels is None or message:
        raise unreadable(path, message)
    return np.asarray(pixels, dtype=np.float32).reshape(spec.height, spec.width, spec.nchannels)


class UnreadableImageError(SceneError):
    """An image cannot be decoded, because of a `problem`: a clause about the file."""

    def __init__(self, path: PathLike, problem: str) -> None:
        super().__init__(f"{path} cannot be read: expected an image ({problem})")
        self.problem = problem


def unreadable(path: PathLike, message: str) -> UnreadableImageError:
    """Return the error to raise for an image that cannot be decoded, with OpenImageIO's message."""
    return UnreadableImageError(path, reason(message))


def complaint(decoder: Any) -> str:
    """Return OpenImageIO's last error message, which may quote bytes of a broken file that are no valid text."""
    try:
        return str(decoder.geterror())
    except UnicodeDecodeError as error:
        return error.object.decode(errors="replace")


def reason(message: str) -> str:
    """Return the first line of the decoder's message, or "unknown format" if there is none."""
    return message.strip().splitlines()[0] if message.strip() else "unknown format"
