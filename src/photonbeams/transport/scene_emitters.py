"""Light paths of the emitters of a Mitsuba scene, in proportion to their power."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..world.emitters.portals import Portal
from ..world.scene_world import SceneWorld
from .emission import Emission, PathEmitter, Stratum, probed_flux
from .lamps import LIGHT_SIDE

# The least fraction of a pass's light paths that an emitter with any power gets.
_LEAST = 1 / 64

# The fractions of an emitter's paths that go through its portal, and past it.
_FRACTIONS = (1 - LIGHT_SIDE, LIGHT_SIDE)


def power_of(world: SceneWorld, number: int) -> float:
    """Return the power of an emitter of a scene, in its brightest channel."""
    return float(max(probed_flux(PathEmitter(world, number), number)))


def emission_of(
    world: SceneWorld, count: int, seed: int = 0, sources: Sequence[int] | None = None, without: Collection[int] = ()
) -> Emission:
    """Return the emission of a Mitsuba scene: about `count` paths in a pass, distributed among emitters by their power.

    `sources` has the numbers of the emitters' sources (None: all 0); the emitters `without` have no light paths.
    """
    parts = [
        _parts(PathEmitter(world, k, source=sources[k] if sources else 0), each.portal)
        for k, each in enumerate(world.emitters)
    ]
    fluxes = [
        [np.zeros(3) if number in without else probed_flux(each, number) for each in own]
        for number, own in enumerate(parts)
    ]
    power = np.array([max(np.sum(own, axis=0)) for own in fluxes])
    fractions = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
    fractions = fractions / max(fractions.sum(), 1e-30)
    strata = []
    for number, (emitters, own) in enumerate(zip(parts, fluxes, strict=True)):
        said = world.emitters[number].beams
        whole = fractions[number] * count if said.beam_count is None else said.beam_count
        name = (seed & 0xFFFFFFFF, number, *([said.seed & 0xFFFFFFFF] if said.seed else []))
        for place, (emitter, flux) in enumerate(zip(emitters, own, strict=True)):
            if max(flux) > 0 and whole > 0:
                fraction = 1.0 if len(emitters) == 1 or max(own[1 - place]) == 0 else _FRACTIONS[place]
                sequence = name if len(emitters) == 1 else (*name, 0, place)
                strata.append(Stratum(emitter, max(round(fraction * whole), 1), sequence, said.beam_count is not None))
    return Emission(strata, np.sum([flux for own in fluxes for flux in own], axis=0) if fluxes else np.zeros(3))


def _parts(emitter: PathEmitter, portal: Portal | None) -> list[PathEmitter]:
    """Return an emitter as a whole or, if it has a portal, its light through the portal and past it."""
    return [emitter] if portal is None else [emitter.at(portal, through) for through in (True, False)]


def redistribute(strata: Sequence[Stratum], seen: np.ndarray) -> None:
    """Redistribute light paths among the emitters: half by power, as before, and half by the importance `seen`.

    Emitters whose number of paths is fixed keep it.
    """
    free = np.array([not each.fixed for each in strata], dtype=bool)
    if not seen[free].sum() > 0:
        return
    total = sum(each.count for each in strata if not each.fixed)
    for stratum, own in zip(strata, seen / seen[free].sum(), strict=True):
        if not stratum.fixed:
            stratum.count = max(round(0.5 * stratum.count + 0.5 * own * total), 1)
