"""Light that was scattered before, in media: walks of light whose fluence is tallied in cells.

The beams of a pass carry what comes straight from lamps, or by mirrors and glass alone. On other light paths of that
kind walks begin, where the medium scatters their light, or at the surfaces at their ends: as many as are needed for
each to carry about the same power w. On every further segment some stratified points at distances s, of the density q
together, tell the fluence: a = w T(s) / q each, where the transmittance T is exp(−σt s), or its estimate in media that
vary. Then the walk goes on as light does, by free flights, phase functions and BSDFs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import joined, taken, to_float, to_numpy, to_uint
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..numerics.streams import Stream
from ..numerics.structs import Struct
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..scene import Array
from ..world.media.phases import Phases
from .interactions import REFLECTED, SAMPLED, SCATTERED, TINTED, flown, reflect, survival
from .segments.records import Counts, LightPaths
from .splitting import scattered_and_reflected
from .tracing import Tracing

# Points on each segment, and most steps of a walk.
_POINTS, _STEPS = 16, 1024
# No light gets farther than so many free paths.
_DARK = 20.0


class Deposit(Struct):
    """The light of walks at points: directions of the light, its medium, the source, and the fluence times a volume."""

    place: Array3f
    direction: Array3f
    medium: UInt32
    source: UInt32
    light: Array3f


class TallyStarts(Struct):
    """Where walks begin: light paths as in `LightPaths`, each with the kind of its next interaction, `branch`.

    `seed` is the seed of a walk's samples, `initial` its power once it begins, and `low` and `high` bound its stratum
    among those that begin on the same path.
    """

    origin: Array3f
    direction: Array3f
    flux: Array3f
    medium: UInt32
    source: UInt32
    link: UInt32
    depth: UInt32
    straight: Bool
    offset: Float
    reach: Float
    seed: UInt32
    branch: UInt32
    low: Float
    high: Float
    initial: Float


class LightWalk(Struct):
    """Walks of light: rays, their power, the media in which they begin, and how often the light was scattered."""

    origin: Array3f
    direction: Array3f
    flux: Array3f
    medium: UInt32
    depth: UInt32


class _Passed(Struct):
    """Points on walks' segments: their distances, and the transmittance up to there."""

    distance: Float
    transmittance: Array3f


@dataclass(frozen=True)
class Tally:
    """The walks of a pass: how they go on, and where they begin.

    `alpha` is that of `radius_scale`, by which the blur of the fluence shrinks from pass to pass. `media` has the
    numbers of its media in the world that cameras see, if that is another one.
    """

    tracing: Tracing
    starts: TallyStarts
    alpha: float
    media: Mapping[int, int] = field(default_factory=dict)

    def fill(self, deposit: Callable[[Deposit, Bool], None], eye: Array3f | None) -> None:
        """Follow all walks, and call `deposit` with their light, and whether there is any, within a kernel.

        Half of the points are there for an `eye`, near to which little volume is seen; None: it is far away.
        """
        start, walk = self.starts, LightWalk()
        for name in ("origin", "direction", "flux", "medium", "depth"):
            setattr(walk, name, getattr(start, name))

        def further(walk: LightWalk, going: Bool, number: UInt32) -> tuple[Any, ...]:
            following, goes = self._step(walk, going, number, partial(self._deposit, deposit, eye))
            return following, goes, number + 1

        width = dr.width(start.seed)
        state = walk, dr.full(Bool, True, width), dr.zeros(UInt32, width)
        last = dr.while_loop(state, lambda _, going, number: going & (number < _STEPS), further, label="tally")
        dr.eval(last[2])

    def _step(
        self, walk: LightWalk, going: Bool, number: UInt32, deposit: Callable[[LightWalk, Float, UInt32, Bool], None]
    ) -> tuple[LightWalk, Bool]:  # fmt: skip
        """Return the walks after their next interaction, and which of them go on."""
        tracing, start, first = self.tracing, self.starts, number == 0
        world, seed = tracing.world, hash32(start.seed, number)
        hit = world.intersect(
            walk.origin, walk.direction, going, hash32(seed, UInt32(Stream.FOG)), dr.select(first, start.link, 0)
        )
        met = going & hit.is_valid()
        reach = dr.minimum(dr.select(first, start.reach, world.escape(walk.origin, walk.direction)), 1e30)
        length = dr.select(met, hit.t, dr.select(walk.medium > 0, reach, 0))
        tallied = going & ~first & (walk.medium > 0) & (length > 0) & tracing.within(walk.depth, start.source)
        deposit(walk, length, seed, tallied)
        distance, weight = self._flown(walk, length, going, first, seed)
        scatters = going & (distance < length)
        on_surface = met & ~scatters & (~first | (start.branch == REFLECTED))
        position = walk.origin + dr.minimum(distance, length) * walk.direction
        site = dr.select(on_surface, world.linking.of_surfaces(hit), walk.medium)
        weight *= self._straight(walk, position, site, seed, first)
        turned, factor = _turned(walk, position, seed, scatters)
        scatter = reflect(world, hit, on_surface, walk.medium, seed, number)
        following = LightWalk()
        following.origin = dr.select(scatters, position, scatter.origin)
        following.direction = dr.select(scatters, turned, scatter.direction)
        following.medium = dr.select(scatters, walk.medium, scatter.medium)
        following.flux = walk.flux * weight * dr.select(scatters, factor, scatter.weight)
        following.depth = walk.depth + dr.select(on_surface & scatter.null, 0, 1)
        # What mirrors and glass turn straight from lamps goes on as a light path of its own.
        goes = scatters | (on_surface & ~(first & scatter.delta))
        goes &= (dr.max(following.flux) > 0) & tracing.within(following.depth, start.source)
        left = survival(dr.max(following.flux) * dr.rcp(dr.maximum(start.initial, 1e-30)), following.depth)
        following.flux *= dr.rcp(dr.maximum(left, 1e-30))
        return following, goes & (unit_float(hash32(seed, UInt32(Stream.ROULETTE))) < left)

    def _flown(
        self, walk: LightWalk, length: Float, going: Bool, first: Bool, seed: UInt32
    ) -> tuple[Float, Array3f]:  # fmt: skip
        """Return the distances of walks' free flights, and their weights; the first ones end as `branch` says."""
        media, start = self.tracing.world.media, self.starts
        u, own = pixel_sample(seed, UInt32(Stream.FLIGHT)), hash32(seed, UInt32(Stream.FLIGHT))
        u.y = dr.select(first & (start.branch == SCATTERED), dr.lerp(start.low, start.high, u.y), u.y)
        fractions = walk.flux * dr.rcp(dr.maximum(dr.sum(walk.flux), 1e-30))
        flight = flown(
            media, walk, length, branch=dr.select(first, start.branch, UInt32(SAMPLED)), fractions=fractions,
            active=going & ~first, u=u, seed=own,
        )  # fmt: skip
        distance, weight = flight.distance, flight.weight
        if media.any_varying:
            varying, _ = media.varying(walk.medium)
            ray, begins = (walk.medium, walk.origin, walk.direction), going & first & varying
            inside = start.branch == SCATTERED
            point, factor = media.scattering_point(*ray, length, seed=own, sample=u.y, active=begins & inside, fine=1)
            place: Any = dr.select(inside, dr.minimum(point, length * (1 - 1e-6)), dr.inf)
            passed = media.transmittance(*ray, length, own, begins & ~inside)
            distance = dr.select(begins, place, distance)
            weight = dr.select(begins, dr.select(inside, factor, passed), weight)
        return distance, weight

    def _straight(self, walk: LightWalk, position: Array3f, site: UInt32, seed: UInt32, first: Bool) -> Array3f:
        """Return what filters and links of lamps leave of light straight from these where it is first scattered."""
        world, start, result = self.tracing.world, self.starts, Array3f(1)
        if world.filters is not None:
            away = start.offset + dr.norm(position - walk.origin)
            acting = world.linking.acting(start.source, site)
            result = world.filters.factor(
                start.source, position, -walk.direction, away, hash32(seed, UInt32(Stream.FILTER)),
                first & start.straight, acting,
            )  # fmt: skip
        straight = first & (start.depth == 0)
        lit = world.linking.lights(start.source, site, straight)
        return dr.select(straight & ~lit, 0, result)

    def _deposit(
        self, deposit: Callable[[Deposit, Bool], None], eye: Array3f | None, walk: LightWalk, length: Float,
        seed: UInt32, active: Bool,
    ) -> None:  # fmt: skip
        """Deposit the light of walks' segments at stratified points.

        With an eye, every second point is equiangular around it (Kulla and Fajardo 2012): with its distance D from the
        ray, which is least at c, its density is D / ((b − a) (D² + (s − c)²)), with the angles a and b to both ends.
        Each counts with the density of both kinds together (balance heuristic). Points of a kind are in order, so that
        the transmittance up to each is that up to the one before it, times that between them.
        """
        media = self.tracing.world.media
        varying, _ = media.varying(walk.medium)
        dark = _DARK * dr.rcp(dr.maximum(dr.min(media.extinction(walk.medium)), 1e-30))
        end = dr.minimum(length, dr.select(varying, dr.inf, dark))
        _, end = media.extent(walk.medium, walk.origin, walk.direction, end)
        kinds = 1 if eye is None else 2
        center = dr.dot((walk.origin if eye is None else eye) - walk.origin, walk.direction)
        apart = dr.norm((walk.origin if eye is None else eye) - walk.origin - center * walk.direction)
        apart = dr.maximum(apart, 1e-4 * end)
        first, last = dr.atan2(-center, apart), dr.atan2(end - center, apart)

        def point(number: UInt32, before: _Passed, other: _Passed) -> tuple[Any, ...]:
            random = hash32(seed, number, UInt32(Stream.FOG))
            u = (Float(number // kinds) + unit_float(random)) * (kinds / _POINTS)
            distance, density = u * end, dr.rcp(end)
            if eye is not None:
                aside = center + apart * dr.tan(dr.lerp(first, last, u))
                distance = dr.select(number % 2 == 0, distance, dr.clip(aside, 0, end))
                density += apart * dr.rcp((last - first) * (apart * apart + dr.square(distance - center)))
            own = Deposit()
            own.place, own.direction = walk.origin + distance * walk.direction, walk.direction
            own.medium, own.source = walk.medium, self.starts.source
            here = _Passed()
            here.distance, here.transmittance = distance, before.transmittance * media.transmittance(
                walk.medium, walk.origin + before.distance * walk.direction, walk.direction,
                dr.maximum(distance - before.distance, 0), random, active, coarse=True,
            )  # fmt: skip
            own.light = walk.flux * here.transmittance * dr.rcp(density * (_POINTS / kinds))
            deposit(own, active)
            return (number + 1, other, here) if kinds == 2 else (number + 1, here, other)

        begun = _Passed()
        begun.distance, begun.transmittance = dr.zeros(Float, dr.width(end)), dr.ones(Array3f, dr.width(end))
        state = UInt32(0), begun, copy(begun)
        dr.while_loop(state, lambda number, *_: active & (number < _POINTS), point, label="deposits")


def _turned(walk: LightWalk, position: Array3f, seed: UInt32, scatters: Bool) -> tuple[Array3f, Array3f]:
    """Return directions in which media scatter walks, and their weights."""
    lobe, u = unit_float(hash32(seed, UInt32(Stream.LOBE))), Array2f(pixel_sample(seed, UInt32(Stream.TURN)))
    sample = Phases(position, walk.direction, walk.medium, scatters).sample(lobe, u, scatters)
    return sample.direction, sample.weight


class TallyBeginnings:
    """Where walks begin on the light paths of a pass, which are followed step by step."""

    def __init__(self, tracing: Tracing) -> None:
        self._tracing, self._parts = tracing, list[TallyStarts]()
        self._share = np.zeros(len(tracing.paths))

    def tally(self, alpha: float) -> Tally | None:
        """Return the walks; None if there are none."""
        return Tally(self._tracing, joined(self._parts), alpha) if self._parts else None

    def add(self, paths: LightPaths, step: int) -> None:
        """Add the walks that begin on light paths before step number `step`."""
        tracing = self._tracing
        # After a null collision, walks of the same segment have begun before it.
        able = ((paths.counts & int(Counts.TALLIED)) > 0) & (paths.branch != TINTED)
        able &= tracing.within(paths.depth + 1, paths.source)
        if not bool(dr.any(able)):
            return
        seed = hash32(paths.key, dr.opaque(UInt32, step), paths.index)
        light = scattered_and_reflected(tracing, paths, able, seed)
        chance = [unit_float(hash32(seed, UInt32(Stream.FOG_FLIGHT), UInt32(kind))) for kind in (SCATTERED, REFLECTED)]
        dr.eval(light, chance, seed)
        found = np.nan_to_num(to_numpy(light).astype(np.float64), posinf=0.0)
        # Each lamp has its own share of the walks, whatever others do; those behind boundaries and mirrors carry as
        # much as those before.
        source = paths.source.numpy()
        power = np.bincount(source, found.sum(axis=0), len(self._share)) * (len(self._share) / tracing.walks)
        self._share = np.maximum(self._share, power)
        share = np.maximum(self._share[source], 1e-30)
        chosen = _strata(found / share, np.stack([each.numpy() for each in chance]))
        if not len(chosen.index):
            return
        kind, path = np.divmod(chosen.index, found.shape[1])
        result, own = TallyStarts(), to_uint(path)
        names = "origin", "direction", "flux", "medium", "source", "link", "depth", "straight", "offset", "reach"
        for name, value in taken({name: getattr(paths, name) for name in names}, own).items():
            setattr(result, name, value)
        result.flux = result.flux * to_float(share[path] / found.ravel()[chosen.index])
        result.branch = to_uint(np.where(kind == 0, SCATTERED, REFLECTED))
        result.seed = hash32(taken(seed, own), result.branch, to_uint(chosen.number))
        result.low, result.high = to_float(chosen.number / chosen.count), to_float((chosen.number + 1) / chosen.count)
        result.initial = to_float(share[path])
        dr.eval(result)
        self._parts.append(result)


@dataclass(frozen=True)
class _Strata:
    """Entries, each as often as it is chosen, with its number among its own and how often it is in all."""

    index: Array
    number: Array
    count: Array


def _strata(expected: Array, chance: Array) -> _Strata:
    """Return the entries as often as is expected on average."""
    count = (expected + chance).astype(np.int64).ravel()
    index = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return _Strata(index, number, count[index])
