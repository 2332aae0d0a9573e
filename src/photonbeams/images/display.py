"""From scene-linear light to the 8 bits of a display: tone mapping, the sRGB curve, dithering, view transforms."""

from __future__ import annotations

import logging
from functools import cache

import numpy as np
import OpenImageIO

from ..scene import Array, SceneError
from .color_spaces import BUILT_IN, REC709, config_name, converted

LOG = logging.getLogger("photonbeams")

SHOULDER = 0.5  # scene-linear value up to which `tone_mapped` changes nothing
WHITENING = 0.15  # how fast the shoulder turns bright colours white; the value of Khronos' PBR Neutral

#: The name of our own view transform, which PNGs have.
OWN = "photonbeams"

_SCREEN = "sRGB - Display"  # the built-in configuration's display for most screens

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


#: The linear values of sRGB's 256 steps: a power for each pixel would take a hundred times as long.
DECODED = srgb_decoded(np.arange(256) / 255).astype(np.float32)


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


# -- view transforms ------------------------------------------------------------------------------------------------


def view_transforms() -> list[str]:
    """Return the names of the view transforms: ours, and those of the user's OpenColorIO configuration ($OCIO).

    Of the built-in configuration, only those for sRGB screens are listed.
    """
    return [OWN, *_views()]


def viewed(pixels: Array, name: str = OWN, exposure: float = 0.0, space: str = REC709) -> Array:
    """Return a picture of a linear `space`, (H, W, 3 or more), as a screen shows it, (H, W, 3) of 8 bits."""
    light = converted(np.asarray(pixels)[..., :3], space)
    if name == OWN:
        return dithered(srgb_encoded(tone_mapped(light, exposure)))
    if name not in _views():
        raise SceneError(f"there is no view transform {name!r}: expected one of {', '.join(view_transforms())}")
    display, view = _views()[name]
    scaled = np.nan_to_num(np.asarray(light, dtype=np.float32) * np.float32(2.0**exposure), posinf=6e4)
    source = OpenImageIO.ImageBuf(np.ascontiguousarray(scaled))
    shown = OpenImageIO.ImageBufAlgo.ociodisplay(source, display, view, REC709, colorconfig=config_name())
    if shown.has_error:
        raise SceneError(f"the view transform {name!r} cannot be used: {shown.geterror()}"[:300])
    return dithered(np.clip(np.asarray(shown.get_pixels(OpenImageIO.FLOAT)), 0, 1))


@cache
def _views() -> dict[str, tuple[str, str]]:
    """Return OpenColorIO's displays and views by the names that users see."""
    config = OpenImageIO.ColorConfig(config_name())
    if problem := config.geterror():
        LOG.warning("OCIO=%s cannot be used: %s; only photonbeams' own view is available", config_name(), problem)
        return {}
    own = config_name() != BUILT_IN
    displays = [each for each in config.getDisplayNames() if own or each == _SCREEN]
    return {
        f"{display}, {view}" if own and len(displays) > 1 else str(view): (display, view)
        for display in displays
        for view in config.getViewNames(display)
    }


# -- two eyes -------------------------------------------------------------------------------------------------------

# Eric Dubois' matrices ("A projection method to generate anaglyph stereo images", ICASSP 2001), for linear light, sRGB
# screens and gelatin filters, with the digits that other programs use: they bring what each eye sees through its filter
# as close as possible to the two pictures.
_LEFT = np.array([[0.456, 0.500, 0.176], [-0.040, -0.038, -0.016], [-0.015, -0.021, -0.005]], dtype=np.float32)
_RIGHT = np.array([[-0.043, -0.088, -0.002], [0.378, 0.734, -0.018], [-0.072, -0.113, 1.226]], dtype=np.float32)
_STEPS = 4095
_ENCODED = np.round(255 * srgb_encoded(np.arange(_STEPS + 1) / _STEPS)).astype(np.uint8)


def anaglyph(left: Array, right: Array) -> Array:
    """Return two eyes' pictures in one, for glasses with a red filter on the left and a cyan one on the right.

    All three are (H, W, 3) of 8 bits, as a screen shows them.
    """
    if left.shape != right.shape:
        raise SceneError(f"the left eye's picture is {left.shape} and the right one's {right.shape}: expected one size")
    mixed = DECODED[left] @ _LEFT.T + DECODED[right] @ _RIGHT.T
    shown: Array = _ENCODED[np.clip(np.rint(_STEPS * mixed), 0, _STEPS).astype(np.int32)]
    return shown
