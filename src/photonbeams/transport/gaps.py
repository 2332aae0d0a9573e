"""Gaps in the way of lamps' light that are finer than its beams: blinds, grilles, leaves.

A beam is a ray with a width, and what passes a gap that is narrower than the beam blurs the dark beside it. A few light
paths of each lamp tell how wide beams are where surfaces are close to their axes: rays from the lamp to places beside a
path's end find the nearest that is in the way on either side. More light paths are narrower, by the same formula that a
render takes (`segments.radii`), so that it also tells how many resolve a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from ..numerics.arrays import taken, to_float, to_numpy, to_uint
from ..numerics.hashing import hash32
from ..numerics.sampling import pairs, sobol_points
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..scene import Array
from ..world.differentials import RayDifferentials
from ..world.emitters.linking import shape_number
from ..world.emitters.rays import EmittedRays
from ..world.warp import facing, perpendicular
from ..world.world import World
from .emission import Stratum
from .segments.radii import width

mi = mitsuba()

# The most light paths of a lamp that are looked at, and the least fraction of them that is enough for a warning.
_PATHS, _LEAST = 1 << 10, 0.04
# Directions across a path, in opposite pairs; and distances from it, up to a beam's width at the path's end.
_SIDES, _STEPS, _PER_OCTAVE = 8, 28, 4
# Surfaces nearer to a path's end than this part of it are what ends it, or stand there. Both sides of a gap are as far
# from the lamp up to this part.
_END, _LEVEL = 0.03, 0.1
_SEED, _DOUBLINGS = 0x47, 12  # of cut-out surfaces; and how often the number of paths is doubled, at most
# A gap is resolved by beams up to so many times as wide: stripes behind a blind then have nine tenths of the contrast
# that far finer beams give, because beams are narrowed behind edges. It is told of wider ones, so that nobody who does
# as told is told again. Stripes that are soft after this part of their way are left out, and all of lamps that cover a
# wider angle, in radians; so many pairs of points of a lamp tell.
_RESOLVED, _TOLD, _SOFT, _WIDEST, _POINTS = 1.1, 1.3, 0.5, 0.3, 4


class Gap(NamedTuple):
    """A gap that is finer than the beams of a lamp.

    `lamp` has the number of the emitter, `surface` the name of the surface beside the gap, "" if it has none, and
    `place` (3,) is in the gap; `size` is the width of the gap, and `beam` that of a beam there, in scene units, the
    mean of all passes. So many times as many light paths, the `factor`, resolve it; infinity if none that are tried do.
    """

    lamp: int
    surface: str
    place: Array
    size: float
    beam: float
    factor: float


def fine_gaps(
    world: World, strata: Iterable[Stratum], overlap: float, scale: float, pixel: Callable[[Array], Array]
) -> Iterator[Gap]:
    """Yield a gap for each lamp of which some beams meet gaps that are finer than they are: the usual one.

    Gaps of less than a pixel are left out, and those whose stripes are soft soon behind them, as under the sky.

    Parameters
    ----------
    strata
        The light paths of a pass.
    overlap, scale
        As in `Tuning`, and the mean factor on radii of all passes.
    pixel
        Returns how large a pixel is at places, (N, 3), in scene units.
    """
    told: set[int] = set()
    # A lamp with a portal has few paths past it, which are wide: those through it count.
    for stratum in sorted(strata, key=lambda each: -each.count):
        lamp, number = stratum.emitter.lamp, stratum.emitter.number
        if stratum.count and lamp.illuminates and lamp.bare.sharp and number not in told:
            gap = _usual(world, stratum, overlap, scale, pixel)
            if gap is not None:
                told.add(number)
                yield gap


class _Axes(NamedTuple):
    """The axes of some beams of a stratum."""

    origin: Array3f
    direction: Array3f
    differentials: RayDifferentials
    paths: Float
    portal: Float
    link: UInt32
    across: Float
    overlap: Float
    scale: Float

    @classmethod
    def of(cls, world: World, rays: EmittedRays, overlap: float, scale: float) -> _Axes | None:
        """Return the axes of some of the rays that have any light; None if none have."""
        lit = np.flatnonzero(dr.max(rays.flux).numpy() > 0)
        if not len(lit):
            return None
        some = to_uint(lit[:: -(-len(lit) // _PATHS)])
        origin, direction = taken(rays.origin, some), taken(rays.direction, some)
        return cls(
            origin, direction, taken(rays.differentials, some), taken(rays.count, some), taken(rays.portal, some),
            taken(rays.link, some), world.bounds.beyond(origin, direction), dr.opaque(Float, overlap),
            dr.opaque(Float, scale),
        )  # fmt: skip

    def radius(self, distance: Float, factor: float = 1.0) -> Float:
        """Return the radii of the beams, of so many times as many paths, at a distance."""
        count = self.paths * dr.opaque(Float, factor)
        own = width(self.differentials, self.direction, self.across, count, self.overlap, self.portal)
        return self.scale * own(distance)

    def widths(self, distance: Array) -> Array:
        """Return the widths of beams at distances, (N,), after each doubling of their number, (doublings + 1, N)."""
        there = to_float(np.where(np.isfinite(distance), distance, 0))
        return np.array([2 * self.radius(there, 2.0**each).numpy() for each in range(_DOUBLINGS + 1)])


class _Gaps(NamedTuple):
    """The gaps that axes pass, in arrays (N,).

    That is their size, infinity without one, how far from the lamp and before the path's end they are, and Mitsuba's
    number of a surface beside them.
    """

    size: Array
    distance: Array
    behind: Array
    surface: Array

    @classmethod
    def of(cls, world: World, axes: _Axes) -> _Gaps:
        """Find the narrowest gaps between surfaces on opposite sides of axes, as far from the lamp as each other."""
        total, shape, *found = _beside(world, axes)
        blocked, off, along, surface = (each.numpy().reshape(shape) for each in found)
        first = blocked.argmax(axis=2)[..., None]
        there, near, distance, number = (
            np.take_along_axis(each, first, axis=2)[..., 0] for each in (blocked, off, along, surface)
        )
        # The edge lies between the ray that is blocked and the one before it.
        near = near * np.where(first[..., 0] > 0, 2 ** (-0.5 / _PER_OCTAVE), 0.5)
        half = _SIDES // 2
        one, other = distance[:, :half], distance[:, half:]
        both = there[:, :half] & there[:, half:] & (np.abs(one - other) <= _LEVEL * np.minimum(one, other))
        sizes = np.where(both, near[:, :half] + near[:, half:], np.inf)
        row, pair = np.arange(len(sizes)), sizes.argmin(axis=1)
        middle = 0.5 * (one + other)[row, pair]
        return cls(sizes[row, pair], middle, total.numpy() - middle, number[row, pair])


def _beside(world: World, axes: _Axes) -> tuple[Any, ...]:
    """Return the axes' lengths, and for rays beside them, (path, side, step), whether and where they are blocked.

    That is how far beside the axis and along it, and by which surface.
    """
    paths, solids = dr.width(axes.origin), world.solids
    seed = hash32(dr.arange(UInt32, paths), UInt32(_SEED))
    hit = solids.first(axes.origin, axes.direction, dr.full(Bool, True, paths), seed, axes.link)
    met = hit.is_valid()
    total = dr.select(met, hit.t, world.escape(axes.origin, axes.direction))
    against = dr.select(met, facing(Array3f(hit.n), axes.direction), -axes.direction)
    end, widest = axes.origin + total * axes.direction, 2 * axes.radius(total)
    dr.eval(total, against, end, widest)

    lane = dr.arange(UInt32, paths * _SIDES * _STEPS) + dr.opaque(UInt32, 0)
    own, angle = lane // (_SIDES * _STEPS), Float(lane // _STEPS % _SIDES) * (2 * np.pi / _SIDES)
    aside = dr.exp2((Float(lane % _STEPS) - (_STEPS - 1)) / _PER_OCTAVE) * taken(widest, own)
    axis, ahead, first, last = (taken(each, own) for each in (axes.direction, against, axes.origin, end))
    s, t = perpendicular(axis)
    ray: Any = last + aside * (dr.cos(angle) * s + dr.sin(angle) * t) - first
    length = dr.norm(ray)
    ray *= dr.rcp(length)
    plane = dr.dot(last - first, ahead) / dr.minimum(dr.dot(ray, ahead), -1e-3)
    beside = solids.first(first, ray, dr.full(Bool, True, dr.width(lane)), taken(seed, own), taken(axes.link, own))
    to: Any = Array3f(beside.p) - first
    along, before = dr.dot(to, axis), 1 - _END
    blocked = beside.is_valid() & (beside.t < before * dr.minimum(plane, length))
    blocked &= along < before * dr.norm(last - first)
    off, surface = dr.norm(to - along * axis), shape_number(beside.shape)
    dr.eval(blocked, off, along, surface)
    return total, (paths, _SIDES, _STEPS), blocked, off, along, surface


def _usual(
    world: World, stratum: Stratum, overlap: float, scale: float, pixel: Callable[[Array], Array]
) -> Gap | None:  # fmt: skip
    """Return the usual gap among those that are finer than a stratum's beams; None if few beams meet any."""
    axes = _Axes.of(world, stratum.emit(0), overlap, scale)
    if axes is None:
        return None
    gaps = _Gaps.of(world, axes)
    there = np.isfinite(gaps.size)
    if not there.any():
        return None
    place: Any = axes.origin + to_float(np.where(there, gaps.distance, 0)) * axes.direction
    # Stripes are looked at as far behind the gap as the lamp is before it.
    angles = _angles(stratum, place)
    soft = _SOFT * angles * np.minimum(gaps.behind, gaps.distance)
    index = np.flatnonzero(there & (gaps.size > np.maximum(soft, pixel(to_numpy(place).T))) & (angles < _WIDEST))
    beams = axes.widths(gaps.distance) / np.where(there, gaps.size, 1)
    # Of a surface with enough gaps, the most first, or of all: many slats may be a surface each.
    names, counts = np.unique(gaps.surface[index], return_counts=True)
    groups = [index[gaps.surface[index] == name] for name in names[np.argsort(-counts)]]
    for own in (*groups, index):
        if len(own) >= max(_LEAST * len(there), 1) and np.median(beams[0, own]) > _TOLD:
            return _gap(world, stratum, gaps, own, beams, to_numpy(place).T)
    return None


def _gap(world: World, stratum: Stratum, gaps: _Gaps, own: Array, beams: Array, place: Array) -> Gap:
    """Return the usual one of some gaps, by the widths of beams relative to them, (doublings + 1, N)."""
    need = np.array([_crossing(beams[:, each] / _RESOLVED) for each in own])
    usual = int(own[np.argsort(need)[len(need) // 2]])
    shapes = world.shapes or [(each.id(), each) for each in world.plugin.shapes()]  # those of Mitsuba's scenes
    names = {int(shape_number(mi.ShapePtr(shape))[0]): name for name, shape in shapes}
    surface, factor = names.get(int(gaps.surface[usual]), ""), float(2.0 ** np.median(need))
    size = float(gaps.size[usual])
    return Gap(stratum.emitter.number, surface, place[usual], size, float(beams[0, usual]) * size, factor)


def _angles(stratum: Stratum, place: Array3f) -> Array:
    """Return about what angles a lamp covers, seen from places, by the directions to points of it."""
    count = dr.width(place)
    index = dr.arange(UInt32, 2 * _POINTS * count) % dr.opaque(UInt32, count)
    sample = pairs(sobol_points(2 * _POINTS * count, 0, (_SEED,)))[0]
    toward = stratum.emitter.lamp.illuminate(taken(place, index), sample).direction
    to = to_numpy(toward).reshape(3, 2, _POINTS, count)
    across: Array = np.linalg.norm(to[:, 0] - to[:, 1], axis=0).mean(axis=0)
    return 2.2 * across  # of a disc, whose points are 0.45 of its diameter apart, on average


def _crossing(ratios: Array) -> float:
    """Return how many doublings bring falling ratios to 1: 0 if they begin there, infinity if none do."""
    below = np.flatnonzero(ratios <= 1)
    if not len(below) or below[0] == 0:
        return 0.0 if len(below) else np.inf
    last = int(below[0])
    before, after = np.log(ratios[last - 1]), np.log(np.maximum(ratios[last], 1e-30))
    return last - 1 + float(before / (before - after))
