"""Guides of emission: what a pilot found out about the strata of a world, by the names of these."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..emission import Stratum
from ..strata import guided_count, redistributed
from .maps import GuidingMap
from .openings import Opening, parted
from .pilot import Found

#: The name of a stratum: see `Stratum.name`.
Name = tuple[int, ...]


@dataclass(frozen=True)
class Guides:
    """How light paths are sent toward what cameras see.

    Attributes
    ----------
    openings
        Fitted portals, by the names of the strata that they divide into paths through them and past them.
    maps
        Guiding maps of strata.
    counts
        Numbers of paths of strata.
    """

    openings: Mapping[Name, Opening] = field(default_factory=dict)
    maps: Mapping[Name, GuidingMap | None] = field(default_factory=dict)
    counts: Mapping[Name, int] = field(default_factory=dict)

    @classmethod
    def of(cls, strata: Sequence[Stratum], found: Sequence[Found]) -> Guides:
        """Return what a pilot has found out about strata."""
        both = zip(strata, found, strict=True)
        openings = {stratum.name: each.opening for stratum, each in both if each.opening is not None}
        guided = [replace(part, count=guided_count(part)) for each in found for part in each.strata]
        counts = redistributed(guided, [light for each in found for light in each.light])
        return cls(
            openings,
            {each.name: each.guide for each in guided},
            {each.name: count for each, count in zip(guided, counts, strict=True)},
        )

    def applied(self, strata: Iterable[Stratum]) -> list[Stratum]:
        """Return strata with their guides; those that are not known are as they were."""
        parts = [part for each in strata for part in parted(each, self.openings.get(each.name))]
        return [
            replace(each, guide=self.maps.get(each.name), count=self.counts.get(each.name, each.count))
            for each in parts
        ]


#: Without a pilot.
UNGUIDED = Guides()
