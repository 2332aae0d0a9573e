"""Simulation of a pass of a stage: at both ends of the pass's slice of the shutter interval, if anything moves."""

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
from ..world.stage_world import StageWorld
from .emission import PathEmitter, Stratum
from .fitted_portals import Opening, parted
from .guiding import GuidingMap
from .lamps import emission_of_lamps, guided_count, lamps_of, with_surrounds
from .segments.records import PhotonHits
from .simulation import Moving, Simulation, nothing
from .tuning import Tuning

if TYPE_CHECKING:
    from ..estimators.projection import Projection
    from ..looks import Look


@dataclass(frozen=True)
class StageSimulation:
    """The beams and photons of a stage, pass by pass.

    Attributes
    ----------
    tuning, beams
        How light paths are traced, and their number in a pass for lamps that do not set it themselves.
    light_side
        Names of lamps whose paths past their portal are wanted, too: see `portal_visibility`.
    guides
        Guiding maps of strata, by their keys.
    openings
        Fitted portals, by the keys of the strata that they divide into paths through them and past them.
    counts
        Numbers of paths of guided strata, by their keys: see `guided_count`.
    """

    tuning: Tuning
    beams: int = scene.DEFAULT_BEAMS
    light_side: Collection[str] = ()
    guides: Mapping[int, GuidingMap | None] = field(default_factory=dict)
    openings: Mapping[int, Opening] = field(default_factory=dict)
    counts: Mapping[int, int] = field(default_factory=dict)

    def guided(self, world: StageWorld, views: Sequence[Projection]) -> StageSimulation:
        """Return the same simulation with light paths guided toward what any of the views sees.

        Lamps whose beams are bent along guides are left out, because their beams do not go where the paths go.
        """
        strata = [each for each in self._strata(world) if not world.sources[each.emitter.source].guides]
        emission = emission_of_lamps(strata)
        found = Simulation(world, emission, self.tuning, world.sources, world.sizes, named=True).guide(views)
        guides = {stratum.key: stratum.guide for each in found for stratum in each.strata}
        both = zip(strata, found, strict=True)
        openings = {stratum.key: each.opening for stratum, each in both if each.opening is not None}
        counts = {stratum.key: guided_count(stratum) for each in found for stratum in each.strata}
        return replace(self, guides=guides, openings=openings, counts=counts)

    def simulated(
        self, worlds: Sequence[StageWorld], number: int, looks: Mapping[str, Look | None] | None = None,
        step: Callable[[], None] = nothing,
    ) -> tuple[list[BeamSet], list[PhotonHits]]:  # fmt: skip
        """Return the beams of pass `number` and its photons on surfaces.

        Parameters
        ----------
        worlds
            The stage at the start of the pass's time slice and, if anything moves, at its end. A light path straight
            from its lamp has the same samples at both times; scattered light is that of the start. An object that is
            identical in both worlds is at rest.
        looks
            Looks by the names of lamps and drawn beams, which replace those in the first world.
        step
            Called between parts of the pass; an exception from it ends the pass.
        """
        first, last = worlds[0], worlds[-1]
        sources = tuple(
            replace(each, look=each.look if looks is None else looks.get(each.name, each.look))
            for each in first.sources
        )
        strata, changed = self._strata(first), _changed(first, last)
        # Light of a lamp that changes, and is not scattered, is traced at both times alone.
        traced = [each for each in strata if self._scatters or each.emitter.source not in changed]
        emission = emission_of_lamps(traced, self._scatters)
        whole = Simulation(first, emission, self.tuning, sources, first.sizes, named=True, step=step)
        still = last.surfaces is first.surfaces and last.media is first.media
        tried = [each for each in strata if not still or each.emitter.source in changed]
        sets: list[BeamSet] = []
        moving: Moving = {}
        if tried:
            opened, closed, known = (
                with_surrounds(each) if self._scatters else each
                for each in (tried, [_later(each, last) for each in tried], traced)
            )
            straight = replace(self.tuning, max_bounces=0)
            part = replace(whole, emission=emission_of_lamps(list(opened), False), tuning=straight)
            numbers, media = _numbers(opened, known), renumbering(last, first)
            sets, moving = part.moved(last, closed, number, media, numbers, emission.count)
        resting, hits = whole.simulated(number, moving)
        sets = sorted(resting + sets, key=lambda each: each.light) + _drawn(first, last, looks or {})
        dark = {each.number for each in first.media.all if self.tuning.visible and max(each.medium.scattering) <= 0}
        return [each for each in sets if each.look is not None or each.medium not in dark], hits

    @property
    def _scatters(self) -> bool:
        return self.tuning.max_bounces is None or self.tuning.max_bounces > 0

    def _strata(self, world: StageWorld) -> list[Stratum]:
        """Return the light paths of a pass."""
        lit = self._scatters and self.tuning.surfaces
        tuning = self.tuning
        strata = lamps_of(
            world, self.beams, tuning.seed, self.light_side, lit, self._scatters, tuning.visible, tuning.overlap
        )
        strata = [part for each in strata for part in parted(each, self.openings.get(each.key))]
        return [
            replace(each, guide=self.guides.get(each.key), count=self.counts.get(each.key, each.count))
            for each in strata
        ]


def _numbers(some: Sequence[Stratum], strata: Sequence[Stratum]) -> UInt32:
    """Return the numbers that paths of some strata have among those of others, or else the number of all of these."""
    first = dict(zip((each.key for each in strata), np.cumsum([0, *(each.count for each in strata)]), strict=False))
    total = sum(each.count for each in strata)
    places = [first[each.key] + np.arange(each.count) if each.key in first else np.full(each.count, total)
              for each in some]  # fmt: skip
    return to_uint(np.concatenate(places))


def _later(stratum: Stratum, last: StageWorld) -> Stratum:
    """Return the stratum of the same light paths in the world `last`."""
    own = stratum.emitter
    emitter = PathEmitter(last, own.number, own.margin)
    if own.portal is not None:  # a fitted portal does not move
        emitter = emitter.at(last.emitters[own.number].portal or own.portal, own.through)
    return replace(stratum, emitter=emitter)


def renumbering(one: StageWorld, other: StageWorld) -> dict[int, int]:
    """Return the numbers of media in the world `other` of the same stage, by their numbers in the world `one`."""
    if one.media is other.media:
        return {}
    return {number: other.numbers[name] for name, number in one.numbers.items() if name in other.numbers}


def _changed(first: StageWorld, last: StageWorld) -> set[int]:
    """Return the numbers of lamps that are not the same at both times."""
    both = zip(first.emitters, last.emitters, strict=True)
    return {number for number, (emitter, later) in enumerate(both) if later.beams is not emitter.beams}


def _drawn(first: StageWorld, last: StageWorld, looks: Mapping[str, Look | None]) -> list[BeamSet]:
    """Return the drawn beams, in sets by the medium that they are in."""
    sets = []
    for number, drawn in enumerate(first.description.drawn):
        later = last.description.drawn[number]
        moved = Beams(**later.arrays()) if later is not drawn and _are_same(drawn, later) else None
        look, index = looks.get(drawn.name, drawn.look), len(first.emitters) + number
        beams = Beams(**drawn.arrays())
        whole = BeamSet(drawn.group, look, beams, moved, drawn.name, index)
        sets += _by_media(first, whole)
    return sets


def _by_media(world: StageWorld, whole: BeamSet) -> list[BeamSet]:
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
