"""View transforms, which turn scene-linear pictures into those of a screen: our own and OpenColorIO's."""

from __future__ import annotations

import logging
import os
from functools import cache

import numpy as np
import OpenImageIO

from ..scene import Array, SceneError
from .display import dithered, srgb_encoded, tone_mapped

_log = logging.getLogger("photonbeams")

#: The name of our own view transform, which PNGs have.
OWN = "photonbeams"

_DEFAULT = "ocio://default"  # OpenColorIO's built-in configuration
_SCREEN = "sRGB - Display"  # its display for most screens
_LINEAR = "lin_rec709_scene"  # the colour space of pictures


def view_transforms() -> list[str]:
    """Return the names of the view transforms: ours, and those of the user's OpenColorIO configuration ($OCIO).

    Of the built-in configuration, only those for sRGB screens are listed.
    """
    return [OWN, *_views()]


def viewed(pixels: Array, name: str = OWN, exposure: float = 0.0) -> Array:
    """Return a scene-linear picture, (H, W, 3 or more), as a screen shows it, (H, W, 3) of 8 bits.

    Raises
    ------
    SceneError
        A name that is no view transform.
    """
    if name == OWN:
        return dithered(srgb_encoded(tone_mapped(np.asarray(pixels)[..., :3], exposure)))
    if name not in _views():
        raise SceneError(f"there is no view transform {name!r}: expected one of {', '.join(view_transforms())}")
    display, view = _views()[name]
    scaled = np.nan_to_num(np.asarray(pixels, dtype=np.float32)[..., :3] * np.float32(2.0**exposure), posinf=6e4)
    source = OpenImageIO.ImageBuf(np.ascontiguousarray(scaled))
    shown = OpenImageIO.ImageBufAlgo.ociodisplay(source, display, view, _LINEAR, colorconfig=_config())
    if shown.has_error:
        raise SceneError(f"the view transform {name!r} cannot be used: {shown.geterror()}"[:300])
    return dithered(np.clip(np.asarray(shown.get_pixels(OpenImageIO.FLOAT)), 0, 1))


def _config() -> str:
    return os.environ.get("OCIO") or _DEFAULT


@cache
def _views() -> dict[str, tuple[str, str]]:
    """Return OpenColorIO's displays and views by the names that users see."""
    config = OpenImageIO.ColorConfig(_config())
    if problem := config.geterror():
        _log.warning("OCIO=%s cannot be used: %s; only photonbeams' own view is available", _config(), problem)
        return {}
    own = _config() != _DEFAULT
    displays = [each for each in config.getDisplayNames() if own or each == _SCREEN]
    return {
        f"{display}, {view}" if own and len(displays) > 1 else str(view): (display, view)
        for display in displays
        for view in config.getViewNames(display)
    }
