"""Light paths of the emitters of a Mitsuba scene, in proportion to their power."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import drjit as dr
import numpy as np

from ..runtime.device import Array2f, Float
from ..world.emitters.rays import EmittedRays
from ..world.scene_world import SceneWorld
from ..world.shadow_rays import gap_at
from .emission import Emission, Emitter, Stratum, probed_flux
from .lamps import LIGHT_SIDE, PortalEmitter

# The least fraction of a pass's light paths that an emitter with any power gets.
_LEAST = 1 / 64

# The fractions of an emitter's paths that go through its portal, and past it.
_FRACTIONS = (1 - LIGHT_SIDE, LIGHT_SIDE)


class SceneEmitter:
    """An emitter of a Mitsuba scene."""

    link = 0
    halvings = 0

    def __init__(self, world: SceneWorld, number: int, source: int = 0) -> None:
        self._world, self._number, plugin = world, number, world.plugin.emitters()[number]
        self.name, self.source = plugin.id() or plugin.class_name(), source
        self.lamp, self.bounds = world.lamps[number].lamp, world.bounds
        self._reach = dr.opaque(Float, world.reach)

    def sample(self, u: Array2f, v: Array2f) -> EmittedRays:
        """Return light paths for emission samples: `u` places them on the emitter, `v` chooses their directions."""
        return self._begun(self.lamp.emit(u, v, self.bounds))

    def begun(self, rays: EmittedRays) -> EmittedRays:
        """Return rays through a portal as they begin in the world: off the emitter, beyond rounding errors."""
        step = gap_at(rays.origin, self._world.size)
        rays.origin, rays.flux = rays.origin + step * rays.direction, dr.select(rays.valid, rays.flux, 0)
        rays.portal = rays.portal - step
        return self._begun(rays)

    def _begun(self, rays: EmittedRays) -> EmittedRays:
        rays.reach = self._reach
        rays.medium = self._world.surroundings.of_emitter(self._number, rays.origin, rays.direction)
        return rays


def power_of(world: SceneWorld, number: int) -> float:
    """Return the power of an emitter of a scene, in its brightest channel."""
    return float(max(probed_flux(SceneEmitter(world, number), number)))


def emission_of(
    world: SceneWorld, count: int, seed: int = 0, sources: Sequence[int] | None = None, without: Collection[int] = ()
) -> Emission:
    """Return the emission of a Mitsuba scene: about `count` paths in a pass, distributed among emitters by their power.

    `sources` has the numbers of the emitters' sources (None: all 0); the emitters `without` have no light paths.
    """
    total = len(world.plugin.emitters())
    parts = [_parts(world, SceneEmitter(world, k, sources[k] if sources else 0), k) for k in range(total)]
    fluxes = [
        [np.zeros(3) if number in without else probed_flux(each, number) for each in own]
        for number, own in enumerate(parts)
    ]
    power = np.array([max(np.sum(own, axis=0)) for own in fluxes])
    fractions = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
    fractions = fractions / max(fractions.sum(), 1e-30)
    strata = []
    for number, (emitters, own) in enumerate(zip(parts, fluxes, strict=True)):
        said = world.beams[number]
        whole = fractions[number] * count if said.beam_count is None else said.beam_count
        name = (seed & 0xFFFFFFFF, number, *([said.seed & 0xFFFFFFFF] if said.seed else []))
        for place, (emitter, flux) in enumerate(zip(emitters, own, strict=True)):
            if max(flux) > 0 and whole > 0:
                fraction = 1.0 if len(emitters) == 1 or max(own[1 - place]) == 0 else _FRACTIONS[place]
                sequence = name if len(emitters) == 1 else (*name, 0, place)
                strata.append(Stratum(emitter, max(round(fraction * whole), 1), sequence, said.beam_count is not None))
    return Emission(strata, np.sum([flux for own in fluxes for flux in own], axis=0) if fluxes else np.zeros(3))


def _parts(world: SceneWorld, emitter: SceneEmitter, number: int) -> list[Emitter]:
    """Return an emitter as a whole or, if it has a portal, its light through the portal and past it."""
    portal = world.lamps[number].portal
    return [emitter] if portal is None else [PortalEmitter(emitter, portal, through) for through in (True, False)]


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
