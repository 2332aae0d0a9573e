"""Meshes whose material has only a volume shader: they are boxes of fog, not surfaces."""

import numpy as np
import pytest

from photonbeams.scene import Medium, SceneError
from photonbeams.usd.stage import open_stage, read_scene

VOLUME = """
def Material "Smoke"
{
    token outputs:volume.connect = </Smoke/Volume.outputs:volume>
    SURFACE
    def Shader "Volume"
    {
        uniform token info:id = "arnold:standard_volume"
        float inputs:density = 2
        color3f inputs:scatter_color = (0.75, 0.5, 0.25)
        float inputs:scatter_anisotropy = 0.3
        string inputs:emission_mode = "none"
        token outputs:volume
    }
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        token outputs:surface
    }
}
def KIND "Box" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    rel material:binding = </Smoke>
}
"""


def stage(kind="Cube", surface=""):
    return VOLUME.replace("KIND", kind).replace("SURFACE", surface)


def test_the_volume_fills_its_mesh_which_is_no_surface(scene):
    found = scene(stage())
    assert not found.meshes
    (medium,) = found.media
    assert medium.mesh is not None
    assert medium.mesh.volume == pytest.approx(8)
    assert np.allclose(medium.scattering, [1.5, 1.0, 0.5])
    assert np.allclose(medium.absorption, [0.5, 1.0, 1.5])
    assert medium.anisotropy == pytest.approx(0.3)


def test_even_fog_emits_what_its_shader_or_its_attribute_says(scene, caplog):
    shines = stage().replace('"none"', '"density"\n        color3f inputs:emission_color = (1, 2, 3)')
    (medium,) = scene(shines).media
    assert medium.emission == (1, 2, 3) and "only cameras see" in caplog.text
    caplog.clear()
    own = "color3f photonbeams:scattering = (0, 0, 1)\ncolor3f photonbeams:emission = (0, 0, 2)"
    (everywhere,) = scene(f'def Scope "Air" (\nprepend apiSchemas = ["PhotonBeamsMediumAPI"]\n) {{\n{own}\n}}\n').media
    assert everywhere.emission == (0, 0, 2) and everywhere.mesh is None
    assert scene(shines.replace('"density"', '"channel"')).media[0].emission is None
    assert "has no field heat" in caplog.text
    with pytest.raises(SceneError, match="emits light without end"):
        Medium((0, 0, 1), emission=(0, 1, 0))


def test_a_material_with_a_surface_is_one(scene):
    found = scene(stage(surface="token outputs:surface.connect = </Smoke/Surface.outputs:surface>"))
    assert len(found.meshes) == 1
    assert not found.media


def test_an_open_mesh_holds_no_fog(scene):
    with pytest.raises(SceneError, match="/Box has a volume material"):
        scene(stage("Plane"))


def test_a_volume_that_blender_did_not_write_is_told_with_the_flag_that_makes_fog(scene, usd, caplog):
    text = 'def Material "Fog"\n{\n}\n' + stage().replace("</Smoke>", "</Fog>")
    assert len(scene(text, 'doc = "Blender v5.0.1"').meshes) == 1
    assert "--set '/Box.photonbeams:scattering=0.1'" in caplog.text
    path = usd(text, 'doc = "Blender v5.0.1"').GetRootLayer().realPath
    found = read_scene(open_stage(path, overrides=["/Box.photonbeams:scattering=0.1"]))
    assert not found.meshes
    (medium,) = found.media
    assert (medium.mesh.volume, medium.scattering) == (pytest.approx(8), pytest.approx((0.1, 0.1, 0.1)))
    caplog.clear()
    scene(text)
    assert "--set" not in caplog.text


def test_a_lost_volume_of_some_faces_is_told(scene, caplog):
    text = """
    def Material "Fog" {\n }
    def Mesh "Box" {
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 1]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
        def GeomSubset "Some" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </Fog>\n }\n }
    """
    scene(text, 'doc = "Blender v5.0.1"')
    assert "/Box.material:binding is /Fog, which Blender wrote without shaders" in caplog.text
