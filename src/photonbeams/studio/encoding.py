"""Pictures for a browser: a session's, PNG if they are finished and JPEG if not, and thumbnails of presets."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from PIL import Image

from ..images.display import OWN, anaglyph, viewed
from ..images.swatches import thumbnail
from ..scene import Array, rgb
from ..usd.authoring.presets import Preset, look_of
from ..usd.cameras.stereo import EYES
from ..usd.looks.shading import build_look
from .pictures import Picture
from .protocol import PictureHeader

#: Ways to show both eyes: in one picture for red and cyan glasses, and beside each other at half the size.
ANAGLYPH, BESIDE = "anaglyph", "side-by-side"
#: All ways to show two eyes.
SHOWN = (ANAGLYPH, BESIDE, *EYES)

_THUMBNAIL = 144, 60  # pixels
_THUMBNAILS: dict[str, bytes] = {}  # by presets, as text


def encoded(
    picture: Picture, layer: str = "rgba", exposure: float = 0.0, display: str = OWN, eye: str = EYES[0]
) -> tuple[PictureHeader, bytes]:
    """Return a layer of a picture, or `rgba` if it has no such layer, at an exposure in stops, by a view transform.

    If the picture has two eyes, `eye` chooses one, or both in one picture of the same size: `ANAGLYPH`, `BESIDE`.
    """
    layer = layer if layer in picture.layers else "rgba"
    if picture.views and eye in (ANAGLYPH, BESIDE):
        both = [_viewed(picture, picture.views[each][layer], exposure, display) for each in EYES]
        shown = anaglyph(*both) if eye == ANAGLYPH else beside(*both)
    else:
        shown = _viewed(picture, picture.views.get(eye, picture.layers)[layer], exposure, display)
    data, kind = BytesIO(), "png" if picture.is_finished else "jpeg"  # what is replaced soon may have losses
    options: dict[str, int] = {"compress_level": 1} if picture.is_finished else {"quality": 92, "subsampling": 0}
    Image.fromarray(shown).save(data, kind, **options)
    height, width = shown.shape[:2]
    header = PictureHeader(
        version=picture.version,
        passes=picture.passes,
        planned=picture.planned,
        layer=layer,
        width=width,
        height=height,
        scale=picture.scale,
        mime=f"image/{kind}",
        frame=picture.frame,
    )
    return header, data.getvalue()


def beside(left: Array, right: Array) -> Array:
    """Return two pictures (H, W, 3) beside each other at half the size, centred in a picture of the same size."""
    height, width = left.shape[:2]
    half = max(1, width // 2), max(1, height // 2)
    result = np.zeros_like(left)
    top = (height - half[1]) // 2
    for number, each in enumerate((left, right)):
        begin = number * (width - half[0])
        small = Image.fromarray(each).resize(half, Image.Resampling.BOX)
        result[top : top + half[1], begin : begin + half[0]] = np.asarray(small)
    return result


def _viewed(picture: Picture, pixels: Array, exposure: float, display: str) -> Array:
    """Return a layer as a screen shows it, (H, W, 3) of 8 bits."""
    return viewed(rgb(np.atleast_3d(pixels)), display, exposure, picture.space)


def thumbnail_of(preset: Preset) -> bytes:
    """Return a preset's thumbnail, made by the renderer, as a PNG; it is made once."""
    key = repr(preset)
    if key not in _THUMBNAILS:
        pixels = thumbnail(build_look(look_of(preset)), preset.factor, *_THUMBNAIL)
        data = BytesIO()
        Image.fromarray((255 * np.clip(pixels, 0, 1) + 0.5).astype(np.uint8)).save(data, "PNG")
        _THUMBNAILS[key] = data.getvalue()
    return _THUMBNAILS[key]
