"""Sets of beams that share a light group and a look."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..numerics.arrays import joined, opaque
from ..runtime.device import Array3f
from ..scene.places import ZERO, Point
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
    tallied: bool = False  # whether a tally has this light straight ahead: only mirrors and glass show these beams
    zero: Point = ZERO  # where the user's coordinates begin in those of the beams: see `scene.places`

    def at(self, time: float) -> BeamSet:
        """Return the beams at a `time` from 0 (shutter open) to 1 (close), at which they do not move."""
        if self.close is None or not len(self.beams):
            return self._replace(close=None)
        return self._replace(beams=between(self.beams, self.close, time), close=None)

    def in_world(self) -> BeamSet:
        """Return the beams in the user's coordinates."""
        if not any(self.zero):
            return self
        to_world, by = self.to_world, -np.array(self.zero)
        if to_world is not None:
            to_world = np.array(to_world, dtype=np.float64)
            to_world[:3, 3] += by
        close = None if self.close is None else shifted(self.close, opaque(by))
        return self._replace(beams=shifted(self.beams, opaque(by)), close=close, to_world=to_world, zero=ZERO)


def merged(sets: Sequence[BeamSet]) -> list[BeamSet]:
    """Return sets of which those that look alike are one: with the physical look, in a medium and of a light group."""
    alike: dict[object, list[BeamSet]] = {}
    for number, each in enumerate(sets):
        parts = [each.close is None, each.depth is None, *_present(each.beams)]
        alike.setdefault(number if each.look else (each.group, each.medium, each.tallied, *parts), []).append(each)
    result = []
    for first, *more in alike.values():
        pieces = [(each.beams, each.close, each.depth) for each in (first, *more)]
        beams, close, depth = joined(pieces)
        result.append(first._replace(beams=beams, close=close, depth=depth))
    return result


def _present(beams: Beams) -> list[bool]:
    """Return which of their data beams have."""
    return [getattr(beams, name) is not None for name in Beams.DRJIT_STRUCT]


def shifted(beams: Beams, by: Array3f) -> Beams:
    """Return beams whose places are moved by a vector."""
    result = copy(beams)
    result.start, result.end = beams.start + by, beams.end + by
    if beams.side is not None:
        result.side = beams.side + by
    return result
