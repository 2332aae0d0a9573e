"""In notebooks, shots show a picture or an error message; IPython never sees an exception."""

from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from PIL import Image

import photonbeams as pb
from photonbeams import scene
from photonbeams.scene import SceneError
from photonbeams.shot import notebook
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, load, rgb

STAGE = """#usda 1.0
def Camera "Camera"
{
    float horizontalAperture = 20
    float verticalAperture = 10
    double3 xformOp:translate = (0, 0, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
{
    float inputs:radius = 0.05
    float inputs:intensity = 20
    int photonbeams:count = 100
}
def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.2, 0.2, 0.2)
}
"""


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(notebook, "LONGEST", 32)
    monkeypatch.setattr(notebook, "PASSES", 1)


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    return path


def shown(shot):
    """Return what IPython shows of a shot, by MIME type; IPython prints a traceback if it catches an exception."""
    return DisplayFormatter().format(shot)[0]


def pixels_of(found):
    with Image.open(BytesIO(b64decode(found["image/png"]))) as image:
        return np.asarray(image)


def built(height, **given):
    lamp = scene.SphereLight("/Lamp", (9, 9, 9), center=np.zeros(3), radius=0.1, beam_count=100)
    eye = scene.Camera.look_at([0, 0, 5], [0, 0, 0], aspect=1 / height)
    return pb.Shot(scene.Scene(lights=[lamp], media=[pb.Medium(0.1)]), eye, **given)


def test_a_stage_shows_a_quick_picture(stage):
    found = shown(pb.Shot.open(stage))
    assert found["text/plain"] == "Shot('shot.usda', camera=None)"
    assert pixels_of(found).shape == (16, 32, 3) and pixels_of(found).max() > 0


def test_a_scene_that_was_built_in_python_and_stands_upright(stage):
    assert pixels_of(shown(built(height=4))).shape == (32, 8, 3)


def test_a_mitsuba_scene_is_shown_no_larger_than_its_film():
    lamp = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb([3.0, 2.0, 1.0])}
    integrator = {"type": "photon_beams", "max_depth": 2, "method": "beams"}
    sensor = camera((0.2, 0.3, 4), width=24, height=16)
    found = pixels_of(shown(pb.Shot(load(integrator=integrator, fog=cube_of(fog(0.5)), lamp=lamp, sensor=sensor))))
    assert found.shape == (16, 24, 3) and found.max() > 0


def test_two_eyes_are_side_by_side(stage):
    assert pixels_of(shown(pb.Shot.open(stage, stereo=pb.Stereo(interaxial=0.1)))).shape == (16, 64, 3)


def broken(_context):
    raise RuntimeError("the beams are out")


@pytest.mark.parametrize(
    "shot, sentence",
    [(lambda path: pb.Shot.open(path, looks={"Lampe": pb.Look()}), "no beams are named Lampe: expected one of /Lamp"),
     (lambda path: pb.Shot.open(path.with_name("shot.####.xml")), "no such file"),
     (lambda path: built(height=1, emit=broken), "the beams are out")],
    ids=["look", "file", "function"],
)  # fmt: skip
def test_an_error_is_shown_as_its_sentence(stage, capsys, shot, sentence):
    found = shown(shot(stage))
    assert found.keys() == {"text/plain"} and sentence in found["text/plain"]
    assert "Traceback" not in "".join(capsys.readouterr())


def test_without_the_denoiser_the_picture_has_grain_but_is_there(stage, monkeypatch):
    def missing():
        raise SceneError("no denoiser")

    monkeypatch.setattr("photonbeams.render.films.denoising.check_denoiser", missing)
    assert pixels_of(shown(pb.Shot.open(stage))).max() > 0


@pytest.mark.parametrize("asked", [{"include": {"text/plain"}}, {"exclude": {"image/png"}}])
def test_nothing_is_rendered_where_no_picture_is_asked_for(stage, monkeypatch, asked):
    monkeypatch.setattr(notebook, "quick_frame", None)
    assert pb.Shot.open(stage)._repr_mimebundle_(**asked) == {"text/plain": "Shot('shot.usda', camera=None)"}
