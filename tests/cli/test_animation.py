"""`photonbeams render` of several frames, and with a stage's render settings."""

import os
import re
import signal
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest

from photonbeams import Shot
from photonbeams.images.files import read_image, read_layers
from photonbeams.images.tiles import join_tiles
from photonbeams.scene import SceneError

STAGE = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 5
    %s
)
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering%s
}
def Camera "Camera" {
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
    float inputs:radius = 0.1
    float inputs:intensity = 10
    float inputs:exposure.timeSamples = { 1: 0, 5: 0 }
    token photonbeams:lightGroup = "key"
}
%s
"""
SIDE = 'def Camera "Side" {\n}\n'
SETTINGS = 'def RenderSettings "Settings" {\n%s\n}\n'
STILL = " = (0.1, 0.1, 0.1)"
SMALL = ("--passes", 1, "--beams", 16)
SIZE = ("--res", 32, 18)


@pytest.fixture
def stage(tmp_path):
    def written(more="", metadata="", fog=STILL):
        path = tmp_path / "stage.usda"
        path.write_text(STAGE % (metadata, fog, more))
        return path

    return written


@pytest.fixture
def out(tmp_path, monkeypatch):
    """Return an empty folder in which the command runs."""
    folder = tmp_path / "out"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def render(render):
    """Return a function that renders small pictures and returns the exit code and the lines of standard error."""

    def called(*arguments, size=SIZE):
        code, stdout, stderr = render(*arguments, *SMALL, *size)
        assert stdout == ""
        return code, stderr.splitlines()

    return called


def fails(result, code, *parts):
    found, lines = result
    assert found == code, lines
    assert len(lines) == 1, lines
    assert lines[0].startswith("Error: ")
    for part in parts:
        assert part in lines[0]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def interrupting(monkeypatch, frame, error=None):
    """Make the rendering of a frame end with Ctrl-C, or with an error."""
    whole = Shot.render

    def until(shot, number, *args, **more):
        if number == frame and error:
            raise error
        if number == frame:
            os.kill(os.getpid(), signal.SIGINT)
        return whole(shot, number, *args, **more)

    monkeypatch.setattr(Shot, "render", until)


# -- frames ----------------------------------------------------------------------------------------------------------


def test_frames_are_rendered_in_their_order_and_reported(render, stage, out):
    code, lines = render(stage(), "-f", "3:1x-2,2,3", "-o", "a.####.exr", "-o", "b/a.#.png", "--progress", "none")
    assert code == 0
    assert names(out) == ["a.0001.exr", "a.0002.exr", "a.0003.exr", "b"]
    assert names(out / "b") == ["a.1.png", "a.2.png", "a.3.png"]
    found = [re.fullmatch(r"frame (\d): 1 pass, 16 beams, [\d.]+ s, wrote (.+)", line) for line in lines[:3]]
    assert [match[1] for match in found] == ["3", "1", "2"]
    assert found[0][2] == "a.0003.exr, b/a.3.png"
    assert re.fullmatch(r"3 frames rendered, 0 skipped, 6 files written, [\d.]+ s", lines[3])
    assert len(lines) == 4
    with OpenEXR.File("a.0002.exr", header_only=True) as file:
        assert file.parts[0].header["frame"] == 2


def test_two_frames_of_a_stage_at_rest_have_the_same_pixels(render, stage, out):
    assert render(stage(), "-f", "1:2", "-o", "a.#.exr", "-o", "a.#.png")[0] == 0
    first, second = read_layers("a.1.exr"), read_layers("a.2.exr")
    assert list(first) == list(second)
    assert first["beams"].any()
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert np.array_equal(read_image("a.1.png"), read_image("a.2.png"))


def test_a_frame_of_several_is_the_frame_alone(render, stage, out):
    fog = ".timeSamples = { 1: (0.01, 0.01, 0.01), 5: (0.05, 0.05, 0.05)\n}\n"
    path = stage(fog=fog)
    assert render(path, "-f", "1:5x4", "-o", "a.#.exr")[0] == 0
    assert render(path, "-f", "5", "-o", "b.#.exr")[0] == 0
    first, last, alone = (read_layers(name)["beams"] for name in ("a.1.exr", "a.5.exr", "b.5.exr"))
    assert np.array_equal(last, alone)
    assert last.mean() > 2 * first.mean()


def test_flags_over_a_fog_hold_for_all_frames(render, stage, out):
    fog = ".timeSamples = { 1: (0.01, 0.01, 0.01), 5: (0.05, 0.05, 0.05)\n}\n"
    path = stage(fog=fog)
    assert render(path, "-f", "1,5", "-o", "a.#.exr", "--scattering", 0.02, "-q") == (0, [])
    assert render(path, "-f", "1,5", "-o", "b.#.exr", "--anisotropy", 0.1, "-q") == (0, [])
    first, last = (read_layers(f"a.{frame}.exr")["beams"] for frame in (1, 5))
    assert np.array_equal(first, last)
    first, last = (read_layers(f"b.{frame}.exr")["beams"] for frame in (1, 5))
    assert last.mean() > 2 * first.mean()


def test_fractional_frames_have_digits_after_the_point(render, stage, out):
    assert render(stage(), "-f", "1:2x0.5", "-o", "a.##.##.exr")[0] == 0
    assert names(out) == ["a.01.00.exr", "a.01.50.exr", "a.02.00.exr"]
    fails(render(stage(), "-f", "1:2x0.25", "-o", "a.##.#.exr"), 2, "a.##.#.exr", "expected ####.## in its name")


def test_progress_is_one_bar_over_all_frames(render, stage, out):
    lines = render(stage(), "-f", "1:2", "-o", "a.#.exr", "--progress", "plain")[1]
    assert [line for line in lines if "pass " in line] == [
        "frame 1: pass 0 of 1",
        "frame 1: pass 1 of 1",
        "frame 2: pass 1 of 1",
    ]
    lines = render(stage(), "-f", "1:2", "-o", "a.#.exr", "--progress", "rich")[1]
    assert lines[-1].startswith("2 frames rendered")


def test_a_light_group_that_is_hidden_in_a_frame_is_black_there(render, stage, out):
    other = 'def SphereLight "Fill" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {\n'
    other += '    token photonbeams:lightGroup = "fill"\n    token visibility.timeSamples = {\n'
    other += '        1: "inherited",\n        2: "invisible"\n    }\n}\n'
    picture = ("--picture", "beams_fill=fill.#.png")
    assert render(stage(other), "-f", "1:2", "-o", "a.#.exr", *picture, "--layers", "beams_fill")[0] == 0
    first, second = read_layers("a.1.exr"), read_layers("a.2.exr")
    assert list(first) == list(second) == ["rgba", "beams_fill"]
    assert first["beams_fill"].any()
    assert not second["beams_fill"].any()
    assert not read_image("fill.2.png").any()


def test_a_light_group_that_appears_later_has_its_layer_from_the_first_frame_on(render, stage, out):
    other = 'def SphereLight "Fill" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {\n'
    other += '    token photonbeams:lightGroup = "fill"\n    bool photonbeams:enabled.timeSamples = {\n'
    other += "        1: 0,\n        2: 1\n    }\n}\n"
    assert render(stage(other), "-f", "1:2", "-o", "a.#.exr", "--layers", "beams_fill")[0] == 0
    first, second = read_layers("a.1.exr"), read_layers("a.2.exr")
    assert list(first) == list(second) == ["rgba", "beams_fill"]
    assert not first["beams_fill"].any()
    assert second["beams_fill"].any()


def test_a_group_that_a_function_emits_later_is_in_the_frames_that_have_it(render, stage, out):
    (out / "late.py").write_text(
        "from photonbeams.scene import DrawnBeams\n\n"
        "def late(context):\n"
        "    beam = [[-1, 0, 0]], [[1, 0, 0]], [0.5], [0.5], [[1, 1, 1]]\n"
        "    return [DrawnBeams('late', *beam, group='late')] if context.frame > 1 else []\n"
    )
    assert render(stage(), "-f", "1:2", "-o", "a.#.exr", "--emit", "late.py:late")[0] == 0
    first, second = read_layers("a.1.exr"), read_layers("a.2.exr")
    assert "beams_late" not in first and second["beams_late"].any()


def test_a_frame_without_any_light_has_black_beams_and_does_not_end_the_film(render, call, stage, out):
    path = stage()
    hidden = 'token visibility.timeSamples = {\n        1: "inherited",\n        2: "invisible",\n    }\n'
    path.write_text(path.read_text().replace("    float inputs:radius", "    " + hidden + "    float inputs:radius"))
    code, lines = render(path, "-f", "1:3", "-o", "a.#.exr", "-o", "a.#.png", "--progress", "none")
    assert code == 0 and len(names(out)) == 6
    warned = [line for line in lines if "Warning" in line]
    assert len(warned) == 1 and f"{path}: nothing makes beams at frame 2" in warned[0]
    first, second = read_layers("a.1.exr"), read_layers("a.2.exr")
    assert list(first) == list(second)
    assert first["beams_key"].any()
    assert not second["beams"].any() and not second["beams_key"].any() and not second["surface"].any()
    # Without beams, a pass samples surfaces only once, so pixels at edges differ.
    assert np.mean(first["transmittance"] == second["transmittance"]) > 0.5
    film = ("--stereo", "--set", "/Camera.fStop=2", "--set", "/Camera.focusDistance=5")
    assert render(path, "-f", "2", "-o", "b.exr", "--over", "a.1.png", "--holdout", "a.1.exr", "-q")[0] == 0
    assert render(path, "-f", "2", "-o", "c.exr", "-q", *film)[0] == 0
    assert render(path, "-f", "2", "-o", "d.exr", "--dry-run")[1][1].startswith("Ready to render")
    assert call("beams", path, "-f", "1:2", "-o", "beams.#.usda")[0] == 0
    assert "BasisCurves" not in (out / "beams.2.usda").read_text()


def test_frames_of_a_stage_that_does_not_change_are_warned_of(render, stage, out):
    path = stage()
    path.write_text(path.read_text().replace("inputs:exposure.timeSamples = { 1: 0, 5: 0 }", "inputs:exposure = 0"))
    code, lines = render(path, "-f", "1:2", "-o", "a.#.exr", "--progress", "none")
    assert code == 0 and names(out) == ["a.1.exr", "a.2.exr"]
    assert lines[0] == f"Warning: {path} has no time samples: all 2 frames are the same"
    assert not any("Warning" in line for line in render(path, "-f", "1", "-o", "a.#.exr")[1])


def test_a_dry_run_counts_the_frames(render, stage, out):
    code, lines = render(stage(), "-f", "1:4", "-o", "a.#.exr", "--dry-run")
    assert code == 0
    assert lines[1] == "would render 4 of 4 frames"
    assert lines[2].startswith("would write a.1.exr to a.4.exr, with the layers rgba, ")
    assert names(out) == []


# -- frames that are there already -----------------------------------------------------------------------------------


def test_frames_that_are_there_are_skipped(render, stage, out):
    (out / "a.1.exr").write_bytes(b"kept")
    (out / "a.1.png").write_bytes(b"kept")
    (out / "a.2.exr").write_bytes(b"one of two")
    (out / "a.3.exr").write_bytes(b"")
    (out / "a.3.png").write_bytes(b"not empty")
    flags = ("-f", "1:3", "-o", "a.#.exr", "-o", "a.#.png", "--skip-existing", "--progress", "none")
    code, lines = render(stage(), *flags)
    assert code == 0
    assert (out / "a.1.exr").read_bytes() == b"kept"
    assert all("rgba" in read_layers(f"a.{frame}.exr") for frame in (2, 3))
    assert lines[0] == "frame 1: skipped, all its files exist"
    assert lines[-1].startswith("2 frames rendered, 1 skipped, 4 files written, ")
    code, lines = render(stage(), *flags)
    assert code == 0
    assert lines[-1].startswith("0 frames rendered, 3 skipped, 0 files written, ")


def test_one_frame_that_is_there_is_skipped(render, stage, out):
    (out / "a.exr").write_bytes(b"kept")
    code, lines = render(stage(), "-o", "a.exr", "--skip-existing", "--progress", "none")
    assert code == 0
    assert lines[-1].startswith("0 frames rendered, 1 skipped")
    assert (out / "a.exr").read_bytes() == b"kept"


def test_what_another_machine_wrote_meanwhile_is_skipped(render, stage, out, monkeypatch):
    whole = Shot.render

    def meanwhile(shot, number, *args, **more):
        (out / "a.2.exr").write_bytes(b"theirs")
        return whole(shot, number, *args, **more)

    monkeypatch.setattr(Shot, "render", meanwhile)
    code, lines = render(stage(), "-f", "1:3", "-o", "a.#.exr", "--skip-existing")
    assert (code, lines[-1][:29]) == (0, "2 frames rendered, 1 skipped,")
    assert (out / "a.2.exr").read_bytes() == b"theirs"


# -- what is refused, and what ends it -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "code", "parts"),
    [
        (("-f", "1:2", "-o", "a.exr"), 2, ("a.exr is one file for 2 frames", "a.####.exr")),
        (("-f", "1:2", "-o", "a.#.exr", "-o", "b.png"), 2, ("b.png is one file", "b.####.png")),
        (("-f", "1:2", "-o", "a.#.exr", "--picture", "beams=b.png"), 2, ("b.png is one file",)),
        (("-f", "1:2", "-o", "a.#.b#.exr"), 2, ("a.#.b#.exr", "expected one run of #")),
        (("-f", "1:2", "-o", "#/a.exr"), 2, ("#/a.exr is one file",)),
        (("-f", "5:1x1", "-o", "a.#.exr"), 2, ("--frames is 5:1x1", "endTimeCode cannot be less")),
        (("-f", "1:", "-o", "a.#.exr"), 2, ("--frames is 1:", "expected frames such as")),
        (("-f", "1:9999999", "-o", "a.#.exr"), 2, ("--frames is 1:9999999", "no more than 100,000 frames")),
        (("-f", "4:7", "-o", "a.#.exr"), 1, ("stage.usda has no frame 6 and 1 more", "from 1 to 5")),
        (("-f", "0", "-o", "a.exr"), 1, ("stage.usda has no frame 0: expected frames from 1 to 5",)),
        (("-f", "1:2", "-o", "folder.#.exr"), 1, ("folder.2.exr: Is a directory",)),
        (("-f", "1:2", "-o", "a.#.exr", "--layers", "glow"), 2, ("--layers names 'glow'",)),
        (("-f", "1:2", "-o", "a.#.exr", "-cam", "Nobody"), 1, ("no camera 'Nobody'",)),
        (("-o", "a.exr", "-rs", "/Gone"), 1, ("stage.usda has no render settings '/Gone'",)),
    ],
)
def test_what_cannot_be_done_is_refused_before_the_first_frame(render, stage, out, monkeypatch, flags, code, parts):
    (out / "folder.2.exr").mkdir()
    monkeypatch.setattr(Shot, "render", None)
    fails(render(stage(), *flags), code, *parts)
    assert names(out) == ["folder.2.exr"]


def test_an_error_names_its_frame_and_leaves_those_before(render, stage, out):
    # A portal that has no area at frame 3.
    portal = 'def Mesh "Portal" {\n    int[] faceVertexCounts = [3]\n    int[] faceVertexIndices = [0, 1, 2]\n'
    portal += "    point3f[] points = [(-1, -1, 1), (1, -1, 1), (0, 1, 1)]\n    float3 xformOp:scale.timeSamples = {\n"
    portal += "        2.9: (1, 1, 1), 3: (0, 0, 0), 3.1: (1, 1, 1)\n    }\n"
    portal += '    uniform token[] xformOpOrder = ["xformOp:scale"]\n}\n'
    portal += 'over "Lamp" {\n    rel photonbeams:portal = </Portal>\n}\n'
    over = stage().with_name("over.usda")
    over.write_text("#usda 1.0\n" + portal)
    flags = ("--session-layer", over, "-f", "1:4", "-o", "a.#.exr", "--progress", "none", "-q", "--strict")
    fails(render(stage(), *flags), 1, "Error: frame 3: ", "/Portal")
    assert names(out) == ["a.1.exr", "a.2.exr"]


@pytest.mark.parametrize(
    "error", [SceneError("a mesh is broken"), OSError(28, "No space left on device", "a.2.exr"), MemoryError()]
)
def test_whatever_ends_a_frame_names_it(render, stage, out, monkeypatch, error):
    interrupting(monkeypatch, 2, error)
    fails(render(stage(), "-f", "1:3", "-o", "a.#.exr", "-q"), 1, "Error: frame 2: ")
    assert names(out) == ["a.1.exr"]


@pytest.mark.parametrize(
    ("frame", "written", "said"),
    [
        (1, [], "nothing was written"),
        (2, ["a.1.exr"], "1 frame was written"),
        (3, ["a.1.exr", "a.2.exr"], "2 frames were written"),
    ],
)
def test_ctrl_c_keeps_what_is_finished(render, stage, out, monkeypatch, frame, written, said):
    interrupting(monkeypatch, frame)
    assert render(stage(), "-f", "1:4", "-o", "a.#.exr", "-q") == (130, [f"Interrupted; {said}"])
    assert names(out) == written


# -- render settings -------------------------------------------------------------------------------------------------


def window(path):
    file = OpenImageIO.ImageInput.open(str(path))
    spec = file.spec()
    file.close()
    return (spec.full_width, spec.full_height), (spec.x, spec.y, spec.width, spec.height), spec["camera"]


BODY = """
    rel camera = </Side>
    uniform int2 resolution = (16, 8)
    uniform float4 dataWindowNDC = (0, 0, 0.5, 0.25)
"""
NAMED = 'renderSettingsPrimPath = "/Settings"'


def test_settings_say_camera_size_and_window(render, stage, out):
    path = stage(SIDE + SETTINGS % BODY, NAMED)
    assert render(path, "-o", "a.exr", size=())[0] == 0
    assert window("a.exr") == ((16, 8), (0, 6, 8, 2), "/Side")
    assert render(path, "-o", "a.exr", "--res-scale", 2, size=())[0] == 0
    assert window("a.exr") == ((32, 16), (0, 12, 16, 4), "/Side")


def test_a_window_beyond_the_picture_is_overscan(render, stage, out):
    wide = "uniform int2 resolution = (64, 36)\n    uniform float4 dataWindowNDC = (-0.5, -0.5, 1.5, 1.5)"
    path = stage(SIDE + SETTINGS % wide, NAMED)
    for number in (1, 2):
        assert render(path, "-o", f"t{number}.exr", "--tile", f"{number}/2", size=())[0] == 0
    assert render(path, "-o", "wide.exr", "-o", "wide.png", size=())[0] == 0
    assert window("wide.exr") == ((64, 36), (-32, -18, 128, 72), "/Camera")
    assert window("t1.exr")[1] == (-32, -18, 128, 34)
    assert read_image("wide.png").shape == (72, 128, 3)
    whole, joined = (read_layers(join) for join in ("wide.exr", joined_of("t1.exr", "t2.exr")))
    assert all(np.array_equal(joined[name], whole[name]) for name in whole)
    assert render(stage(SIDE + SETTINGS % wide.split("uniform float4")[0], NAMED), "-o", "a.exr", size=())[0] == 0
    assert all(np.array_equal(whole[name][18:54, 32:96], pixels) for name, pixels in read_layers("a.exr").items())
    flag = "--res", 64, 36, "--crop", -0.5, -0.5, 1.5, 1.5
    assert render(stage(SIDE, NAMED), "-o", "b.exr", *flag, size=())[0] == 0
    assert window("b.exr")[:2] == window("wide.exr")[:2]
    assert all(np.array_equal(whole[name], pixels) for name, pixels in read_layers("b.exr").items())


def joined_of(*paths):
    join_tiles([Path(each) for each in paths], "joined.exr")
    return "joined.exr"


@pytest.mark.parametrize(
    ("body", "ratio", "size"),
    [
        ("uniform float pixelAspectRatio = 2", 2.0, (32, 36)),
        ('uniform token aspectRatioConformPolicy = "adjustPixelAspectRatio"', 2.0, (32, 36)),
    ],
)
def test_the_shape_of_pixels_is_in_the_header_and_in_the_frustum(render, stage, out, body, ratio, size):
    """The camera's aperture is 32 x 18: with pixels of twice the width, its whole height has twice the rows."""
    path = stage(SETTINGS % f"{body}\n    uniform int2 resolution = {size}", NAMED)
    assert render(path, "-o", "a.exr", "-o", "a.png", size=())[0] == 0
    part = OpenEXR.File("a.exr").parts[0].header
    assert part["pixelAspectRatio"] == pytest.approx(ratio, rel=1e-6)
    assert png_ratio("a.png") == pytest.approx(ratio, rel=0.01)


def png_ratio(path):
    """Return the width of a PNG's pixels over their height, of which the file holds the inverses, per metre."""
    data = Path(path).read_bytes()
    place = data.index(b"pHYs") + 4
    across, down = struct.unpack(">II", data[place : place + 8])
    return down / across


@pytest.mark.parametrize("window", ["(0.5, 0, 0.5, 1)", "(0, 0, nan, 1)", "(0, 1, 1, 0)"])
def test_an_empty_window_is_one_sentence(render, stage, out, window):
    path = stage(SETTINGS % f"uniform float4 dataWindowNDC = {window}", NAMED)
    code, lines = render(path, "-o", "a.exr")
    assert (code, names(out)) == (1, [])
    assert len(lines) == 1 and "/Settings.dataWindowNDC is (" in lines[0] and len(lines[0]) <= 300


def test_flags_win_over_settings(render, stage, out):
    path = stage(SIDE + SETTINGS % BODY, NAMED)
    assert render(path, "-o", "a.exr", "-cam", "Camera", "--crop", 0, 0, 1, 1)[0] == 0
    assert window("a.exr") == ((32, 18), (0, 0, 32, 18), "/Camera")
    other = SIDE + SETTINGS % BODY + 'def RenderSettings "Other" {\n    uniform int2 resolution = (4, 4)\n}\n'
    assert render(stage(other, NAMED), "-o", "a.exr", "-rs", "/Other", "-cam", "Camera", size=())[0] == 0
    assert window("a.exr") == ((4, 4), (0, 0, 4, 4), "/Camera")


def products(*bodies):
    listed = ", ".join(f"</P{number}>" for number in range(len(bodies)))
    text = SETTINGS % f"    rel products = [{listed}]"
    for number, body in enumerate(bodies):
        text += f'def RenderProduct "P{number}" {{\n    {body}\n}}\n'
    for name, source in (("Key", "beams_key"), ("Depth", "Z"), ("Emission", "emission")):
        text += f'def RenderVar "{name}" {{\n    uniform string sourceName = "{source}"\n}}\n'
    return text


def test_products_are_the_outputs_where_flags_name_none(render, stage, out):
    first = 'token productName = "a.####.exr"\n    rel orderedVars = [</Key>, </Depth>, </Emission>]'
    second = 'token productName = "key.####.png"\n    rel orderedVars = </Key>'
    path = stage(products(first, second, 'token productName = "all.####.exr"'), NAMED)
    code, lines = render(path, "-f", "1:2", "--progress", "none")
    assert code == 0
    assert names(out) == [f"{name}.000{frame}.{kind}" for name, kind in (("a", "exr"), ("all", "exr"), ("key", "png"))
                          for frame in (1, 2)]  # fmt: skip
    assert list(read_layers("a.0001.exr")) == ["rgba", "beams_key", "depth"]
    assert "surface" in read_layers("all.0001.exr")
    warnings = [line for line in lines if line.startswith("Warning: ")]
    assert len(warnings) == 1
    assert "asks for 'emission', which is not a layer" in warnings[0]
    assert render(path, "-f", "1", "-o", "flag.exr")[0] == 0
    assert "surface" in read_layers("flag.exr")
    assert render(path, "-f", "1", "--layers", "surface")[0] == 0
    assert list(read_layers("a.0001.exr")) == ["rgba", "surface"]


def test_products_may_have_a_name_for_each_frame(render, stage, out):
    body = 'token productName.timeSamples = {\n        1: "one.exr",\n        2: "two.exr"\n    }'
    path = stage(products(body), NAMED)
    assert render(path, "-f", "1:2")[0] == 0
    assert names(out) == ["one.exr", "two.exr"]
    fails(render(path, "-f", "1:3"), 2, "two.exr is the output of the frames 2 and 3", "one run of #")


def test_a_picture_of_a_product_shows_its_first_layer_of_colours(render, stage, out):
    body = 'token productName = "a.png"\n    rel orderedVars = [%s]'
    assert render(stage(products(body % "</Depth>, </Key>"), NAMED))[0] == 0
    assert render(stage(), "--picture", "beams_key=b.png")[0] == 0
    assert np.array_equal(read_image("a.png"), read_image("b.png"))
    (out / "a.png").unlink()
    expected = ("the render product a.png shows 'depth', which has no colours", "expected another layer, or an .exr")
    for flags in ((), ("--dry-run",)):
        fails(render(stage(products(body % "</Depth>"), NAMED), *flags), 1, *expected)
    assert names(out) == ["b.png"]


@pytest.mark.parametrize(
    ("bodies", "code", "parts"),
    [
        (("",), 1, ("stage.usda: /P0.productName is ''", "ends in .exr or .png")),
        (('token productName = "a.jpg"',), 1, ("stage.usda: /P0.productName is 'a.jpg'",)),
        (('token productName = "a.exr"',) * 2, 2, ("a.exr is named twice",)),
        ((), 2, ("expected at least one output",)),
    ],
)
def test_products_that_are_no_outputs_are_refused(render, stage, out, bodies, code, parts):
    fails(render(stage(products(*bodies), NAMED)), code, *parts)
    assert names(out) == []


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("../a.exr", "which is outside the working folder"), ("{out}/../a.exr", "outside the working folder"),
        ("link/a.exr", "outside the working folder"), ("old.exr", "which exists and is not a picture"),
        ("pipe.exr", "which is not a regular file"),
    ],
)  # fmt: skip
def test_products_of_a_stage_stay_in_the_working_folder(render, stage, out, name, told):
    (out / "link").symlink_to(out.parent)
    (out / "old.exr").write_text("yesterday")
    os.mkfifo(out / "pipe.exr")
    path = stage(products(f'token productName = "{name.format(out=out)}"'), NAMED)
    code, lines = render(path, "-q")
    assert code == 1 and len(lines) == 1 and "stage.usda: /P0.productName is" in lines[0], lines
    outside = "outside" in told
    assert told in lines[0] and lines[0].endswith(
        "expected --allow-paths, --render-settings, or -o FILE" if outside else "expected another name, or -o FILE"
    )
    for flags in (("--allow-paths",), ("-rs", "/Settings")):
        assert render(path, "-q", *flags, *(() if name == "../a.exr" else ("--dry-run",)))[0] == (0 if outside else 1)
    assert (out.parent / "a.exr").exists() is (name == "../a.exr")
    assert (out / "old.exr").read_text() == "yesterday" and (out / "pipe.exr").is_fifo()
