"""The camera as Blender's own projection matrix has it: sensor fit, shift and pixel aspect are in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .prims import Prim, Told, Values

CAMERA = "/Camera"
_TENTH = 0.1  # USD's focal lengths and apertures are in tenths of a scene unit


def camera_prim(
    camera: Any, to_world: Any, depsgraph: Any, size: tuple[int, int], shift: float, told: Told,
) -> Prim:  # fmt: skip
    """Return the prim of a camera.

    Parameters
    ----------
    camera, to_world
        The evaluated object, and its transform, (4, 4), or that of one of two eyes.
    size
        The width and height of the whole picture.
    shift
        A further horizontal shift, in units of Blender's own.
    told
        Called with a sentence about a panorama that is not rendered as in Blender.
    """
    (width, height), render = size, depsgraph.scene.render
    aspect = render.pixel_aspect_x, render.pixel_aspect_y
    matrix = np.array(camera.calc_matrix_camera(depsgraph, x=width, y=height, scale_x=aspect[0], scale_y=aspect[1]))
    data, pose = camera.data, np.array(to_world)
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    if data.type == "PANO" and (values := panoramic(data, told)):
        return Prim(CAMERA, "Camera", values, matrix=pose.T)
    values = _projected(matrix, data.lens, (data.clip_start, data.clip_end))
    wide = width * aspect[0] >= height * aspect[1] if data.sensor_fit == "AUTO" else data.sensor_fit == "HORIZONTAL"
    fitted = values["horizontalAperture" if wide else "verticalAperture"]  # what shifts are fractions of
    values["horizontalApertureOffset"] += shift * fitted
    return Prim(CAMERA, "Camera", values | _lens(data, pose), matrix=pose.T)


def panoramic(data: Any, told: Told) -> Values:
    """Return the attributes of a panoramic camera's data; none, which is told, for another kind of panorama."""
    kind, offsets = data.panorama_type, [0.0, 0.0]
    if kind == "EQUIRECTANGULAR":
        projection, ranges = (
            "equirectangular",
            [(getattr(data, f"{axis}_min"), getattr(data, f"{axis}_max")) for axis in ("longitude", "latitude")],
        )
        field = [high - low for low, high in ranges]
        offsets = [(low + high) / 2 / max(wide, 1e-6) for (low, high), wide in zip(ranges, field, strict=True)]
    elif kind == "FISHEYE_EQUIDISTANT":
        projection, field = "fisheyeEquidistant", [data.fisheye_fov] * 2
    elif kind == "FISHEYE_EQUISOLID":
        # The sensor shows sines of half the angle up to its edge over twice the lens, and a circle at most.
        edges = [min(size / (4 * data.fisheye_lens), 1.0) for size in (data.sensor_width, data.sensor_height)]
        projection, field = "fisheyeEquisolid", [min(4 * np.arcsin(each), data.fisheye_fov) for each in edges]
    else:
        told(f"{data.name} is a panorama of the kind {kind.replace('_', ' ').title()}: it is rendered in perspective")
        return {}
    panorama = {"photonbeams:projection": projection, "photonbeams:fieldOfView": np.degrees(field).tolist()}
    return panorama | _window((1.0, 1.0), offsets, (data.clip_start, data.clip_end))


def _window(size: Any, offsets: Any, clip: tuple[float, float]) -> Values:
    """Return the attributes of a camera's apertures, of how they are shifted, and of what it clips."""
    return {
        "horizontalAperture": size[0], "verticalAperture": size[1],
        "horizontalApertureOffset": offsets[0], "verticalApertureOffset": offsets[1],
        "clippingRange": [max(clip[0], 0.0), clip[1]],
    }  # fmt: skip


def viewport_prim(region: Any, space: Any, depsgraph: Any) -> Prim:
    """Return the prim of a viewport's camera, from its `RegionView3D` and its `SpaceView3D`."""
    pose = np.linalg.inv(np.array(region.view_matrix))
    values = _projected(np.array(region.window_matrix), space.lens, (space.clip_start, space.clip_end))
    if _is_through_camera(region, space):
        values |= _lens(space.camera.evaluated_get(depsgraph).data, pose)
    return Prim(CAMERA, "Camera", values, matrix=pose.T)


def viewport_area(region: Any, space: Any, scene: Any) -> list[float] | None:
    """Return the border of a viewport: x0, y0, x1, y1 in fractions from the top left; None: all of it is rendered.

    Through a camera that is the scene's own, which is in fractions of the camera's frame; else the viewport's.
    """
    corners, border = np.array([[-1.0, -1.0], [1.0, 1.0]]), space
    through = _is_through_camera(region, space)
    if through:
        frame = np.array([[*corner, 1.0] for corner in space.camera.data.view_frame(scene=scene)])
        clip = frame @ np.array(region.window_matrix).T
        places = clip[:, :2] / clip[:, 3:]
        corners, border = np.array([places.min(axis=0), places.max(axis=0)]), scene.render
    if not (border.use_border if through else border.use_render_border):
        return None
    names = ("border" if through else "render_border") + "_{}_{}"
    ends = [[getattr(border, names.format(end, axis)) for axis in "xy"] for end in ("min", "max")]
    (left, bottom), (right, top) = np.clip(corners[0] + ends * (corners[1] - corners[0]), -1, 1) * 0.5 + 0.5
    return [float(left), float(1 - top), float(right), float(1 - bottom)] if right > left and top > bottom else None


def _is_through_camera(region: Any, space: Any) -> bool:
    """Return whether a viewport looks through a camera."""
    return bool(region.view_perspective == "CAMERA" and space.camera is not None and space.camera.type == "CAMERA")


def _projected(matrix: Any, lens: float, clip: tuple[float, float]) -> Values:
    """Return the attributes of a camera with a projection matrix (4, 4), for a focal length in millimetres."""
    orthographic = matrix[3, 3] == 1
    focal = lens * 1e-3 / _TENTH
    size = 2 / matrix.diagonal()[:2] * (1 / _TENTH if orthographic else focal)
    shift = -matrix[:2, 3] if orthographic else matrix[:2, 2]
    projection: Values = {"projection": "orthographic" if orthographic else "perspective", "focalLength": focal}
    return projection | _window(size, shift * size / 2, clip)


def _lens(data: Any, pose: Any) -> Values:
    """Return the attributes of depth of field; none without it."""
    if not data.dof.use_dof or data.type == "ORTHO":
        return {}
    return {"fStop": data.dof.aperture_fstop, "focusDistance": _focus(data.dof, pose)}


def _focus(dof: Any, pose: Any) -> float:
    """Return the distance of what is in focus, along the camera's axis."""
    if dof.focus_object is None:
        return float(dof.focus_distance)
    away = np.array(dof.focus_object.matrix_world.translation) - pose[:3, 3]
    return float(max(away @ -pose[:3, 2], 1e-3))
