"""Light paths of Mitsuba's emitters, by `Emitter.sample_ray`, with their ray differentials."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import drjit as dr
import numpy as np

from ..runtime.device import Array2f, Array3f, Bool, Float, mitsuba
from ..world.bounds import box_around
from ..world.checks import check_finite
from ..world.emitters.gobos import ProjectedLight
from ..world.emitters.lights import EmitterSource
from ..world.scene_world import SceneWorld
from ..world.shadow_rays import gap_at
from ..world.spectra import rgb
from .differentials import RayDifferentials, copies, differentiate, of_copies
from .emission import Emission, EmissionSample, Emitter, Stratum, probed_flux
from .lamps import LIGHT_SIDE, LampRays, PortalEmitter

mi = mitsuba()

# The least fraction of a pass's light paths that an emitter with any power gets.
_LEAST = 1 / 64

# The fractions of an emitter's paths that go through its portal, and past it.
_FRACTIONS = (1 - LIGHT_SIDE, LIGHT_SIDE)


class SceneEmitter:
    """An emitter of a Mitsuba scene; it keeps the scene, because an emitter alone does not keep its shape alive."""

    link = 0
    halvings = 0

    def __init__(self, world: SceneWorld, number: int, source: int = 0) -> None:
        self._world, self._plugin, self._number = world, world.plugin.emitters()[number], number
        self.name, self.source = self._plugin.id() or self._plugin.class_name(), source
        before = world.lamps[number]
        self.lamp, self.bounds = self._source() if before is None else before.source, world.bounds
        check_finite(self._plugin, f"emitter {self.name}")
        self._reach = dr.opaque(Float, world.reach)
        self._spheres = _spheres(world, self._plugin)

    def _source(self) -> EmitterSource | None:
        """Return the emitter as a lamp; None if it shines along one direction."""
        flags = self._plugin.flags()
        ahead = mi.has_flag(flags, mi.EmitterFlags.Surface) and mi.has_flag(flags, mi.EmitterFlags.Delta)
        return None if ahead else EmitterSource(self._plugin)

    def sample(self, u: Array2f, v: Array2f) -> EmissionSample:
        """Return light paths for emission samples, with derivatives by forward-mode differentiation."""
        differentials = self._differentials(u, v)
        ray, weight = self._ray(mi.Point2f(u), mi.Point2f(v))
        origin, direction, flux = Array3f(ray.o), Array3f(ray.d), rgb(weight)
        if isinstance(self.lamp, ProjectedLight):
            flux = flux * self.lamp.tint(origin, direction)
        return self._sample(origin, direction, flux, differentials, Float(dr.inf), Bool(True))

    def begun(self, paths: LampRays) -> EmissionSample:
        """Return paths through a portal as emission samples; they begin off the emitter, beyond rounding errors."""
        step = gap_at(paths.origin, self._world.size)
        origin, flux = paths.origin + step * paths.direction, dr.select(paths.valid, paths.flux, 0)
        return self._sample(origin, paths.direction, flux, paths.differentials(), paths.portal - step, paths.valid)

    def _sample(
        self,
        origin: Array3f,
        direction: Array3f,
        flux: Array3f,
        differentials: RayDifferentials,
        portal: Float,
        valid: Bool,
    ) -> EmissionSample:
        medium = self._world.surroundings.of_emitter(self._number, origin, direction)
        return EmissionSample(origin, direction, flux, differentials, self._reach, portal, medium, valid)

    def _ray(self, u: Any, v: Any) -> Any:
        ray, weight = self._plugin.sample_ray(Float(0), Float(0.5), u, v, True)
        if self._spheres is not None:
            (center, radius), (own_center, own_radius) = self._spheres
            scale = radius / own_radius
            ray.o = center + (ray.o - own_center) * scale
            weight *= dr.square(scale)
        return ray, weight

    def _differentials(self, u: Array2f, v: Array2f) -> RayDifferentials:
        count = dr.width(u)
        lane, which = copies(count)
        inputs = [mi.Point2f(dr.gather(Array2f, each, lane)) for each in (u, v)]
        units = [
            mi.Point2f(dr.select(which == 2 * k, Float(1), 0), dr.select(which == 2 * k + 1, Float(1), 0))
            for k in range(2)
        ]
        with dr.resume_grad():  # the caller may have suspended gradients, as `mi.render` does
            dr.enable_grad(inputs)
            ray, _ = self._ray(*inputs)
            shift, turn = differentiate(inputs, [ray.o, ray.d], units)
        shift, turn = (Array3f(each) + dr.zeros(Array3f, 4 * count) for each in (shift, turn))
        dr.eval(shift, turn)
        return of_copies(shift, turn, count)


def _spheres(world: SceneWorld, plugin: Any) -> Any:
    """Return the scene's sphere, and the one by which Mitsuba's light from infinity enters; None if they are equal.

    Mitsuba leaves merged meshes out of the scene's box.
    """
    box = world.plugin.bbox()
    if not mi.has_flag(plugin.flags(), mi.EmitterFlags.Infinite) or box == box_around(world.plugin):
        return None
    sphere = box.bounding_sphere() if box.valid() else mi.ScalarBoundingSphere3f(mi.ScalarPoint3f(0), 0.0)
    radius = max(mi.math.RayEpsilon, float(sphere.radius) * (1 + mi.math.RayEpsilon))  # as in Mitsuba's emitters
    return [
        (mi.Point3f(*(dr.opaque(Float, each) for each in np.ravel(center))), dr.opaque(Float, float(size)))
        for center, size in ((world.bounds.center.numpy(), world.radius), (sphere.center, radius))
    ]


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
    before = world.lamps[number]
    if before is None or before.portal is None:
        return [emitter]
    return [PortalEmitter(emitter, before.portal, through) for through in (True, False)]


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
