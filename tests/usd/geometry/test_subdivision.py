"""Subdivision surfaces against their limits in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from photonbeams.usd.common.selection import Selection
from photonbeams.usd.geometry.refinement import SHARP, Topology
from photonbeams.usd.stage import open_stage, read_scene

CUBE_POINTS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
CUBE = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
TOP = [(4, 5), (5, 7), (7, 6), (6, 4)]
OCTAHEDRON_POINTS = np.concatenate([np.eye(3), -np.eye(3)])
OCTAHEDRON = [0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5]


def topology(sides, indices, size, creases=None, loop=False):
    indices = np.array(indices)
    counts = np.full(len(indices) // sides, sides)
    flat = Topology(counts, indices, size, np.zeros(len(indices)), np.zeros(size), loop)
    edges = [frozenset(pair) for pair in zip(indices.tolist(), indices[flat.following].tolist(), strict=True)]
    given = {frozenset(pair): value for pair, value in (creases or {}).items()}
    return replace(flat, edge_sharpness=np.array([given.get(edge, 0.0) for edge in edges]))


def refined(mesh, points, levels):
    for _ in range(levels):
        mesh, matrix = mesh.refined
        points = matrix @ points
    return mesh, points


@pytest.mark.parametrize("crease", [None, 1.0, 2.0, SHARP])
def test_the_limit_of_a_cube_is_the_same_from_every_level(crease):
    mesh = topology(4, CUBE, 8, dict.fromkeys(TOP, crease) if crease else None)
    least = 1 if crease in (None, SHARP) else int(crease)  # the limit is exact once a finite sharpness has decayed to 0
    limits = []
    for level in range(least, least + 3):
        finer, points = refined(mesh, CUBE_POINTS, level)
        limits.append((finer.limit @ points)[:8])
    assert np.allclose(limits[0], limits[1]) and np.allclose(limits[0], limits[2])
    # Halstead, Kass and DeRose 1993: (n² v + 4 Σe + Σf) / n (n + 5), with v = -5/9, e = -3/4, 0, 0 … at level 1
    if crease is None:
        assert np.allclose(limits[0], CUBE_POINTS / 2)
    # A crease is a cubic B-spline: (a + 4 v + b) / 6.
    if crease == SHARP:
        assert np.allclose(limits[0][4:], CUBE_POINTS[4:] * [2 / 3, 2 / 3, 1])


def test_a_fractional_sharpness_is_between_its_neighbours():
    soft, sharp, between = (
        topology(4, CUBE, 8, dict.fromkeys(TOP, value)).refined[1] @ CUBE_POINTS for value in (0.0, 1.0, 0.25)
    )
    assert np.allclose(between, 0.75 * soft + 0.25 * sharp)


def test_loop_keeps_its_limit():
    mesh = topology(3, OCTAHEDRON, 6, loop=True)
    limits = [(lambda finer, points: finer.limit @ points)(*refined(mesh, OCTAHEDRON_POINTS, n))[:6] for n in range(3)]
    assert np.allclose(limits[0], limits[1]) and np.allclose(limits[0], limits[2])
    # Loop 1987: at valence 4, β = (5/8 − (3/8)²) / 4. The neighbours of v add to 0, so the limit is v times
    # 1 − 4 / (4 + 3 / 8β).
    beta = (5 / 8 - (3 / 8) ** 2) / 4
    assert np.allclose(limits[0], OCTAHEDRON_POINTS * (1 - 4 / (4 + 3 / (8 * beta))))


def test_a_regular_grid_is_a_bicubic_spline(rng):
    size = 5
    heights = rng.random((size, size))
    rows, columns = np.mgrid[:size, :size]
    points = np.stack([rows.ravel(), columns.ravel(), heights.ravel()], axis=1).astype(float)
    numbers = np.arange(size * size).reshape(size, size)
    quads = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], axis=-1)
    finer, found = refined(topology(4, quads.ravel(), size * size), points, 2)
    limit = finer.limit @ found
    inner = np.all((limit[:, :2] > 1 - 1e-9) & (limit[:, :2] < size - 2 + 1e-9), axis=1)
    knots = np.arange(-2.0, size + 2)
    basis = [BSpline.design_matrix(limit[inner, axis].clip(1, size - 2), knots, 3).toarray() for axis in (0, 1)]
    assert inner.sum() == 81
    assert np.allclose(np.einsum("ni,ij,nj->n", basis[0], heights, basis[1]), limit[inner, 2])


def body(scheme, more=""):
    faces = ", ".join(map(str, CUBE))
    points = ", ".join(str(tuple(point)) for point in CUBE_POINTS.tolist())
    return f"""def Mesh "M" {{
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [{faces}]
        point3f[] points = [{points}]
        {f'uniform token subdivisionScheme = "{scheme}"' if scheme else ""}
        {more}
    }}
    """


@pytest.mark.parametrize(
    ("scheme", "complexity", "faces"),
    [
        ("", None, 12),
        ("", "medium", 48),
        ("catmullClark", None, 192),
        ("catmullClark", "low", 12),
        ("none", "high", 12),
    ],
)
def test_what_says_that_it_is_a_subdivision_surface_is_refined(tmp_path, scheme, complexity, faces):
    path = tmp_path / "stage.usda"
    path.write_text("#usda 1.0\n" + body(scheme))
    (found,) = read_scene(open_stage(path, selection=Selection(complexity=complexity))).meshes
    assert len(found.faces) == faces
    if faces > 12:
        # The surface lies within distance 1 of the origin, and its normals point outward.
        assert np.linalg.norm(found.points, axis=1).max() < 1
        outward = np.einsum("ij,ij->i", found.normals, found.points / np.linalg.norm(found.points, axis=1)[:, None])
        assert outward.min() > 0.9


def test_creases_split_normals_and_left_handed_ones_point_outward(scene):
    more = """int[] creaseIndices = [4, 5, 7, 6, 4]
        int[] creaseLengths = [5]
        float[] creaseSharpnesses = [10]
        uniform token orientation = "%s" """
    for orientation in ("rightHanded", "leftHanded"):
        (found,) = scene(body("catmullClark", more % orientation)).meshes
        top = found.normals[np.isclose(found.points[:, 2], 1)]
        up = 1 if orientation == "rightHanded" else -1
        assert np.isclose(found.points[:, 2].max(), 1)
        assert np.allclose(top[np.abs(top[:, 2]) > 0.5], [0, 0, up])
        assert np.any(np.abs(top[:, 2]) < 0.5)


@pytest.mark.parametrize(
    ("channels", "corner"),
    [("all", 0), ("boundaries", 0), ("cornersPlus1", 0), ("cornersOnly", 0), ("none", 1 / 24)],
)
def test_texture_coordinates_are_smoothed_as_the_mesh_says(scene, channels, corner):
    st = ", ".join(f"({k}, {k}), ({k + 1}, {k}), ({k + 1}, {k + 1}), ({k}, {k + 1})" for k in range(0, 12, 2))
    more = f"""texCoord2f[] primvars:st = [{st}] (interpolation = "faceVarying")
        uniform token faceVaryingLinearInterpolation = "{channels}" """
    (found,) = scene(body("catmullClark", more)).meshes
    # Each quad is a chart of its own. Its corners stay, or its boundary is a closed B-spline, which is
    # (a + 23 b + 23 c + d) / 48 midway between b and c.
    assert found.uvs.min() == pytest.approx(corner)
    assert found.uvs.max() == pytest.approx(11 - corner)


def test_faces_of_subsets_and_holes_keep_their_numbers(scene):
    more = """int[] holeIndices = [0]
        def GeomSubset "Top" {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
        }"""
    found = {each.name: each for each in scene(body("catmullClark", more)).meshes}
    assert len(found["/M/Top"].faces) == 32
    assert len(found["/M"].faces) == 128
    assert found["/M/Top"].points[:, 2].min() > 0.4


def test_a_single_quad_stays_one(scene):
    quad = body("catmullClark").replace("[4, 4, 4, 4, 4, 4]", "[4]")
    quad = quad.replace(f"[{', '.join(map(str, CUBE))}]", "[4, 5, 7, 6]")
    (found,) = scene(quad).meshes
    assert len(found.faces) == 2


def test_wrong_creases_are_left_out_with_a_warning(scene, caplog):
    more = "int[] creaseIndices = [4, 5, 7]\nint[] creaseLengths = [5]\nfloat[] creaseSharpnesses = [10]"
    assert len(scene(body("catmullClark", more)).meshes[0].faces) == 192
    assert "/M.creaseLengths sums to 5: expected 3, as many as creaseIndices; creases are left out" in caplog.text
