"""Numbers and radii of the light paths of lamps: with images, from infinity, through a portal and close by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numerics.sampling import pairs, sobol_points
from ..scene import Array
from ..world.emitters.lamp import Lamp
from .emission import PathEmitter, Stratum

_PROBE = 4096  # paths that measure how much of a lamp's light passes its images

# The fraction of a lamp's beams that do not go through its portal, if such beams are seen.
LIGHT_SIDE = 0.25

# The fraction of these that pass close by the portal, if light is scattered more than once.
SURROUND = 0.25


def radius_from_infinity(lamp: Lamp, count: int, overlap: float) -> float:
    """Return the radius of a lamp's beams in the middle of the world, in its radii, if they come from infinity; else 0.

    With the solid angle Ω of the lamp, N paths that begin on a disc of radius R have the radius r of `transport.radii`,

        r² = (overlap / 2)² · R² · max(π / N, 5/2 · √(π Ω / N)).
    """
    if not lamp.infinite:
        return 0.0
    return 0.5 * overlap * float(np.sqrt(max(np.pi / count, 2.5 * np.sqrt(2 * np.pi**2 * lamp.covered / count))))


def with_surrounds(strata: Sequence[Stratum]) -> list[Stratum]:
    """Split each stratum of paths past a portal into two: paths close by the portal, and all others.

    Only a little of the light hits the edges of a hole. But when it is scattered into the room, it matters as much as
    the light that passes the hole, so it needs paths of its own.
    """
    result = []
    for stratum in strata:
        emitter, count = stratum.emitter, round(SURROUND * stratum.count)
        if emitter.portal is None or emitter.through or emitter.lamp.images:
            result.append(stratum)
            continue
        surround = emitter.portal.surround
        if surround is None or count < 1:
            result.append(stratum)
            continue
        near = emitter.at(surround, True, without=emitter.portal)
        far = emitter.at(surround, False)
        result.append(Stratum(near, count, (*stratum.sequence, 4), stratum.fixed))
        result.append(Stratum(far, stratum.count - count, stratum.sequence, stratum.fixed, stratum.guide))
    return result


def lit_fraction(emitter: PathEmitter) -> float:
    """Return which fraction of the emitter's paths passes its images, estimated from a few; 1 without images."""
    lamp, through = emitter.lamp, emitter.through
    if not lamp.images:
        return 1.0
    if through not in lamp.lit:
        lamp.lit[through] = _lit(emitter, sobol_points(_PROBE, 0, (_PROBE,)))
    return lamp.lit[through]


def _lit(emitter: PathEmitter, points: Array) -> float:
    """Return the fraction of the paths with these emission samples that carry light, among those that exist."""
    probe = emitter.sample(*pairs(points))
    there = np.broadcast_to(probe.valid.numpy(), len(points))
    lit = there & (probe.flux.numpy().max(axis=0) > 0)
    return float(lit.sum() / max(there.sum(), 1))


def guided_count(stratum: Stratum) -> int:
    """Return the number of paths of a stratum of which as many carry light as if it were not guided.

    A guide sends paths to where images let light pass; those that others need to find these places would be too many.
    """
    if stratum.guide is None or not stratum.emitter.lamp.images:
        return stratum.count
    points = sobol_points(_PROBE, 0, (_PROBE,))
    before, behind = (_lit(stratum.emitter, each) for each in (points, stratum.guide(points)[0]))
    return max(round(stratum.count * min(before / max(behind, 1e-30), 1)), 1)
