"""`photonbeams render --stereo`: both eyes in a file, or one of them."""

import numpy as np
import OpenImageIO
import pytest

from photonbeams import cli

STAGE = """#usda 1.0
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
def Camera "Camera" {
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    float focusDistance = 4
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
    float inputs:radius = 0.1
    float inputs:intensity = 10
}
"""
SMALL = ("--passes", "1", "--beams", "64", "--res", "32", "18", "-q")


@pytest.fixture
def stage(tmp_path, monkeypatch):
    (tmp_path / "stage.usda").write_text(STAGE)
    monkeypatch.chdir(tmp_path)
    return "stage.usda"


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        cli.main(["render", *map(str, arguments), *SMALL])
    return stop.value.code


def parts(path):
    """Return the pixels of each part, by its view and its name."""
    file = OpenImageIO.ImageInput.open(str(path))
    found, index = {}, 0
    while file.seek_subimage(index, 0):
        spec = file.spec()
        view, name = spec.get_string_attribute("view"), spec.get_string_attribute("oiio:subimagename")
        found[view, name.removesuffix(f".{view}")] = np.asarray(file.read_image(index, 0, 0, spec.nchannels, "float"))
        index += 1
    return found


def test_both_eyes_are_in_one_exr_and_side_by_side_in_a_picture(stage, tmp_path):
    assert run(stage, "--stereo", "--interaxial", "0.5", "-o", "both.exr", "-o", "both.png") == 0
    found = parts(tmp_path / "both.exr")
    layers = ["rgba", "surface", "beams", "transmittance", "depth"]
    assert list(found) == [(view, layer) for view in ("left", "right") for layer in layers]
    assert not np.array_equal(found["left", "beams"], found["right", "beams"])
    assert OpenImageIO.ImageBuf("both.png").spec().width == 64


def test_one_eye_is_that_of_both(stage, tmp_path):
    assert run(stage, "--stereo", "-o", "both.exr", "--layers", "beams") == 0
    for eye in ("left", "right"):
        assert run(stage, "--stereo", "--view", eye, "-o", "one.exr", "--layers", "beams") == 0
        (alone,) = [pixels for (_, layer), pixels in parts(tmp_path / "one.exr").items() if layer == "beams"]
        assert np.array_equal(alone, parts(tmp_path / "both.exr")[eye, "beams"])


def test_eyes_at_one_place_are_equal(stage, tmp_path):
    assert run(stage, "--stereo", "--interaxial", "0", "--view", "both", "-o", "a.exr") == 0
    found = parts(tmp_path / "a.exr")
    assert np.array_equal(found["left", "rgba"], found["right", "rgba"])


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--view", "left"), "--view is for two eyes: expected --stereo, too"),
        (("--interaxial", "1"), "--interaxial is for two eyes: expected --stereo, too"),
        (("--stereo", "--interaxial", "-1"), "--interaxial is -1.0: expected a distance in scene units, 0 or more"),
        (("--stereo", "--convergence", "0"), "--convergence is 0.0: expected a positive distance in scene units"),
        (("--stereo", "--convergence", "nan"), "--convergence is nan: expected a positive distance in scene units"),
        (("--stereo", "--view", "up"), "--view is up: expected one of"),
    ],
)
def test_bad_flags_are_refused(stage, tmp_path, capfd, flags, sentence):
    assert run(stage, "-o", "a.exr", *flags) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1 and sentence in lines[0]
    assert not (tmp_path / "a.exr").exists()
