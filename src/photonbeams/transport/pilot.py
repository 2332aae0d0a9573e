"""The pilot of a frame: it learns which emission samples make light that cameras see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..scene import Array
from .connections import ShadowRays
from .emission import Emitted, Stratum
from .guiding import ENOUGH, ENOUGH_PORTAL, ENOUGH_STRAIGHT, GuidingMap, learn
from .importance import Sightings
from .inversion import samples_of
from .lamps import PortalEmitter

# Light paths of a round, of all strata together; rounds; the fewest paths of a stratum that is guided.
_ROUND, _ROUNDS, _FEWEST = 1 << 13, 2, 1 << 9
# Most lines from a stratum to points in the picture, and to points that it does not reach.
_LINES, _STOPPED = 1 << 11, 1 << 10

#: What cameras see of light paths, whose numbers count on from one element to the next.
Seen = Callable[[list[Emitted]], Sightings]


def guide(
    strata: Sequence[Stratum], seen: Seen, lines: Callable[[Stratum], ShadowRays] | None = None, straight: bool = False
) -> Array:
    """Guide strata toward visible light, and return how much light of each is in the picture, (S,).

    Lines to points in the picture tell where light comes in, as far as it comes straight from its emitter. Rounds of
    light paths follow, each guided by what is known; they find scattered light, too. Strata with few of the pilot's
    paths are left as they are.

    Parameters
    ----------
    strata
        The strata, whose guides are set.
    seen
        Returns what cameras see of light paths.
    lines
        Returns lines along which a stratum lights points in the picture; None: no lines are known.
    straight
        Whether all light that counts is straight from its emitter: no rounds follow where lines tell that uniform
        samples serve.
    """
    total = max(sum(each.count for each in strata), 1)
    counts = [round(_ROUND * each.count / total) for each in strata]
    learning = [
        _Learning(each, count, _enough(each, straight))
        for each, count in zip(strata, counts, strict=True)
        if count >= _FEWEST
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
    return np.array([found[id(each)].light() if id(each) in found else 0.0 for each in strata])


def _enough(stratum: Stratum, straight: bool) -> float:
    """Return above which variance, against that by uniform samples, a stratum's samples stay uniform."""
    if not straight:
        return ENOUGH
    emitter = stratum.emitter
    return ENOUGH_PORTAL if isinstance(emitter, PortalEmitter) and emitter.through else ENOUGH_STRAIGHT


def _round(learning: Sequence[_Learning], number: int, seen: Seen) -> None:
    """Trace a round of light paths, and hand each stratum what is seen of its own."""
    emitted = [each.emit(number) for each in learning]
    sightings, first = seen(emitted), 0
    for each in learning:
        own = (sightings.path >= first) & (sightings.path < first + each.count)
        each.add(sightings.of(own, first))
        first += each.count


class _Learning:
    """A stratum, and what the pilot has found of it so far."""

    def __init__(self, stratum: Stratum, count: int, enough: float) -> None:
        self.stratum, self.count, self._enough = stratum, count, enough
        stratum.guide = None
        self._pilot = Stratum(stratum.emitter, count, stratum.sequence)
        self._free = self._stopped = np.zeros((0, 4), dtype=np.float32)
        self._points: list[Array] = []
        self._guides: list[GuidingMap | None] = []
        self._sightings: list[Sightings] = []

    def follow(self, lines: ShadowRays) -> None:
        """Take the samples of lines to points in the picture, each as often as its weight says."""
        free, stopped = lines.chosen(True, _LINES), lines.chosen(False, _STOPPED)
        if not len(free[0]) + len(stopped[0]):
            return
        point, direction = (np.concatenate(both) for both in zip(free, stopped, strict=True))
        samples, found = samples_of(self.stratum.emitter, point, direction)
        # Not in the order of the picture: half of them are to judge what the other half has learned.
        order = np.random.default_rng(0).permutation(np.flatnonzero(found))
        lit = order < len(free[0])
        self._free, self._stopped = samples[order[lit]], samples[order[~lit]]

    def emit(self, number: int) -> Emitted:
        """Return the light paths of a round."""
        points = self._pilot.points(number, (1,))
        if self.stratum.guide is not None:
            points, _ = self.stratum.guide(points)
        self._points.append(points)
        self._guides.append(self.stratum.guide)
        return replace(self._pilot.emit(number, points), halvings=0)

    def add(self, sightings: Sightings) -> None:
        """Add what is seen of the last round."""
        self._sightings.append(sightings.later((len(self._points) - 1) * self.count))

    def learned(self) -> GuidingMap | None:
        """Return the map by all that was found.

        A part of the samples follows lines that are stopped: they find the holes that the pilot missed.
        """
        found = [(self._free, np.ones(len(self._free)))]
        if self._points:
            density = self._density()
            importance = Sightings.joined(self._sightings).importance(density)
            found.append((np.concatenate(self._points)[importance > 0], (importance / density)[importance > 0]))
        # Lines and paths tell of the same light: each kind counts as much as it has samples.
        found = [(points, weights * (len(points) / weights.sum())) for points, weights in found if len(points)]
        if not found:
            return learn(self._stopped, np.ones(len(self._stopped)), enough=self._enough)
        points, weights = (np.concatenate(each) for each in zip(*found, strict=True))
        return learn(points, weights, self._stopped, self._enough)

    def light(self) -> float:
        """Return how much of the stratum's light is in the picture."""
        if not self._points:
            return 0.0
        density, found = self._density(), Sightings.joined(self._sightings)
        return float((found.totals(len(density)) / density).sum() / len(self._points))

    def _density(self) -> Array:
        """Return how densely the samples of all rounds lie where each sample is."""
        points = np.concatenate(self._points)
        rounds = [np.ones(len(points)) if each is None else each.density(points) for each in self._guides]
        return np.mean(rounds, axis=0)
