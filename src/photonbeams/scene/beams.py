"""Drawn beams."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from .checks import Array

if TYPE_CHECKING:
    from ..looks import Look


@dataclass(frozen=True)
class DrawnBeams:
    """Beams that are given, not traced: `start` and `end` (N, 3), `radius_start` and `radius_end` (N,), `power` (N, 3).

    The other arrays are as `Beams` has them, or None: pieces of curves have `offset` and `total` (N,), by which
    falloffs run over the whole curve, `start_tangent` and `end_tangent` (N, 3), by which they are joined, and one `id`,
    the number of their curve.
    """

    name: str
    start: Array
    end: Array
    radius_start: Array
    radius_end: Array
    power: Array
    group: str = ""
    look: Look | None = None
    offset: Array | None = None
    total: Array | None = None
    entry: Array | None = None
    end_normal: Array | None = None
    start_tangent: Array | None = None
    end_tangent: Array | None = None
    power_end: Array | None = None
    random: Array | None = None
    id: Array | None = None
    generation: Array | None = None

    def arrays(self) -> dict[str, Array]:
        """Return all arrays that are set, by the names that `Beams` takes."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        others = ("name", "group", "look")
        return {key: value for key, value in named.items() if key not in others and value is not None}
