"""The digest of a stage: a hash of the composed stage and of the files that it names."""

import shutil

import pytest
from pxr import UsdGeom

from photonbeams.usd.stage import open_stage, stage_digest

PRIMS = """def Mesh "Wall" {
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }
}
def Shader "Image" {
    asset inputs:file = @./wood.png@
}
def "Other" (references = @./other.usda@</Ball>) {
}
"""


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a stage, a layer that it refers to, and an image."""
    result = tmp_path / "shot"
    result.mkdir()
    (result / "stage.usda").write_text(f"#usda 1.0\n{PRIMS}")
    (result / "other.usda").write_text('#usda 1.0\ndef Sphere "Ball" {\n    double radius = 1\n}\n')
    (result / "wood.png").write_bytes(b"oak")
    return result


def found(folder, **more):
    return stage_digest(open_stage(folder / "stage.usda", **more))


def test_a_copy_elsewhere_has_the_same_hash(folder, tmp_path):
    before = found(folder)
    shutil.copytree(folder, tmp_path / "elsewhere" / "copy")
    assert found(tmp_path / "elsewhere" / "copy") == before == found(folder)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("stage.usda", "(1, 1, 0)", "(1, 2, 0)"),
        ("stage.usda", "2: (1", "2: (3"),
        ("other.usda", "radius = 1", "radius = 2"),
        ("wood.png", "oak", "ash"),
    ],
)
def test_a_change_of_any_file_is_another_hash(folder, name, old, new):
    before = found(folder)
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    assert found(folder) != before


def test_what_lies_over_the_stage_counts(folder):
    assert found(folder, overrides=["/Other.radius=3"]) != found(folder)


def test_instances_are_what_they_share(folder):
    def crowd(size):
        stage = open_stage(folder / "stage.usda")
        for kind in range(3):
            UsdGeom.Cube.Define(stage, f"/Lib{kind}/Cube").CreateSizeAttr(size + kind)
        for number in range(30):
            prim = UsdGeom.Xform.Define(stage, f"/Copy{number}").GetPrim()
            prim.GetReferences().AddInternalReference(f"/Lib{number % 3}")
            prim.SetInstanceable(True)
        return stage_digest(stage)

    assert crowd(1.0) == crowd(1.0) != crowd(2.0)


def test_a_file_that_is_empty_a_folder_or_not_there_is_no_error(folder):
    (folder / "wood.png").write_bytes(b"")
    empty = found(folder)
    (folder / "wood.png").unlink()
    gone = found(folder)
    (folder / "wood.png").mkdir()
    assert found(folder) == gone != empty
