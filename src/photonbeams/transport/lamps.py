"""Numbers and radii of the light paths of lamps: with images, from infinity, through a portal and close by it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..numerics.hashing import key_of
from ..numerics.sampling import pairs, sobol_points
from ..scene import Array
from ..world.emitters.lamp import Lamp
from ..world.emitters.portals import count_candidates
from ..world.stage_world import StageWorld
from .emission import Emission, PathEmitter, Stratum, probed_flux
from .tuning import Tuning

_PROBE = 4096  # paths that measure how much of a lamp's light passes its images

# The fraction of a lamp's beams that do not go through its portal, if such beams are seen.
LIGHT_SIDE = 0.25

# The fraction of these that pass close by the portal, if light is scattered more than once.
SURROUND = 0.25

# Most candidates for each path that passes its lamp's images, and most candidates of a stratum.
_MOST_DARK, _MOST_PATHS = 64, 1 << 22

_PORTAL, _ALL = 0, 1  # kinds of strata, as part of the seeds of their sequences


def radius_from_infinity(lamp: Lamp, count: int, overlap: float) -> float:
    """Return the radius of a lamp's beams in the middle of the world, in its radii, if they come from infinity; else 0.

    With the solid angle Ω of the lamp, N paths that begin on a disc of radius R have the radius r of `segments.radii`,

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


def lamps_of(
    world: StageWorld, beams: int, seed: int, light_side: Collection[str], surfaces: bool = False,
    scatters: bool = False, visible: bool = False, overlap: float = Tuning.overlap,
) -> list[Stratum]:  # fmt: skip
    """Return the strata of a stage's lamps that make beams, or light `surfaces`, each with a fixed number of paths.

    A lamp without a portal has one stratum, with all its directions. A lamp with a portal has two that add up to it:
    the paths through the portal and, if the camera sees the lamp's side of the portal, all others.

    Parameters
    ----------
    world
        The stage.
    beams, seed
        Light paths in a pass, for lamps that do not set the number themselves; and the seed of the sequences.
    light_side
        Names of lamps whose paths past the portal are wanted, too.
    surfaces
        Whether lamps that light surfaces are included, even if they make no beams.
    scatters
        Whether light is scattered more than once. Domes that light media without beams are then included, because their
        scattered light makes beams.
    visible
        Whether only visible beams count. Lamps without a look then make none if no medium scatters light.
    overlap
        Width of a beam in spacings of its neighbours.
    """
    result = []
    hazy = not visible or any(max(each.scattering) > 0 for each in world.description.media)
    for number, emitter in enumerate(world.emitters):
        light = emitter.beams
        count = beams if light.beam_count is None else light.beam_count
        wanted = (light.emits_beams and (hazy or light.look is not None)) or (
            surfaces and light.lights_surfaces and light.shines
        )
        wanted |= scatters and any(light is each for each in world.description.sky)
        if not wanted or count <= 0:
            continue
        aside = count
        if emitter.portal is not None:
            aside = max(1, round(LIGHT_SIDE * count)) if emitter.name in light_side else 0
            result.append(_stratum(world, number, seed, count - aside, overlap, through=True))
        if aside:
            result.append(_stratum(world, number, seed, aside, overlap, through=False))
    return result


def _stratum(
    world: StageWorld, number: int, seed: int, count: int, overlap: float, through: bool
) -> Stratum:  # fmt: skip
    """Return the stratum of a lamp's paths through its portal, or past it, of which about `count` carry light."""
    own, portal = world.emitters[number], world.emitters[number].portal
    margin = radius_from_infinity(own.lamp, count, overlap) if world.boxes else 0.0
    lamp = PathEmitter(world, number, margin)
    emitter = lamp if portal is None else lamp.at(portal, through)
    most = max(count, min(_MOST_DARK * count, _MOST_PATHS))
    count = min(count_candidates(max(lit_fraction(emitter), 1 / _MOST_DARK), count), most)
    if through and portal is not None:
        count = count_candidates(portal.fill, count)
    kind = _PORTAL if through else _ALL
    return Stratum(emitter, count, (seed & 0xFFFFFFFF, own.beams.seed & 0xFFFFFFFF, kind, key_of(own.name)))


def emission_of_lamps(strata: list[Stratum], probed: bool = True) -> Emission:
    """Return the emission of lamps; their power is measured if `probed`, else 0."""
    powers = {each.emitter.source: np.zeros(3) for each in strata}
    for number, each in enumerate(strata if probed else []):
        powers[each.emitter.source] += probed_flux(each.emitter, number)
    return Emission(strata, sum(powers.values(), np.zeros(3)), powers)
