"""The pilot of a frame, which learns which emission samples make light that cameras see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...scene import Array
from ...world.emitters.rays import EmittedRays
from ...world.world import World
from ..emission import PathEmitter, Stratum
from .importance import Sightings
from .inversion import samples_of
from .lines import FogLines
from .maps import BRIGHTEST, ENOUGH, ENOUGH_PORTAL, ENOUGH_STRAIGHT, GuidingMap, learn
from .openings import UNIT, Bundle, FittedRectangle, Opening, TracedRays, fitted, parted

# Light paths in a round, for all strata together; number of rounds; fewest paths of a stratum that is guided.
_ROUND, _ROUNDS, _FEWEST = 1 << 13, 2, 1 << 9
# So many strata have the fewest paths each in any case: dim light may be all that a part of the picture has.
_EACH = 16
# Most lines from a stratum to points in the picture that it reaches, and to points that it does not reach.
_LINES, _STOPPED = 1 << 11, 1 << 10
# A fitted portal must leave less than these factors times the variance by uniform samples, and by guided ones.
_WORTH, _BETTER = 0.25, 2.0
# Portals are fitted to light straight from the emitter alone if that is at least this fraction of the visible light.
_STRAIGHT = 0.1

#: Returns what cameras see of light paths; these are numbered consecutively from one element to the next.
Seen = Callable[[list[EmittedRays]], Sightings]


@dataclass
class Found:
    """What the pilot has found out about a stratum.

    Attributes
    ----------
    strata
        The guided stratum, or its two strata of light through a fitted portal and past it.
    opening
        The fitted portal, or None.
    light
        How much light of each of the strata is in the picture.
    bundle
        The pilot's light paths, and what is seen of them; None if nothing is, or no opening is looked for.
    """

    strata: list[Stratum]
    opening: Opening | None
    light: list[float]
    bundle: Bundle | None = None


def guide(
    strata: Sequence[Stratum], seen: Seen, world: World, lines: Callable[[Stratum], FogLines] | None = None,
    straight: bool = False,
) -> list[Found]:  # fmt: skip
    """Guide strata toward visible light, and return what is found out about each.

    Lines to points in the picture show where light comes in straight from its emitter. Rounds of light paths follow,
    each guided by what is known so far; they find scattered light, too. Where most of the visible light comes through a
    small rectangle, that becomes a portal. Strata with few of the pilot's paths are left as they are.

    Parameters
    ----------
    strata
        The strata, whose guides are set.
    seen
        Returns what cameras see of light paths.
    world
        The world that light meets.
    lines
        Returns lines along which a stratum lights points in the picture; None: no lines are known.
    straight
        Whether only light straight from its emitter counts. Then strata for which lines show that uniform samples
        suffice have no rounds.
    """
    total = max(sum(each.count for each in strata), 1)
    least = _FEWEST if len(strata) <= _EACH else 0
    counts = [max(round(_ROUND * each.count / total), least) for each in strata]
    learning = [
        _Learning(each, count, straight) for each, count in zip(strata, counts, strict=True) if count >= _FEWEST
    ]
    for each in learning:
        if lines is not None:
            each.follow(lines(each.stratum))
        each.stratum.guide = each.learned()
    found = {id(each.stratum): each for each in learning}
    if straight:
        learning = [each for each in learning if each.stratum.guide is not None]
    for number in range(_ROUNDS if learning else 0):
        _round(learning, number, seen)
        for each in learning:
            each.stratum.guide = each.learned()
    known = [each.rectangle for each in found.values() if each.rectangle is not None]
    result = []
    for stratum in strata:
        own = found.get(id(stratum))
        if own is None:
            result.append(Found([stratum], None, [0.0]))
        else:  # a window found for one lamp may also serve another, of which less is seen
            result.append(own.found(own.one_of(known), world))
    return result


def _enough(emitter: PathEmitter, straight: bool) -> float:
    """Return the variance, relative to uniform samples, above which an emitter's samples stay uniform."""
    if not straight:
        return ENOUGH
    return ENOUGH_PORTAL if emitter.through else ENOUGH_STRAIGHT


def _round(learning: Sequence[_Learning], number: int, seen: Seen) -> None:
    """Trace a round of light paths, and add to each stratum the sightings of its own paths."""
    emitted = [each.emit(number) for each in learning]
    sightings, first = seen(emitted), 0
    for each in learning:
        own = (sightings.path >= first) & (sightings.path < first + each.count)
        each.add(sightings.of(own, first))
        first += each.count


class _Learning:
    """A stratum, and what the pilot has found out about it so far."""

    def __init__(self, stratum: Stratum, count: int, straight: bool) -> None:
        self.stratum, self.count, self._straight = stratum, count, straight
        stratum.guide = None
        self._pilot = Stratum(stratum.emitter, count, stratum.sequence)
        self._free = self._stopped = np.zeros((0, 4), dtype=np.float32)
        self._points: list[Array] = []
        self._guides: list[GuidingMap | None] = []
        self._sightings: list[Sightings] = []
        self._known: tuple[Array, Sightings] | None = None  # `_evidence` of the rounds so far

    def follow(self, lines: FogLines) -> None:
        """Take the emission samples of lines to points in the picture, in proportion to the lines' weights."""
        free, stopped = lines.chosen(True, _LINES), lines.chosen(False, _STOPPED)
        if not len(free[0]) + len(stopped[0]):
            return
        point, direction = (np.concatenate(both) for both in zip(free, stopped, strict=True))
        samples, found = samples_of(self.stratum.emitter, point, direction)
        # In random order, not in the picture's: one half has to judge what the other half has learned.
        order = np.random.default_rng(0).permutation(np.flatnonzero(found))
        lit = order < len(free[0])
        self._free, self._stopped = samples[order[lit]], samples[order[~lit]]

    def emit(self, number: int) -> EmittedRays:
        """Return the light paths of a round."""
        points = self._pilot.points(number, (1,))
        if self.stratum.guide is not None:
            points, _ = self.stratum.guide(points)
        self._points.append(points)
        self._guides.append(self.stratum.guide)
        return replace(self._pilot.emit(number, points), halvings=0)

    def add(self, sightings: Sightings) -> None:
        """Add the sightings of the last round."""
        self._sightings.append(sightings.later((len(self._points) - 1) * self.count))
        self._known = None

    def learned(self) -> GuidingMap | None:
        """Return the map that is learned from all that was found.

        A fraction of the samples follows lines that are blocked, to find the holes that the pilot missed.
        """
        found, enough = [(self._free, np.ones(len(self._free)))], _enough(self.stratum.emitter, self._straight)
        if self._points:
            density, sightings = self._evidence()
            importance = sightings.importance(density)
            found.append((np.concatenate(self._points)[importance > 0], (importance / density)[importance > 0]))
        # Lines and paths sample the same light, so each kind counts in proportion to its number of samples.
        found = [(points, weights * (len(points) / weights.sum())) for points, weights in found if len(points)]
        if not found:
            return learn(self._stopped, np.ones(len(self._stopped)), enough=enough)
        points, weights = (np.concatenate(each) for each in zip(*found, strict=True))
        return learn(points, weights, self._stopped, enough)

    @cached_property
    def rectangle(self) -> FittedRectangle | None:
        """A rectangle whose portal serves better than the guide; None if there is none."""
        return None if self._bundle is None else fitted(self._bundle, self._most(self._bundle))

    def one_of(self, rectangles: Sequence[FittedRectangle]) -> FittedRectangle | None:
        """Return the best of the given rectangles; None if none serves better than the guide."""
        if self._bundle is None or not rectangles:
            return None
        own = [each.cut(UNIT, self._bundle) for each in rectangles]
        result = min(own, key=lambda each: each.variance)
        return result if result.variance < self._most(self._bundle) else None

    def _most(self, bundle: Bundle) -> float:
        return min(_WORTH, _BETTER * bundle.room)

    def found(self, rectangle: FittedRectangle | None, world: World) -> Found:
        """Return what was found, with a portal if there is a rectangle."""
        light = self._light()
        if rectangle is None or self._bundle is None:
            return Found([self.stratum], None, [light], self._bundle)
        origin, direction = self._bundle.rays.origin, self._bundle.rays.direction
        density, sightings = self._evidence()
        weights = sightings.importance(density) / density
        through = min(float(weights[rectangle.inside].sum() / weights.sum()), 1.0)
        opening = Opening(rectangle.portal(world.host), replace(rectangle, seen=through).share)
        strata = parted(self.stratum, opening)
        for stratum, inside in zip(strata, (rectangle.inside, ~rectangle.inside), strict=True):
            own = inside & (weights > 0)
            if own.any():
                samples, valid = samples_of(stratum.emitter, origin[own], direction[own])
                enough = _enough(stratum.emitter, self._straight)
                stratum.guide = learn(samples[valid], weights[own][valid], enough=enough)
        return Found(strata, opening, [light * through, light * (1 - through)], self._bundle)

    @cached_property
    def _bundle(self) -> Bundle | None:
        """The paths of all rounds, once these are over, with the light that is seen before it is scattered.

        If hardly any light is seen before it is scattered, all visible light counts. None if nothing is seen, and for
        emitters that already have a portal or cannot have one.
        """
        emitter, guide = self.stratum.emitter, self.stratum.guide
        if not self._points or not emitter.lamp.illuminates or emitter.portal is not None:
            return None
        density, sightings = self._evidence()
        straight = sightings.of(sightings.straight, 0)
        if straight.light.sum() < _STRAIGHT * sightings.light.sum():
            straight = sightings
        seen = straight.importance(density) / density
        if not seen.any():
            return None
        # For the variance of paths with these densities, what is seen counts by its square.
        seen = density * np.minimum(seen, BRIGHTEST * seen[seen > 0].mean()) ** 2
        seen /= seen.sum()
        points = np.concatenate(self._points)
        room = 1.0 if guide is None else float(seen @ (1 / guide.density(points)))
        rays = TracedRays.of(emitter, points)
        light = rays.flux / density
        return Bundle(emitter, rays, light / max(light.sum(), 1e-30), seen, room)

    def _light(self) -> float:
        """Return how much of the stratum's light is in the picture."""
        if not self._points:
            return 0.0
        density, found = self._evidence()
        return float((found.totals(len(density)) / density).sum() / len(self._points))

    def _evidence(self) -> tuple[Array, Sightings]:
        """Return the density of the samples of all rounds at each sample, and their sightings."""
        if self._known is None:
            points = np.concatenate(self._points)
            rounds = [np.ones(len(points)) if each is None else each.density(points) for each in self._guides]
            self._known = np.mean(rounds, axis=0), Sightings.joined(self._sightings)
        return self._known
