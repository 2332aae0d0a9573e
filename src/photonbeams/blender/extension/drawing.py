"""Pictures in a viewport, drawn by the graphics card."""

from __future__ import annotations

from typing import Any

import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d


def upwards(layer: Any, channels: int, opaque: bool = False) -> Any:
    """Return a layer as Blender has it: (H, W, channels) from the bottom row up, with an alpha of 1 if it is opaque."""
    pixels = np.array(layer.reshape(*layer.shape[:2], -1)[::-1, :, :channels], np.float32)
    if opaque:
        pixels[..., 3] = 1.0
    return pixels


class Drawing:
    """The texture of the last picture."""

    def __init__(self) -> None:
        self._picture: Any = None
        self._texture: Any = None

    def draw(self, picture: Any, size: tuple[int, int], transparent: bool) -> None:
        """Draw a picture, (H, W, 4) of linear light from the top row down, over a region of this size."""
        if picture is not self._picture or self._texture is None:
            self._picture = picture
            height, width = picture.shape[:2]
            pixels = upwards(picture, 4, opaque=not transparent)
            data = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel())
            self._texture = gpu.types.GPUTexture((width, height), format="RGBA16F", data=data)
        gpu.state.blend_set("ALPHA_PREMULT")
        draw_texture_2d(self._texture, (0, 0), *size)
        gpu.state.blend_set("NONE")
