"""Meshes and gprims, in world space."""

import logging

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import read_scene

QUAD = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""
CUBE = """
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
    point3f[] points = [
        (-1, -1, -1), (1, -1, -1), (-1, 1, -1), (1, 1, -1), (-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1)]
"""


def mesh(body, name="M", extra=""):
    return f'def Mesh "{name}" {extra}\n{{\n{body}\n}}\n'


def only(scene):
    (result,) = scene.meshes
    return result


def face_normals(mesh):
    a, b, c = (mesh.points[mesh.faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def volume(mesh):
    a, b, c = (mesh.points[mesh.faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_a_quad_becomes_two_triangles_and_shares_its_points(scene):
    result = only(scene(mesh(QUAD)))
    assert result.name == "/M"
    assert result.points.shape == (4, 3)
    assert result.faces.shape == (2, 3)
    assert result.normals is None
    assert result.uvs is None


def test_transforms_of_all_ancestors_reach_the_points(scene):
    text = f"""def Xform "A" {{
        double3 xformOp:translate = (10, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Xform "B" {{
            float xformOp:rotateZ = 90
            uniform token[] xformOpOrder = ["xformOp:rotateZ"]
            {mesh(QUAD)}
        }}
    }}"""
    assert np.allclose(only(scene(text)).points.max(axis=0), [10, 1, 0])
    assert np.allclose(only(scene(text)).points.min(axis=0), [9, 0, 0])


def test_left_handed_faces_are_turned_round(scene):
    right = only(scene(mesh(QUAD)))
    left = only(scene(mesh(QUAD + 'uniform token orientation = "leftHanded"', "L")))
    assert np.all(face_normals(right)[:, 2] > 0)
    assert np.all(face_normals(left)[:, 2] < 0)


def test_a_mirroring_transform_keeps_the_outside_out(scene):
    mirrored = """
        float3 xformOp:scale = (-2, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]"""
    result = only(scene(mesh(CUBE + mirrored)))
    assert volume(result) == pytest.approx(16)
    # The smooth normals point outward as well.
    assert np.all(np.einsum("ij,ij->i", result.normals, result.points) > 0)


def test_authored_normals_go_by_the_inverse_transpose(scene):
    text = mesh(
        QUAD
        + """
        normal3f[] normals = [(0.6, 0, 0.8), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (interpolation = "vertex")
        float3 xformOp:scale = (1, 1, -4)
        uniform token[] xformOpOrder = ["xformOp:scale"]"""
    )
    result = only(scene(text))
    expected = np.array([0.6, 0, -0.2]) / np.hypot(0.6, 0.2)
    assert np.allclose(result.normals[np.argmin(result.points.sum(axis=1))], expected)


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [
        ("constant", "[(0, 0, 1)]"),
        ("uniform", "[(0, 0, 1)]"),
        ("vertex", "[(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, 0, 1)]"),
        ("varying", "[(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, 0, 1)]"),
        ("faceVarying", "[(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, 0, 1)]"),
    ],
)
@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_of_every_interpolation(scene, interpolation, values, name):
    text = mesh(f'{QUAD}\nnormal3f[] {name} = {values} (interpolation = "{interpolation}")')
    result = only(scene(text))
    assert len(result.points) == 4
    expected = [0, 1, 0] if values.count("(") == 4 else [0, 0, 1]
    corner = np.argmax(np.all(result.points == [1, 0, 0], axis=1))
    assert np.allclose(result.normals[corner], expected)


def test_primvars_normals_win_over_normals(scene):
    text = mesh(
        f"""{QUAD}
        normal3f[] normals = [(0, 1, 0)] (interpolation = "constant")
        normal3f[] primvars:normals = [(1, 0, 0)] (interpolation = "constant")"""
    )
    assert np.allclose(only(scene(text)).normals, [1, 0, 0])


def test_subdivision_meshes_without_normals_are_smooth_and_others_faceted(scene):
    smooth = only(scene(mesh(CUBE)))
    assert len(smooth.points) == 8
    assert np.allclose(smooth.normals, smooth.points / np.sqrt(3))
    assert only(scene(mesh(CUBE + 'uniform token subdivisionScheme = "none"', "B"))).normals is None
    assert only(scene(mesh(CUBE + 'uniform token subdivisionScheme = "bilinear"', "C"))).normals is None


def test_a_normal_of_zero_is_replaced_by_that_of_its_face(scene):
    text = mesh(f'{QUAD}\nnormal3f[] normals = [(0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (interpolation = "vertex")')
    assert np.allclose(only(scene(text)).normals, [0, 0, 1])


@pytest.mark.parametrize(
    ("interpolation", "values", "indices"),
    [
        ("vertex", "[(0, 0), (1, 0), (1, 1), (0, 1)]", ""),
        ("varying", "[(0, 0), (1, 0), (1, 1), (0, 1)]", ""),
        ("faceVarying", "[(0, 0), (1, 0), (1, 1), (0, 1)]", ""),
        ("faceVarying", "[(1, 1), (0, 1), (0, 0), (1, 0)]", "[2, 3, 0, 1]"),
        ("constant", "[(0.5, 0.5)]", ""),
        ("uniform", "[(0.5, 0.5)]", ""),
    ],
)
def test_texture_coordinates_of_every_interpolation(scene, interpolation, values, indices):
    text = f'{QUAD}\ntexCoord2f[] primvars:st = {values} (interpolation = "{interpolation}")'
    if indices:
        text += f"\nint[] primvars:st:indices = {indices}"
    result = only(scene(mesh(text)))
    expected = result.points[:, :2] if values.count("(") == 4 else [0.5, 0.5]
    assert np.allclose(result.uvs, expected)


def test_vertices_are_split_only_where_texture_coordinates_differ(scene):
    body = """
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 0), (0.5, 0.5), (0, 1)] (
            interpolation = "faceVarying")"""
    result = only(scene(mesh(body)))
    assert len(result.points) == 5
    assert len(result.faces) == 2


def test_hidden_guide_and_proxy_prims_are_no_surfaces(scene):
    text = (
        mesh(QUAD + 'token visibility = "invisible"', "A")
        + mesh(QUAD + 'uniform token purpose = "guide"', "B")
        + mesh(QUAD + 'uniform token purpose = "proxy"', "C")
        + mesh(QUAD + 'uniform token purpose = "render"', "D")
        + f'def Xform "E" {{\n token visibility = "invisible"\n{mesh(QUAD)}\n}}\n'
        + f'class "F" {{\n{mesh(QUAD)}\n}}\n'
        + f'def "G" (active = false) {{\n{mesh(QUAD)}\n}}\n'
    )
    assert [each.name for each in scene(text).meshes] == ["/D"]


@pytest.mark.parametrize(("field", "usual", "line"), [
    ("seen", True, "bool visibleInPrimaryRay = 0"), ("seen", True, "bool primvars:arnold:visibility:camera = 0"),
    ("seen", True, "int primvars:ri:attributes:visibility:camera = 0"),
    ("seen", True, 'string primvars:karma:object:rendervisibility = "-primary"'),
    ("blocks", True, "bool primvars:arnold:visibility:shadow = 0"),
    ("blocks", True, "int primvars:ri:attributes:visibility:transmission = 0"),
    ("blocks", True, 'string primvars:karma:object:rendervisibility = "-primary&-shadow"'),
    ("holdout", False, "bool primvars:arnold:matte = 1"),
    ("holdout", False, "int primvars:karma:object:holdoutmode = 1"),
])  # fmt: skip
def test_surfaces_are_hidden_from_rays_as_other_programs_say_it(scene, field, usual, line):
    ball = 'def Sphere "Ball" {\n}\n'
    texts = ball.replace("{", "{\n" + line), f'def Xform "All" {{\n{line}\n{ball}}}\n', ball
    (own,), (inherited,), (plain,) = (scene(text).meshes for text in texts)
    assert [getattr(each, field) for each in (own, inherited, plain)] == [not usual, not usual, usual]


def test_points_deform_with_time(usd):
    body = QUAD.replace(
        "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]",
        """point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
            3: [(0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)]}""",
    )
    stage = usd(mesh(body))
    assert np.allclose(only(read_scene(stage, 2)).points[:, 2], 1)
    # At the default time there is no value: the first sample is used.
    assert np.allclose(only(read_scene(stage)).points[:, 2], 0)


SAMPLES = (
    "point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 3: "
    "[(0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)] }"
)
FALLING = (
    "vector3f[] velocities.timeSamples = { 1: [(0, 0, -6), (0, 0, 0), (0, 0, 6), (0, 0, 9)], 3: "
    "[(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)] }"
)
DRAWN = "vector3f[] accelerations.timeSamples = { 1: [(1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0)], 3: [] }"


def flying(body):
    return mesh(QUAD.replace("point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]", SAMPLES) + body)


def test_velocities_carry_points_as_usd_has_it(usd):
    stage = usd(flying(f"{FALLING}\n{DRAWN}"))
    points = UsdGeom.PointBased(stage.GetPrimAtPath("/M"))
    for time, base in ((1, 1), (2, 2), (2.5, 1.5), (0.5, 1), (-3, -3), (4, 4)):
        found = only(read_scene(stage, time, base=base)).points
        assert np.allclose(found, np.array(points.ComputePointsAtTime(time, base)), atol=1e-6)
    # At the default time the first sample is used, unchanged.
    assert np.allclose(only(read_scene(stage)).points[:, 2], 0)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (FALLING.replace("3:", "4:"), "the same time samples as those of points"),
        (
            "vector3f[] velocities = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]",
            "the same time samples as those of points",
        ),
        ("vector3f[] velocities.timeSamples = { 1: [(0, 0, 1)], 3: [] }", "4 values, as points has at time 1"),
    ],
)
def test_velocities_that_fit_no_sample_are_named_and_points_interpolated(usd, caplog, body, expected):
    stage = usd(flying(body))
    assert np.allclose(only(read_scene(stage, 2)).points[:, 2], 1)
    assert [record.message.partition("/M")[2] for record in caplog.records] == [
        f".velocities is not used: expected {expected}"
    ]


def test_velocities_that_are_not_finite_are_an_error(usd):
    with pytest.raises(SceneError, match=r"/M\.velocities\[1\] is .*nan.*"):
        read_scene(usd(flying(FALLING.replace("(0, 0, 0)", "(0, nan, 0)"))), 2, Warnings(strict=True))


def test_holes_are_left_out(scene):
    body = CUBE + 'int[] holeIndices = [1]\nuniform token subdivisionScheme = "none"'
    assert len(only(scene(mesh(body))).faces) == 10


def test_materials_of_face_subsets_split_the_mesh(scene):
    body = f"""{CUBE}
        uniform token subdivisionScheme = "none"
        rel material:binding = </Red>
        def GeomSubset "Top" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1, 3]
            rel material:binding = </Blue>
        }}"""
    result = scene(
        mesh(body, extra='(prepend apiSchemas = ["MaterialBindingAPI"])')
        + color("Red", "(1, 0, 0)")
        + color("Blue", "(0, 0, 1)")
    )
    assert {each.name: (len(each.faces), each.material.diffuse) for each in result.meshes} == {
        "/M/Top": (4, (0, 0, 1)),
        "/M": (8, (1, 0, 0)),
    }


def color(name, value):
    return f"""def Material "{name}" {{
        token outputs:surface.connect = </{name}/S.outputs:surface>
        def Shader "S" {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = {value}
            token outputs:surface
        }}
    }}
    """


def test_a_subset_has_those_of_its_faces_that_are_there(scene, caplog):
    body = f"""{QUAD}
        def GeomSubset "S" {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [7, 0]
        }}"""
    assert [each.name for each in scene(mesh(body)).meshes] == ["/M/S"]
    assert "/M/S.indices names face 7: expected faces from 0 to 0; the others are used" in caplog.text


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            QUAD.replace("[0, 1, 2, 3]", "[0, 1, 2, 9]"),
            r"/M\.faceVertexIndices names point 9",
        ),
        (QUAD.replace("[0, 1, 2, 3]", "[0, 1, 2, -1]"), r"/M\.faceVertexIndices names point -1"),
        (QUAD.replace("[4]", "[5]"), r"/M\.faceVertexIndices has 4 values"),
        (QUAD.replace("(1, 1, 0)", "(1, nan, 0)"), r"/M\.points\[2\] is .*"),
    ],
)
def test_contradictions_are_errors_that_name_prim_and_attribute(scene, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(mesh(body))


def test_empty_meshes_and_faces_without_area_are_skipped_with_a_warning(scene, caplog):
    degenerate = """
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 0, 1]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
        uniform token subdivisionScheme = "none" """
    with caplog.at_level(logging.WARNING, "photonbeams"):
        result = scene(mesh("", "Empty") + mesh(degenerate, "Bad"))
    assert len(only(result).faces) == 1
    assert [record.getMessage().split("stage.usda: ")[1] for record in caplog.records] == [
        "/Empty has no faces: it is skipped",
        "/Bad has 1 faces without area: they are skipped",
    ]


def test_a_warning_is_given_once_for_all_frames(usd, caplog):
    stage = usd(mesh("", "Empty"))
    warnings = Warnings()
    for frame in range(3):
        read_scene(stage, frame, warnings)
    assert len(caplog.records) == 1
    assert len(warnings.given) == 1


GPRIMS = {
    'Cube "G" { double size = 3 }': (27.0, 0),
    'Sphere "G" { double radius = 2 }': (4 / 3 * np.pi * 8, 0.006),
    'Cylinder "G" { double radius = 2\n double height = 3\n uniform token axis = "X" }': (np.pi * 4 * 3, 0.002),
    'Cylinder_1 "G" { double radiusTop = 1\n double radiusBottom = 2\n double height = 3 }': (np.pi * 7, 0.002),
    'Cone "G" { double radius = 2\n double height = 3\n uniform token axis = "Y" }': (np.pi * 4, 0.002),
    'Capsule "G" { double radius = 1\n double height = 2\n uniform token axis = "Y" }': (np.pi * (2 + 4 / 3), 0.005),
}


@pytest.mark.parametrize("text", GPRIMS)
def test_gprims_have_the_volume_and_the_bounds_of_the_shape(usd, text):
    # The facets lie inside the shape: with 64 of them around, a cross-section loses 1 − sin(2π/64) / (2π/64), or
    # 0.16 %, of its area.
    stage = usd(f"def {text}")
    result = only(read_scene(stage))
    expected, loss = GPRIMS[text]
    assert expected * (1 - loss) <= volume(result) <= expected * (1 + 1e-9)
    bounds = UsdGeom.Gprim(stage.GetPrimAtPath("/G")).ComputeWorldBound(0, "default").ComputeAlignedRange()
    # USD's bounds of a Cylinder_1 do not depend on which of its radii is at which end.
    assert np.allclose(result.points.max(axis=0), bounds.GetMax(), atol=0.01)
    assert np.allclose(result.points.min(axis=0), bounds.GetMin(), atol=0.01)
    if result.normals is not None:
        facing = face_normals(result) / np.linalg.norm(face_normals(result), axis=1, keepdims=True)
        assert np.all(np.einsum("ij,ikj->ik", facing, result.normals[result.faces]) > 0.98)


def test_a_plane_faces_its_axis(scene):
    result = only(scene('def Plane "G" { double width = 2\n double length = 4\n uniform token axis = "Y" }'))
    assert np.allclose(result.normals, [0, 1, 0])
    assert np.all(face_normals(result)[:, 1] > 0)
    assert np.allclose(np.sort(np.ptp(result.points, axis=0)), [0, 2, 4])


def test_without_a_material_display_color_is_the_diffuse_colour(scene, caplog):
    body = QUAD + 'color3f[] primvars:displayColor = [(0.1, 0.2, 0.3)] (interpolation = "constant")'
    assert only(scene(mesh(body))).material.diffuse == pytest.approx((0.1, 0.2, 0.3))
    varying = '[(0, 0, 0), (1, 0, 0), (1, 0, 0), (0, 0, 0)] (interpolation = "vertex")'
    result = only(scene(mesh(QUAD + f"color3f[] primvars:displayColor = {varying}", "V")))
    assert result.material.diffuse.values.shape == (4, 3)
    for point, color in zip(result.points, result.material.diffuse.values, strict=True):
        assert color.tolist() == [point[0], 0, 0]
    assert not caplog.text


def test_faces_have_colours_and_opacities_of_their_own(scene):
    body = """
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "uniform")
        float[] primvars:displayOpacity = [1, 0.5] (interpolation = "uniform")"""
    result = only(scene(mesh(body)))
    assert len(result.points) == 6  # each face has its own points
    found = result.material.diffuse.values[result.faces], result.material.opacity.values[result.faces]
    assert found[0].tolist() == [[[1, 0, 0]] * 3, [[0, 1, 0]] * 3]
    assert found[1].tolist() == [[[1]] * 3, [[0.5]] * 3]
    assert result.material.presence


def test_colours_that_do_not_fit_the_mesh_are_left_out_with_a_warning(scene, caplog):
    body = QUAD + 'color3f[] primvars:displayColor = [(0, 0, 0), (1, 0, 0)] (interpolation = "vertex")'
    assert only(scene(mesh(body, "V"))).material.diffuse == (0.18, 0.18, 0.18)
    assert "/V.primvars:displayColor has 2 values of interpolation 'vertex': expected 4; it is left out" in caplog.text


def bounds_of(stage, path):
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default", "render"])
    found = cache.ComputeWorldBound(stage.GetPrimAtPath(path)).ComputeAlignedRange()
    return np.array(found.GetMin()), np.array(found.GetMax())


def test_scenegraph_instances_land_where_usd_has_their_bounds(usd):
    stage = usd(f"""
        class "Proto" {{
            def Xform "Part" {{
                double3 xformOp:translate = (0, 3, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
                {mesh(CUBE)}
            }}
        }}
        def Xform "A" (instanceable = true
            references = </Proto>) {{
            double3 xformOp:translate = (5, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}
        def Xform "B" (instanceable = true
            references = </Proto>) {{
            float xformOp:rotateZ = 30
            uniform token[] xformOpOrder = ["xformOp:rotateZ"]
        }}""")
    result = {each.name: each for each in read_scene(stage).meshes}
    assert sorted(result) == ["/A/Part/M", "/B/Part/M"]
    for name, each in result.items():
        low, high = bounds_of(stage, name.split("/Part")[0])
        assert np.allclose(each.points.min(axis=0), low, atol=1e-5)
        assert np.allclose(each.points.max(axis=0), high, atol=1e-5)


INSTANCER = """
def PointInstancer "I" {
    rel prototypes = [</I/P/Cube>, </I/P/Ball>]
    int[] protoIndices = [0, 1, 0, 1]
    point3f[] positions = [(0, 0, 0), (5, 0, 0), (10, 0, 0), (15, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (0.924, 0, 0, 0.383), (0.924, 0, 0.383, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 2, 1), (0.5, 0.5, 0.5), (1, 1, 1)]
    int64[] ids = [7, 8, 9, 10]
    int64[] invisibleIds = [%s]
    float3 xformOp:scale = (1, 1, 2)
    double3 xformOp:translate = (0, 0, 4)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    over "P" {
        def Cube "Cube" {
            double3 xformOp:translate = (0, 1, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
        def Cube "Ball" { double size = 1 }
    }
}"""


def test_point_instances_land_where_usd_has_their_bounds(usd):
    stage = usd(INSTANCER % "")
    result = read_scene(stage).meshes
    assert [each.name for each in result] == ["/I[0]", "/I[1]", "/I[2]", "/I[3]"]
    low, high = bounds_of(stage, "/I")
    assert np.allclose(np.min([each.points.min(axis=0) for each in result], axis=0), low, atol=1e-3)
    assert np.allclose(np.max([each.points.max(axis=0) for each in result], axis=0), high, atol=1e-3)


MOVED = """def PointInstancer "I" {
    rel prototypes = [</I/Ball>]
    int[] protoIndices.timeSamples = { 1: [0, 0], 2: [0] }
    point3f[] positions.timeSamples = { 1: [(0, 0, 0), (5, 0, 0)], 2: [(7, 0, 0)] }
    vector3f[] velocities.timeSamples = { 1: [(0, 0, 24), (0, 0, 24)], 2: [(0, 24, 0)] }
    def Cube "Ball" {
    }
}"""


def test_velocities_carry_the_instances_of_the_frame(usd):
    stage = usd(MOVED, "timeCodesPerSecond = 24")
    (ball,) = read_scene(stage, 1.75, base=2).meshes
    assert ball.points.mean(axis=0) == pytest.approx([7, -0.25, 0])
    assert [each.points.mean(axis=0)[2] for each in read_scene(stage, 1.75).meshes] == pytest.approx([0.75, 0.75])
    # At the default time the first sample is used, unchanged.
    assert [each.points.mean(axis=0)[2] for each in read_scene(stage).meshes] == pytest.approx([0, 0])


def test_hidden_point_instances_are_not_there(usd):
    assert [each.name for each in read_scene(usd(INSTANCER % "8, 10")).meshes] == ["/I[0]", "/I[2]"]


def test_instances_of_a_prototype_that_is_not_there_are_skipped(scene, caplog):
    meshes = scene((INSTANCER % "").replace("[0, 1, 0, 1]", "[0, 1, 0, 2]")).meshes
    assert [each.name for each in meshes] == ["/I[0]", "/I[1]", "/I[2]"]
    assert "/I.protoIndices names prototype 2, which is not there: 1 of 4 instances are skipped" in caplog.text
    meshes = scene((INSTANCER % "").replace("</I/P/Cube>", "</I/P/Gone>")).meshes
    assert [each.name for each in meshes] == ["/I[1]", "/I[3]"]


@pytest.mark.parametrize(("positions", "count"), [("(15, 0, 0), (1, 1, 1)]", 4), ("]", 3)])
def test_point_instances_that_are_complete_are_where_they_are_without_the_others(scene, caplog, positions, count):
    whole = scene(INSTANCER % "").meshes
    meshes = scene((INSTANCER % "").replace("(15, 0, 0)]", positions)).meshes
    assert f"values: expected 4, as many as protoIndices; {count} are rendered" in caplog.text
    assert [each.name for each in meshes] == [each.name for each in whole[:count]]
    # The matrices are computed in another way, so points agree to the rounding of USD's half and single precision.
    assert all(np.allclose(a.points, b.points, atol=1e-5) for a, b in zip(meshes, whole, strict=False))


def test_prims_of_a_prototype_have_the_nearest_purpose_above_them(scene):
    """As UsdGeomImageable computes it: a prim's own purpose counts before that of its ancestors."""
    text = """def PointInstancer "I" {
        rel prototypes = [</I/P>]
        int[] protoIndices = [0]
        point3f[] positions = [(0, 0, 0)]
        def Xform "P" {
            uniform token purpose = "guide"
            def Cube "Shown" { uniform token purpose = "default" }
            def Cube "Guide" { }
            def Xform "Hidden" {
                token visibility = "invisible"
                def Cube "Cube" { uniform token purpose = "default" }
            }
        }
    }"""
    assert [each.name for each in scene(text).meshes] == ["/I[0]/Shown"]


def test_an_instancer_within_its_own_prototypes_ends(usd, caplog):
    text = """def PointInstancer "I" {
        rel prototypes = [</I/P>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (5, 0, 0)]
        def Xform "P" {
            def Cube "Cube" { }
            def PointInstancer "J" {
                rel prototypes = [</I>]
                int[] protoIndices = [0, 0]
                point3f[] positions = [(0, 0, 0), (5, 0, 0)]
            }
        }
    }"""
    assert len(read_scene(usd(text)).meshes) == 2
    assert "/I.prototypes contains the instancer itself: expected prims that do not; it is skipped" in caplog.text
