"""The medium of a scene's background, and the boxes around its media."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ....runtime.device import mitsuba
from ....scene import Array
from ....scene.vectors import unit
from ...bounds import Box, box_around, box_of
from ..interfaces import UNKNOWN, number
from ..parts import boxes, parts
from .probes import Probes, random_directions

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import BoundingBox, MiMedium, MiScene, MiShape

mi = mitsuba()

# Number of walks from outside of the scene.
_OUTSIDE = 1024
# The fraction of walks that confirms a statement; a few walks slip between the walls of a closed room.
RARE = 0.02
# Most shapes toward which walks start.
_SHAPES = 1024
# Greatest thickness of a flat box, as a fraction of its size.
_FLAT = 1e-3


def rays_from_outside(plugin: MiScene, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return rays into a scene from outside: toward all of it, and toward shapes that name media."""
    low, high = _corners(box_around(plugin))
    aims = [low + rng.random((_OUTSIDE // 2, 3)) * (high - low)]
    naming = [each for each in plugin.shapes() if each.is_medium_transition() or each.class_name() == "Instance"]
    if naming:
        chosen = np.unique(np.linspace(0, len(naming) - 1, _SHAPES).astype(int))
        corners = np.array([_corners(box_of(naming[each])) for each in chosen])  # (shapes, 2, 3)
        own = corners[np.arange(_OUTSIDE // 2) % len(corners)]
        aims.append(own[:, 0] + rng.random((_OUTSIDE // 2, 3)) * (own[:, 1] - own[:, 0]))
    aim = np.concatenate(aims)
    distance = 0.55 * float(np.linalg.norm(high - low)) + 1e-3
    origin = 0.5 * (low + high) + distance * random_directions(rng, len(aim))
    return origin, unit(aim - origin)


def background(walks: Probes, named: Iterable[MiMedium | None], inside: set[int]) -> int:
    """Return the medium in which walks from outside of the scene begin; 0 if there is none.

    It is the medium that most of them face. Otherwise it is one that an emitter or a sensor names (`named`), unless
    shapes bound that one, because they have it inside, or behind an interface to empty space.
    """
    told = walks.near[walks.near != UNKNOWN]
    facing = Counter(told[told > 0].tolist()).most_common(1)
    if facing and facing[0][1] > max(0.5 * len(told), RARE * len(walks.near)):
        return int(facing[0][0])
    behind = Counter(walks.far[walks.near == 0].tolist())
    for own in map(number, named):
        if own and own not in inside and behind[own] <= RARE * len(told):
            return own
    return 0


def media_inside(plugin: MiScene | MiShape) -> set[int]:
    """Return the numbers of the media that shapes of a scene, or of a group, have inside."""
    return {number(each.interior_medium()) for each in parts(plugin, mi.Shape)} - {0}


def held(plugin: MiScene) -> dict[int, Box]:
    """Return the box around the shapes that hold each medium, also in instances, and those that have it outside.

    A medium that no shape holds, or only a flat one such as the window of a room, has no entry.
    """
    around = boxes(plugin.shapes())
    flat = {medium for medium, box in around.items() if _is_flat(*_corners(box))}
    # An instance does not tell its group.
    repeated: set[int] = set()
    for group in (shape for shape in parts(plugin, mi.Shape) if shape.class_name() == "ShapeGroupPlugin"):
        inside = boxes(parts(group, mi.Shape))
        repeated |= set(inside)
        for medium in inside.keys() - around.keys():
            if _is_flat(*_corners(inside[medium])):
                flat.add(medium)
            else:
                around[medium] = mi.ScalarBoundingBox3f()
    for shape in plugin.shapes():
        others = repeated if shape.class_name() == "Instance" else {number(shape.exterior_medium())}
        for medium in others.intersection(around):
            around[medium].expand(box_of(shape))
    return {medium: _corners(box) for medium, box in around.items() if medium not in flat}


def _is_flat(low: Array, high: Array) -> bool:
    """Return whether a box is flat, or empty."""
    return not (high - low).min() > _FLAT * (high - low).max()


def _corners(box: BoundingBox) -> tuple[Array, Array]:
    """Return the corners of a Mitsuba box; both are the origin if it is empty."""
    low, high = (np.ravel(np.asarray(each, dtype=np.float64)) for each in (box.min, box.max))
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        return np.zeros(3), np.zeros(3)
    return low, high
