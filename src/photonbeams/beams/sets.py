"""Sets of beams that share a light group and a look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from .beams import Beams

if TYPE_CHECKING:
    from ..looks import Look


class BeamSet(NamedTuple):
    """Beams of one light, or of drawn curves, that share a light group and a look.

    Attributes
    ----------
    group
        The light group.
    look
        The look; None is the physical look.
    beams
        The beams, at shutter open where they move.
    close
        The same beams at shutter close, or None if they do not move.
    name
        Path of the light, or of the curves.
    light
        Number of the light, for looks.
    to_world
        (4, 4) transform from the light's space to world space, for looks.
    medium
        Number of the medium that the beams are in.
    depth
        (N,) number of times that each beam's light was scattered before, or None if none was.
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
