"""Gaps in the way of lamps' light that are finer than its beams are wide, and how many beams resolve them.

A beam is a ray with a width, and what passes a gap that is narrower than the beam, as in blinds, grilles and leaves,
blurs the dark beside it. A few light paths of each lamp tell: rays as those that narrow beams look for edges on all
sides, nearer and nearer to the axis. The width w of a beam falls as a power of the number N of paths, by the same
formula that a render takes (`segments.radii`), so a gap of the width g is resolved by

    N · (w(N) / g)^(1 / p),    p = log2(w(N) / w(2 N)).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, log10
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from ...constants import DEFAULT_BEAMS, DEFAULT_PATHS
from ...numerics.arrays import taken, to_float, to_numpy, to_uint
from ...numerics.hashing import hash32, unit_float
from ...numerics.sampling import pairs, sobol_points
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...scene import Array
from ...transport.emission import Stratum
from ...transport.paths import begin
from ...transport.segments.narrowing import WITHIN, beside, stop
from ...transport.segments.radii import width
from ...transport.segments.records import LightPaths
from ...transport.tuning import radius_scale
from ...world.cameras.cameras import View
from ...world.emitters.linking import shape_number
from ...world.warp import perpendicular
from ...world.world import World
from ..light import ShotLight
from ..settings import usual_passes

mi = mitsuba()

# The most light paths of a lamp that are looked at, and the least fraction of them that is enough for a warning.
_PATHS, _LEAST = 1 << 10, 0.04
# Sides of a path, in opposite pairs; and rings around it, each 2^-½ as wide as the one before.
_SIDES, _RINGS = 8, 14
# Surfaces nearer to a path's end than this part of it are what ends it, or stand there. Both sides of a gap are as far
# from the lamp up to this part.
_END, _LEVEL = 0.03, 0.1
_SEED = 0x47  # of the widths of rings
# A gap is resolved by beams up to so many times as wide: stripes behind a blind then have nine tenths of the contrast
# that far finer beams give, because beams are narrowed behind edges. It is told of wider ones, so that nobody who does
# as told is told again. Stripes that are soft after this part of their way are left out, and all of lamps that cover a
# wider angle, in radians; so many pairs of points of a lamp tell.
_RESOLVED, _TOLD, _SOFT, _WIDEST, _POINTS = 1.1, 1.3, 0.5, 0.3, 4
# Passes of which radii are averaged, at most; the most beams that are advised; and from how many on a portal is, too.
_PASSES, _MOST, _MANY = 1024, 1 << 22, 100_000


def sentences(light: ShotLight) -> Iterator[str]:
    """Yield a sentence about each lamp of which some beams meet finer gaps, with what to type."""
    told: set[int] = set()
    # A lamp with a portal has few paths past it, which are wide: those through it count.
    for stratum in sorted(light.simulation.strata(light.world) if light.cameras else (), key=lambda each: -each.count):
        lamp, number = stratum.emitter.lamp, stratum.emitter.number
        if lamp.illuminates and lamp.bare.sharp and number not in told:
            gaps = _Gaps.of(light, stratum)
            usual = None if gaps is None else gaps.usual
            if gaps is not None and usual is not None:
                told.add(number)
                yield _sentence(light, number, gaps, usual)


class _Gaps(NamedTuple):
    """Gaps that beams pass, in arrays (N,).

    `place`, (N, 3), is in the gap; `surface` is Mitsuba's number of one beside it; `size` is its width, and `beam` that
    of a beam there, the mean of all passes; and the number of beams is doubled `doublings` times to resolve it. `least`
    is how many are enough.
    """

    least: float
    place: Array
    surface: Array
    size: Array
    beam: Array
    doublings: Array

    @classmethod
    def of(cls, light: ShotLight, stratum: Stratum) -> _Gaps | None:
        """Find gaps, up to the width of beams; None if there are none.

        Gaps of less than a pixel are left out, and those whose stripes are soft soon behind them, as under the sky.
        """
        settings, world = light.settings, light.world
        begun = begin(light.simulation.tracer(world, [stratum]).tracing(0), [stratum.emit(0)])
        if begun is None:
            return None
        paths = taken(begun, to_uint(np.arange(0, dr.width(begun.total), -(-dr.width(begun.total) // _PATHS))))
        stop(world, paths)
        least = max(_LEAST * dr.width(paths.total), 1)
        passes = min(settings.passes if settings.error is None else usual_passes(None), _PASSES)
        scale = float(np.mean([radius_scale(settings.alpha, number) for number in range(passes)]))
        near, far = _edges(world, paths, scale * paths.width(paths.total))
        size, middle, side = _between(near, far)
        index = np.flatnonzero(np.isfinite(size))
        if not len(index):
            return None
        paths, size, side = taken(paths, to_uint(index)), size[index], side[index]
        along, aside, ahead = (to_float(each) for each in (middle[index], near[side, index], far[side, index]))
        x, y = perpendicular(paths.direction)
        sine, cosine = dr.sincos(to_float(side * (2 * np.pi / _SIDES)))
        center: Any = paths.origin + along * paths.direction
        edge = dr.normalize(ahead * paths.direction + aside * (cosine * x + sine * y))
        met = world.solids.first(paths.origin, edge, Bool(True), hash32(paths.index, paths.key), paths.link)
        across = world.bounds.beyond(paths.origin, paths.direction)
        overlap = dr.opaque(Float, settings.overlap)
        finer = width(paths.differentials, paths.direction, across, 2 * paths.count, overlap, paths.portal)
        beam, half = (2 * scale * each(along).numpy().astype(np.float64) for each in (paths.width, finer))
        doublings = np.log2(beam / (_RESOLVED * size)) / np.maximum(np.log2(beam / half), 1e-3)
        place, angles = to_numpy(center).T, _angles(stratum, center)
        # Stripes are looked at as far behind the gap as the lamp is before it.
        soft = _SOFT * angles * np.minimum((paths.total - along).numpy(), along.numpy())
        pixel = np.min([_pixel(each, place) for each in light.cameras], axis=0)
        told = (size > np.maximum(soft, pixel)) & (angles < _WIDEST)
        return cls(least, *(each[told] for each in (place, shape_number(met.shape).numpy(), size, beam, doublings)))

    @property
    def usual(self) -> int | None:
        """The index of the usual gap; None if too few are finer than beams.

        It is that of a surface with enough gaps, the most first, or of all: many slats may be a surface each.
        """
        names, counts = np.unique(self.surface, return_counts=True)
        groups = [np.flatnonzero(self.surface == name) for name in names[np.argsort(-counts)]]
        for own in (*groups, np.arange(len(self.size))):
            if len(own) >= self.least and np.median(self.beam[own] / self.size[own]) > _TOLD:
                return int(own[np.argsort(self.doublings[own])[len(own) // 2]])
        return None


def _edges(world: World, paths: LightPaths, radius: Float) -> tuple[Array, Array]:
    """Return how far from axes the nearest surfaces on each side are, up to beams' widths, and from the lamp, (S, N).

    `radius` is that of beams at their ends. Distances are infinite where nothing is.
    """
    near, along = ([dr.full(Float, dr.inf, dr.width(radius))] * _SIDES for _ in range(2))
    jitter = unit_float(hash32(paths.index, paths.key, UInt32(_SEED)))
    for ring in range(_RINGS):
        at_end = 2 * radius * dr.exp2(-0.5 * (jitter + dr.opaque(Float, ring)))
        met = [*beside(world, paths, Float(0), at_end, Bool(True), _SIDES)]
        for side, there in enumerate(met):
            blocked = there < (1 - _END) * paths.total
            near[side] = dr.select(blocked, at_end * there / paths.total, near[side])
            along[side] = dr.select(blocked, there, along[side])
        dr.eval(near, along)
    return np.array([each.numpy() for each in near]), np.array([each.numpy() for each in along])


def _between(near: Array, along: Array) -> tuple[Array, ...]:
    """Return the widths of the narrowest gaps between opposite edges as far from the lamp as each other, (N,).

    Return, too, how far from the lamp they are, and the side of one of the edges.
    """
    (a, b), (s, t) = np.split(near, 2), np.split(along, 2)
    with np.errstate(invalid="ignore"):
        sizes = np.where(np.abs(s - t) <= _LEVEL * np.minimum(s, t), WITHIN * (a + b), np.inf)
        middle = (b * s + a * t) / (a + b)  # where the line from one edge to the other crosses the axis
    side, every = sizes.argmin(axis=0), np.arange(sizes.shape[1])
    return sizes[side, every], middle[side, every], side


def _angles(stratum: Stratum, place: Array3f) -> Array:
    """Return about what angles a lamp covers, seen from places, by the directions to points of it."""
    samples = (pairs(sobol_points(dr.width(place), block, (_SEED,)))[0] for block in range(2 * _POINTS))
    to = [to_numpy(stratum.emitter.lamp.illuminate(place, each).direction) for each in samples]
    across = [np.linalg.norm(one - other, axis=0) for one, other in zip(to[::2], to[1::2], strict=True)]
    return 2.2 * np.mean(across, axis=0)  # of a disc, whose points are 0.45 of its diameter apart, on average


def _pixel(view: View, places: Array) -> Array:
    """Return how large a pixel of a view is at places, (N, 3), in scene units."""
    scale, camera = float(np.max(view.pixels_per_tangent)), view.camera
    if camera.orthographic:
        return np.full(len(places), 1 / scale)
    distance: Array = np.linalg.norm(places - np.asarray(camera.to_world)[:3, 3], axis=1)
    return distance / scale


def _sentence(light: ShotLight, number: int, gaps: _Gaps, usual: int) -> str:
    """Return what is said of a gap that is finer than beams of a lamp."""
    world, emitter = light.world, light.world.emitters[number]
    shapes = world.shapes or [(each.id(), each) for each in world.plugin.shapes()]  # those of Mitsuba's scenes
    names = {int(shape_number(mi.ShapePtr(shape))[0]): name for name, shape in shapes}
    surface = names.get(int(gaps.surface[usual]), "")
    where = f"gaps of {surface}" if surface else f"gaps near {' '.join(f'{each:.3g}' for each in gaps.place[usual])}"
    who = f"{where} are {gaps.size[usual]:.3g} units wide"
    what = f"{who}, but beams of {emitter.name or 'a lamp'} {gaps.beam[usual]:.3g} there, so that their stripes blur"
    own, default = emitter.beams.beam_count, DEFAULT_PATHS if world.emits else DEFAULT_BEAMS
    count = np.exp2(min(gaps.doublings[usual], 64)) * (light.settings.beams or default if own is None else own)
    portal = "a photonbeams:portal around the gaps"
    if count > _MOST:
        return f"{what}: expected more than {_MOST:,} beams" + ("" if emitter.portal else f", or {portal}")
    step = 10 ** max(int(log10(count)) - 1, 0)  # two digits
    amount = step * ceil(count / step)
    more = f"--beams {amount}" if own is None else f"--set {emitter.name}.photonbeams:count={amount}"
    return f"{what}: expected {more}" + (f", or {portal}" if amount > _MANY and emitter.portal is None else "")
