"""How light paths are traced, and the bounds of the radii of their beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np

from ..runtime.device import Float
from ..world.emitters.sources import Source
from .segments.radii import Limits

# Least and greatest radius as a fraction of a medium's radius (for photons, of the world's), and the greatest in free
# paths. Wide beams stick out of small media, and blur what changes within a free path. With these bounds, a ball of 10
# free paths is too dark by half a per cent after 16 passes; beams twice as wide would not lower the noise.
FLOOR, CEILING, FREE_PATHS = 1e-4, 0.05, 0.25


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


def own_bounces(sources: Sequence[Source], tuning: Tuning) -> list[int] | None:
    """Return the most bounces of the light of each source; None if sources have no numbers of their own."""
    bounces = [each.bounces for each in sources]
    if not tuning.own_bounces or tuning.max_bounces is None or all(each is None for each in bounces):
        return None
    return [each or 0 for each in bounces]


def radius_scale(alpha: float, number: int) -> float:
    """Return the factor on radii in pass `number`: R_{i+1} / R_i = (i + α) / (i + 1) (Progressive Photon Beams)."""
    return float(np.prod([(i + alpha) / (i + 1) for i in range(1, number + 1)]))
