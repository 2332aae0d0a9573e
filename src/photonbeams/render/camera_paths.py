"""Camera paths: straight through boundaries of media, mirrored and refracted, to the first surfaces that scatter light.

Each pixel has one path a pass. Its segments in media gather beams; at surfaces it gathers emission, direct light and
photons, and goes on where a BSDF has ideal mirrors, refracts, or lets light through, by one sample of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import drjit as dr

from ..numerics.arrays import compressed
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.sensors import Primary
from ..world.world import World

if TYPE_CHECKING:
    from .photons import PhotonMaps

mi = mitsuba()

_LOBE, _TURN, _ROULETTE, _WAY, _CUTOUT = 301, 302, 303, 304, 305  # streams of samples

# What makes a surface more than a boundary of media; to Mitsuba going straight on (Null) is one of `Delta`.
_VISIBLE = int(mi.BSDFFlags.Smooth | mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission)

_IDEAL = int(mi.BSDFFlags.Delta | mi.BSDFFlags.Null)

# Steps after which a path ends that meets nothing that ends it, as between two mirrors.
_STEPS = 128


class CameraPaths:
    """Camera paths: rays from `near` on.

    Attributes
    ----------
    throughput, clear
        The weight of light that a path meets; the same without the fogs that surfaces do not feel.
    medium
        Number of the medium that it is in.
    pixel, order
        The path's pixel, and what names its samples.
    primary
        Whether it is still the pixel's own ray.
    depth
        Mirrors and refractions so far.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "near": Float, "far": Float, "throughput": Array3f, "clear": Array3f,
        "medium": UInt32, "pixel": UInt32, "order": UInt32, "primary": Bool, "depth": UInt32, "alive": Bool,
    }  # fmt: skip

    origin: Any
    direction: Any
    near: Any
    far: Any
    throughput: Any
    clear: Any
    medium: Any
    pixel: Any
    order: Any
    primary: Any
    depth: Any
    alive: Any


class CameraVertex:
    """Where paths arrive in one step: `radiance` of surfaces times the throughput, `end` on the ray.

    `solid` tells surfaces and lamps from boundaries of media and from the background; `transmittance` is that of the
    fogs that surfaces feel, from the camera on; `seed` is that of the transmittance up to there.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "radiance": Array3f, "solid": Bool, "end": Float, "transmittance": Array3f, "seed": UInt32,
    }  # fmt: skip

    radiance: Any
    solid: Any
    end: Any
    transmittance: Any
    seed: Any


class Lamp:
    """What paths meet of lamps that are no surfaces: `distance` (infinite where there is none) and `radiance`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"distance": Float, "radiance": Array3f}

    def __init__(self, distance: Any = None, radiance: Any = None) -> None:
        self.distance: Any = distance
        self.radiance: Any = radiance


@dataclass(frozen=True)
class ShadingPoint:
    """Surfaces that paths have met: Mitsuba's interaction, the medium before them, and what names their samples."""

    hit: Any
    medium: Any
    order: Any
    step: Any
    samples: Samples


class Lighting(Protocol):
    """How a world's emitters are seen, and how they light surfaces."""

    def lamp(self, origin: Array3f, direction: Array3f) -> Lamp | None:
        """Return the nearest lamp that rays see shine; None where all emitters are surfaces."""

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return the radiance of surfaces that glow, and of the background where nothing is met."""

    def direct(self, point: ShadingPoint, active: Bool) -> Array3f:
        """Return the radiance toward the path of light that comes straight from emitters to smooth BSDFs."""


@dataclass(frozen=True)
class CameraTracing:
    """How camera paths are followed.

    Attributes
    ----------
    world, lighting
        What they meet, and what lights that.
    max_depth, rr_depth, hide_emitters
        As Mitsuba's integrators have them; a depth of None is any.
    surfaces
        Whether surfaces are shaded; if not, paths see emitters alone.
    sharp
        Whether anything in the world may send paths on: a boundary of media, a mirror, glass.
    """

    world: World
    lighting: Lighting
    max_depth: int | None
    rr_depth: int
    hide_emitters: bool
    surfaces: bool = True
    sharp: bool = True


def begin(viewing: CameraTracing, primary: Primary, order: UInt32) -> CameraPaths:
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
    start = paths.origin + paths.near * paths.direction
    paths.medium = viewing.world.medium_of_view(start, paths.direction)
    dr.eval(paths)
    return paths


def follow(
    viewing: CameraTracing, paths: CameraPaths, samples: Samples, photons: PhotonMaps | None
) -> Iterator[tuple[CameraPaths, CameraVertex]]:
    """Yield camera paths and where they arrive, step by step."""
    step = 0
    while step < _STEPS:
        vertex, following = _step(viewing, paths, samples, dr.opaque(UInt32, step), photons)
        dr.eval(vertex, following)
        yield paths, vertex
        if following is None or not bool(dr.any(following.alive)):
            return
        paths = following
        if not bool(dr.any(following.alive & following.primary)):
            (paths,) = compressed(following.alive, following)
        step += 1


def _step(
    viewing: CameraTracing, paths: CameraPaths, samples: Samples, step: UInt32, photons: PhotonMaps | None
) -> tuple[CameraVertex, CameraPaths | None]:
    world, alive = viewing.world, paths.alive
    start = paths.origin + paths.near * paths.direction
    reach = dr.minimum(paths.far - paths.near, dr.largest(Float))
    hit = world.seen(start, paths.direction, reach, alive, samples.bits(paths.order, _CUTOUT, step))
    lamp = viewing.lighting.lamp(start, paths.direction)
    met = alive & hit.is_valid()
    way = dr.select(met, hit.t, reach)
    on_lamp = Bool(False)
    if lamp is not None:
        on_lamp = alive & (lamp.distance < way)
        met, way = met & ~on_lamp, dr.select(on_lamp, lamp.distance, way)
    vertex = CameraVertex()
    vertex.end = paths.near + way
    vertex.seed = samples.bits(paths.order, _WAY, step)
    passed = world.media.transmittance(paths.medium, start, paths.direction, way, vertex.seed, alive)
    felt = world.media.felt(paths.medium, passed)
    throughput, clear = paths.throughput * passed, paths.clear * felt
    vertex.transmittance = dr.select(alive, clear, 0)
    shown = alive & _within(viewing, paths.depth, 1)
    if viewing.hide_emitters:
        shown &= paths.depth > 0
    radiance = viewing.lighting.emission(hit, start, paths.direction, shown & ~on_lamp)
    if lamp is not None:
        radiance = dr.select(on_lamp & shown, lamp.radiance, radiance)
    flags = hit.bsdf().flags()
    smooth = met & mi.has_flag(flags, mi.BSDFFlags.Smooth) & _within(viewing, paths.depth, 2)
    if viewing.surfaces:
        radiance += viewing.lighting.direct(ShadingPoint(hit, paths.medium, paths.order, step, samples), smooth)
        if photons is not None:
            radiance += photons(hit, paths.depth, smooth)
    vertex.radiance = dr.select(alive, radiance * clear, 0)
    visible = (UInt32(flags) & _VISIBLE) != 0
    vertex.solid = on_lamp | (met & (visible | ~mi.has_flag(flags, mi.BSDFFlags.Null)))
    if not viewing.sharp:
        return vertex, None
    return vertex, _onward(viewing, paths, hit, (throughput, clear), met, samples, step)


def _within(viewing: CameraTracing, depth: UInt32, more: int) -> Any:
    """Return whether paths of so many events and more edges are no longer than asked for."""
    return Bool(True) if viewing.max_depth is None else depth + more <= dr.opaque(UInt32, viewing.max_depth)


def _onward(
    viewing: CameraTracing, paths: CameraPaths, hit: Any, weights: tuple[Array3f, Array3f], met: Bool, samples: Samples,
    step: UInt32,
) -> CameraPaths:  # fmt: skip
    """Return paths behind the surface that they met: mirrored, refracted, or straight on."""
    context = mi.BSDFContext()
    context.type_mask = _IDEAL
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    sharp = met & (mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null))
    # In strata over the passes: as often mirrored and as often refracted as the glass would have it.
    lobe, turn = samples.pair(paths.order, _LOBE, step).x, samples.pair(paths.order, _TURN, step)
    # A cut-out surface was drawn to stop the ray: it does not let it through a second time.
    lobe *= viewing.world.opacity(hit, sharp)
    sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(turn), sharp)
    # Some BSDFs, as Mitsuba's `principled` is one, sample their other lobes whatever they are asked for.
    sharp &= (sample.sampled_type & _IDEAL) != 0
    direction = hit.to_world(sample.wo)
    null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    straight = paths.primary & null
    following = CameraPaths()
    factor = dr.select(sharp & (sample.pdf > 0), Array3f(weight), 0)
    following.throughput, following.clear = (each * factor for each in weights)
    spawned = hit.spawn_ray(direction)
    # A primary ray keeps its origin, from which tiles see it; it begins anew where it passed the surface.
    way = dr.dot(Array3f(spawned.o) - paths.origin, paths.direction)
    following.origin = dr.select(straight, paths.origin, Array3f(spawned.o))
    following.direction = dr.select(straight, paths.direction, Array3f(direction))
    following.near = dr.select(straight, way, 0)
    following.far = dr.select(straight, paths.far, dr.largest(Float))
    following.medium = viewing.world.media.beyond(hit, direction, paths.medium, sharp)
    following.depth = paths.depth + dr.select(null, 0, 1)
    following.pixel, following.order, following.primary = paths.pixel, paths.order, straight
    most = dr.max(dr.maximum(following.throughput, following.clear))
    alive = sharp & (most > 0) & _within(viewing, following.depth, 1)
    survival = dr.minimum(most, 0.95)
    tried = following.depth >= dr.opaque(UInt32, viewing.rr_depth)
    survives = samples.single(paths.order, _ROULETTE, step) < survival
    factor = dr.select(tried, dr.rcp(dr.maximum(survival, 1e-30)), 1)
    following.throughput, following.clear = following.throughput * factor, following.clear * factor
    following.alive = alive & (~tried | survives)
    return following
