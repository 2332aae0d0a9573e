"""The light groups of a world: what surfaces reflect is known by the groups of the lights."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.arrays import padded, to_uint
from ...numerics.grouped import GroupedLight
from ...runtime.device import UInt32
from .emitter import Emitter
from .mitsuba_scene import by_emitter, emitter_number
from .sources import Source

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import EmitterPtr
    from ..world import World


class LightGroups:
    """The names of the groups that shine on surfaces, in the order of their numbers; "" is the unnamed one.

    Parameters
    ----------
    emitters, sources
        Those of a world.
    more
        The groups of other things that shine.
    unnamed
        Whether something shines that belongs to the unnamed group.
    """

    def __init__(
        self, emitters: Sequence[Emitter], sources: Sequence[Source], more: Iterable[str], unnamed: bool
    ) -> None:  # fmt: skip
        found = {each.beams.group for each in emitters} | {*more} | ({""} if unnamed else set())
        self.names = tuple(sorted(found)) if found - {""} else ("",)
        self._sources = self.table([each.group for each in sources])

    def __len__(self) -> int:
        """Return how many groups there are: at least one."""
        return len(self.names)

    def number(self, name: str) -> int:
        """Return the number of a group; 0 if nothing of that name shines."""
        return self.names.index(name) if name in self.names else 0

    def table(self, names: Sequence[str]) -> Any:
        """Return the numbers of groups, `padded`, for kernels that gather from it; None if there is only one."""
        return None if len(self) == 1 else to_uint(padded([self.number(each) for each in names] or [0]))

    def of_sources(self, sources: UInt32) -> UInt32:
        """Return the number of the group of each source."""
        return gathered_group(self._sources, sources)

    def grouped(self, light: Any, name: str = "") -> GroupedLight:
        """Return light that is all of one group."""
        return GroupedLight.of(light, self.number(name), len(self))


#: The groups of a world in which groups are not told apart.
ONE_GROUP = LightGroups((), (), (), True)


def gathered_group(table: Any, number: UInt32) -> UInt32:
    """Return the number of the group of each entry of a `LightGroups.table`."""
    return UInt32(0) if table is None else dr.gather(UInt32, table, number)


class GroupedEmitters:
    """The light groups of a Mitsuba scene's emitters, as kernels need them."""

    def __init__(self, world: World, groups: LightGroups) -> None:
        numbers = [groups.number(each.beams.group) for each in world.emitters]
        table = None if len(groups) == 1 else by_emitter(world.plugin, range(len(numbers)), numbers)
        self._count, self._table = len(groups), None if table is None else to_uint(table)

    def of(self, light: Any, emitter: EmitterPtr) -> GroupedLight:
        """Return the light of emitters by their groups."""
        return GroupedLight.of(light, self.group(emitter), self._count)

    def group(self, emitter: EmitterPtr) -> UInt32:
        """Return the numbers of the groups of emitters."""
        return gathered_group(self._table, emitter_number(emitter))
