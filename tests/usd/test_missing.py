"""What a stage names and what is missing is told with its frame, and fails where that is asked for."""

import logging
from pathlib import Path

import pytest
from pxr import Usd

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import MissingError, Warnings
from photonbeams.usd.stage import files_of, open_stage, read_scene, sample_times
from tests.helpers.small_stage import LAMP, write_stage
from tests.helpers.usda import textured

SEQUENCE = """def Volume "Smoke" {
    rel field:density = </Smoke/density>
    def OpenVDBAsset "density" {
        token fieldName = "density"
        asset filePath.timeSamples = {1: @here.vdb@, 2: @gone.vdb@, 3: @here.vdb@}
    }
}
"""
CLIPS = """def Sphere "Ball" (
    clips = { dictionary default = {
        asset[] assetPaths = [@here.usda@, @gone.usda@, @here.usda@]
        double2[] active = [(1, 0), (2, 1), (3, 2)]
        string primPath = "/Ball"
    } }
) { double radius
}
"""
TEMPLATE = """def Sphere "Ball" (
    clips = { dictionary default = {
        string templateAssetPath = "./clip.##.usda"
        double templateStartTime = 1
        double templateEndTime = 3
        double templateStride = 1
        string primPath = "/Ball"
    } }
) { double radius
}
"""
CLIP = '#usda 1.0\ndef Sphere "Ball" { double radius.timeSamples = {1: 1, 3: 3}\n}\n'
MANIFEST = CLIPS.replace("gone", "here").replace("string", "asset manifestAssetPath = @gone.usda@\n        string")
TEXTURE = """def Mesh "Floor" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Paint>
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2)]
}
""" + textured("Paint", "asset inputs:file = @gone.png@")
IES = LAMP.replace("inputs:radius", "inputs:radius = 0.1\n    asset inputs:shaping:ies:file = @gone.ies@\n    float x")
DOME = 'def DomeLight "Sky" { asset inputs:texture:file = @gone.hdr@\n}\n'
REFERENCE = 'def Xform "Props" (prepend references = @gone.usda@) {\n}\n'
MATERIAL = 'def Sphere "Ball" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </gone>\n}\n'
SKELETON = """def SkelRoot "Figure" {
    def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {
        rel skel:skeleton = </gone>
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2)]
    }
}
"""
INSTANCES = """def PointInstancer "Trees" {
    rel prototypes = </gone>
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 0)]
}
"""
UNNAMED = {
    "no file": SEQUENCE.replace("@gone.vdb@", "None"), "no grids": SEQUENCE.replace("@gone.vdb@", "@here.usda@"),
    "no prototype": INSTANCES,
}  # fmt: skip
VARYING = {"smoke": SEQUENCE, "clips": CLIPS, "template": TEMPLATE}
LASTING = {"texture": TEXTURE, "profile": IES, "sky": DOME, "reference": REFERENCE, "material": MATERIAL,
           "skeleton": SKELETON, "manifest": MANIFEST}  # fmt: skip


@pytest.fixture
def read(tmp_path):
    """Return a function that reads some frames of a stage, and returns the warnings about it."""
    smoke = Path(__file__).resolve().parents[2] / "examples" / "smoke" / "smoke.1.vdb"
    (tmp_path / "here.vdb").write_bytes(smoke.read_bytes())
    for name in ("here.usda", "clip.01.usda", "clip.03.usda"):
        (tmp_path / name).write_text(CLIP)

    def frames(prims, numbers, strict=False):
        warnings = Warnings(strict)
        stage = open_stage(write_stage(tmp_path / "stage.usda", prims), warnings=warnings)
        for number in numbers:
            read_scene(stage, number, warnings)
        return warnings

    return frames


@pytest.mark.parametrize("kind", VARYING)
def test_a_gap_in_a_sequence_is_told_with_its_frame(read, kind, caplog):
    warnings = read(VARYING[kind], (1, 2, 3))
    (message,) = (each.message for each in caplog.records if "gone" in each.message or "clip.02" in each.message)
    assert message.startswith("frame 2: ")
    assert [len(warnings.missing_at(number)) for number in (1, 2, 3)] == [0, 1, 0]


@pytest.mark.parametrize("kind", VARYING)
def test_a_frame_in_a_gap_can_be_made_to_fail(read, kind):
    read(VARYING[kind], (1, 3), strict="missing")
    with pytest.raises(MissingError, match=r"gone\.|clip\.02\."):
        read(VARYING[kind], (2,), strict="missing")


def test_what_openusd_says_of_a_gap_at_another_time_is_not_printed(tmp_path, capfd):
    (tmp_path / "here.usda").write_text(CLIP)
    (tmp_path / "manifest.usda").write_text('#usda 1.0\ndef Sphere "Ball" { double radius\n}\n')
    clips = CLIPS.replace("string", "asset manifestAssetPath = @manifest.usda@\n        string")
    stage = open_stage(write_stage(tmp_path / "stage.usda", clips))
    assert sample_times(stage, 8) == [1, 2, 3]
    assert capfd.readouterr().err == ""


def test_what_openusd_says_of_a_template_without_a_folder_is_not_printed(tmp_path, capfd):
    stage = open_stage(write_stage(tmp_path / "stage.usda", TEMPLATE.replace("./", "")))
    assert str(tmp_path / "stage.usda") in set(files_of(stage))
    assert capfd.readouterr().err == ""


def test_value_clips_of_wrong_types_are_ignored_on_stages_that_somebody_else_opened(tmp_path):
    wrong = CLIPS.replace("double2[] active = [(1, 0), (2, 1), (3, 2)]", "double3 active = (0, 0, 0)")
    stage = Usd.Stage.Open(str(write_stage(tmp_path / "stage.usda", wrong)))
    assert not read_scene(stage, 1).lights


@pytest.mark.parametrize("kind", LASTING)
def test_a_missing_file_counts_for_every_frame_and_can_be_made_to_fail(read, kind, caplog):
    caplog.set_level(logging.WARNING)
    warnings = read(LASTING[kind], (1, 2))
    (message,) = (each.message for each in caplog.records if "gone" in each.message)
    assert "frame" not in message
    assert len(warnings.missing_at(1)) == len(warnings.missing_at(2)) == 1
    with pytest.raises(MissingError, match="gone"):
        read(LASTING[kind], (1,), strict="missing")


@pytest.mark.parametrize("kind", UNNAMED)
def test_what_is_told_without_the_name_of_a_file_can_be_made_to_fail(read, kind):
    assert len(read(UNNAMED[kind], (2,)).missing_at(2)) == 1
    with pytest.raises(MissingError):
        read(UNNAMED[kind], (2,), strict="missing")


def test_other_warnings_are_no_errors_where_only_missing_things_are(read):
    read(LAMP.replace("inputs:radius", "inputs:colour = 3\n    float inputs:radius"), (1,), strict="missing")
    with pytest.raises(SceneError, match="expected True, False or 'missing'"):
        Warnings("gone")
