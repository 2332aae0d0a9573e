"""Motion blur: when the shutter is open, and prims with time samples of what moves meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np
from mathutils import Matrix

from .prims import Told, typed

_SAME = 1e-6  # frames
_ROUNDED = 1e-6  # relative differences of what is at rest, in single precision
_TURN = 0.1  # radians between the time samples of what turns: the chord is 0.1 % shorter than the arc
_SAMPLED = ("float", "color3f", "point3f[]", "normal3f[]")  # the types of attributes that may move


@dataclass(frozen=True)
class Shutter:
    """When the shutter is open, in frames of the scene.

    Attributes
    ----------
    frame
        The frame that is rendered.
    opens, closes
        Frames at which the shutter opens and closes, of which `frame` is one or is between them.
    steps
        Into how many parts the time in between is divided.
    """

    frame: float
    opens: float
    closes: float
    steps: int

    def other_times(self) -> list[float]:
        """Return the frames at which what moves is read, besides the one that is rendered."""
        times = np.linspace(self.opens, self.closes, self.steps + 1)
        return [float(each) for each in times if abs(each - self.frame) > _SAME]

    def of_camera(self, prim: dict[str, Any]) -> dict[str, Any]:
        """Return the prim of a camera with this shutter."""
        ends = {"open": self.opens - self.frame, "close": self.closes - self.frame}
        values = {f"shutter:{name}": value for name, value in ends.items()}
        return {**prim, "values": {**prim["values"], **typed(values)}}


def shutter_of(scene: Any, told: Told) -> Shutter | None:
    """Return the shutter of a scene at its current frame; None without motion blur."""
    render = scene.render
    if not render.use_motion_blur or render.motion_blur_shutter <= _SAME:
        return None
    if any(abs(point.location[1] - 1) > 1e-3 for point in render.motion_blur_shutter_curve.curves[0].points):
        told("the curve of the shutter is not rendered: it is open from its beginning to its end")
    frame = scene.frame_current + scene.frame_subframe
    before = {"START": 0.0, "CENTER": 0.5, "END": 1.0}[render.motion_blur_position] * render.motion_blur_shutter
    steps = scene.photonbeams.motion_steps
    return Shutter(frame, frame - before, frame - before + render.motion_blur_shutter, steps)


def with_samples(
    prim: dict[str, Any], frame: float, others: Mapping[float, Mapping[str, Any]], told: Told
) -> dict[str, Any]:  # fmt: skip
    """Return a prim with time samples of what differs between a frame and other times.

    Parameters
    ----------
    prim, frame
        The prim, and the frame at which it is so.
    others
        By frame, descriptions of the same prim at other times; they need not have all of its values.
    """
    if not others:
        return prim
    samples = {}
    matrices = _sampled(prim.get("matrix"), frame, {time: each.get("matrix") for time, each in others.items()})
    if matrices:
        samples["matrix"] = _turned(matrices)
    first = prim.get("values", {})
    values = {time: each["values"] for time, each in others.items() if each.get("values")}
    if all(_has_shape_of(first, each) for each in values.values()):
        for name, (kind, value, *_) in first.items():
            there = {time: each[name][1] for time, each in values.items() if name in each}
            if kind in _SAMPLED and (found := _sampled(value, frame, there)):
                samples[name] = found
    else:
        told(f"{prim['name']} has other faces at other times: its shape has no motion blur")
    return {**prim, "samples": samples} if samples else prim


def is_blurred(thing: Any) -> bool:
    """Return whether an object has motion blur, which can be turned off for Cycles."""
    return bool(getattr(getattr(thing.original, "cycles", None), "use_motion_blur", True))


def _has_shape_of(first: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether the arrays of two prims have the same lengths, and their faces the same corners."""
    return all(
        np.array_equal(value, other[name][1]) if kind == "int[]" else np.shape(value) == np.shape(other[name][1])
        for name, (kind, value, *_) in first.items() if name in other
    )  # fmt: skip


def _sampled(value: Any, frame: float, others: Mapping[float, Any]) -> list[list[Any]]:
    """Return the values in the order of time, [time, value] each; none if all of them are the same."""
    others = {time: each for time, each in others.items() if each is not None}
    if all(np.allclose(each, value, _ROUNDED, 0.01 * _ROUNDED) for each in others.values()):
        return []
    return [[time, each] for time, each in sorted({frame: value, **others}.items())]


def _turned(samples: list[list[Any]]) -> list[list[Any]]:
    """Return transforms with others between them, such that what turns keeps its size.

    OpenUSD interpolates the numbers of a matrix: halfway through half a turn, a thing would be a point.
    """
    found = samples[:1]
    for (begin, a), (end, b) in pairwise(samples):
        first, last = (Matrix(each.T.tolist()).decompose() for each in (a, b))
        count = ceil(first[1].rotation_difference(last[1]).angle / _TURN) if _is_rigid(a) and _is_rigid(b) else 1
        for t in np.arange(1, count) / count:
            place, size = (first[k].lerp(last[k], t) for k in (0, 2))
            matrix = Matrix.LocRotScale(place, first[1].slerp(last[1], t), size)
            found.append([begin + t * (end - begin), np.array(matrix).T])
        found.append([end, b])
    return found


def _is_rigid(matrix: Any) -> bool:
    """Return whether a transform is a rotation, a scale along its axes and a translation."""
    axes = matrix[:3, :3]
    across = axes @ axes.T
    away = across - np.diag(np.diag(across))
    return bool(np.linalg.det(axes) > 0 and np.abs(away).max() < 1e-5 * np.diag(across).max())
