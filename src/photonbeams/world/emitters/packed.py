"""The lamps of a world as kernels need them: packed by kind and by links, for loops over them, or one by one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np

from ...numerics.arrays import opaque, to_uint
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

#: A lamp, behind its portal, and how it lights surfaces; None: as it lights everything.
Single = tuple[Any, "LinkedSurfaces | None"]


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

    `pixels` are the images of lights with gobos. `links` is None if the lights light everything.
    """

    kind: Any
    packed: Any
    count: Any
    pixels: dict[str, Any]
    links: LinkedSurfaces | None

    @classmethod
    def of(cls, sources: Sequence[Lamp], links: LinkedSurfaces | None) -> Lamps:
        """Return lights of one kind, packed."""
        kind, count = type(sources[0]), dr.opaque(UInt32, len(sources))
        if not sources[0].images:
            return cls(kind, pack(sources), count, {}, links)
        packed, pixels = pack_projected(sources)
        return cls(kind, packed, count, pixels, links)

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
    """

    packed: tuple[Lamps, ...]
    domes: tuple[Single, ...]
    meshes: tuple[Single, ...]
    sky: tuple[Single, ...]

    @classmethod
    def of(cls, world: World) -> LampGroups:
        """Return the lamps of a world."""
        lighting = [] if world.emits else [each for each in world.emitters if each.beams.lights_surfaces]
        groups: dict[Any, list[Any]] = {(kind, Links()): [] for kind in KINDS}
        for each in lighting:
            if each.beams.shines and each.lamp.bare.DRJIT_STRUCT:
                groups.setdefault((type(each.lamp), each.links), []).append(each.lamp)
        packed = tuple(Lamps.of(items, _linked(world, links)) for (_, links), items in groups.items() if items)

        def singles(chosen: Iterable[Emitter]) -> tuple[Single, ...]:
            return tuple((behind(each.lamp, each.portal), _linked(world, each.links)) for each in chosen)

        domes = [each for each in lighting if each.lamp.environment]
        meshes = [each for each in lighting if not (each.lamp.environment or each.lamp.bare.DRJIT_STRUCT)]
        return cls(packed, singles(domes), singles(meshes), singles(world.emitters[number] for number in world.sky))


def _linked(world: World, links: Links) -> LinkedSurfaces | None:
    if links == Links():
        return None
    lit = _lit_shapes(world, links.unlit) if links.unlit else None
    reach, scale, shadow = (opaque(each) for each in (links.shadow_distance, links.surface_scale, links.shadow_color))
    return LinkedSurfaces(world.stopping(links), lit, reach, scale, shadow, links.seen)


def _lit_shapes(world: World, unlit: frozenset[str]) -> Any:
    """Return whether each shape is lit, 1 or 0, by Mitsuba's numbers."""
    numbers = {int(shape_number(mi.ShapePtr(shape))[0]): name not in unlit for name, shape in world.shapes}
    table = np.zeros(max(numbers, default=0) + 2, dtype=np.uint32)
    table[list(numbers)] = list(numbers.values())
    return to_uint(table)


def shape_number(shape: ShapePtr) -> Any:
    """Return Mitsuba's numbers of shapes."""
    return dr.reinterpret_array(UInt32, shape)
