"""A survey of the media of a scene, by random walks through it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ....numerics.arrays import to_vectors
from ....runtime.device import mitsuba
from ....scene import Array
from ...bounds import box_around, box_of
from ..interfaces import UNKNOWN, meet, number, shape_number
from ..media import Media
from ..parts import boxes, parts
from .conflicts import Statements
from .probes import Walks, first_interface, known_media, normalized, random_directions

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import BoundingBox, MiScene
    from .surroundings import Place

mi = mitsuba()

# Numbers of walks from outside of the scene, and around shapes that name media.
_OUTSIDE, _AROUND = 1024, 4096
# The fraction of steps that may leave a closed region, and the fraction of walks that confirms a statement.
_LEAK, _RARE = 0.02, 0.02
# Fractions of the scene's size: the rounding error of a place in float32, and the least length of a step that counts.
_ROUNDING, _STEP = 1e-6, 1e-4
# Most shapes around which walks start.
_SHAPES = 1024


@dataclass(frozen=True)
class MediumEstimate:
    """The medium around a place: `usual` is that of most rays, and `known` says whether all rays have it."""

    usual: int
    known: bool


class Survey:
    """A survey of the media of a scene.

    Parameters
    ----------
    plugin, media, rng
        The Mitsuba scene, its media, and the random generator for walks.

    Attributes
    ----------
    statements
        The statements about media, with those that contradict each other.
    """

    def __init__(self, plugin: MiScene, media: Media, rng: np.random.Generator) -> None:
        self._scene, self._rng = plugin, rng
        names = {each.number: each.plugin.id() or each.plugin.class_name() for each in media.all}
        shapes = {shape_number(each): each for each in parts(plugin, mi.Shape)}
        self.statements = Statements(shapes, names)
        self._inside = {number(each.interior_medium()) for each in shapes.values()}
        naming = [each for each in plugin.shapes() if each.is_medium_transition() or each.class_name() == "Instance"]
        self._naming = [naming[each] for each in np.unique(np.linspace(0, len(naming) - 1, _SHAPES).astype(int))
                        if naming]  # fmt: skip
        self._low, self._high = _corners(box_around(plugin))
        self._size = float(np.linalg.norm(self._high - self._low))

    def outside(self) -> tuple[Array, Array]:
        """Return rays into the scene from outside: toward all of it, and toward shapes that name media."""
        center, radius = 0.5 * (self._low + self._high), 0.5 * self._size
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

        It is the medium that most of them face. Otherwise it is one that an emitter or a sensor names, unless shapes
        bound that one, because they have it inside or behind an interface to empty space.
        """
        first, other, shape = first_interface(walks)
        told = first[first != UNKNOWN]
        facing = Counter(told[told > 0].tolist()).most_common(1)
        # A few walks slip between the walls of a closed room.
        if facing and facing[0][1] > max(0.5 * len(told), _RARE * len(first)):
            self.statements.check_background(int(facing[0][0]), first, shape)
            return int(facing[0][0])
        behind = Counter(other[first == 0].tolist())
        for place in places:
            own = number(place.named)
            if own and own not in self._inside and behind[own] <= _RARE * len(told):
                return own
        return 0

    def answer(self, place: Place, asking: Walks, onward: Walks, everywhere: int) -> MediumEstimate:
        """Return the medium around a place: the one that it names, or else the one that most of its walks find.

        Walls that name no medium lie within the medium around them. If walks find no medium, those that pass walls
        (`onward`) may; if these find none either, it is `everywhere`.
        """
        if place.named is not None:
            own = number(place.named)
            self.statements.check_place(place, asking)
            return MediumEstimate(own, True)
        told = known_media(asking, everywhere)
        told = told if len(told) else known_media(onward, everywhere)
        if not len(told):
            return MediumEstimate(everywhere, True)
        values, counts = np.unique(told, return_counts=True)
        one_place = np.ptp(place.origin, axis=0).max() <= 1e-6 * np.abs(place.origin).max(initial=1e-30)
        return MediumEstimate(int(values[counts.argmax()]), len(values) == 1 or bool(one_place))

    def sees_within(self, place: Place, answer: MediumEstimate, asking: Walks) -> bool:
        """Return whether rays of a place that names no medium meet a shape with another medium on their side."""
        near = asking.near[0]
        other = asking.valid[0] & (near != UNKNOWN) & (near > 0) & (near != answer.usual)
        return place.named is None and other.size > 0 and bool(other.mean() > _RARE)

    def on_interface(self, place: Place) -> bool:
        """Return whether an emitter or a sensor that names no medium stands on an interface, up to rounding."""
        if place.named is not None or not len(place.origin):
            return False
        near = _ROUNDING * (np.abs(place.origin).max() + self._size)
        met = meet(self._scene, to_vectors(place.origin - near * place.direction), to_vectors(place.direction), True)
        return bool(((met.hit.t.numpy() < 2 * near) & met.interface.numpy()).mean() > _RARE)

    def measure(self, walks: Walks, state: Array, sources: list[str], source: Array) -> dict[int, float]:
        """Return the radii of media from the points that walks reached, and note statements that contradict each other.

        Parameters
        ----------
        walks, state
            Walks, and the medium in which each begins.
        sources, source
            The names of the places where walks begin, and for each walk the number of its place.
        """
        lows: dict[int, Array] = {}
        highs: dict[int, Array] = {}
        steps: Counter[int] = Counter()
        escapes: Counter[int] = Counter()
        pairs: Counter[tuple[int, ...]] = Counter()
        teller = np.zeros(len(state), dtype=np.int64)  # the shape that named the state; 0: the start of the walk
        for step in walks.steps():
            named = step.near != UNKNOWN
            known = (state != UNKNOWN) & (state > 0)
            contrary = step.alive & step.valid & named & (step.near > 0) & (state != UNKNOWN) & (step.near != state)
            # Where shapes touch, a ray meets their faces in either order.
            contrary &= np.linalg.norm(step.end - step.start, axis=1) > _STEP * self._size
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
        self.statements.check_pairs(pairs, sources, sum(steps.values()))
        return self._radii(lows, highs, {own for own in steps if escapes[own] > _LEAK * steps[own]})

    def _radii(self, lows: dict[int, Array], highs: dict[int, Array], open_: set[int]) -> dict[int, float]:
        """Return half the diagonal of the box around each medium: around its shapes and the points that walks reached.

        A medium has no entry if no shape holds it and walks leave it to infinity: it is as large as the scene.
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


def _corners(box: BoundingBox) -> tuple[Array, Array]:
    """Return the corners of a Mitsuba box; both are the origin if it is empty."""
    low, high = (np.ravel(np.asarray(each, dtype=np.float64)) for each in (box.min, box.max))
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        return np.zeros(3), np.zeros(3)
    return low, high
