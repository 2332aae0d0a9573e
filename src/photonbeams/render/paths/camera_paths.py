"""Camera paths: straight through boundaries of media, mirrored and refracted, to the first surfaces that scatter light.

Each sample of a pixel begins as one path. Its segments in media gather beams; at surfaces it gathers emission, direct
light and photons. It continues by one sample of the BSDF's specular and null lobes, if there are any. The first two
times that it meets glass, it splits in two branches, which follow reflection and refraction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import drjit as dr

from ...numerics.arrays import compressed, joined, unaliased
from ...numerics.grouped import GroupedLight
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.cameras.sensors import PrimaryRays
from ...world.shadow_rays import rounding
from ...world.spectra import rgb
from ...world.warp import outward
from ...world.world import World
from .branches import STEPS, CameraPaths, onward, several
from .toward_lamps import Toward, aimed
from .virtual_lights import Point
from .walk_vertices import Vertex

if TYPE_CHECKING:
    from .emitters import Emitters
    from .surface_light import SurfaceLight

mi = mitsuba()

# Lobes that make a surface more than a boundary of media; Mitsuba's `Delta` includes `Null`.
_VISIBLE = int(mi.BSDFFlags.Smooth | mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission)


class Bounce(Struct):
    """A sample of a smooth BSDF.

    Attributes
    ----------
    origin, direction, medium, throughput
        The ray on which the path continues, its medium, and the throughput (0: it ends).
    place, value
        Where the surface is; and BSDF times cosine, its largest channel.
    lamp
        The emitter that was chosen for the segment ahead: see `walk_vertices.Walk`.
    """

    origin: Array3f
    direction: Array3f
    medium: UInt32
    throughput: Array3f
    place: Array3f
    value: Float
    lamp: UInt32


class SurfacePoint(Struct):
    """Where a camera path meets a surface: the `place`, the number of Mitsuba's shape (0: none), and the triangle."""

    place: Array3f
    shape: UInt32
    triangle: UInt32


class CameraVertex(Struct):
    """The end of one step of camera paths.

    Attributes
    ----------
    radiance
        The radiance of the surface or the background, and of media that emit before it, times the throughput, by the
        light groups of the world; empty if the tracing does not ask for it.
    emitted
        The part of it that lamps, surfaces that glow or the background emit, which has no noise; empty unless normals
        are asked for.
    solid
        Whether it is a surface or a lamp, rather than a boundary of media or the background.
    end
        Distance along the ray.
    transmittance
        Transmittance of the media from the camera on, without beams-only media.
    name
        Number that names its samples: no other vertex of a pixel's paths has it.
    seed
        Seed of the samples of transmittance along the segment.
    normal
        The surface's shading normal in world space, toward the camera; 0 for lamps, or if normals are not asked for.
    albedo
        The diffuse reflectance in [0, 1]; 1 for lamps and for surfaces that reflect otherwise; 0 if albedos are not
        asked for.
    rough
        Whether it is a lamp, or a surface with more than mirror reflection and refraction; set only with albedos.
    bounce
        Where walks continue from here; None if there are no walks.
    point
        Where the surface is; None if points are not asked for.
    """

    radiance: GroupedLight
    emitted: GroupedLight
    solid: Bool
    end: Float
    transmittance: Array3f
    name: UInt32
    seed: UInt32
    normal: Array3f
    albedo: Array3f
    rough: Bool
    bounce: Bounce | None
    point: SurfacePoint | None


class NearestLamp(Struct):
    """The nearest lamp that is not a surface: its `distance` (infinite if there is none) and `radiance`."""

    distance: Float
    radiance: GroupedLight


@dataclass(frozen=True)
class ShadingPoint:
    """Camera vertices on surfaces: Mitsuba's interaction, the medium in front, and the numbers that seed samples."""

    hit: Any
    medium: Any
    order: Any
    step: Any
    samples: Samples


class Lighting(Protocol):
    """The emitters of a world, as camera paths see them and as they light surfaces."""

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> NearestLamp | None:
        """Return the nearest lamp along rays that have come the distance `flown`; None if all emitters are surfaces."""

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return the emitted radiance of surfaces, and the background's where rays meet nothing."""

    def direct(self, point: ShadingPoint, active: Bool) -> GroupedLight:
        """Return the direct light that smooth BSDFs reflect along the path."""


@dataclass(frozen=True)
class CameraTracing:
    """How camera paths are followed.

    Attributes
    ----------
    world, lighting
        The world, and its lighting.
    max_depth, rr_depth, hide_emitters
        As in Mitsuba's integrators; with a `max_depth` of None there is no limit.
    surfaces
        Whether surfaces are shaded; if not, paths see only emitters.
    sharp
        Whether paths may continue in this world, at a boundary of media, a mirror or glass.
    normals
        Whether vertices have normals.
    walked
        The emitters that walks meet which continue from smooth surfaces; None: there are no walks.
    shining
        Whether vertices have radiance.
    albedo
        Whether vertices have albedos.
    splits
        Whether paths split at glass.
    points
        Whether vertices have points.
    """

    world: World
    lighting: Lighting
    max_depth: int | None
    rr_depth: int
    hide_emitters: bool
    surfaces: bool = True
    sharp: bool = True
    normals: bool = False
    walked: Emitters | None = None
    shining: bool = True
    albedo: bool = False
    splits: bool = True
    points: bool = False

    @property
    def splitting(self) -> bool:
        """Whether any path splits."""
        return self.splits and self.world.mirrors

    def within(self, depth: UInt32, more: int) -> Any:
        """Return whether paths of a depth, with `more` edges, are no longer than `max_depth`."""
        return Bool(True) if self.max_depth is None else depth + more <= dr.opaque(UInt32, self.max_depth)


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
    paths.depth, paths.branch, paths.splits = (dr.zeros(UInt32, count) for _ in range(3))
    paths.flown = paths.near
    start = paths.origin + paths.near * paths.direction
    paths.medium = tracing.world.medium_of_view(start, paths.direction)
    result: CameraPaths = unaliased(paths)  # the first step runs the kernel of later steps
    return result


def follow(
    tracing: CameraTracing, paths: CameraPaths, samples: Samples, light: SurfaceLight
) -> Iterator[tuple[CameraPaths, CameraVertex]]:
    """Yield camera paths and their next vertices, step by step; at most one path of each pixel and branch at a time."""
    batches, step = [paths], 0
    while batches and step < STEPS:
        number, further = dr.opaque(UInt32, step), []
        for each in batches:
            vertex, following = _step(tracing, each, samples, number, light)
            dr.eval(vertex, vertex.bounce, vertex.point, following)
            yield each, vertex
            further.append(following)
        batches = _batches(further)
        step += 1


def _batches(further: list[list[CameraPaths]]) -> list[CameraPaths]:
    """Return the paths that continue: batches of all pixels that have a straight path, and one batch of the others."""
    straight: list[CameraPaths] = []
    others: list[CameraPaths] = []
    for each in (branch for branches in further for branch in branches):
        if bool(dr.any(each.alive & each.primary)):
            straight.append(each)
        else:
            others += map(several, compressed(each.alive, each))
    batches = straight + ([joined(others)] if others else [])
    dr.make_opaque(batches)
    return batches


def _step(
    tracing: CameraTracing, paths: CameraPaths, samples: Samples, step: UInt32, light: SurfaceLight
) -> tuple[CameraVertex, list[CameraPaths]]:
    world, alive = tracing.world, paths.alive
    name = step + STEPS * paths.branch
    start = paths.origin + paths.near * paths.direction
    reach = dr.minimum(paths.far - paths.near, dr.largest(Float))
    chosen = samples.bits(paths.order, Stream.CUTOUT, name)
    hit = world.seen(start, paths.direction, reach, alive, chosen, paths.primary)
    lamp = tracing.lighting.lamp(start, paths.direction, paths.flown)
    met = alive & hit.is_valid()
    distance = dr.select(met, hit.t, reach)
    on_lamp = Bool(False)
    if lamp is not None:
        # A lamp in the plane of a surface is before it.
        slack = rounding(lamp.distance + dr.max(dr.abs(start)) + world.size)
        on_lamp = alive & (lamp.distance - slack < distance)
        met, distance = met & ~on_lamp, dr.select(on_lamp, lamp.distance, distance)
    vertex = CameraVertex()
    vertex.bounce = vertex.point = None
    vertex.end = paths.near + distance
    vertex.name, vertex.seed = name, samples.bits(paths.order, Stream.SEGMENT, name)
    passed = world.media.transmittance(paths.medium, start, paths.direction, distance, vertex.seed, alive)
    felt = world.media.felt(paths.medium, passed)
    throughput, clear = paths.throughput * passed, paths.clear * felt
    vertex.transmittance = dr.select(alive, clear, 0)
    flags = hit.bsdf().flags()
    held = world.held_out(hit, start, paths.direction, met & paths.primary)
    smooth = met & ~held & mi.has_flag(flags, mi.BSDFFlags.Smooth) & tracing.within(paths.depth, 2)
    vertex.radiance = vertex.emitted = GroupedLight()
    if tracing.shining:
        point = ShadingPoint(hit, paths.medium, paths.order, name, samples)
        emitted = _emitted(tracing, paths, point, None if lamp is None else (on_lamp, lamp.radiance))
        radiance, lit = _with_reflected(emitted, tracing, paths, point, smooth, light), alive & ~held
        # A texture may contain NaN; atomic additions on a GPU do not skip it.
        vertex.radiance = (radiance * clear).where(lit).numbers()
        if tracing.normals:
            vertex.emitted = (emitted * clear).where(lit).numbers()
        if world.media.emissive:
            seed = samples.bits(paths.order, Stream.GLOW, name)
            glow = world.media.emitted(paths.medium, start, paths.direction, distance, seed, alive)
            vertex.radiance = vertex.radiance + world.groups.grouped(paths.throughput * glow)
    if tracing.walked is not None:
        vertex.bounce = _bounce(tracing.walked, hit, paths, clear, smooth & alive, samples, name)
    visible = (UInt32(flags) & _VISIBLE) != 0
    vertex.solid = on_lamp | (met & ~held & (visible | ~mi.has_flag(flags, mi.BSDFFlags.Null)))
    vertex.normal = dr.zeros(Array3f, 1)
    if tracing.normals:
        normal = world.shading_normal(hit, met)
        # The geometric normal decides which side is seen: at a silhouette, shading normals may point anywhere.
        vertex.normal = dr.select(met, -dr.mulsign(normal, dr.dot(outward(hit), paths.direction)), 0)
    vertex.albedo, vertex.rough = dr.zeros(Array3f, 1), Bool(False)
    if tracing.albedo:
        vertex.rough = on_lamp | (met & mi.has_flag(flags, mi.BSDFFlags.Smooth))
        vertex.albedo = _albedo(hit, met)
    if tracing.points:
        vertex.point = SurfacePoint()
        vertex.point.place = dr.select(met, Array3f(hit.p), start + distance * paths.direction)
        vertex.point.shape = dr.select(met, UInt32(dr.reinterpret_array(UInt32, hit.shape)), 0)
        vertex.point.triangle = dr.select(met, UInt32(hit.prim_index), 0)
    if not tracing.sharp:
        return vertex, []
    return vertex, onward(tracing, paths, hit, (throughput, clear), met & ~held, samples, name)


def _albedo(hit: Any, met: Bool) -> Array3f:
    """Return the diffuse reflectance of BSDFs in [0, 1], and 1 where they have no diffuse lobe."""
    diffuse = met & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Diffuse)
    found = rgb(hit.bsdf().eval_diffuse_reflectance(hit, diffuse))
    return Array3f(dr.select(diffuse, dr.clip(found, 0, 1), 1))


def _emitted(
    tracing: CameraTracing, paths: CameraPaths, point: ShadingPoint, lamp: tuple[Bool, GroupedLight] | None
) -> GroupedLight:
    """Return the radiance that surfaces, lamps and the background emit.

    `lamp` are two arrays: which paths end on a lamp that is not a surface, and the radiance of the lamp.
    """
    shown = paths.alive & tracing.within(paths.depth, 1)
    if tracing.hide_emitters:
        shown &= paths.depth > 0
    # Images on portals also tint light that passed a boundary of a medium after them.
    straight_from = paths.origin + (paths.near - paths.flown) * paths.direction
    on_lamp = Bool(False) if lamp is None else lamp[0]
    result = tracing.lighting.emission(point.hit, straight_from, paths.direction, shown & ~on_lamp)
    if lamp is not None:
        result = lamp[1].where(on_lamp & shown, result)
    return result


def _with_reflected(
    result: GroupedLight, tracing: CameraTracing, paths: CameraPaths, point: ShadingPoint, smooth: Bool,
    light: SurfaceLight,
) -> GroupedLight:  # fmt: skip
    """Return radiance together with what `smooth` surfaces reflect."""
    if not tracing.surfaces:
        return result
    result = result + tracing.lighting.direct(point, smooth)
    if light.photons is not None:
        result = result + light.photons(point.hit, paths.depth, smooth)
    if light.virtual is not None and tracing.walked is not None:
        result = result + light.virtual.radiance(tracing.walked, Point(
            point.hit, tracing.world.opacity(point.hit, smooth), point.medium,
            smooth & tracing.within(paths.depth, 3), UInt32(1),
            point.samples.bits(point.order, Stream.VIRTUAL, point.step),
        ))  # fmt: skip
    return result


def _bounce(
    walked: Emitters, hit: Any, paths: CameraPaths, throughput: Array3f, smooth: Bool, samples: Samples, name: UInt32
) -> Bounce:
    """Return a sample of the smooth lobes of BSDFs."""
    order, lobe = paths.order, samples.single(paths.order, Stream.BOUNCE, name)
    vertex = Vertex.of_surfaces(walked.world, hit, paths.medium, smooth)
    chosen = vertex.directed(lobe, samples.pair(order, Stream.BOUNCE_TURN, name))
    lamp, _ = walked.choice(samples.single(order, Stream.BOUNCE_WHICH_EMITTER, name))
    if walked.balls is not None:
        ball = walked.balls(lamp, smooth)
        pick, u = samples.single(order, Stream.BOUNCE_TOWARD, name), samples.pair(order, Stream.BOUNCE_TOWARD, name)
        toward = Toward(vertex.position, ball)
        chosen = aimed(
            walked.world.media, paths.medium, toward, ball.near, plain=chosen, pick=pick, u=u, evaluate=vertex.evaluate
        )  # fmt: skip
    good = smooth & (chosen.pdf > 0) & ~chosen.ideal
    ray, result = vertex.ahead(chosen.direction, chosen.pdf, lamp), Bounce()
    result.origin, result.direction, result.medium = ray.origin, ray.direction, ray.medium
    result.throughput = dr.select(good, throughput * chosen.weight, 0)
    result.place, result.value, result.lamp = ray.place, dr.max(chosen.value), lamp
    return result
