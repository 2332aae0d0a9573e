"""Frames in other working spaces: the same light, by other numbers, and files and pictures that say so."""

import numpy as np
import OpenImageIO
import pytest

import photonbeams as pb
from photonbeams.images.color_spaces import converted
from photonbeams.images.files import read_layers
from tests.helpers.commands import fails
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage

RENDER = {"passes": 2, "width": 32, "seed": 3}
COLORS = {"grey": (1, 1, 1), "red": (1, 0, 0), "blue": (0.1, 0.2, 1)}


@pytest.mark.parametrize("working", ["ACEScg", "lin_rec2020"])
def test_light_of_each_colour_is_the_same_in_each_space(tmp_path, working):
    """A lamp of one colour over a grey card in grey fog: all light is the lamp's colour times numbers of the geometry.

    So each pixel is OpenColorIO's conversion of the Rec. 709 one, to the rounding of single precision in sums of 1e3
    terms.
    """
    for name, color in COLORS.items():
        lamp = LAMP.replace("}\n", f"    color3f inputs:color = {color}\n}}\n")
        stage = write_stage(tmp_path / f"{name}.usda", CAMERA, FLOOR, FOG, lamp)
        usual = pb.Shot.open(stage).render(**RENDER)
        other = pb.Shot.open(stage, working_space=working).render(**RENDER)
        for layer in ("rgba", "surface", "beams"):
            expected = converted(usual.layers[layer], usual.color_space, other.color_space)
            most = np.abs(expected).max()
            assert most > 0
            assert np.abs(other.layers[layer] - expected).max() < 2e-5 * most, (name, layer)
        assert np.allclose(other.layers["transmittance"], usual.layers["transmittance"], rtol=1e-5)
        assert np.array_equal(other.layers["depth"], usual.layers["depth"])


def test_files_say_their_space_and_pictures_look_the_same(tmp_path, render):
    stage = write_stage(
        tmp_path / "a.usda", CAMERA, FLOOR, FOG, LAMP.replace("}", "    color3f inputs:color = (1, 0.5, 0.2)\n}")
    )
    flags = ["--passes", 2, "--res", 32, 18, "--seed", 3, "-o", tmp_path / "a.exr", "-o", tmp_path / "a.png"]
    assert render(stage, *flags)[0] == 0
    usual = read_layers(tmp_path / "a.exr"), OpenImageIO.ImageBuf(str(tmp_path / "a.png")).get_pixels("uint8")
    assert render(stage, *flags, "--working-space", "ACEScg")[0] == 0
    found = read_layers(tmp_path / "a.exr"), OpenImageIO.ImageBuf(str(tmp_path / "a.png")).get_pixels("uint8")
    assert np.allclose(found[0]["beams"], converted(usual[0]["beams"], "lin_rec709_scene", "ACEScg"), rtol=4e-3)  # half
    assert np.abs(usual[1].astype(int) - found[1]).max() <= 1  # dithered
    file = OpenImageIO.ImageInput.open(str(tmp_path / "a.exr"))
    for index, name in enumerate(("rgba", "surface", "beams", "transmittance", "depth")):
        assert file.seek_subimage(index, 0)
        spec = file.spec()
        assert spec.get_string_attribute("oiio:subimagename") == name
        assert spec.getattribute("oiio:ColorSpace") == (None if name == "depth" else "lin_ap1_scene")
        primaries = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
        assert spec.getattribute("chromaticities") == pytest.approx(primaries, abs=1e-5)
    wrong = render(stage, *flags, "--working-space", "sRGB - Texture")
    fails(wrong, 1, "the working space is 'sRGB - Texture': expected a linear colour space")


def test_a_plate_is_added_in_the_working_space(tmp_path):
    """A plate of Rec. 709 behind the beams of an ACEScg shot: their sum is that of Rec. 709, converted."""
    stage = write_stage(tmp_path / "a.usda", CAMERA, FLOOR, FOG, LAMP)
    shot = pb.Shot.open(stage)
    shot.render(**RENDER).write(tmp_path / "plate.exr")
    plate = pb.Plate(tmp_path / "plate.exr")
    usual = shot.render(**RENDER, over=plate)
    other = pb.Shot.open(stage, working_space="ACEScg").render(**RENDER, over=plate)
    expected = converted(usual.layers["rgba"], usual.color_space, other.color_space)
    assert np.abs(other.layers["rgba"] - expected).max() < 2e-5 * np.abs(expected).max()
