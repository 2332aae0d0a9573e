"""The openings through which lamps light what cameras see: holes in walls, windows, gaps between buildings.

Lines from a lamp to points in the picture show where its light comes in. Rectangles are fitted to those that are free
(see `guiding.fitted_portals`), one for each bundle of lines with dark strips around it, as behind each window of a
wall. Other than the pilot of a render, which takes a rectangle only where that saves light paths, this finds all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..scene import Array
from ..world.emitters.rectangles import Sides
from ..world.world import World
from .emission import Stratum
from .guiding.fitted_portals import Bundle, FittedRectangle, fitted, stopped_around, walled
from .guiding.inversion import rays_of, samples_of
from .guiding.lines import FogLines, LightLines
from .strata import Allotment
from .tuning import Tuning

if TYPE_CHECKING:
    from ..estimators.projection import Projection

# Number of light paths of each lamp, and most lines to points in the picture.
_PATHS, _LINES = 1 << 15, 1 << 12
# A dark strip parts a bundle if it is wider than this fraction of the narrower of both parts, so that the bars of a
# window do not part it; and than so many times the widest gap that is usual among as many uniform points.
_WIDE, _SURE = 0.5, 3.0
# The fewest lines through an opening, and the least fraction of the light around it that a wall stops.
_FEWEST, _STOPPED = 48, 0.5
# How much more light may pass a rectangle in a wall than one across the light: it has the wall's edges.
# In so many rounds it becomes wider, because cameras may see only a part of the light through it.
_WORSE, _ROUNDS = 4.0, 3
# How many lines are beside a line, which fraction of them must be free, and how far away the last of them may be, as a
# factor on the usual distance.
_NEAR, _FREE, _LONELY = 16, 0.7, 2.5


def openings_of_lamps(world: World, views: Sequence[Projection], names: Collection[str]) -> dict[str, list[Sides]]:
    """Return the openings of lamps that make beams, by their names, as rectangles; none of lamps that have a portal."""
    if not (views and names):
        return {}
    strata, lines = Allotment(_PATHS).strata(world, Tuning(max_bounces=0)), LightLines(world, views)
    return {
        each.emitter.name: list(_openings(each, lines.to_fog(each.emitter), world))
        for each in strata
        if each.emitter.portal is None and each.emitter.lamp.illuminates and each.emitter.name in names
    }


def _openings(stratum: Stratum, lines: FogLines, world: World) -> Iterator[Sides]:
    bundle = _bundle(stratum, lines)
    for part in () if bundle is None else _parts(bundle, world.extent):
        found = fitted(part, world.extent)
        found = None if found is None else walled(found, part, stratum.emitter, world, _WORSE, _ROUNDS)
        if found is None or np.linalg.norm(found.edges, axis=1).max() > world.extent:
            continue  # no hole in anything: a floor, too, is in the way of light
        if stopped_around(found, stratum.emitter, world) > _STOPPED:
            yield found.corner, found.edges[0], found.edges[1]


def _bundle(stratum: Stratum, lines: FogLines) -> Bundle | None:
    """Return free lines, which are seen, and paths in all directions, which are not; None if few lines are free."""
    index = np.flatnonzero(lines.free)
    if len(index) < _FEWEST:
        return None
    index = index[_passes(lines, index)]
    if len(index) < _FEWEST:
        return None
    index = index[:: max(1, len(index) // _LINES)]
    samples, there = samples_of(stratum.emitter, lines.point[index], lines.direction[index])
    count = int(np.count_nonzero(there))
    if count < _FEWEST:
        return None
    points = stratum.points(0)
    free, all_around = rays_of(stratum.emitter, samples[there]), rays_of(stratum.emitter, points)
    origin, direction = (np.concatenate(both) for both in zip(free[:2], all_around[:2], strict=True))
    light = np.concatenate([np.zeros(count), all_around[2] / max(all_around[2].sum(), 1e-30)])
    return Bundle(origin, direction, light, np.concatenate([np.full(count, 1 / count), np.zeros(len(points))]))


def _passes(lines: FogLines, index: Array) -> Array:
    """Return which of some free lines pass an opening: most lines beside those are free, however far they lead.

    Others lead to what is lit before a wall, which blocks the lines beside them that lead behind it.
    """
    from scipy.spatial import cKDTree  # takes long to import

    center = lines.point[index].mean(axis=0)
    to = center - lines.point
    foot = lines.point + (to * lines.direction).sum(axis=1, keepdims=True) * lines.direction
    size = np.sqrt((to[index] ** 2).sum(axis=1).mean())
    tree = cKDTree(np.concatenate([foot, size * lines.direction], axis=1))
    distance, near = tree.query(tree.data[index], _NEAR)
    passes: Array = lines.free[near].mean(axis=1) > _FREE
    usual = np.median(distance[passes, -1]) if passes.any() else 0.0
    return passes & (distance[:, -1] <= _LONELY * usual)


def _parts(bundle: Bundle, size: float) -> Iterator[Bundle]:
    """Yield a bundle, or its parts between which there are dark strips."""
    found = fitted(bundle, size)
    if found is None:
        return
    parts = _cut(*_seen(found, bundle))
    if len(parts) == 1:
        yield bundle
        return
    for own in parts:
        seen = np.zeros(len(bundle.seen))
        seen[own] = bundle.seen[own] / bundle.seen[own].sum()
        yield from _parts(replace(bundle, seen=seen), size)


def _seen(found: FittedRectangle, bundle: Bundle) -> tuple[Array, Array]:
    """Return where the lines that are seen cross a rectangle's plane, (N, 2) in scene units, and their indices."""
    local, _ = found.crossed(bundle.origin, bundle.direction)
    index = np.flatnonzero((bundle.seen > 0) & np.isfinite(local).all(axis=0))
    return (local * np.linalg.norm(found.edges, axis=1)[:, None])[:, index].T, index


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
