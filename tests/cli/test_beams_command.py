"""`photonbeams beams`, and functions named on the command line."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import photonbeams as pb
from photonbeams.cli import main

KEYHOLE = Path(__file__).parents[2] / "examples/keyhole/keyhole.usda"
ATTIC = Path(__file__).parents[2] / "examples/blender/attic.usda"
KEY = "/World/Light/Key"

STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.2, 0.2, 0.2)
}
def Camera "Camera"
{
    float horizontalAperture = 20
    float verticalAperture = 10
    float focalLength = 20
    double3 xformOp:translate = (0, 0, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
{
    token photonbeams:lightGroup = "warm"
    rel photonbeams:look = </Look>
    rel photonbeams:guides = </Guide>
    float inputs:radius = 0.05
    double3 xformOp:translate.timeSamples = { 1: (-1, 0, 0), 3: (-1, 0.5, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def PhotonBeamsLook "Look"
{
    float[] photonbeams:along:ramp:knots = [0, 1]
    color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 0.2, 0)]
}
def BasisCurves "Guide"
{
    uniform token type = "cubic"
    uniform token basis = "bezier"
    int[] curveVertexCounts = [4]
    point3f[] points = [(-1, 0, 0), (0, 0, 0), (1, 0.2, 0), (1, 1, 0)]
}
def BasisCurves "Drawn" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"])
{
    uniform token type = "cubic"
    uniform token basis = "bspline"
    uniform token wrap = "pinned"
    int[] curveVertexCounts = [4]
    point3f[] points = [(-1, -0.5, 0), (0, 0.5, 0.3), (0.5, -0.5, 0), (1, 0.5, 0)]
    float[] widths = [0.1, 0.2, 0.2, 0.1]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")
}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "stage.usda").write_text(STAGE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(each) for each in arguments])
    return ended.value.code


# -- The round trip ----------------------------------------------------------------------------------------------------


def picture(*layers, overrides=(), stage="stage.usda"):
    shot = pb.Shot.open(stage, camera="Camera", session_layers=layers, overrides=overrides)
    return shot.render(passes=1, width=64, beams=128).layers


def test_exported_beams_look_as_the_beams_of_the_stage(folder):
    assert call("beams", "stage.usda", "-o", "out.usdc", "--beams", "128", "-q") == 0
    expected = picture()
    found = picture("out.usdc", overrides=["/Lamp.photonbeams:enabled=0", "/Drawn.visibility=invisible"])
    for name in ("beams", "beams_warm", "beams_default"):
        # Points, radii and power are read back unchanged, directions up to the rounding of single precision.
        assert np.linalg.norm(found[name] - expected[name]) <= 2e-5 * np.linalg.norm(expected[name])
        assert expected[name].any()


def test_exported_beams_of_a_stage_that_was_not_made_for_it_look_the_same(folder):
    count = f"{KEY}.photonbeams:count=256"
    assert call("beams", KEYHOLE, "-o", "key.usda", "-cam", "Camera", "--set", count, "-q") == 0
    given = {"stage": KEYHOLE, "overrides": [count]}
    expected = picture(**given)["beams"]
    given["overrides"] = [f"{KEY}.photonbeams:enabled=0"]
    found = picture("key.usda", **given)["beams"]
    assert expected.any() and np.linalg.norm(found - expected) <= 1e-5 * np.linalg.norm(expected)


def test_the_file_is_what_other_programs_show(folder, capsys):
    assert call("beams", "stage.usda", "-o", "out.usda", "--beams", "32") == 0
    assert "beams to out.usda" in capsys.readouterr().err
    stage = Usd.Stage.Open("out.usda")
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert stage.GetDefaultPrim().GetPath() == "/Beams"
    assert [prim.GetName() for prim in stage.GetPrimAtPath("/Beams").GetChildren()] == ["Looks", "Lamp", "Drawn"]
    lamp, drawn = (UsdGeom.BasisCurves.Get(stage, f"/Beams/{name}") for name in ("Lamp", "Drawn"))
    counts = np.array(lamp.GetCurveVertexCountsAttr().Get())
    assert len(lamp.GetPointsAttr().Get()) == counts.sum() == len(lamp.GetWidthsAttr().Get())
    assert counts.min() == 2 and counts.max() > 20  # a beam that follows the guide stays one curve
    assert lamp.GetDisplayColorPrimvar().GetInterpolation() == "uniform"
    assert drawn.GetDisplayColorPrimvar().GetInterpolation() == "vertex"
    assert list(drawn.GetCurveVertexCountsAttr().Get()) == [len(drawn.GetPointsAttr().Get())]
    assert lamp.GetPrim().GetRelationship("photonbeams:look").GetTargets() == ["/Beams/Looks/Look"]
    assert lamp.GetPrim().GetAttribute("photonbeams:lightGroup").Get() == "warm"


def test_each_frame_has_a_file_and_a_stage_without_fog_needs_none(folder):
    stage = STAGE.replace(' (prepend apiSchemas = ["PhotonBeamsMediumAPI"])', "")
    stage = stage.replace("    color3f photonbeams:scattering = (0.2, 0.2, 0.2)\n", "")
    (folder / "clear.usda").write_text(stage)
    assert call("beams", "clear.usda", "-o", "new/out.##.usdc", "-f", "1:3x2", "--beams", "16", "-q") == 0
    starts = []
    for name in ("out.01.usdc", "out.03.usdc"):
        stage = Usd.Stage.Open(f"new/{name}")
        curves = UsdGeom.BasisCurves.Get(stage, "/Beams/Lamp")
        starts.append(np.array(curves.GetPointsAttr().Get())[0])
    assert sorted(each.name for each in (folder / "new").iterdir()) == ["out.01.usdc", "out.03.usdc"]
    assert np.abs(starts[1] - starts[0]).max() > 0.1


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["-o", "out.obj"], 2, "--output is out.obj: expected a name that ends in .usd or .usda or .usdc"),
        (["-o", "out.usda", "-f", "1:2"], 2, "one file for 2 frames: expected one run of # in its name"),
        (["-o", "out.usda", "--beams", "0"], 2, "--beams is 0: expected 1 to 100000000"),
        (["-o", "out.usda", "-cam", "Nobody"], 1, "Nobody"),
        (["-o", "out.usda", "--set", "/Lamp.photonbeams:enabled=0", "--set", "/Drawn.visibility=invisible"], 1,
         "no light that makes beams"),
        (["-o", "stage.usda/out.usda"], 1, "stage.usda"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_told_in_a_sentence(folder, capsys, arguments, code, message):
    assert call("beams", "stage.usda", *arguments, "-q") == code
    said = capsys.readouterr().err.strip()
    assert said.startswith("Error: ") and message in said and len(said.splitlines()) == 1
    assert [each.name for each in folder.iterdir()] == ["stage.usda"]


# -- Functions ---------------------------------------------------------------------------------------------------------

FUNCTIONS = """
import photonbeams as pb

red = pb.recolor((1, 0, 0))


def nothing(beams, context):
    return None


def broken(beams, context):
    return beams.no_such_thing


def nan(beams, context):
    beams.power = beams.power * float("nan")
    return beams


def spark(context):
    return pb.Beams([[0, 0, 0]], [[1, 0, 0]], 0.1, 0.2, [[0, 0, 1]])


constant = 3
"""


@pytest.fixture
def functions(folder):
    (folder / "functions.py").write_text(FUNCTIONS)
    (folder / "wrong.py").write_text("def f(beams context):\n    pass\n")
    (folder / "raises.py").write_text("x = 1\nraise ValueError('no\\nluck')\n")
    return folder


def test_functions_change_and_make_beams_of_a_file_and_of_a_render(functions):
    given = ["--simulate", "functions.py:red", "--emit", "functions.py:spark"]
    assert call("beams", "stage.usda", "-o", "out.usda", "--beams", "32", "-q", *given) == 0
    stage = Usd.Stage.Open("out.usda")
    power = np.array(stage.GetPrimAtPath("/Beams/Lamp").GetAttribute("photonbeams:power").Get())
    assert power[:, 0].all() and not power[:, 1:].any()
    assert np.allclose(stage.GetPrimAtPath("/Beams/spark").GetAttribute("photonbeams:power").Get(), [[1 / 3, 0, 0]])
    render = ["render", "stage.usda", "-o", "out.exr", "--res", "32", "0", "--passes", "1", "--beams", "32", "-q"]
    assert call(*render, *given) == 0
    shot = pb.Shot.open("stage.usda", simulate=pb.recolor((1, 0, 0)))
    beams = shot.render(passes=1, width=32, beams=32).layers["beams"]
    assert beams[..., 0].any() and not beams[..., 1:].any()


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("functions.py", 2, "--simulate is functions.py: expected FILE.py:NAME, such as beams.py:bend"),
        ("functions.txt:red", 2, "expected FILE.py:NAME"),
        ("gone.py:red", 2, "--simulate is gone.py:red: expected a file that exists"),
        ("functions.py:green", 2, "expected a function 'green' in functions.py"),
        ("functions.py:constant", 2, "expected a function 'constant' in functions.py"),
        ("functions.py:broken", 1, "functions.py, line 12: AttributeError: 'Beams' object has no attribute"),
        ("functions.py:nothing", 1, "nothing returned, of /Lamp, nothing: expected Beams"),
        ("functions.py:nan", 1, "nan returned, of /Lamp, beams whose power is not finite"),
        ("wrong.py:f", 1, "wrong.py, line 1: "),
        ("raises.py:f", 1, "raises.py, line 2: ValueError: no luck"),
    ],
)
def test_what_is_wrong_with_a_function_is_told_in_a_sentence(functions, capsys, text, code, message):
    assert call("beams", "stage.usda", "-o", "out.usda", "--beams", "16", "-q", "--simulate", text) == code
    said = capsys.readouterr().err.strip()
    assert said.startswith("Error: ") and message in said and len(said.splitlines()) == 1
    assert not (functions / "out.usda").exists()


def test_beams_do_not_replace_the_stage_that_they_are_of(functions, capsys):
    before = (functions / "stage.usda").read_bytes()
    assert call("beams", "stage.usda", "-o", "stage.usda", "--beams", "16", "-q") == 1
    assert "which is read: expected another file to write to" in capsys.readouterr().err
    assert (functions / "stage.usda").read_bytes() == before


def test_a_stage_from_blender_is_written_without_a_word_of_photonbeams_in_it(folder):
    assert call("beams", ATTIC, "-o", "attic.usdc", "--beams", "64", "-q") == 0
    stage = Usd.Stage.Open("attic.usdc")
    prims = list(stage.GetPrimAtPath("/Beams").GetChildren())
    assert len(prims) == 1 and prims[0].IsA(UsdGeom.BasisCurves)
