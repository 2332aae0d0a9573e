"""Find which medium surrounds the emitters and the sensor of a scene, which fills the background, and their sizes.

The media that emitters, sensors and shapes name are taken as stated. Where they name none, random walks find them: a
walk stays in one medium while surfaces reflect it, or while it passes surfaces that name no media, so that the first
interface that it meets tells in which medium it began. A wall that names no medium tells nothing. Walks that pass
interfaces measure the extent of each medium, and find statements that contradict each other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.sampling import pairs, sobol_points
from ..runtime.device import Array3f, Float, UInt32, mitsuba
from ..scene import Array
from .bounds import box_around, box_of
from .interfaces import UNKNOWN, medium_at, number, shape_number
from .media import Media, boxes, parts
from .walks import (
    ASKING,
    CROSSING,
    ONWARD,
    Walks,
    first_interface,
    known_media,
    named_medium,
    normalized,
    random_directions,
    walk,
)

mi = mitsuba()

# Walks from each emitter, from outside of the scene, and around shapes that name media.
_WALKS, _OUTSIDE, _AROUND = 64, 1024, 4096
# Fraction of walks that may leave a closed region, and the least fraction of walks that confirms a statement.
_LEAK, _RARE = 0.02, 0.02
# Most shapes around which walks start.
_SHAPES = 1024


@dataclass(frozen=True)
class Place:
    """An emitter or a sensor, and some of its rays.

    Attributes
    ----------
    name
        The emitter or the sensor, for messages.
    origin, direction
        (N, 3) each, N may be 0.
    named
        Mitsuba's medium that the emitter or the sensor names, or None.
    """

    name: str
    origin: Array
    direction: Array
    named: Any = None


@dataclass(frozen=True)
class _Answer:
    """The medium around a place: `usual` is that of most rays, `known` tells that it is the same for all."""

    usual: int
    known: bool


class Surroundings:
    """The media around emitters and the sensor.

    Parameters
    ----------
    plugin
        The Mitsuba scene.
    media
        Its media.
    emitters, sensor
        The places where light paths and camera paths begin.

    Attributes
    ----------
    everywhere
        The number of the medium that fills the background, 0 where there is none.
    sizes
        Radius of each medium by its number; no entry for media as large as the scene.
    conflicts
        Sentences about statements that contradict each other.
    """

    def __init__(self, plugin: Any, media: Media, emitters: Sequence[Place], sensor: Place | None = None) -> None:
        self._scene, places = plugin, [*emitters, *([] if sensor is None else [sensor])]
        self.everywhere, self.sizes, self.conflicts = 0, dict[int, float](), list[str]()
        self._sensor = len(places) - 1
        self._answers = [_Answer(0, True)] * len(places)
        if media.all and plugin.shapes():
            self._survey(media, places)
        elif media.all:
            self.everywhere = next((number(each.named) for each in places if each.named is not None), 0)
            self._answers = [_Answer(number(each.named) or self.everywhere, True) for each in places]

    def of_emitter(self, index: int, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which paths of an emitter begin."""
        return self._around(self._answers[index], origin, direction)

    def of_sensor(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera paths begin."""
        return self._around(self._answers[self._sensor], origin, direction)

    def _around(self, answer: _Answer, origin: Array3f, direction: Array3f) -> UInt32:
        width = max(dr.width(origin), dr.width(direction))
        usual = dr.opaque(UInt32, answer.usual, width)
        if answer.known:
            return usual
        return medium_at(self._scene, origin, direction, usual, dr.opaque(UInt32, self.everywhere))

    def _survey(self, media: Media, places: Sequence[Place]) -> None:
        rng = np.random.default_rng(0)
        survey = _Survey(self._scene, media, rng)
        origins, directions = [each.origin for each in places], [each.direction for each in places]
        bounds = np.cumsum([0, *(len(each) for each in origins)]).tolist()
        outside = survey.outside()
        begin = np.concatenate([*origins, outside[0]]), np.concatenate([*directions, outside[1]])
        asking, onward = (walk(self._scene, *begin, rng, kind) for kind in (ASKING, ONWARD))
        self.everywhere = survey.everywhere(asking.part(bounds[-1], None), places)
        self._answers, states = [], []
        for place, *part in zip(places, bounds[:-1], bounds[1:], strict=True):
            answer = survey.answer(place, asking.part(*part), onward.part(*part), self.everywhere)
            self._answers.append(answer)
            states.append(np.full(len(place.origin), answer.usual if answer.known else UNKNOWN))
        around = survey.around()
        begin = np.concatenate([*origins, around[0]]), np.concatenate([*directions, around[1]])
        state = np.concatenate([*states, np.full(len(around[0]), UNKNOWN)])
        source = np.repeat(np.arange(len(places) + 1), [*map(len, origins), len(around[0])])
        if len(state):
            walks = walk(self._scene, *begin, rng, CROSSING)
            self.sizes = survey.measure(walks, state, [*(each.name for each in places), ""], source)
        self.conflicts = survey.conflicts


class _Survey:
    """A survey of the media of a scene, by walks through it."""

    def __init__(self, plugin: Any, media: Media, rng: np.random.Generator) -> None:
        self._scene, self._rng = plugin, rng
        self._names = {each.number: each.plugin.id() or each.plugin.class_name() for each in media.all}
        self._shapes = {shape_number(each): each for each in parts(plugin, mi.Shape)}
        self._inside = {number(each.interior_medium()) for each in self._shapes.values()}
        naming = [each for each in plugin.shapes() if each.is_medium_transition() or each.class_name() == "Instance"]
        self._naming = [naming[each] for each in np.unique(np.linspace(0, len(naming) - 1, _SHAPES).astype(int))
                        if naming]  # fmt: skip
        box = box_around(plugin)
        self._low, self._high = _corners(box)
        self.conflicts: list[str] = []

    def outside(self) -> tuple[Array, Array]:
        """Return rays from outside of the scene into it: toward all of it, and toward shapes that name media."""
        center, radius = 0.5 * (self._low + self._high), 0.5 * float(np.linalg.norm(self._high - self._low))
        aims = [self._low + self._rng.random((_OUTSIDE // 2, 3)) * (self._high - self._low)]
        if self._naming:
            aims.append(self._near_shapes(_OUTSIDE // 2, 0.0))
        aim = np.concatenate(aims)
        origin = center + (1.1 * radius + 1e-3) * random_directions(self._rng, len(aim))
        return origin, normalized(aim - origin)

    def around(self) -> tuple[Array, Array]:
        """Return rays that begin near shapes that name media."""
        count = _AROUND if self._naming else 0
        return self._near_shapes(count, 0.2), random_directions(self._rng, count)

    def _near_shapes(self, count: int, margin: float) -> Array:
        """Return points, (count, 3), in boxes around shapes that name media, enlarged by a fraction of their size."""
        if not count:
            return np.zeros((0, 3))
        corners = np.array([_corners(box_of(each)) for each in self._naming])  # (shapes, 2, 3)
        own = np.arange(count) % len(corners)
        low, size = corners[own, 0], corners[own, 1] - corners[own, 0]
        edge = margin * (size + 0.25 * size.max(axis=1, keepdims=True))
        result: Array = low - edge + self._rng.random((count, 3)) * (size + 2 * edge)
        return result

    def everywhere(self, walks: Walks, places: Sequence[Place]) -> int:
        """Return the medium in which walks from outside of the scene begin.

        It is the one that faces them; else one that an emitter or a sensor names, unless shapes bound it: they have it
        inside, or behind an interface to empty space.
        """
        first, other, _ = first_interface(walks)
        told = first[first != UNKNOWN]
        facing = Counter(told[told > 0].tolist()).most_common(1)
        # A few walks slip between the walls of a closed room.
        if facing and facing[0][1] > max(0.5 * len(told), _RARE * len(first)):
            return int(facing[0][0])
        behind = Counter(other[first == 0].tolist())
        for place in places:
            own = number(place.named)
            if own and own not in self._inside and behind[own] <= _RARE * len(told):
                return own
        return 0

    def answer(self, place: Place, asking: Walks, onward: Walks, everywhere: int) -> _Answer:
        """Return the medium around a place: the one that it names, else the one that most of its walks find.

        Walls that name no medium lie within the medium around them, which walks through the walls find; where these
        find none either, it is `everywhere`.
        """
        if place.named is not None:
            own = number(place.named)
            self._check(place, own, asking)
            return _Answer(own, True)
        told = known_media(asking, everywhere)
        told = told if len(told) else known_media(onward, everywhere)
        if not len(told):
            return _Answer(everywhere, True)
        values, counts = np.unique(told, return_counts=True)
        one_place = np.ptp(place.origin, axis=0).max() <= 1e-6 * np.abs(place.origin).max(initial=1e-30)
        return _Answer(int(values[counts.argmax()]), len(values) == 1 or bool(one_place))

    def _check(self, place: Place, own: int, walks: Walks) -> None:
        """Note a contradiction between what an emitter or a sensor names and what the shapes around it name."""
        first, _, shape = first_interface(walks)
        named = named_medium(walks)
        told = np.where(named > 0, named, first)
        known = told != UNKNOWN
        if not known.any() or (told[known] == own).mean() > _RARE:
            return
        other = Counter(told[known].tolist()).most_common(1)[0][0]
        if other == 0 and own not in self._inside:  # `warnings` reports shapes that name no exterior
            return
        teller = Counter(shape[known & (first == other)].tolist()).most_common(1)
        if not teller:
            return
        self._note(place.name, own, self._shape(teller[0][0]), int(other))

    def measure(self, walks: Walks, state: Array, sources: list[str], source: Array) -> dict[int, float]:
        """Return the radii of media from the points that walks reached; `state` is the medium in which each begins."""
        lows: dict[int, Array] = {}
        highs: dict[int, Array] = {}
        steps: Counter[int] = Counter()
        escapes: Counter[int] = Counter()
        pairs: Counter[tuple[int, ...]] = Counter()
        teller = np.zeros(len(state), dtype=np.int64)  # the shape that told the state; 0: where the walk began
        for step in walks.steps():
            named = step.near != UNKNOWN
            known = (state != UNKNOWN) & (state > 0)
            contrary = step.alive & step.valid & named & (step.near > 0) & known & (step.near != state)
            rows = np.stack([state, step.near, teller, source, step.shape], axis=1)[contrary]
            pairs.update(map(tuple, rows.tolist()))
            medium = np.where(known & ~contrary, state, np.where(named, step.near, 0))
            for own in np.unique(medium[step.alive & (medium > 0)]):
                of = step.alive & (medium == own)
                points = np.concatenate([step.start[of], step.end[of & step.valid]])
                points = points[np.isfinite(points).all(axis=1)]
                steps[int(own)] += int(of.sum())
                escapes[int(own)] += int((of & ~step.valid).sum())
                if len(points):
                    lows[own] = np.minimum(lows.get(own, np.inf), points.min(axis=0))
                    highs[own] = np.maximum(highs.get(own, -np.inf), points.max(axis=0))
            told = np.where(step.crossed, step.far, np.where(named & (step.near > 0), step.near, UNKNOWN))
            state = np.where(told != UNKNOWN, told, state)
            teller = np.where(told != UNKNOWN, step.shape, teller)
        self._note_pairs(pairs, sources, sum(steps.values()))
        return self._radii(lows, highs, {own for own in steps if escapes[own] > _LEAK * steps[own]})

    def _radii(self, lows: dict[int, Array], highs: dict[int, Array], open_: set[int]) -> dict[int, float]:
        """Return half the diagonals of boxes around media: around their shapes and the points that walks reached.

        A medium without a shape that walks leave to infinity is as large as the scene: it has no entry.
        """
        held = boxes(self._scene.shapes())
        result = {}
        for own in {*lows, *held}:
            low, high = _corners(held[own]) if own in held else (np.full(3, np.inf), np.full(3, -np.inf))
            if own not in held and own in open_:
                continue
            low, high = np.minimum(low, lows.get(own, np.inf)), np.maximum(high, highs.get(own, -np.inf))
            radius = 0.5 * float(np.linalg.norm(high - low))
            if np.isfinite(radius) and radius > 0:
                result[int(own)] = radius
        return result

    def _note_pairs(self, pairs: Counter[tuple[int, ...]], sources: list[str], total: int) -> None:
        """Note the most frequent contradiction between two statements for each two media; shapes may overlap."""
        noted = set()
        for (state, near, teller, source, shape), count in pairs.most_common():
            media = frozenset((state, near))
            who = self._shape(teller) if teller else sources[source]
            overlap = self._holds(teller, state) and self._holds(shape, near)
            if media not in noted and who and not overlap and count > max(8, 1e-3 * total):
                noted.add(media)
                self._note(who, state, self._shape(shape), near)

    def _holds(self, shape: int, medium: int) -> bool:
        return shape in self._shapes and number(self._shapes[shape].interior_medium()) == medium

    def _note(self, who: str, own: int, other_who: str, other: int) -> None:
        if who == other_who:
            return
        there = f"medium {self._names[other]}" if other else "none"
        text = (
            f"{who} and {other_who} contradict each other: one names medium {self._names[own]}, the other {there}, "
            "for the same space: expected one medium"
        )
        if text not in self.conflicts:
            self.conflicts.append(text)

    def _shape(self, own: int) -> str:
        shape = self._shapes.get(int(own))
        return "a shape" if shape is None else f"shape {shape.id() or shape.class_name()}"


def places_of(plugin: Any) -> list[Place]:
    """Return the places where light paths of a Mitsuba scene begin: its emitters."""
    u, v = _samples()
    result = []
    for each in plugin.emitters():
        ray, _ = each.sample_ray(Float(0), Float(0.5), u, v, True)
        result.append(place_of(f"emitter {each.id() or each.class_name()}", ray.o, ray.d, _named_by(each)))
    return result


def place_of_sensor(plugin: Any) -> Place:
    """Return the place where camera paths begin: one of Mitsuba's sensors."""
    ray, _ = plugin.sample_ray_differential(Float(0), Float(0.5), *_samples(), True)
    return place_of(f"sensor {plugin.id() or plugin.class_name()}", ray.o, ray.d, _named_by(plugin))


def _samples() -> tuple[Any, Any]:
    """Return samples of rays, two dimensions each for place and direction."""
    u, v = pairs(sobol_points(_WALKS, 0, (_WALKS,)))
    return mi.Point2f(u), mi.Point2f(v)


def _named_by(plugin: Any) -> Any:
    """Return the medium that an emitter or a sensor names: the one outside its shape, or its own."""
    shape = plugin.get_shape()
    outside = None if shape is None else shape.exterior_medium()
    return plugin.get_medium() if outside is None else outside


def place_of(name: str, origin: Any, direction: Any, named: Any = None, most: int = _WALKS) -> Place:
    """Return a place from the rays of an emitter or a sensor: some of them, and their reverse."""
    wide = dr.zeros(Array3f, max(dr.width(origin), dr.width(direction)))
    origin, direction = ((Array3f(each) + wide).numpy().T.astype(np.float64) for each in (origin, direction))
    good = np.isfinite(origin).all(axis=1) & np.isfinite(direction).all(axis=1) & (np.abs(direction).max(axis=1) > 0)
    origin, direction = origin[good], direction[good]
    chosen = np.unique(np.linspace(0, len(origin) - 1, most).astype(int)) if len(origin) else np.zeros(0, dtype=int)
    origin, direction = origin[chosen], direction[chosen]
    return Place(name, np.concatenate([origin, origin]), np.concatenate([direction, -direction]), named)


def _corners(box: Any) -> tuple[Array, Array]:
    """Return the corners of one of Mitsuba's boxes; those of a box of nothing are the origin."""
    low, high = (np.ravel(np.asarray(each, dtype=np.float64)) for each in (box.min, box.max))
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        return np.zeros(3), np.zeros(3)
    return low, high
