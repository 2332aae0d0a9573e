"""Surfaces through fog: what camera rays see where beams end, lit directly by the same lights that make the beams.

For each ray: the first surface or lamp; the surface's own glow; from each light one sample of the light, and one sample
of the BSDF for all of them, combined by multiple importance sampling (power heuristic, Veach 1997); the fog's
transmittance exp(−σt x) on the way from the light and on the way to the eye. Lamps hide what is behind them from the
camera, and cast no shadows.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, Any, ClassVar

import drjit as dr

from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample, power_heuristic
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.lights import Sight

if TYPE_CHECKING:
    from ..world.stage_world import Lamps, Links, StageWorld

mi = mitsuba()

_CUTOUT, _BSDF, _LIGHT, _DOME = 1, 2, 3, 4  # names of samples in seeds

# Part of the way by which shadow rays end before their light, which may lie on a surface.
_EARLIER = 1e-4


class Shaded:
    """What camera rays see of surfaces.

    `radiance` (premultiplied by everything in front), `alpha` (1 on surfaces and lamps, 0 in the open), `depth` (to the
    first of them, infinite in the open) and the fog's `transmittance` up to there.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "radiance": Array3f, "alpha": Float, "depth": Float, "transmittance": Array3f,
    }  # fmt: skip

    def __init__(self, radiance: Any = None, alpha: Any = None, depth: Any = None, transmittance: Any = None) -> None:
        self.radiance: Any = radiance
        self.alpha: Any = alpha
        self.depth: Any = depth
        self.transmittance: Any = transmittance


def shade(world: StageWorld, origin: Array3f, direction: Array3f, active: Bool, index: UInt32, seed: UInt32) -> Shaded:
    """Return what rays see of surfaces, lamps and environment.

    Parameters
    ----------
    world
        The shot.
    origin, direction, active
        Rays; directions of unit length. Rays that are not active see nothing.
    index, seed
        Place of the ray's samples in the sequences that the seed names; opaque, or each pass compiles a kernel. Passes
        of a pixel stand next to each other, in an aligned block, and the blocks along a Z-order curve: samples are then
        well distributed in each pixel and over each square of pixels, and what noise is left is fine-grained (Ahmed and
        Wonka 2020, "Screen-space blue-noise diffusion of Monte Carlo sampling error").

    Notes
    -----
    An unbounded fog does not dim what is infinitely far away (`Fog.length`): environment and distant lights.
    """
    hit = world.solid(origin, direction, active, hash32(index, seed, UInt32(_CUTOUT)))
    lamp = _nearest_lamp(world, origin, direction)
    on_lamp = active & (lamp.distance < hit.t)
    on_surface = active & hit.is_valid() & ~on_lamp
    radiance = _glow(world, hit, on_surface) + _direct(world, hit, on_surface, index, seed)
    radiance = dr.select(on_lamp, lamp.radiance, radiance)
    covered = on_lamp | on_surface
    radiance += dr.select(active & ~covered, _background(world, origin, direction), 0)
    depth = dr.select(covered, dr.minimum(lamp.distance, hit.t), dr.inf)
    transmittance = Array3f(1) + 0 * depth
    if _dims(world):
        transmittance = _dimming(world, origin, direction, depth)
    return Shaded(radiance * transmittance, dr.select(covered, Float(1), 0), depth, transmittance)


def _each(lamps: Lamps, state: tuple[Any, ...], body: Any) -> tuple[Any, ...]:
    """Return `state` after body(light, number, state) for each light of a kind, as a loop in the kernel."""

    def step(number: UInt32, *state: Any) -> tuple[Any, ...]:
        return (number + 1, *body(lamps.light(number), number, state))

    # The counter is as wide as the rest, for loops want one width.
    start = dr.zeros(UInt32, dr.width(state))
    return dr.while_loop((start, *state), lambda number, *_: number < lamps.count, step, label=lamps.kind.__name__)[1:]


def _nearest_lamp(world: StageWorld, origin: Array3f, direction: Array3f) -> Sight:
    """Return the nearest lamp that a ray sees shine; a lamp that is dark from there is not there."""
    width = max(dr.width(origin), dr.width(direction))

    def nearer(light: Any, _: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
        distance, radiance = state
        sight = light.see(origin, direction)
        front = sight.hit & (sight.distance < distance) & (dr.max(sight.radiance) > 0)
        return dr.select(front, sight.distance, distance), dr.select(front, sight.radiance, radiance)

    state: tuple[Any, ...] = (dr.full(Float, dr.inf, width), dr.zeros(Array3f, width))
    for lamps in world.lamps:
        state = _each(lamps, state, nearer)
    return Sight(dr.isfinite(state[0]), state[0], state[1], dr.zeros(Float, width))


def _background(world: StageWorld, origin: Array3f, direction: Array3f) -> Array3f:
    """Return the radiance of what is infinitely far away: environments and the discs of distant lights."""
    result = dr.zeros(Array3f, max(dr.width(origin), dr.width(direction)))
    for dome, _ in world.domes:
        result += dome.see(origin, direction).radiance

    def add(light: Any, _: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
        sight = light.see(origin, direction)
        return (state[0] + dr.select(dr.isfinite(sight.distance), 0, sight.radiance),)

    for lamps in world.lamps:
        (result,) = _each(lamps, (result,), add)
    return result


def _glow(world: StageWorld, hit: Any, active: Bool) -> Array3f:
    """Return the radiance that surfaces emit by themselves, to both sides."""
    if not world.glowing:
        return dr.zeros(Array3f, dr.width(hit.t))
    incident = mi.Vector3f(hit.wi)
    front = mi.SurfaceInteraction3f(hit)
    front.wi = mi.Vector3f(incident.x, incident.y, dr.abs(incident.z))  # Mitsuba's emitters are one-sided
    return Array3f(front.emitter(world.surfaces).eval(front, active))


class _Reflection:
    """A surface's BSDF at hits, and one sample of it."""

    def __init__(self, world: StageWorld, hit: Any, active: Bool, index: UInt32, seed: UInt32) -> None:
        self.hit, self.active = hit, active
        self.bsdf = hit.bsdf()
        self.context = mi.BSDFContext()
        # A cut-out surface was drawn to stop the ray; undo the factor of opacity that Mitsuba's `mask` puts on top.
        clear = dr.mean(self.bsdf.eval_null_transmission(hit, active)) if world.cutouts else Float(0)
        self.opacity = dr.maximum(1 - clear, 1e-6)
        lobe = unit_float(hash32(index, seed, UInt32(_BSDF)))
        u = pixel_sample(index, hash32(seed, UInt32(_BSDF)))
        sample, weight = self.bsdf.sample(self.context, hit, lobe * self.opacity, mi.Point2f(u), active)
        self.pdf = sample.pdf / self.opacity
        self.weight = dr.select(active & (self.pdf > 0), Array3f(weight), 0)
        self.direction = Array3f(hit.to_world(sample.wo))
        self.seed = hash32(index, seed, UInt32(_LIGHT))
        self.origin = Array3f(hit.spawn_ray(mi.Vector3f(self.direction)).o)
        self.open = self._open(world)

    def _open(self, world: StageWorld) -> Bool:
        """Return whether the sample meets no surface at all: tested at half the time that the nearest one takes."""
        alive = self.active & (dr.max(self.weight) > 0)
        return alive & ~world.blocked(self.origin, self.direction, Float(dr.inf), alive, self.seed)

    def sees(self, world: StageWorld, met: Bool, distance: Float) -> Bool:
        """Return which samples that meet a light, at some distance, see it."""
        # Small lights are met seldom. The seed is that of `open`: a cut-out that lets one ray through lets the other.
        behind = met & ~self.open & dr.isfinite(distance)
        reach = distance * (1 - _EARLIER)
        return met & (self.open | (behind & ~world.blocked(self.origin, self.direction, reach, behind, self.seed)))

    def of_lights(self, links: Links) -> _Reflection:
        """Return the reflection of lights that light some surfaces, and that some surfaces stop."""
        result = copy(self)
        result.active = links.lights(self.hit, self.active)
        result.weight = dr.select(result.active, self.weight, 0)
        result.open = result._open(links.world)
        return result

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return BSDF times cosine, and the pdf of sampling that direction."""
        wo = self.hit.to_local(mi.Vector3f(direction))
        value, pdf = self.bsdf.eval_pdf(self.context, self.hit, wo, self.active)
        return Array3f(value) / self.opacity, pdf / self.opacity


def _direct(world: StageWorld, hit: Any, active: Bool, index: UInt32, seed: UInt32) -> Array3f:
    """Return the light of all lights that surfaces reflect to the eye, one sample of each."""
    radiance = dr.zeros(Array3f, dr.width(hit.t))
    if not world.lamps and not world.domes:
        return radiance
    reflection = _Reflection(world, hit, active, index, seed)
    for kind, lamps in enumerate(world.lamps):
        (radiance,) = _each(lamps, (radiance,), _adding(world, reflection, lamps.links, index, seed, kind))
    for number, (dome, links) in enumerate(world.domes):
        stream = hash32(seed, UInt32(_DOME + 16 * number))
        radiance += _reflected(*_linked(world, reflection, links), dome, index, stream)
    return radiance


def _adding(
    world: StageWorld, reflection: _Reflection, links: Links | None, index: UInt32, seed: UInt32, kind: int
) -> Callable[..., tuple[Any, ...]]:
    """Return what adds a light of a kind to the radiance, in a loop over them."""
    stopping, reflection = _linked(world, reflection, links)

    def add(light: Any, number: UInt32, state: tuple[Any, ...]) -> tuple[Any, ...]:
        stream = hash32(seed, UInt32(_LIGHT + 16 * kind), number)
        return (state[0] + _reflected(stopping, reflection, light, index, stream),)

    return add


def _linked(world: StageWorld, reflection: _Reflection, links: Links | None) -> tuple[StageWorld, _Reflection]:
    """Return the surfaces that stop lights with these links, and the hits that they light."""
    return (world, reflection) if links is None else (links.world, reflection.of_lights(links))


def _reflected(world: StageWorld, reflection: _Reflection, light: Any, index: UInt32, stream: UInt32) -> Array3f:
    """Return what a surface reflects of one light: a sample of the light and the sample of the BSDF, weighted."""
    hit = reflection.hit
    point = Array3f(hit.p)
    sample = light.illuminate(point, pixel_sample(index, stream))
    value, pdf = reflection.evaluate(sample.direction)
    share = dr.select(sample.pdf > 0, power_heuristic(sample.pdf, pdf), 1)
    value = value * sample.weight * share
    useful = reflection.active & (dr.max(value) > 0)
    start = Array3f(hit.spawn_ray(mi.Vector3f(sample.direction)).o)
    reach = sample.distance * (1 - _EARLIER)
    free = useful & ~world.blocked(start, sample.direction, reach, useful, hash32(index, stream))
    result = dr.select(free, value * _dimming(world, start, sample.direction, sample.distance), 0)

    sight = light.see(point, reflection.direction)
    met = reflection.sees(world, sight.hit & (dr.max(reflection.weight) > 0), sight.distance)
    share = power_heuristic(reflection.pdf, sight.pdf)
    dimming = _dimming(world, start, reflection.direction, sight.distance)
    return result + dr.select(met, reflection.weight * sight.radiance * share * dimming, 0)


def _dimming(world: StageWorld, origin: Array3f, direction: Array3f, distance: Float) -> Array3f:
    fog = world.fog
    return fog.transmittance(origin, direction, distance) if fog is not None and _dims(world) else Array3f(1)


def _dims(world: StageWorld) -> bool:
    """Return whether there is a fog that surfaces feel."""
    return world.fog is not None and world.fog.medium.surfaces
