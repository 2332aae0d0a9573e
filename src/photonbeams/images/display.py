"""From scene-linear light to the 8 bits of a display: tone mapping, the sRGB curve, dithering."""

from __future__ import annotations

import numpy as np

from ..scene import Array

SHOULDER = 0.5  # scene-linear value up to which `tone_mapped` changes nothing
WHITENING = 0.15  # how fast the shoulder turns bright colours white; the value of Khronos' PBR Neutral


# The fraction of lit pixels that should be below the shoulder: the rest are lamps and their surroundings.
_JUDGED = 0.95


def exposure_of(pixels: Array) -> float:
    """Return the exposure in stops, to a tenth, at which 95 % of a picture's lit pixels are below the shoulder.

    Alpha does not count. The exposure of a black picture is 0.
    """
    peak = np.asarray(pixels, dtype=np.float64)[..., :3].max(axis=-1)
    lit = peak[np.isfinite(peak) & (peak > 0)]
    if not lit.size:
        return 0.0
    return round(float(np.clip(np.log2(SHOULDER / np.quantile(lit, _JUDGED)), -100, 100)), 1)


def tone_mapped(pixels: Array, exposure: float = 0.0) -> Array:
    """Return scene-linear colours as display-linear ones in [0, 1]: the view transform of PNGs.

    Colours whose largest channel m is below 0.5 do not change, so that fog and shadows are shown as computed. Above
    that, m follows a hyperbola towards 1, without a kink, and the colour is scaled by the same factor: no channel
    clips alone, and the hue stays. As m grows, the colour is mixed with white, as film and the eye see very bright
    light. This is the shoulder of Khronos' PBR Neutral, but it begins lower, because the light around a lamp in fog
    spans many stops; and it lacks the toe, which would darken thin fog. Negative values and NaN become 0.
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
    """Return linear values in [0, 1] encoded by the sRGB transfer function (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_decoded(encoded: Array) -> Array:
    """Return the linear values of sRGB-encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def is_encoded(kind: str, channels: int) -> bool:
    """Return whether an image file's colours are sRGB rather than linear, by the rule of UsdUVTexture's "auto".

    They are sRGB if `kind`, the type in which they are stored, has 8 bits, and there are three channels or more.
    """
    return kind == "uint8" and channels >= 3


def dithered(picture: Array) -> Array:
    """Return values in [0, 1], (H, W, C), as 8 bits, rounded up or down by a fixed pattern so that fog has no bands.

    The pattern is interleaved gradient noise (Jimenez 2014), shifted for each channel: it is even over small groups of
    neighbours, and the same in each frame. On average values are kept; 0 and 1 stay exact.
    """
    height, width, channels = picture.shape
    y, x, c = np.ogrid[:height, :width, :channels]
    pattern = np.modf(52.9829189 * np.modf(0.06711056 * (x + 47 * c) + 0.00583715 * (y + 17 * c))[0])[0]
    return np.clip(np.floor(picture * 255.0 + pattern), 0, 255).astype(np.uint8)
