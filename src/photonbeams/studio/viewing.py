"""Scenes and cameras as a session's view changes them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ..render.films.denoising import lacking_denoiser
from ..scene import BLACK, Array, Camera, Scene, SceneError


def with_fewer_paths(content: Scene, most: int) -> Scene:
    """Return a scene whose lights have at most so many light paths."""
    lights = [
        each if each.beam_count is None else replace(each, beam_count=min(each.beam_count, most))
        for each in content.lights
    ]
    return replace(content, lights=tuple(lights))


def alone(content: Scene, shining: Sequence[str]) -> Scene:
    """Return a scene in which only these lights and drawn beams shine."""
    lights = [each if each.name in shining else replace(each, radiance=BLACK) for each in content.lights]
    drawn = [each for each in content.drawn if each.name in shining]
    return replace(content, lights=tuple(lights), drawn=tuple(drawn))


def between(cameras: Sequence[Camera]) -> Camera:
    """Return the camera between two eyes, or the only camera."""
    if len(cameras) == 1:
        return cameras[0]
    poses = [np.asarray(each.to_world) for each in cameras]
    middle = poses[0].copy()
    middle[:3, 3] = np.mean([each[:3, 3] for each in poses], axis=0)
    return replace(cameras[0], to_world=middle)


def placed(cameras: Sequence[Camera], pose: Array) -> tuple[Camera, ...]:
    """Return cameras moved so that the camera between them has a pose."""
    if len(cameras) == 1:
        return (replace(cameras[0], to_world=pose),)
    away = np.linalg.inv(np.asarray(between(cameras).to_world))
    return tuple(replace(each, to_world=pose @ (away @ np.asarray(each.to_world))) for each in cameras)


@cache
def can_denoise() -> bool:
    """Return whether this machine can denoise; if not, warn once why."""
    lacking = lacking_denoiser()
    if lacking is not None:
        logging.getLogger("photonbeams").warning("pictures are not denoised: %s", lacking)
    return lacking is None


def checked_pose(value: Any) -> Array:
    """Return a camera's transform to the world, (4, 4); SceneError for anything else."""
    try:
        pose = np.array(value, dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError):
        raise SceneError(f"the pose is {value!r:.80}: expected 16 numbers") from None
    if not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3])) < 1e-12:
        raise SceneError("the pose is no transform: expected a finite matrix that can be inverted")
    return pose
