"""The pilot of a frame: it learns which emission samples make light that cameras see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..scene import Array
from ..world.world import World
from .connections import ShadowRays
from .emission import Emitted, Emitter, Stratum
from .fitted_portals import Bundle, Opening, Rectangle, fitted, parted, walled
from .guiding import BRIGHTEST, ENOUGH, ENOUGH_PORTAL, ENOUGH_STRAIGHT, GuidingMap, learn
from .importance import Sightings
from .inversion import rays_of, samples_of
from .lamps import PortalEmitter

# Light paths of a round, of all strata together; rounds; the fewest paths of a stratum that is guided.
_ROUND, _ROUNDS, _FEWEST = 1 << 13, 2, 1 << 9
# Most lines from a stratum to points in the picture, and to points that it does not reach.
_LINES, _STOPPED = 1 << 11, 1 << 10
# Most of the variance by uniform samples, and by guided ones, that a fitted portal leaves.
_WORTH, _BETTER = 0.25, 2.0
# The least part of visible light that is seen before it is scattered for that alone to tell where a portal is.
_STRAIGHT = 0.1

#: What cameras see of light paths, whose numbers count on from one element to the next.
Seen = Callable[[list[Emitted]], Sightings]


@dataclass
class Found:
    """What the pilot has found of a stratum.

    Attributes
    ----------
    strata
        The guided stratum, or the two strata of its light through a fitted portal and past it.
    opening
        The fitted portal; None without one.
    light
        How much light of each of the strata is in the picture.
    """

    strata: list[Stratum]
    opening: Opening | None
    light: list[float]


def guide(
    strata: Sequence[Stratum], seen: Seen, world: World, lines: Callable[[Stratum], ShadowRays] | None = None,
    straight: bool = False,
) -> list[Found]:  # fmt: skip
    """Guide strata toward visible light, and return what is found of each.

    Lines to points in the picture tell where light comes in, as far as it comes straight from its emitter. Rounds of
    light paths follow, each guided by what is known; they find scattered light, too. Where most of what is seen comes
    through a small rectangle, that becomes a portal. Strata with few of the pilot's paths are left as they are.

    Parameters
    ----------
    strata
        The strata, whose guides are set.
    seen
        Returns what cameras see of light paths.
    world
        What light meets.
    lines
        Returns lines along which a stratum lights points in the picture; None: no lines are known.
    straight
        Whether all light that counts is straight from its emitter: no rounds follow where lines tell that uniform
        samples serve.
    """
    total = max(sum(each.count for each in strata), 1)
    counts = [round(_ROUND * each.count / total) for each in strata]
    learning = [
        _Learning(each, count, straight)
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
    return [found[id(each)].found(world) if id(each) in found else Found([each], None, [0.0]) for each in strata]


def _enough(emitter: Emitter, straight: bool) -> float:
    """Return above which variance, against that by uniform samples, an emitter's samples stay uniform."""
    if not straight:
        return ENOUGH
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

    def __init__(self, stratum: Stratum, count: int, straight: bool) -> None:
        self.stratum, self.count, self._straight = stratum, count, straight
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
            return learn(self._stopped, np.ones(len(self._stopped)), enough=_enough(self.stratum.emitter, self._straight))
        points, weights = (np.concatenate(each) for each in zip(*found, strict=True))
        return learn(points, weights, self._stopped, _enough(self.stratum.emitter, self._straight))

    def found(self, world: World) -> Found:
        """Return what was found, with a portal where that serves better than the guide."""
        if not self._points or self.stratum.emitter.lamp is None or isinstance(self.stratum.emitter, PortalEmitter):
            return Found([self.stratum], None, [self._light()])
        density, sightings = self._density(), Sightings.joined(self._sightings)
        bundle = self._bundle(sightings, density)
        rectangle = None if bundle is None else self._rectangle(bundle, world)
        if bundle is None or rectangle is None:
            return Found([self.stratum], None, [self._light()])
        weights = sightings.importance(density) / density
        through = min(float(weights[rectangle.inside].sum() / weights.sum()), 1.0)
        opening = Opening(rectangle.portal(world.host), replace(rectangle, seen=through).share)
        strata = parted(self.stratum, opening)
        for stratum, own in zip(strata, (rectangle.inside, ~rectangle.inside), strict=True):
            own = own & (weights > 0)
            if not own.any():
                continue
            samples, valid = samples_of(stratum.emitter, bundle.origin[own], bundle.direction[own])
            stratum.guide = learn(samples[valid], weights[own][valid], enough=_enough(stratum.emitter, self._straight))
        light = self._light()
        return Found(strata, opening, [light * through, light * (1 - through)])

    def _rectangle(self, bundle: Bundle, world: World) -> Rectangle | None:
        """Return the rectangle that serves better than the guide, None where there is none."""
        rectangle, enough = fitted(bundle, world.radius), min(_WORTH, _BETTER * bundle.room)
        if rectangle is None or not sum(rectangle.rooms) < enough:
            return None
        rectangle = walled(rectangle, bundle, self.stratum.emitter, world)
        return rectangle if rectangle is not None and sum(rectangle.rooms) < enough else None

    def _bundle(self, sightings: Sightings, density: Array) -> Bundle | None:
        """Return the light paths of all rounds and what is seen of them before they are scattered; None if nothing is.

        If hardly any light is seen before it is scattered, what is seen of it later counts.
        """
        straight = sightings.of(sightings.straight, 0)
        if straight.light.sum() < _STRAIGHT * sightings.light.sum():
            straight = sightings
        seen = straight.importance(density) / density
        if not seen.any():
            return None
        seen = density * np.minimum(seen, BRIGHTEST * seen[seen > 0].mean()) ** 2
        seen /= seen.sum()
        guide = self.stratum.guide
        points = np.concatenate(self._points)
        room = 1.0 if guide is None else float(seen @ (1 / guide.density(points)))
        origin, direction, flux = rays_of(self.stratum.emitter, points)
        light = flux / density
        return Bundle(origin, direction, light / max(light.sum(), 1e-30), seen, room)

    def _light(self) -> float:
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
