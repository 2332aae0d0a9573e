"""Translate a Mitsuba scene into plain numbers, from which `cycles_worker` builds it in Blender.

Only what Cycles can render as well is translated: meshes, spheres, cylinders, rectangles and disks; diffuse surfaces,
ideal glass and boundaries of media; homogeneous media; area lights and a constant background; a perspective camera.
Anything else is an error, since a picture of another scene would be no comparison.

In Cycles a medium fills the space that the normals of one mesh point away from, and media overlap. So each medium gets
a mesh of its own without a surface: all shapes that bound it, moved out of it by a small distance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from photonbeams.runtime.device import mitsuba

mi = mitsuba()

_HAIR = 1e-4  # of a scene unit, between a surface and the boundary of its medium
_ROUND = 192, 96  # facets around a sphere and from pole to pole


class UntranslatedError(ValueError):
    """The scene has something that Cycles would render differently."""


def cycles_job(scene: Any) -> dict[str, Any]:
    """Return a scene as `cycles_worker` reads it.

    Raises
    ------
    UntranslatedError
        The scene has something that is not translated.
    """
    surfaces, fogs = [], {}
    for shape in scene.shapes():
        points, faces = _mesh(shape)
        surface = _surface(shape)
        if surface is not None:
            surfaces.append({"points": points.tolist(), "faces": faces.tolist(), "smooth": _is_round(shape), **surface})
        inside, outside = shape.interior_medium(), shape.exterior_medium()
        if str(inside) == str(outside) or (shape.emitter() is not None and _kind(shape) in ("Rectangle", "Disk")):
            continue
        for medium, turned in ((inside, False), (outside, True)):
            if medium is not None:
                fogs.setdefault(str(medium), (_fog(medium), []))[1].append(
                    (points, faces[:, ::-1] if turned else faces)
                )
    boundaries = [{"fog": fog, **_joined(parts)} for fog, parts in fogs.values()]
    return {"surfaces": surfaces, "fogs": boundaries, "background": _background(scene), "camera": _camera(scene)}


def _kind(thing: Any) -> str:
    return str(thing).partition("[")[0].strip()


def _is_round(shape: Any) -> bool:
    return _kind(shape) in ("Sphere", "Cylinder") or (shape.is_mesh() and shape.has_vertex_normals())


def _parameters(thing: Any) -> dict[str, Any]:
    parameters = mi.traverse(thing)
    return {key: parameters[key] for key in parameters.properties}


def _color(parameters: dict[str, Any], name: str) -> list[float]:
    """Return a colour of a plug-in, which must have no texture."""
    value = parameters.get(f"{name}.value", parameters.get(f"{name}.value.value"))
    if value is None:
        raise UntranslatedError(f"{name} has a texture")
    return np.broadcast_to(np.array(value, dtype=float).ravel(), 3).tolist()


# -- shapes ----------------------------------------------------------------------------------------------------------


def _mesh(shape: Any) -> tuple[Any, Any]:
    """Return a shape's points, (N, 3), and its triangles, (M, 3), whose normals point as Mitsuba's do."""
    given, primitive = _parameters(shape), _PRIMITIVES.get(_kind(shape))
    if primitive is not None:
        local, faces = primitive()
        matrix = np.array(given["to_world"].matrix, dtype=float).reshape(4, 4)
        points = local @ matrix[:3, :3].T + matrix[:3, 3]
    elif "vertex_positions" in given:
        points = np.array(given["vertex_positions"], dtype=float).reshape(-1, 3)
        faces = np.array(given["faces"]).reshape(-1, 3).astype(int)
    else:
        raise UntranslatedError(f"a shape of {_kind(shape)}")
    sample = shape.sample_position(0.0, mi.Point2f(0.31, 0.62))
    corners = points[faces]
    nearest = np.argmin(np.linalg.norm(corners.mean(axis=1) - np.array(sample.p).ravel(), axis=1))
    normal = np.cross(*(corners[nearest, 1:] - corners[nearest, 0]))
    return points, faces if normal @ np.array(sample.n).ravel() > 0 else faces[:, ::-1]


def _grid(columns: int, rows: int) -> Any:
    """Return the triangles between the points of a grid, whose first axis closes."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    corner = [((i + di) % columns) * (rows + 1) + j + dj for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    quads = np.stack(corner, axis=-1).reshape(-1, 4)
    return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def _sphere() -> tuple[Any, Any]:
    around, down = _ROUND
    phi, theta = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.linspace(0, np.pi, down + 1), indexing="ij")
    points = np.stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1)
    return points.reshape(-1, 3), _grid(around, down)


def _cylinder() -> tuple[Any, Any]:
    phi, z = np.meshgrid(np.arange(_ROUND[0]) * 2 * np.pi / _ROUND[0], [0.0, 1.0], indexing="ij")
    points = np.stack((np.cos(phi), np.sin(phi), z), axis=-1)
    return points.reshape(-1, 3), _grid(_ROUND[0], 1)


def _rectangle() -> tuple[Any, Any]:
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def _disk() -> tuple[Any, Any]:
    phi = np.arange(_ROUND[0]) * 2 * np.pi / _ROUND[0]
    rim = np.stack((np.cos(phi), np.sin(phi), 0 * phi), axis=-1)
    number = np.arange(len(phi))
    faces = np.stack((number, (number + 1) % len(phi), np.full_like(number, len(phi))), axis=-1)
    return np.concatenate((rim, np.zeros((1, 3)))), faces


_PRIMITIVES = {"Sphere": _sphere, "Cylinder": _cylinder, "Rectangle": _rectangle, "Disk": _disk}


def _joined(parts: list[tuple[Any, Any]]) -> dict[str, Any]:
    """Return meshes as one, each point moved along its normal."""
    points, faces, count = [], [], 0
    for each, triangles in parts:
        corners = each[triangles]
        normals = np.zeros_like(each)
        for corner in range(3):
            np.add.at(normals, triangles[:, corner], np.cross(*(corners[:, 1:] - corners[:, :1]).transpose(1, 0, 2)))
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        points.append(each + _HAIR * normals / np.maximum(length, 1e-30))
        faces.append(triangles + count)
        count += len(each)
    return {"points": np.concatenate(points).tolist(), "faces": np.concatenate(faces).tolist()}


# -- surfaces, media, lights and the camera ----------------------------------------------------------------------------


def _surface(shape: Any) -> dict[str, Any] | None:
    """Return what is on a shape, with the radiance of an area light, or None for a boundary of a medium alone."""
    emitter, found = shape.emitter(), _scattering(shape.bsdf())
    if emitter is None:
        return found
    if _kind(emitter) != "AreaLight" or found is None or found["kind"] != "diffuse":
        raise UntranslatedError(f"a shape with {_kind(emitter)} that is not diffuse")
    return {**found, "emission": _color(_parameters(emitter), "radiance")}


def _scattering(bsdf: Any) -> dict[str, Any] | None:
    parameters, kind = _parameters(bsdf), _kind(bsdf)
    if kind == "TwoSided" and "brdf[0] = SmoothDiffuse" in str(bsdf):
        parameters = {key.partition(".")[2]: value for key, value in parameters.items() if key.startswith("brdf_0.")}
        kind = "SmoothDiffuse"
    if kind == "SmoothDiffuse":
        return {"kind": "diffuse", "color": _color(parameters, "reflectance")}
    if kind == "SmoothDielectric":
        return {"kind": "glass", "ior": float(np.ravel(parameters["eta"])[0])}
    if kind == "Null":
        return None
    raise UntranslatedError(f"a surface of {kind}")


def _fog(medium: Any) -> dict[str, Any]:
    """Return the coefficients of a homogeneous medium."""
    if _kind(medium) != "HomogeneousMedium":
        raise UntranslatedError(f"a medium of {_kind(medium)}")
    given = _parameters(medium)
    extinction = np.array(_color(given, "sigma_t")) * float(np.ravel(given["scale"])[0])
    albedo = np.array(_color(given, "albedo"))
    anisotropy = given.get("phase_function.g", 0.0)
    return {
        "scattering": (albedo * extinction).tolist(),
        "absorption": ((1 - albedo) * extinction).tolist(),
        "anisotropy": float(np.ravel(anisotropy)[0]),
    }


def _background(scene: Any) -> list[float]:
    """Return the radiance of a constant background; all other emitters without a shape are refused."""
    found = [0.0, 0.0, 0.0]
    for emitter in scene.emitters():
        kind = _kind(emitter)
        if kind == "ConstantBackgroundEmitter":
            found = _color(_parameters(emitter), "radiance")
        elif kind != "AreaLight":
            raise UntranslatedError(f"a light of {kind}")
    return found


def _camera(scene: Any) -> dict[str, Any]:
    """Return the camera's matrix and field of view as Blender has them: it looks along −z."""
    sensor = scene.sensors()[0]
    if _kind(sensor) != "PerspectiveCamera":
        raise UntranslatedError(f"a camera of {_kind(sensor)}")
    given = _parameters(sensor)
    matrix = np.array(given["to_world"].matrix).reshape(4, 4) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    return {"matrix": matrix.tolist(), "angle": float(np.radians(np.ravel(given["x_fov"])[0]))}
