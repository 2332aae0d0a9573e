"""Which lamps can light a place: a tree of boxes, each with the lamps whose cones meet it.

Of the lamps of a rig, few light any one place. The lists leave out only lamps that certainly do not: light is the same
with and without them, and so are the samples of each lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque, padded, to_uint
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...scene import Array
from ..bounds import Bounds
from .lamp import unit

# A box is divided if more lamps than this light a part of it, unless it is this deep in the tree, or there are so many
# boxes, or entries of their lists.
_FEW = 8
_DEEPEST = 10
_BOXES = 1 << 15
_ENTRIES = 1 << 20
# What rounding adds to boxes, as a fraction of their size, and to cones, in radians.
_ROUNDING, _ANGLE = 1e-3, 1e-3

_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])


@dataclass(frozen=True)
class _Cones:
    """Cones with rounded tips that contain the light of lamps: the balls around these, axes and half angles."""

    center: Array
    radius: Array
    axis: Array
    angle: Array

    @classmethod
    def of(cls, lights: Sequence[Any]) -> _Cones:
        """Return the cones of lights, (N, …)."""
        boxes = np.array([(each.points.min(axis=0), each.points.max(axis=0)) for each in lights], dtype=np.float64)
        axis = np.array([unit(each.axis) for each in lights])
        flat = [np.pi / 2 if isinstance(each, scene.FlatLight) else np.pi for each in lights]
        cone = [np.pi if each.shaping is None else np.radians(each.shaping.cone_angle) for each in lights]
        radius = 0.5 * np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
        return cls(boxes.mean(axis=1), radius, axis, np.minimum(flat, cone) + _ANGLE)

    def meet(self, lamp: Array, center: Array, radius: float) -> tuple[Array, Array]:
        """Return which lamps' cones meet balls, and which contain them.

        A ball with the distance d from the tip's centre covers the angle asin((r + R) / d) around that to its middle.
        """
        to = center - self.center[lamp]
        distance, size = np.linalg.norm(to, axis=1), radius + self.radius[lamp]
        cosine = (to * self.axis[lamp]).sum(axis=1) / np.maximum(distance, 1e-30)
        aside, covered = np.arccos(np.clip(cosine, -1, 1)), np.arcsin(np.minimum(size / np.maximum(distance, 1e-30), 1))
        near = distance <= size
        return near | (aside <= self.angle[lamp] + covered), ~near & (aside + covered <= self.angle[lamp])


class LampBoxes:
    """The tree over a world's bounds; lamps have their places among `lights`, and all light what is outside."""

    def __init__(self, lights: Sequence[Any], bounds: Bounds) -> None:
        cones, count = _Cones.of(lights), len(lights)
        radius = float(bounds.radius.numpy()[0])
        corner, size = np.ravel(bounds.center.numpy()) - radius, 2 * radius
        corners, owner, lamp = corner[None].astype(np.float64), np.zeros(count, dtype=np.int64), np.arange(count)
        children, lists, counts, boxes = list[Array](), list[Array](), list[Array](), 1
        for level in range(_DEEPEST + 1):
            middle, around = corners[owner] + 0.5 * size, 0.5 * 3**0.5 * size * (1 + _ROUNDING)
            meets, contains = cones.meet(lamp, middle, around)
            partly = np.bincount(owner[meets & ~contains], minlength=len(corners))
            owner, lamp = owner[meets], lamp[meets]
            divided = partly > _FEW
            more = 8 * int(divided.sum())
            if level == _DEEPEST or boxes + more > _BOXES or 8 * len(owner) > _ENTRIES:
                divided[:] = False
            whole = divided[owner]
            children.append(np.where(divided, boxes + 8 * (np.cumsum(divided) - 1), 0))
            lists.append(lamp[~whole])
            counts.append(np.bincount(owner[~whole], minlength=len(corners)))
            if not divided.any():
                break
            size, boxes = 0.5 * size, boxes + more
            place = 8 * (np.cumsum(divided) - 1)[owner[whole]]
            owner = (place[:, None] + np.arange(8)).T.ravel()  # of one lamp after the other, so that lists are in order
            lamp = np.tile(lamp[whole], 8)
            order = np.argsort(owner, kind="stable")
            owner, lamp = owner[order], lamp[order]
            corners = (corners[divided][:, None] + size * _CORNERS).reshape(-1, 3)
        ends = np.cumsum(np.concatenate([[0], *counts, [count]]))
        self._children = to_uint(padded(np.concatenate(children)))
        self._ends, self._lamps = to_uint(ends), to_uint(padded(np.concatenate([*lists, np.arange(count)])))
        self._outside = dr.opaque(UInt32, boxes)
        self._corner, self._scale = opaque(corner), dr.opaque(Float, 0.5 / radius)

    def lists(self, place: Array3f, active: Bool) -> tuple[UInt32, UInt32]:
        """Return where the lists of lamps that can light places begin and end; those of others are empty."""
        at = (place - self._corner) * self._scale
        inside = (dr.min(at) >= 0) & (dr.max(at) < 1)

        def deeper(box: UInt32, at: Array3f) -> tuple[UInt32, Array3f]:
            upper = [dr.select(2 * each >= 1, UInt32(1), UInt32(0)) for each in at]
            child = dr.gather(UInt32, self._children, box) + upper[0] + 2 * upper[1] + 4 * upper[2]
            return child, 2 * at - Array3f(*map(Float, upper))

        start = dr.zeros(UInt32, dr.width(place)), Array3f(at)
        box, _ = dr.while_loop(
            start, lambda box, _: active & inside & (dr.gather(UInt32, self._children, box) > 0), deeper, label="boxes"
        )
        box = dr.select(inside, box, self._outside)
        first, stop = (dr.gather(UInt32, self._ends, box + each, active) for each in (0, 1))
        return first, stop

    def lamp(self, entry: UInt32) -> UInt32:
        """Return the lamp of an entry of a list."""
        return dr.gather(UInt32, self._lamps, entry)
