"""Every kind of colour on a stage is converted from its own space to the working space."""

import numpy as np
import pytest
from pxr import UsdLux

from photonbeams.images.color_spaces import REC709, converted
from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import open_stage, read_scene

COLOR = (0.9, 0.3, 0.15)
STAGE = """#usda 1.0
(
    renderSettingsPrimPath = "/Render"
)
%(world)s
def Scope "World" %(space)s {
    def PhotonBeamsLook "Look" {
        float[] photonbeams:along:ramp:knots = [0, 1]
        color3f[] photonbeams:along:ramp:colors = [%(color)s, (1, 1, 1)]
    }
    def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
        color3f inputs:color = %(color)s
        rel photonbeams:look = </World/Look>
    }
    def SphereLight "Warm" {
        bool inputs:enableColorTemperature = 1
        float inputs:colorTemperature = 3000
    }
    def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
        color3f photonbeams:scattering = %(color)s
    }
    def Mesh "Painted" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1)] (interpolation = "vertex")
        rel material:binding = </World/Paint>
    }
    def Mesh "Plain" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        color3f[] primvars:displayColor = [%(color)s]
    }
    def Material "Paint" {
        token outputs:surface.connect = </World/Paint/S.outputs:surface>
        def Shader "S" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Paint/T.outputs:rgb>
            color3f inputs:emissiveColor = %(color)s
            token outputs:surface
        }
        def Shader "T" {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @%(image)s@
            color3f outputs:rgb
        }
    }
}
"""
SPACE = """(prepend apiSchemas = ["ColorSpaceAPI"]) {
    uniform token colorSpace:name = "%s"
"""


def write(path, image, *, space="", settings=""):
    world = 'def RenderSettings "Render" {\n    %s\n}' % (settings and f'token renderingColorSpace = "{settings}"')
    text = STAGE % {"world": world, "space": "%(space)s", "color": COLOR, "image": image}
    path.write_text(text.replace("%(space)s {", SPACE % space if space else "{"))
    return path


@pytest.mark.parametrize("working", ["lin_ap1_scene", "lin_rec2020_scene", "lin_p3d65_scene"])
@pytest.mark.parametrize("by", ["argument", "settings"])
def test_every_colour_is_converted_to_the_working_space(tmp_path, image, caplog, working, by):
    """The oracle is OpenColorIO; temperatures are those of UsdLux, in Rec. 709, relative to 6500 K."""
    path = write(
        tmp_path / "a.usda",
        image("a.png", [[[1, 128 / 255, 64 / 255]]]),
        settings=working if by == "settings" else "Other",
    )
    found = read_scene(open_stage(path, working_space=working if by == "argument" else None))
    color = tuple(converted(np.array(COLOR), REC709, working))
    lamp, painted, warm = sorted(found.lights, key=lambda each: each.name)
    assert painted.radiance == pytest.approx(color, rel=1e-5)
    assert lamp.radiance == pytest.approx(color, rel=1e-5)
    kelvin, white = (np.array(UsdLux.BlackbodyTemperatureAsRgb(each)) for each in (3000, 6500))
    assert warm.radiance == pytest.approx(tuple(converted(kelvin / white, REC709, working)), rel=1e-5)
    assert found.medium.scattering == pytest.approx(color, rel=1e-5)
    assert lamp.look.values["along:ramp:colors"] == (pytest.approx(color, rel=1e-5), pytest.approx((1, 1, 1), rel=1e-5))
    painted, plain = (next(each for each in found.meshes if each.name.endswith(name)) for name in ("Painted", "Plain"))
    encoded = np.array([1, 128 / 255, 64 / 255])
    texel = converted(np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, 0), REC709, working)
    assert np.allclose(painted.material.diffuse, texel, rtol=1e-5)
    assert painted.material.emissive == pytest.approx(color, rel=1e-5)
    assert np.allclose(plain.material.diffuse, color, rtol=1e-5)
    assert not caplog.text


def test_colours_have_the_space_of_a_prim_above_them_or_else_that_of_the_user(tmp_path, image):
    """A stage whose colours are AP1's, in one way or the other, needs no conversion in AP1."""
    texture = image("a.png", [[[1, 128 / 255, 64 / 255]]])
    above = open_stage(write(tmp_path / "a.usda", texture, space="ACEScg"), working_space="ACEScg")
    asked = open_stage(write(tmp_path / "b.usda", texture), working_space="ACEScg", color_space="lin_ap1")
    for stage in (above, asked):
        found = read_scene(stage)
        assert found.lights[0].radiance == pytest.approx(COLOR, rel=1e-6)
        assert found.medium.scattering == pytest.approx(COLOR, rel=1e-6)
    shown = read_scene(open_stage(tmp_path / "a.usda"))
    assert shown.lights[0].radiance == pytest.approx(tuple(converted(np.array(COLOR), "ACEScg")), rel=1e-5)


def test_colours_outside_of_the_working_space_give_a_warning_there_alone(scene, tmp_path, caplog):
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\ndef SphereLight "L" {\n    color3f inputs:color = (0, 1, 0) (colorSpace = "lin_ap1_scene")\n}\n'
    )
    assert read_scene(open_stage(path, working_space="ACEScg")).lights[0].radiance == (0, 1, 0)
    assert not caplog.text
    assert read_scene(open_stage(path)).lights[0].radiance == pytest.approx((0, 1.1408, 0), abs=1e-4)
    assert "/L.inputs:color is (-0.622, 1.14, -0.129) in lin_rec709_scene: numbers below 0 count as 0" in caplog.text


def test_an_unknown_space_is_named(tmp_path, caplog):
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef SphereLight "L" {\n    color3f inputs:color = (0, 1, 0) (colorSpace = "mine")\n}\n')
    assert read_scene(open_stage(path)).lights[0].radiance == (0, 1, 0)
    assert "/L.inputs:color has the colour space 'mine', which neither OpenUSD nor OpenColorIO knows" in caplog.text
    with pytest.raises(SceneError, match="the working space is 'mine': expected a linear colour space"):
        open_stage(path, working_space="mine")
    with pytest.raises(SceneError, match="the colour space is 'sRGB - Texture': expected a linear colour space"):
        open_stage(path, color_space="sRGB - Texture")
    wrong = open_stage(write(tmp_path / "b.usda", "none.png", settings="ACEScct"))
    read_scene(wrong, warnings=Warnings())
    assert caplog.text.count("renderingColorSpace") == 1
    assert "/Render.renderingColorSpace is 'ACEScct': expected a linear colour space" in caplog.text
