"""Colour spaces of a stage: the one in which light is computed, and those in which values and images are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...images.color_spaces import REC709, ColorSpaces, converted, named, plain, working_space
from ...scene import Array, SceneError
from .openusd import Gf, Usd
from .selection import kept, settings_at

AUTO, RAW = "auto", "raw"
#: Without a curve, in the space of colours that name none.
LINEAR = "linear"
SRGB = "srgb_rec709_scene"

_WORDS = {
    **dict.fromkeys(("", "auto", "usemetadata"), AUTO),
    **dict.fromkeys(("raw", "none", "data", "noncolor", "identity", "utilityraw", "unknown"), RAW),
    **dict.fromkeys(("linear", "scenelinear"), LINEAR),
    **dict.fromkeys(("gamma24", "g24rec709", "g24rec709scene"), "g24_rec709_scene"),  # as OpenUSD calls it
}


def spaces_of(stage: Usd.Stage, warn: Callable[[Usd.Prim, str, str], None] | None = None) -> ColorSpaces:
    """Return the spaces of the user, which are kept in a stage's session layer, or else of its render settings."""
    untagged = kept(stage, "colorSpace") or REC709
    if working := kept(stage, "workingSpace"):
        return ColorSpaces(working, untagged)
    attribute = _rendering_space(stage)
    if attribute is None:
        return ColorSpaces(untagged=untagged)
    try:
        return ColorSpaces(working_space(str(attribute.Get())), untagged)
    except SceneError as error:
        if warn:
            warn(attribute.GetPrim(), f"{error}; linear Rec. 709 is used", attribute.GetName())
        return ColorSpaces(untagged=untagged)


def _rendering_space(stage: Usd.Stage) -> Usd.Attribute | None:
    """Return the attribute of the render settings in use that names the working space, if it has a value."""
    settings = settings_at(stage, kept(stage, "renderSettings"))
    attribute = settings.GetRenderingColorSpaceAttr() if settings else None
    return attribute if attribute and attribute.Get() else None


def source_space(attribute: Usd.Attribute) -> str:
    """Return the name of the space that an attribute, its prim or a prim above names; "" if none does."""
    if attribute.HasColorSpace():
        return str(attribute.GetColorSpace())
    return str(Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None))


def color_space(name: str) -> str | None:
    """Return OpenUSD's or OpenColorIO's name of a colour space, or AUTO, RAW or LINEAR; None if it is not known."""
    return _WORDS.get(plain(name)) or named(name) or (name if Gf.ColorSpace.IsValid(name) else None)


def to_working(colors: Any, space: str, spaces: ColorSpaces) -> Any:
    """Convert colours (…, 3) from a space that `color_space` returned to the working space."""
    space = spaces.untagged if space in (AUTO, LINEAR) else space
    if space in (RAW, spaces.working):
        return colors
    if not (Gf.ColorSpace.IsValid(space) and Gf.ColorSpace.IsValid(spaces.working)):
        return converted(colors, space, spaces.working)
    known, working = Gf.ColorSpace(space), Gf.ColorSpace(spaces.working)
    light = _decoded(np.asarray(colors, dtype=np.float64), known)
    # Every transfer function keeps black and white, so the converted primaries are the columns of the matrix.
    columns = [working.Convert(known, Gf.Vec3f(*axis)).GetRGB() for axis in np.eye(3).tolist()]
    return light @ np.array(columns, dtype=np.float64)


def _decoded(colors: Array, space: Gf.ColorSpace) -> Array:
    """Return colours without the curve of their space."""
    threshold, slope = space.GetTransferFunctionParams()
    gamma, bias = space.GetGamma(), space.GetLinearBias()
    if gamma == 1:
        return colors
    curved = ((np.maximum(colors, 0) + bias) / (1 + bias)) ** gamma
    return np.where(colors <= threshold, colors / slope, curved)
