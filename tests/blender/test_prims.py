"""Prims that are described in plain values: what is written is on the stage, and what is left out is not."""

import numpy as np
import pytest
from pxr import UsdGeom, UsdLux

from photonbeams import SceneError
from photonbeams.usd.authoring.prims import new_stage, remove_prims, write_prims
from tests.blender.scene import prims


def test_what_is_described_is_on_the_stage():
    stage = new_stage("Z", 1.0)
    write_prims(stage, prims())
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    lamp = UsdLux.SphereLight(stage.GetPrimAtPath("/Lamp"))
    assert lamp.GetIntensityAttr().Get() == 10.0 and lamp.GetPrim().HasAPI(UsdLux.ShapingAPI)
    moved = UsdGeom.Xformable(lamp).GetLocalTransformation()
    assert tuple(moved.ExtractTranslation()) == (0, 0, 2)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Floor"))
    assert np.array_equal(mesh.GetPointsAttr().Get(), prims()[0]["values"]["points"][1])
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_a_prim_that_is_described_again_is_replaced():
    stage = new_stage("Z", 1.0)
    write_prims(stage, prims())
    write_prims(stage, [{"path": "/Lamp", "type": "DiskLight", "values": {"inputs:intensity": ["float", 3.0]}}])
    lamp = stage.GetPrimAtPath("/Lamp")
    assert lamp.GetTypeName() == "DiskLight" and lamp.GetAttribute("inputs:intensity").Get() == 3.0
    assert not lamp.HasAPI(UsdLux.ShapingAPI) and not lamp.GetAttribute("xformOpOrder").HasAuthoredValue()
    assert not lamp.GetAttribute("photonbeams:lightGroup").HasAuthoredValue()


def test_parents_are_defined():
    stage = new_stage("Z", 1.0)
    write_prims(stage, [{"path": "/Lights/Rig/Key", "type": "SphereLight"}])
    assert all(stage.GetPrimAtPath(path).IsDefined() for path in ("/Lights", "/Lights/Rig", "/Lights/Rig/Key"))


def test_sources_and_targets_are_connected():
    stage = new_stage("Z", 1.0)
    write_prims(stage, [
        {"path": "/M", "type": "Material", "sources": {"outputs:surface": ["token", "/M/S.outputs:surface"]}},
        {"path": "/M/S", "type": "Shader", "values": {"info:id": ["token", "UsdPreviewSurface"]}},
        {"path": "/A", "type": "Mesh", "apis": ["MaterialBindingAPI"], "targets": {"material:binding": ["/M"]}},
    ])  # fmt: skip
    assert [str(each) for each in stage.GetAttributeAtPath("/M.outputs:surface").GetConnections()] == [
        "/M/S.outputs:surface"
    ]
    assert [str(each) for each in stage.GetRelationshipAtPath("/A.material:binding").GetTargets()] == ["/M"]


def test_time_samples_are_interpolated_and_the_value_stays_the_default():
    stage = new_stage("Z", 1.0)
    lamp, moved = next(each for each in prims() if each["path"] == "/Lamp"), np.eye(4)
    moved[3, :3] = 4, 0, 2
    samples = {"matrix": [[1.0, lamp["matrix"]], [3.0, moved]], "inputs:intensity": [[1.0, 10.0], [3.0, 20.0]]}
    write_prims(stage, [{**lamp, "samples": samples}])
    found = UsdLux.SphereLight(stage.GetPrimAtPath("/Lamp"))
    assert found.GetIntensityAttr().Get() == 10.0 and found.GetIntensityAttr().Get(2.0) == 15.0
    assert tuple(UsdGeom.Xformable(found).GetLocalTransformation(2.0).ExtractTranslation()) == (2, 0, 2)
    write_prims(stage, [lamp])
    assert found.GetIntensityAttr().Get(2.0) == 10.0


def test_prims_are_removed():
    stage = new_stage("Z", 1.0)
    write_prims(stage, prims())
    remove_prims(stage, ["/Lamp", "/Nothing"])
    assert not stage.GetPrimAtPath("/Lamp") and stage.GetPrimAtPath("/Floor")


@pytest.mark.parametrize("wrong", [
    {"path": "/A", "type": "Mesh", "values": {"points": ["point3f[]", [1]]}},
    {"path": "no path", "type": "Mesh"},
    {"path": "/A", "type": "Mesh", "values": {"points": ["of no type", 1]}},
    {"type": "Mesh"},
])  # fmt: skip
def test_what_is_no_description_is_named(wrong):
    with pytest.raises(SceneError, match="is no description of a prim"):
        write_prims(new_stage("Z", 1.0), [wrong])
