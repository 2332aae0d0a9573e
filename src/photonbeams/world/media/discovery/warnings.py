"""Warn about valid Mitsuba scenes that are probably mistakes, with one warning for each mistake."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from ....runtime.device import mitsuba
from ...bounds import box_of
from ..interfaces import number
from ..parts import boxes, parts
from .surroundings import Surroundings

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiEmitter, MiObject, MiScene, MiShape

mi = mitsuba()

_LOG = logging.getLogger("photonbeams")

# Parameters of emitters that are factors of their light, and the names of the numbers in these.
_LIGHT = ("radiance", "intensity", "irradiance", "scale", "data")
_VALUES = (*_LIGHT, "value", "values")


def warn(plugin: MiScene, surroundings: Surroundings, warned: set[str]) -> None:
    """Warn about probable mistakes in a scene.

    Parameters
    ----------
    plugin, surroundings
        The Mitsuba scene, and the media around its emitters and sensor.
    warned
        Texts of the warnings so far, to which new ones are added. Pictures that share it repeat no warning.
    """
    for text in [*_warnings(plugin, surroundings), *surroundings.conflicts]:
        if text not in warned:
            warned.add(text)
            _LOG.warning("%s", text)


def _warnings(plugin: MiScene, surroundings: Surroundings) -> list[str]:
    result = [
        f"shape {_name(each)}: stands in a medium, but names no exterior, so that the space around it counts as empty: "
        "expected that medium as its exterior, and normals that point outward"
        for each in _holes(plugin, surroundings.everywhere)
    ]
    if not plugin.emitters():
        return [*result, "the scene has no emitter and will be black: expected one"]
    if all(map(_is_black, plugin.emitters())):
        names = ", ".join(map(_name, plugin.emitters()[:3]))
        return [*result, f"all emitters of the scene are black, and so will be the picture ({names}): expected light"]
    return result


def _name(plugin: MiObject) -> str:
    return str(plugin.id() or plugin.class_name())


def _is_black(emitter: MiEmitter) -> bool:
    """Return whether any of the factors of an emitter's light is zero everywhere."""
    factors: dict[str, bool] = {}
    for name, value in mi.traverse(emitter):
        first, last = name.split(".")[0], name.split(".")[-1]
        if first in _LIGHT and last in _VALUES:
            factors[first] = factors.get(first, False) or bool(np.any(np.asarray(value)))
    return not all(factors.values())


def _holes(plugin: MiScene, everywhere: int) -> list[MiShape]:
    """Return the shapes within a medium that do not name it: those with another one inside, and no exterior.

    A medium is taken to fill the bounding box of the shapes that bound it; its exact extent is not known here.
    """
    shapes = [each for each in parts(plugin, mi.Shape) if each.interior_medium() is not None]
    found = boxes(shapes)
    result = []
    for each in shapes:
        own, box = number(each.interior_medium()), box_of(each)
        around = any(other.contains(box) and other != box for medium, other in found.items() if medium != own)
        if each.exterior_medium() is None and (everywhere or around):
            result.append(each)
    return result
