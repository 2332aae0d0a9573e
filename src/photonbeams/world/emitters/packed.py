"""The lamps of a world as kernels need them: packed by kind, for loops over them, and what their links do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.arrays import opaque, padded, to_uint
from ...numerics.structs import pack
from ...runtime.device import UInt32
from .emitter import Emitter, Links
from .gobos import pack_projected

if TYPE_CHECKING:
    from ..world import World
    from .lamp import Lamp


class LinkedSurfaces(NamedTuple):
    """How lights with the same links light surfaces.

    `world` has the surfaces that block the lights. Surfaces farther away than `reach` cast no shadows. `scale` is a
    factor on the reflected light, and `shadow` on what a shadow leaves of it.
    """

    world: World
    reach: Any
    scale: Any
    shadow: Any

    @classmethod
    def of(cls, world: World, links: Links) -> LinkedSurfaces | None:
        """Return the surfaces of a world as lights with these links meet them; None if they light everything."""
        if links == Links():
            return None
        reach, scale = opaque(links.shadow_distance), opaque(links.surface_scale)
        return cls(world.stopping(links), reach, scale, opaque(links.shadow_color))


class PackedLamps:
    """The lamps of emitters, packed by kind."""

    def __init__(self, emitters: Sequence[Emitter]) -> None:
        self._emitters = emitters
        self._kinds: dict[type[Lamp], list[int]] = {}
        for number, each in enumerate(emitters):
            if each.lamp.bare.DRJIT_STRUCT:
                self._kinds.setdefault(type(each.lamp), []).append(number)
        self._gather = {kind: _packed([emitters[each].lamp for each in own]) for kind, own in self._kinds.items()}

    def among(self, numbers: Sequence[int]) -> Callable[[UInt32], Any]:
        """Return a function that gathers one of some lamps of one kind, by its place among their `numbers`."""
        kind = type(self._emitters[numbers[0]].lamp)
        every, gather = self._kinds[kind], self._gather[kind]
        if [*numbers] == every:
            return gather
        places = to_uint(padded([every.index(each) for each in numbers]))
        return lambda number: gather(dr.gather(UInt32, places, number))


def _packed(lamps: Sequence[Lamp]) -> Callable[[UInt32], Any]:
    """Return a function that gathers one of these lamps of one kind by its number, in a loop over them."""
    kind, (arrays, pixels) = type(lamps[0]), pack_projected(lamps) if lamps[0].images else (pack(lamps), {})

    def lamp(number: UInt32) -> Any:
        found: Any = dr.gather(kind, arrays, number)
        return found.with_pixels(pixels) if pixels else found

    return lamp
