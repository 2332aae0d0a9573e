"""Fog."""

import numpy as np
import pytest

from photonbeams.scene import SceneError

FOG = """
    color3f photonbeams:scattering = (0.1, 0.2, 0.3)
    color3f photonbeams:absorption = (0.01, 0.02, 0.03)
    float photonbeams:anisotropy = 0.4
"""
API = '(prepend apiSchemas = ["PhotonBeamsMediumAPI"])'


@pytest.mark.parametrize("extra", ["", API])
def test_fog_on_a_prim_that_is_no_gprim_fills_the_space(scene, extra):
    medium = scene(f'def Scope "F" {extra} {{\n{FOG}\n}}').medium
    assert medium.scattering == pytest.approx((0.1, 0.2, 0.3))
    assert medium.absorption == pytest.approx((0.01, 0.02, 0.03))
    assert medium.anisotropy == pytest.approx(0.4)
    assert medium.mesh is None


@pytest.mark.parametrize("kind", ["Cube", "Sphere", "Cylinder", "Cone", "Capsule"])
def test_fog_on_a_closed_gprim_fills_it_and_it_is_no_surface(scene, kind):
    moved = 'double3 xformOp:translate = (7, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    result = scene(f'def {kind} "F" {API} {{\n{FOG}\n{moved}\n}}')
    assert result.meshes == ()
    assert result.medium.mesh.name == "/F"
    assert np.allclose(result.medium.mesh.points.mean(axis=0)[0], 7, atol=0.1)


def test_fog_on_a_closed_mesh_fills_it(scene):
    body = """
        int[] faceVertexCounts = [3, 3, 3, 3]
        int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]"""
    assert len(scene(f'def Mesh "F" {{\n{body}\n{FOG}\n}}').medium.mesh.faces) == 4


def test_fog_on_an_open_surface_fills_the_space_with_a_warning(scene, caplog):
    result = scene(f'def Plane "F" {API} {{\n{FOG}\n}}')
    assert result.medium.mesh is None
    assert len(result.meshes) == 1
    assert "/F is not closed: its fog fills the whole space" in caplog.text


def test_of_two_media_the_first_is_used_with_a_warning(scene, caplog):
    result = scene(f'def Scope "F" {API} {{\n{FOG}\n}}\ndef Scope "G" {API} {{\n}}')
    assert result.medium.scattering[0] == pytest.approx(0.1)
    assert "/G is a second medium: that of /F is used alone" in caplog.text


def test_hidden_fog_is_not_there(scene):
    assert scene(f'def Cube "F" {API} {{\n{FOG}\ntoken visibility = "invisible"\n}}').medium is None


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "color3f photonbeams:scattering = (nan, 0, 0)",
            r"/F\.photonbeams:scattering is .*: expected one or three finite",
        ),
        (
            "color3f photonbeams:absorption = (0, -1, 0)",
            r"/F\.photonbeams:absorption is .*: expected one or three finite",
        ),
        (
            "float photonbeams:anisotropy = 1",
            r"/F\.photonbeams:anisotropy is 1.*: expected a finite number at least -0.99",
        ),
    ],
)
def test_coefficients_out_of_range_are_errors_that_name_them(scene, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(f'def Scope "F" {API} {{\n{body}\n}}')
