"""A session's pictures for a browser: PNG if they are finished, JPEG if better ones will follow."""

from __future__ import annotations

from io import BytesIO
from typing import NamedTuple

import numpy as np
from PIL import Image

from ..images.anaglyph import anaglyph
from ..images.view_transforms import OWN, viewed
from ..scene import Array
from ..usd.cameras.stereo import EYES
from .session import Picture

#: Ways to show both eyes: in one picture for red and cyan glasses, and beside each other at half the size.
ANAGLYPH, BESIDE = "anaglyph", "side-by-side"
#: All ways to show two eyes.
SHOWN = (ANAGLYPH, BESIDE, *EYES)


class EncodedPicture(NamedTuple):
    """A picture for a browser.

    Attributes
    ----------
    data, mime
        The file's bytes, and their MIME type.
    layer
        The layer that is shown.
    width, height
        Pixels.
    """

    data: bytes
    mime: str
    layer: str
    width: int
    height: int


def encoded(
    picture: Picture, layer: str = "rgba", exposure: float = 0.0, display: str = OWN, eye: str = EYES[0]
) -> EncodedPicture:
    """Return a layer of a picture, or `rgba` if it has no such layer, at an exposure in stops, by a view transform.

    If the picture has two eyes, `eye` chooses one, or both in one picture of the same size: `ANAGLYPH`, `BESIDE`.

    Raises
    ------
    SceneError
        `display` is no view transform.
    """
    layer = layer if layer in picture.layers else "rgba"
    if picture.views and eye in (ANAGLYPH, BESIDE):
        both = [_viewed(picture.views[each][layer], display, exposure) for each in EYES]
        shown = anaglyph(*both) if eye == ANAGLYPH else beside(*both)
    else:
        shown = _viewed(picture.views.get(eye, picture.layers)[layer], display, exposure)
    data = BytesIO()
    if picture.is_finished:
        Image.fromarray(shown).save(data, "PNG", compress_level=1)
    else:  # a better one replaces it soon, so that losses do not matter
        Image.fromarray(shown).save(data, "JPEG", quality=92, subsampling=0)
    mime = "image/png" if picture.is_finished else "image/jpeg"
    return EncodedPicture(data.getvalue(), mime, layer, shown.shape[1], shown.shape[0])


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


def _viewed(pixels: Array, display: str, exposure: float) -> Array:
    """Return a layer as a screen shows it, (H, W, 3) of 8 bits."""
    if pixels.ndim == 2 or pixels.shape[2] == 1:
        pixels = pixels.reshape(*pixels.shape[:2], 1).repeat(3, axis=2)
    return viewed(pixels, display, exposure)
