"""Movements of a free camera: orbit, dolly and pan about a point in front of it, as on the studio's page.

Poses are transforms from the camera to the world, (4, 4), for column vectors; cameras look along −z, with +y up.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..scene import Array
from ..scene.vectors import unit

# The steepest view, up or down: beyond it the camera could turn over.
_STEEPEST = np.radians(89)


def pivot_distance(pose: Array) -> float:
    """Return a guess of the distance to the subject: where the view passes the origin, where most subjects are."""
    _, _, back, place = _axes(pose)
    along, far = float(place @ back), float(np.linalg.norm(place))
    return along if along > 0.1 * far else max(far / 2, 1.0)


def moved(pose: Array, right: float, up: float, forward: float) -> Array:
    """Return a pose after a movement along the camera's own axes, in scene units."""
    right_axis, up_axis, back, place = _axes(pose)
    return _pose(right_axis, up_axis, back, place + right * right_axis + up * up_axis - forward * back)


def orbited(pose: Array, world_up: Array, distance: float, yaw: float, pitch: float) -> Array:
    """Return a pose after a turn about a point that is `distance` in front of the camera; a scale in it is removed.

    `yaw` turns about the stage's up axis, (3,), to the left, and `pitch` up; both are in radians. The turn stops before
    the camera would turn over.
    """
    return moved(_turned(moved(pose, 0, 0, distance), world_up, yaw, pitch), 0, 0, -distance)


def _turned(pose: Array, world_up: Array, yaw: float, pitch: float) -> Array:
    """Return a pose after a turn on the spot."""
    right, _, back, place = _axes(pose)
    elevation = float(np.arcsin(np.clip(-(back @ world_up), -1, 1)))
    # A camera that already looks steeper can only turn back.
    tilt = float(np.clip(elevation + pitch, min(-_STEEPEST, elevation), max(_STEEPEST, elevation))) - elevation
    turn = Rotation.from_rotvec(yaw * world_up)
    back = unit(turn.apply(Rotation.from_rotvec(tilt * right).apply(back)))
    right = unit(turn.apply(right))
    return _pose(right, np.cross(back, right), back, place)


def _axes(pose: Array) -> tuple[Array, Array, Array, Array]:
    """Return the camera's axes right, up and back, orthonormal, and its position."""
    back = unit(pose[:3, 2])
    right = unit(np.cross(pose[:3, 1], back))
    return right, np.cross(back, right), back, pose[:3, 3]


def _pose(right: Array, up: Array, back: Array, place: Array) -> Array:
    result = np.eye(4)
    result[:3] = np.stack([right, up, back, place], axis=1)
    return result
