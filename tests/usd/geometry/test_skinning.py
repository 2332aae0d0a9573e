"""Skinned meshes against UsdSkel's own baking."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel

from photonbeams.scene.vectors import unit
from photonbeams.usd.stage import extent_varies, read_scene

ONE, LIFTED = (
    "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))",
    "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 1, 1))",
)
POINTS = "[(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (1, 0, 2), (0, 0, 2)]"

ARM = f"""
def SkelRoot "Root" {{
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Skeleton "Bones" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        uniform token[] joints = ["A", "A/B"]
        uniform matrix4d[] bindTransforms = [{ONE}, {LIFTED}]
        uniform matrix4d[] restTransforms = [{ONE}, {LIFTED}]
        rel skel:animationSource = </Root/Bones/Bend>
        def SkelAnimation "Bend" {{
            uniform token[] joints = ["A", "A/B"]
            uniform token[] blendShapes = ["bulge"]
            float[] blendShapeWeights.timeSamples = {{ 1: [0], 2: [1] }}
            float3[] translations = [(0, 0, 0), (0, 0, 1)]
            quatf[] rotations.timeSamples = {{
                1: [(1, 0, 0, 0), (1, 0, 0, 0)], 2: [(1, 0, 0, 0), (0.8, 0, 0.6, 0)]
            }}
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
        }}
    }}
    def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        rel skel:skeleton = </Root/Bones>
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 5]
        point3f[] points = {POINTS}
        normal3f[] normals = [(0, -1, 0), (0, -1, 0), (0, -1, 0.5), (0, -1, 0), (1, -1, 0), (0, -1, 0)] (
            interpolation = "vertex")
        uniform token subdivisionScheme = "none"
        int[] primvars:skel:jointIndices = [0, 0, 0, 0, 0, 1, 0, 1, 1, 0, 1, 0] (
            interpolation = "vertex"
            elementSize = 2)
        float[] primvars:skel:jointWeights = [1, 0, 1, 0, 0.5, 0.5, 0.25, 0.75, 1, 0, 1, 0] (
            interpolation = "vertex"
            elementSize = 2)
        uniform token[] skel:blendShapes = ["bulge"]
        rel skel:blendShapeTargets = </Root/Skin/Bulge>
        float3 xformOp:scale = (2, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        METHOD
        def BlendShape "Bulge" {{
            uniform vector3f[] offsets = [(0, 0.25, 0)]
            uniform int[] pointIndices = [4]
        }}
    }}
}}
"""
CLASSIC, DUAL = "", 'uniform token primvars:skel:skinningMethod = "dualQuaternion"'


@pytest.mark.parametrize("method", [CLASSIC, DUAL])
def test_points_and_normals_are_those_that_usd_skel_bakes(usd, method):
    stage = usd(ARM.replace("METHOD", method))
    baked = Usd.Stage.Open(stage.Flatten())
    assert UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/Root")), Gf.Interval.GetFullInterval())
    prim = baked.GetPrimAtPath("/Root/Skin")
    assert extent_varies(stage)
    for time in (1, 2):
        (found,) = read_scene(stage, time).meshes
        matrix = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim))
        expected = np.array(prim.GetAttribute("points").Get(time)) @ matrix[:3, :3] + matrix[3, :3]
        # USD stores points and normals as float32.
        assert np.allclose(found.points, expected, atol=1e-5)
        if method == CLASSIC:  # with dual quaternions, UsdSkel rotates normals by other matrices than points
            normals = np.array(prim.GetAttribute("normals").Get(time)) @ np.linalg.inv(matrix[:3, :3]).T
            assert np.allclose(found.normals, unit(normals), atol=1e-5)


def test_influences_that_do_not_fit_leave_the_points_as_they_are(usd, caplog):
    stage = usd(ARM.replace("METHOD", "").replace("[0, 0, 0, 0, 0, 1,", "[0, 0, 0, 0, 0, 7,"))
    (found,) = read_scene(stage, 2).meshes
    assert np.allclose(found.points[:, 2].max(), 2)
    assert "/Root/Skin.primvars:skel:jointIndices does not fit" in caplog.text
