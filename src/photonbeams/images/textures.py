"""Images as textures: decoded by OpenImageIO, scene-linear."""

from __future__ import annotations

from typing import Any

import numpy as np
import OpenImageIO

from ..scene import Array
from .display import is_encoded, srgb_decoded
from .files import reason


def decoded(path: str) -> tuple[Array | None, str, str]:
    """Return pixels (H, W, C), the type they are stored in, and the decoder's complaint if there are none."""
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # the colour where alpha is 0 is still the surface's colour
    file: Any = OpenImageIO.ImageInput.open(path, config)
    if not file:
        return None, "", reason(OpenImageIO.geterror())
    kind = str(file.spec().format)
    pixels = file.read_image("float")
    error = file.geterror()
    file.close()
    if pixels is None or not np.size(pixels):
        return None, kind, reason(error)
    return np.asarray(pixels, dtype=np.float32).reshape(*np.shape(pixels)[:2], -1), kind, ""


def linear(pixels: Array, kind: str, color_space: str) -> Array:
    """Return stored pixels as scene-linear ones; `color_space` is "sRGB", "raw" or "auto", by how they are stored."""
    channels = pixels.shape[2]
    if not (color_space == "sRGB" or (color_space == "auto" and is_encoded(kind, channels))):
        return pixels
    result = pixels.copy()
    count = channels if channels not in (2, 4) else channels - 1  # alpha is never encoded
    result[..., :count] = srgb_decoded(result[..., :count])
    return result
