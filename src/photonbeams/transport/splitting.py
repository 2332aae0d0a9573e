"""Split light paths into parts that carry about equal flux (Kirk & Arvo 1991, "Unbiased Sampling Techniques").

Light that comes straight from its lamp, or by mirrors and lenses, follows *coherent* paths, whose neighbours are known.
Some of it is scattered on the way (in thin fog, a few hundredths), and much of it is reflected by the surface at the
end. One path for each would leave few bright beams among many dark ones. So the coherent path goes on by ideal lobes
alone. For the rest of its light new paths begin, as many as are needed for each to carry about the same flux.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ..numerics.arrays import taken, to_float, to_numpy, to_uint
from ..numerics.hashing import hash32, unit_float
from ..numerics.streams import Stream
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..world.spectra import rgb
from .interactions import IDEAL, REFLECTED, SAMPLED, SCATTERED
from .segments.records import Counts, LightPaths

if TYPE_CHECKING:
    from .tracing import Tracing

mi = mitsuba()

# Least reflectance that is assumed, because some BSDFs do not know theirs.
_LEAST = 0.05
_DARK = 1e-30


def split(tracing: Tracing, paths: LightPaths, step: int) -> LightPaths:
    """Return paths before step number `step`, and the parts split off for light that is scattered or reflected."""
    able = divisible(tracing, paths)
    goes_on = continued(able)
    if not bool(dr.any(able)):
        paths.branch = goes_on
        return paths
    # What is scattered or reflected counts only if more than caustics does.
    able &= paths.counting(Counts.FURTHER, Counts.CAUSTICS)
    able &= tracing.within(paths.depth + 1, paths.source)  # no part that would exceed the depth
    seed = hash32(paths.key, dr.opaque(UInt32, step), paths.index)
    light = scattered_and_reflected(tracing, paths, able, seed)
    chance = [unit_float(hash32(seed, UInt32(Stream.ROUNDING), UInt32(kind))) for kind in (SCATTERED, REFLECTED)]
    dr.eval(goes_on, light, chance)
    found = np.nan_to_num(to_numpy(light).astype(np.float64), posinf=0.0)
    lamp, width = np.unique(paths.key.numpy(), return_inverse=True)[1].ravel(), dr.width(paths.key)
    # Rows of the paths themselves, then of copies: origin, branch, number among the copies, factor on the flux, share.
    columns = [(np.arange(width), goes_on.numpy(), np.zeros(width), np.ones(width), np.zeros(width))]
    for branch, own, turn in zip((SCATTERED, REFLECTED), found, chance, strict=True):
        # Each lamp has its own share, and so keeps its number of paths: a dim one may be all that lights a corner.
        share = (np.bincount(lamp, own) / np.maximum(np.bincount(lamp, own > 0), 1))[lamp]
        mean = own / np.maximum(share, _DARK)
        count = (mean + turn.numpy()).astype(np.int64)
        origin = np.repeat(np.arange(width), count)
        number = np.arange(len(origin)) - np.repeat(np.cumsum(count) - count, count) + 1
        columns.append((origin, np.full(len(origin), branch), number, 1 / mean[origin], share[origin]))
    origin, branches, number, factor, share = (np.concatenate(each) for each in zip(*columns, strict=True))
    result: LightPaths = taken(paths, to_uint(origin))
    result.flux = result.flux * to_float(factor)
    result.branch = to_uint(branches)
    copies = to_uint(number)
    result.part = dr.select(copies > 0, copies, result.part)
    result.initial = dr.select(copies > 0, to_float(share), result.initial)
    dr.eval(result)
    return result


def divisible(tracing: Tracing, paths: LightPaths) -> Bool:
    """Return which paths go on by ideal lobes alone, because other paths carry the rest of their light."""
    varying, _ = tracing.world.media.varying(paths.medium)
    return paths.coherent & ~varying & Bool(not tracing.short)


def continued(able: Bool) -> UInt32:
    """Return the kinds of the next interaction of paths, of which some are `divisible`."""
    return dr.select(able, UInt32(IDEAL), UInt32(SAMPLED))


def scattered_and_reflected(
    tracing: Tracing, paths: LightPaths, able: Bool, seed: UInt32
) -> tuple[Float, Float]:  # fmt: skip
    """Return about how much of the paths' light the medium scatters, and the next surface reflects."""
    world, media = tracing.world, tracing.world.media
    hit = world.intersect(paths.origin, paths.direction, able, seed, paths.link)
    valid = able & hit.is_valid()
    length = dr.minimum(dr.select(valid, hit.t, paths.reach), 1e30)
    albedo = media.scattering(paths.medium) * dr.rcp(dr.maximum(media.extinction(paths.medium), 1e-30))
    passed = media.absorbed(paths.medium, length)
    if media.any_varying:  # an estimate, which may be 0 where some light passes, or 1 where some is scattered
        varying, _ = media.varying(paths.medium)
        found = media.transmittance(paths.medium, paths.origin, paths.direction, length, seed, able)
        passed = dr.select(varying, dr.clip(found, _LEAST, 1 - _LEAST), passed)
    scattered = paths.flux * albedo * (1 - passed)
    bsdf = hit.bsdf()
    smooth = valid & (mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) | Bool(bool(world.cutouts)))
    # Too many dark parts are better than few bright ones: what has glossy lobes may be metal, so it counts as 1.
    reflectance = dr.clip(rgb(bsdf.eval_diffuse_reflectance(hit, smooth)), _LEAST, 1)
    reflectance = dr.select(mi.has_flag(bsdf.flags(), mi.BSDFFlags.Glossy), 1, reflectance)
    reflected = paths.flux * passed * reflectance
    inside = able & (paths.medium > 0)
    return dr.select(inside, dr.max(Array3f(scattered)), 0), dr.select(smooth, dr.max(Array3f(reflected)), 0)
