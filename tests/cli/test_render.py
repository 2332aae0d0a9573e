"""`photonbeams render` as its users call it: good input, bad input, and what is left behind when it fails."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest
import typer

from photonbeams import cli
from photonbeams.images.files import read_image, read_layers
from photonbeams.render import stage_frame as frame
from photonbeams.render.frame import FrameRenderer
from photonbeams.render.settings import DEFAULT_PATHS, Settings
from photonbeams.scene import DEFAULT_BEAMS
from tests.helpers.commands import command, fails, untouched
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage
from tests.helpers.usda import textured

PORTAL = """def Mesh "Portal" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, -1, -1), (1, -1, -1), (1, -1, -1), (-1, -1, -1)]
}
"""
TEXTURED = """def Mesh "Wall" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(-2, -1, -1), (2, -1, -1), (2, 1, -1)]
    rel material:binding = </Wood>
}
""" + textured("Wood", "asset inputs:file = @./wood.png@")
CUBE = """def Cube "Cube" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
}
"""
SMALL = ("--res", 32, 0, "--passes", 1, "--beams", 64)
LAYERS = ["rgba", "surface", "beams", "transmittance", "depth"]


@pytest.fixture
def stage(tmp_path):
    """Return a function that writes a stage, with valid prims unless others are given."""

    def written(*prims, **more):
        return write_stage(tmp_path / "stage.usda", *(prims or (FOG, CAMERA, LAMP, FLOOR)), **more)

    return written


@pytest.fixture
def render(render):
    """Return a function that calls the command, for a small picture unless `small` is false."""
    return lambda *arguments, small=True: render(*arguments, *(SMALL if small else ()))


# -- normal use ------------------------------------------------------------------------------------------------------


def test_all_outputs_are_written_and_summed_up(render, stage, out):
    code, stdout, stderr = render(
        stage(), "-o", out / "a.exr", "-o", out / "new" / "b.png", "--picture", f"beams={out / 'c.png'}"
    )
    assert (code, stdout) == (0, "")
    layers = read_layers(out / "a.exr")
    assert list(layers) == LAYERS
    assert layers["rgba"].shape == (18, 32, 4)
    assert all(not np.isnan(pixels).any() for pixels in layers.values())
    assert read_image(out / "new" / "b.png").shape == (18, 32, 3)
    assert not np.array_equal(read_image(out / "new" / "b.png"), read_image(out / "c.png"))
    lines = stderr.splitlines()
    assert lines[:2] == ["pass 0 of 1", "pass 1 of 1"]
    assert re.fullmatch(r"1 pass, \d+ beams, \d+ million ray-beam tests", lines[2])
    assert re.fullmatch(
        r"[\d.]+ s \(build [\d.]+, guide [\d.]+, simulate .*, beams [\d.]+\)",
        lines[3],
    )
    assert lines[4:] == [f"wrote {out / name}" for name in ("a.exr", "new/b.png", "c.png")]
    assert sorted(path.name for path in out.iterdir()) == ["a.exr", "c.png", "new", "old.exr"]


@pytest.mark.parametrize(
    ("flags", "name"),
    [((), "a.-007.exr"), (("-f", "12"), "a.0012.exr"), (("-f", "-3"), "a.-003.exr"), (("-f", "7.5"), "a.7.5.exr")],
)
def test_a_run_of_hashes_is_the_frame_number(render, stage, out, flags, name):
    path = stage(metadata="startTimeCode = -7\n    endTimeCode = 12")
    assert render(path, "-o", out / "a.####.exr", *flags)[0] == 0
    assert (out / name).exists()


@pytest.mark.parametrize(
    ("flags", "size"),
    [
        # Pictures of several tiles, as most here: those of one tile have other kernels.
        (("--res", 32, 0), (18, 32)),
        (("--res", 0, 27), (27, 48)),
        (("--res", 20, 20), (20, 20)),
        (("--res", 64, 0, "--res-scale", 0.5), (18, 32)),
    ],
)
def test_the_size_is_what_is_given_and_the_rest_the_apertures(render, stage, out, flags, size):
    assert render(stage(), "-o", out / "a.exr", "--passes", 1, "--beams", 64, *flags, small=False)[0] == 0
    assert read_layers(out / "a.exr")["rgba"].shape == (*size, 4)


def test_an_exposure_is_chosen_and_told(render, stage, out):
    code, _, stderr = render(stage(), "-o", out / "a.png", "--auto-exposure")
    told = re.search(r"chose an exposure of (\S+) stops, as with --exposure (\S+)$", stderr, re.MULTILINE)
    assert code == 0 and told[1] == told[2]
    assert render(stage(), "-o", out / "b.png", "--exposure", told[1], "-q")[0] == 0
    assert (out / "a.png").read_bytes() == (out / "b.png").read_bytes()
    fails(render(stage(), "-o", out / "a.png", "--auto-exposure", "--exposure", 1), 2, "expected no --exposure")


def test_a_crop_has_its_place_in_the_header_and_the_pixels_of_the_whole(render, stage, out):
    assert render(stage(), "-o", out / "whole.exr")[0] == 0
    assert render(stage(), "-o", out / "part.exr", "--crop", 0.25, 0.5, 0.75, 1)[0] == 0
    file = OpenImageIO.ImageInput.open(str(out / "part.exr"))
    spec = file.spec()
    file.close()
    assert (spec.x, spec.y, spec.width, spec.height) == (8, 9, 16, 9)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 32, 18)
    whole, part = (read_layers(out / name)["beams"] for name in ("whole.exr", "part.exr"))
    assert np.array_equal(part, whole[9:18, 8:24])


def test_cameras_are_listed_and_chosen(render, stage, out):
    second = CAMERA.replace('"Camera"', '"Side"').replace("0, 0, 5", "1, 0, 5")
    path = stage(FOG, CAMERA, second, LAMP)
    assert render(path, "--list-cameras") == (0, "/Camera\n/Side\n", "")
    assert render(path, "-o", out / "a.exr", "-cam", "Side")[0] == 0
    with OpenEXR.File(str(out / "a.exr"), header_only=True) as file:
        assert file.parts[0].header["camera"] == "/Side"


def test_a_dry_run_says_that_all_is_well_and_writes_nothing(render, stage, out):
    code, stdout, stderr = render(stage(), "-o", out / "new" / "a.####.exr", "--dry-run")
    assert (code, stdout) == (0, "")
    assert "Ready to render" in stderr
    assert "32 x 18 pixels" in stderr
    assert str(out / "new" / "a.0007.exr") in stderr
    assert untouched(out)


def test_fog_comes_from_flags_where_the_stage_has_none(render, stage, out):
    path = stage(CAMERA, LAMP, FLOOR)
    for name, fog in (("a", "0.1"), ("b", "0.1,0.1,0.1"), ("c", "0.2")):
        assert render(path, "-o", out / f"{name}.exr", "--scattering", fog)[0] == 0
    a, b, c = (read_layers(out / f"{name}.exr")["beams"] for name in "abc")
    assert np.array_equal(a, b)
    assert c.mean() > a.mean() > 0
    fails(render(path, "-o", out / "d.exr", "--absorption", "0.1"), 2, "--absorption", "--scattering")
    fails(render(path, "-o", out / "d.exr", "--beams-only-fog"), 2, "--beams-only-fog", "--scattering")


def test_fog_of_a_box_by_flags_is_that_of_a_cube(render, stage, out):
    """A box given by corners, and one around a prim, are those of a cube with the same attributes."""
    varied = {"--fog-falloff": 0.5, "--fog-ground": -0.5, "--fog-noise": 0.5, "--fog-noise-scale": 0.7,
              "--fog-drift": "1,0,0"}  # fmt: skip
    flags = ("--scattering", 0.5, *(each for pair in varied.items() for each in pair))
    names = ("height:falloff", "height:ground", "noise:amount", "noise:scale", "noise:drift")
    values = (each if each != "1,0,0" else "(1, 0, 0)" for each in varied.values())
    own = [f"/Cube.photonbeams:{name}={value}" for name, value in zip(names, values, strict=True)]
    settings = [each for one in own for each in ("--set", one)]
    bare, cube = stage(CAMERA, LAMP, FLOOR), write_stage(out / "cube.usda", CAMERA, LAMP, FLOOR, CUBE)
    assert render(bare, "-o", out / "a.exr", *flags, "--fog-box", "-1,-1,-1,1,1,1")[0] == 0
    assert render(cube, "-o", out / "b.exr", *settings, "--set", "/Cube.photonbeams:scattering=0.5")[0] == 0
    a, b = (read_layers(out / f"{name}.exr") for name in "ab")
    assert all(np.array_equal(a[name], b[name]) for name in a) and a["beams"].mean() > 0
    fails(render(bare, "-o", out / "d.exr", *flags, "--fog-box", "/No"), 2, "--fog-box", "no prim /No")
    fails(render(bare, "-o", out / "d.exr", "--scattering", 1, "--fog-ground", 1), 2, "--fog-ground", "--fog-falloff")
    fails(render(bare, "-o", out / "d.exr", "--scattering", 1, "--fog-drift", "1,1,1"), 2, "--fog-drift", "--fog-noise")


def test_a_fog_that_beams_alone_feel_by_flag_or_on_the_stage(render, stage, out):
    path = stage(CAMERA, LAMP, FLOOR, FOG)
    thick = ("--scattering", 0.3)
    assert render(path, "-o", out / "a.exr", *thick)[0] == 0
    assert render(path, "-o", out / "b.exr", *thick, "--beams-only-fog")[0] == 0
    assert render(path, "-o", out / "c.exr", *thick, "--set", "/Fog.photonbeams:surfaces=0")[0] == 0
    a, b, c = (read_layers(out / f"{name}.exr") for name in "abc")
    assert np.array_equal(a["beams"], b["beams"]) and np.array_equal(b["rgba"], c["rgba"])
    assert a["transmittance"].min() < 0.5 and np.all(b["transmittance"] == 1)
    assert b["surface"].sum() > 1.5 * a["surface"].sum() > 0


def test_values_are_set_over_the_stage_and_over_session_layers(render, stage, out, tmp_path):
    path = stage()
    over = write_stage(tmp_path / "over.usda", 'over "Lamp" {\n    float inputs:intensity = 20\n}\n')
    for name, flags in {
        "one": (),
        "layer": ("--session-layer", over),
        "both": ("--session-layer", over, "--set", "/Lamp.inputs:intensity=40"),
    }.items():
        assert render(path, "-o", out / f"{name}.exr", *flags)[0] == 0
    one, layer, both = (read_layers(out / f"{name}.exr")["beams"].mean() for name in ("one", "layer", "both"))
    np.testing.assert_allclose([layer / one, both / one], [2, 4], rtol=1e-3)  # half has 11 bits


def test_progress_is_shown_as_asked(render, stage, out):
    for kind, lines in {"plain": True, "none": False, "rich": False}.items():
        code, _, stderr = render(stage(), "-o", out / "a.exr", "--progress", kind)
        assert code == 0
        assert ("pass 1 of 1" in stderr) is lines
        assert "wrote" in stderr
    empty = stage(FOG, CAMERA, LAMP, 'def Mesh "Floor" {\n}\n')
    assert render(empty, "-o", out / "a.exr", "-q") == (0, "", "")


def test_a_seed_is_a_picture(render, stage, out):
    for name, seed in (("a", 1), ("b", 1), ("c", 2), ("d", -1), ("e", 10**20)):
        assert render(stage(), "-o", out / f"{name}.exr", "--seed", seed)[0] == 0
    pictures = [read_layers(out / f"{name}.exr")["beams"] for name in "abcde"]
    assert np.array_equal(pictures[0], pictures[1])
    assert len({each.tobytes() for each in pictures}) == 4


def test_a_time_limit_ends_a_render_with_what_there_is(render, stage, out):
    code, _, stderr = render(
        stage(), "-o", out / "a.exr", "--res", 16, 9, "--beams", 64, "--passes", 10**6, "--time-limit", 0.2, small=False
    )
    assert code == 0
    passes = int(re.search(r"([\d,]+) of 1,000,000 passes \(--time-limit\)", stderr)[1].replace(",", ""))
    with OpenEXR.File(str(out / "a.exr"), header_only=True) as file:
        assert 1 <= file.parts[0].header["passes"] == passes < 10**6


@pytest.mark.parametrize(
    "flags", [("--estimator", "billboard"), ("--estimator", "frustum", "--rule", "riemann", "--order", 3)]
)
def test_estimates_agree_roughly_whatever_the_estimator(render, stage, out, flags):
    for name, more in (("a", ()), ("b", flags)):
        assert render(stage(), "-o", out / f"{name}.exr", *more)[0] == 0
    a, b = (read_layers(out / f"{name}.exr")["beams"].mean() for name in "ab")
    assert b == pytest.approx(a, rel=0.2)  # 64 wide beams around a lamp in view; the estimators' own tests are strict


def test_layers_choose_what_the_exr_holds_and_groups_have_theirs(render, stage, out):
    grouped = LAMP.replace("}\n", '    token photonbeams:lightGroup = "key"\n}\n')
    black = grouped.replace('"Lamp"', '"Off"').replace('"key"', '"off"').replace("= 10", "= 0")
    path = stage(FOG, CAMERA, grouped, black)
    assert render(path, "-o", out / "all.exr", "--picture", f"beams_key={out / 'key.png'}")[0] == 0
    layers = read_layers(out / "all.exr")
    groups = ["beams_key", "beams_off", "surface_default", "surface_key", "surface_off"]
    assert list(layers) == ["rgba", "surface", "beams", *groups, "transmittance", "depth"]
    for kind in ("beams", "surface"):
        assert layers[kind].any() and np.array_equal(layers[f"{kind}_key"], layers[kind])
    assert not layers["beams_off"].any()
    assert render(path, "-o", out / "some.exr", "--layers", "depth,beams_key")[0] == 0
    assert list(read_layers(out / "some.exr")) == ["rgba", "beams_key", "depth"]
    fails(render(path, "-o", out / "no.exr", "--layers", "beams_fill"), 2, "--layers", "'beams_fill'", "beams_key")


# -- wrong flags -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "parts"),
    [
        (("--res", -1, 5), ("--res is -1 5", "0 to 65536")),
        (("--res", 100000, 5), ("--res is 100000 5",)),
        (("--res", "x", 5), ("--res is x", "a valid integer")),
        (("--res-scale", 0), ("--res-scale is 0",)),
        (("--res-scale", "nan"), ("--res-scale is nan",)),
        (("--crop", 0, 0, "inf", 1), ("--crop is 0 0 inf 1", "x0 < x1")),
        (("--crop", 0.5, 0, 0.5, 1), ("--crop is 0.5 0 0.5 1",)),
        (("--crop", "nan", 0, 1, 1), ("--crop is nan 0 1 1",)),
        (("--passes", 0), ("--passes is 0", "expected 1 to")),
        (("--passes", "many"), ("--passes is many", "expected a valid integer")),
        (("--beams", 0), ("--beams is 0", "expected 1 to 100000000")),
        (("--beams", 10**10), ("--beams is 10000000000", "expected 1 to 100000000")),
        (("--bounces", -2), ("--bounces is -2: expected 0 to 2147483645, or -1",)),
        (("--filter", "sinc"), ("--filter is sinc", "'lanczos'")),
        (("--checkpoint", "nan"), ("--checkpoint is nan: expected a positive number of seconds",)),
        (("--order", 0), ("--order is 0", "1 to 256")),
        (("--order", 1000), ("--order is 1000", "1 to 256")),
        (("--gather-error", 1), ("--gather-error is 1", "0 (exact) to less than 1")),
        (("--time-limit", 0), ("--time-limit is 0",)),
        (("--time-limit", "nan"), ("--time-limit is nan",)),
        (("--exposure", "nan"), ("--exposure is nan",)),
        (("--exposure", 1e9), ("--exposure is 1000000000",)),
        (("--threads", 0), ("--threads is 0",)),
        (("--threads", 10**6), ("--threads is 1000000",)),
        (("--scattering", "nan"), ("--scattering is nan", "one number, or three")),
        (("--scattering", "1,2"), ("--scattering is 1,2",)),
        (("--fog-box", "1,2,3"), ("--fog-box is 1,2,3", "6 numbers separated by commas, or the path of a prim")),
        (("--fog-box", "0,0,0,0,1,1"), ("--fog-box is 0,0,0,0,1,1", "the box is 0 0 0 to 0 1 1", "with a volume")),
        (("--fog-drift", "1,nan,1"), ("--fog-drift is 1,nan,1", "3 numbers separated by commas")),
        (("--absorption", "-1"), ("--absorption is -1", "at least 0")),
        (("--anisotropy", 2), ("--anisotropy is 2", "-0.99 to 0.99")),
        (("--anisotropy", "nan"), ("--anisotropy is nan",)),
        (("--frames", "7:9"), ("a.exr is one file for 3 frames", "expected one run of #", "a.####.exr")),
        (("--frames", "7:8x0.25"), ("a.exr is one file for 5 frames", "a.####.##.exr")),
        (("--frames", "nan"), ("--frames is nan", "expected frames such as 101")),
        (("--device", "abacus"), ("--device is abacus", "'cpu'")),
        (("--estimator", "x"), ("--estimator is x", "'billboard'")),
        (("--progress", "x"), ("--progress is x", "'plain'")),
        (("--bogus",), ("No such option: --bogus",)),
        (("-o", "a.jpg"), ("a.jpg", ".exr or .png")),
        (("-o", "a.##.b##.exr"), ("a.##.b##.exr", "one run of #")),
        (("-o", "a.####/b.####.exr"), ("a.####/b.####.exr", "one run of #", "in the file's own name")),
        (("-o", "./a.exr"), ("a.exr is named twice",)),
        (("-o", "a\udcff.exr"), ("udcff", "UTF-8")),
        (("--picture", "b.png"), ("b.png", "expected LAYER=FILE.png")),
        (("--picture", "beams=b.exr"), ("b.exr", ".png")),
        (("--picture", "glow=b.png"), ("'glow'", ", ".join(LAYERS))),
        (("--picture", "depth=b.png"), ("--picture names 'depth', which has no colours", "another layer")),
        (("--picture", "depth=b.png", "--dry-run"), ("--picture names 'depth', which has no colours",)),
        (("--layers", "glow"), ("'glow'", ", ".join(LAYERS))),
    ],
)
def test_a_wrong_flag_is_refused_before_rendering(render, stage, tmp_path, monkeypatch, flags, parts):
    path = stage()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(frame, "begin", None)  # an error if anything is rendered
    fails(render(path, "-o", "a.exr", *SMALL, *flags, small=False), 2, *parts)
    assert [each.name for each in tmp_path.iterdir()] == ["stage.usda"]


def test_an_output_and_a_stage_are_asked_for(render, stage):
    fails(render(stage()), 2, "expected at least one output", "-o FILE.exr")
    fails(render("-o", "a.exr"), 2, "Missing argument 'scene'")


def test_without_a_command_the_help_is_shown(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["photonbeams"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2
    assert "render" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "parts"),
    [
        (("-cam", "Nobody"), ("'Nobody'", "/Camera")),
        (("--set", "/Lamp.inputs:intensity"), ("expected /prim.attribute=value",)),
        (("--set", "/Lamp.inputs:intensity=nan"), ("/Lamp.inputs:intensity=nan", "finite")),
        (("--set", "/Nobody.x=1"), ("no prim /Nobody",)),
        (("--session-layer", "gone.usda"), ("gone.usda", "no such file")),
        (("--res", 60000, 60000), ("60000 x 60000 pixels", "--crop")),
        (("--res-scale", 1000, "--res", 1000, 0), ("1000000 x 56", "expected 1 to 65536")),
    ],
)
def test_flags_that_do_not_suit_the_stage_are_named(render, stage, out, flags, parts):
    fails(render(stage(), "-o", out / "old.exr", "-q", *flags, small=False), 1, *parts)
    assert untouched(out)


# -- broken stages ---------------------------------------------------------------------------------------------------


def test_a_stage_that_is_not_there_is_named(render, out, tmp_path):
    fails(render(tmp_path / "gone.usda", "-o", out / "old.exr"), 1, str(tmp_path / "gone.usda"), "no such file")
    fails(render(tmp_path, "-o", out / "old.exr"), 1, str(tmp_path), "expected a .usd")
    fails(render(tmp_path / "gone\udcff.usda", "-o", out / "old.exr"), 1, "UTF-8")
    assert untouched(out)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.usda", b""),
        ("a.usda", b"\x00\xff\x07garbage" * 100),
        ("a.usda", b'#usda 1.0\ndef Xform "A" {'),
        ("a.usdc", b"PXR-USDC" + bytes(200)),
        ("a.usd", b"\x89garbage" * 100),
        ("a.usdz", b"PK\x03\x04" + b"broken" * 50),
        ("a.usdz", b"PK\x05\x06" + bytes(18)),
    ],
)
def test_a_broken_file_is_one_sentence(render, out, tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    fails(render(tmp_path / name, "-o", out / "old.exr"), 1, str(tmp_path / name), "cannot be read")
    assert untouched(out)


def with_(prim, old, new):
    assert old in prim
    return prim.replace(old, new)


def lamp(body):
    return with_(LAMP, "}\n", f"    {body}\n}}\n")


@pytest.mark.parametrize(
    ("prims", "parts"),
    [
        ((FOG, LAMP), ("there is no camera", "expected a camera")),
        ((CAMERA,), ("there is nothing to render", "expected meshes, lights, fog or drawn beams")),
        (
            (FOG, CAMERA, 'def DomeLight "Sky" {\n    bool photonbeams:enabled = 0\n}\n'),
            ("nothing makes beams", "/Sky", "photonbeams:enabled"),
        ),
        ((CAMERA, LAMP), ("there is no fog", "PhotonBeamsMediumAPI", "--scattering")),
        # meshes
        ((FOG, CAMERA, LAMP, with_(FLOOR, "0, 1, 2, 3", "0, 1, 2, 30")), ("/Floor.faceVertexIndices", "30", "0 to 3")),
        ((FOG, CAMERA, LAMP, 'def Cone "C" {\n    uniform token axis = "W"\n}\n'), ("/C.axis is 'W'", "X, Y, Z")),
        (
            (FOG, CAMERA, LAMP, 'def Xform "X" {\n    uniform token[] xformOpOrder = ["xformOp:nope"]\n}\n'),
            ("/X.xformOpOrder has an entry that is not a transform", "expected xformOps"),
        ),
        ((FOG, CAMERA, LAMP, with_(FLOOR, "[4]", "[4, 4]")), ("/Floor.faceVertexIndices has 4", "expected 8")),
        ((FOG, CAMERA, LAMP, with_(FLOOR, "[4]", "[5, -1]")), ("/Floor.faceVertexCounts holds -1",)),
        ((FOG, CAMERA, LAMP, with_(FLOOR, "(2, -1, -2)", "(nan, 0, 0)")), ("/Floor.points[2] is (nan", "finite")),
        ((FOG, CAMERA, LAMP, with_(FLOOR, "-1, ", "-1e30, ")), ("/Floor reaches 1e+30 units", "1e+12")),
        # cameras
        ((FOG, with_(CAMERA, "focalLength = 20", "focalLength = 0"), LAMP), ("/Camera.focalLength is 0", "positive")),
        ((FOG, with_(CAMERA, "focalLength = 20", "focalLength = nan"), LAMP), ("/Camera.focalLength is nan",)),
        ((FOG, with_(CAMERA, "focalLength = 20", "focalLength = 1e-30"), LAMP), ("/Camera.focalLength", "ratio")),
        ((FOG, with_(CAMERA, "= 18", "= 0"), LAMP), ("/Camera.verticalAperture is 0", "positive")),
        ((FOG, with_(CAMERA, "= 32", "= -1"), LAMP), ("/Camera.horizontalAperture is -1", "at least 0")),
        ((FOG, with_(CAMERA, "(0, 0, 5)", "(0, 0, nan)"), LAMP), ("/Camera", "transform that is not finite")),
        ((FOG, with_(CAMERA, "(0, 0, 5)", "(0, 0, 1e300)"), LAMP), ("/Camera reaches 1e+300 units",)),
        ((FOG, CAMERA.replace("translate", "scale"), LAMP), ("/Camera is scaled to zero",)),
        (
            (FOG, with_(CAMERA, "float focal", "float2 clippingRange = (9, 1)\n    float focal"), LAMP),
            ("/Camera.clippingRange is (9, 1)", "near distance before a far one"),
        ),
        # lights
        ((FOG, CAMERA, with_(LAMP, "= 10", "= -1")), ("/Lamp.inputs:intensity is -1", "at least 0")),
        ((FOG, CAMERA, with_(LAMP, "= 10", "= nan")), ("/Lamp.inputs:intensity is nan", "finite")),
        ((FOG, CAMERA, with_(LAMP, "= 0.1", "= -1")), ("/Lamp.inputs:radius is -1", "at least 0")),
        ((FOG, CAMERA, with_(LAMP, "= 0.1", "= 1e30")), ("/Lamp reaches 1e+30 units",)),
        ((FOG, CAMERA, lamp("color3f inputs:color = (nan, 1, 1)")), ("/Lamp.inputs:color", "nan", "finite")),
        ((FOG, CAMERA, lamp("int photonbeams:count = 0")), ("/Lamp.photonbeams:count is 0", "1 to 100,000,000")),
        ((FOG, CAMERA, lamp("int photonbeams:count = 10000000000")), ("10000000000", "/Lamp.photonbeams:count")),
        ((FOG, CAMERA, 'def RectLight "Lamp" {\n    float inputs:width = 0\n}\n'), ("/Lamp.inputs:width is 0",)),
        ((FOG, CAMERA, lamp("rel photonbeams:portal = </Gone>")), ("/Lamp.photonbeams:portal names /Gone",)),
        # fog
        ((with_(FOG, "(0.1, 0.1", "(-1, 0.1"), CAMERA, LAMP), ("/Fog.photonbeams:scattering", "-1", "at least 0")),
        ((with_(FOG, "(0.1, 0.1", "(nan, 0.1"), CAMERA, LAMP), ("/Fog.photonbeams:scattering", "nan", "finite")),
        ((with_(FOG, "}\n", "    float photonbeams:anisotropy = 2\n}\n"), CAMERA, LAMP), ("anisotropy is 2", "0.99")),
        # looks
        ((FOG, CAMERA, lamp("rel photonbeams:look = </Camera>")), ("/Lamp.photonbeams:look names /Camera",)),
        (
            (FOG, CAMERA, lamp("rel photonbeams:look = </Look>"),
             'def PhotonBeamsLook "Look" {\n    float photonbeams:along:length = 0\n}\n'),
            ("/Look.photonbeams:along:length is 0", "more than 0"),
        ),
        # textures
        ((FOG, CAMERA, LAMP, TEXTURED), ("/Wood/Image.inputs:file names ./wood.png", "there is none")),
    ],
)  # fmt: skip
def test_what_cannot_be_rendered_is_named_with_file_prim_and_attribute(render, stage, out, prims, parts):
    path = stage(*prims)
    fails(render(path, "-o", out / "old.exr", "--strict"), 1, str(path), *parts)
    assert untouched(out)
    assert fails(render(path, "-o", out / "old.exr", "--strict", "--dry-run"), 1, str(path), *parts)


def test_a_texture_that_is_no_image_is_named(render, stage, out, tmp_path):
    (tmp_path / "wood.png").write_bytes(b"bark")
    parts = ("/Wood/Image.inputs:file", "wood.png", "expected an image")
    fails(render(stage(FOG, CAMERA, LAMP, TEXTURED), "-o", out / "old.exr", "--strict"), 1, *parts)
    assert untouched(out)


def test_a_layer_that_is_not_there_is_named(render, stage, out):
    path = stage(FOG, CAMERA, LAMP, metadata="subLayers = [@./gone.usda@]")
    fails(render(path, "-o", out / "old.exr", "--strict"), 1, str(path), "gone.usda")
    assert untouched(out)


@pytest.mark.parametrize(
    ("prims", "metadata", "warnings"),
    [
        (
            (FOG, CAMERA, lamp("rel photonbeams:portal = </Portal>"), PORTAL, with_(FLOOR, "[4]", "[5]")),
            "subLayers = [@./gone.usda@]",
            [
                "gone.usda@, which is not there; it is left out",
                "/Portal has 1 faces without area",
                "/Lamp.photonbeams:portal names /Portal, which has no area: expected a surface; the light has no "
                "portal",
                "/Floor.faceVertexIndices has 4 values: expected 5, the sum of faceVertexCounts; it is skipped",
            ],
        ),
        ((CAMERA, FLOOR, 'def DomeLight "Sky" {\n}\n'), "", ["there is no fog, so no beams are seen"]),
    ],
)
def test_what_cannot_be_rendered_is_left_out_with_one_warning_each(render, stage, out, prims, metadata, warnings):
    code, _, stderr = render(stage(*prims, metadata=metadata), "-o", out / "a.exr")
    said = [line for line in stderr.splitlines() if line.startswith("Warning: ")]
    assert code == 0 and len(said) == len(warnings)
    assert all(any(part in line for line in said) for part in warnings)
    layers = read_layers(out / "a.exr")
    assert layers["rgba"][..., :3].any() and not any(np.isnan(pixels).any() for pixels in layers.values())


def test_domes_make_beams_where_that_is_asked_for(render, stage, out):
    path = stage(FOG, CAMERA, FLOOR, 'def DomeLight "Sky" {\n}\n')
    assert render(path, "-o", out / "dark.exr", "--set", "/Sky.photonbeams:enabled=0")[0] == 0
    assert render(path, "-o", out / "light.exr", "--dome-beams")[0] == 0
    dark, light = (read_layers(out / name) for name in ("dark.exr", "light.exr"))
    assert dark["surface"].any() and not dark["beams"].any()
    assert light["beams"].any()


@pytest.mark.parametrize(
    ("prims", "warning"),
    [
        ((FOG, CAMERA, LAMP, 'def Mesh "Empty" {\n}\n'), "/Empty has no faces: it is skipped"),
        ((FOG, CAMERA, with_(LAMP, "= 10", "= 0")), "no beams have any light: expected some of /Lamp to shine"),
        ((FOG, CAMERA, LAMP, PORTAL), "/Portal has 1 faces without area: they are skipped"),
        (
            (FOG, CAMERA, LAMP, re.sub("point3f.*", "", FLOOR)),
            "/Floor has no points: it is skipped",
        ),
        ((FOG, CAMERA, LAMP, 'def Cube "Dot" {\n    double size = 0\n}\n'), "/Dot has 6 faces without area"),
        ((FOG, CAMERA, LAMP, 'def DistantLight "Sun" {\n    double3 xformOp:scale = (0, 0, 0)\n'
          '    uniform token[] xformOpOrder = ["xformOp:scale"]\n}\n'), "/Sun is scaled to zero: it is skipped"),
        ((FOG, CAMERA, LAMP, TEXTURED.split('def Material')[0]), "/Wall.material:binding names /Wood"),
    ],
)  # fmt: skip
def test_what_is_degenerate_is_skipped_with_one_warning(render, stage, out, prims, warning):
    path = stage(*prims)
    code, _, stderr = render(path, "-o", out / "a.exr")
    assert code == 0
    warnings = [line for line in stderr.splitlines() if line.startswith("Warning: ")]
    assert len(warnings) == 1
    assert f"{path}: {warning}" in warnings[0]
    assert all(not np.isnan(pixels).any() for pixels in read_layers(out / "a.exr").values())


def test_odd_names_and_values_render(render, stage, out, tmp_path):
    folder = tmp_path / "Ü ñ 雪"
    folder.mkdir()
    path = write_stage(folder / "сцена.usda", FOG, CAMERA, LAMP, metadata="framesPerSecond = 1e30")
    assert render(path, "-o", folder / "сцена.exr")[0] == 0
    assert sorted(each.name for each in folder.iterdir()) == ["сцена.exr", "сцена.usda"]


# -- disks and signals -----------------------------------------------------------------------------------------------


def test_an_output_that_cannot_be_written_is_named_before_rendering(render, stage, out, monkeypatch):
    monkeypatch.setattr(frame, "begin", None)  # an error if anything is rendered
    (out / "folder.exr").mkdir()
    fails(render(stage(), "-o", out / "folder.exr"), 1, str(out / "folder.exr"), "Is a directory")
    (out / "folder.exr").rmdir()
    fails(render(stage(), "-o", out / "old.exr" / "a.exr"), 1, str(out / "old.exr" / "a.exr"), "Not a directory")
    fails(render(stage(), "-o", out / f"{'a' * 300}.exr"), 1, "File name too long")
    if Path("/proc/self").exists():
        fails(render(stage(), "-o", "/proc/self/a.exr"), 1, "/proc/self/a.exr")
    if os.geteuid() != 0:  # root may write anywhere
        out.chmod(0o555)
        fails(render(stage(), "-o", out / "a.exr"), 1, str(out / "a.exr"), "Permission denied")
        out.chmod(0o755)
    assert untouched(out)


def test_ctrl_c_ends_with_130_and_nothing_written(stage, out):
    arguments = command(
        stage(), "-o", out / "old.exr", "-o", out / "new" / "a.png", "--res", 32, 0, "--passes", 10**9, "--beams", 64
    )
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            assert process.stderr.readline().startswith("pass 0 of")
            process.send_signal(signal.SIGINT)
            stdout, stderr = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert stdout == ""
    lines = [line for line in stderr.splitlines() if not line.startswith("pass ")]
    assert lines == ["Interrupted; nothing was written"]
    assert untouched(out)


def test_ctrl_c_while_libraries_are_imported_is_held_back(render, stage, out, monkeypatch):
    monkeypatch.setattr("photonbeams.runtime.device.select", lambda _: os.kill(os.getpid(), signal.SIGINT))
    assert render(stage(), "-o", out / "old.exr") == (130, "", "Interrupted; nothing was written\n")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert untouched(out)


def test_an_interrupt_is_one_also_where_it_is_wrapped(render, stage, out, monkeypatch):
    def interrupted(*_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise RuntimeError("dr.while_loop(): encountered an exception (see above).") from interrupt

    monkeypatch.setattr(FrameRenderer, "add_pass", interrupted)
    code, stdout, stderr = render(stage(), "-o", out / "old.exr", "--progress", "none")
    assert (code, stdout, stderr) == (130, "", "Interrupted; nothing was written\n")
    assert untouched(out)


def test_the_defaults_that_help_tells_hold():
    command = typer.main.get_command(cli.app).get_command(None, "render")
    told = {each.name: each.help for each in command.params if isinstance(each.help, str)}
    settings = Settings()
    assert f"default: {settings.passes}, " in told["passes"]
    assert f"default: {DEFAULT_BEAMS}; " in told["beams"] and f", or {DEFAULT_PATHS}." in told["beams"]
    assert f"default: {settings.estimator}, " in told["estimator"]
    assert f"default: {len(settings.rule)}, " in told["order"]
    assert settings.rule.name == "gauss_legendre" and told["rule"].endswith("default: gauss.")
    assert told["seed"].endswith(f"default: {settings.seed}.")


def test_help_is_fast_and_has_examples():
    script = "import sys; from photonbeams import cli\ntry: cli.main(['render', '--help'])\nexcept SystemExit: pass\n"
    script += "print([name for name in ('pxr', 'drjit', 'mitsuba', 'numpy') if name in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert "photonbeams render shot.usda -o" in shown
    assert shown.splitlines()[-1] == "[]"


def test_a_texture_that_is_cut_off_is_named(render, stage, out, tmp_path):
    whole = tmp_path / "wood.png"
    OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(4, 4, 3, "uint8")).write(str(whole))
    whole.write_bytes(whole.read_bytes()[:-20])
    stderr = render(stage(FOG, CAMERA, LAMP, TEXTURED), "-o", out / "old.exr")[2]
    assert any(line.startswith("Warning: ") and "wood.png" in line for line in stderr.splitlines())


# -- looks of one's own -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["mine.py:green"], 0, ""),
        (["Lamp=mine.py:green"], 0, ""),
        (["Lmp=mine.py:green"], 1, "no beams are named Lmp: expected one of "),
        (["mine.py:number"], 2, "--look is mine.py:number: expected a photonbeams.Look 'number' in mine.py"),
        (["gone.py:green"], 2, "--look is gone.py:green: expected a file that exists"),
        (["green"], 2, "--look is green: expected FILE.py:NAME"),
        (
            ["mine.py:green", "Lamp=mine.py:green"],
            2,
            "expected either one look for all beams, or at most one for each prim",
        ),
        (["mine.py:words"], 1, "the look's function words returns a str: expected a Float, an Array3f or a number"),
        (["mine.py:nothing"], 1, "the look's factor along is not finite everywhere"),
        (["broken.py:green"], 1, "broken.py, line 1: "),
        (["binary.py:green"], 1, "source code string cannot contain null bytes"),
    ],
)
def test_a_look_in_python_is_taken_or_told_in_a_sentence(render, stage, out, monkeypatch, flags, code, message):
    monkeypatch.chdir(out)
    (out / "mine.py").write_text(
        "import photonbeams as pb\n"
        "number = 3\n"
        "def told(s):\n    return 'red'\n"
        "told.__name__ = 'words'\n"
        "green, words = pb.Look(along='[0, 1, 0]'), pb.Look(along=told)\n"
        "nothing = pb.Look(along=lambda s: s / 0)\n"
    )
    (out / "broken.py").write_text("green = = 1\n")
    (out / "binary.py").write_bytes(b"\xff\xfe\0green")
    given = [word for flag in flags for word in ("--look", flag)]
    result = render(stage(), "-o", "a.exr", "--progress", "none", "-q", *given)
    if code:
        fails(result, code, message)
    assert result[0] == code
    assert (out / "a.exr").exists() == (code == 0)
