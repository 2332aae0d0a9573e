"""The camera as Blender's own projection matrix has it: sensor fit, shift and pixel aspect are in it."""

from __future__ import annotations

from typing import Any

import numpy as np

_TENTH = 0.1  # USD's focal lengths and apertures are in tenths of a scene unit


def camera_prim(
    camera: Any, to_world: Any, depsgraph: Any, path: str, size: tuple[int, int], aspect: tuple[float, float],
    shift: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """Return the prim of a camera.

    Parameters
    ----------
    camera, to_world
        The evaluated object, and its transform, (4, 4), or that of one of two eyes.
    size, aspect
        The width and height of the whole picture, and of a pixel.
    shift
        A further horizontal shift, in units of Blender's own.
    """
    width, height = size
    matrix = np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height, scale_x=aspect[0], scale_y=aspect[1]))
    data, pose = camera.data, np.array(to_world)
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    orthographic = data.type == "ORTHO"
    focal = data.lens * 1e-3 / _TENTH  # millimetres
    across, down = (2 / matrix[k, k] * (1 / _TENTH if orthographic else focal) for k in (0, 1))
    place = 3 if orthographic else 2
    sign = -1 if orthographic else 1
    wide = width * aspect[0] >= height * aspect[1] if data.sensor_fit == "AUTO" else data.sensor_fit == "HORIZONTAL"
    fitted = across if wide else down  # what shifts are fractions of
    values = {
        "projection": ["token", "orthographic" if orthographic else "perspective"],
        "focalLength": ["float", focal],
        "horizontalAperture": ["float", across],
        "verticalAperture": ["float", down],
        "horizontalApertureOffset": ["float", sign * matrix[0, place] * across / 2 + shift * fitted],
        "verticalApertureOffset": ["float", sign * matrix[1, place] * down / 2],
        "clippingRange": ["float2", [max(data.clip_start, 0.0), data.clip_end]],
    }
    if data.dof.use_dof and not orthographic:
        values["fStop"] = ["float", data.dof.aperture_fstop]
        values["focusDistance"] = ["float", _focus(data.dof, pose)]
    return {"path": path, "type": "Camera", "matrix": pose.T, "values": values}


def _focus(dof: Any, pose: Any) -> float:
    """Return the distance of what is in focus, along the camera's axis."""
    if dof.focus_object is None:
        return float(dof.focus_distance)
    away = np.array(dof.focus_object.matrix_world.translation) - pose[:3, 3]
    return float(max(away @ -pose[:3, 2], 1e-3))
