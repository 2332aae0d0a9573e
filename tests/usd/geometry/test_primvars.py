"""Primvars are flattened, cut to the expected number, or left out with one warning."""

import numpy as np
import pytest

QUAD = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""
SQUARE = "[(0, 0), (1, 0), (1, 1), (0, 1)]"


def mesh(body):
    return f'def Mesh "M" {{\n{QUAD}\n{body}\n}}\n'


def warnings(caplog):
    return [record.getMessage().partition("stage.usda: /M.")[2] for record in caplog.records]


@pytest.mark.parametrize(
    "body",
    [
        f'texCoord2f[] primvars:st = {SQUARE} (interpolation = "vertex"\n elementSize = 2)',
        'float[] primvars:st = [0, 0, 1, 0, 1, 1, 0, 1] (interpolation = "vertex"\n elementSize = 2)',
        'texCoord3f[] primvars:st = [(0, 0, 7), (1, 0, 7), (1, 1, 7), (0, 1, 7)] (interpolation = "vertex")',
        f'half2[] primvars:st = {SQUARE} (interpolation = "varying")',
        'texCoord2f[] primvars:st = [(1, 1), (0, 1), (0, 0), (1, 0)] (interpolation = "faceVarying")\n'
        "int[] primvars:st:indices = [2, 3, 0, 1]",
    ],
)
def test_texture_coordinates_are_flattened_whatever_their_type_and_element_size(scene, caplog, body):
    (found,) = scene(mesh(body)).meshes
    assert np.allclose(found.uvs, found.points[:, :2])
    assert not caplog.records


def test_normals_ignore_the_element_size(scene, caplog):
    values = "[(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"
    (found,) = scene(
        mesh(f'normal3f[] primvars:normals = {values} (interpolation = "vertex"\n elementSize = 3)')
    ).meshes
    assert np.allclose(found.normals, [0, 0, 1])
    assert not caplog.records


def test_values_too_many_are_cut(scene, caplog):
    (found,) = scene(mesh(f'texCoord2f[] primvars:st = {SQUARE[:-1]}, (9, 9)] (interpolation = "vertex")')).meshes
    assert np.allclose(found.uvs, found.points[:, :2])
    assert warnings(caplog) == ["primvars:st has 5 values of interpolation 'vertex': expected 4; the first are used"]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")',
            "primvars:st has 1 values of interpolation 'vertex': expected 4; it is left out",
        ),
        (
            'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")\nint[] primvars:st:indices = [0, 5, 0, 0]',
            "primvars:st:indices names value 5: expected values from 0 to 0; primvars:st is left out",
        ),
        (
            'int primvars:st = 3 (interpolation = "constant")',
            "primvars:st has values of type int: expected 2 numbers each; it is left out",
        ),
        (
            'token[] primvars:st = ["a"] (interpolation = "constant")',
            "primvars:st has values of type TokenArray: expected 2 numbers each; it is left out",
        ),
        (
            f'texCoord2f[] primvars:st = {SQUARE.replace("(1, 1)", "(1, inf)")} (interpolation = "vertex")',
            "primvars:st[2] is (1.0, inf): expected finite numbers; primvars:st is left out",
        ),
    ],
)
def test_what_cannot_be_used_is_left_out_with_one_warning(scene, caplog, body, message):
    (found,) = scene(mesh(body)).meshes
    assert found.uvs is None
    assert warnings(caplog) == [message]


def test_normals_that_are_too_few_are_left_out(scene, caplog):
    (found,) = scene(mesh("normal3f[] normals = [(0, 0, 1)]")).meshes
    assert found.normals is None
    assert warnings(caplog) == ["normals has 1 values of interpolation 'vertex': expected 4; it is left out"]


INSTANCER = """def PointInstancer "I" {
    rel prototypes = [</I/Plain>, </I/Own>]
    int[] protoIndices = [0, 0, 1]
    point3f[] positions = [(0, 0, 0), (5, 0, 0), (10, 0, 0)]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (interpolation = "vertex")
    def Cube "Plain" {
    }
    def Cube "Own" {
        color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)]
    }
}
"""


def test_primvars_of_an_instancer_are_for_each_instance_unless_a_prim_has_its_own(scene):
    found = {each.name: each.material.diffuse for each in scene(INSTANCER).meshes}
    assert found == {"/I[0]": (1, 0, 0), "/I[1]": (0, 1, 0), "/I[2]": (0.5, 0.5, 0.5)}


def test_primvars_of_a_native_instance_reach_its_prims(scene):
    text = """class "Proto" {
        def Cube "Box" {
        }
    }
    """
    for name, color in (("A", "(1, 0, 0)"), ("B", "(0, 1, 0)")):
        text += f"""def Xform "{name}" (
            instanceable = true
            references = </Proto>
        ) {{
            color3f[] primvars:displayColor = [{color}]
        }}
        """
    found = {each.name: each.material.diffuse for each in scene(text).meshes}
    assert found == {"/A/Box": (1, 0, 0), "/B/Box": (0, 1, 0)}
