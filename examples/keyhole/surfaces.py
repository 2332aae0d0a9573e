"""Surfaces of the keyhole stage: a wood texture, UsdPreviewSurface materials, and meshes as short USD text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenImageIO
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt
from shapes import Shape


def write_wood(path: Path, random: np.random.Generator) -> None:
    """Write a tileable picture of wood, grain along V: sums of sines bent by slow noise, in a few greys and browns."""
    height, width = 512, 256
    v, u = np.mgrid[0:height, 0:width] / [[[height]], [[width]]]
    bend = np.zeros((height, width))
    for _ in range(10):
        ku, kv, phase = random.integers(0, 4), random.integers(1, 4), random.uniform(0, 2 * np.pi)
        bend += np.cos(2 * np.pi * (ku * u + kv * v) + phase) / (2 + ku + kv)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * 5 * u + 2.2 * bend)
    fibre = np.zeros((height, width))
    for _ in range(60):
        ku, kv, phase = random.integers(12, 90), random.integers(-2, 3), random.uniform(0, 2 * np.pi)
        fibre += np.cos(2 * np.pi * (ku * u + kv * v) + phase + bend)
    tone = 0.55 * rings**1.5 + 0.16 * fibre / np.sqrt(60) + 0.28
    levels = np.round(np.clip(tone, 0, 1) * 31) / 31  # with few levels the file compresses to a tenth
    dark, light = np.array([0.20, 0.125, 0.075]), np.array([0.60, 0.43, 0.27])
    pixels = np.round(255 * (dark + (light - dark) * levels[..., None])).astype(np.uint8)
    image = OpenImageIO.ImageOutput.create(str(path))
    spec = OpenImageIO.ImageSpec(width, height, 3, "uint8")
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("png:compressionLevel", 9)
    if not (image and image.open(str(path), spec) and image.write_image(pixels) and image.close()):
        raise OSError(f"{path}: cannot be written")


def material(
    stage: Usd.Stage,
    name: str,
    color: Sequence[float],
    roughness: float,
    metallic: float = 0.0,
    texture: str | None = None,
) -> UsdShade.Material:
    """Define a UsdPreviewSurface; a texture's colours are multiplied by `color`."""
    path = Sdf.Path("/World/Materials").AppendChild(name)
    result = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    if metallic:
        surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(metallic)
    diffuse = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.Set(Gf.Vec3f(*color))
    if texture is not None:
        reader = UsdShade.Shader.Define(stage, path.AppendChild("Coordinates"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        image = UsdShade.Shader.Define(stage, path.AppendChild("Image"))
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(texture))
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for axis in ("wrapS", "wrapT"):
            image.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("repeat")
        image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*color, 1.0))
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        diffuse.ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    result.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return result


def mesh(stage: Usd.Stage, path: str, shape: Shape, look: UsdShade.Material | None = None) -> UsdGeom.Mesh:
    """Define a polygon mesh; coordinates are rounded to a tenth of a millimetre, which keeps the text short."""
    result = UsdGeom.Mesh.Define(stage, path)
    points = np.round(shape.points, 4).astype(np.float32)
    result.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    result.CreateFaceVertexCountsAttr([len(face) for face in shape.faces])
    result.CreateFaceVertexIndicesAttr([int(i) for face in shape.faces for i in face])
    result.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    result.CreateExtentAttr([Gf.Vec3f(*points.min(axis=0).tolist()), Gf.Vec3f(*points.max(axis=0).tolist())])
    if shape.normals is not None:
        result.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.round(shape.normals, 3).astype(np.float32)))
        result.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if look is not None:
        UsdShade.MaterialBindingAPI.Apply(result.GetPrim()).Bind(look)
        if look.GetPrim().GetChild("Image"):
            uvs = UsdGeom.PrimvarsAPI(result).CreatePrimvar(
                "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
            )
            values, indices = np.unique(np.round(shape.uvs, 3).astype(np.float32), axis=0, return_inverse=True)
            uvs.Set(Vt.Vec2fArray.FromNumpy(values))
            uvs.SetIndices(Vt.IntArray.FromNumpy(indices.reshape(-1).astype(np.int32)))
    return result
