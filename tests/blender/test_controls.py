"""What an artist sets for beams in Blender is what the attributes of a stage say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

import photonbeams as pb
from photonbeams.looks.ramp import interpolate
from photonbeams.usd.authoring.presets import PRESETS
from photonbeams.usd.common.definitions import LOOK, PREFIX, definitions
from photonbeams.usd.lights.ies import parse
from tests.blender.bpy_python import HEIGHT, PYTHON, WIDTH, passes_of, together

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("controls_in_blender.py")
KINDS = Sdf.ValueTypeNames


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    names = "controls", "values", "presets", "panels", "added", "exported", "saved"
    return together(names, tmp_path_factory.mktemp("cases"), SCRIPT)


@pytest.fixture(scope="module")
def scene(cases):
    return cases["controls"].folder


def by_hand(folder):
    """Return Blender's own export, with what the case sets written as the pages say."""
    stage = Usd.Stage.Open(str(folder / "plain.usda"))

    def set_all(prim, values):
        for name, (kind, value) in values.items():
            prim.CreateAttribute(f"{PREFIX}{name}", kind).Set(value)

    look = stage.DefinePrim("/Look", LOOK)
    set_all(look, {
        "along:ramp:knots": (KINDS.FloatArray, [0, 0.35, 0.7, 1]),
        "along:ramp:colors": (KINDS.Color3fArray, [(1, 0.95, 0.8), (1, 0.6, 0.2), (0.8, 0.15, 0.1), (0.2, 0.05, 0.3)]),
        "across:profile": (KINDS.Token, "tabulated"), "across:values": (KINDS.FloatArray, [1, 0]),
    })  # fmt: skip
    key = stage.GetPrimAtPath("/root/Key/Key")
    slide = folder / "textures" / "0_Slide.exr"
    set_all(key, {"intensity": (KINDS.Float, 2.0), "lightGroup": (KINDS.Token, "key"),
                  "gobo": (KINDS.Asset, str(slide))})  # fmt: skip
    key.CreateRelationship(f"{PREFIX}look").SetTargets([look.GetPath()])
    set_all(stage.GetPrimAtPath("/root/Fill/Fill"), {"enabled": (KINDS.Bool, False)})
    sun = stage.GetPrimAtPath("/root/Sun/Sun")
    sun.CreateRelationship(f"{PREFIX}portal").SetTargets(["/root/Plane_001/Plane_001"])
    for name in ("Line", "env_light"):  # the volume of a world hides its sky
        stage.GetPrimAtPath(f"/root/{name}").SetActive(False)
    for name, kind, points in (
        ("Bent", "cubic", [(-1, 0, 2), (-0.7, 0, 1.8), (0.7, 0, 2.2), (1, 0, 2)]),
        ("Straight", "linear", [(-1, 1, 0.2), (1, 1, 1.8)]),
    ):
        curves = UsdGeom.BasisCurves.Define(stage, f"/{name}")
        curves.CreateTypeAttr(kind)
        curves.CreateCurveVertexCountsAttr([len(points)])
        curves.CreatePointsAttr(points)
        curves.CreateWidthsAttr([0.1])
        curves.SetWidthsInterpolation("constant")
        curves.GetPrim().AddAppliedSchema("PhotonBeamsCurvesAPI")
        set_all(curves.GetPrim(), {"power": (KINDS.Color3fArray, [(0.4, 1.0, 2.0)])})
    return stage


@pytest.mark.parametrize("stage", ["by hand", "hooked"])
def test_the_picture_is_that_of_the_stage(scene, stage):
    """What crosses over, what the export writes, and what is written by hand are the same scene."""
    if stage == "hooked":
        shot = pb.Shot.open(scene / "hooked.usdc")
    else:
        shot = pb.Shot(by_hand(scene), medium=pb.Medium(scattering=0.08))
    given = {"width": WIDTH, "height": HEIGHT, "beams": 1024, "max_depth": 2}
    seeds = [shot.render(seed=seed, passes=4, **given).layers for seed in range(1, 4)]
    found = passes_of(scene / "frame.exr")
    for name, layer in (
        ("Surface", "surface"),
        ("Beams", "beams"),
        ("Beams key", "beams_key"),
        ("Surface key", "surface_key"),
    ):
        theirs = np.array([each[layer] for each in seeds])
        mean, noise = theirs.mean(axis=0), theirs.std(axis=0, ddof=1)
        # The means of a picture have a noise of about 1 % here; each colour by itself, as the gobo and the look have.
        np.testing.assert_allclose(found[name].mean(axis=(0, 1)), mean.mean(axis=(0, 1)), rtol=0.04, err_msg=name)
        blocks = np.abs(found[name] - mean)[:24].reshape(3, 8, 6, 8, 3).mean(axis=(1, 3, 4))
        usual = (noise + 0.02 * mean)[:24].reshape(3, 8, 6, 8, 3).mean(axis=(1, 3, 4))
        assert np.all(blocks < 4 * usual + 1e-5), name


@pytest.fixture(scope="module")
def values(cases):
    (found,) = cases["values"].told
    return found


def test_lamps_have_their_own_values(values):
    prims = values["prims"]
    fill, sun, sky = prims["/Lights/Fill"], prims["/Lights/Sun"], prims["/World"]
    assert fill[f"{PREFIX}enabled"] is False and fill[f"{PREFIX}gobo"].endswith("0_Slide.exr")  # by its Emission node
    assert fill[f"{PREFIX}gobo:angle"] == pytest.approx(60) and fill[f"{PREFIX}gobo:wrap"] == "repeat"
    assert sun["targets"] == {f"{PREFIX}portal": ["/Portals/Plane_001"]} and f"{PREFIX}gobo:width" not in sun
    assert sky["targets"] == {f"{PREFIX}portal": ["/Portals/Window"]}
    assert sky[f"{PREFIX}enabled"] and sky[f"{PREFIX}count"] == 512
    # A portal is neither a surface nor a lamp, and is there if it is hidden.
    assert not {"/Objects/Plane_001", "/Lights/Window"} & prims.keys()
    window = np.array(prims["/Portals/Window"]["points"])
    assert window.min(axis=0).tolist() == [-1, -0.5, 0] and window.max(axis=0).tolist() == [1, 0.5, 0]


def test_fog_of_the_world_varies_as_its_panel_says(values, scene):
    fog, stage = values["prims"]["/Fog"], Usd.Stage.Open(str(scene / "hooked.usdc"))
    found = {name.removeprefix(PREFIX): value for name, value in fog.items() if name not in ("type", "targets")}
    assert {name: found[name] for name in ("height:falloff", "height:ground", "noise:amount")} == {
        "height:falloff": 1.5, "height:ground": 0.25, "noise:amount": 0.5,
    }  # fmt: skip
    assert (found["noise:scale"], found["noise:contrast"], found["noise:drift"]) == (1, 2, [0.5, 0, 0])
    assert {f"{PREFIX}{name}" for name in found} <= {*definitions("PhotonBeamsMediumAPI")}
    assert not [
        each
        for each in stage.GetPrimAtPath("/root/Fog").GetAuthoredPropertyNames()
        if "height" in each or "noise" in each
    ]


def test_curves_are_beams_and_no_tubes(values):
    prims = values["prims"]
    assert [name for name in prims if "Line" in name] == ["/Beams/Line", "/Beams/Line_part1"]
    ring = prims["/Beams/Ring"]  # a NURBS with weights, as the lines that Blender makes of it: a circle
    assert (ring["type"], ring["wrap"]) == ("linear", "periodic") and len(ring["points"]) > 24
    np.testing.assert_allclose(np.linalg.norm(ring["points"], axis=1), 1.0, rtol=1e-3)
    assert ring["targets"] == {f"{PREFIX}look": ["/Looks/Ember"]} and ring[f"{PREFIX}lightGroup"] == "key"
    assert ring["widths"] == pytest.approx([0.1] * len(ring["points"])) and ring[f"{PREFIX}power"] == [[10, 10, 10]]
    path = prims["/Beams/Path"]  # a uniform B-spline
    assert (path["type"], path["basis"], path["wrap"]) == ("cubic", "bspline", "nonperiodic")
    assert path["points"] == [[k, k % 2, 0] for k in range(5)]
    assert path["widths"] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert prims["/Beams/Third"]["type"] == "linear"


def test_text_is_one_mesh(values):
    assert [name for name in values["prims"] if "Title" in name] == ["/Objects/Title"]


def test_what_cannot_be_used_is_a_sentence(values):
    said = [*values["said"], *values["later"]]
    assert all(len(each) <= 300 for each in said)
    for text in (
        "Third: its modifiers, weights and knots",
        "Third has no splines",
        "the node across curve",
        "Empty is a portal with",
    ):
        assert any(text in each for each in said), text
    look = values["changed"]["/Looks/Ember"]
    assert "photonbeams:across:profile" not in look and len(look["photonbeams:along:ramp:knots"]) == 97


def test_the_export_writes_what_blender_leaves_out(cases):
    (told,), folder = cases["exported"]
    stage = Usd.Stage.Open(str(folder / "exported.usda"))

    def value(path, name):
        return stage.GetPrimAtPath(path).GetAttribute(name).Get()

    assert value("/root/Fill/Fill", "inputs:intensity") == pytest.approx(3 * 20 / np.pi)
    warm = np.multiply((0.5, 1, 1), told["temperature"])
    assert value("/root/Key/Key", "inputs:color") == pytest.approx(warm, rel=1e-6)
    assert value("/root/Key/Key", "inputs:enableColorTemperature") is False
    assert tuple(value("/root/Fill/Fill", "inputs:color")) == (0.5, 0.5, 1.0)
    assert value("/root/Key/Key", f"{PREFIX}lightGroup") == "Key_Light"
    assert np.allclose(value("/root/Fog", f"{PREFIX}scattering"), 0.08)
    box = next(each for each in stage.GetPrimAtPath("/root/Box").GetChildren() if each.GetTypeName() == "Mesh")
    assert "PhotonBeamsMediumAPI" in box.GetAppliedSchemas()
    assert np.allclose(box.GetAttribute(f"{PREFIX}scattering").Get(), (0.1, 0.2, 0.3))
    links = stage.GetPrimAtPath("/root/Key/Key").GetRelationship("collection:lightLink:includes").GetTargets()
    assert value("/root/Key/Key", "collection:lightLink:includeRoot") is False
    assert set(links) == {box.GetPath(), Sdf.Path("/root/Copy/Cube_0/Cube")}
    assert value("/root/Panel/Panel", "inputs:shadow:enable") is False
    profile = parse(Path(value("/root/Panel/Panel", "inputs:shaping:ies:file").resolvedPath).read_text())
    scale = value("/root/Panel/Panel", "inputs:shaping:ies:angleScale")
    assert scale == pytest.approx(0.25)  # Cycles': tan a − tan x over tan a − a, with a = 45 degrees
    factor = replace(profile, angle_scale=scale).at([0, 20, 44, 46, 120], 0)
    there = np.array([1, 1 - np.tan(np.radians(20)), 1 - np.tan(np.radians(44)), 0, 0]) / (1 - np.pi / 4)
    np.testing.assert_allclose(factor, there, rtol=1e-5, atol=1e-9)
    sky = stage.GetPrimAtPath("/root/env_light")
    (window,) = sky.GetRelationship(f"{PREFIX}portal").GetTargets()
    assert sky.GetAttribute(f"{PREFIX}enabled").Get() and stage.GetPrimAtPath(window).GetTypeName() == "Mesh"
    assert not stage.GetPrimAtPath("/root/Window/Window").IsActive()
    (twin,) = (each for each in Usd.PrimRange(stage.GetPrimAtPath("/root/Window")) if each.GetTypeName() == "Mesh")
    rays = ("visibleInPrimaryRay", "primvars:arnold:visibility:shadow", "primvars:arnold:matte")
    assert [twin.GetAttribute(name).Get() for name in rays] == [False, False, True]
    others = Usd.Stage.Open(str(folder / "of_cycles.usda"))
    assert not any(name.startswith(PREFIX) for each in others.Traverse() for name in each.GetPropertyNames())


def test_ready_made_things_are_lit(cases):
    found, folder = cases["added"]
    turn = np.radians(np.linspace(-60, 240, 33))
    keyhole = np.array([*zip(0.13 * np.cos(turn), 0.13 * np.sin(turn), strict=True), (-0.15, -0.47), (0.15, -0.47)])
    x, y = keyhole.T
    hole = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    slat = 2 * (1.0 * 0.18 + 1.0 * 0.004 + 0.18 * 0.004)
    for name, thing, fog in zip(("keyhole", "blinds", "strands"), found[::2], found[1::2], strict=True):
        area = {"keyhole": 9 - hole, "blinds": 9 - 1.2 + 6 * slat, "strands": 0}[name]
        # Walls are 2.5 m behind the cursor, on which their spot shines.
        away = {"keyhole": np.multiply(2.5, [0.6, 1, 0.7 / 1.5]), "blinds": np.multiply(2.5, [1.6 / 3, 1, 1.4 / 3])}
        assert thing["place"] == pytest.approx(np.add([1, 2, 3], away.get(name, 0)), abs=1e-5)
        assert thing["area"] == pytest.approx(area, rel=1e-5)
        assert "/Fog" in thing["prims"] and thing["said"] == [] and fog["volumes"] == 1  # added twice, with one fog
        beams = passes_of(folder / f"{name}.exr")["Beams"].mean(axis=(0, 1))
        color = (1, 0.7, 0.35) if name == "strands" else (1, 1, 1)
        assert beams[0] > 0
        np.testing.assert_allclose(beams / beams[0], color, rtol=1e-3)


def test_presets_are_those_of_the_studio(cases):
    """Ramps and tables are the same functions, within a 500th; other attributes have the same values or defaults."""
    found = {each["name"]: each["values"] for each in cases["presets"].told}
    assert len(found) == len(PRESETS)
    x = np.linspace(0, 1, 241)
    for preset in PRESETS:
        ours, theirs = preset.attributes(), found[preset.name]
        for name, own in definitions(LOOK).items():
            a, b = (each.get(name, own.default) for each in (ours, theirs))
            if name.endswith("ramp:knots") and a:
                ramp = name.rpartition(":")[0]
                a, b = (_ramp(each, ramp, x) for each in (ours, theirs))
            elif name.endswith("across:values") and a:
                a, b = (np.interp(x, np.linspace(0, 1, len(each)), each) for each in (a, b))
            elif ":ramp:" in name:
                continue
            elif name.endswith("coefficients"):
                a, b = (np.trim_zeros(each, "b") for each in (a, b))
            if isinstance(a, str | bool | None):
                assert a == b, (preset.name, name)
            else:
                np.testing.assert_allclose(b, a, atol=2e-3, rtol=1e-6, err_msg=f"{preset.name} {name}")


def _ramp(values, ramp, x):
    knots, colors = (np.array(values[f"{ramp}:{part}"], float) for part in ("knots", "colors"))
    return interpolate(knots, colors, values.get(f"{ramp}:interpolation", "linear"), x)


def test_what_is_set_is_saved_in_the_file(cases):
    (found,) = cases["saved"].told
    before, after = found["before"], found["after"]
    assert before == after and found["said"] == ["World World: its volume hides the sky, as in Cycles"]
    assert found["in_acescg"][0].startswith("the file's working space is ACEScg: images, skies and temperatures have")
    looks = {name: before[path]["targets"][f"{PREFIX}look"] for name, path in (
        ("Key", "/Lights/Key"), ("Fill", "/Lights/Fill"), ("Sun", "/Lights/Sun"), ("Line", "/Beams/Line"),
    )}  # fmt: skip
    assert looks == {"Key": ["/Looks/Ember"], "Fill": ["/Looks/Laser"], "Sun": ["/Looks/Look"],
                     "Line": ["/Looks/Deep_water"]}  # fmt: skip
    ember = before["/Looks/Ember"]  # the preset of a factor leaves the others
    assert ember[f"{PREFIX}across:profile"] == "tabulated" and f"{PREFIX}along:ramp:knots" in ember
    assert f"{PREFIX}eye:falloff" not in ember and before["/Looks/Laser"][f"{PREFIX}eye:falloff"] == "none"


def test_panels_show_what_there_is_and_explain_it(cases):
    (found,) = cases["panels"].told
    shown = found["shown"]
    assert found["elsewhere"] == []
    for panel, rows in shown.items():
        assert rows, panel
        for name, label, tip in rows:
            # Blender itself does not explain its Shadow switch.
            assert label and (tip or name.endswith(".use_shadow")) and len(tip) <= 400, (panel, name)
    names = {name for rows in shown.values() for name, *_ in rows}
    properties = {name.removeprefix(PREFIX).replace(":", "_") for name in definitions(LOOK)
                  if ":ramp:" not in name and not name.endswith("across:values")}  # fmt: skip
    assert {f"PhotonBeamsLook.{each}" for each in properties} <= names
    assert {f"PhotonBeamsLightSettings.{each}" for each in (
        "enabled", "intensity", "count", "seed", "scattered", "portal", "look", "gobo", "gobo_angle", "gobo_width",
        "gobo_wrap",
    )} <= names  # fmt: skip
    assert {"ShaderNodeValToRGB", "ShaderNodeFloatCurve", "photonbeams.look_new", "photonbeams.look_preset"} <= names
