"""Fitted portals: small rectangles that most of an emitter's visible light passes, such as holes in a wall.

A pilot knows which light paths of an emitter cameras see. Where these pass a rectangle that few others pass, it is
better to send paths through it, as through a portal that somebody has placed: samples are then stratified on the
emitter and in the rectangle, and few of them are blocked. The other paths go past the rectangle, so no light is lost
wherever it is. (For portals of environments, see Bitterli, Novák and Jarosz 2015.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...numerics.arrays import to_numpy
from ...numerics.sampling import sobol_block
from ...runtime.device import Array3f, Float, UInt32, mitsuba
from ...scene import Array
from ...world.emitters.portals import Portal
from ...world.emitters.rectangles import mesh_of, widened
from ...world.media.visibility import through
from ...world.surfaces.shapes import shape_of
from ...world.world import World
from ..emission import PathEmitter, Stratum

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene

mi = mitsuba()

# The fewest visible paths to which a rectangle is fitted.
_FEWEST = 24
# Numbers of planes along the mean direction, and of angles of rectangles in them; and the least length of the mean of
# directions, which are unit vectors: light from all around has no portal.
_PLANES, _ANGLES, _SLANTED = 16, 6, 0.2
# Number of rounds in which planes are moved and tilted to find a better one, and the first angle of tilt, in radians.
_ROUNDS, _TILT = 5, 0.3
# How many paths decide which plane is best: of those that are seen, and of the others.
_THINNED = 512, 1024
# The fractions of visible light that a rectangle may leave out along either axis.
_TRIMS = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2)
# Rectangles are wider on each side than the known paths through them, by this fraction, or by that of so many paths.
_MARGIN, _MARGIN_PATHS = 0.02, 2.0
# Number of rays that measure how far light gets around a rectangle, in one three times as long and wide; the fraction
# of the usual distance that they must get beyond it; the width of the strips by which it grows, and how bright a strip
# must be, as a fraction of the rectangle.
_PROBES, _BEYOND, _STRIP, _DARK = 1 << 13, 0.25, 0.1, 0.1
# Numbers of walls that are tried, and of points that may define one. Points belong to one wall if the cosine between
# their normals is more than _FLAT, and their distance from its plane is less than _THICK of their spread. _WORSE is
# the usual factor of `walled`.
_WALLS, _TRIED, _FLAT, _THICK, _WORSE = 4, 32, 0.99, 0.003, 1.5
#: The box of a whole rectangle, (2, 2) by axis and end.
UNIT = np.array([[0.0, 1.0], [0.0, 1.0]])
_BESIDE = np.array([[-0.5, 1.5]] * 2)  # a box around it, in which walls are looked for
# Bounds of the fraction of paths that goes through the rectangle.
_SHARES = (0.75, 0.9)


@dataclass(frozen=True)
class Bundle:
    """Light paths as they leave their emitter, (N, 3), with the light that each stands for, (N,).

    `light` is their flux and `seen` is what cameras see of it; each sums to 1. `room` is the variance of visible light
    by guided paths, relative to that by uniform ones.
    """

    origin: Array
    direction: Array
    light: Array
    seen: Array
    room: float = 1.0

    def thinned(self) -> Bundle:
        """Return fewer paths that represent all: some of those that are seen, and some of the others."""
        which, scale = [], np.ones(len(self.seen))
        for number, most in enumerate(_THINNED):
            own = np.flatnonzero((self.seen > 0) == (number == 0))
            step = max(1, len(own) // most)
            which.append(own[::step])
            scale[which[-1]] = len(own) / max(len(which[-1]), 1)
        kept = np.concatenate(which)
        light, seen = (each[kept] * scale[kept] for each in (self.light, self.seen))
        return Bundle(self.origin[kept], self.direction[kept], light / light.sum(), seen / seen.sum(), self.room)


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
    def rooms(self) -> tuple[float, float]:
        """The variances of visible light through it and past it, relative to those of paths in all directions."""
        share = self.share
        return self.seen * self.light / share, (1 - self.seen) * (1 - self.light) * self.aside / (1 - share)

    def portal(self, host: MiScene, wider: float = 0.0) -> Portal:
        """Return the rectangle as a portal (see `scene_of` for `host`), wider by a fraction `wider` on each side."""
        mesh = mesh_of("fitted portal", widened((self.corner, self.edges[0], self.edges[1]), wider))
        return Portal(mesh, shape_of(mesh), host)

    @classmethod
    def of(cls, corner: Array, edges: Array, inside: Array, bundle: Bundle) -> FittedRectangle:
        """Return a rectangle that the paths `inside` of a bundle pass."""
        seen, light = (min(float(each[inside].sum()), 1.0) for each in (bundle.seen, bundle.light))
        return cls(corner, edges, inside, seen, light, bundle.room)

    def crossed(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Return where rays cross its plane, (2, N) in units of its edges, and the distances to there, (N,)."""
        axes = self.edges / (self.edges**2).sum(axis=1, keepdims=True)
        return _crossed(origin, direction, self.corner, np.cross(*self.edges), axes)

    def cut(self, box: Array, bundle: Bundle) -> FittedRectangle:
        """Return the part of its plane in a box, (2, 2) by axis and end in units of its edges."""
        local, _ = self.crossed(bundle.origin, bundle.direction)
        edges = np.diff(box, axis=1) * self.edges
        return FittedRectangle.of(self.corner + box[:, 0] @ self.edges, edges, _within(local, box), bundle)


def _crossed(origin: Array, direction: Array, point: Array, normal: Array, axes: Array) -> tuple[Array, Array]:
    """Return where rays cross a plane, (2, N) along `axes` from `point`, and how far away; infinite if they do not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((point - origin) @ normal) / (direction @ normal)
    crosses = np.isfinite(distance) & (distance > 0)
    local = axes @ (origin + np.where(crosses, distance, 0)[:, None] * direction - point).T
    return np.where(crosses, local, np.inf), np.where(crosses, distance, np.inf)


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


def fitted(bundle: Bundle, size: float) -> FittedRectangle | None:
    """Return the rectangle that visible light passes, but little other light; None if too little light is seen.

    Planes square to the light are tried at all depths of a scene of radius `size`. The best one is then moved and
    tilted in several rounds, as long as that improves it.
    """
    if np.count_nonzero(bundle.seen > 0) < _FEWEST:
        return None
    few = bundle.thinned()
    mean = few.seen @ few.direction
    length = float(np.linalg.norm(mean))
    if not length > _SLANTED:
        return None
    mean = mean / length
    depths = size * np.concatenate([np.geomspace(1e-3, 2, _PLANES), np.linspace(0, 2, _PLANES + 1)[1:-1]])
    center = few.seen @ few.origin
    tried = [_CrossSection.of(few, mean, center + depth * mean) for depth in depths]
    best = min((each for each in tried if each is not None), key=lambda each: each.cost, default=None)
    for number in range(_ROUNDS if best is not None else 0):
        best = min(best.neighbours(2.0**-number, mean, size), key=lambda each: each.cost)  # type: ignore[union-attr]
    whole = None if best is None else _CrossSection.of(bundle, best.normal, best.point)
    return None if whole is None else whole.rectangle


def walled(
    rectangle: FittedRectangle, bundle: Bundle, emitter: PathEmitter, world: World, worse: float = _WORSE,
    rounds: int = 1,
) -> FittedRectangle | None:  # fmt: skip
    """Return a rectangle moved into the plane of the wall around it, with its sides moved outward to the wall's edges.

    None if no wall stops the light around it, because then there is no hole. The cost of a rectangle in a wall may be
    higher by the factor `worse`. In each of several `rounds` it may become three times as wide.
    """
    around = _ProbeRays.of(rectangle, emitter, world)
    planes = (_CrossSection.of(bundle, *wall) for wall in around.walls())
    found = min((each for each in planes if each is not None), key=lambda each: each.cost, default=None)
    if found is not None and found.cost < worse * sum(rectangle.rooms):
        rectangle = found.rectangle
        around = _ProbeRays.of(rectangle, emitter, world)
    for left in reversed(range(rounds)):
        box, ends = around.box()
        rectangle = rectangle.cut(box, bundle)
        if ends:
            return rectangle
        around = _ProbeRays.of(rectangle, emitter, world) if left else around
    return None


def stopped_around(rectangle: FittedRectangle, emitter: PathEmitter, world: World) -> float:
    """Return the fraction of the light close around a rectangle that surfaces stop; 0 if it is dark there anyway."""
    return _ProbeRays.of(rectangle, emitter, world).stopped()


@dataclass(frozen=True)
class _ProbeRays:
    """Rays through a rectangle and around it, with their `light`, (N,).

    `local` is where they cross its plane, (2, N) in units of its edges; `beyond` is how far they get from there, (N,).
    `point` and `normal`, (N, 3), are those of the surface that stops them, or NaN if none does.
    """

    local: Array
    beyond: Array
    light: Array
    point: Array
    normal: Array

    @classmethod
    def of(cls, rectangle: FittedRectangle, emitter: PathEmitter, world: World) -> _ProbeRays:
        """Trace rays from an emitter through a rectangle and around it."""
        points = sobol_block(_PROBES, 0, (_PROBES,))
        sample = emitter.at(rectangle.portal(world.host, wider=1.0), True).sample(*points)
        ray = mi.Ray3f(mi.Point3f(sample.origin), mi.Vector3f(sample.direction))
        lane = dr.arange(UInt32, _PROBES)
        light = dr.select(sample.valid, dr.max(sample.flux), 0) + dr.zeros(Float, _PROBES)
        _, hit = through(world.plugin, world.media, ray, sample.medium + 0 * lane, lane, light > 0)
        met = hit.is_valid()
        point, normal = (dr.select(met, Array3f(each), dr.nan) for each in (hit.p, hit.n))
        ended = dr.select(met, dr.norm(Array3f(hit.p) - sample.origin), sample.reach)
        dr.eval(point, normal, ended, light, sample.origin, sample.direction)
        vectors = (np.broadcast_to(to_numpy(each), (3, _PROBES)).T.astype(np.float64)
                   for each in (sample.origin, sample.direction, point, normal))  # fmt: skip
        origin, direction, place, upward = vectors
        local, distance = rectangle.crossed(origin, direction)
        known = np.nan_to_num(light.numpy().astype(np.float64), posinf=0)
        return cls(local, np.where(np.isfinite(distance), ended.numpy() - distance, -1), known, place, upward)

    def walls(self) -> list[tuple[Array, Array]]:
        """Return the planes that stop most of the rays around the rectangle: a normal and a point of each."""
        beside = _within(self.local, _BESIDE) & ~_within(self.local, UNIT)
        beside &= (self.light > 0) & np.isfinite(self.point).all(axis=1)
        points, normals = self.point[beside], self.normal[beside]
        result: list[tuple[Array, Array]] = []
        least = max(_FEWEST, len(points) // 10)
        size = np.ptp(points, axis=0).max() if len(points) else 0.0
        while len(points) >= least and len(result) < _WALLS:
            tried = np.linspace(0, len(points) - 1, _TRIED).astype(int)
            near = np.abs((points[tried, None] - points) @ normals[tried][:, :, None])[:, :, 0] < _THICK * size
            same = near & (np.abs(normals[tried] @ normals.T) > _FLAT)
            best = np.argmax(same.sum(axis=1))
            if np.count_nonzero(same[best]) < least:
                break
            result.append((normals[tried[best]], points[tried[best]]))
            points, normals = points[~same[best]], normals[~same[best]]
        return result

    def stopped(self) -> float:
        """Return the fraction of the light beside the rectangle that is stopped; 0 if there is next to none."""
        inside, wider = (_within(self.local, box) for box in (UNIT, _BESIDE))
        usual, beside = self._usual(), wider & ~inside
        light, room = self.light[beside].sum(), np.prod(np.diff(_BESIDE, axis=1)) - 1
        if usual is None or light < _DARK * room * self.light[inside].sum():
            return 0.0
        return float(self.light[beside & (self.beyond <= _BEYOND * usual)].sum() / light)

    def _usual(self) -> float | None:
        """Return the usual distance that light gets beyond the rectangle; None if none does."""
        found = self.beyond[_within(self.local, UNIT) & (self.light > 0) & (self.beyond > 0)]
        return float(np.median(found)) if len(found) else None

    def box(self) -> tuple[Array, bool]:
        """Return the box whose sides are where light is stopped, (2, 2) by axis and end in units of the edges.

        Light counts as stopped if it gets less far than a fraction of the usual distance beyond the rectangle. Return,
        too, whether it is stopped on all sides of the box.
        """
        usual = self._usual()
        if usual is None:
            return UNIT, False
        light = np.where(self.beyond > _BEYOND * usual, self.light, 0)
        box, darkest = UNIT.copy(), _DARK * light[_within(self.local, UNIT)].sum()
        for _ in range(int(1 / _STRIP)):
            before = box.copy()
            for axis, end in np.ndindex(2, 2):
                strip = box.copy()
                strip[axis] = np.sort(box[axis, end] + np.array([0, (2 * end - 1) * _STRIP]))
                if light[_within(self.local, strip)].sum() > darkest * np.prod(np.diff(strip, axis=1)):
                    box[axis, end] = strip[axis, end]
            if (box == before).all():
                return box, True
        return box, False


def _within(local: Array, box: Array) -> Array:
    """Return which places, (2, N), are inside a box, (2, 2) by axis and end."""
    within: Array = np.all((local >= box[:, :1]) & (local <= box[:, 1:]), axis=0)
    return within


class _CrossSection:
    """A plane that a bundle crosses, and a rectangle in it.

    `local` has the places where the bundle's paths cross the plane, (2, N); infinite if they do not.
    """

    def __init__(self, bundle: Bundle, normal: Array, point: Array, axes: Array, local: Array) -> None:
        self._bundle, known = bundle, bundle.seen > 0
        self.normal, self.point, self.axes, self._local = normal, point, axes, local
        intervals = np.array([_shortest(each[known], bundle.seen[known]) for each in local])
        boxes = [self._wider(box) for box in np.moveaxis(intervals, 1, 0)]
        self.rectangle = min((self._rectangle(box) for box in boxes), key=lambda each: sum(each.rooms))
        self.cost = sum(self.rectangle.rooms)

    @classmethod
    def of(cls, bundle: Bundle, normal: Array, point: Array) -> _CrossSection | None:
        """Return a plane with its best rectangle; None if little of the visible light crosses it."""
        x = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        x /= np.linalg.norm(x)
        axes = np.array([x, np.cross(normal, x)])
        local, distance = _crossed(bundle.origin, bundle.direction, point, normal, axes)
        crosses = np.isfinite(distance)
        if bundle.seen[crosses].sum() < 0.5:
            return None
        angle = np.arange(_ANGLES) / _ANGLES * (np.pi / 2)
        turns = np.moveaxis(np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]), 2, 0)
        seen = np.sort(turns @ local[:, crosses & (bundle.seen > 0)])
        outer = seen.shape[2] // 50  # the outermost paths on either side do not count
        turn = turns[np.argmin(np.prod(seen[:, :, -1 - outer] - seen[:, :, outer], axis=1))]
        turned = np.where(crosses, turn @ np.where(crosses, local, 0), np.inf)
        return cls(bundle, normal, point, turn @ axes, turned)

    def neighbours(self, scale: float, mean: Array, size: float) -> list[_CrossSection]:
        """Return this plane, planes moved from it along the mean direction, and planes tilted against it."""
        step, angle = scale * size / (4 * _PLANES), scale * _TILT
        moves = [(self.normal, self.point + sign * step * mean) for sign in (-1, 1)]
        moves += [(self.normal + sign * angle * side, self.point) for side in self.axes for sign in (-1, 1)]
        found = (_CrossSection.of(self._bundle, normal / np.linalg.norm(normal), point) for normal, point in moves)
        return [self, *(each for each in found if each is not None)]

    def _wider(self, box: Array) -> Array:
        """Return a box, (2, 2) by axis and end, widened by a margin on each side."""
        paths = max(int((_within(self._local, box) & (self._bundle.seen > 0)).sum()), 1)
        wider: Array = box + max(_MARGIN, _MARGIN_PATHS / paths) * np.diff(box, axis=1) * [-1, 1]
        return wider

    def _rectangle(self, box: Array) -> FittedRectangle:
        low, high = box.T
        edges = (high - low)[:, None] * self.axes
        return FittedRectangle.of(self.point + low @ self.axes, edges, _within(self._local, box), self._bundle)


def _shortest(places: Array, light: Array) -> list[tuple[float, float]]:
    """Return the shortest intervals that leave out at most each of the fractions `_TRIMS` of the light."""
    order = np.argsort(places)
    order = order[np.isfinite(places[order])]
    places, whole = places[order], np.concatenate([[0], np.cumsum(light[order])]) / light.sum()
    result = []
    for trim in _TRIMS:
        # From each place to the first by which enough light is included; some of the light does not cross the plane.
        last = np.searchsorted(whole, whole[:-1] + (1 - trim) * whole[-1] - 1e-9) - 1
        first = np.flatnonzero(last < len(places))
        best = first[np.argmin(places[last[first]] - places[first])]
        result.append((float(places[best]), float(places[last[best]])))
    return result
