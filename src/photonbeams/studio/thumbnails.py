"""Thumbnails of presets, made by the renderer."""

from __future__ import annotations

from functools import cache
from io import BytesIO

import numpy as np
from PIL import Image

from ..images.swatches import thumbnail
from ..usd.authoring.presets import preset_look, preset_of
from ..usd.looks.shading import build_look

_WIDTH, _HEIGHT = 144, 60


@cache
def thumbnail_of(name: str) -> bytes:
    """Return a preset's thumbnail as a PNG; SceneError if no preset has this name."""
    pixels = thumbnail(build_look(preset_look(name)), preset_of(name).factor, _WIDTH, _HEIGHT)
    data = BytesIO()
    Image.fromarray((255 * np.clip(pixels, 0, 1) + 0.5).astype(np.uint8)).save(data, "PNG")
    return data.getvalue()
