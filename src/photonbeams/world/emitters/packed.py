"""The lamps of a world as kernels need them: packed by kind and by links, for loops over them, or one by one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.arrays import by_number, opaque, to_uint
from ...numerics.structs import pack
from ...runtime.device import Bool, UInt32, mitsuba
from .build import KINDS
from .emitter import Emitter, Links
from .gobos import pack_projected
from .portal_lamps import behind

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import ShapePtr, SurfaceInteraction
    from ..world import World
    from .lamp import Lamp

mi = mitsuba()


class Single(NamedTuple):
    """A light that kernels treat by itself: its lamp behind its portal, how it lights surfaces, and its light group.

    `links` is None if it lights everything.
    """

    lamp: Any
    links: LinkedSurfaces | None
    group: str


class LinkedSurfaces(NamedTuple):
    """How lights with the same links light surfaces.

    `world` has the surfaces that block the lights; `lit` says for each shape whether they light it (None: all of them).
    Surfaces farther away than `reach` cast no shadows. `scale` is a factor on the reflected light, and `shadow` on what
    a shadow leaves of it. `seen` says whether pictures show the lights.
    """

    world: World
    lit: Any | None
    reach: Any
    scale: Any
    shadow: Any
    seen: bool

    def lights(self, hit: SurfaceInteraction, active: Bool) -> Bool:
        """Return which of the active hits are on surfaces that the lights light."""
        if self.lit is None:
            return active
        return active & (dr.gather(UInt32, self.lit, shape_number(hit.shape), active) > 0)


class Lamps(NamedTuple):
    """All lights of one kind with the same links: a struct of arrays, and their number (opaque).

    `pixels` are the images of lights with gobos. `links` is None if the lights light everything. `groups` is the
    `LightGroups.table` of their light groups.
    """

    kind: Any
    packed: Any
    count: Any
    pixels: dict[str, Any]
    links: LinkedSurfaces | None
    groups: Any = None

    @classmethod
    def of(cls, sources: Sequence[Lamp], links: LinkedSurfaces | None, groups: Any = None) -> Lamps:
        """Return lights of one kind, packed."""
        kind, count = type(sources[0]), dr.opaque(UInt32, len(sources))
        if not sources[0].images:
            return cls(kind, pack(sources), count, {}, links, groups)
        packed, pixels = pack_projected(sources)
        return cls(kind, packed, count, pixels, links, groups)

    @property
    def seen(self) -> bool:
        """Whether pictures show the lights."""
        return self.links is None or self.links.seen

    def light(self, number: UInt32) -> Any:
        """Return one of the lights, in a loop over them."""
        light = dr.gather(self.kind, self.packed, number)
        return light.with_pixels(self.pixels) if self.pixels else light


class LampGroups(NamedTuple):
    """The lamps of a world that light surfaces and are no part of its Mitsuba scene, and those that light its media.

    Attributes
    ----------
    packed
        Lamps in loops, by kind and by links.
    domes, meshes
        Environments, and mesh lights.
    sky
        Environments that light media without beams, in the order of `World.sky`.
    glow
        The numbers of the light groups of surfaces that glow, by Mitsuba's numbers of shapes; None: there is one group.
    """

    packed: tuple[Lamps, ...]
    domes: tuple[Single, ...]
    meshes: tuple[Single, ...]
    sky: tuple[Single, ...]
    glow: Any

    @classmethod
    def of(cls, world: World) -> LampGroups:
        """Return the lamps of a world."""
        lighting = [] if world.emits else [each for each in world.emitters if each.beams.lights_surfaces]
        groups: dict[Any, list[Emitter]] = {(kind, Links()): [] for kind in KINDS}
        for each in lighting:
            if each.beams.shines and each.lamp.bare.DRJIT_STRUCT:
                groups.setdefault((type(each.lamp), each.links), []).append(each)
        packed = tuple(
            Lamps.of(
                [each.lamp for each in items], _linked(world, links),
                world.groups.table([each.beams.group for each in items]),
            )
            for (_, links), items in groups.items() if items
        )  # fmt: skip

        def singles(chosen: Iterable[Emitter]) -> tuple[Single, ...]:
            return tuple(
                Single(behind(each.lamp, each.portal), _linked(world, each.links), each.beams.group) for each in chosen
            )

        domes = [each for each in lighting if each.lamp.environment]
        meshes = [each for each in lighting if not (each.lamp.environment or each.lamp.bare.DRJIT_STRUCT)]
        sky = singles(world.emitters[number] for number in world.sky)
        glow = {name: world.groups.number(world.glow.get(name, "")) for name, _ in world.shapes}
        return cls(
            packed, singles(domes), singles(meshes), sky, by_shape(world, glow) if len(world.groups) > 1 else None
        )


def _linked(world: World, links: Links) -> LinkedSurfaces | None:
    if links == Links():
        return None
    lit = by_shape(world, {name: name not in links.unlit for name, _ in world.shapes}) if links.unlit else None
    reach, scale, shadow = (opaque(each) for each in (links.shadow_distance, links.surface_scale, links.shadow_color))
    return LinkedSurfaces(world.stopping(links), lit, reach, scale, shadow, links.seen)


def by_shape(world: World, values: Mapping[str, int]) -> Any:
    """Return integers of shapes, given by their names, as a table by Mitsuba's numbers of them."""
    numbers = [int(shape_number(mi.ShapePtr(shape))[0]) for _, shape in world.shapes]
    return to_uint(by_number(numbers, [values[name] for name, _ in world.shapes]))


def shape_number(shape: ShapePtr) -> Any:
    """Return Mitsuba's numbers of shapes."""
    return dr.reinterpret_array(UInt32, shape)
