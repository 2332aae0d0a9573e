"""Emission of light paths: samples of emitters, in strata, with their ray differentials.

Each stratum (an emitter, or the part of a lamp's light that passes its portal) has its own 4D Sobol sequence. A point
of it is an emission sample: two dimensions place a path on the emitter, two choose its direction. Each path carries ray
differentials, the derivatives of its origin and its direction by the emission sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import to_float, to_numpy
from ..numerics.hashing import key_of
from ..numerics.sampling import pairs, sobol_points
from ..runtime.device import Array2f, Array3f, Float, UInt32
from ..scene import Array
from ..world.bounds import Bounds
from ..world.differentials import RayDifferentials
from ..world.emitters.portals import Portal, emit_through
from ..world.emitters.rays import OF_PATHS, EmittedRays
from ..world.world import World
from .guiding.maps import GuidingMap
from .segments.records import Counts

# Number of paths that estimate an emitter's flux.
PROBE = 4096

# Length of SciPy's Sobol sequences, after which another one begins.
_SEQUENCE = 1 << 30

# How often a beam is halved, at most, where a surface blocks its rim: through a portal or without one, and past one.
# Few through a portal, where a narrow beam would be seen as a streak; many beside it, where light would leak.
HALVINGS, HALVINGS_ASIDE = 1, 5


class PathEmitter:
    """The light paths of an emitter of the world, or of the part of its light `at` a portal.

    Parameters
    ----------
    world, number
        The world, and the emitter's number in it.
    around
        Returns the bounds of a world that light from infinity enters: larger than the world's own by the radius of the
        beams, or those at the boundary of a medium would lack neighbours. None: the world's own.
    counts
        Which of the paths' light counts.
    """

    portal: Portal | None = None
    without: Portal | None = None
    through = False
    halvings = HALVINGS

    def __init__(
        self, world: World, number: int, around: Callable[[World], Bounds] | None = None, counts: Counts = Counts.ALL
    ) -> None:  # fmt: skip
        own = world.emitters[number]
        self.world, self.number, self.around, self.counts = world, number, around, counts
        self.name, self.lamp, self.link, self.source = own.name, own.lamp, own.link, own.source
        self.bounds = world.bounds if around is None else around(world)

    def at(self, portal: Portal, through: bool, without: Portal | None = None) -> PathEmitter:
        """Return the part of the emitter's light that passes a portal (`through`), or the part that does not.

        `without` is an opening within the portal whose light does not count.
        """
        result = copy(self)
        result.__dict__.pop("flux", None)
        result.portal, result.through, result.without = portal, through, without
        result.halvings = HALVINGS if through else HALVINGS_ASIDE
        return result

    def sample(self, u: Array2f, v: Array2f) -> EmittedRays:
        """Return light paths: `u` places them on the lamp, `v` chooses a direction or a point of the portal."""
        if self.portal is not None and self.through:
            rays = emit_through(self.lamp, self.portal, self.bounds, u, v)
            if self.without is not None:
                rays.valid &= ~self.without.crosses(rays.origin, rays.direction)
                rays.portal = dr.full(Float, dr.inf, dr.width(rays.portal))
            return self.world.entered(self.number, rays, self.bounds, through=True)
        rays = self.world.entered(self.number, self.lamp.emit(u, v, self.bounds), self.bounds, through=False)
        if self.portal is not None:
            rays.valid &= ~self.portal.crosses(rays.origin, rays.direction)
            rays.flux = dr.select(rays.valid, rays.flux, 0)
        return rays

    @cached_property
    def flux(self) -> np.ndarray:
        """An estimate of the flux of this light in each channel, (3,), from a few of its paths."""
        sample = self.sample(*pairs(sobol_points(PROBE, 0, (PROBE, self.number))))
        values = to_numpy(sample.flux + dr.zeros(Array3f, PROBE))
        flux: np.ndarray = np.nan_to_num(values, posinf=0, neginf=0).mean(axis=1)
        return flux


@dataclass
class Stratum:
    """Light paths of one kind from one emitter.

    Attributes
    ----------
    emitter, count
        The emitter, and the number of paths in a pass.
    sequence
        Seeds of the stratum's Sobol sequence: that of the shot, and its name.
    fixed
        Whether its number of paths does not depend on other emitters.
    guide
        A map that sends samples toward visible light, or None.
    key
        A hash of the sequence.
    """

    emitter: PathEmitter
    count: int
    sequence: tuple[int, ...]
    fixed: bool = False
    guide: GuidingMap | None = None
    key: int = field(init=False)

    def __post_init__(self) -> None:
        self.key = key_of(*self.sequence)

    @property
    def name(self) -> tuple[int, ...]:
        """The stratum's name, which does not depend on the shot's seed."""
        return self.sequence[1:]

    def points(self, block: int, more: tuple[int, ...] = ()) -> Array:
        """Return the emission samples of pass `block`, (count, 4)."""
        blocks = max(1, _SEQUENCE // self.count)
        more = more or ((2, block // blocks) if block >= blocks else ())
        return sobol_points(self.count, block % blocks, (*self.sequence, *more))

    def emit(self, block: int, points: Array | None = None) -> EmittedRays:
        """Return the light paths of pass `block`; `points`, if given, replace the pass's own, and are not guided."""
        count, derivative = self.count, None
        if points is None:
            points = self.points(block)
            if self.guide is not None:
                points, derivative = self.guide(points)
        rays = self.emitter.sample(*pairs(points))
        nothing = dr.zeros(Array3f, count)
        weight: Any = dr.opaque(Float, 1 / count)
        differentials = rays.differentials
        if derivative is not None and self.guide is not None:
            weight = to_float(np.prod(derivative, axis=1) / count)
            factors = [dr.opaque(Float, float(self.guide.widths[k // 2])) for k in range(4)]
            columns = zip(differentials.columns(), factors, strict=True)
            differentials = RayDifferentials.of([(p * factor, d * factor) for (p, d), factor in columns])
        flux = rays.flux * weight + nothing
        valid = dr.isfinite(dr.sum(flux)) & (dr.min(flux) >= 0)
        number = dr.arange(UInt32, count) + dr.opaque(UInt32, (block * count) & 0xFFFFFFFF)
        wide = dr.zeros(UInt32, count)
        result = replace(
            rays, origin=rays.origin + nothing, direction=rays.direction + nothing, flux=dr.select(valid, flux, 0),
            differentials=differentials, count=dr.opaque(Float, count) + nothing.x, index=number,
            key=dr.opaque(UInt32, self.key) + wide, source=dr.opaque(UInt32, self.emitter.source) + wide,
            link=dr.opaque(UInt32, self.emitter.link) + wide, reach=rays.reach + nothing.x,
            portal=rays.portal + nothing.x, medium=rays.medium + wide,
            counts=dr.opaque(UInt32, int(self.emitter.counts)) + wide, halvings=self.emitter.halvings,
        )  # fmt: skip
        dr.eval([getattr(result, each) for each in OF_PATHS])
        return result


@dataclass(frozen=True)
class Emission:
    """All light paths of a pass, by strata.

    Attributes
    ----------
    strata
        The strata.
    shared
        Whether emitters share light paths in proportion to their power; if not, each has a number of its own.
    """

    strata: Sequence[Stratum]
    shared: bool = False

    @property
    def count(self) -> int:
        """Number of light paths in a pass."""
        return sum(stratum.count for stratum in self.strata)

    def counts(self, sources: int) -> list[int]:
        """Return the numbers of light paths that decide how wide beams are, by the numbers of sources."""
        if self.shared:
            return [self.count] * sources
        result = [0] * sources
        for stratum in self.strata:
            result[stratum.emitter.source] += stratum.count
        return result

    def powers(self, sources: int) -> list[float]:
        """Return the flux of these light paths in the brightest channel, by the numbers of sources."""
        result = np.zeros((sources, 3))
        for stratum in self.strata:
            result[stratum.emitter.source] += stratum.emitter.flux
        if self.shared:
            return [float(result.sum(axis=0).max())] * sources
        return [float(each) for each in result.max(axis=1)]

    def emit(self, block: int) -> list[EmittedRays]:
        """Return the light paths of pass `block`."""
        return [stratum.emit(block) for stratum in self.strata]
