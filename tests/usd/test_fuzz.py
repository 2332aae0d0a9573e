"""Stages with one random error: the rest is read, or one sentence says why it cannot be read."""

from __future__ import annotations

import logging
import random
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import numpy as np
from pxr import Gf, Sdf, Usd

from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST
from photonbeams.usd.groups import groups_at_all_times, makers_at_all_times
from photonbeams.usd.reading import quiet
from photonbeams.usd.settings import read_settings
from photonbeams.usd.stage import default_time, read_camera, read_scene

STAGE = """#usda 1.0
(
    renderSettingsPrimPath = "/Settings"
)
def RenderSettings "Settings"
{
    rel camera = </Camera>
    uniform int2 resolution = (64, 32)
    uniform float4 dataWindowNDC = (0, 0, 1, 1)
    rel products = </Settings/Product>
    def RenderProduct "Product"
    {
        token productName = "a.exr"
        rel orderedVars = </Settings/Product/Var>
        def RenderVar "Var"
        {
            uniform string sourceName = "depth"
        }
    }
}
def Camera "Camera"
{
    token projection = "perspective"
    float2 clippingRange = (0.1, 100)
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    float horizontalApertureOffset = 0
    float fStop = 4
    float focusDistance = 5
    float exposure = 0
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Scope "Fog" (
    prepend apiSchemas = ["PhotonBeamsMediumAPI"]
)
{
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
    color3f photonbeams:absorption = (0.1, 0.1, 0.1)
    float photonbeams:anisotropy = 0.5
    int photonbeams:bounces = 1
}
def SphereLight "Lamp" (
    prepend apiSchemas = ["PhotonBeamsLightAPI", "ShapingAPI"]
)
{
    float inputs:radius = 0.1
    float inputs:intensity = 10
    float inputs:exposure = 1
    color3f inputs:color = (1, 1, 1)
    bool inputs:enableColorTemperature = 1
    float inputs:colorTemperature = 5000
    bool inputs:normalize = 1
    float inputs:shaping:cone:angle = 40
    float inputs:shaping:focus = 1
    bool photonbeams:enabled = 1
    int photonbeams:count = 100
    float photonbeams:intensity = 1
    int photonbeams:seed = 3
    token photonbeams:lightGroup = "key"
    token photonbeams:scattered = "physical"
    rel photonbeams:look = </Look>
    rel photonbeams:portal = </Portal>
    rel photonbeams:guides = </Guide>
    rel collection:lightLink:includes = </Mesh>
    rel collection:shadowLink:excludes = </Ball>
    double3 xformOp:translate = (0, 3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def RectLight "Panel"
{
    float inputs:width = 1
    float inputs:height = 2
}
def DistantLight "Sun"
{
    float inputs:angle = 1
}
def DomeLight "Sky"
{
    token inputs:texture:format = "latlong"
}
def PhotonBeamsLook "Look"
{
    token photonbeams:along:falloff = "exponential"
    float photonbeams:along:length = 2
    float[] photonbeams:along:ramp:knots = [0, 1]
    color3f[] photonbeams:along:ramp:colors = [(1, 0, 0), (0, 0, 1)]
    token photonbeams:across:profile = "gaussian"
    float photonbeams:across:width = 0.3
    float photonbeams:noise:amount = 0.5
}
def Plane "Portal"
{
    double width = 2
    double length = 2
}
def BasisCurves "Guide"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [3]
    point3f[] points = [(0, 3, 0), (0, 2, 0), (1, 1, 0)]
}
def BasisCurves "Drawn" (
    prepend apiSchemas = ["PhotonBeamsCurvesAPI"]
)
{
    uniform token type = "cubic"
    uniform token basis = "bspline"
    int[] curveVertexCounts = [4, 5]
    point3f[] points = [
        (0, 0, 0), (1, 0, 0), (2, 1, 0), (3, 0, 0), (0, 1, 0), (1, 1, 0), (2, 2, 0), (3, 1, 0), (4, 1, 0)
    ]
    float[] widths = [0.1, 0.2] (
        interpolation = "uniform"
    )
    color3f[] photonbeams:power = [(1, 1, 1)]
}
def Mesh "Mesh" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2), (-2, -1, -2), (0, 1, 0)]
    normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]
    vector3f[] velocities = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]
    uniform token orientation = "rightHanded"
    uniform token subdivisionScheme = "none"
    int[] holeIndices = []
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1)] (
        interpolation = "vertex"
    )
    int[] primvars:st:indices = [0, 1, 2, 0, 1]
    color3f[] primvars:displayColor = [(1, 0, 0)]
    rel material:binding = </Material>
    def GeomSubset "Part" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </Material>
    }
}
def Sphere "Ball"
{
    double radius = 1
    token visibility = "inherited"
    uniform token purpose = "default"
    float3 xformOp:scale = (1, 1, 1)
    uniform token[] xformOpOrder = ["xformOp:scale"]
}
def PointInstancer "Copies"
{
    rel prototypes = [</Copies/Cube>]
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]
    int64[] ids = [1, 2, 3]
    int64[] invisibleIds = [2]
    def Cube "Cube"
    {
        double size = 1
    }
}
def Material "Material"
{
    token outputs:surface.connect = </Material/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Material/Image.outputs:rgb>
        float inputs:roughness = 0.5
        float inputs:opacity = 1
        float inputs:ior = 1.5
        token outputs:surface
    }
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @gone.png@
        float4 inputs:fallback = (1, 0, 0, 1)
        token inputs:wrapS = "repeat"
        float2 inputs:st.connect = </Material/Reader.outputs:result>
        float3 outputs:rgb
    }
    def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
"""
SEEDS = 250
WRONG = [
    ("float", float("nan")), ("float", float("inf")), ("float", -1.0), ("float", 3e38), ("double", 1e300), ("int", -7),
    ("int", 2**31 - 1), ("bool", True), ("string", "text"), ("token", ""), ("asset", Sdf.AssetPath("gone.exr")),
    ("float3", (float("nan"), 0, 0)), ("color3f", (-1, 0, 0)), ("float[]", []), ("float[]", [1.0, float("nan")]),
    ("point3f[]", [(0, 0, 0)]), ("point3f[]", [(3e38, 0, 0)] * 5), ("int[]", [-1]), ("int[]", [2**31 - 1] * 3),
    ("int[]", [3, 3, 3, 3]), ("token[]", ["nope"]), ("string[]", ["a", "b"]), ("matrix4d", Gf.Matrix4d(0.0)),
    ("float2[]", [(0, 0)] * 7), ("half", 1.0), ("timecode", Sdf.TimeCode(1)),
]  # fmt: skip
TARGETS = ["/Gone", "/Mesh", "/Mesh.points", "/Look", "/Fog", "/Copies", "/Camera"]
KINDS = ["Mesh", "Xform", "SphereLight", "Camera", "PointInstancer", "BasisCurves", "Material", "Shader", "Unknown", ""]


def specs(layer: Sdf.Layer) -> list[Sdf.Spec]:
    """Return all prims and properties of a layer."""
    paths: list[Sdf.Path] = []
    layer.Traverse("/", paths.append)
    return [layer.GetObjectAtPath(path) for path in paths if path.IsPrimPath() or path.IsPropertyPath()]


def mutate(layer: Sdf.Layer, chance: random.Random) -> str:
    """Change a layer in one place, and return what was changed."""
    spec = chance.choice(specs(layer))
    path = spec.path
    if isinstance(spec, Sdf.PrimSpec):
        kind = chance.choice(KINDS)
        if kind:
            spec.typeName = kind
        else:
            del layer.GetPrimAtPath(path.GetParentPath()).nameChildren[spec.name]
        return f"{path} is a {kind or 'prim no longer'}"
    owner = spec.owner
    owner.RemoveProperty(spec)
    if chance.random() < 0.1:
        return f"{path} is gone"
    if chance.random() < 0.3:
        target = chance.choice(TARGETS)
        made = Sdf.RelationshipSpec(owner, path.name, custom=True)
        made.targetPathList.explicitItems = [target]
        return f"{path} names {target}"
    kind, value = chance.choice(WRONG)
    made = Sdf.AttributeSpec(owner, path.name, Sdf.ValueTypeNames.Find(kind))
    if chance.random() < 0.3:
        layer.SetTimeSample(made.path, 1.0, value)
    else:
        made.default = value
    return f"{path} is {kind} {value}"


def arrays(value: object) -> Iterator[np.ndarray]:
    """Yield all numbers of a scene as arrays."""
    if is_dataclass(value):
        yield from (array for each in fields(value) for array in arrays(getattr(value, each.name)))
    elif isinstance(value, (tuple, list)):
        yield from (array for each in value for array in arrays(each))
    elif isinstance(value, (float, np.ndarray)):
        yield np.asarray(value)


def test_a_stage_that_is_wrong_in_one_place_is_read_without_it(caplog, capfd):
    caplog.set_level(logging.WARNING, "photonbeams")
    for seed in range(SEEDS):
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.ImportFromString(STAGE)
        with quiet():
            what = mutate(layer, random.Random(seed))
        stage = Usd.Stage.Open(layer)
        caplog.clear()
        try:
            scene = read_scene(stage, default_time(stage))
            numbers = [each for each in arrays(scene) if each.dtype.kind == "f"]
            # A single number may be infinite, as the distance of a shadow is.
            assert all(np.isfinite(each).all() if each.ndim else not np.isnan(each) for each in numbers), (seed, what)
            assert scene.meshes and scene.lights, (seed, what)
        except Exception as error:
            raise AssertionError((seed, what)) from error
        for read in (read_camera, read_settings, groups_at_all_times, makers_at_all_times):
            try:
                read(stage)
            except SceneError as error:
                assert len(str(error)) <= LONGEST
        for record in caplog.records:
            assert len(record.getMessage()) <= LONGEST, (seed, what)
    assert capfd.readouterr().err == ""
