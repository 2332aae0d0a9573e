"""Colour spaces of a stage: the one in which light is computed, and those in which values and images are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...images.color_spaces import REC709, ColorSpaces, converted, named, plain, working_space
from ...scene import SceneError
from .openusd import Usd
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
    """Return OpenColorIO's name of a colour space, or AUTO, RAW or LINEAR; None if it is not known."""
    return _WORDS.get(plain(name)) or named(name)


def to_working(colors: Any, space: str, spaces: ColorSpaces) -> Any:
    """Convert colours (…, 3) from a space that `color_space` returned to the working space."""
    space = spaces.untagged if space in (AUTO, LINEAR) else space
    return colors if space == RAW else converted(colors, space, spaces.working)
