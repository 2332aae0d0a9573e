"""No command replaces a file that it reads, nor one of its outputs by another, whatever their names and links."""

import os

import numpy as np
import pytest

from photonbeams.images.writing import write_png
from tests.helpers.commands import fails
from tests.helpers.frames import write_frame
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, write_stage
from tests.helpers.usda import textured

SMALL = ("--res", 16, 0, "--passes", 1, "-q")
IMAGES = ("gobo", "later", "variant", "tile.1001", "text", "set", "layer", "sub")
MATERIAL = """
def Scope "More" (
    variants = { string kind = "a" }
    prepend variantSets = "kind"
    references = [@sub/more.usda@</More>]
) {
    asset image.timeSamples = { 7: @gobo.png@, 9: @later.png@ }
    asset tiles = @tile.<UDIM>.png@
    variantSet "kind" = {
        "a" { }
        "b" {
            asset image = @variant.png@
        }
    }
}
def Sphere "Ball" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Painted>
}
""" + textured("Painted", 'string inputs:file = "text.png"')
SCENE = """<scene version="3.0.0"><path value="folder"/><default name="image" value="gobo.png"/>
 <sensor type="perspective"><film type="hdrfilm"/></sensor><include filename="more.xml"/>
 <shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
  <string name="filename" value="$image"/></texture></bsdf></shape></scene>"""
MORE = SCENE.replace("gobo", "inner").replace('<sensor type="perspective"><film type="hdrfilm"/></sensor>', "").replace(
    '<include filename="more.xml"/>', "").replace("$image", "inner.png")  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a stage that names images in every way, and the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    for name in IMAGES:
        write_png(tmp_path / f"{name}.png", np.full((4, 4, 3), 0.5))
    (tmp_path / "sub.png").rename(tmp_path / "sub" / "sub.png")
    (tmp_path / "sub" / "more.usda").write_text('#usda 1.0\ndef Scope "More" {\n    asset other = @sub.png@\n}\n')
    (tmp_path / "layer.usda").write_text('#usda 1.0\nover "More" {\n    asset third = @layer.png@\n}\n')
    write_stage(tmp_path / "stage.usda", FOG, CAMERA, FILL, FLOOR, MATERIAL)
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", [*IMAGES[:-1], "sub/sub"])
def test_an_image_that_a_stage_names_is_kept(folder, render, name):
    before = contents(folder)
    flags = ("--session-layer", "layer.usda", "--set", "/Fill.photonbeams:gobo=set.png", *SMALL, "--dry-run")
    code, _, stderr = render("stage.usda", "-o", f"{name}.png", *flags)
    assert code == 1
    assert f"{name}.png would replace " in stderr and stderr.endswith("is read: expected another file to write to\n")
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("link", "source"),
    [(os.symlink, "gobo.png"), (os.link, "gobo.png"), (os.symlink, "stage.usda"), (os.symlink, "sub/more.usda")],
)
def test_a_link_to_a_file_of_the_stage_is_no_output(folder, render, link, source):
    link(folder / source, folder / "link.png")
    code, _, stderr = render("stage.usda", "-o", "link.png", *SMALL, "--dry-run")
    assert code == 1 and "link.png would replace " in stderr and f"{source}, which is read" in stderr


def test_what_was_written_before_may_be_written_again(folder, render):
    write_png(folder / "old.png", np.zeros((4, 4, 3)))
    assert render("stage.usda", "-o", "old.png", *SMALL, "--dry-run")[0] == 0


@pytest.mark.parametrize(
    ("command", "target"),
    [
        (("swatch", "stage.usda", "-o"), "gobo.png"),
        (("beams", "stage.usda", "-o"), "sub/more.usda"),
        (("dress", "stage.usda", "-o"), "sub/more.usda"),
        (("export", "stage.usda", "-o"), "link.xml"),
    ],
)
def test_other_commands_keep_the_files_of_a_stage(folder, call, command, target):
    (folder / "link.xml").symlink_to("gobo.png")
    code, _, stderr = call(*command, target)
    assert code == 1 and f"{target} would replace " in stderr


@pytest.mark.parametrize("target", ["gobo.png", "folder/inner.png", "scene.png", "more.png", "other.png"])
def test_a_bitmap_of_a_mitsuba_scene_is_kept(folder, render, target):
    (folder / "folder").mkdir()
    for name in ("folder/inner", "other"):
        write_png(folder / f"{name}.png", np.full((4, 4, 3), 0.5))
    (folder / "scene.xml").write_text(SCENE)
    (folder / "more.xml").write_text(MORE)
    for name in ("scene", "more"):
        (folder / f"{name}.png").symlink_to(f"{name}.xml")
    before = contents(folder)
    parameter = ("--set", "image=other.png") if target == "other.png" else ()
    code, _, stderr = render("scene.xml", "-o", target, *parameter, *SMALL, "--dry-run")
    assert code == 1 and f"Error: {target} would replace " in stderr
    assert contents(folder) == before


def test_a_plate_of_any_frame_is_kept_and_so_is_a_snapshot(folder, render):
    write_frame(folder / "plate.0008.exr", {"rgba": np.ones((9, 16, 4))})
    write_frame(folder / "a.snapshot.exr", {"rgba": np.ones((9, 16, 4))})
    flags = ("--res", 16, 9, "--passes", 1, "-q", "--dry-run")
    code, _, stderr = render("stage.usda", "-f", 8, "--over", "plate.####.exr", "-o", "plate.0008.exr", *flags)
    assert code == 1 and "Error: plate.0008.exr would replace " in stderr
    code, _, stderr = render("stage.usda", "--over", "a.snapshot.exr", "-o", "a.exr", *flags)
    assert code == 1 and "Error: a.snapshot.exr would replace " in stderr


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_two_outputs_are_no_links_of_one_file(folder, render, link):
    (folder / "a.exr").write_bytes(b"before")
    link(folder / "a.exr", folder / "b.exr")
    told = "b.exr is a.exr, by a link or another name: expected a different file for each output"
    fails(render("stage.usda", "-o", "a.exr", "-o", "b.exr", *SMALL), 2, told)


def test_an_output_is_no_snapshot_of_another(folder, render):
    """Snapshots are removed when the frame is there."""
    fails(render("stage.usda", "-o", "a.exr", "-o", "a.snapshot.exr", *SMALL), 2, "a.snapshot.exr is named twice")


def test_merge_keeps_its_tiles(folder, call):
    for number in (0, 1):
        header = {"dataWindow": (0, 4 * number, 7, 4 * number + 3), "displayWindow": (0, 0, 7, 7)}
        write_frame(folder / f"tile{number}.exr", {"rgba": np.ones((4, 8, 4))}, header)
    (folder / "link.exr").symlink_to("tile1.exr")
    before = contents(folder)
    for target in ("tile1.exr", "link.exr"):
        told = f"{target} would replace tile1.exr, which is read: expected another file to write to"
        fails(call("merge", "tile0.exr", "tile1.exr", "-o", target), 1, told)
    assert contents(folder) == before
    assert call("merge", "tile0.exr", "tile1.exr", "-o", "whole.exr")[0] == 0
