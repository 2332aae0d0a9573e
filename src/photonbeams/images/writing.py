"""Encode pictures: layered EXRs and tone-mapped PNGs."""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Mapping
from fractions import Fraction
from io import BytesIO
from typing import Any

import numpy as np
import OpenEXR

from ..constants import CRYPTO, DEPTH_LAYER, is_number
from ..runtime.files import PathLike, write_bytes
from ..scene import Array, SceneError, number
from .color_spaces import COLOR_SPACE, REC709, USUAL_SPACES, converted
from .display import dithered, srgb_encoded, tone_mapped
from .files import reason

Metadata = Mapping[str, Any]  # the attributes of a header: text, numbers, vectors and matrices
Views = Mapping[str, tuple[Mapping[str, Array], Metadata]]  # view to its layers and metadata

LOG = logging.getLogger("photonbeams")

HALF_MAX = 65504.0  # the largest finite half
HALF_MIN = 2.0**-24  # the smallest half above 0
# Names of the channels of layers that have no colours.
#: The end of the names of attributes that hold, in double precision, what attributes of EXR hold in single precision.
EXACT = "Double"
_COARSE = 1e-4  # error of a number in single precision from which it is written in double precision, too

_AXES = {"normal": "XYZ", "position": "XYZ", "motion": "uv"}
_CRYPTO_HEADER = "cryptomatte/"
# Attributes of a frame that must be the same in all parts of an EXR.
SHARED = ("displayWindow", "pixelAspectRatio", "chromaticities")
_PNG_UNIT = 10_000  # pixels in the unit of length in which a PNG gives the shape of its pixels


def encoded_exr(path: PathLike, views: Views, *, single_part: bool = False) -> memoryview:
    """Return a multi-part EXR with a part for each layer, `rgba` first: ZIP, half for colours, float for others.

    Layers are pixels by name, all of one size, first row on top: (H, W, 4) and (H, W, 3) become R, G, B(, A), those of
    `normal` and `position` X, Y, Z, `motion` u, v, and (H, W) or (H, W, 1) becomes Z. Cryptomattes stay float. Colours
    beyond ±65504, the largest half, are clamped, with a warning; infinite depth stays.

    Metadata are header attributes for every part: str, int, float, `Fraction` (framesPerSecond), lists of str, and (2,)
    and (4, 4) arrays. The matrices worldToCamera and worldToNDC are for row vectors, as in Imath and USD. For a cropped
    frame, or one with overscan, `dataWindow` and `displayWindow` are (x0, y0, x1, y1), the last pixel included.
    Chromaticities and colour space are linear Rec. 709 unless given.

    Parameters
    ----------
    path
        Where the file will be, for messages.
    views
        Layers and metadata of each view, "left" and "right", the default one first; a single one may have no name. Each
        part has the attribute `view`; if there are several views, the part's name ends with it, as in beams.left, since
        names must be unique.
    single_part
        Whether all layers are in one part, for programs that read only the first: those of `rgba` and `depth` as R, G,
        B, A and Z, others with their layer, as in beams.R. Several views are then in OpenEXR's older form, with the
        attribute `multiView`: right.R and right.beams.R are those of the view "right", the second one.

    Raises
    ------
    ValueError
        Layers of several sizes or of other shapes, metadata for which EXR has no type, views with different display
        windows or chromaticities, or one without a name among several.

    References
    ----------
    Storing multi-view images, https://openexr.com/en/latest/MultiViewOpenEXR.html: parts are the preferred one of its
    two forms.
    """
    views = {
        view: (seen, {**USUAL_SPACES.header, **about, **({"view": view} if view else {})})
        for view, (seen, about) in views.items()
    }
    _check_views(path, views)
    _warn_of_range(path, views)
    if single_part:
        return encoded_parts(path, [_single_part(views)])
    parts = [
        OpenEXR.Part(
            attributes_of(part_metadata(about, name)), _channels(name, seen[name]), _part_name(name, view, views)
        )
        for view, (seen, about) in views.items()
        for name in sorted(seen, key=lambda name: name != "rgba")  # the sort is stable: the others keep their order
    ]
    return encoded_parts(path, parts)


def _single_part(views: Views) -> OpenEXR.Part:
    """Return the one part with all layers of all views."""
    first, *others = views
    about = dict(views[first][1])
    if others:
        del about["view"]
        about["multiView"] = [*views]
    channels = dict[str, Array]()
    for view, (seen, _) in views.items():
        for layer, pixels in seen.items():
            prefix = "" if layer in ("rgba", DEPTH_LAYER) else f"{layer}."
            for name, each in _channels(layer, pixels).items():
                channels[f"{view}.{prefix}{name}" if view in others else f"{prefix}{name}"] = each
    return OpenEXR.Part(attributes_of(part_metadata(about, "rgba")), channels, "rgba")


def part_metadata(about: Metadata, layer: str) -> dict[str, Any]:
    """Return the metadata of a layer's part: only layers of colours have a colour space.

    The long manifests of cryptomattes are only where readers look for them.
    """
    return {
        key: value for key, value in about.items()
        if (not key.startswith(_CRYPTO_HEADER) or layer == "rgba" or layer.startswith(CRYPTO))
        and not (key == COLOR_SPACE and is_number(layer))
    }  # fmt: skip


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
    return not is_number(name) and len(shape) == 3 and shape[2] in (3, 4)


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


def attributes_of(metadata: Metadata) -> dict[str, Any]:
    """Return metadata as attributes of the types that the OpenEXR module takes."""
    result: dict[str, Any] = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    for name, value in metadata.items():
        if name in ("dataWindow", "displayWindow"):
            x0, y0, x1, y1 = value
            result[name] = (np.array([x0, y0], np.int32), np.array([x1, y1], np.int32))
        elif isinstance(value, np.ndarray) and value.shape in ((4, 4), (2,)):
            result[name] = np.ascontiguousarray(value, dtype=np.float32)
            if np.max(np.abs(value - result[name])) > _COARSE:  # a camera far from zero
                result[f"{name}{EXACT}"] = np.ascontiguousarray(value, dtype=np.float64)
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


def _all_text(values: list[object]) -> bool:
    return bool(values) and all(isinstance(each, str) for each in values)


def _channels(name: str, pixels: Array) -> dict[str, Array]:
    """Return the layer's channels by name, (H, W) each."""
    planes = np.asarray(pixels) if np.ndim(pixels) == 3 else np.expand_dims(pixels, -1)
    half = _is_half(name, planes.shape)
    letters = _AXES.get(name, "RGBA"[: planes.shape[-1]] if half or name.startswith(CRYPTO) else "Z")
    if planes.ndim != 3 or planes.shape[2] != len(letters):
        shape = np.shape(pixels)
        raise ValueError(f"while writing layer {name}, got shape {shape}: expected (H, W), (H, W, 3) or (H, W, 4)")
    stored = np.clip(planes, -HALF_MAX, HALF_MAX) if half else planes
    return {
        letter: np.ascontiguousarray(stored[..., k], np.float16 if half else np.float32)
        for k, letter in enumerate(letters)
    }


def write_png(path: PathLike, *eyes: Array, exposure: float = 0.0, pixel_aspect: float = 1.0) -> None:
    """Write the picture that `png_of` encodes; raise ValueError as it does, and OSError as `atomic_path` does."""
    write_bytes(path, png_of(*eyes, exposure=exposure, pixel_aspect=pixel_aspect))


def png_of(*eyes: Array, exposure: float = 0.0, pixel_aspect: float = 1.0, space: str = REC709) -> bytes:
    """Return scene-linear colours (H, W, 3 or 4), premultiplied, as an opaque 8-bit sRGB picture over black, a PNG.

    Several eyes are shown side by side, the first on the left; each has the bits that it would have alone.

    Alpha is left out: beams add light where alpha is 0, which PNG's alpha cannot express.

    Parameters
    ----------
    exposure
        In stops, from -100 to 100: the colours are multiplied by 2^exposure.
    pixel_aspect
        Width of a pixel over its height.
    space
        The linear colour space of the eyes.

    Raises
    ------
    ValueError
        Eyes of different heights; SceneError, which is one, for another exposure.

    References
    ----------
    Portable Network Graphics (PNG) Specification, https://www.w3.org/TR/png-3/.
    """
    exposure = number(exposure, "exposure", -100.0, 100.0)
    heights = [np.shape(eye)[0] for eye in eyes]
    if len(set(heights)) != 1:
        raise ValueError(f"while encoding a picture, got eyes {heights} pixels high: expected one height")
    shown = [converted(np.asarray(eye)[..., :3], space) for eye in eyes]
    picture = np.hstack([dithered(srgb_encoded(tone_mapped(each, exposure))) for each in shown])
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
