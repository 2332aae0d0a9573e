"""Colour spaces by all their names, and what is converted between them, against OpenColorIO's numbers."""

import numpy as np
import pytest

from photonbeams.images.color_spaces import (
    BUILT_IN,
    REC709,
    config_name,
    converted,
    named,
    primaries,
    space_of,
    working_space,
)  # fmt: skip
from photonbeams.images.display import OWN, view_transforms, viewed
from photonbeams.images.writing import png_of
from photonbeams.scene import SceneError

# Rec. 709's red, green and blue in AP1, of OpenColorIO's configurations for ACES.
TO_AP1 = np.array([[0.613097, 0.070194, 0.020616], [0.339523, 0.916354, 0.109570], [0.047379, 0.013452, 0.869815]])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("ACEScg", "lin_ap1_scene"),
        ("ACES - ACEScg", "lin_ap1_scene"),
        ("lin_ap1", "lin_ap1_scene"),
        ("Linear Rec.709 (sRGB)", REC709),
        ("Utility - Linear - Rec.709", REC709),
        ("linear_rec709", REC709),
        ("sRGB - Texture", "srgb_rec709_scene"),
        ("Linear Rec.2020", "lin_rec2020_scene"),
        ("ACES2065-1", "lin_ap0_scene"),
        ("nonsense", None),
        ("raw", None),
    ],
)
def test_a_space_is_known_by_each_of_its_names(name, expected):
    assert named(name) == expected


def test_primaries_are_those_of_a_space_and_find_it():
    assert primaries(REC709) == (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    assert primaries("lin_ap1_scene") == (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    assert primaries("srgb_rec709_scene") is None
    assert space_of((0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.3217, 0.3377)) == "lin_ap1_scene"
    assert space_of((0.5, 0.3, 0.3, 0.5, 0.2, 0.1, 0.31, 0.33)) is None


def test_colours_are_converted_and_alpha_stays():
    colors = np.random.default_rng(3).uniform(0, 9, (4, 5, 4)).astype(np.float32)
    found = converted(colors, REC709, "ACEScg")
    # Six digits of the matrix: 5e-7 times three colours of up to 9.
    assert np.allclose(found[..., :3], colors[..., :3] @ TO_AP1, atol=1.4e-5)
    assert np.array_equal(found[..., 3], colors[..., 3])
    assert np.allclose(converted(found, "ACEScg", REC709), colors, rtol=1e-5, atol=1e-5)
    grey = np.full((1, 3), 0.18)
    assert np.allclose(converted(grey, REC709, "lin_rec2020_scene"), grey, rtol=1e-6)
    assert converted(colors, REC709) is colors


@pytest.mark.parametrize("name", ["sRGB - Texture", "raw", "nonsense"])
def test_light_is_computed_in_linear_spaces_alone(name):
    with pytest.raises(SceneError, match=rf"is '{name}': expected a linear colour space, such as lin_rec709_scene or"):
        working_space(name)


@pytest.mark.parametrize("view", view_transforms())
def test_a_screen_shows_the_same_from_each_space(view):
    """Converting there and back changes single precision's last digits, so dithering may move a value by one step."""
    light = np.random.default_rng(5).uniform(0, 2, (20, 30, 3)).astype(np.float32)
    own, other = viewed(light, view, 0.5), viewed(converted(light, REC709, "ACEScg"), view, 0.5, "lin_ap1_scene")
    assert np.abs(own.astype(int) - other).max() <= 1
    assert np.mean(own != other) < 0.01
    if view == OWN:
        assert png_of(light, exposure=0.5) == png_of(light, exposure=0.5, space=REC709)


CONFIG = """ocio_profile_version: 2
roles: {default: raw, scene_linear: show_linear, aces_interchange: aces}
displays: {screen: [!<View> {name: plain, colorspace: show_linear}]}
colorspaces:
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: aces, aliases: [ACES2065-1, lin_ap0_scene], encoding: scene-linear}
  - !<ColorSpace>
    name: show_linear
    encoding: scene-linear
    to_scene_reference: !<BuiltinTransform> {style: ACEScg_to_ACES2065-1}
"""


def test_a_space_of_the_users_configuration_is_known(tmp_path, monkeypatch):
    path = tmp_path / "config.ocio"
    path.write_text(CONFIG)
    assert config_name() == BUILT_IN
    monkeypatch.setenv("OCIO", str(path))
    assert named("show_linear") == "show_linear"
    assert named("ACEScg") == "lin_ap1_scene"
    colors = np.array([[0.2, 0.5, 0.9]])
    assert np.allclose(
        converted(colors, "show_linear", "lin_ap0_scene"), converted(colors, "ACEScg", "lin_ap0_scene"), atol=1e-6
    )
