"""How light paths are traced, and the bounds of the radii of their beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np

from ..runtime.device import Float
from ..world.bounds import Bounds
from ..world.emitters.sources import Source
from ..world.media.rendered import RenderedMedium
from ..world.world import World
from .segments.radii import Limits

# Least and greatest radius as a fraction of a medium's radius (for photons, of the world's), and the greatest in free
# paths. Wide beams stick out of small media, and blur what changes within a free path. With these bounds, a ball of 10
# free paths is too dark by half a per cent after 16 passes; beams twice as wide would not lower the noise.
FLOOR, CEILING, FREE_PATHS = 1e-4, 0.05, 0.25

# The greatest σt r² / R of light straight from a lamp: see `Tuning.widest`. The middle of a cube of one free path under
# a sky is then 0.3 ± 0.3 % too bright after 8 passes of 4,096 beams, with a spread of 0.7 %; without it, by 6.5 %. A
# half of it has twice the spread, twice of it no less.
BLUR = 0.025


@dataclass(frozen=True)
class Tuning:
    """How light paths are traced: the fields of `render.settings.Settings` that transport reads.

    With `own_bounces`, each source sets the bounces of its light, up to `max_bounces`. With `visible`, only beams that
    a medium or a look shows are made; programs and files of beams want all.
    """

    seed: int = 0
    max_bounces: int | None = None
    rr_depth: int = 5
    overlap: float = 2.2
    alpha: float = 0.7
    radius: float | None = None
    min_radius: float | None = None
    max_radius: float | None = None
    short: bool = False
    surfaces: bool = True
    own_bounces: bool = False
    visible: bool = False

    @property
    def scatters(self) -> bool:
        """Whether light may be scattered before it is scattered toward the camera."""
        return self.max_bounces is None or self.max_bounces > 0

    def limits(self, number: int, size: float, widest: float = np.inf) -> Limits:
        """Return the bounds of radii in pass `number`, in a region of radius `size`; `widest` bounds the default."""
        low = self.radius or self.min_radius or FLOOR * size
        high = self.radius or self.max_radius or max(min(CEILING * size, widest), low)
        return Limits(*(dr.opaque(Float, each) for each in (low, high, radius_scale(self.alpha, number))))

    def widest(self, world: World, medium: RenderedMedium) -> float:
        """Return the greatest radius of light straight from a lamp in a medium of a stage.

        Such a beam fades from where its axis enters the medium. Where the boundary is bent, or has edges, the mean over
        neighbours is too bright: in a medium of radius R by a part of σt r² / R, for beams of radius r.
        """
        given = self.radius or self.max_radius
        if given or medium.number not in world.fringed:
            return given or np.inf
        extinction = medium.fullness * max(medium.medium.extinction)
        return float(np.sqrt(BLUR * world.radius_of(medium) / max(extinction, 1e-30)))

    def thick(self, world: World) -> list[RenderedMedium]:
        """Return the media that are so thick that light straight from a lamp needs narrower beams there than elsewhere.

        Few of these cover a point, and where they are wider than a free path they miss light that enters at a slant.
        If radii are given, or all beams are wanted, it is none.
        """
        if self.radius or self.max_radius or not self.visible:
            return []
        return [each for each in world.media.all if self.widest(world, each) < CEILING * world.radius_of(each)]

    def bounds(self, radius: float, world: World) -> Bounds:
        """Return the bounds that light from infinity enters if the radius of its beams is this part of theirs."""
        bounded = [(world.fringed[each.number], self.widest(world, each))
                   for each in world.media.all if each.number in world.fringed]  # fmt: skip
        return world.bounds.around(bounded, radius)


def own_bounces(sources: Sequence[Source], tuning: Tuning) -> list[int] | None:
    """Return the most bounces of the light of each source; None if sources have no numbers of their own."""
    bounces = [each.bounces for each in sources]
    if not tuning.own_bounces or tuning.max_bounces is None or all(each is None for each in bounces):
        return None
    return [each or 0 for each in bounces]


def radius_scale(alpha: float, number: int) -> float:
    """Return the factor on radii in pass `number`: R_{i+1} / R_i = (i + α) / (i + 1) (Progressive Photon Beams)."""
    return float(np.prod([(i + alpha) / (i + 1) for i in range(1, number + 1)]))
