"""Which lamps light what, and where their filters act: what the links of lights and of filters leave out.

Light is scattered at *sites*, which have numbers: 0 is none of them, such as the camera's; then come the media by their
own numbers, and then the surfaces. A table has a row of sites for each source of light, with a bit for the light itself
and one for each of its filters. Links concern light straight from its lamp alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import by_number, to_uint
from ...runtime.device import Bool, UInt32, mitsuba
from .filters import FilterChain

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import ShapePtr, SurfaceInteraction
    from ..world import World
    from .emitter import Emitter
    from .sources import Source

mi = mitsuba()

_ALL = 0xFFFFFFFF
_MOST_FILTERS = 31


class Linking:
    """The links of a world's lights and of their filters, as kernels need them.

    Raises
    ------
    SceneError
        A light has more than 31 filters, and links of filters.
    """

    def __init__(self, world: World) -> None:
        self._table: Any = None
        limited = [each for each in world.emitters if _is_limited(each)]
        self._filters = any(_limits_filters(each) for each in limited)
        media = {name: number for name, number in world.numbers.items() if number}
        self._first = 1 + max((each.number for each in world.media.all), default=0)
        if not limited and not any(each.unlit for each in world.sources):
            return
        surfaces = {name: int(shape_number(mi.ShapePtr(shape))[0]) for name, shape in world.shapes}
        self._last = max(surfaces.values(), default=0)
        self._size = self._first + 1 + self._last
        self._host = np.full((len(world.sources) + 1, self._size), _ALL, dtype=np.uint32)
        sites = media | {name: self._first + number for name, number in surfaces.items()}
        for source in world.sources:
            self._host[source.number, sorted(source.unlit)] &= ~np.uint32(1)
        for each in limited:
            self._leave_out(each, sites)
        self._table, self._width = to_uint(self._host.ravel()), dr.opaque(UInt32, self._size)

    def _leave_out(self, emitter: Emitter, sites: Mapping[str, int]) -> None:
        row, filters = self._host[emitter.source], emitter.beams.filters
        row[[sites[name] for name in emitter.links.unlit if name in sites]] &= ~np.uint32(1)
        if _limits_filters(emitter) and len(filters) > _MOST_FILTERS:
            text = f"has {len(filters)} filters: expected at most {_MOST_FILTERS} where any has a link"
            raise scene.SceneError(f"{emitter.name}: {text}")
        for number, each in enumerate(filters):
            bit = ~np.uint32(1 << (number + 1))
            row[[sites[name] for name in each.left_out if name in sites]] &= bit
            if not each.in_media:
                row[: self._first] &= bit

    def of_surfaces(self, hit: SurfaceInteraction) -> UInt32:
        """Return the sites of hits on surfaces; 0 where no links matter."""
        if self._table is None:
            return UInt32(0)
        number: Any = shape_number(hit.shape)  # parts of instances have no names
        return dr.opaque(UInt32, self._first) + dr.select(number <= dr.opaque(UInt32, self._last), number, 0)

    def _row(self, source: UInt32, site: UInt32, active: Bool) -> UInt32:
        return dr.gather(UInt32, self._table, source * self._width + site, active)

    def lights(self, source: UInt32, site: UInt32, active: Bool) -> Bool:
        """Return at which of the active sites light straight from sources is scattered: `active` itself, if at all."""
        return active if self._table is None else active & ((self._row(source, site, active) & 1) > 0)

    def acting(self, source: UInt32, site: UInt32) -> UInt32 | None:
        """Return which filters of sources act at sites, a bit for each, from the lowest on; None: all of them."""
        return self._row(source, site, Bool(True)) >> 1 if self._filters else None

    def chain(self, source: Source, medium: int) -> FilterChain | None:
        """Return the filters of a source that act in a medium."""
        chain = source.filters
        if chain is None or not self._filters:
            return chain  # type: ignore[no-any-return]
        bits = int(self._host[source.number, medium])
        own = tuple(each for number, each in enumerate(chain.filters) if bits >> (number + 1) & 1)
        return chain._replace(filters=own) if own else None


def _limits_filters(emitter: Emitter) -> bool:
    return any(each.left_out or not each.in_media for each in emitter.beams.filters)


def _is_limited(emitter: Emitter) -> bool:
    return bool(emitter.links.unlit) or _limits_filters(emitter)


def by_shape(world: World, values: Mapping[str, int]) -> Any:
    """Return integers of shapes, given by their names, as a table by Mitsuba's numbers of them."""
    numbers = [int(shape_number(mi.ShapePtr(shape))[0]) for _, shape in world.shapes]
    return to_uint(by_number(numbers, [values[name] for name, _ in world.shapes]))


def shape_number(shape: ShapePtr) -> Any:
    """Return Mitsuba's numbers of shapes."""
    return dr.reinterpret_array(UInt32, shape)
