"""The bounds of a shot at all times: beams must not change with what moves elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import numpy as np

from ..scene import Array, Camera, Scene, SceneError
from .openusd import Usd
from .stage import extent_varies, sample_times

T = TypeVar("T")

# Times of an animated stage at most at which its extent is looked at.
_MOST_TIMES = 33


def bounds_at_all_times(
    stage: Usd.Stage,
    content: Scene,
    read_extent: Callable[[float | None], Scene],
    read_cameras: Callable[[float | None], tuple[Camera, ...]],
    emits: bool,
) -> tuple[Array, float]:
    """Return centre and radius of a sphere around all that is ever on a stage.

    Parameters
    ----------
    content
        What the stage holds at any time: if nothing changes, that is all.
    read_extent, read_cameras
        Return how far the scene reaches, and the cameras, at a time code.
    emits
        Whether a function makes beams, of which only itself knows whether they move.
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
    """Return what is there at a time, or None where it cannot be read: rendering it raises the error."""
    with suppress(SceneError):
        return read(code)
    return None
