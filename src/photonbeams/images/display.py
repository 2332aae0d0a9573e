"""From scene-linear light to the 8 bits of a display: tone mapping, the sRGB curve, dithering."""

from __future__ import annotations

import numpy as np

from ..scene import Array

SHOULDER = 0.5  # scene-linear value up to which `tone_mapped` changes nothing
WHITENING = 0.15  # how fast the shoulder turns bright colours white; the value of Khronos' PBR Neutral


# Of the lit pixels, which part is to be darker than white's shoulder: the rest are lamps and what is close to them.
_JUDGED = 0.95


def exposure_of(pixels: Array) -> float:
    """Return the exposure in stops, to a tenth, at which nearly all of a picture is below the shoulder.

    Alpha and pixels without light do not count; of a black picture it is 0.
    """
    peak = np.asarray(pixels, dtype=np.float64)[..., :3].max(axis=-1)
    lit = peak[np.isfinite(peak) & (peak > 0)]
    if not lit.size:
        return 0.0
    return round(float(np.clip(np.log2(SHOULDER / np.quantile(lit, _JUDGED)), -100, 100)), 1)


def tone_mapped(pixels: Array, exposure: float = 0.0) -> Array:
    """Return display-linear colours in [0, 1] of scene-linear ones: the view that PNGs are made with.

    Colours whose largest channel m is below 0.5 stay as they are, so that fog and shadows are what was computed. Above
    that, m goes through a hyperbola to 1, with no kink, and its colour is scaled by the same factor, so that no channel
    clips alone and hue holds; as m grows, the colour is mixed with white, as film and the eye see what is very bright.
    This is the shoulder of Khronos' PBR Neutral, begun lower, since a lamp's neighbourhood in fog spans many stops,
    and without its toe, which would darken thin fog. Negative values and NaN become 0.
    """
    light = np.asarray(pixels, dtype=np.float64) * 2.0**exposure
    light = np.nan_to_num(np.maximum(light, 0.0), nan=0.0, posinf=1e30)
    peak = light.max(axis=-1, keepdims=True)
    room = 1.0 - SHOULDER
    above = np.maximum(peak, SHOULDER)
    target = 1.0 - room**2 / (above + room - SHOULDER)
    white = 1.0 - 1.0 / (WHITENING * (above - target) + 1.0)
    colour = light * (target / above)
    return np.where(peak > SHOULDER, colour + (target - colour) * white, light)


def srgb_encoded(linear: Array) -> Array:
    """Return linear values in [0, 1] as the sRGB transfer function encodes them (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_decoded(encoded: Array) -> Array:
    """Return the linear values of sRGB-encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def is_encoded(kind: str, channels: int) -> bool:
    """Return whether an image file's colours are to be taken as sRGB, as UsdUVTexture's "auto" has it; else as linear.

    They are where `kind`, the type that they are stored in, is of 8 bits, and there are three channels or more.
    """
    return kind == "uint8" and channels >= 3


def dithered(picture: Array) -> Array:
    """Return values in [0, 1], (H, W, C), as 8 bit, rounded up or down by a fixed pattern so that fog does not band.

    The pattern is interleaved gradient noise (Jimenez 2014), shifted for each channel: evenly spread over any few
    neighbours, and the same for each frame. On the average a pixel keeps its value; 0 and 1 stay exact.
    """
    height, width, channels = picture.shape
    y, x, c = np.ogrid[:height, :width, :channels]
    pattern = np.modf(52.9829189 * np.modf(0.06711056 * (x + 47 * c) + 0.00583715 * (y + 17 * c))[0])[0]
    return np.clip(np.floor(picture * 255.0 + pattern), 0, 255).astype(np.uint8)
