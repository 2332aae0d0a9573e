"""Image files of stages as scene-linear pixels; their paths resolved by the stage's asset resolver."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
from pxr import Ar, Sdf, Usd

from ..images.textures import decoded, linear
from ..scene import Array
from .reading import Reading


def read_image(reading: Reading, prim: Usd.Prim, name: str, color_space: str = "auto") -> Array | None:
    """Return the image that an asset attribute names, (H, W, C) float32, first row on top; None where it names none.

    Parameters
    ----------
    color_space
        "sRGB", "raw" (as it is), or "auto": sRGB for 8-bit images of three or four channels, as UsdUVTexture has it.

    Raises
    ------
    SceneError
        An image that is not there or cannot be decoded.
    """
    asset = reading.value(prim, name)
    if asset is not None and not isinstance(asset, Sdf.AssetPath):
        raise reading.fail(prim, name, f"is {asset}: expected an asset, @image@")
    if asset is None or not asset.path:
        return None
    path = resolved(reading, asset)
    if not path:
        raise reading.fail(prim, name, f"names {asset.path}: expected an image file, there is none")
    key = ("image", path, color_space)
    if key not in reading.cache:
        pixels, error = _pixels(path, stamp(path), color_space)
        if pixels is None:
            raise reading.fail(prim, name, f"names {path}: expected an image that can be read ({error})")
        if not np.all(np.isfinite(pixels)):
            raise reading.fail(prim, name, f"names {path}: expected pixels that are finite numbers")
        reading.cache[key] = pixels
    return reading.cache[key]


def stamp(path: str) -> tuple[int, int]:
    """Return a stamp of a file that changes when it is written again."""
    status = Path(Ar.SplitPackageRelativePathOuter(path)[0]).stat()
    return status.st_mtime_ns, status.st_size


# A shutter is read at many times: the images are then the same objects, decoded once.
@lru_cache(maxsize=64)
def _pixels(path: str, _stamp: tuple[int, int], color_space: str) -> tuple[Array | None, str]:
    """Return an image's linear pixels, or None and the decoder's complaint."""
    pixels, kind, error = _decoded(path)
    return (None if pixels is None else linear(pixels, kind, color_space)), error


def resolved(reading: Reading, asset: Sdf.AssetPath) -> str:
    """Return an asset's path, "" where there is no such file.

    One that was given in the session (`--set`) is relative to the stage's own file.
    """
    if asset.resolvedPath:
        return str(asset.resolvedPath)
    anchored = Ar.GetResolver().CreateIdentifier(asset.path, Ar.ResolvedPath(reading.stage.GetRootLayer().realPath))
    return str(Ar.GetResolver().Resolve(anchored))


def _decoded(path: str) -> tuple[Array | None, str, str]:
    """Return pixels, the type they are stored in, and the decoder's complaint if there are none."""
    if not Ar.IsPackageRelativePath(path):
        return decoded(path)
    # OpenImageIO reads files: what lies in a .usdz is unpacked for it.
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        return None, "", "it is not in the package"
    suffix = Path(Ar.SplitPackageRelativePathInner(path)[1]).suffix
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"image{suffix}"
        file.write_bytes(bytes(asset.GetBuffer()))
        return decoded(str(file))
