"""The lamps of a stage, packed by kind and by links, for loops over them in kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.structs import pack
from ...runtime.device import Bool, UInt32
from .gobos import pack_projected

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import ShapePtr, SurfaceInteraction
    from ..world import World
    from .lamp import Lamp


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


def shape_number(shape: ShapePtr) -> Any:
    """Return Mitsuba's numbers of shapes."""
    return dr.reinterpret_array(UInt32, shape)
