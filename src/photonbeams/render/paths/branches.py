"""How camera paths continue at boundaries, mirrors and glass: by a sample of the BSDF, or in two branches, one a lobe.

At the first two times that a path meets glass, reflection and refraction are both followed: a random choice between
them would leave grain that only many passes remove.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr

from ...numerics.arrays import joined
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.shadow_rays import leaving
from ...world.spectra import rgb

if TYPE_CHECKING:
    from .camera_paths import CameraTracing

mi = mitsuba()

#: Lobes by which camera paths continue.
IDEAL = int(mi.BSDFFlags.Delta | mi.BSDFFlags.Null)

#: Steps after which paths end if nothing else ends them, as between two mirrors.
STEPS = 128

# The least step beyond a surface: a fraction of the gap beside it, so that thin things are not left out; and a few
# units in the last place of the distance from the camera.
_LEAST_STEP, _ROUNDED = 0.1, 4e-7

# How often a path splits in two, and the throughput below which branches end by Russian roulette.
_SPLITS, _NEGLIGIBLE = 2, 1 / 8
# A sample that selects the last of a BSDF's lobes, where 0 selects the first.
_LAST = 1 - 2**-24


class CameraPaths(Struct):
    """Camera paths: rays that begin at the distance `near`.

    Attributes
    ----------
    throughput, clear
        The path's throughput, and the throughput without the transmittance of beams-only media.
    medium
        Number of the medium around the path.
    pixel, order
        The path's pixel, and the pixel's place in the sample sequences.
    branch, splits
        The path's number among those of its pixel's sample, and how often it has split.
    primary
        Whether the path is still on the pixel's own straight ray.
    depth
        Specular bounces so far.
    flown
        Distance that the path has come straight, up to `near`.
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
    branch: UInt32
    splits: UInt32
    primary: Bool
    depth: UInt32
    alive: Bool
    flown: Float


class _Lobe(NamedTuple):
    """A sample of ideal lobes and its weight, whether the path has split, and the branch that continues by it."""

    sample: Any
    weight: Any
    split: Bool
    branch: UInt32


def several(paths: CameraPaths) -> CameraPaths:
    """Return the paths, with a single path twice: Dr.Jit treats arrays of one entry as scalars, in other kernels."""
    if dr.width(paths.pixel) > 1:
        return paths
    twice: CameraPaths = joined([paths, paths])
    twice.alive = dr.arange(UInt32, 2) == dr.opaque(UInt32, 0)
    dr.eval(twice)
    return twice


def add_to_pixels(total: Any, values: Any, pixel: UInt32, branch: UInt32, active: Any = True) -> None:
    """Add values of paths to the sums of their pixels, branch by branch, so that the order is always the same.

    A pixel has one path in each branch, so no two writes conflict. Dr.Jit's default, a copy for each thread, would
    write the size of the copies into the kernel.
    """
    for number in range(int(dr.max(branch)[0]) + 1):
        own = Bool(active) & (branch == dr.opaque(UInt32, number))
        dr.scatter_add(total, values, pixel, own, dr.ReduceMode.NoConflicts)
        dr.eval(total)


def onward(
    tracing: CameraTracing, paths: CameraPaths, hit: Any, weights: tuple[Array3f, Array3f], met: Bool, samples: Samples,
    name: UInt32,
) -> list[CameraPaths]:  # fmt: skip
    """Return the paths continued from the surface (reflected, refracted or straight through), then those split off."""
    context = mi.BSDFContext()
    context.type_mask = IDEAL
    bsdf = hit.bsdf()
    flags = bsdf.flags()
    sharp = met & (mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null))
    # Stratified over the passes: glass reflects and refracts each pixel's paths in the right proportion.
    lobe, turn = (
        samples.pair(paths.order, Stream.BRANCH_LOBE, name).x,
        mi.Point2f(samples.pair(paths.order, Stream.BRANCH_TURN, name)),
    )
    # A cut-out surface was already sampled as opaque: its null lobe is not sampled again.
    opacity = tracing.world.opacity(hit, sharp)
    lobe *= opacity
    sample, weight = bsdf.sample(context, hit, lobe, turn, sharp)
    # Some BSDFs ignore the mask: Mitsuba's `principled` samples all its lobes.
    sharp &= (sample.sampled_type & IDEAL) != 0
    factor = dr.select(sharp & (sample.pdf > 0), rgb(weight), 0)
    if not tracing.splitting:
        only = _Lobe(sample, factor, Bool(False), paths.branch)
        return [_continued(tracing, paths, hit, weights, only, name, samples)]
    # The lobes of glass are reflection and then refraction (or nothing, of thin glass), and there are no others.
    last = mi.has_flag(sample.sampled_type, mi.BSDFFlags.DeltaReflection)
    able = sharp & (paths.splits < _SPLITS)
    other, weight = bsdf.sample(context, hit, dr.select(last, Float(_LAST), 0), turn, able)
    split = able & (sample.pdf > 0) & (other.pdf > 0) & (sample.sampled_type != other.sampled_type)
    split &= dr.abs(sample.pdf + other.pdf - 1) < 1e-4
    # Whether light passes was decided when a cut-out surface stopped the path.
    split &= ~mi.has_flag(other.sampled_type, mi.BSDFFlags.Null) | (opacity == 1)
    factor *= dr.select(split, sample.pdf, 1)
    rest = dr.select(split, rgb(weight) * other.pdf, 0)
    # The straight path stays the pixel's own ray, for which beams are gathered by tiles.
    swapped = split & paths.primary & mi.has_flag(other.sampled_type, mi.BSDFFlags.Null)
    first, second = dr.select(swapped, other, sample), dr.select(swapped, sample, other)
    factor, rest = dr.select(swapped, rest, factor), dr.select(swapped, factor, rest)
    step = UInt32(1) << paths.splits
    lobes = _Lobe(first, factor, split, paths.branch), _Lobe(second, rest, split, paths.branch + step)
    names = name, name + STEPS * step
    return [
        _continued(tracing, paths, hit, weights, each, own, samples) for each, own in zip(lobes, names, strict=True)
    ]


def _continued(
    tracing: CameraTracing, paths: CameraPaths, hit: Any, weights: tuple[Array3f, Array3f], lobe: _Lobe,
    name: UInt32, samples: Samples,
) -> CameraPaths:  # fmt: skip
    """Return the paths continued by a lobe."""
    sample, factor, split, branch = lobe
    direction = hit.to_world(sample.wo)
    null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    straight = paths.primary & null
    following = CameraPaths()
    throughput, clear = (each * factor for each in weights)
    spawned = leaving(hit, direction, tracing.world.size)
    # A primary ray keeps its origin, for the tiles; its `near` moves to the surface that it has passed.
    # Along a surface the gap beside it brings no progress: without a least step, such a ray would meet it for ever.
    reached = dr.dot(hit.p - paths.origin, paths.direction)
    least = dr.maximum(_LEAST_STEP * dr.norm(spawned - hit.p), _ROUNDED * reached)
    distance = dr.maximum(dr.dot(spawned - paths.origin, paths.direction), reached + least)
    following.origin = dr.select(straight, paths.origin, spawned)
    following.direction = dr.select(straight, paths.direction, Array3f(direction))
    following.near = dr.select(straight, distance, 0)
    following.far = dr.select(straight, paths.far, dr.largest(Float))
    alive = dr.max(factor) > 0
    following.medium = tracing.world.media.beyond(hit, direction, paths.medium, alive)
    following.depth = paths.depth + dr.select(null, 0, 1)
    following.pixel, following.order, following.primary = paths.pixel, paths.order, straight
    following.branch, following.splits = branch, paths.splits + dr.select(split, UInt32(1), 0)
    following.flown = dr.select(null, paths.flown + distance - paths.near, 0)
    most = dr.max(dr.maximum(throughput, clear))
    alive &= (most > 0) & tracing.within(following.depth, 1)
    tried = following.depth >= dr.opaque(UInt32, tracing.rr_depth)
    survival = dr.select(tried, dr.minimum(most, 0.95), 1)
    survival = dr.minimum(survival, dr.select(split, most * (1 / _NEGLIGIBLE), 1))
    survives = samples.single(paths.order, Stream.BRANCH_ROULETTE, name) < survival
    factor = dr.rcp(dr.maximum(survival, 1e-30))
    following.throughput, following.clear = throughput * factor, clear * factor
    following.alive = alive & survives
    return following
