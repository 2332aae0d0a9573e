"""Mitsuba's emitters: light paths by `Emitter.sample_ray`, with their ray differentials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from ..runtime.device import Array2f, Array3f, Float, mitsuba
from ..world.checks import check_finite
from ..world.scene_world import SceneWorld
from .differentials import RayDifferentials, copies, differentiate, of_copies
from .emission import Emission, EmissionSample, Stratum, probed_flux

mi = mitsuba()

# The least fraction of a pass that an emitter with any power gets.
_LEAST = 1 / 64


class SceneEmitter:
    """An emitter of a Mitsuba scene; it keeps the scene, for an emitter alone does not keep its shape alive."""

    link = 0
    halvings = 0

    def __init__(self, world: SceneWorld, number: int, source: int = 0) -> None:
        self._world, self._plugin, self._number = world, world.plugin.emitters()[number], number
        self.name, self.source = self._plugin.id() or self._plugin.class_name(), source
        check_finite(self._plugin, f"emitter {self.name}")
        self._reach = dr.opaque(Float, world.reach)

    def sample(self, u: Array2f, v: Array2f) -> EmissionSample:
        """Return light paths for emission samples, with derivatives by forward-mode differentiation."""
        differentials = self._tangents(u, v)
        ray, weight = self._ray(mi.Point2f(u), mi.Point2f(v))
        origin, direction = Array3f(ray.o), Array3f(ray.d)
        medium = self._world.surroundings.of_emitter(self._number, origin, direction)
        return EmissionSample(origin, direction, Array3f(weight), differentials, self._reach, Float(dr.inf), medium)

    def _ray(self, u: Any, v: Any) -> Any:
        return self._plugin.sample_ray(Float(0), Float(0.5), u, v, True)

    def _tangents(self, u: Array2f, v: Array2f) -> RayDifferentials:
        count = dr.width(u)
        lane, which = copies(count)
        inputs = [mi.Point2f(dr.gather(Array2f, each, lane)) for each in (u, v)]
        units = [
            mi.Point2f(dr.select(which == 2 * k, Float(1), 0), dr.select(which == 2 * k + 1, Float(1), 0))
            for k in range(2)
        ]
        with dr.resume_grad():  # whatever the caller has suspended, as `mi.render` does
            dr.enable_grad(inputs)
            ray, _ = self._ray(*inputs)
            shift, turn = differentiate(inputs, [ray.o, ray.d], units)
        shift, turn = (Array3f(each) + dr.zeros(Array3f, 4 * count) for each in (shift, turn))
        dr.eval(shift, turn)
        return of_copies(shift, turn, count)


def emission_of(world: SceneWorld, count: int, seed: int = 0, sources: Sequence[int] | None = None) -> Emission:
    """Return the light paths of a Mitsuba scene: about `count` a pass, shared among its emitters by their power.

    `sources` are the numbers of the emitters' sources, 0 unless given.
    """
    total = len(world.plugin.emitters())
    emitters = [SceneEmitter(world, k, sources[k] if sources else 0) for k in range(total)]
    fluxes = [probed_flux(each, number) for number, each in enumerate(emitters)]
    power = np.array([max(flux) for flux in fluxes])
    fractions = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
    return Emission(_strata(emitters, fractions, count, seed), np.sum(fluxes, axis=0) if fluxes else np.zeros(3))


def _strata(emitters: Sequence[SceneEmitter], weights: np.ndarray, count: int, seed: int) -> list[Stratum]:
    fractions = weights / max(weights.sum(), 1e-30)
    return [
        Stratum(emitter, max(round(fraction * count), 1), (seed & 0xFFFFFFFF, number))
        for number, (emitter, fraction) in enumerate(zip(emitters, fractions, strict=True))
        if fraction > 0
    ]


def redistribute(emission: Emission, seen: np.ndarray) -> None:
    """Distribute light paths among the emitters: half by power, as before, and half by the importance `seen`."""
    if not seen.sum() > 0:
        return
    total = emission.count
    for stratum, own in zip(emission.strata, seen / seen.sum(), strict=True):
        stratum.count = max(round(0.5 * stratum.count + 0.5 * own * total), 1)
