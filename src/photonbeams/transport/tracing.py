"""How the light paths of a pass are traced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr

from ..numerics.hashing import hash32
from ..numerics.streams import Stream
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.world import World
from .aiming import Openings
from .segments.records import LightPaths

if TYPE_CHECKING:
    from .interactions import Interaction


@dataclass(frozen=True)
class Tracing:
    """How light paths are traced.

    Attributes
    ----------
    world
        The world that paths meet.
    max_bounces, rr_depth
        Most bounces of a light path (None: any number), and the number of bounces after which Russian roulette begins.
    overlap
        Width of a beam in spacings of its neighbours.
    region, paths, power
        Size of the region that scattered light crosses, and by the numbers of sources the number of light paths and
        their flux: see `_scattered_radius`.
    short
        Whether beams end at the path's next scattering event; in heterogeneous media they always do.
    scale
        The pass's factor on all radii.
    bounces_by_source
        Most bounces, by the numbers of sources; None: `max_bounces` alone.
    openings
        Portals through which scattered light is sent; None if there are none.
    endless
        Least lengths of paths that meet nothing, by the numbers of sources; None: 0.
    walks
        About how many walks a tally has, those of all lamps together.
    """

    world: World
    max_bounces: int | None
    rr_depth: int
    overlap: float
    region: float
    paths: Sequence[int]
    power: Sequence[float]
    short: bool = False
    scale: float = 1.0
    bounces_by_source: Any = None
    openings: Openings | None = None
    endless: Any = None
    walks: int = 0

    def within(self, depth: UInt32, source: UInt32) -> Bool:
        """Return whether a depth is allowed on the paths of a source."""
        result = Bool(True)
        if self.max_bounces is not None:
            result = depth <= dr.opaque(UInt32, self.max_bounces)
        if self.bounces_by_source is None:
            return result
        return result & (depth <= dr.gather(UInt32, self.bounces_by_source, source))

    def filtered(self, paths: LightPaths, at: Interaction, stream: UInt32) -> Array3f:
        """Return what filters of lamps leave of light straight from these, at the interactions of paths."""
        filters = self.world.filters
        if filters is None:
            return Array3f(1)
        seed = hash32(stream, paths.index, UInt32(Stream.FILTER))
        away = paths.offset + at.distance
        acting = self.world.linking.acting(paths.source, at.site)
        return filters.factor(paths.source, at.position, -paths.direction, away, seed, paths.straight, acting)

    def linked(self, paths: LightPaths, at: Interaction, ideal: Bool, flux: Array3f) -> Array3f:
        """Return flux, 0 where sites have scattered what came straight from a light whose link leaves them out.

        Mirrors and glass, whose lobes are `ideal`, only pass light on.
        """
        straight = (at.scatters | (at.on_surface & ~ideal)) & (paths.depth == 0)
        lit = self.world.linking.lights(paths.source, at.site, straight)
        return flux if lit is straight else dr.select(straight & ~lit, 0, flux)

    def escape(self, paths: LightPaths, reach: Float) -> Float:
        """Return the lengths of paths that meet nothing, at least `reach`."""
        return reach if self.endless is None else dr.maximum(reach, dr.gather(Float, self.endless, paths.source))
