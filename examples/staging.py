"""Helpers of the examples' model scripts: an empty stage, meshes, materials, transforms, attributes, images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender, UsdShade, Vt

import photonbeams.usd.common.definitions  # noqa: F401  # teaches OpenUSD the attributes of lights, fog and looks

Array = npt.NDArray[np.float64]
#: Points (V, 3), and faces as lists of indices.
Shape = tuple[Array, list[list[int]]]


def new_stage(comment: str, frames: tuple[int, int] | None = None) -> Usd.Stage:
    """Return a stage in metres, Y up, with a prim `World`; its frames, if it has any, run at 24 a second."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("comment", comment)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    if frames is not None:
        stage.SetStartTimeCode(frames[0])
        stage.SetEndTimeCode(frames[1])
        stage.SetTimeCodesPerSecond(24)
        stage.SetFramesPerSecond(24)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def define(stage: Usd.Stage, path: str, kind: str, doc: str = "", api: str = "") -> Usd.Prim:
    """Define a prim, and apply an API schema if one is named."""
    prim = stage.DefinePrim(path, kind)
    if doc:
        prim.SetDocumentation(doc)
    if api:
        prim.AddAppliedSchema(api)
    return prim


def author(prim: Usd.Prim, values: Mapping[str, Any]) -> None:
    """Set attributes that the prim's schemas know; a path is set as a relationship's target."""
    for name, value in values.items():
        if isinstance(value, Sdf.Path):
            prim.GetRelationship(name).SetTargets([value])
        else:
            attribute = prim.GetAttribute(name)
            if not attribute:
                raise KeyError(f"{prim.GetPath()} has no attribute {name}")
            attribute.Set(value)


def merge(shapes: Sequence[Shape]) -> Shape:
    """Return all shapes as one."""
    offsets = np.cumsum([0] + [len(points) for points, _ in shapes])
    faces = [[int(o) + i for i in face] for (_, own), o in zip(shapes, offsets, strict=False) for face in own]
    return np.concatenate([points for points, _ in shapes]), faces


def moved(shape: Shape, matrix: Array, offset: Sequence[float] = (0, 0, 0)) -> Shape:
    """Return a shape transformed by `matrix` (3, 3), then by `offset`."""
    return shape[0] @ np.asarray(matrix).T + np.asarray(offset, dtype=float), shape[1]


def turned(axis: int, degrees: float) -> Array:
    """Return the rotation about a coordinate axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def grid_faces(rows: int, columns: int, around: bool = False) -> list[list[int]]:
    """Return the quads of a grid of points, row by row; `around` closes each row into a ring."""
    last = columns if around else columns - 1
    return [
        [r * columns + c, r * columns + (c + 1) % columns, (r + 1) * columns + (c + 1) % columns, (r + 1) * columns + c]
        for r in range(rows - 1)
        for c in range(last)
    ]


def tube(path: Any, radii: Any, sides: int = 8) -> Shape:
    """Return a round tube along a path (N, 3), with a radius at each of its points."""
    path, radii = np.asarray(path, dtype=float), np.broadcast_to(np.asarray(radii, dtype=float), len(path))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    helper = np.eye(3)[int(np.argmin(np.abs(tangent).max(axis=0)))]
    side = np.cross(tangent, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    angles = np.arange(sides) * (2 * np.pi / sides)
    ring = np.cos(angles)[:, None] * side[:, None] + np.sin(angles)[:, None] * up[:, None]
    points = path[:, None] + radii[:, None, None] * ring
    return points.reshape(-1, 3), grid_faces(len(path), sides, around=True)


def block(low: Sequence[float], high: Sequence[float]) -> Shape:
    """Return the box between two corners."""
    x, y, z = np.meshgrid(*zip(low, high, strict=True), indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(float)
    return points, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def mesh(
    stage: Usd.Stage, path: str, shape: Shape, look: UsdShade.Material | None, smooth: bool = False, doc: str = ""
) -> UsdGeom.Mesh:
    """Define a mesh, rounded to millimetres to keep the text short; a smooth mesh is a subdivision surface."""
    result = UsdGeom.Mesh.Define(stage, path)
    points = np.round(shape[0], 3).astype(np.float32) + np.float32(0)  # no negative zeros
    result.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    result.CreateFaceVertexCountsAttr([len(face) for face in shape[1]])
    result.CreateFaceVertexIndicesAttr([int(i) for face in shape[1] for i in face])
    result.CreateExtentAttr([Gf.Vec3f(*points.min(axis=0).tolist()), Gf.Vec3f(*points.max(axis=0).tolist())])
    if not smooth:
        result.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if look is not None:
        UsdShade.MaterialBindingAPI.Apply(result.GetPrim()).Bind(look)
    if doc:
        result.GetPrim().SetDocumentation(doc)
    return result


def material(stage: Usd.Stage, name: str, color: Sequence[float], roughness: float, **inputs: Any) -> UsdShade.Material:
    """Define a UsdPreviewSurface; `inputs` are further inputs, colours as tuples."""
    result = UsdShade.Material.Define(stage, f"/World/Materials/{name}")
    surface = UsdShade.Shader.Define(stage, f"/World/Materials/{name}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    for key, value in {"diffuseColor": tuple(color), "roughness": roughness, **inputs}.items():
        if isinstance(value, tuple):
            surface.CreateInput(key, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*value))
        else:
            surface.CreateInput(key, Sdf.ValueTypeNames.Float).Set(value)
    result.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return result


def aimed(eye: Sequence[float], target: Sequence[float]) -> Gf.Matrix4d:
    """Return the transform of a camera or light at `eye` that looks along −Z at `target`, +Y up, rounded."""
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*map(float, eye)), Gf.Vec3d(*map(float, target)), Gf.Vec3d(0, 1, 0))
    return Gf.Matrix4d(*[round(x, 6) + 0.0 for row in look.GetInverse() for x in row])


def camera(stage: Usd.Stage, path: str, focal: float) -> UsdGeom.Camera:
    """Define a 36 mm wide 16:9 camera whose shutter is open for half of a frame.

    Apertures and focal length are tenths of a scene unit, so 0.36 is 36 mm.
    """
    result = UsdGeom.Camera.Define(stage, path)
    result.CreateHorizontalApertureAttr(0.36)
    result.CreateVerticalApertureAttr(0.2025)
    result.CreateFocalLengthAttr(focal / 100)
    result.CreateClippingRangeAttr(Gf.Vec2f(0.05, 200))
    result.CreateShutterOpenAttr(-0.25)
    result.CreateShutterCloseAttr(0.25)
    return result


def render_settings(stage: Usd.Stage, camera_path: str) -> None:
    """Define the settings of a render without flags: the camera, and a width of 1280 pixels."""
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateCameraRel().SetTargets([camera_path])
    settings.CreateResolutionAttr(Gf.Vec2i(1280, 720))
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")


def save(stage: Usd.Stage, path: Path) -> Path:
    """Write a stage as text."""
    path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")
    return path


def write_image(path: Path, pixels: Array) -> None:
    """Write values from 0 to 1, (H, W, C), as an 8-bit PNG."""
    levels = np.round(255 * np.clip(pixels, 0, 1)).astype(np.uint8)
    spec = OpenImageIO.ImageSpec(levels.shape[1], levels.shape[0], levels.shape[2], "uint8")
    spec.attribute("png:compressionLevel", 9)
    image = OpenImageIO.ImageOutput.create(str(path))
    if not (image and image.open(str(path), spec) and image.write_image(levels) and image.close()):
        raise OSError(f"{path}: cannot be written")
