"""Materials that are read once for all times: only those that nothing can change."""

import os

import numpy as np
import pytest
from PIL import Image

from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import read_extent, read_scene

SHADER = """
def Material "M" {{
    token outputs:surface.connect = </{parent}M/S.outputs:surface>
    def Shader "S" {{
        uniform token info:id = "UsdPreviewSurface"
        {color}
        token outputs:surface
    }}
    {more}
}}
"""
MESH = """
def Mesh "Mesh" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1)] (interpolation = "vertex")
    rel material:binding = </{parent}M>
}}
"""
CHANGING = "color3f inputs:diffuseColor.timeSamples = { 1: (.1, .1, .1), 2: (.8, .8, .8) }"


def diffuse(stage, time, lasting, warnings=None):
    """Return the diffuse reflectance of the only mesh at a time."""
    (mesh,) = read_scene(stage, time, warnings or Warnings(), lasting=lasting).meshes
    return mesh.material.diffuse


def own(**parts):
    return SHADER.format(**({"parent": "", "more": ""} | parts)) + MESH.format(parent="")


def test_a_material_is_the_same_object_at_all_times(usd):
    stage, lasting = usd(own(color="color3f inputs:diffuseColor = (.1, .2, .3)")), {}
    first, second = (read_scene(stage, time, lasting=lasting).meshes[0].material for time in (1, 2))
    assert first is second and first.diffuse == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize("kind", ["def", "class", "over"])
def test_a_shader_that_changes_in_a_prototype(usd, kind):
    prototype = SHADER.format(parent="Proto/", color=CHANGING, more="") + MESH.format(parent="Proto/")
    instancer = """
def PointInstancer "Many" {
    point3f[] positions = [(0, 0, 0)]
    int[] protoIndices = [0]
    rel prototypes = </Proto/Mesh>
}
"""
    stage, lasting = usd(f'{kind} "Proto" {{{prototype}}}\n{instancer}'), {}
    # The prototype is rendered where it stands, too, if it is defined.
    found = [[mesh.material.diffuse[0] for mesh in read_scene(stage, at, lasting=lasting).meshes] for at in (1, 2)]
    assert (
        found[0]
        and found[0] == pytest.approx([0.1] * len(found[0]))
        and found[1] == pytest.approx([0.8] * len(found[0]))
    )


def test_a_shader_that_reads_from_a_prim_of_another_kind(usd):
    other = f'def Scope "Elsewhere" {{\n    {CHANGING}\n}}\n'
    text = own(color="color3f inputs:diffuseColor.connect = </Elsewhere.inputs:diffuseColor>")
    stage, lasting = usd(other + text), {}
    alone = [diffuse(stage, time, {}) for time in (1, 2)]
    assert [diffuse(stage, time, lasting) for time in (1, 2)] == alone


def test_a_texture_that_is_written_again(usd, tmp_path):
    texture = """
    def Shader "T" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @%s@
        float2 inputs:st = (0, 0)
        float3 outputs:rgb
    }
""" % (tmp_path / "texture.png")
    stage = usd(own(color="color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>", more=texture))
    lasting, found = {}, []
    for number, grey in enumerate((50, 200, 200)):
        if grey != 200 or len(found) == 1:
            Image.fromarray(np.full((4, 4, 3), grey, np.uint8)).save(tmp_path / "texture.png")
            os.utime(tmp_path / "texture.png", (number, number))
        found.append(np.mean(diffuse(stage, 1, lasting)))
    assert found[0] < 0.1 and found[1] == found[2] > 0.5


def test_what_is_wrong_is_said_after_a_silent_reading(usd):
    text = own(color="color3f inputs:diffuseColor = (.1, .2, .3)").replace("UsdPreviewSurface", "Unknown")
    lamp = text.replace('["MaterialBindingAPI"]', '["MaterialBindingAPI", "MeshLightAPI"]')
    stage, lasting, warnings = usd(lamp), {}, Warnings()
    read_extent(stage, 1, lasting)
    read_scene(stage, 1, warnings, lasting=lasting)
    assert any("Unknown" in each for each in warnings.given)
