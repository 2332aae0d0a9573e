"""The light of a shot, pass by pass: at both ends of a pass's slice of the shutter interval, if anything moves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from .. import scene
from ..beams import Beams
from ..beams.sets import BeamSet
from ..numerics.arrays import compressed, to_uint
from ..runtime.device import Bool, UInt32
from ..world.world import World
from .emission import Emission, PathEmitter, Stratum
from .guiding.guides import UNGUIDED, Guides
from .light_tracer import LightTracer, Moving, PassLight, nothing
from .segments.records import Counts
from .strata import ALLOTMENT, Allotment, with_surrounds
from .tuning import Tuning

if TYPE_CHECKING:
    from ..estimators.projection import Projection
    from ..looks import Look

# Worlds whose strata are kept: the ends and the middle of a pass.
_KEPT = 3


@dataclass(frozen=True)
class Simulation:
    """The beams and photons of a shot, pass by pass.

    Attributes
    ----------
    tuning, allotment
        How light paths are traced, and how many each emitter sends.
    guides
        What a pilot has found out about the strata.
    named
        Whether beams carry the data that only looks and programs read.
    walked
        The names of media in which sources make no beams, by the numbers of these.
    """

    tuning: Tuning
    allotment: Allotment = ALLOTMENT
    guides: Guides = UNGUIDED
    named: bool = True
    walked: Mapping[int, Collection[str]] = field(default_factory=dict)
    _known: list[tuple[World, list[Stratum]]] = field(default_factory=list, init=False, repr=False, compare=False)

    def strata(self, world: World) -> list[Stratum]:
        """Return the light paths of a pass in a world."""
        for known, strata in self._known:
            if known is world:
                return strata
        found = self.guides.applied(self.allotment.strata(world, self.tuning))
        self._known[:] = [*self._known[1 - _KEPT :], (world, found)]
        return found

    def guided(self, world: World, views: Sequence[Projection]) -> Simulation:
        """Return the same simulation with light paths guided toward what any of the views sees.

        Emitters whose beams are bent along guides are left out, because their beams do not go where the paths go.
        """
        # Copies, because the pilot gives them guides.
        strata = [
            replace(each)
            for each in self.strata(world)
            if not world.sources[world.emitters[each.emitter.number].source].guides
        ]
        if not strata or not views:
            return self
        return replace(self, guides=Guides.of(strata, self.tracer(world, strata).guide(views)))

    def simulated(
        self, worlds: Sequence[World], number: int, looks: Mapping[str, Look | None] | None = None,
        step: Callable[[], None] = nothing,
    ) -> PassLight:  # fmt: skip
        """Return the light of pass `number`.

        Parameters
        ----------
        worlds
            The world at the start of the pass's time slice and, if anything moves, at its end. A light path straight
            from its lamp has the same samples at both times; scattered light is that of the start. An object that is
            identical in both worlds is at rest.
        looks
            Looks by the names of lamps and drawn beams, which replace those in the first world.
        step
            Called between parts of the pass; an exception from it ends the pass.
        """
        first, last = worlds[0], worlds[-1]
        strata, changed, scatters = self.strata(first), _changed(first, last), self.tuning.scatters
        # Light of a lamp that changes, and is not scattered, is traced at both times alone.
        traced = [each for each in strata if scatters or each.emitter.number not in changed]
        whole = self.tracer(first, traced, looks, step)
        still = last.surfaces is first.surfaces and last.media is first.media
        tried = [each for each in strata if not still or each.emitter.number in changed]
        sets: list[BeamSet] = []
        moving: Moving = {}
        if tried:
            opened, closed, known = (
                with_surrounds(each) if scatters else each
                for each in (tried, [_later(each, last) for each in tried], traced)
            )
            part = replace(whole, emission=Emission(opened), tuning=replace(self.tuning, max_bounces=0))
            numbers, media = _numbers(opened, known), renumbering(last, first)
            sets, moving = part.moved(last, closed, number, media, numbers, whole.emission.count)
        resting = whole.simulated(number, moving)
        sets = sorted(resting.sets + sets, key=lambda each: each.light) + _drawn(first, last, looks or {})
        dark = {each.number for each in first.media.all if self.tuning.visible and max(each.medium.scattering) <= 0}
        return resting._replace(sets=[each for each in sets if each.look is not None or each.medium not in dark])

    def tracer(
        self, world: World, strata: Sequence[Stratum], looks: Mapping[str, Look | None] | None = None,
        step: Callable[[], None] = nothing,
    ) -> LightTracer:  # fmt: skip
        """Return what traces strata in a world; `looks` and `step` are those of `simulated`."""
        tallied = {
            world.emitters[number].source for number, counts in self.allotment.counts.items() if counts & Counts.TALLIED
        }
        sources = [
            replace(
                each, look=each.look if looks is None else looks.get(each.name, each.look),
                tallied=each.number in tallied,
                unseen=frozenset(world.numbers[name] for name in self.walked.get(each.number, ())),
            )
            for each in world.sources
        ]  # fmt: skip
        return LightTracer(
            world, Emission(strata, self.allotment.shared), self.tuning, sources, self.named, self.allotment.walks, step
        )


def _numbers(some: Sequence[Stratum], strata: Sequence[Stratum]) -> UInt32:
    """Return the numbers that paths of some strata have among those of others, or else the number of all of these."""
    first = dict(zip((each.key for each in strata), np.cumsum([0, *(each.count for each in strata)]), strict=False))
    total = sum(each.count for each in strata)
    places = [first[each.key] + np.arange(each.count) if each.key in first else np.full(each.count, total)
              for each in some]  # fmt: skip
    return to_uint(np.concatenate(places))


def _later(stratum: Stratum, last: World) -> Stratum:
    """Return the stratum of the same light paths in the world `last`."""
    own = stratum.emitter
    emitter = PathEmitter(last, own.number, own.around, own.counts)
    if own.portal is not None:  # a fitted portal does not move
        emitter = emitter.at(last.emitters[own.number].portal or own.portal, own.through)
    return replace(stratum, emitter=emitter)


def renumbering(one: World, other: World) -> dict[int, int]:
    """Return the numbers of media in the world `other` of the same shot, by their numbers in the world `one`."""
    if one.media is other.media:
        return {}
    return {number: other.numbers[name] for name, number in one.numbers.items() if name in other.numbers}


def _changed(first: World, last: World) -> set[int]:
    """Return the numbers of lamps that are not the same at both times."""
    both = zip(first.emitters, last.emitters, strict=True)
    return {number for number, (emitter, later) in enumerate(both) if later.beams is not emitter.beams}


def _drawn(first: World, last: World, looks: Mapping[str, Look | None]) -> list[BeamSet]:
    """Return the drawn beams, in sets by the medium that they are in."""
    sets = []
    for number, (drawn, later) in enumerate(zip(first.drawn, last.drawn, strict=True)):
        moved = Beams(**later.arrays()) if later is not drawn and _are_same(drawn, later) else None
        look, index = looks.get(drawn.name, drawn.look), len(first.emitters) + number
        beams = Beams(**drawn.arrays())
        whole = BeamSet(drawn.group, look, beams, moved, drawn.name, index)
        sets += _by_media(first, whole)
    return sets


def _by_media(world: World, whole: BeamSet) -> list[BeamSet]:
    """Divide a set of beams by the media of their middles; beams in no medium are left out."""
    media = world.media.all
    if len(media) < 2 and not world.boundaries:
        return [whole._replace(medium=each.number) for each in media]
    beams = whole.beams
    axis = beams.end - beams.start
    middle = beams.start + 0.5 * axis
    found = world.medium_at(middle, dr.normalize(axis), dr.full(Bool, True, len(beams)))
    states = [beams] if whole.close is None else [beams, whole.close]
    result = []
    for each in media:
        kept = compressed(found == dr.opaque(UInt32, each.number), *states)
        if kept:
            close = kept[1] if len(kept) > 1 else None
            result.append(whole._replace(beams=kept[0], close=close, medium=each.number))
    return result


def _are_same(drawn: scene.DrawnBeams, later: scene.DrawnBeams) -> bool:
    """Return whether drawn beams at two times correspond one to one."""
    return len(later.start) == len(drawn.start) and later.arrays().keys() == drawn.arrays().keys()
