"""Beams that share a light group and a look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from .beams import Beams

if TYPE_CHECKING:
    from ..looks import Look


class BeamSet(NamedTuple):
    """Beams that share a light group and a look (None: the physical one), and where they move, at shutter close.

    `light` is the light's number, `to_world` the transform from its space, (4, 4), for looks; `name` is the path of the
    light, or of the curves, that they are of. `medium` is the number of the medium that they are in, `depth` how often
    the light of each was scattered before, if any was.
    """

    group: str
    look: Look | None
    beams: Beams
    close: Beams | None = None
    name: str = ""
    light: int = 0
    to_world: Any = None
    medium: int = 0
    depth: Any = None
