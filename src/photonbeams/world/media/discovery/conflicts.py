"""Statements about media that contradict each other, as sentences for users."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ....runtime.device import mitsuba
from ....scene import Array
from ...bounds import box_of
from ..interfaces import UNKNOWN, number
from .probes import Walks, first_interface, named_medium

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiShape
    from .surroundings import Place

mi = mitsuba()

# Fractions of walks: a medium is confirmed if more than _RARE find it; another one counts if more than _OFTEN do.
_RARE, _OFTEN = 0.02, 0.1
# A contradiction counts if it has more steps than this number, and than this fraction of all: now and then a ray slips
# through an edge.
_FEW, _SELDOM = 8, 1e-3
# Greatest thickness of a flat shape, as a fraction of its size.
_FLAT = 1e-3


class Statements:
    """What the shapes, emitters and sensors of a scene say of its media.

    Parameters
    ----------
    shapes
        The scene's shapes by their numbers, including those in shape groups.
    media
        The names of its media, by their numbers.

    Attributes
    ----------
    conflicts
        Sentences about statements that contradict each other.
    inside_out
        Numbers of shapes whose normals point inward, so that their `interior` fills the space around them.
    """

    def __init__(self, shapes: Mapping[int, MiShape], media: Mapping[int, str]) -> None:
        self._shapes, self._media = shapes, media
        self.conflicts: list[str] = []
        self.inside_out: set[int] = set()
        self._noted: set[frozenset[int]] = set()

    def check_background(self, medium: int, first: Array, shape: Array) -> None:
        """Note the shapes that are inside out, by walks that begin in the background, which `medium` fills."""
        for own in np.unique(shape[first == medium]):
            if self._holds(own, medium) and number(self._shapes[int(own)].exterior_medium()) != medium:
                self.inside_out.add(int(own))

    def check_place(self, place: Place, walks: Walks) -> None:
        """Note a contradiction between what an emitter or a sensor names and what the shapes around it name."""
        own = number(place.named)
        if place.other is not None and number(place.other) != own:
            self._note(place.name, number(place.other), f"the shape of {place.name}", own)
        first, _, shape = first_interface(walks)
        named = named_medium(walks)
        told = np.where(named > 0, named, first)
        known = told != UNKNOWN
        if not known.any():
            return
        foreign = known & (first != own) & (first > 0)
        if (told[known] == own).mean() > _RARE and foreign.sum() <= _OFTEN * known.sum():
            return
        other = Counter(told[foreign if foreign.any() else known].tolist()).most_common(1)[0][0]
        if other == 0 and not self._is_inside_of_any(own):  # `warnings` reports shapes that name no exterior
            return
        teller = Counter(shape[known & (first == other)].tolist()).most_common(1)
        if teller and self._note(place.name, own, self._shape(teller[0][0]), int(other)):
            self._noted.add(frozenset((own, int(other))))

    def check_pairs(self, pairs: Counter[tuple[int, ...]], sources: Sequence[str], total: int) -> None:
        """Note the most frequent contradiction for each pair of media.

        Parameters
        ----------
        pairs
            How many steps of walks contradict the medium that was known, by five numbers: the known medium, the medium
            that is named now, the shape that named the known one (0: where the walk began), the walk's source, and the
            shape that names the medium now.
        sources
            Names of the sources, "" where nothing is known of them.
        total
            The number of all steps.
        """
        noted = set(self._noted)  # contradictions at emitters and sensors, which walks from there find once more
        for (state, near, teller, source, shape), count in pairs.most_common():
            media = frozenset((state, near))
            who = self._shape(teller) if teller else sources[source]
            if media in noted or not who or count <= max(_FEW, _SELDOM * total):
                continue
            if state == 0:
                known = self._note_gap(who, teller, shape, near)
            elif self._holds(teller, state) and self._holds(shape, near):
                known = self._note_overlap(teller, shape)
            else:
                known = self._note(who, state, self._shape(shape), near)
            if known:
                noted.add(media)

    def _note_gap(self, who: str, teller: int, shape: int, medium: int) -> bool:
        """Note a medium that rays enter without an interface, unless a shape in it only fails to name its exterior."""
        if shape in self.inside_out or (teller and not (teller == shape or self._is_sheet_of(teller, medium))):
            return False
        origin = "that left it" if teller else f"of {who}"
        return self._add(
            f"{self._shape(shape)} does not enclose medium {self._media[medium]}: rays {origin} meet it from within "
            "without having passed a boundary: expected closed shapes, without holes, that do not overlap"
        )

    def _note_overlap(self, one: int, other: int) -> bool:
        return self._add(
            f"{self._shape(one)} and {self._shape(other)} overlap, and have different media inside: expected shapes "
            "that do not overlap, or one inside the other that names the outer medium as its exterior"
        )

    def _note(self, who: str, own: int, other_who: str, other: int) -> bool:
        if who == other_who:
            return False
        there = f"medium {self._media[other]}" if other else "none"
        return self._add(
            f"{who} and {other_who} contradict each other: one names medium {self._media[own]}, the other {there}, "
            "for the same space: expected one medium"
        )

    def _add(self, text: str) -> bool:
        if text not in self.conflicts:
            self.conflicts.append(text)
        return True

    def _holds(self, shape: int, medium: int) -> bool:
        return int(shape) in self._shapes and number(self._shapes[int(shape)].interior_medium()) == medium

    def _is_inside_of_any(self, medium: int) -> bool:
        return any(self._holds(each, medium) for each in self._shapes)

    def _is_sheet_of(self, shape: int, medium: int) -> bool:
        """Return whether a shape is flat, and names the medium on one of its sides."""
        plugin = self._shapes.get(int(shape))
        if plugin is None or medium not in (number(plugin.interior_medium()), number(plugin.exterior_medium())):
            return False
        if plugin.class_name() in ("Rectangle", "Disk"):
            return True
        box = box_of(plugin)
        size = np.ravel(np.asarray(box.max, dtype=np.float64) - np.asarray(box.min, dtype=np.float64))
        return bool(size.min() <= _FLAT * size.max())

    def _shape(self, own: int) -> str:
        shape = self._shapes.get(int(own))
        return "a shape" if shape is None else f"shape {shape.id() or shape.class_name()}"
