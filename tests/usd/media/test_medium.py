"""Media that are read from a stage."""

import numpy as np
import pytest

from photonbeams import Shot, medium_of_colors
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


def test_all_media_are_read(scene, caplog):
    result = scene(f'def Cube "F" {API} {{\n{FOG}\n}}\ndef Scope "G" {API} {{\n}}\ndef Sphere "H" {API} {{\n}}')
    assert [each.name for each in result.media] == ["/F", "/G", "/H"]
    assert [each.bounded for each in result.media] == [True, False, True]
    assert result.medium is result.media[0]
    assert not caplog.text


def test_of_two_media_of_the_whole_space_the_first_is_kept(scene, caplog):
    (medium,) = scene(f'def Scope "F" {API} {{\n{FOG}\n}}\ndef Scope "G" {API} {{\n}}').media
    assert medium.name == "/F"
    assert "/G fills the whole space, as /F does: expected one such medium" in caplog.text


def test_a_medium_may_say_how_often_light_is_scattered(scene):
    assert scene(f'def Scope "F" {{\n{FOG}\n}}').medium.bounces is None
    assert scene(f'def Scope "F" {{\n{FOG}\nint photonbeams:bounces = 3\n}}').medium.bounces == 3
    with pytest.raises(SceneError, match=r"stage\.usda: /F\.photonbeams:bounces is -1"):
        scene(f'def Scope "F" {{\n{FOG}\nint photonbeams:bounces = -1\n}}')


def test_hidden_fog_is_not_there(scene):
    assert scene(f'def Cube "F" {API} {{\n{FOG}\ntoken visibility = "invisible"\n}}').medium is None


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "color3f photonbeams:scattering = (nan, 0, 0)",
            r"/F\.photonbeams:scattering is .*",
        ),
        (
            "color3f photonbeams:absorption = (0, -1, 0)",
            r"/F\.photonbeams:absorption is .*",
        ),
        (
            "float photonbeams:anisotropy = 1",
            r"/F\.photonbeams:anisotropy is 1.*",
        ),
    ],
)
def test_coefficients_out_of_range_are_errors_that_name_them(scene, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(f'def Scope "F" {API} {{\n{body}\n}}')


COLORS = """
    color3f photonbeams:nearColor = (1, 0.8, 0.5)
    color3f photonbeams:farColor = (0.5, 0.2, 0.1)
"""


def test_two_colors_make_the_fog(scene):
    more = "color3f photonbeams:albedo = (0.5, 0.5, 1)\nfloat photonbeams:farDistance = 2"
    medium = scene(f'def Scope "F" {{\n{COLORS}\n{more}\n}}').medium
    extinction = np.log([2, 4, 5]) / 2
    assert medium.extinction == pytest.approx(tuple(extinction), rel=1e-6)
    assert medium.scattering == pytest.approx(tuple(extinction * [0.5, 0.5, 1]), rel=1e-6)


def test_colors_win_over_coefficients_with_a_warning(scene, caplog):
    medium = scene(f'def Scope "F" {{\n{COLORS}\n{FOG}\n}}').medium
    assert medium.scattering == pytest.approx(tuple(np.log([2, 4, 5])), rel=1e-6)
    assert medium.anisotropy == pytest.approx(0.4)
    assert "/F.photonbeams:nearColor and farColor make the fog: scattering and absorption are not used" in caplog.text


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("color3f photonbeams:nearColor = (1, 1, 1)", r"/F\.photonbeams:farColor is not given"),
        ("color3f photonbeams:farColor = (1, 1, 1)", r"/F\.photonbeams:nearColor is not given"),
        (COLORS + "color3f photonbeams:albedo = (0, 1, 1)", r"/F: albedo is \(0.0, 1.0, 1.0\)"),
        (COLORS + "float photonbeams:farDistance = 0", r"/F\.photonbeams:farDistance is 0"),
    ],
)
def test_colors_that_make_no_fog_are_errors(scene, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(f'def Scope "F" {{\n{body}\n}}')


def test_a_fog_may_leave_surfaces_alone(scene):
    assert scene(f'def Scope "F" {{\n{FOG}\n}}').medium.surfaces
    assert not scene(f'def Scope "F" {{\n{FOG}\nbool photonbeams:surfaces = 0\n}}').medium.surfaces


def test_a_drawn_beam_of_the_medium_of_colors_is_rendered_in_those_colors(usd):
    distance, radius = 4.0, 0.2
    near, far = (1.0, 0.8, 0.5), (0.5, 0.2, 0.1)
    _, power = medium_of_colors(near, far, distance=distance, radius=radius)
    stage = usd(f"""
        def Scope "F" {{\n{COLORS}\n}}
        def BasisCurves "B" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"]) {{
            uniform token type = "linear"
            int[] curveVertexCounts = [2]
            point3f[] points = [(-0.5, 0, 0), (3, 0, 0)]
            float[] widths = [{2 * radius}, {2 * radius}]
            color3f[] photonbeams:power = [{power}]
        }}
        def Camera "C" {{
            token projection = "orthographic"
            float horizontalAperture = 20
            float verticalAperture = 1
            double3 xformOp:translate = (0.5, 0, {distance})
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}""")
    beams = Shot(stage).render(passes=64, width=40, height=2).layers["beams"]
    # A pixel is 0.05 units wide and shows its mean. The beam and the picture begin at x = -0.5, so columns 0 and 20 are
    # 0.025 and 1.025 units along the beam. The axis passes between the two rows: a row covers u = 0 to 0.05 off the
    # axis, where the profile is (1 - u²/R²)^1.5 times that of the middle. Sample positions in pixels are stratified:
    # the mean of 64 is exact to less than a hundredth.
    profile = np.mean((1 - (np.linspace(0, 0.05, 101) / radius) ** 2) ** 1.5)
    along = 0.025
    expected = np.array([near, far]) * np.power(np.divide(far, near), along) * profile
    # Light from the front and the back of the beam passes through less and more fog than light from its axis. This
    # adds cosh(σt R) - 1 < 0.06 at the rim, and a fifth of that in the mean.
    assert np.allclose(beams[0, [0, 20]], expected, rtol=0.02)
