"""Colour spaces, by their names in USD, MaterialX, Arnold and the configurations of OpenColorIO."""

from __future__ import annotations

import re

import numpy as np

from ...scene import Array
from .openusd import Gf, Usd

AUTO, RAW = "auto", "raw"
SRGB = "srgb_rec709_scene"
_LINEAR = "lin_rec709_scene"

# The keys are names in lower case, without blanks, dashes, dots and underscores.
_NAMES = {
    **dict.fromkeys(("", "auto", "usemetadata"), AUTO),
    **dict.fromkeys(("raw", "none", "data", "noncolor", "identity", "utilityraw", "unknown"), RAW),
    **dict.fromkeys(("srgb", "srgbtexture", "srgbtx", "utilitysrgbtexture", "srgbencodedrec709srgb"), SRGB),
    **dict.fromkeys(("linear", "scenelinear", "linsrgb", "linearsrgb", "utilitylinearsrgb"), _LINEAR),
    **dict.fromkeys(("linrec709", "linearrec709", "linearrec709srgb"), _LINEAR),
    **dict.fromkeys(("acescg", "linap1", "acesacescg"), "lin_ap1_scene"),
    **dict.fromkeys(("aces", "aces20651", "linap0", "acesaces20651"), "lin_ap0_scene"),
    **dict.fromkeys(("linrec2020", "linearrec2020"), "lin_rec2020_scene"),
    **dict.fromkeys(("lindisplayp3", "linp3d65", "linearp3d65"), "lin_p3d65_scene"),
    **dict.fromkeys(("srgbdisplayp3", "srgbp3d65"), "srgb_p3d65_scene"),
    **dict.fromkeys(("adobergb", "g22adobergb"), "g22_adobergb_scene"),
    **dict.fromkeys(("gamma18", "g18rec709"), "g18_rec709_scene"),
    **dict.fromkeys(("gamma22", "g22rec709"), "g22_rec709_scene"),
    **dict.fromkeys(("gamma24", "g24rec709"), "g24_rec709_scene"),
    "linadobergb": "lin_adobergb_scene",
    "g22ap1": "g22_ap1_scene",
    "srgbap1": "srgb_ap1_scene",
}


def color_space(name: str) -> str | None:
    """Return OpenUSD's name of a colour space, or AUTO or RAW; None if the name is not known."""
    plain = re.sub("[^a-z0-9]", "", name.lower())
    if plain in _NAMES:
        return _NAMES[plain]
    return name if Gf.ColorSpace.IsValid(name) else None


def in_working_space(value: Array, attribute: Usd.Attribute) -> Array:
    """Return a constant (C,), its colour converted to scene-linear Rec.709 if the attribute names another space."""
    if value.size < 3 or not attribute.HasColorSpace():
        return value
    space = color_space(str(attribute.GetColorSpace()))
    if space in (None, AUTO, RAW):
        return value
    return np.concatenate([to_linear(value[:3], str(space)), value[3:]])


def to_linear(colors: Array, space: str) -> Array:
    """Convert colours (…, 3) from one of OpenUSD's colour spaces to scene-linear Rec.709."""
    if space in (AUTO, RAW, _LINEAR):
        return colors
    known = Gf.ColorSpace(space)
    threshold, slope = known.GetTransferFunctionParams()
    gamma, bias = known.GetGamma(), known.GetLinearBias()
    light = np.asarray(colors, dtype=np.float64)
    if gamma != 1:
        curved = ((np.maximum(light, 0) + bias) / (1 + bias)) ** gamma
        light = np.where(light <= threshold, light / slope, curved)
    working = Gf.ColorSpace(_LINEAR)
    # Every transfer function keeps black and white, so the converted primaries are the columns of the matrix.
    columns = [working.Convert(known, Gf.Vec3f(*axis)).GetRGB() for axis in np.eye(3).tolist()]
    return light @ np.array(columns, dtype=np.float64)
