"""Tracing the light paths of a pass through a world, into beams and photons."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import drjit as dr
import numpy as np

from .. import scene
from ..beams.sets import BeamSet
from ..numerics.arrays import compressed, equal_entries, to_float, to_numpy, to_uint
from ..runtime.device import Bool, Float, UInt32
from ..runtime.digest import equal
from ..world.emitters.rays import EmittedRays
from ..world.emitters.sources import Source
from ..world.media.rendered import RenderedMedium
from ..world.world import World
from . import paths
from .aiming import Openings
from .emission import Emission, Stratum
from .fringes import Steps, entering, fringe, unscattered
from .guiding.importance import CameraImportance, Sightings
from .guiding.lines import LightLines
from .guiding.pilot import Found, guide
from .segments.beams import Cutting, Moments, moving_sets, sets_of
from .segments.density import widened
from .segments.radii import Limits
from .segments.records import Counts, LightPaths, PhotonHits, Segments
from .strata import with_surrounds
from .tally import Tally, TallyBeginnings
from .tuning import FREE_PATHS, Tuning, own_bounces, radius_scale

if TYPE_CHECKING:
    from ..estimators.projection import Projection

T = TypeVar("T")

# Walks of a tally that begin on the same light path, and the fewest light paths of a stratum on which they begin.
_WALKS_ON_PATH, _FEWEST = 8, 64
# This part of them goes everywhere, even where the guide knows what cameras see.
_EVERYWHERE = 0.5

#: A step of light paths: the medium beside which they pass, 0 for paths themselves, and the step's number.
Key = tuple[int, int]

#: For each step, whether light straight from its lamp moves, by the numbers of paths.
Moving = dict[Key, Bool]


class Reach(NamedTuple):
    """Which part of the light straight from an emitter gets into fog, and which part each camera sees."""

    in_fog: float
    seen: Sequence[float]


class PassLight(NamedTuple):
    """The light of a pass: beams, photons on surfaces, and the walks of its tally, or None."""

    sets: list[BeamSet]
    hits: list[PhotonHits]
    tally: Tally | None


def nothing() -> None:
    """Do nothing between parts of a pass."""


def stepping(step: Callable[[], None], parts: Iterable[T]) -> Iterator[T]:
    """Yield parts, and call `step` before each is used."""
    for each in parts:
        step()
        yield each


@dataclass(frozen=True)
class LightTracer:
    """Light paths through the world of one time, pass by pass.

    Attributes
    ----------
    world, emission, tuning
        The world that light meets, the light paths, and how they are traced.
    sources
        What the beams of each emitter have in common.
    named, walks
        Whether beams carry what looks and programs may read; and about how many walks a tally has.
    step
        Called between parts of a pass; an exception from it ends the pass.
    """

    world: World
    emission: Emission
    tuning: Tuning
    sources: Sequence[Source]
    named: bool = False
    walks: int = 0
    step: Callable[[], None] = nothing

    def simulated(self, number: int, moving: Moving | None = None) -> PassLight:
        """Return the light of pass `number`.

        `moving` says whose light straight from its lamp is left out.
        """
        # Keep only segments and hits, not the paths: a million of these take a gigabyte.
        moving, (tracing, begun) = moving or {}, self._begun(number)
        steps = enumerate(stepping(self.step, paths.trace(tracing, copy(begun))))
        traced = [((0, step), segments, hits) for step, (segments, hits) in steps]
        found = [(key, segments) for key, segments, _ in traced] + list(self._fringes(number, begun))
        segments = [part for key, each in found for part in _resting(each, moving.get(key))]
        if self.tuning.scatters:
            segments = widened(segments, np.ravel(self.world.bounds.center.numpy()), self.world.extent)
        hits = [each for _, _, each in traced if each is not None] if self.tuning.surfaces else []
        if not all(each.surfaces for each in self.sources):
            lights = to_uint([*(each.surfaces for each in self.sources), False])
            parts = (compressed(dr.gather(UInt32, lights, each.source) > 0, each) for each in hits)
            hits = [each for part in parts for each in part]
        sets = sets_of(self.world, stepping(self.step, self.cuttings(number)), segments)
        return PassLight(sets, hits, self._tally(number, tracing))

    def _tally(self, number: int, tracing: paths.Tracing) -> Tally | None:
        """Return the walks of a pass's tally, or None.

        They begin on light paths of their own. Beams are made of few, whose neighbours are known; walks on the same
        path have the same noise, and more of them would not lower it.
        """
        tallied = [each for each in self.emission.strata if each.emitter.counts & Counts.TALLIED]
        if not tallied:
            return None
        many = self.walks / (_WALKS_ON_PATH * sum(each.count for each in tallied))
        counts = [max(round(many * each.count), _FEWEST) for each in tallied]
        guides = [each.guide and each.guide.evened(_EVERYWHERE) for each in tallied]
        own = zip(tallied, counts, guides, strict=True)
        strata = with_surrounds([replace(each, count=count, guide=guide) for each, count, guide in own])
        rays = [each.emit(number) for each in strata]
        emitted = [replace(each, halvings=0, counts=each.counts & int(Counts.TALLIED)) for each in rays]
        beginnings = TallyBeginnings(tracing)
        for _ in paths.trace(tracing, paths.begin(tracing, emitted), beginnings):
            self.step()
        return beginnings.tally(self.tuning.alpha)

    def _begun(self, number: int) -> tuple[paths.Tracing, LightPaths | None]:
        """Return how the light paths of a pass are traced, and the paths as they leave their emitters."""
        if not self.tuning.scatters:
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
        changed = self._filters_move(last)
        steps: list[Moments] = []
        moving: Moving = {}
        pairs = self._pairs(tracing, kept, number, {own: other for other, own in media.items()})
        for key, (opened, there), (closed, then) in stepping(self.step, pairs):
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
            moves |= dr.gather(UInt32, changed, ends[0].source) > 0
            of_paths = dr.zeros(Bool, total + 1)
            dr.scatter(of_paths, Bool(True), place, moves)
            dr.eval(of_paths)
            moving[key] = of_paths
            steps.append(([ends[0], ends[-1]], [mask & moves for mask in masks]))
        return moving_sets(stepping(self.step, self.cuttings(number)), steps, last.sources), moving

    def _filters_move(self, last: World) -> UInt32:
        """Return whether the filters of sources change from the start to the end of the pass, 1 or 0, by numbers."""
        result = np.zeros(len(self.sources) + 1, dtype=np.uint32)
        for emitter, later in zip(self.world.emitters, last.emitters, strict=True):
            result[emitter.source] |= not equal(emitter.beams.filters, later.beams.filters)
        return to_uint(result)

    def tracing(self, number: int) -> paths.Tracing:
        """Return how the light paths of a pass are traced."""
        tuning, count = self.tuning, len(self.sources)
        bounces = own_bounces(self.sources, tuning)
        region = max((self.world.radius_of(each) for each in self.world.media.all), default=self.world.radius)
        return paths.Tracing(
            world=self.world,
            max_bounces=tuning.max_bounces,
            rr_depth=tuning.rr_depth,
            overlap=tuning.overlap,
            region=region,
            paths=self.emission.counts(count),
            power=self.emission.powers(count) if tuning.scatters else [0.0] * count,
            short=tuning.short,
            scale=radius_scale(tuning.alpha, number),
            bounces_by_source=None if bounces is None else to_uint([*bounces, 0]),
            endless=self._endless_by_source(),
            walks=self.walks,
        )

    def _pairs(
        self, tracing: Sequence[paths.Tracing], begun: Sequence[LightPaths], number: int, media: Mapping[int, int]
    ) -> Iterator[tuple[Any, ...]]:
        """Yield segments of light straight from lamps at both times, by their keys.

        `media` has the numbers of media at the second time.
        """
        straight = [unscattered(each, start) for each, start in zip(tracing, begun, strict=True)]
        own = {medium: medium for medium in self.world.fringed}
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
        media = [*self.world.fringed]
        if begun is None or not media:
            return
        tracing = self.tracing(number)
        only = media[0] if len(media) == 1 else None
        straight = unscattered(tracing, begun, None if only is None else entering(only))
        for medium in media:
            for step, (segments, there) in enumerate(self._fringe(tracing, begun, straight, number, medium, medium)):
                yield (medium, step), paths.kept(there, segments)

    def _fringe(
        self, tracing: paths.Tracing, begun: LightPaths, straight: Steps, number: int, medium: int, there: int
    ) -> Iterator[tuple[Segments, Bool]]:
        """Yield segments beside a medium, which has the number `there` in the world of `tracing`."""
        rendered = next(each for each in self.world.media.all if each.number == medium)
        if there not in tracing.world.fringed:
            return iter(())
        limits = self._both_limits(number, rendered)[1]
        reentrant = there in tracing.world.reentrant
        return fringe(tracing, begun, straight, there, tracing.world.fringed[there], limits, reentrant)

    def reach(self, cameras: Sequence[Sequence[Projection]]) -> Reach:
        """Return which part of the light straight from its emitters gets into fog, and is seen by the views of each."""
        tracing, emitted = self.tracing(0), [replace(each, halvings=0) for each in self.emission.emit(0)]
        flux = np.concatenate([to_numpy(each.flux).max(axis=0) for each in emitted])
        seen = [[CameraImportance(self.world, [view]) for view in views] for views in cameras]
        reached = np.zeros((1 + len(cameras), len(flux)), dtype=bool)
        for segments, _ in paths.trace(tracing, paths.begin(tracing, emitted)):
            if segments is not None:
                reached[0, segments.number.numpy()] = True
                for own, views in zip(reached[1:], seen, strict=True):
                    for view in views:
                        own[view.seen(segments, None).path] = True
        in_fog, *by = (reached @ flux / max(flux.sum(), 1e-30)).tolist()
        return Reach(in_fog, by)

    def guide(self, views: Sequence[Projection], thorough: bool = False) -> list[Found]:
        """Guide emission toward what the views see, and return what is found out about each stratum.

        If it is `thorough`, that is also asked where light straight from its emitter needs no guide.
        """
        camera, tracing = CameraImportance(self.world, views), self.tracing(0)

        def seen(emitted: list[EmittedRays]) -> Sightings:
            begun = paths.begin(tracing, emitted)
            beside = [(each, None) for _, each in self._fringes(0, begun) if each is not None]
            steps = [*paths.trace(tracing, copy(begun)), *beside]
            surfaces = self.tuning.surfaces
            return Sightings.joined([camera.seen(segments, hits if surfaces else None) for segments, hits in steps])

        lines, straight = LightLines(self.world, views), self.tuning.max_bounces == 0 and not thorough
        return guide(self.emission.strata, seen, self.world, lambda each: lines.to_fog(each.emitter), straight)

    def _endless_by_source(self) -> Any:
        """Return the length at which light in endless media ends, by the numbers of sources; 0: by the bounds.

        Programs, and files of beams, get beams that end by the bounds.
        """
        length = self.world.endless if self.tuning.visible else 0.0
        return to_float([*(length if each.endless else 0.0 for each in self.sources), 0.0])

    def cuttings(self, number: int) -> list[Cutting]:
        """Return how the segments of a pass become beams, for each medium and each source that makes beams in it."""
        fixed = bool(self.tuning.radius or self.tuning.max_radius)
        free_paths = np.inf if fixed else FREE_PATHS
        longest = None if fixed else dr.opaque(Float, scene.ESCAPE * self.world.extent)
        limits = {each.number: self._both_limits(number, each) for each in self.world.media.all}
        return [
            Cutting(
                medium=medium,
                source=source,
                limits=limits[medium.number][0],
                straight=limits[medium.number][1],
                named=self.named,
                short=self.tuning.short,
                free_paths=free_paths,
                box=self.world.fringed.get(medium.number),
                reentrant=medium.number in self.world.reentrant,
                longest=longest,
                walls=self.tuning.scatters and bool(self.world.surfaces.shapes()),
                chain=self.world.linking.chain,
            )
            for source in self.sources
            for medium in self.world.media.all
            if self._shown(source, medium) and (source.beams or source.scattered_beams)
        ]

    def _shown(self, source: Source, medium: RenderedMedium) -> bool:
        """Return whether beams of a source in a medium are wanted; a look may show them even if the medium does not."""
        if medium.number in source.unseen or (medium.number in source.unlit and not self.tuning.scatters):
            return False
        return max(medium.medium.scattering) > 0 or (self.named and not (self.tuning.visible and source.look is None))

    def _both_limits(self, number: int, medium: RenderedMedium) -> tuple[Limits, Limits]:
        """Return the bounds of radii for scattered light, and for light straight from an emitter."""
        widest = np.inf if medium.tracked is not None else FREE_PATHS / max(*medium.medium.extinction, 1e-30)
        limits = self.tuning.limits(number, self.world.radius_of(medium), widest)
        if not self.world.apart or self.tuning.radius or self.tuning.max_radius:
            return limits, limits
        # `narrowing` keeps each wide beam out of walls.
        return limits, limits._replace(ceiling=dr.opaque(Float, self.tuning.widest(self.world, medium)))


def _resting(segments: Segments | None, moving: Bool | None) -> list[Segments]:
    """Return segments without light straight from lamps that is `moving`, by numbers of paths: one struct, or none."""
    if segments is None or moving is None:
        return [] if segments is None else [segments]
    moves = (segments.depth == 0) & dr.gather(Bool, moving, segments.number)
    return compressed(~moves, segments)


def _renumbered(numbers: UInt32, media: Mapping[int, int]) -> UInt32:
    result = numbers
    for old, new in media.items():
        result = dr.select(numbers == dr.opaque(UInt32, old), dr.opaque(UInt32, new), result)
    return result
