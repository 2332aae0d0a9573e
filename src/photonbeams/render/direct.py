"""Surfaces through media: the light that arrives straight from emitters, past nothing but borders of media.

One sample of an emitter and one of the BSDF, combined by multiple importance sampling (power heuristic, Veach 1997), as
Mitsuba's `volpath` does; what is scattered or refracted on its way comes from photons.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from ..numerics.sampling import power_heuristic
from ..runtime.device import Array3f, Bool, UInt32, mitsuba
from ..world.media import Media
from ..world.visibility import through

if TYPE_CHECKING:
    from ..numerics.samples import Samples

mi = mitsuba()

_EMITTER, _LOBE, _TURN, _WAY = 201, 202, 203, 204  # names of samples in seeds


def direct(plugin: Any, volumes: Media, hit: Any, medium: UInt32, order: UInt32, samples: Samples, step: UInt32,
           active: Bool) -> Array3f:  # fmt: skip
    """Return the radiance toward −ray of the light that comes straight from emitters to smooth BSDFs.

    `medium` is where the ray came through; `order` and `step` name the samples.
    """
    bsdf = hit.bsdf()
    context = mi.BSDFContext()
    context.type_mask = mi.BSDFFlags.Smooth
    aim = samples.pair(order, _EMITTER, step)
    light, radiance = plugin.sample_emitter_direction(hit, mi.Point2f(aim), False, active)
    lit = active & (light.pdf > 0)
    value, pdf = bsdf.eval_pdf(context, hit, hit.to_local(light.d), lit)
    share = dr.select(light.delta, 1, power_heuristic(light.pdf, pdf))
    value = Array3f(value) * Array3f(radiance) * share
    lit &= dr.max(value) > 0
    ray = hit.spawn_ray_to(light.p)
    seed = samples.bits(order, _WAY, step)
    passed, _ = through(plugin, volumes, ray, volumes.beyond(hit, light.d, medium, lit), seed, lit)
    result = dr.select(lit, value * passed, 0)

    lobe, turn = samples.single(order, _LOBE, step), samples.pair(order, _TURN, step)
    sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(turn), active)
    reflected = active & (sample.pdf > 0) & (dr.max(Array3f(weight)) > 0)
    direction = hit.to_world(sample.wo)
    start = volumes.beyond(hit, direction, medium, reflected)
    passed, met = through(plugin, volumes, hit.spawn_ray(direction), start, ~seed, reflected)
    emitter = met.emitter(plugin, reflected)
    seen = mi.DirectionSample3f(plugin, met, hit)
    other = plugin.pdf_emitter_direction(hit, seen, reflected & (emitter != None))  # noqa: E711 - of arrays
    value = Array3f(weight) * Array3f(emitter.eval(met, reflected)) * passed * power_heuristic(sample.pdf, other)
    return result + dr.select(reflected, value, 0)
