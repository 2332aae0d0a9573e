"""`photonbeams export`."""

from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.export.shot import export
from photonbeams.runtime.device import mitsuba

pytestmark = pytest.mark.usefixtures("helping_thread")
mi = mitsuba()

STAGE = """#usda 1.0
(
    startTimeCode = 1
)
def Camera "Camera"
{
    float horizontalAperture = 20
    float verticalAperture = 10
    float focalLength = 20
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 4), 3: (0, 2, 4) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp"
{
    bool treatAsPoint = 1
}
def Cube "Block"
{
}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "stage.usda").write_text(STAGE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_stage_is_written_with_a_fog_and_a_size(folder, call):
    fog = ["--scattering", "0.1,0.2,0.3", "--anisotropy", "0.5"]
    code, _, said = call("export", "stage.usda", "-o", "out/twin.xml", "--res", "32", "0", *fog)
    assert code == 0 and said.splitlines()[-1] == "wrote out/twin.xml, and 1 file beside it"
    scene = mi.load_file("out/twin.xml")
    (sensor,) = scene.sensors()
    assert tuple(sensor.film().size()) == (32, 16)
    value = sensor.get_medium().get_scattering_coefficients(mi.MediumInteraction3f())[0]
    assert np.allclose(np.ravel(value), (0.1, 0.2, 0.3))
    assert sorted(Path("out").iterdir()) == [Path("out/twin"), Path("out/twin.xml")]


def test_fog_that_falls_with_height_in_a_box_is_written(folder, call):
    fog = ["--scattering", "0.5", "--fog-box", "0,0,0,4,4,4", "--fog-falloff", "2", "--fog-ground", "1"]
    assert call("export", "stage.usda", "-o", "mist.xml", *fog, "-q")[0] == 0
    (medium,) = (shape.interior_medium() for shape in mi.load_file("mist.xml").shapes() if shape.interior_medium())
    place = mi.MediumInteraction3f()
    for height in (0.5, 1.5, 3.9):
        place.p = mi.Point3f(1, height, 2)
        value = np.ravel(medium.get_scattering_coefficients(place)[0])
        assert np.allclose(value, 0.5 * np.exp(-max(height - 1, 0) / 2), rtol=2e-4)


def test_each_frame_is_a_file_with_the_camera_where_it_is_then(folder, call):
    code, _, said = call("export", "stage.usda", "-o", "twin.##.xml", "-f", "1:3x2", "-q")
    assert code == 0 and not said
    height = [
        float(np.ravel(mi.load_file(f"twin.0{frame}.xml").sensors()[0].world_transform().translation())[1])
        for frame in (1, 3)
    ]
    assert height == [0, 2]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["-o", "out.usda"], 2, "--output is out.usda: expected a name that ends in .xml"),
        (["-o", "out.xml", "-f", "1:2"], 2, "one file for 2 frames: expected one run of # in its name"),
        (["-o", "out.xml", "--crop", "0", "0", "2", "1"], 2, "--crop is 0 0 2 1: expected"),
        (["-o", "out.xml", "-cam", "Nobody"], 1, "Nobody"),
        (["-o", "stage.usda/out.xml"], 1, "stage.usda"),
    ],
)
def test_what_cannot_be_done_is_told_in_a_sentence(folder, call, arguments, code, message):
    found, _, said = call("export", "stage.usda", *arguments, "-q")
    assert found == code and said.startswith("Error: ") and message in said and len(said.splitlines()) == 1
    assert [each.name for each in folder.iterdir()] == ["stage.usda"]


def test_colours_of_a_twin_are_linear_rec_709_whatever_the_working_space(call, folder, caplog):
    red = STAGE.replace("bool treatAsPoint = 1", "color3f inputs:color = (1, 0, 0)\n    float inputs:intensity = 5")
    head = 'startTimeCode = 1\n    renderSettingsPrimPath = "/Render"'
    settings = 'def RenderSettings "Render" {\n    token renderingColorSpace = "ACEScg"\n}\n'
    (folder / "stage.usda").write_text(red.replace("startTimeCode = 1", head) + settings)
    assert call("export", "stage.usda", "-o", "twin.xml")[0] == 0
    text = (folder / "twin.xml").read_text().replace(",", "")
    assert 'value="5 0 0"' in text and "lin_ap1_scene" not in caplog.text
    export(pb.Shot.open(folder / "stage.usda"), folder / "other.xml")
    assert "colours are numbers of lin_ap1_scene, which Mitsuba takes for linear Rec. 709" in caplog.text
