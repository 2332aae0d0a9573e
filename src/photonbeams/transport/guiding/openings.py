"""Openings: rectangles in walls through which an emitter lights what cameras see, such as windows and holes.

A pilot knows which light paths of an emitter cameras see. Where surfaces stop those beside them in a plane, but not
these, there is an opening. If most of the visible light comes through one, it is better to send paths through it, as
through a portal that somebody has placed: samples are then stratified on the emitter and in the rectangle, and few of
them are blocked. The other paths go past the rectangle, so no light is lost wherever it is. (For portals of
environments, see Bitterli, Novák and Jarosz 2015.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...numerics.arrays import to_numpy
from ...numerics.sampling import pairs, sobol_points
from ...runtime.device import Array3f, Float, UInt32, mitsuba
from ...scene import Array
from ...world.emitters.portals import Portal
from ...world.emitters.rectangles import Sides, mesh_of, widened
from ...world.media.visibility import through
from ...world.surfaces.shapes import shape_of
from ..emission import PathEmitter, Stratum

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene

mi = mitsuba()

# The fewest visible paths to which a rectangle is fitted. They pass a plane if they get farther by this fraction.
_FEWEST, _END = 24, 1e-3
# The number of angles of rectangles in a plane, and the fractions of visible light that one may leave out along either
# axis.
_ANGLES, _TRIMS = 6, (0.0, 0.005, 0.02, 0.05, 0.1, 0.2)
# Rectangles are wider on each side than the known paths through them, by this fraction, or by that of so many paths.
_MARGIN, _MARGIN_PATHS = 0.02, 2.0
# Paths are beside visible ones up to so many times as far as these are from their middle. Numbers of walls that are
# tried, and of points that tell of walls. Points belong to one wall if the cosine between their normals is more than
# _FLAT, and their distance from its plane is less than _THICK of their spread.
_BESIDE, _WALLS, _TRIED, _FLAT, _THICK = 3.0, 4, 64, 0.99, 0.003
# Number of rays that measure how far light gets around a rectangle, in one three times as long and wide; the fraction
# of the usual distance that they must get beyond it; the number of strips along that, and how bright a strip is at
# least, relative to those of the rectangle.
_PROBES, _BEYOND, _STRIPS, _DARK = 1 << 13, 0.25, 30, 0.1
#: The box of a whole rectangle, (2, 2) by axis and end.
UNIT = np.array([[0.0, 1.0], [0.0, 1.0]])
_AROUND = np.array([[-0.5, 1.5]] * 2)  # a box around it, in which walls stop light
# Bounds of the fraction of paths that goes through the rectangle.
_SHARES = (0.75, 0.9)
# A dark strip parts a bundle if it is wider than this fraction of the narrower of both parts, so that the bars of a
# window do not part it; and than so many times the widest gap that is usual among as many uniform points.
_WIDE, _SURE = 0.5, 3.0
# Parts of a bundle with fewer of its visible paths are no openings.
_PART = 0.02
# The least fraction of the light around an opening that its wall stops; and in so many rounds it becomes wider, because
# cameras may see only a part of the light through it.
_STOPPED, _ROUNDS = 0.5, 3


@dataclass(frozen=True)
class TracedRays:
    """Rays of an emitter, (N, 3), their flux in the brightest channel, (N,), and how far they get.

    `normal`, (N, 3), is that of the surface that stops a ray; NaN if none does.
    """

    origin: Array
    direction: Array
    flux: Array
    length: Array
    normal: Array

    @classmethod
    def of(cls, emitter: PathEmitter, samples: Array) -> TracedRays:
        """Trace rays with these emission samples, (N, 4)."""
        world, lane = emitter.world, dr.arange(UInt32, len(samples))
        sample = emitter.sample(*pairs(samples.astype(np.float32)))
        ray = mi.Ray3f(mi.Point3f(sample.origin), mi.Vector3f(sample.direction))
        flux = dr.select(sample.valid, dr.max(sample.flux), 0) + dr.zeros(Float, len(samples))
        _, hit = through(world.plugin, world.media, ray, sample.medium + 0 * lane, lane, flux > 0)
        met = hit.is_valid()
        normal = dr.select(met, Array3f(hit.n), dr.nan)
        length = dr.select(met, dr.norm(Array3f(hit.p) - sample.origin), sample.reach)
        vectors = [each + dr.zeros(Array3f, len(samples)) for each in (sample.origin, sample.direction, normal)]
        dr.eval(vectors, flux, length)
        origin, direction, upward = (to_numpy(each).T.astype(np.float64) for each in vectors)
        known = np.nan_to_num(flux.numpy().astype(np.float64), posinf=0)
        return cls(origin, direction, known, length.numpy().astype(np.float64), upward)

    def crossed(self, point: Array, axes: Array) -> tuple[Array, Array]:
        """Return where rays cross a plane, (2, N) along `axes` from `point`, and how far away; infinite if nowhere."""
        normal = np.cross(*axes)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = ((point - self.origin) @ normal) / (self.direction @ normal)
        crosses = np.isfinite(distance) & (distance > 0)
        local = axes @ (self.origin + np.where(crosses, distance, 0)[:, None] * self.direction - point).T
        return np.where(crosses, local, np.inf), np.where(crosses, distance, np.inf)


@dataclass(frozen=True)
class Bundle:
    """Light paths as they leave their emitter, with the light that each stands for, (N,).

    `light` is their flux and `seen` is what cameras see of it; each sums to 1. `room` is the variance of visible light
    by guided paths, relative to that by uniform ones.
    """

    emitter: PathEmitter
    rays: TracedRays
    light: Array
    seen: Array
    room: float = 1.0

    def planes(self) -> list[tuple[Array, Array]]:
        """Return planes that stop paths beside the visible ones, a normal and a point of each; last, one across these.

        The last one is as far away as most of these surfaces, which may be bent.
        """
        rays, seen = self.rays, self.seen
        middle = np.median(rays.length[seen > 0])
        ends = rays.origin + np.minimum(rays.length, middle)[:, None] * rays.direction
        mean, place = (np.average(each, axis=0, weights=seen) for each in (rays.direction, ends))
        to = place - rays.origin
        aside = np.linalg.norm(to - (to * rays.direction).sum(axis=1, keepdims=True) * rays.direction, axis=1)
        turn = np.linalg.norm(rays.direction - mean, axis=1)
        beside = np.isfinite(rays.normal).all(axis=1) & (rays.length <= middle)
        for each in (aside, turn):
            beside &= each <= _BESIDE * np.sqrt(seen @ each**2)
        blocked = beside & (seen == 0)
        across = mean / max(float(np.linalg.norm(mean)), 1e-30)
        result = [(across, np.median(ends[blocked], axis=0))] if blocked.any() else []
        some = np.flatnonzero(beside)[:: max(np.count_nonzero(beside) // _TRIED, 1)]
        points, normals = ends[some], rays.normal[some]
        size = np.ptp(points, axis=0).max() if len(some) else 0.0
        same = np.abs(normals @ normals.T) > _FLAT
        same &= np.abs(((points[:, None] - points) * normals[:, None]).sum(axis=2)) < _THICK * size
        for _ in range(_WALLS if len(some) else 0):
            best = int(same.sum(axis=1).argmax())
            if np.count_nonzero(same[best]) > 1:
                result.insert(-1, (normals[best], points[best]))
            same[:, same[best].copy()] = False
        return result


@dataclass(frozen=True)
class FittedRectangle:
    """A rectangle: its corner, (3,), and its edges, (2, 3).

    `inside` says which paths of the bundle pass it, (N,). `seen` and `light` are the fractions of visible light and of
    all light that pass it. `aside` is the variance of paths past it, relative to that of uniform ones.
    """

    corner: Array
    edges: Array
    inside: Array
    seen: float
    light: float
    aside: float

    @property
    def share(self) -> float:
        """The best fraction of paths to send through it: fractions are proportional to the roots of variances."""
        through, aside = np.sqrt([self.seen * self.light, (1 - self.seen) * (1 - self.light) * self.aside])
        return float(np.clip(through / max(through + aside, 1e-30), *_SHARES))

    @property
    def variance(self) -> float:
        """The variance of visible light through it and past it, relative to that of paths in all directions."""
        share = self.share
        through, aside = self.seen * self.light / share, (1 - self.seen) * (1 - self.light) * self.aside / (1 - share)
        return through + aside

    @property
    def sides(self) -> Sides:
        """The corner, and each of the edges."""
        return self.corner, self.edges[0], self.edges[1]

    def portal(self, host: MiScene, wider: float = 0.0) -> Portal:
        """Return the rectangle as a portal (see `scene_of` for `host`), wider by a fraction `wider` on each side."""
        mesh = mesh_of("fitted portal", widened(self.sides, wider))
        return Portal(mesh, shape_of(mesh), host)

    def crossed(self, rays: TracedRays) -> tuple[Array, Array]:
        """Return where rays cross its plane, (2, N) in units of its edges, and the distances to there, (N,)."""
        return rays.crossed(self.corner, self.edges / (self.edges**2).sum(axis=1, keepdims=True))

    def cut(self, box: Array, bundle: Bundle) -> FittedRectangle:
        """Return the part of its plane in a box, (2, 2) by axis and end in units of its edges."""
        inside = _within(self.crossed(bundle.rays)[0], box)
        seen, light = (min(float(each[inside].sum()), 1.0) for each in (bundle.seen, bundle.light))
        edges = np.diff(box, axis=1) * self.edges
        return FittedRectangle(self.corner + box[:, 0] @ self.edges, edges, inside, seen, light, bundle.room)


@dataclass(frozen=True)
class Opening:
    """A fitted portal, and the fraction of a stratum's paths that goes through it."""

    portal: Portal
    share: float


def parted(stratum: Stratum, opening: Opening | None) -> list[Stratum]:
    """Return a stratum as two, of the paths through an opening and past it; without an opening, as it is."""
    if opening is None:
        return [stratum]
    emitter: Any = stratum.emitter
    through = min(max(round(opening.share * stratum.count), 1), max(stratum.count - 1, 1))
    counts = {True: through, False: max(stratum.count - through, 1)}
    return [
        Stratum(emitter.at(opening.portal, passes), count, (*stratum.sequence, 3, passes), stratum.fixed)
        for passes, count in counts.items()
    ]


def fitted(bundle: Bundle, most: float) -> FittedRectangle | None:
    """Return the opening that most visible light comes through, as a rectangle up to the wall's edges.

    None if there is no hole in a wall whose rectangle leaves less than `most` of the variance by uniform samples.
    """
    around = _best(bundle, most)
    result = None if around is None else _grown(around, bundle)
    return result if result is not None and result.variance < most else None


def openings(bundle: Bundle) -> list[FittedRectangle]:
    """Return all openings: one for each part of the visible light with dark strips around it, as behind windows."""
    around = _best(bundle, np.inf)
    if around is None:
        return []
    local, distance = around.rectangle.crossed(bundle.rays)
    passes = bundle.rays.length > (1 + _END) * distance
    index, others = (np.flatnonzero((bundle.seen > 0) & (passes == each)) for each in (True, False))
    parts = _cut((local * np.linalg.norm(around.rectangle.edges, axis=1)[:, None])[:, index].T, index)
    whole = _grown(around, bundle) if len(parts) == 1 else None
    result = [] if whole is None else [whole]
    for part in (*(parts if len(parts) > 1 else ()), others):
        seen = np.zeros(len(bundle.seen))
        seen[part] = bundle.seen[part]
        for each in result:
            seen[each.inside] = 0
        if np.count_nonzero(seen) >= max(_FEWEST, _PART * np.count_nonzero(bundle.seen)):
            result += openings(replace(bundle, seen=seen / seen.sum()))
    return result


def _best(bundle: Bundle, most: float) -> _ProbeRays | None:
    """Return what is around the rectangle in whose plane most of the light beside it is stopped; None without any."""
    fits = (_fitted_in(bundle, *each) for each in bundle.planes())
    tried = [_ProbeRays.of(each, bundle.emitter) for each in fits if each is not None and each.variance < most]
    return max(tried, key=lambda each: each.stopped, default=None)


def _grown(around: _ProbeRays, bundle: Bundle) -> FittedRectangle | None:
    """Return a rectangle with its sides moved outward to the wall's edges; None if it is no hole in anything.

    In each of several rounds it may become three times as wide. A floor, too, is in the way of light.
    """
    for _ in range(_ROUNDS):
        box, dark = around.box()
        around = _ProbeRays.of(around.rectangle.cut(box, bundle), bundle.emitter)
        if dark:
            break
    sizes = np.linalg.norm(around.rectangle.edges, axis=1)
    hole = dark and around.stopped > _STOPPED and sizes.max() <= bundle.emitter.world.extent
    return around.rectangle if hole else None


def _fitted_in(bundle: Bundle, normal: Array, point: Array) -> FittedRectangle | None:
    """Return the rectangle in a plane that leaves the least variance; None if little visible light crosses that."""
    x = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(normal, x)])
    local, distance = bundle.rays.crossed(point, axes)
    passes = bundle.rays.length > (1 + _END) * distance
    known = passes & (bundle.seen > 0)
    if bundle.seen[known].sum() < 0.5 or np.count_nonzero(known) < _FEWEST:
        return None
    angle = np.arange(_ANGLES) / _ANGLES * (np.pi / 2)
    turns = np.moveaxis(np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]), 2, 0)
    places = np.sort(turns @ local[:, known])
    outer = places.shape[2] // 50  # the outermost paths on either side do not count
    turn = turns[np.argmin(np.prod(places[:, :, -1 - outer] - places[:, :, outer], axis=1))]
    turned, result = turn @ local[:, known], []
    for (left, right), (low, high) in zip(*(_shortest(each, bundle.seen[known]) for each in turned), strict=True):
        box: Array = np.array([[left, right], [low, high]])
        margin = max(_MARGIN, _MARGIN_PATHS / max(int(np.count_nonzero(_within(turned, box))), 1))
        plane = FittedRectangle(point, turn @ axes, known, 0.0, 0.0, 0.0)
        result.append(plane.cut(box + margin * np.diff(box, axis=1) * [-1, 1], bundle))
    return min(result, key=lambda each: each.variance)


@dataclass(frozen=True)
class _ProbeRays:
    """Rays of an emitter through a rectangle and around it, with their `flux`, (N,).

    `local` is where they cross its plane, (2, N) in units of its edges; `beyond` is how far they get from there, (N,),
    relative to what is usual inside.
    """

    rectangle: FittedRectangle
    flux: Array
    local: Array
    beyond: Array

    @classmethod
    def of(cls, rectangle: FittedRectangle, emitter: PathEmitter) -> _ProbeRays:
        """Trace rays."""
        portal = rectangle.portal(emitter.world.host, wider=1.0)
        rays = TracedRays.of(emitter.at(portal, True), sobol_points(_PROBES, 0, (_PROBES,)))
        local, distance = rectangle.crossed(rays)
        beyond = np.where(np.isfinite(distance), rays.length - distance, -1)
        inside = beyond[_within(local, UNIT) & (rays.flux > 0) & (beyond > 0)]
        usual = float(np.median(inside)) if len(inside) else np.inf
        return cls(rectangle, rays.flux, local, beyond / usual)

    @property
    def stopped(self) -> float:
        """The fraction of the light beside the rectangle that is stopped near its plane; 0 if there is next to none."""
        inside = _within(self.local, UNIT)
        beside = _within(self.local, _AROUND) & ~inside
        light, room = self.flux[beside].sum(), np.prod(np.diff(_AROUND, axis=1)) - 1
        if light < _DARK * room * self.flux[inside].sum():
            return 0.0
        near = np.maximum(1 - np.abs(self.beyond[beside]) / _BEYOND, 0)
        return float(self.flux[beside] @ near / max(light, 1e-30))

    def box(self) -> tuple[Array, bool]:
        """Return the box that light passes around the middle, (2, 2) by axis and end in units of the edges.

        It ends where strips of the rectangle are dark, because light there gets less far beyond it than is usual.
        Return, too, whether it is dark on all sides.
        """
        flux = np.where(self.beyond > _BEYOND, self.flux, 0)
        box, dark = UNIT.copy(), bool(flux[_within(self.local, UNIT)].sum() > 0)
        for axis in (0, 1):
            own = _within(self.local[1 - axis : 2 - axis], UNIT[:1])
            light, places = np.histogram(self.local[axis, own], _STRIPS, (-1, 2), weights=flux[own])
            strips = np.flatnonzero(light <= _DARK * light[_STRIPS // 3 : -_STRIPS // 3].mean())
            before, behind = strips[strips < _STRIPS // 3], strips[strips >= _STRIPS - _STRIPS // 3]
            dark = dark and len(before) > 0 and len(behind) > 0
            box[axis] = places[[before.max(initial=-1) + 1, behind.min(initial=_STRIPS)]]
        passed = self.local[:, _within(self.local, box) & (flux > 0)] if dark else box
        ends = np.stack([passed.min(axis=1), passed.max(axis=1)], axis=1)
        return ends + _MARGIN * np.diff(ends, axis=1) * [-1, 1], dark


def _within(local: Array, box: Array) -> Array:
    """Return which places, (2, N), are inside a box, (2, 2) by axis and end."""
    within: Array = np.all((local >= box[:, :1]) & (local <= box[:, 1:]), axis=0)
    return within


def _shortest(places: Array, light: Array) -> list[tuple[float, float]]:
    """Return the shortest intervals of places, (N,), that leave out at most each of the fractions `_TRIMS` of light."""
    order = np.argsort(places)
    places, whole = places[order], np.concatenate([[0], np.cumsum(light[order])]) / light.sum()
    result = []
    for trim in _TRIMS:
        # From each place to the first by which enough light is included.
        last = np.searchsorted(whole, whole[:-1] + (1 - trim) - 1e-9) - 1
        first = np.flatnonzero(last < len(places))
        best = first[np.argmin(places[last[first]] - places[first])]
        result.append((float(places[best]), float(places[last[best]])))
    return result


def _cut(places: Array, index: Array) -> list[Array]:
    """Return the indices of points, (N, 2): of all, or of those on either side of dark strips along an axis."""
    best: tuple[float, int, float] | None = None
    for axis in (0, 1) if len(index) >= 2 * _FEWEST else ():
        ordered = np.sort(places[:, axis])
        gaps = np.diff(ordered[_FEWEST - 1 : len(ordered) - _FEWEST + 1])
        at = int(np.argmax(gaps)) + _FEWEST - 1
        narrower = min(ordered[at] - ordered[0], ordered[-1] - ordered[at + 1])
        usual = (ordered[-1] - ordered[0]) * np.log(len(ordered)) / len(ordered)
        gap = ordered[at + 1] - ordered[at]
        if gap > max(_WIDE * narrower, _SURE * usual) and (best is None or gap > best[0]):
            best = gap, axis, 0.5 * (ordered[at] + ordered[at + 1])
    if best is None:
        return [index]
    below = places[:, best[1]] < best[2]
    return [*_cut(places[below], index[below]), *_cut(places[~below], index[~below])]
