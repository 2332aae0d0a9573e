"""Warn about valid Mitsuba scenes that are probably mistakes: one warning for each mistake."""

from __future__ import annotations

import logging
from typing import Any

from ..runtime.device import mitsuba
from .bounds import box_of
from .interfaces import number
from .media import boxes, parts
from .surroundings import Surroundings

mi = mitsuba()

_LOG = logging.getLogger("photonbeams")


def warn(plugin: Any, surroundings: Surroundings, warned: set[str]) -> None:
    """Warn about probable mistakes in a scene.

    Parameters
    ----------
    plugin, surroundings
        The Mitsuba scene, and the media around its emitters and sensor.
    warned
        Texts of warnings that were given, to which new ones are added; share it between pictures, so that each is given
        once.
    """
    for text in [*_warnings(plugin, surroundings.everywhere), *surroundings.conflicts]:
        if text not in warned:
            warned.add(text)
            _LOG.warning("%s", text)


def _warnings(plugin: Any, everywhere: int) -> list[str]:
    result = [
        f"shape {each.id() or each.class_name()}: stands in a medium, but names no exterior, so that the space around "
        "it counts as empty: expected that medium as its exterior"
        for each in _holes(plugin, everywhere)
    ]
    return result if plugin.emitters() else [*result, "the scene has no emitter and will be black: expected one"]


def _holes(plugin: Any, everywhere: int) -> list[Any]:
    """Return the shapes within a medium that do not say so: those with another one inside, and nothing outside.

    Where media are is only known from the shapes that bound them, so the boxes around these have to do.
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
