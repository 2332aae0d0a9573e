"""Pictures for notebooks: the PNG that `writing.write_png` writes, scaled down if the file would be large."""

from __future__ import annotations

import numpy as np
import OpenImageIO

from ..scene import Array
from .writing import png_of

# A notebook stores pictures as text: a few large ones make it slow to open and to compare.
MOST_BYTES = 1_000_000
MOST_PIXELS = 1 << 21  # about 1920 x 1080


def preview(*eyes: Array) -> bytes:
    """Return scene-linear colours (H, W, 3 or 4) as a PNG of at most `MOST_BYTES`.

    Several eyes are shown side by side, the first on the left. Up to `MOST_PIXELS` and `MOST_BYTES` the PNG is, to the
    byte, the file that `write_png` writes; larger pictures are scaled down, and look like a smaller render.

    Raises
    ------
    ValueError
        Eyes of different heights.
    """
    scale = min(1.0, (MOST_PIXELS / sum(np.shape(each)[0] * np.shape(each)[1] for each in eyes)) ** 0.5)
    while len(data := png_of(*(_smaller(each, scale) for each in eyes))) > MOST_BYTES:
        scale *= min(0.9, (MOST_BYTES / len(data)) ** 0.5)
    return data


def _smaller(pixels: Array, scale: float) -> Array:
    """Return a scene-linear picture scaled by up to 1; each pixel is the mean of those that it covers."""
    if scale == 1.0:
        return pixels
    height, width = (max(1, round(scale * count)) for count in np.shape(pixels)[:2])
    # One infinite pixel or NaN would spoil its neighbours.
    finite = np.nan_to_num(np.asarray(pixels, dtype=np.float32)[..., :3], nan=0.0, posinf=1e30, neginf=0.0)
    source = OpenImageIO.ImageBuf(np.ascontiguousarray(finite))
    region = OpenImageIO.ROI(0, width, 0, height, 0, 1, 0, 3)
    made = OpenImageIO.ImageBufAlgo.resize(source, filtername="box", roi=region)
    return np.asarray(made.get_pixels(OpenImageIO.FLOAT))
