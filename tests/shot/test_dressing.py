"""A layer over an export has what shafts need, leaves what is there, and changes no file and no light."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

import photonbeams as pb
from photonbeams.scene import SceneError
from photonbeams.shot.dressing import dress
from tests.helpers.windows import stage_text

TIMES = "    startTimeCode = 7\n    endTimeCode = 9\n    timeCodesPerSecond = 30\n    framesPerSecond = 30"


@pytest.fixture
def export(tmp_path):
    folder = tmp_path / "from@elsewhere"
    folder.mkdir()
    (folder / "room.usda").write_text(stage_text(TIMES))
    return folder / "room.usda"


def dressed(export, path):
    return dress(pb.Shot.open(export), path)


def test_a_layer_has_fog_portals_a_look_a_group_and_the_exports_units_and_times(export, tmp_path):
    before = export.read_bytes()
    said = dressed(export, tmp_path / "shot.usda")
    assert export.read_bytes() == before
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (0.01, "Y")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (7, 9, 30)
    content, _ = pb.Shot.open(tmp_path / "shot.usda", strict=True).read()
    (sun,) = content.lights
    assert (sun.name, sun.group) == ("/Lights/Sun", "Sun")
    assert isinstance(sun.look, pb.Look)
    assert len(sun.portal.faces) == 6  # three windows
    assert np.allclose(sun.portal.area, 3e4, rtol=0.15)
    # The room is 6 m deep: a quarter of an optical depth, in centimetres.
    assert 0.25 / 700 < content.medium.scattering[0] < 0.25 / 300
    assert said[1] == "/Lights/Sun: a light group, a look, 3 portals"


def test_portals_of_a_stage_at_survey_coordinates_are_in_its_openings(export, tmp_path):
    place = np.array([408201e2, 0.0, 4080928e2])
    move = f"double3 xformOp:translate = {tuple(place.tolist())}"
    move += '\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    text = export.read_text()
    begin = text.index("def ")
    (export.parent / "far.usda").write_text(f'{text[:begin]}def Xform "W" {{\n{move}\n{text[begin:]}\n}}\n')
    dressed(export, tmp_path / "near.usda")
    dressed(export.parent / "far.usda", tmp_path / "far-shot.usda")
    near, far = (
        pb.Shot.open(tmp_path / name).read()[0].lights[0].portal.points for name in ("near.usda", "far-shot.usda")
    )
    assert np.abs(far - place - near).max() < 1  # the layer has six digits of centimetres, and openings are 100 wide


def test_each_value_of_a_layer_has_a_comment(export, tmp_path):
    dressed(export, tmp_path / "shot.usda")
    lines = (tmp_path / "shot.usda").read_text().splitlines()
    values = [number for number, line in enumerate(lines) if " photonbeams:" in line]
    assert len(values) >= 10
    assert all(lines[each - 1].strip().startswith("# ") for each in values)
    assert max(map(len, lines)) < 240


def test_portals_change_no_light(export, tmp_path):
    dressed(export, tmp_path / "shot.usda")
    options = {"beams": 512, "passes": 1, "width": 16, "height": 9, "max_depth": 2}

    def means(*overrides):
        shot = pb.Shot.open(tmp_path / "shot.usda", overrides=overrides)
        return np.array([shot.render(seed=seed, **options).layers["beams_Sun"].mean() for seed in range(6)])

    aimed, all_around = means(), means("/Lights/Sun.photonbeams:portal=")
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in (aimed, all_around)))
    assert abs(aimed.mean() - all_around.mean()) < 4 * error
    assert 0 < error < 0.15 * all_around.mean()


def test_what_an_export_has_stays(export, tmp_path):
    dressed(export, tmp_path / "first.usda")
    text = (tmp_path / "first.usda").read_text()
    said = dressed(tmp_path / "first.usda", tmp_path / "second.usda")
    assert "the export has fog, which stays" in said
    assert "/Lights/Sun: the export has its intensity, lightGroup, look, portal, which stay" in said
    second = Sdf.Layer.FindOrOpen(str(tmp_path / "second.usda"))
    assert not second.rootPrims
    assert (tmp_path / "first.usda").read_text() == text


def test_layers_that_cannot_be_written_are_refused(export, tmp_path):
    with pytest.raises(SceneError, match=r"room\.usda would replace .*room\.usda, which is read"):
        dressed(export, export)
    with pytest.raises(SceneError, match=r"a\.usdc: expected a name that ends in \.usda"):
        dressed(export, tmp_path / "a.usdc")
    empty = pb.Shot(Usd.Stage.CreateInMemory())
    with pytest.raises(SceneError, match=r"expected a stage that is a file"):
        dress(empty, tmp_path / "a.usda")
    assert not (tmp_path / "a.usda").exists()


def test_an_export_without_camera_or_light_is_dressed_and_session_layers_become_sublayers(export, tmp_path, caplog):
    shot = pb.Shot.open(export)
    for name in ("Lights", "Camera"):
        shot.stage.GetPrimAtPath(f"/{name}").SetActive(False)
    assert [each.partition(" of ")[0] for each in dress(shot, tmp_path / "a.usda")] == ["a fog with a scattering"]
    assert "there is no camera" in caplog.text
    assert "there is no light" in caplog.text

    lamp = 'def SphereLight "Key" {\n    double3 xformOp:translate = (0, 1, 1)\n'
    lamp += '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    (tmp_path / "lamp.usda").write_text(f"#usda 1.0\n{lamp}")
    dress(pb.Shot.open(export, session_layers=tmp_path / "lamp.usda"), tmp_path / "b.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "b.usda"))
    assert [*layer.subLayerPaths] == ["./lamp.usda", f"./{export.relative_to(tmp_path)}"]
    assert Usd.Stage.Open(layer).GetPrimAtPath("/Key").GetTypeName() == "SphereLight"


def test_instances_stay_and_names_are_unique(tmp_path):
    lamp = 'def SphereLight "{}" {{\n    double3 xformOp:translate = ({}, 1, -5)\n    {}\n'
    lamp += '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}}\n'
    (tmp_path / "part.usda").write_text(f'#usda 1.0\ndef Xform "Part" {{\n{lamp.format("Lamp", 0, "")}}}\n')
    place = 'def Xform "{}" (\n    instanceable = true\n    references = @part.usda@</Part>\n)\n{{\n}}\n'
    own = 'token photonbeams:lightGroup = "Lamp"'
    text = [place.format("A"), f'def Xform "B" {{\n{lamp.format("Lamp", 1, "")}}}\n', lamp.format("Known", 2, own)]
    camera = 'def Camera "Camera" {\n}\ndef Scope "Beams" {\n}\n'
    (tmp_path / "export.usda").write_text("#usda 1.0\n" + "".join(text) + camera)
    said = dressed(tmp_path / "export.usda", tmp_path / "shot.usda")
    assert "/A/Lamp is an instance, which no layer can change: its beams stay as they are" in said
    content, _ = pb.Shot.open(tmp_path / "shot.usda", strict=True).read()
    assert {each.name: each.group for each in content.lights} == {"/A/Lamp": "", "/B/Lamp": "Lamp_2", "/Known": "Lamp"}
    assert content.medium.name == "/Beams2/Fog"
