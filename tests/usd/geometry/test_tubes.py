"""Curves, points, patches and tetrahedra as surfaces, compared with areas and radii in closed form."""

import numpy as np
import pytest

CIRCLE = "(1, 0, 0), (1, 1, 0), (0, 1, 0), (-1, 1, 0), (-1, 0, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0), (1, 0, 0)"
KNOTS = "0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4"
WEIGHTS = ", ".join(["1, 0.7071067811865476"] * 4 + ["1"])


def only(scene, text):
    (found,) = scene(text).meshes
    return found


def outward(mesh):
    """Return whether all triangles wind around their normals."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return np.all(np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.faces].mean(axis=1)) > 0)


def curves(points, counts, more, kind="BasisCurves"):
    return f"""def {kind} "C" {{
        int[] curveVertexCounts = [{counts}]
        point3f[] points = [{points}]
        {more}
    }}
    """


@pytest.mark.parametrize(
    "widths",
    [
        '[0.2] (interpolation = "constant")',
        '[0.2, 0.2, 0.2] (interpolation = "vertex")',
        '[0.2] (interpolation = "uniform")',
        "[0.2, 0.2, 0.2]",
    ],
)
def test_a_straight_curve_is_a_tube_of_its_width(scene, widths):
    text = curves("(0, 0, 0), (0, 0, 1), (0, 0, 3)", 3, f'uniform token type = "linear"\nfloat[] widths = {widths}')
    found = only(scene, text)
    assert np.allclose(np.linalg.norm(found.points[:, :2], axis=1), 0.1)
    assert found.area == pytest.approx(12 * 2 * 0.1 * np.sin(np.pi / 12) * 3)  # a prism of twelve sides
    assert outward(found)


def test_a_tapered_cubic_curve_keeps_to_its_spline(scene):
    # A Bézier curve of collinear, evenly spaced points is linear in t, and so is its width.
    more = 'uniform token type = "cubic"\nfloat[] widths = [0, 0.6] (interpolation = "varying")'
    found = only(scene, curves("(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)", 4, more))
    assert np.allclose(np.linalg.norm(found.points[:, 1:], axis=1), 0.1 * found.points[:, 0])


def test_curves_with_normals_are_ribbons(scene):
    more = 'uniform token type = "linear"\nfloat[] widths = [0.5]\nnormal3f[] normals = [(0, 0, 1), (0, 0, 1)]'
    found = only(scene, curves("(0, 0, 0), (2, 0, 0)", 2, more))
    assert found.area == pytest.approx(1)
    assert np.allclose(found.normals, [0, 0, 1])
    assert outward(found)


def test_normals_along_their_curve_do_not_turn_it_into_a_ribbon_of_no_width(scene):
    shape = 'uniform token type = "linear"\nfloat[] widths = [0.5]\nnormal3f[] normals = [{}]'
    tube = only(scene, curves("(0, 0, 0), (0, 0, 2)", 2, shape.format("(0, 0, 1), (0, 0, 3)")))
    assert np.allclose(np.linalg.norm(tube.points[:, :2], axis=1), 0.25)
    points, normals = "(0, 0, 0), (1, 0, 0), (2, 0, 0)", "(1, 0, 0), (0, 0, 1), (0, 0, 1)"
    assert only(scene, curves(points, 3, shape.format(normals))).area == pytest.approx(1)  # a ribbon of full width


def test_a_rational_curve_is_a_circle_and_a_tube_around_it_a_torus(scene):
    more = f"""int[] order = [3]
        double[] knots = [{KNOTS}]
        double[] pointWeights = [{WEIGHTS}]
        float[] widths = [0.2] (interpolation = "constant")"""
    found = only(scene, curves(CIRCLE, 9, more, "NurbsCurves"))
    radius = np.linalg.norm(found.points[:, :2], axis=1)
    # The tube has 33 points on the circle. Its tangents are means of two chords; its normals are exact.
    assert np.allclose(np.hypot(radius - 1, found.points[:, 2]), 0.1, atol=1e-3)
    assert outward(found)


def test_hermite_curves_begin_and_end_along_their_tangents(scene):
    more = "vector3f[] tangents = [(0, 3, 0), (3, 0, 0)]\nfloat[] widths = [0.01, 0.01]"
    found = only(scene, curves("(0, 0, 0), (1, 1, 0)", 2, more, "HermiteCurves"))
    t = np.linspace(0, 1, 2001)[:, None]
    middle = (3 * t**2 - 2 * t**3) * [1, 1, 0] + (t - 2 * t**2 + t**3) * [0, 3, 0] + (t**3 - t**2) * [3, 0, 0]
    away = np.linalg.norm(found.points[:, None] - middle, axis=2).min(axis=1)
    assert np.allclose(away, 0.005, atol=1e-4)


def test_points_are_spheres_of_their_widths(scene):
    found = only(scene, 'def Points "P" { point3f[] points = [(0, 0, 0), (5, 0, 0)]\nfloat[] widths = [1, 2] }')
    near = found.points[:, 0] < 2
    assert np.allclose(np.linalg.norm(found.points[near], axis=1), 0.5)
    assert np.allclose(np.linalg.norm(found.points[~near] - [5, 0, 0], axis=1), 1)
    assert outward(found)
    # Facets with edges of up to √2 π / 32 radii lose at most a quarter of the square of that, 0.5 %, of the area.
    assert found.area == pytest.approx(np.pi * (1 + 4), rel=0.005)


def test_points_with_normals_are_discs(scene):
    text = 'def Points "P" { point3f[] points = [(0, 0, 1)]\nfloat[] widths = [2]\nnormal3f[] normals = [(0, 2, 0)] }'
    found = only(scene, text)
    assert np.allclose(found.points[:, 1], 0)
    assert found.area == pytest.approx(4 * np.sqrt(0.5))  # an octagon of radius 1: 8 / 2 sin 45°
    assert outward(found)


def test_points_without_widths_are_small(scene, caplog):
    found = only(scene, 'def Points "P" { point3f[] points = [(0, 0, 0), (500, 0, 0)] }')
    assert np.linalg.norm(found.points, axis=1).min() == pytest.approx(0.5)
    assert "/P.widths is not given: 1 is used" in caplog.text


def test_a_rational_patch_is_a_cylinder(scene):
    low, high = CIRCLE, CIRCLE.replace(", 0)", ", 2)")
    found = only(
        scene,
        f"""def NurbsPatch "N" {{
            int uVertexCount = 9
            int uOrder = 3
            double[] uKnots = [{KNOTS}]
            int vVertexCount = 2
            int vOrder = 2
            double[] vKnots = [0, 0, 1, 1]
            point3f[] points = [{low}, {high}]
            double[] pointWeights = [{WEIGHTS}, {WEIGHTS}]
        }}
        """,
    )
    assert np.allclose(np.linalg.norm(found.points[:, :2], axis=1), 1)
    assert found.points[:, 2].max() == pytest.approx(2)
    assert outward(found)
    assert np.allclose(found.uvs[:, 1], found.points[:, 2] / 2)


def test_the_surface_of_tetrahedra_is_closed(scene):
    found = only(
        scene,
        """def TetMesh "T" {
            point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
            int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 4, 2, 3)]
        }""",
    )
    assert len(found.faces) == 6
    assert found.volume == pytest.approx(1 / 6 + 1 / 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('def Points "P" {}', "/P has no points: it is skipped"),
        ('def BasisCurves "C" {}', "/C has no points: it is skipped"),
        (
            curves("(0, 0, 0), (1, 0, 0), (2, 0, 0)", 3, "float[] widths = [1]"),
            "/C.curveVertexCounts has 1 curves whose number of points",
        ),
    ],
)
def test_what_has_nothing_to_show_is_named(scene, caplog, text, message):
    assert not scene(text).meshes
    assert message in caplog.text
