"""`photonbeams render --holdout … --over …` and `--session-layer`, as their users call them."""

import re
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from pxr import Usd

from photonbeams.images.files import read_image, read_layers

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "blender"
ATTIC, PLATE = EXAMPLES / "attic.usda", EXAMPLES / "plate.exr"
FOG = ("--scattering", 0.05)
SMALL = ("--passes", 1, "--beams", 64, "--progress", "none")

# A stage of plain USD, and layers over it for a session.
BARE = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 3
)
def Camera "Camera" {
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:radius = 0.1
    float inputs:intensity = 10
}
"""
LOOK = """#usda 1.0
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
def PhotonBeamsLook "Red" {
    float[] photonbeams:along:ramp:knots = [0, 1]
    color3f[] photonbeams:along:ramp:colors = [(1, 0, 0), (1, 0, 0)]
}
over "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
    rel photonbeams:look = </Red>
    token photonbeams:lightGroup = "lamp"
}
"""
THICK = '#usda 1.0\nover "Fog" {\n    color3f photonbeams:scattering = (0.4, 0.4, 0.4)\n}\n'


@pytest.fixture
def files(tmp_path):
    for name, text in (("bare", BARE), ("look", LOOK), ("thick", THICK)):
        (tmp_path / f"{name}.usda").write_text(text)
    return tmp_path


def depth_file(path, value=2.0, size=(16, 9), **others):
    values = {"Z": value, **others}
    channels = {name: np.full(size[::-1], each, np.float32) for name, each in values.items()}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(path))
    return path


# -- holdout and plate -----------------------------------------------------------------------------------------------


def test_beams_go_over_a_plate_of_cycles_in_exr_and_png(call, tmp_path):
    flags = ("--holdout", PLATE, "--over", PLATE, *FOG, *SMALL)
    code, _, stderr = call("render", ATTIC, "-o", tmp_path / "a.exr", "-o", tmp_path / "a.png", *flags)
    # Each light group has few beams here, which are wider than the skylight's gaps.
    assert code == 0 and [each for each in stderr.splitlines() if "Warning" in each and "gaps of" not in each] == []
    layers, plate = read_layers(tmp_path / "a.exr"), read_layers(PLATE)["ViewLayer.Combined"]
    assert layers["rgba"].shape == (180, 320, 4)  # without --res, the size of the plate
    half = 2**-10 * np.maximum(layers["rgba"][..., :3], 1e-3)  # each of the two is rounded to half precision
    assert np.all(np.abs(layers["rgba"][..., :3] - plate[..., :3] - layers["beams"]) <= half)
    assert np.array_equal(layers["rgba"][..., 3], plate[..., 3])
    shown = read_image(tmp_path / "a.png")
    dark = layers["rgba"][..., :3].max(axis=2) < 0.4  # below the shoulder of tone mapping
    assert np.abs(shown - layers["rgba"][..., :3])[dark].max() < 0.01  # 8 bits, dithered


def test_a_preview_may_be_a_part_of_the_plates_size(call, tmp_path):
    flags = ("--holdout", PLATE, "--over", PLATE, "--over-fog", *FOG, *SMALL)
    assert call("render", ATTIC, "-o", tmp_path / "a.exr", "--res-scale", 0.25, *flags)[0] == 0
    assert read_layers(tmp_path / "a.exr")["rgba"].shape == (45, 80, 4)


def test_a_frame_has_the_holdout_of_its_number(call, files):
    for frame in (1, 2):
        depth_file(files / f"z.{frame:04d}.exr", float(frame))
    flags = ("--session-layer", files / "look.usda", "--holdout", files / "z.####.exr", *SMALL)
    assert call("render", files / "bare.usda", "-o", files / "a.#.exr", "-f", "1:2", *flags)[0] == 0
    assert [read_layers(files / f"a.{frame}.exr")["depth"][0, 0] for frame in (1, 2)] == [1, 2]


def test_a_coverage_is_the_alpha_or_a_channel_of_another_name_or_none(call, files):
    """Light behind the holdout is seen by what the coverage leaves: none, 0.75 for the alpha, 0.4 for the mask."""
    depth_file(files / "z.exr", 0.5, size=(32, 18), A=0.25, mask=0.6)
    flags = ("--session-layer", files / "look.usda", *SMALL, "--passes", 8, "--res", 32, 18)

    def beams(*more):
        assert call("render", files / "bare.usda", "-o", files / "a.exr", *flags, *more)[0] == 0
        return read_layers(files / "a.exr")["beams"][..., 0].astype(np.float64)

    whole = beams()
    before = beams("--holdout", files / "z.exr", "--holdout-coverage", "none")
    behind = whole - before
    assert behind.sum() > 0.5 * whole.sum()
    for more, passed in (((), 0.75), (("--holdout-coverage", "mask"), 0.4)):
        seen = beams("--holdout", files / "z.exr", *more) - before
        # Light of a pixel and pass is seen or not; it varies from pass to pass, at most by its own size.
        error = np.sqrt(2 * passed * (1 - passed) * (behind**2).sum() / 8) / behind.sum()
        assert seen.sum() / behind.sum() == pytest.approx(passed, abs=4 * error + 1e-3) and 4 * error < 0.12


def test_one_eye_needs_its_own_depth_alone(call, files):
    depth_file(files / "z.right.exr", 3.0)
    flags = ("--session-layer", files / "look.usda", "--holdout", files / "z.%V.exr", *SMALL)
    assert call("render", files / "bare.usda", "-o", files / "a.exr", "--stereo", "--view", "right", *flags)[0] == 0
    assert np.all(read_layers(files / "a.exr")["depth"] == 3)
    assert call("render", files / "bare.usda", "-o", files / "b.exr", "--stereo", *flags)[0] == 1


@pytest.mark.parametrize(
    ("flags", "code", "sentence"),
    [
        (("--holdout", "z.exr", "--res", 20, 10), 1, "z.exr is 16 x 9 pixels, and the picture 20 x 10: expected one"),
        (("--holdout", "nothing.exr"), 1, "nothing.exr cannot be read: expected an image (there is no such file)"),
        (("--holdout", "look.usda"), 1, "look.usda cannot be read: expected an image"),
        (("--holdout", "z.exr", "--holdout-channel", "depth.Z"), 1, "has no channel 'depth.Z': expected one of Z"),
        (("--holdout", "z.exr", "--stereo"), 1, "z.exr has no views, and the frame has two"),
        (("--holdout", "z.exr", "--holdout-coverage", "mask"), 1, "z.exr has no channel 'mask': expected one of Z"),
        (("--holdout-coverage", "none"), 2, "--holdout-coverage needs a holdout: expected --holdout, too"),
        (("-qf1:2", "-o", "a.#.exr", "--holdout", "x.#.exr", "--holdout-coverage", "A"), 1, "x.2.exr has no channel"),
        (("--over", "z.exr"), 1, "z.exr has no red, green and blue: expected a picture"),
        (("--holdout-scale", 2), 2, "--holdout-scale needs a holdout: expected --holdout, too"),
        (("--holdout-channel", "Z"), 2, "--holdout-channel needs a holdout: expected --holdout, too"),
        (("--holdout", "z.exr", "--holdout-scale", 0), 2, "--holdout-scale is 0.0: expected more than 0"),
        (("--holdout", "z.exr", "--holdout-depth", "z"), 2, "--holdout-depth is z: expected one of"),
        (("--over-fog",), 2, "--over-fog needs a plate: expected --over, too"),
        (
            ("-q", "-f", "1:3", "-o", "a.#.exr", "--holdout", "y.#.exr"),
            1,
            "y.3.exr cannot be read: expected an image (there",
        ),
    ],
)
def test_bad_plates_are_one_sentence_before_anything_is_rendered(call, files, monkeypatch, flags, code, sentence):
    monkeypatch.chdir(files)
    for name in ("z", "y.1", "y.2"):
        depth_file(files / f"{name}.exr")
    depth_file(files / "x.1.exr", A=0.5)
    depth_file(files / "x.2.exr")
    output = () if "-o" in flags else ("-o", "a.exr")
    found, _, stderr = call("render", "bare.usda", "--session-layer", "look.usda", *output, *SMALL, *flags)
    assert (found, stderr.count("\n")) == (code, 1), stderr
    assert stderr.startswith(f"Error: {sentence}") or sentence in stderr
    assert not list(files.glob("a*"))


# -- session layers --------------------------------------------------------------------------------------------------


def test_a_stage_without_our_schemas_gets_beams_and_a_look_from_a_session_layer_alone(call, files):
    assert "PhotonBeams" not in Usd.Stage.Open(str(files / "bare.usda")).ExportToString()
    before = (files / "bare.usda").read_bytes()
    layer = ("--session-layer", files / "look.usda")
    assert call("render", files / "bare.usda", *layer, "-o", files / "a.exr", "--res", 16, 0, *SMALL)[0] == 0
    beams = read_layers(files / "a.exr")["beams_lamp"]
    assert beams[..., 0].max() > 0
    assert beams[..., 1:].max() == 0  # the look's ramp is red
    assert (files / "bare.usda").read_bytes() == before
    code, _, stderr = call("render", files / "bare.usda", "-o", files / "b.exr", "--strict", *SMALL)
    assert code == 1
    assert "there is no fog" in stderr


def test_of_several_session_layers_the_first_is_the_strongest(call, files):
    def fog(*names):
        layers = [part for name in names for part in ("--session-layer", files / f"{name}.usda")]
        code, stdout, stderr = call("info", files / "bare.usda", *layers)
        assert code == 0, stderr
        return re.search(r"fog\s+scattering ([\d.]+)", stdout)[1]

    assert fog("look", "thick") == "0.1"
    assert fog("thick", "look") == "0.4"


def test_info_shows_the_stage_under_session_layers_and_no_image(call, files):
    stdout = call("info", files / "bare.usda", "--session-layer", files / "look.usda")[1]
    assert re.search(r"/Lamp +sphere .* lamp .*Red", stdout)
    code, _, stderr = call("info", PLATE, "--session-layer", files / "look.usda")
    assert code == 2
    assert stderr.startswith("Error: --session-layer is for stages")
    code, _, stderr = call("info", files / "bare.usda", "--session-layer", files / "nothing.usda")
    assert code == 1
    assert "nothing.usda: expected a USD stage, but there is no such file" in stderr


@pytest.mark.parametrize("flag", ["--holdout", "--over"])
def test_a_plate_is_not_replaced_by_what_lies_over_it(call, files, flag):
    plate = files / "plate.exr"
    plate.write_bytes(PLATE.read_bytes())
    code, _, stderr = call("render", files / "bare.usda", flag, plate, "-o", plate, *SMALL)
    assert code == 1
    assert f"{plate} would replace {plate}, which is read: expected another file to write to" in stderr
    assert plate.read_bytes() == PLATE.read_bytes()
