"""The lamps of a world as kernels need them: packed by kind and by links, for loops over them, or one by one."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.arrays import opaque, padded, to_uint
from ...numerics.structs import pack
from ...runtime.device import UInt32
from .build import KINDS
from .emitter import Emitter, Links
from .gobos import pack_projected
from .linking import by_shape
from .portal_lamps import behind

if TYPE_CHECKING:
    from ..world import World
    from .lamp import Lamp


class Single(NamedTuple):
    """A light that kernels treat by itself: its lamp behind its portal, how it lights surfaces, and its light group.

    `links` is None if it lights everything. `source` is the number of its source.
    """

    lamp: Any
    links: LinkedSurfaces | None
    group: str
    source: UInt32


class LinkedSurfaces(NamedTuple):
    """How lights with the same links light surfaces.

    `world` has the surfaces that block the lights. The lights light the same surfaces as the source with the number
    `source`. Surfaces farther away than `reach` cast no shadows. `scale` is a factor on the reflected light, and
    `shadow` on what a shadow leaves of it. `seen` says whether pictures show the lights.
    """

    world: World
    source: UInt32
    reach: Any
    scale: Any
    shadow: Any
    seen: bool


class Lamps(NamedTuple):
    """All lights of one kind with the same links: a struct of arrays, and their number (opaque).

    `pixels` are the images of lights with gobos. `links` is None if the lights light everything. `groups` is the
    `LightGroups.table` of their light groups, and `sources` has the numbers of their sources.
    """

    kind: Any
    packed: Any
    count: Any
    pixels: dict[str, Any]
    links: LinkedSurfaces | None
    groups: Any = None
    sources: Any = None

    @classmethod
    def of(
        cls, lamps: Sequence[Lamp], links: LinkedSurfaces | None, groups: Any = None, sources: Sequence[int] = ()
    ) -> Lamps:  # fmt: skip
        """Return lights of one kind, packed."""
        kind, count = type(lamps[0]), dr.opaque(UInt32, len(lamps))
        packed, pixels = pack_projected(lamps) if lamps[0].images else (pack(lamps), {})
        return cls(kind, packed, count, pixels, links, groups, to_uint(padded(sources)) if sources else None)

    @property
    def seen(self) -> bool:
        """Whether pictures show the lights."""
        return self.links is None or self.links.seen

    def light(self, number: UInt32) -> Any:
        """Return one of the lights, in a loop over them."""
        light = dr.gather(self.kind, self.packed, number)
        return light.with_pixels(self.pixels) if self.pixels else light


class LampGroups(NamedTuple):
    """The lamps of a world that light surfaces and are no part of its Mitsuba scene.

    Attributes
    ----------
    packed
        Lamps in loops, by kind and by links.
    domes, meshes
        Environments, and mesh lights.
    glow
        The numbers of the light groups of surfaces that glow, by Mitsuba's numbers of shapes; None: there is one group.
    """

    packed: tuple[Lamps, ...]
    domes: tuple[Single, ...]
    meshes: tuple[Single, ...]
    glow: Any

    @classmethod
    def of(cls, world: World, without: Collection[int] = ()) -> LampGroups:
        """Return the lamps of a world, but those with some numbers."""
        others = [each for number, each in enumerate(world.emitters) if number not in without]
        lighting = [] if world.emits else [each for each in others if each.beams.lights_surfaces]
        groups: dict[Any, list[Emitter]] = {(kind, Links()): [] for kind in KINDS}
        for each in lighting:
            if each.beams.shines and each.lamp.bare.DRJIT_STRUCT:
                groups.setdefault((type(each.lamp), each.links), []).append(each)
        packed = tuple(
            Lamps.of(
                [each.lamp for each in items], _linked(world, links, items[0].source),
                world.groups.table([each.beams.group for each in items]), [each.source for each in items],
            )
            for (_, links), items in groups.items() if items
        )  # fmt: skip

        domes = tuple(single(world, each) for each in lighting if each.lamp.environment)
        meshes = tuple(
            single(world, each) for each in lighting if not (each.lamp.environment or each.lamp.bare.DRJIT_STRUCT)
        )
        glow = {name: world.groups.number(world.glow.get(name, "")) for name, _ in world.shapes}
        return cls(packed, domes, meshes, by_shape(world, glow) if len(world.groups) > 1 else None)


def single(world: World, emitter: Emitter) -> Single:
    """Return a lamp that kernels treat by itself."""
    links, source = _linked(world, emitter.links, emitter.source), dr.opaque(UInt32, emitter.source)
    return Single(behind(emitter.lamp, emitter.portal), links, emitter.beams.group, source)


def _linked(world: World, links: Links, source: int) -> LinkedSurfaces | None:
    if links == Links():
        return None
    reach, scale, shadow = (opaque(each) for each in (links.shadow_distance, links.surface_scale, links.shadow_color))
    return LinkedSurfaces(world.stopping(links), dr.opaque(UInt32, source), reach, scale, shadow, links.seen)
