"""Simulation of a pass: trace light paths through a world, and return their beams and photons."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, TypeVar

import drjit as dr
import numpy as np

from .. import scene
from ..beams import Beams
from ..beams.sets import BeamSet
from ..numerics.arrays import compressed, equal_entries, to_float, to_uint
from ..numerics.hashing import key_of
from ..runtime.device import Bool, Float, UInt32
from ..world.emitters.portals import count_candidates
from ..world.emitters.rays import EmittedRays
from ..world.emitters.sources import Source
from ..world.media.rendered import RenderedMedium
from ..world.stage_world import StageWorld
from ..world.world import World
from . import paths
from .aiming import Openings
from .connections import Connections
from .emission import Emission, PathEmitter, Stratum, probed_flux
from .fitted_portals import Opening, parted
from .fringes import Steps, entering, fringe, unscattered
from .guiding import GuidingMap
from .importance import CameraImportance, Sightings
from .lamps import (
    LIGHT_SIDE,
    guided_count,
    lit_fraction,
    radius_from_infinity,
    with_surrounds,
)
from .pilot import Found, guide
from .segments.beams import Cutting, Moments, moving_sets, sets_of
from .segments.radii import Limits
from .segments.records import LightPaths, PhotonHits, Segments

if TYPE_CHECKING:
    from ..estimators.projection import Projection
    from ..looks import Look

T = TypeVar("T")

#: A step of light paths: the medium beside which they pass, 0 for paths themselves, and the step's number.
Key = tuple[int, int]

#: For each step, whether light straight from its lamp moves, by the numbers of paths.
Moving = dict[Key, Bool]

# Most candidates for each path that passes its lamp's images, and most candidates of a stratum.
_MOST_DARK, _MOST_PATHS = 64, 1 << 22

_PORTAL, _ALL = 0, 1  # kinds of strata, as part of the seeds of their sequences

# Least and greatest radius as a fraction of a medium's radius (for photons, of the world's), and the greatest in free
# paths. Wide beams stick out of small media, and blur what changes within a free path. With these bounds, a ball of 10
# free paths is too dark by half a per cent after 16 passes; beams twice as wide would not lower the noise.
FLOOR, CEILING, FREE_PATHS = 1e-4, 0.05, 0.25


@dataclass(frozen=True)
class Tuning:
    """How light paths are traced: the fields of `render.settings.Settings` that transport reads.

    With `own_bounces`, each source sets the bounces of its light, up to `max_bounces`. With `visible`, only beams that
    a medium or a look shows are made; programs and files of beams want all.
    """

    seed: int = 0
    max_bounces: int | None = None
    rr_depth: int = 5
    overlap: float = 2.2
    alpha: float = 0.7
    radius: float | None = None
    min_radius: float | None = None
    max_radius: float | None = None
    short: bool = False
    surfaces: bool = True
    own_bounces: bool = False
    visible: bool = False

    def limits(self, number: int, size: float, widest: float = np.inf) -> Limits:
        """Return the bounds of radii in pass `number`, in a region of radius `size`; `widest` bounds the default."""
        low = self.radius or self.min_radius or FLOOR * size
        high = self.radius or self.max_radius or max(min(CEILING * size, widest), low)
        return Limits(*(dr.opaque(Float, each) for each in (low, high, radius_scale(self.alpha, number))))


def radius_scale(alpha: float, number: int) -> float:
    """Return the factor on radii in pass `number`: R_{i+1} / R_i = (i + α) / (i + 1) (Progressive Photon Beams)."""
    return float(np.prod([(i + alpha) / (i + 1) for i in range(1, number + 1)]))


def _nothing() -> None:
    """Do nothing between parts of a pass."""


def _stepping(step: Callable[[], None], parts: Iterable[T]) -> Iterator[T]:
    """Yield parts, and call `step` before each is used."""
    for each in parts:
        step()
        yield each


@dataclass(frozen=True)
class Simulation:
    """Light paths through a world, pass by pass.

    Attributes
    ----------
    world, emission, tuning
        The world that light meets, the light paths, and how they are traced.
    sources
        What the beams of each emitter have in common.
    sizes
        Radius of each medium, by number; a medium without an entry has the world's.
    named
        Whether beams carry what looks and programs may read.
    step
        Called between parts of a pass; an exception from it ends the pass.
    """

    world: World
    emission: Emission
    tuning: Tuning
    sources: Sequence[Source]
    sizes: Mapping[int, float]
    named: bool = False
    step: Callable[[], None] = _nothing

    def simulated(self, number: int, moving: Moving | None = None) -> tuple[list[BeamSet], list[PhotonHits]]:
        """Return the beams of pass `number`, and its photons on surfaces.

        `moving` says whose light straight from its lamp is left out.
        """
        # Keep only segments and hits, not the paths: a million of these take a gigabyte.
        moving = moving or {}
        tracing, begun = self._begun(number)
        steps = enumerate(_stepping(self.step, paths.trace(tracing, copy(begun))))
        traced = [((0, step), segments, hits) for step, (segments, hits) in steps]
        found = [(key, segments) for key, segments, _ in traced] + list(self._fringes(number, begun))
        segments = [part for key, each in found for part in _resting(each, moving.get(key))]
        hits = [each for _, _, each in traced if each is not None] if self.tuning.surfaces else []
        if not all(each.surfaces for each in self.sources):
            lights = to_uint([*(each.surfaces for each in self.sources), False])
            parts = (compressed(dr.gather(UInt32, lights, each.source) > 0, each) for each in hits)
            hits = [each for part in parts for each in part]
        return sets_of(self.world, _stepping(self.step, self.cuttings(number)), segments), hits

    def _begun(self, number: int) -> tuple[paths.Tracing, LightPaths | None]:
        """Return how the light paths of a pass are traced, and the paths as they leave their emitters."""
        if self.tuning.max_bounces is not None and self.tuning.max_bounces <= 0:
            tracing, emitted = self.tracing(number), self.emission.emit(number)
        else:
            strata = with_surrounds(self.emission.strata)
            emitted = [each.emit(number) for each in strata]
            tracing = replace(self.tracing(number), openings=Openings.of(strata, emitted))
        return tracing, paths.begin(tracing, emitted)

    def moved(
        self, last: World, later: Sequence[Stratum], number: int, media: Mapping[int, int], known: UInt32, total: int
    ) -> tuple[list[BeamSet], Moving]:  # fmt: skip
        """Return the moving beams straight from lamps, at both ends of the pass, and which light moves.

        Parameters
        ----------
        last, later
            The world at the end of the pass, and its lamps; this world is that at the start.
        number, media
            The pass, and the numbers of this world's media by their numbers in `last`.
        known, total
            The numbers of paths among those of `simulated`, which `total` counts, or `total` for paths that are not
            among them. Light whose segment is equal at both times is left to `simulated`.
        """
        tracing = [self.tracing(number), replace(self, world=last).tracing(number)]
        emitted = [self.emission.emit(number), [each.emit(number) for each in later]]
        begun = [paths.leaving(*each) for each in zip(tracing, emitted, strict=True)]
        if begun[0] is None or begun[1] is None:
            return [], {}
        alive = (begun[0].initial > 0) | (begun[1].initial > 0)
        kept = compressed(alive, *begun)
        if not kept:
            return [], {}
        place = dr.gather(UInt32, known, kept[0].number)
        apart = place == dr.opaque(UInt32, total)
        steps: list[Moments] = []
        moving: Moving = {}
        pairs = self._pairs(tracing, kept, number, {own: other for other, own in media.items()})
        for key, (opened, there), (closed, then) in _stepping(self.step, pairs):
            if closed is not None:
                closed = copy(closed)
                closed.medium = _renumbered(closed.medium, media)
            ends = [each for each in (opened, closed) if each is not None]  # one of the two may have ended
            nowhere = dr.zeros(Bool, dr.width(ends[0].length))
            masks = [nowhere if mask is None else mask for mask in (there, then)]
            masks = [
                there & (each.medium > 0) & (each.length > 0)
                for there, each in zip(masks, (ends[0], ends[-1]), strict=True)
            ]
            moves = apart | (masks[0] != masks[1]) | ~equal_entries(ends[0], ends[-1])
            of_paths = dr.zeros(Bool, total + 1)
            dr.scatter(of_paths, Bool(True), place, moves)
            dr.eval(of_paths)
            moving[key] = of_paths
            steps.append(([ends[0], ends[-1]], [mask & moves for mask in masks]))
        return moving_sets(_stepping(self.step, self.cuttings(number)), steps, last.sources), moving

    def tracing(self, number: int) -> paths.Tracing:
        """Return how the light paths of a pass are traced."""
        tuning = self.tuning
        region = max((self.size(each) for each in self.world.media.all), default=self.world.radius)
        return paths.Tracing(
            self.world, tuning.max_bounces, tuning.rr_depth, tuning.overlap, region,
            *self.emission.shares(len(self.sources)), tuning.short, radius_scale(tuning.alpha, number),
            self._bounces_by_source(), self._caustics_by_source(), endless=self._endless_by_source(),
        )  # fmt: skip

    def _pairs(
        self, tracing: Sequence[paths.Tracing], begun: Sequence[LightPaths], number: int, media: Mapping[int, int]
    ) -> Iterator[tuple[Any, ...]]:
        """Yield segments of light straight from lamps at both times, by their keys.

        `media` has the numbers of media at the second time.
        """
        straight = [unscattered(each, start) for each, start in zip(tracing, begun, strict=True)]
        own = {medium: medium for medium in self.world.boxes}
        fringes = [
            {medium: self._fringe(each, start, steps, number, medium, there.get(medium, medium)) for medium in own}
            for each, start, steps, there in zip(tracing, begun, straight, (own, media), strict=True)
        ]
        keyed: dict[int, list[Any]] = {0: list(straight)}
        keyed.update({medium: [each[medium] for each in fringes] for medium in own})
        for medium, both in keyed.items():
            for step, pair in enumerate(zip_longest(*both, fillvalue=(None, None))):
                yield (medium, step), pair[0], pair[1]

    def _fringes(self, number: int, begun: LightPaths | None) -> Iterator[tuple[Key, Segments | None]]:
        """Yield segments of light straight from lamps that passes beside media, by their keys."""
        if begun is None or not self.world.boxes:
            return
        tracing = self.tracing(number)
        only = next(iter(self.world.boxes)) if len(self.world.boxes) == 1 else None
        straight = unscattered(tracing, begun, None if only is None else entering(only))
        for medium in self.world.boxes:
            for step, (segments, there) in enumerate(self._fringe(tracing, begun, straight, number, medium, medium)):
                yield (medium, step), paths.kept(there, segments)

    def _fringe(
        self, tracing: paths.Tracing, begun: LightPaths, straight: Steps, number: int, medium: int, there: int
    ) -> Iterator[tuple[Segments, Bool]]:
        """Yield segments beside a medium, which has the number `there` in the world of `tracing`."""
        rendered = next(each for each in self.world.media.all if each.number == medium)
        if there not in tracing.world.boxes:
            return iter(())
        limits = self._both_limits(number, rendered)[1]
        reentrant = there in tracing.world.reentrant
        return fringe(tracing, begun, straight, there, tracing.world.boxes[there], limits, reentrant)

    def guide(self, views: Sequence[Projection]) -> list[Found]:
        """Guide emission toward what the views see, and return what is found out about each stratum."""
        camera, tracing = CameraImportance(self.world, views), self.tracing(0)

        def seen(emitted: list[EmittedRays]) -> Sightings:
            begun = paths.begin(tracing, emitted)
            beside = [(each, None) for _, each in self._fringes(0, begun) if each is not None]
            steps = [*paths.trace(tracing, copy(begun)), *beside]
            surfaces = self.tuning.surfaces
            return Sightings.joined([camera.seen(segments, hits if surfaces else None) for segments, hits in steps])

        if not isinstance(self.world, StageWorld):
            return guide(self.emission.strata, seen, self.world)
        lines, straight = Connections(self.world, views), self.tuning.max_bounces == 0
        return guide(self.emission.strata, seen, self.world, lambda each: lines(each.emitter), straight)

    def _bounces_by_source(self) -> Any:
        """Return the most bounces, by the numbers of sources; None if they are the same for all."""
        bounces, most = [each.bounces for each in self.sources], self.tuning.max_bounces
        if not self.tuning.own_bounces or all(each is None for each in bounces):
            return None
        return to_uint([*(each or 0 for each in bounces), 0]) if most is not None else None

    def _endless_by_source(self) -> Any:
        """Return the length at which light in endless media ends, by the numbers of sources; 0: by the bounds.

        Programs, and files of beams, get beams that end by the bounds.
        """
        length = self.world.endless if self.tuning.visible else 0.0
        return to_float([*(length if each.endless else 0.0 for each in self.sources), 0.0])

    def _caustics_by_source(self) -> Any:
        """Return which sources' light only counts as caustics, by their numbers; None if no source's does."""
        if not any(each.caustics for each in self.sources):
            return None
        return to_uint([*(each.caustics for each in self.sources), False])

    def cuttings(self, number: int) -> list[Cutting]:
        """Return how the segments of a pass become beams, for each medium and each source that makes beams in it."""
        fixed = bool(self.tuning.radius or self.tuning.max_radius)
        free_paths = np.inf if fixed else FREE_PATHS
        longest = None if fixed else dr.opaque(Float, scene.ESCAPE * self.world.extent)
        return [
            Cutting(
                medium,
                source,
                *self._both_limits(number, medium),
                self.named,
                self.tuning.short,
                free_paths,
                self.world.boxes.get(medium.number),
                medium.number in self.world.reentrant,
                longest,
            )
            for source in self.sources
            for medium in self.world.media.all
            if self._shown(source, medium)
            and (source.beams or (source.scattered_beams and medium.number in self.world.lit_by_domes))
        ]

    def _shown(self, source: Source, medium: RenderedMedium) -> bool:
        """Return whether beams of a source in a medium are wanted; a look may show them even if the medium does not."""
        return max(medium.medium.scattering) > 0 or (self.named and not (self.tuning.visible and source.look is None))

    def _both_limits(self, number: int, medium: RenderedMedium) -> tuple[Limits, Limits]:
        """Return the bounds of radii for scattered light, and for light straight from an emitter."""
        widest = np.inf if medium.tracked is not None else FREE_PATHS / max(*medium.medium.extinction, 1e-30)
        limits = self.tuning.limits(number, self.size(medium), widest)
        if not self.world.narrows or self.tuning.radius or self.tuning.max_radius:
            return limits, limits
        # Without a ceiling: `narrowing` keeps each wide beam out of walls.
        return limits, limits._replace(ceiling=dr.opaque(Float, np.inf))

    def size(self, medium: RenderedMedium) -> float:
        """Return the radius of a medium, at most that of the region with everything in it."""
        return min(self.sizes.get(medium.number, np.inf), self.world.extent)


def lamps_of(
    world: StageWorld, beams: int, seed: int, light_side: Collection[str], surfaces: bool = False,
    scatters: bool = False, visible: bool = False, overlap: float = Tuning.overlap,
) -> list[Stratum]:  # fmt: skip
    """Return the strata of a stage's lamps that make beams, or light `surfaces`, each with a fixed number of paths.

    A lamp without a portal has one stratum, with all its directions. A lamp with a portal has two that add up to it:
    the paths through the portal and, if the camera sees the lamp's side of the portal, all others.

    Parameters
    ----------
    world
        The stage.
    beams, seed
        Light paths in a pass, for lamps that do not set the number themselves; and the seed of the sequences.
    light_side
        Names of lamps whose paths past the portal are wanted, too.
    surfaces
        Whether lamps that light surfaces are included, even if they make no beams.
    scatters
        Whether light is scattered more than once. Domes that light media without beams are then included, because their
        scattered light makes beams.
    visible
        Whether only visible beams count. Lamps without a look then make none if no medium scatters light.
    overlap
        Width of a beam in spacings of its neighbours.
    """
    result = []
    hazy = not visible or any(max(each.scattering) > 0 for each in world.description.media)
    for number, emitter in enumerate(world.emitters):
        light = emitter.beams
        count = beams if light.beam_count is None else light.beam_count
        wanted = (light.emits_beams and (hazy or light.look is not None)) or (
            surfaces and light.lights_surfaces and light.shines
        )
        wanted |= scatters and any(light is each for each in world.description.sky)
        if not wanted or count <= 0:
            continue
        aside = count
        if emitter.portal is not None:
            aside = max(1, round(LIGHT_SIDE * count)) if emitter.name in light_side else 0
            result.append(_stratum(world, number, seed, count - aside, overlap, through=True))
        if aside:
            result.append(_stratum(world, number, seed, aside, overlap, through=False))
    return result


def _stratum(
    world: StageWorld, number: int, seed: int, count: int, overlap: float, through: bool
) -> Stratum:  # fmt: skip
    """Return the stratum of a lamp's paths through its portal, or past it, of which about `count` carry light."""
    own, portal = world.emitters[number], world.emitters[number].portal
    margin = radius_from_infinity(own.lamp, count, overlap) if world.boxes else 0.0
    lamp = PathEmitter(world, number, margin)
    emitter = lamp if portal is None else lamp.at(portal, through)
    most = max(count, min(_MOST_DARK * count, _MOST_PATHS))
    count = min(count_candidates(max(lit_fraction(emitter), 1 / _MOST_DARK), count), most)
    if through and portal is not None:
        count = count_candidates(portal.fill, count)
    kind = _PORTAL if through else _ALL
    return Stratum(emitter, count, (seed & 0xFFFFFFFF, own.beams.seed & 0xFFFFFFFF, kind, key_of(own.name)))


def emission_of_lamps(strata: list[Stratum], probed: bool = True) -> Emission:
    """Return the emission of lamps; their power is measured if `probed`, else 0."""
    powers = {each.emitter.source: np.zeros(3) for each in strata}
    for number, each in enumerate(strata if probed else []):
        powers[each.emitter.source] += probed_flux(each.emitter, number)
    return Emission(strata, sum(powers.values(), np.zeros(3)), powers)


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
        step: Callable[[], None] = _nothing,
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


def _resting(segments: Segments | None, moving: Bool | None) -> list[Segments]:
    """Return segments without light straight from lamps that is `moving`, by numbers of paths: one struct, or none."""
    if segments is None or moving is None:
        return [] if segments is None else [segments]
    moves = (segments.depth == 0) & dr.gather(Bool, moving, segments.number)
    return compressed(~moves, segments)


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


def _renumbered(numbers: UInt32, media: Mapping[int, int]) -> UInt32:
    result = numbers
    for old, new in media.items():
        result = dr.select(numbers == dr.opaque(UInt32, old), dr.opaque(UInt32, new), result)
    return result


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
