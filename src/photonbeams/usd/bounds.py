"""Bounds of a shot over all times, so that its beams do not change when something moves elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import numpy as np

from ..scene import Array, Camera, Scene, SceneError
from .common.openusd import Usd
from .stage import extent_varies, sample_times

T = TypeVar("T")

# The greatest number of times at which the extent of an animated stage is read.
_MOST_TIMES = 33


def bounds_at_all_times(
    stage: Usd.Stage,
    content: Scene,
    read_extent: Callable[[float | None], Scene],
    read_cameras: Callable[[float | None], tuple[Camera, ...]],
    emits: bool,
) -> tuple[Array, float]:
    """Return the centre and radius of a sphere around everything that is on a stage at any time.

    Parameters
    ----------
    content
        The scene at one time, which is enough if nothing changes.
    read_extent, read_cameras
        Functions that return the extent of the scene, and the cameras, at a time code.
    emits
        Whether a function makes beams: these may move without the stage showing it.
    """
    from ..world.bounds import bounding_sphere

    codes = sample_times(stage, _MOST_TIMES)
    moving = bool(codes) and (extent_varies(stage) or emits)
    states = [state for code in codes if (state := _sound(read_extent, code))] if moving else [content]
    times: list[float | None] = [*codes] or [None]
    cameras = [camera for time in times for camera in _sound(read_cameras, time) or ()]
    eyes = [np.asarray(camera.to_world)[:3, 3] for camera in cameras]
    return bounding_sphere(states, eyes)


def _sound(read: Callable[[float | None], T], code: float | None) -> T | None:
    """Return what `read` returns at a time, or None on an error, which rendering that time will raise."""
    with suppress(SceneError):
        return read(code)
    return None
