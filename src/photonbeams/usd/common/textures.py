"""Read image files of stages as scene-linear pixels; the stage's asset resolver finds the files."""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from ...images.color_spaces import REC709, ColorSpaces
from ...images.display import is_encoded
from ...images.textures import TEXTURE_LIMIT, Decoded, decoded, linear
from ...runtime.files import temporary_folder, write_bytes
from ...runtime.inputs import check_size, content, why_unreadable
from ...scene import Array, SceneError, rgb
from .color_spaces import AUTO, LINEAR, SRGB, color_space, to_working
from .openusd import Ar, Sdf, Usd
from .reading import Reading
from .selection import kept

_MOST_BYTES = 1 << 33  # of a file in a package

#: Key in `Reading.lasting` of the time and size of each image file that was read, by path.
FILES = ("files",)


def read_image(reading: Reading, prim: Usd.Prim, name: str, space: str = "auto") -> Array | None:
    """Return the image of light that an asset attribute names, (H, W, C) float32; None if it names none.

    The first row is on top. Pixels below 0 become 0, with a warning: filters that sharpen leave some.

    Parameters
    ----------
    space
        A colour space, "raw" (unchanged), or "auto": sRGB for 8-bit images of three or four channels, as UsdUVTexture
        defines it. The attribute's own `colorSpace` overrides "auto".

    Raises
    ------
    SceneError
        The image does not exist or cannot be decoded.
    """
    # Images of lights surround the scene or are projected large, so they have twice the limit.
    pixels, problem = find_image(reading, prim, name, space, 2 * texture_limit(reading.stage))
    if problem:
        raise reading.missing(prim, name, problem)
    if pixels is not None and (least := np.min(rgb(pixels), initial=0)) < 0:
        reading.warn(prim, f"has a pixel of {least:g}: expected 0 or more; 0 is used", name)
        return np.maximum(pixels, 0)
    return pixels


def find_image(
    reading: Reading, prim: Usd.Prim, name: str, space: str = "auto", limit: int | None = None
) -> tuple[Array | None, str]:
    """Return the image as `read_image` does and "", or None and an error: "names …: expected …"."""
    asset = reading.value(prim, name)
    if asset is not None and not isinstance(asset, Sdf.AssetPath | str):
        return None, f"is {asset}: expected an asset, @image@"
    asset = Sdf.AssetPath(asset) if isinstance(asset, str) else asset
    if asset is None or not asset.path:
        return None, ""
    path = resolved(reading, asset)
    if not path:
        return None, f"names {asset.path}: expected an image file, but there is none"
    known = known_space(reading, prim, name, space)
    return image_at(reading, prim, name, path, known, limit)


def known_space(reading: Reading, prim: Usd.Prim, name: str, space: str = "auto") -> str:
    """Return OpenUSD's name of a colour space, AUTO or RAW; for an unknown one AUTO, with a warning."""
    attribute = prim.GetAttribute(name)
    if color_space(space) == AUTO and attribute and attribute.HasColorSpace():
        space = str(attribute.GetColorSpace())
    known = color_space(space)
    if known is None:
        reading.warn(prim, f"has the colour space '{space}': expected one that OpenUSD knows; auto is used", name)
    return known or AUTO


def image_at(
    reading: Reading, prim: Usd.Prim, name: str, path: str, space: str, limit: int | None = None
) -> tuple[Array | None, str]:
    """Return the image in a file and "", or None and an error; an image beyond the limit is scaled down."""
    most = limit or texture_limit(reading.stage)
    key = ("image", path, space, most)
    if key not in reading.cache:
        problem = why_unreadable(Ar.SplitPackageRelativePathOuter(path)[0])
        written = None if problem else stamp(path)
        found = Decoded(None, error=problem) if written is None else _image(path, written, space, most, reading.spaces)
        if found.pixels is None:
            why, shown = found.error.replace(f" ({path})", ""), path if len(path) <= 60 else f"…{path[-60:]}"
            return None, f"names {shown}: expected an image that can be read ({why})"
        if not np.all(np.isfinite(found.pixels)):
            return None, f"names {path}: expected pixels that are finite numbers"
        for text in found.warnings:
            reading.warn(prim, f"names an image with several pictures: {text}", name)
        height, width = found.pixels.shape[:2]
        if (width, height) != (found.width, found.height):
            text = f"names {Path(path).name} of {found.width} x {found.height} pixels: it is scaled down to"
            reading.warn(prim, f"{text} {width} x {height}, as the texture limit is {most}", name)
        reading.cache[key] = found.pixels
        reading.lasting.setdefault(FILES, {})[path] = written
    return reading.cache[key], ""


def texture_limit(stage: Usd.Stage) -> int:
    """Return the stage's limit on textures, in pixels a side."""
    limit = kept(stage, "textureLimit")
    return TEXTURE_LIMIT if limit is None else int(limit)


def asset_content(path: str, most: int = _MOST_BYTES) -> bytes:
    """Return the bytes of an asset's file, which may be in a package.

    Raises
    ------
    SceneError
        A file that cannot be read, or has more than `most` bytes; the message is a clause about it.
    """
    if not Ar.IsPackageRelativePath(path):
        return content(path, most)
    if problem := why_unreadable(Ar.SplitPackageRelativePathOuter(path)[0]):
        raise SceneError(problem)
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        raise SceneError("it is not in the package")
    check_size(asset.GetSize(), most, "it")
    return bytes(asset.GetBuffer())


def stamp(path: str) -> tuple[int, int]:
    """Return a value that changes when a file is written again: its time and size."""
    status = Path(Ar.SplitPackageRelativePathOuter(path)[0]).stat()
    return status.st_mtime_ns, status.st_size


# A shutter is read at many times: images are decoded once, and are then the same objects.
@lru_cache(maxsize=64)
def _image(path: str, _stamp: tuple[int, int], space: str, limit: int, spaces: ColorSpaces) -> Decoded:
    """Return a file's image in the working space, or the decoder's error."""
    linearize = partial(_linear, space=space, spaces=spaces)
    if not Ar.IsPackageRelativePath(path):
        return decoded(path, linearize, limit)
    # OpenImageIO reads only files, so images in a .usdz are unpacked for it.
    suffix = Path(Ar.SplitPackageRelativePathInner(path)[1]).suffix
    with temporary_folder("texture") as folder:
        file = Path(folder) / f"image{suffix}"
        try:
            write_bytes(file, asset_content(path))
        except SceneError as error:
            return Decoded(None, error=str(error))
        return decoded(str(file), linearize, limit)


def _linear(pixels: Array, kind: str, space: str, spaces: ColorSpaces) -> Array:
    """Convert stored pixels from a colour space to the working space."""
    if space == AUTO:
        space = SRGB if is_encoded(kind, pixels.shape[2]) else LINEAR
    if space == SRGB:
        pixels, space = linear(pixels, kind), REC709
    given = rgb(pixels)
    found = to_working(given, space, spaces)
    if found is given:
        return pixels
    colors = found.astype(np.float32)
    return np.concatenate([colors, pixels[..., -1:]], axis=2) if pixels.shape[2] in (2, 4) else colors


def resolved(reading: Reading, asset: Sdf.AssetPath) -> str:
    """Return the path of an asset's file, or "" if there is none.

    An asset that was given in the session (`--set`) is relative to the stage's own file.
    """
    if asset.resolvedPath:
        return str(asset.resolvedPath)
    anchored = Ar.GetResolver().CreateIdentifier(asset.path, Ar.ResolvedPath(reading.stage.GetRootLayer().realPath))
    return str(Ar.GetResolver().Resolve(anchored))
