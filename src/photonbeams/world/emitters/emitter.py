"""The record of an emitter of the world: a light of a stage, or an emitter of a Mitsuba scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...scene import BLACK, BeamSettings, Color
from .lamp import Lamp
from .portals import Portal


class Links(NamedTuple):
    """By which surfaces a light is blocked and which it lights; see `scene.Light` for the names of surfaces."""

    unlit: frozenset[str] = frozenset()
    unshadowed: frozenset[str] = frozenset()
    shadow_distance: float = np.inf
    surface_scale: float = 1.0
    shadow_color: Color = BLACK
    seen: bool = True


class Emitter(NamedTuple):
    """An emitter of light.

    Attributes
    ----------
    name
        Its name, for messages: the prim's path, or Mitsuba's id.
    lamp
        What it does, behind its images.
    beams
        The settings of its beams; of a stage's light, the light itself.
    portal
        The opening through which its light comes, or None.
    links
        Which surfaces it lights, and which block it.
    link
        The number of the set of surfaces that block it: see `World.blockers`.
    source
        The number of its source among `World.sources`.
    """

    name: str
    lamp: Lamp
    beams: BeamSettings
    portal: Portal | None = None
    links: Links = Links()
    link: int = 0
    source: int = 0
