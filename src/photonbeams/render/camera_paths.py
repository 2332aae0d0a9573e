"""Camera paths: straight through boundaries of media, mirrored and refracted, to the first surfaces that scatter light.

Each sample of a pixel is one path. Its segments in media gather beams; at surfaces it gathers emission, direct light
and photons. It continues by one sample of the BSDF's specular and null lobes, where there are any.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import drjit as dr

from ..numerics.arrays import compressed
from ..numerics.samples import Samples
from ..numerics.structs import Struct
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.sensors import PrimaryRays
from ..world.spectra import rgb
from ..world.world import World

if TYPE_CHECKING:
    from .photons import PhotonMaps

mi = mitsuba()

# Streams of samples.
_LOBE, _TURN, _ROULETTE, _WAY, _CUTOUT, _GLOW, _BOUNCE, _ASIDE = 301, 302, 303, 304, 305, 306, 307, 308

# Lobes that make a surface more than a boundary of media; Mitsuba's `Delta` includes `Null`.
_VISIBLE = int(mi.BSDFFlags.Smooth | mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission)

#: Lobes by which camera paths go on.
IDEAL = int(mi.BSDFFlags.Delta | mi.BSDFFlags.Null)

# Steps after which paths end that nothing else ends, as between two mirrors.
_STEPS = 128


class CameraPaths(Struct):
    """Camera paths: rays from `near` on.

    Attributes
    ----------
    throughput, clear
        The path's throughput; the same without the transmittance of beams-only media.
    medium
        Number of the medium around it.
    pixel, order
        The path's pixel, and the pixel's place in the sample sequences.
    primary
        Whether the path is still straight: on the pixel's own ray.
    depth
        Specular bounces so far.
    flown
        How far the path has come straight, up to where `near` is.
    """

    origin: Array3f
    direction: Array3f
    near: Float
    far: Float
    throughput: Array3f
    clear: Array3f
    medium: UInt32
    pixel: UInt32
    order: UInt32
    primary: Bool
    depth: UInt32
    alive: Bool
    flown: Float


class Bounce(Struct):
    """A sample of a smooth BSDF: where the path goes on, through which medium, with what throughput (0: nowhere)."""

    origin: Array3f
    direction: Array3f
    medium: UInt32
    throughput: Array3f


class CameraVertex(Struct):
    """The end of one step of camera paths.

    Attributes
    ----------
    radiance
        The radiance of the surface or the background, and what media emit before it, times the throughput.
    solid
        Whether it is a surface or a lamp: no boundary of media, no background.
    end
        Distance along the ray.
    transmittance
        That of the media from the camera on, without beams-only ones.
    seed
        Seed of the samples of transmittance along the segment.
    normal
        The surface's shading normal in world space, toward the camera; 0 of lamps, and unless it is asked for.
    albedo
        The diffuse reflectance in [0, 1]; 1 of surfaces that reflect otherwise and of lamps; 0 unless it is asked for.
    rough
        Whether it is a lamp or a surface with more than mirror reflection and refraction, where albedos are asked for.
    bounce
        Where walks go on from here; None where there are none.
    """

    radiance: Array3f
    solid: Bool
    end: Float
    transmittance: Array3f
    seed: UInt32
    normal: Array3f
    albedo: Array3f
    rough: Bool
    bounce: Bounce | None


class NearestLamp(Struct):
    """The nearest lamp that is not a surface: its `distance` (infinite where there is none) and `radiance`."""

    distance: Float
    radiance: Array3f


@dataclass(frozen=True)
class ShadingPoint:
    """Camera vertices on surfaces: Mitsuba's interaction, the medium in front, and what seeds their samples."""

    hit: Any
    medium: Any
    order: Any
    step: Any
    samples: Samples


class Lighting(Protocol):
    """The emitters of a world: as camera paths see them, and as they light surfaces."""

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> NearestLamp | None:
        """Return the nearest lamp along rays that have `flown` so far already; None where all emitters are surfaces."""

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return the emitted radiance of surfaces, and the background's where rays meet nothing."""

    def direct(self, point: ShadingPoint, active: Bool) -> Array3f:
        """Return the direct light that smooth BSDFs reflect along the path."""


@dataclass(frozen=True)
class CameraTracing:
    """How camera paths are followed.

    Attributes
    ----------
    world, lighting
        The world, and its lighting.
    max_depth, rr_depth, hide_emitters
        As in Mitsuba's integrators; a `max_depth` of None is no limit.
    surfaces
        Whether surfaces are shaded; if not, paths see only emitters.
    sharp
        Whether paths may continue in this world, at a boundary of media, a mirror or glass.
    normals
        Whether vertices have normals.
    walks
        Whether walks go on from smooth surfaces.
    shining
        Whether vertices have the radiance of what is there.
    albedo
        Whether vertices have albedos.
    """

    world: World
    lighting: Lighting
    max_depth: int | None
    rr_depth: int
    hide_emitters: bool
    surfaces: bool = True
    sharp: bool = True
    normals: bool = False
    walks: bool = False
    shining: bool = True
    albedo: bool = False


def begin(tracing: CameraTracing, primary: PrimaryRays, order: UInt32) -> CameraPaths:
    """Return the camera paths of a pass."""
    count = dr.width(primary.direction)
    paths = CameraPaths()
    paths.origin = primary.origin + dr.zeros(Array3f, count)
    paths.direction, paths.near, paths.far = primary.direction, primary.near + dr.zeros(Float, count), primary.far
    paths.throughput = paths.clear = primary.weight
    paths.pixel = dr.arange(UInt32, count) + dr.opaque(UInt32, 0)
    paths.order = UInt32(order)
    paths.primary = paths.alive = dr.full(Bool, True, count)
    paths.depth = dr.zeros(UInt32, count)
    paths.flown = paths.near
    start = paths.origin + paths.near * paths.direction
    paths.medium = tracing.world.medium_of_view(start, paths.direction)
    dr.eval(paths)
    return paths


def follow(
    tracing: CameraTracing, paths: CameraPaths, samples: Samples, photons: PhotonMaps | None
) -> Iterator[tuple[CameraPaths, CameraVertex]]:
    """Yield camera paths and their next vertices, step by step."""
    step = 0
    while step < _STEPS:
        vertex, following = _step(tracing, paths, samples, dr.opaque(UInt32, step), photons)
        dr.eval(vertex, following)
        yield paths, vertex
        if following is None or not bool(dr.any(following.alive)):
            return
        paths = following
        if not bool(dr.any(following.alive & following.primary)):
            (paths,) = compressed(following.alive, following)
        step += 1


def _step(
    tracing: CameraTracing, paths: CameraPaths, samples: Samples, step: UInt32, photons: PhotonMaps | None
) -> tuple[CameraVertex, CameraPaths | None]:
    world, alive = tracing.world, paths.alive
    start = paths.origin + paths.near * paths.direction
    reach = dr.minimum(paths.far - paths.near, dr.largest(Float))
    hit = world.seen(start, paths.direction, reach, alive, samples.bits(paths.order, _CUTOUT, step))
    lamp = tracing.lighting.lamp(start, paths.direction, paths.flown)
    met = alive & hit.is_valid()
    distance = dr.select(met, hit.t, reach)
    on_lamp = Bool(False)
    if lamp is not None:
        on_lamp = alive & (lamp.distance < distance)
        met, distance = met & ~on_lamp, dr.select(on_lamp, lamp.distance, distance)
    vertex = CameraVertex()
    vertex.bounce = None
    vertex.end = paths.near + distance
    vertex.seed = samples.bits(paths.order, _WAY, step)
    passed = world.media.transmittance(paths.medium, start, paths.direction, distance, vertex.seed, alive)
    felt = world.media.felt(paths.medium, passed)
    throughput, clear = paths.throughput * passed, paths.clear * felt
    vertex.transmittance = dr.select(alive, clear, 0)
    flags = hit.bsdf().flags()
    smooth = met & mi.has_flag(flags, mi.BSDFFlags.Smooth) & _within(tracing, paths.depth, 2)
    vertex.radiance = dr.zeros(Array3f, 1)
    if tracing.shining:
        point = ShadingPoint(hit, paths.medium, paths.order, step, samples)
        radiance = _radiance(tracing, paths, point, None if lamp is None else (on_lamp, lamp.radiance), smooth, photons)
        vertex.radiance = dr.select(alive, radiance * clear, 0)
        if world.media.emissive:
            seed = samples.bits(paths.order, _GLOW, step)
            vertex.radiance += paths.throughput * world.media.emitted(
                paths.medium, start, paths.direction, distance, seed, alive
            )
    if tracing.walks:
        vertex.bounce = _bounce(world, hit, paths, clear, smooth & alive, samples, step)
    visible = (UInt32(flags) & _VISIBLE) != 0
    vertex.solid = on_lamp | (met & (visible | ~mi.has_flag(flags, mi.BSDFFlags.Null)))
    vertex.normal = dr.zeros(Array3f, 1)
    if tracing.normals:
        normal = world.shading_normal(hit, met)
        # Which side is seen, the surface itself decides: at a silhouette, shading normals point anywhere.
        vertex.normal = dr.select(met, -dr.mulsign(normal, dr.dot(Array3f(hit.n), paths.direction)), 0)
    vertex.albedo, vertex.rough = dr.zeros(Array3f, 1), Bool(False)
    if tracing.albedo:
        vertex.rough = on_lamp | (met & mi.has_flag(flags, mi.BSDFFlags.Smooth))
        vertex.albedo = _albedo(hit, met)
    if not tracing.sharp:
        return vertex, None
    return vertex, _onward(tracing, paths, hit, (throughput, clear), met, samples, step)


def _albedo(hit: Any, met: Bool) -> Array3f:
    """Return the diffuse reflectance of BSDFs in [0, 1], and 1 where they have no diffuse lobe."""
    diffuse = met & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Diffuse)
    found = rgb(hit.bsdf().eval_diffuse_reflectance(hit, diffuse))
    return Array3f(dr.select(diffuse, dr.clip(found, 0, 1), 1))


def _radiance(
    tracing: CameraTracing, paths: CameraPaths, point: ShadingPoint, lamp: tuple[Bool, Array3f] | None, smooth: Bool,
    photons: PhotonMaps | None,
) -> Any:  # fmt: skip
    """Return the radiance of surfaces, lamps and the background: emitted, and where they are `smooth`, reflected.

    `lamp` tells which paths end on a lamp that is no surface, and its radiance.
    """
    shown = paths.alive & _within(tracing, paths.depth, 1)
    if tracing.hide_emitters:
        shown &= paths.depth > 0
    # Images on portals tint light that passed them before it passed a boundary of a medium, too.
    straight_from = paths.origin + (paths.near - paths.flown) * paths.direction
    on_lamp = Bool(False) if lamp is None else lamp[0]
    result = tracing.lighting.emission(point.hit, straight_from, paths.direction, shown & ~on_lamp)
    if lamp is not None:
        result = dr.select(on_lamp & shown, lamp[1], result)
    if tracing.surfaces:
        result += tracing.lighting.direct(point, smooth)
        if photons is not None:
            result += photons(point.hit, paths.depth, smooth)
    return result


def _bounce(
    world: World, hit: Any, paths: CameraPaths, throughput: Array3f, smooth: Bool, samples: Samples, step: UInt32
) -> Bounce:
    """Return a sample of the smooth lobes of BSDFs."""
    # Of all lobes: among some of them, Mitsuba's cut-out surfaces sample nothing but what passes them.
    context = mi.BSDFContext()
    lobe, turn = samples.single(paths.order, _BOUNCE, step), samples.pair(paths.order, _ASIDE, step)
    sample, weight = hit.bsdf().sample(context, hit, lobe, mi.Point2f(turn), smooth)
    good = smooth & (sample.pdf > 0) & ((sample.sampled_type & IDEAL) == 0)
    direction = hit.to_world(sample.wo)
    result = Bounce()
    result.origin, result.direction = Array3f(hit.spawn_ray(direction).o), Array3f(direction)
    result.medium = world.media.beyond(hit, direction, paths.medium, good)
    result.throughput = dr.select(good, throughput * rgb(weight), 0)
    return result


def _within(tracing: CameraTracing, depth: UInt32, more: int) -> Any:
    """Return whether paths of a depth, with `more` edges, are no longer than `max_depth`."""
    return Bool(True) if tracing.max_depth is None else depth + more <= dr.opaque(UInt32, tracing.max_depth)


def _onward(
    tracing: CameraTracing, paths: CameraPaths, hit: Any, weights: tuple[Array3f, Array3f], met: Bool, samples: Samples,
    step: UInt32,
) -> CameraPaths:  # fmt: skip
    """Return the paths continued from the surface: reflected, refracted, or straight through."""
    context = mi.BSDFContext()
    context.type_mask = IDEAL
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    sharp = met & (mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null))
    # Stratified over the passes: glass reflects and refracts each pixel's paths in the right proportion.
    lobe, turn = samples.pair(paths.order, _LOBE, step).x, samples.pair(paths.order, _TURN, step)
    # A cut-out surface was already sampled as opaque: its null lobe is not sampled again.
    lobe *= tracing.world.opacity(hit, sharp)
    sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(turn), sharp)
    # Some BSDFs ignore the mask: Mitsuba's `principled` samples all its lobes.
    sharp &= (sample.sampled_type & IDEAL) != 0
    direction = hit.to_world(sample.wo)
    null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    straight = paths.primary & null
    following = CameraPaths()
    factor: Any = dr.select(sharp & (sample.pdf > 0), rgb(weight), 0)
    following.throughput, following.clear = (each * factor for each in weights)
    spawned = hit.spawn_ray(direction)
    # A primary ray keeps its origin, for the tiles; its `near` moves to the surface that it passed.
    distance = dr.dot(Array3f(spawned.o) - paths.origin, paths.direction)
    following.origin = dr.select(straight, paths.origin, Array3f(spawned.o))
    following.direction = dr.select(straight, paths.direction, Array3f(direction))
    following.near = dr.select(straight, distance, 0)
    following.far = dr.select(straight, paths.far, dr.largest(Float))
    following.medium = tracing.world.media.beyond(hit, direction, paths.medium, sharp)
    following.depth = paths.depth + dr.select(null, 0, 1)
    following.pixel, following.order, following.primary = paths.pixel, paths.order, straight
    following.flown = dr.select(null, paths.flown + distance - paths.near, 0)
    throughput: Any = following.throughput
    most = dr.max(dr.maximum(throughput, following.clear))
    alive = sharp & (most > 0) & _within(tracing, following.depth, 1)
    survival = dr.minimum(most, 0.95)
    tried = following.depth >= dr.opaque(UInt32, tracing.rr_depth)
    survives = samples.single(paths.order, _ROULETTE, step) < survival
    factor = dr.select(tried, dr.rcp(dr.maximum(survival, 1e-30)), 1)
    following.throughput, following.clear = following.throughput * factor, following.clear * factor
    following.alive = alive & (~tried | survives)
    return following
