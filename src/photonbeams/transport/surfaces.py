"""Surfaces through media: the light that arrives straight from emitters, past nothing but borders of media.

One sample of an emitter and one of the BSDF, combined by multiple importance sampling (power heuristic, Veach 1997), as
Mitsuba's `volpath` does; what is scattered or refracted on its way comes from photons.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from ..device import Array3f, Bool, Float, UInt32, mitsuba
from ..hashing import hash32
from ..sampling import power_heuristic
from .volumes import Volumes

if TYPE_CHECKING:
    from .samples import Samples

mi = mitsuba()

_EMITTER, _LOBE, _TURN, _WAY = 201, 202, 203, 204  # names of samples in seeds

# Surfaces without a BSDF that a ray may pass.
_LAYERS = 64


def direct(plugin: Any, volumes: Volumes, hit: Any, medium: UInt32, order: UInt32, samples: Samples, step: UInt32,
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


def through(plugin: Any, volumes: Volumes, ray: Any, medium: UInt32, seed: UInt32, active: Bool) -> tuple[Array3f, Any]:
    """Return what of light passes along rays up to their ends, and the surface that each meets there, if any.

    Rays pass surfaces as far as those let them straight through, and no other.
    """
    end = dr.minimum(ray.maxt, dr.largest(Float))

    def further(place: Any, left: Float, medium: UInt32, passed: Array3f, layer: UInt32, going: Bool, hit: Any
                ) -> tuple[Any, ...]:  # fmt: skip
        step = mi.Ray3f(place, ray.d)
        step.maxt = left
        found = plugin.ray_intersect(step, going)
        way = dr.select(found.is_valid(), found.t, left)
        dimmed = volumes.transmittance(medium, Array3f(place), Array3f(ray.d), way, hash32(seed, layer), going)
        passed = dr.select(going, passed * dimmed, passed)
        hit = dr.select(going, found, hit)
        going = going & found.is_valid()
        clear = Array3f(found.bsdf().eval_null_transmission(found, going))
        endless = left >= dr.largest(Float)
        # An endless ray ends at the surface itself; one toward a lamp has been stopped.
        solid = going & (dr.max(clear) <= 0)
        passed = dr.select(solid & ~endless, 0, passed)
        going = going & ~solid
        passed = dr.select(going, passed * clear, passed)
        medium = dr.select(going, volumes.beyond(found, ray.d, medium, going), medium)
        place = dr.select(going, found.spawn_ray(ray.d).o, place)
        left = dr.select(going & ~endless, left - found.t, left)
        return place, left, medium, passed, layer + 1, going & (dr.max(passed) > 0), hit

    width = dr.width(ray.o)
    nothing = dr.zeros(mi.SurfaceInteraction3f, width)
    nothing.t = dr.full(Float, dr.inf, width)
    state = (
        mi.Point3f(ray.o), end + dr.zeros(Float, width), UInt32(medium), dr.ones(Array3f, width),
        dr.zeros(UInt32, width), Bool(active), nothing,
    )  # fmt: skip
    result = dr.while_loop(state, lambda *each: each[5] & (each[4] < _LAYERS), further, label="through")
    return result[3], result[6]
