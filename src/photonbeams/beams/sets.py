"""Sets of beams that share a light group and a look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from .beams import Beams, between

if TYPE_CHECKING:
    from ..looks import Look


class BeamSet(NamedTuple):
    """Beams of one light, or of drawn curves, that share a light group and a look."""

    group: str
    look: Look | None  # None is the physical look
    beams: Beams  # at shutter open where they move
    close: Beams | None = None  # the same beams at shutter close, or None if they do not move
    name: str = ""  # path of the light, or of the curves
    light: int = 0  # index of the light, for looks
    to_world: Any = None  # (4, 4) transform from the light's space to world space, for looks
    medium: int = 0  # index of the medium that the beams are in
    depth: Any = None  # (N,) number of times that each beam's light was scattered before, or None if none was

    def at(self, time: float) -> BeamSet:
        """Return the beams at a `time` from 0 (shutter open) to 1 (close), at which they do not move."""
        if self.close is None or not len(self.beams):
            return self._replace(close=None)
        return self._replace(beams=between(self.beams, self.close, time), close=None)
