"""Values out of their range: the nearest one is used, and never without a word."""

import numpy as np
import pytest

from photonbeams.usd.stage import read_scene

MESH = """
def SphereLight "Lamp" {
}
def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    %s
}
def Material "Mat" {
    token outputs:%s.connect = </Mat/S.outputs:out>
    def Shader "S" {
        uniform token info:id = "%s"
        %s
        token outputs:out
    }
    %s
}
"""
RAMP = """def Shader "N" {
        uniform token info:id = "ND_ramp"
        int inputs:num_intervals = 12
        color3f outputs:out
    }"""


def surface(line, kind="UsdPreviewSurface", nodes=""):
    return MESH % ("rel material:binding = </Mat>", "surface", kind, line, nodes)


def fog(line):
    cube = 'def Cube "Box" (prepend apiSchemas = ["MaterialBindingAPI"]) {\nrel material:binding = </Mat>\n}\n'
    return cube + MESH % ("", "volume", "arnold:standard_volume", f'string inputs:emission_mode = "none"\n{line}', "")


def light(line):
    return f'def SphereLight "L" {{\n{line}\n}}\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (light("float inputs:shaping:cone:softness = -1"), "/L.inputs:shaping:cone:softness is -1: expected 0 or more"),
        (light("float inputs:shaping:focus = -2"), "/L.inputs:shaping:focus is -2: expected 0 or more; 0 is used"),
        (light("float inputs:angle = 400").replace("Sphere", "Distant"), "/L.inputs:angle is 400: expected 0 to 360"),
        (
            light("bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 20000"),
            "/L.inputs:colorTemperature is 20000: expected 1000 to 10000; 10000 is used",
        ),
        (surface("float inputs:roughness = 1.5"), "/Mat has the roughness 1.5: expected 0 to 1; the nearest value"),
        (surface("color3f inputs:diffuseColor = (2, 1, -1)"), "/Mat has the diffuse 2, 1, -1: expected 0 to 1"),
        (MESH % ("color3f[] primvars:displayColor = [(2, 0, 0)]", "surface", "none", "", ""),
         "/M has displayColor from 0 to 2: expected 0 to 1; the nearest is used"),
        (surface("float inputs:specular = 3", "arnold:standard_surface"),
         "/Mat/S.inputs:specular is [3.0]: expected 0 to 1; the nearest is used"),
        (surface("color3f inputs:base_color.connect = </Mat/N.outputs:out>", "ND_standard_surface_surfaceshader", RAMP),
         "/Mat/N.inputs:num_intervals is 12: expected 2 to 10"),
        (fog("float inputs:transparent_depth = 0"), "/Mat/S.inputs:transparent_depth is 0: expected at least 1e-06"),
        (fog("color3f inputs:transparent = (0, 0.5, 0.5)"), "/Mat/S.inputs:transparent makes (0.0, 0.5, 0.5):"),
        (fog("float inputs:scatter = 4"), "/Mat/S.inputs:scatter_color makes (2.0, 2.0, 2.0): expected 0 to 1"),
        ('def Points "P" {\npoint3f[] points = [(0, 0, 0)]\nfloat[] widths = [-1]\n}',
         "/P.widths holds -1: expected diameters of 0 or more; 0 is used"),
        ('def Scope "F" {\ncolor3f photonbeams:nearColor = (1, 1, 1)\ncolor3f photonbeams:farColor = (0, 1, 1)\n}',
         "/F.photonbeams:farColor is (0.0, 1.0, 1.0): expected 0.1 to 0.999 of nearColor in each channel"),
    ],
)  # fmt: skip
def test_a_value_out_of_range_is_named_with_what_is_used_instead(usd, caplog, text, message):
    read_scene(usd(text))
    assert message in caplog.text


def test_a_texture_out_of_range_is_named_unless_it_is_off_by_noise(usd, image, caplog):
    for high, warned in ((1.0005, False), (3.0, True)):
        file = image(f"{high}.exr", np.full((2, 2, 1), high), "float")
        node = f"""def Shader "N" {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{file}@
            float outputs:r
        }}"""
        found = read_scene(usd(surface("float inputs:roughness.connect = </Mat/N.outputs:r>", nodes=node)))
        assert found.meshes[0].material.roughness == 1
        assert ("/Mat has the roughness of a texture, 3 to 3: expected 0 to 1" in caplog.text) == warned
