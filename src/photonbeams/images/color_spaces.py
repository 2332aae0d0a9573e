"""Colour spaces: their names, their primaries, and conversion between them by OpenColorIO."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import OpenImageIO

from ..scene import Array, SceneError

#: The working space unless a user asks for another one: linear, with the primaries of Rec. 709.
REC709 = "lin_rec709_scene"

#: The entry of a header that names the colour space of a file's colours; OpenImageIO and Nuke read it.
COLOR_SPACE = "oiio:ColorSpace"

#: OpenColorIO's built-in configuration.
BUILT_IN = "ocio://default"

# Names of other programs, as `plain` returns them.
_ALSO = {
    **dict.fromkeys(("linearrec709", "linearsrgb"), REC709),
    "srgb": "srgb_rec709_scene",
    "gamma18": "g18_rec709_scene",
    "gamma22": "g22_rec709_scene",
}

Primaries = tuple[float, ...]  # x and y of red, green, blue and white: the `chromaticities` of EXR

_SAME = 2e-3  # between the chromaticities of one space as files round them


@dataclass(frozen=True)
class ColorSpaces:
    """The linear space in which light is computed, and the space of colours that name none."""

    working: str = REC709
    untagged: str = REC709

    @property
    def header(self) -> dict[str, Any]:
        """What headers of files in the working space say."""
        return {COLOR_SPACE: self.working, "chromaticities": primaries(self.working)}


#: Both are linear Rec. 709.
USUAL_SPACES = ColorSpaces()


def config_name() -> str:
    """Return the user's OpenColorIO configuration, which $OCIO names, or the built-in one."""
    return os.environ.get("OCIO") or BUILT_IN


def named(name: str) -> str | None:
    """Return the name of a colour space by which files and messages call it, or None if it is not known.

    Known are the spaces of OpenColorIO's built-in configuration, by all their names, written in any way (ACEScg,
    lin_ap1_scene, "Utility - Linear - Rec.709"), and those of the configuration that $OCIO names.
    """
    found = _built_in().get(plain(name))
    if found is None and config_name() != BUILT_IN and _config(config_name()).getColorSpaceIndex(name) >= 0:
        found = str(_config(config_name()).resolve(name))
    return found


def working_space(name: str) -> str:
    """Return the name of a space in which light can be computed; SceneError, a clause, if it is not linear."""
    found = named(name)
    if found is None or primaries(found) is None:
        raise SceneError(f"is '{name}': expected a linear colour space, such as lin_rec709_scene or ACEScg")
    return found


def primaries(space: str) -> Primaries | None:
    """Return the primaries of a linear space, by the name that `named` returns; None if it is not linear."""
    config = _config(_config_of(space))
    found = config.get_chromaticities(space) if config.isColorSpaceLinear(space) else None
    return None if found is None else tuple(round(float(each), 6) for each in found)


def space_of(found: Primaries) -> str | None:
    """Return the linear space with some primaries, or None if no space of the built-in configuration has them."""
    for space in dict.fromkeys(_built_in().values()):
        own = primaries(space)
        if own is not None and np.allclose(own, found, atol=_SAME):
            return space
    return None


def converted(colors: Array, source: str, target: str = REC709) -> Array:
    """Return colours (…, 3 or more) of a `source` space in a `target` space; further channels stay as they are.

    Raises
    ------
    SceneError
        OpenColorIO cannot convert between these spaces.
    """
    if source == target:
        return colors
    given = np.asarray(colors)
    row = np.ascontiguousarray(given[..., :3].reshape(1, -1, 3), dtype=np.float32)
    config = next((each for each in map(_config_of, (source, target)) if each != BUILT_IN), BUILT_IN)
    made = OpenImageIO.ImageBufAlgo.colorconvert(
        OpenImageIO.ImageBuf(row), source, target, unpremult=False, colorconfig=config
    )
    if made.has_error:
        raise SceneError(f"colours cannot be converted from {source} to {target}: {made.geterror()}"[:300])
    color = np.asarray(made.get_pixels(OpenImageIO.FLOAT)).reshape(*given.shape[:-1], 3)
    return np.concatenate([color, given[..., 3:]], axis=-1, dtype=np.result_type(given, np.float32))


def plain(name: str) -> str:
    """Return a name in lower case, without blanks, dashes, dots and underscores."""
    return re.sub("[^a-z0-9]", "", name.lower())


@cache
def _built_in() -> dict[str, str]:
    """Return the colour spaces of the built-in configuration by all their names, without those of displays."""
    config = _config(BUILT_IN)
    result: dict[str, str] = {}
    for name in map(str, config.getColorSpaceNames()):
        known = str(config.get_color_interop_id(name) or name)
        known = name if known.startswith("ocio:") else known
        if "Display" not in name.partition(" - ")[2] and not config.isData(name):
            result |= {plain(each): known for each in (name, known, *config.getAliases(name))}
    return {**result, **_ALSO}


def _config_of(space: str) -> str:
    """Return the configuration that defines a space."""
    return BUILT_IN if plain(space) in _built_in() else config_name()


@cache
def _config(name: str) -> OpenImageIO.ColorConfig:
    return OpenImageIO.ColorConfig(name)
