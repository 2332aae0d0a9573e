"""Anaglyphs: the pictures of two eyes in one, for glasses with a red filter on the left and a cyan one on the right.

The matrices are Eric Dubois' ("A projection method to generate anaglyph stereo images", ICASSP 2001). They bring what
each eye sees through its filter as close as possible to the two pictures. They are for linear light.
"""

from __future__ import annotations

import numpy as np

from ..scene import Array, SceneError
from .display import srgb_decoded, srgb_encoded

# For sRGB screens and gelatin filters, with the digits that other programs use.
_LEFT = np.array([[0.456, 0.500, 0.176], [-0.040, -0.038, -0.016], [-0.015, -0.021, -0.005]], dtype=np.float32)
_RIGHT = np.array([[-0.043, -0.088, -0.002], [0.378, 0.734, -0.018], [-0.072, -0.113, 1.226]], dtype=np.float32)
_LINEAR = srgb_decoded(np.arange(256) / 255).astype(np.float32)
_STEPS = 4095
_ENCODED = np.round(255 * srgb_encoded(np.arange(_STEPS + 1) / _STEPS)).astype(np.uint8)


def anaglyph(left: Array, right: Array) -> Array:
    """Return the anaglyph of two pictures; all three are (H, W, 3) of 8 bits, as a screen shows them.

    Raises
    ------
    SceneError
        Pictures of different sizes.
    """
    if left.shape != right.shape:
        raise SceneError(f"the left eye's picture is {left.shape} and the right one's {right.shape}: expected one size")
    mixed = _LINEAR[left] @ _LEFT.T + _LINEAR[right] @ _RIGHT.T
    shown: Array = _ENCODED[np.clip(np.rint(_STEPS * mixed), 0, _STEPS).astype(np.int32)]
    return shown
