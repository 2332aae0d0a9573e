"""UsdLux lights: what they emit, and where they are."""

import numpy as np
import pytest

from photonbeams.scene import (
    BLACK,
    CylinderLight,
    DistantLight,
    DomeLight,
    FlatLight,
    MeshLight,
    SceneError,
    Shaping,
    SphereLight,
)
from photonbeams.scene.vectors import ellipse_perimeter, ellipsoid_area
from photonbeams.usd.common.openusd import Usd
from photonbeams.usd.stage import read_scene

SCALED = """
    double3 xformOp:translate = (1, 2, 3)
    float3 xformOp:scale = (2, 3, 4)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
"""
PORTAL = """
def Mesh "Window" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
}
"""


def light(kind, body="", extra=""):
    return f'def {kind} "L" {extra}\n{{\n{body}\n}}\n'


def only(scene):
    (result,) = scene.lights
    return result


def test_radiance_is_intensity_exposure_and_color(scene):
    text = light(
        "RectLight", "float inputs:intensity = 3\nfloat inputs:exposure = 2\ncolor3f inputs:color = (1, 0.5, 0)"
    )
    assert only(scene(text)).radiance == (12, 6, 0)


def test_a_lights_colour_is_converted_from_its_space(scene, caplog):
    text = 'color3f inputs:color = %s (\ncolorSpace = "%s"\n)'
    assert only(scene(light("RectLight", text % ((0.5, 1, 0), "srgb_texture")))).radiance == pytest.approx(
        (0.214, 1, 0), abs=1e-3
    )
    assert only(scene(light("RectLight", text % ((0.5, 1, 0), "lin_rec709")))).radiance == (0.5, 1, 0)
    assert not caplog.text
    assert only(scene(light("RectLight", text % ((0, 1, 0), "acescg")))).radiance == pytest.approx(
        (0, 1.1407, 0), abs=1e-3
    )
    assert "/L.inputs:color is (-0.6" in caplog.text


def test_metres_per_unit_do_not_change_a_light(scene):
    body = "float inputs:intensity = 7\nbool inputs:normalize = 1"
    inches, metres = (only(scene(light("DiskLight", body), f"metersPerUnit = {unit}")) for unit in (0.0254, 1))
    assert repr(inches) == repr(metres)


@pytest.mark.parametrize(
    ("kind", "body", "apis"),
    [
        ("CylinderLight", 'bool treatAsLine = 1\nuniform token light:shaderId = "Other"', ""),
        ("SphereLight", 'token lightList:cacheBehavior = "ignore"', '"LightListAPI"'),
        ("RectLight", "float inputs:shadow:falloffGamma = 3", '"ShadowAPI"'),
        ("DomeLight", "float guideRadius = 3\nrel portals = </L>\nbool inputs:normalize = 1", ""),
    ],
)
def test_what_has_no_effect_on_a_light_is_left_alone(scene, caplog, kind, body, apis):
    applied = f"(prepend apiSchemas = [{apis}])" if apis else ""
    assert repr(only(scene(light(kind, body, applied)))) == repr(only(scene(light(kind))))
    assert not caplog.text


@pytest.mark.parametrize("kind", ["DistantLight", "DomeLight"])
def test_shaping_of_a_light_at_infinity_is_named(scene, caplog, kind):
    applied = '(prepend apiSchemas = ["ShapingAPI"])'
    assert only(scene(light(kind, "float inputs:shaping:cone:angle = 180", applied))).shaping is None
    assert not caplog.text
    assert only(scene(light(kind, "float inputs:shaping:focus = 2", applied))).shaping is None
    assert "/L has shaping, which is not rendered on a light that is infinitely far away" in caplog.text


def test_color_temperature_multiplies_where_it_is_enabled(scene):
    warm = only(
        scene(light("RectLight", "bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000"))
    )
    assert warm.radiance[0] > 1.5 > 1 > warm.radiance[1] > warm.radiance[2]
    assert only(scene(light("SphereLight", "float inputs:colorTemperature = 3000"))).radiance == (1, 1, 1)


def test_color_temperature_of_6500_is_white(scene):
    assert only(scene(light("RectLight", "bool inputs:enableColorTemperature = 1"))).radiance == pytest.approx(
        (1, 1, 1)
    )


@pytest.mark.parametrize(
    "kind", ["SphereLight", "RectLight", "DiskLight", "CylinderLight", "DistantLight", "DomeLight"]
)
def test_what_is_not_authored_has_the_fallback_of_its_schema(scene, kind):
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition(kind)
    names = [name for name in definition.GetPropertyNames() if definition.GetAttributeDefinition(name)]
    body = []
    for name in names:
        attribute = definition.GetAttributeDefinition(name)
        value = attribute.GetFallbackValue()
        if name.startswith(("inputs:", "treatAs")) and isinstance(value, bool | float | int):
            body.append(f"{attribute.GetTypeName()} {name} = {float(value):g}")
    assert len(body) >= 7
    assert repr(only(scene(light(kind)))) == repr(only(scene(light(kind, "\n".join(body)))))


@pytest.mark.parametrize(
    ("kind", "body", "area"),
    [
        ("RectLight", "float inputs:width = 2\nfloat inputs:height = 0.5", 2 * 2 * 0.5 * 3),
        ("DiskLight", "float inputs:radius = 0.5", np.pi * 0.5 * 2 * 0.5 * 3),
        ("SphereLight", "float inputs:radius = 0.5", ellipsoid_area(np.array([1.0, 1.5, 2.0]))),
    ],
)
def test_normalized_lights_are_divided_by_their_area_in_world_space(scene, kind, body, area):
    result = only(scene(light(kind, f"{body}\nfloat inputs:intensity = 7\nbool inputs:normalize = 1\n{SCALED}")))
    assert result.radiance == pytest.approx((7 / area,) * 3)


def test_lights_without_normalize_keep_their_radiance_at_any_size(scene):
    assert only(scene(light("DiskLight", f"float inputs:intensity = 7\n{SCALED}"))).radiance == (7, 7, 7)


@pytest.mark.parametrize(("angle", "half"), [(1.0, 0.5), (90.0, 45.0)])
def test_a_normalized_distant_light_gives_its_intensity_as_irradiance(scene, angle, half):
    body = f"float inputs:intensity = 5\nfloat inputs:angle = {angle}\nbool inputs:normalize = 1"
    result = only(scene(light("DistantLight", body)))
    assert isinstance(result, DistantLight)
    # The irradiance of a disc of sky of half angle θ is π sin²θ times its radiance.
    assert result.radiance[0] * np.pi * np.sin(np.radians(half)) ** 2 == pytest.approx(5)


@pytest.mark.parametrize("normalize", [0, 1])
def test_a_distant_light_of_no_angle_holds_its_irradiance(scene, normalize):
    body = f"float inputs:intensity = 5\nfloat inputs:angle = 0\nbool inputs:normalize = {normalize}"
    assert only(scene(light("DistantLight", body))).radiance == (5, 5, 5)


def test_a_distant_light_has_its_radiance_without_normalize(scene):
    turned = 'float xformOp:rotateX = 90\nuniform token[] xformOpOrder = ["xformOp:rotateX"]'
    result = only(scene(light("DistantLight", f"float inputs:intensity = 5\n{turned}")))
    assert result.radiance == (5, 5, 5)
    assert result.angle == pytest.approx(0.53)
    assert np.allclose(result.axis, [0, 1, 0])


@pytest.mark.parametrize("body", ["bool treatAsPoint = 1", "float inputs:radius = 0"])
def test_a_point_is_the_limit_of_the_normalized_sphere(scene, body):
    body += "\nbool inputs:normalize = 1"
    point = only(scene(light("SphereLight", f"float inputs:intensity = 8\n{body}")))
    small = only(
        scene(
            light("SphereLight", "float inputs:intensity = 8\nfloat inputs:radius = 0.001\nbool inputs:normalize = 1")
        )
    )
    assert point.radius == 0
    assert point.radiance == pytest.approx(np.array(small.radiance) * np.pi * small.radius**2)
    assert point.radiance[0] == 2


@pytest.mark.parametrize("normalize", [0, 1])
@pytest.mark.parametrize("scale", ["(1, 1, 1)", "(2, 3, 4)", "(-0.2, 5, 1)"])
@pytest.mark.parametrize("radius", [0.1, 0.5, 3.0])
def test_treating_a_sphere_as_a_point_does_not_change_its_power(scene, radius, scale, normalize):
    body = f"""float inputs:intensity = 7
        float inputs:radius = {radius}
        bool inputs:normalize = {normalize}
        float3 xformOp:scale = {scale}
        uniform token[] xformOpOrder = ["xformOp:scale"]"""
    sphere, point = (only(scene(light("SphereLight", f"{body}\nbool treatAsPoint = {hint}"))) for hint in (0, 1))
    assert (sphere.radius > 0, point.radius) == (True, 0)
    # A point of intensity I has the power 4π I, and a sphere of radiance L the power 4π² r² L.
    assert 4 * np.pi * point.radiance[0] == pytest.approx(4 * np.pi**2 * sphere.radius**2 * sphere.radiance[0])
    assert (sphere.shape is None) == (scale == "(1, 1, 1)")
    assert point.shape is None


@pytest.mark.parametrize("kind", ["SphereLight", "CylinderLight"])
def test_a_light_without_a_radius_says_that_it_shines_as_if_normalized(scene, caplog, kind):
    hint = "treatAsPoint" if kind == "SphereLight" else "treatAsLine"
    found = [
        only(scene(light(kind, f"float inputs:radius = 0\nbool {each} = 1"))) for each in ("inputs:normalize", hint)
    ]
    assert found[0].radiance == found[1].radiance
    assert not caplog.text
    assert only(scene(light(kind, "float inputs:radius = 0"))).radiance == found[0].radiance
    assert "/L.inputs:radius is 0: without inputs:normalize there would be no light; it shines as if" in caplog.text


def test_a_spot_as_blender_writes_one_has_its_watts_over_four_pi(scene):
    watts = 100
    body = f"""
        float inputs:intensity = {watts / np.pi}
        bool inputs:normalize = 1
        float inputs:radius = 0
        bool treatAsPoint = 1
        bool inputs:enableColorTemperature = 1
        float inputs:shaping:cone:angle = 20
        float inputs:shaping:cone:softness = 0.3"""
    result = only(scene(light("SphereLight", body, '(prepend apiSchemas = ["ShapingAPI"])')))
    assert result.radiance == pytest.approx((watts / (4 * np.pi),) * 3)
    assert (result.shaping.cone_angle, result.shaping.cone_softness) == pytest.approx((20, 0.3))


def test_shaping_is_read_and_there_is_none_where_none_is_authored(scene):
    body = """
        float inputs:shaping:cone:angle = 30
        float inputs:shaping:cone:softness = 2
        float inputs:shaping:focus = 4
        color3f inputs:shaping:focusTint = (1, 0, 0)"""
    shaping = only(scene(light("DiskLight", body, '(prepend apiSchemas = ["ShapingAPI"])'))).shaping
    assert (shaping.cone_angle, shaping.cone_softness, shaping.focus, shaping.focus_tint) == (30, 2, 4, (1, 0, 0))
    assert only(scene(light("SphereLight"))).shaping is None


def test_the_fallbacks_of_shaping_count_where_its_schema_is_applied(scene):
    applied = '(prepend apiSchemas = ["ShapingAPI"])'
    alone, wide = (
        only(scene(light("SphereLight", body, applied))).shaping
        for body in ("", "float inputs:shaping:cone:angle = 90")
    )
    assert alone == wide == Shaping()
    assert only(scene(light("SphereLight", "float inputs:shaping:focus = 2"))).shaping == Shaping(focus=2.0)


def test_shaping_out_of_range_is_named(scene, usd, caplog):
    body = "float inputs:shaping:cone:angle = 200\nfloat inputs:shaping:cone:softness = {}"
    assert only(scene(light("SphereLight", body.format(1.5)))).shaping == Shaping(200.0, 1.5)
    assert not caplog.text
    found = only(read_scene(usd(light("SphereLight", body.format(-0.5)))))
    assert found.shaping == Shaping(200.0, 0.0)
    assert "/L.inputs:shaping:cone:softness is -0.5: expected 0 or more; 0 is used" in caplog.text


def test_flat_lights_take_scale_into_their_half_axes(scene):
    rect = only(scene(light("RectLight", f"float inputs:width = 2\nfloat inputs:height = 0.5\n{SCALED}")))
    assert isinstance(rect, FlatLight)
    assert np.allclose([rect.half_x, rect.half_y, rect.axis], [[2, 0, 0], [0, 0.75, 0], [0, 0, -1]])
    assert np.allclose(rect.center, [1, 2, 3])
    assert rect.area == pytest.approx(6)
    disk = only(scene(light("DiskLight", f"float inputs:radius = 1\n{SCALED}")))
    assert disk.disk
    assert disk.area == pytest.approx(np.pi * 2 * 3)


@pytest.mark.parametrize("scale", ["(-1, 1, 1)", "(1, 1, -1)", "(-1, -1, -1)"])
def test_a_mirrored_flat_light_emits_along_its_mirrored_axis(scene, scale):
    body = f'float3 xformOp:scale = {scale}\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    result = only(scene(light("RectLight", body)))
    assert np.allclose(result.axis, [0, 0, 1 if scale.endswith("-1)") else -1])
    assert np.cross(result.half_x, result.half_y) @ result.axis < 0


def test_a_sphere_under_an_uneven_scale_is_an_ellipsoid(scene, caplog):
    result = only(scene(light("SphereLight", f"float inputs:radius = 0.5\n{SCALED}")))
    assert isinstance(result, SphereLight)
    assert 4 * np.pi * result.radius**2 == pytest.approx(ellipsoid_area(np.array([1.0, 1.5, 2.0])))
    assert np.allclose(result.shape, np.diag([1, 1.5, 2]))
    assert not caplog.text
    round_one = only(scene(light("SphereLight", SCALED.replace("(2, 3, 4)", "(-3, 3, 3)"))))
    assert (round_one.shape, round_one.radius) == (None, 1.5)
    flat = only(scene(light("SphereLight", SCALED.replace("(2, 3, 4)", "(4000, 3, 2)"))))
    assert flat.shape is None
    assert "/L is scaled to 4000 x 3 x 2: it is rendered as a sphere of the same power" in caplog.text
    assert np.allclose(result.center, [1, 2, 3])
    assert np.allclose(result.axis, [0, 0, -1])


def test_hidden_lights_and_lights_scaled_to_nothing_do_not_shine(scene, caplog):
    assert scene(light("SphereLight", 'token visibility = "invisible"')).lights == ()
    assert not caplog.text
    body = 'float3 xformOp:scale = (0, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    assert scene(light("RectLight", body)).lights == ()
    assert "/L is scaled to zero: it is skipped" in caplog.text


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("PluginLight", "is a light of one renderer only, which is not rendered: it is skipped"),
        ("GeometryLight", "is deprecated and not rendered: expected MeshLightAPI on the geometry; it is skipped"),
        ("PortalLight", "is skipped: the light of a dome is sampled by its brightness, without portals"),
        ("PxrEnvDayLight", "is a light of kind PxrEnvDayLight, which is not rendered: it is skipped"),
    ],
)
def test_a_light_of_another_kind_is_skipped_with_a_warning(scene, caplog, kind, message):
    assert scene(light(kind)).lights == ()
    assert f"/L {message}" in caplog.text


def test_a_volume_light_is_named(scene, caplog):
    assert scene(light("Volume", extra='(prepend apiSchemas = ["VolumeLightAPI"])')).lights == ()
    assert "/L is a volume light (VolumeLightAPI), which is not rendered: it does not shine" in caplog.text


def test_what_is_not_rendered_of_a_light_is_named(scene, caplog):
    body = """
        rel light:filters = </L>
        color3f inputs:shadow:color = (0.5, 0, 0)
        float inputs:shadow:falloff = 2
        float inputs:shadow:distance = 3
        float inputs:specular = 0"""
    found = only(scene(light("RectLight", body)))
    assert (found.shadow_distance, found.surface_scale) == (3, 1)
    assert "/L is a RectLight, which is not rendered as a filter: /L shines without it" in caplog.text
    for text in (
        "inputs:shadow:color applies to shadows on surfaces only: beams end where a surface stops them",
        "inputs:shadow:falloff is not rendered: shadows have the same strength everywhere",
        "inputs:shadow:distance applies to shadows on surfaces only: beams end where a surface stops them",
        "inputs:specular is 0 but inputs:diffuse is 1: surfaces use the latter for both",
    ):
        assert f"/L.{text}" in caplog.text


@pytest.mark.parametrize(
    "name", ["bool inputs:visibility:camera", "bool visibleInPrimaryRay", "float primvars:arnold:camera"]
)
def test_a_light_may_be_hidden_from_the_camera_as_other_programs_say_it(scene, name):
    assert only(scene(light("RectLight"))).seen
    assert only(scene(light("RectLight", f"{name} = 1"))).seen
    assert not only(scene(light("RectLight", f"{name} = 0"))).seen


def test_no_surface_blocks_a_light_without_shadows(scene):
    ball = 'def Sphere "Ball" {\n}'
    assert only(scene(light("RectLight", "bool inputs:shadow:enable = 0") + ball)).unshadowed == {"/Ball"}
    assert only(scene(light("RectLight") + ball)).unshadowed == frozenset()


def test_a_cylinder_lies_along_x_and_is_normalized_by_its_mantle(scene, caplog):
    tube = only(scene(light("CylinderLight", f"float inputs:length = 3\nfloat inputs:radius = 0.2\n{SCALED}")))
    assert isinstance(tube, CylinderLight)
    assert np.allclose(tube.half, [3, 0, 0])
    assert 2 * np.pi * tube.radius == pytest.approx(ellipse_perimeter(0.6, 0.8))
    assert np.allclose(tube.shape, np.diag([3, 0.6, 0.8]))
    sheared = "matrix4d xformOp:transform = ((1, 0, 0, 0), (0.5, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"
    sheared += '\nuniform token[] xformOpOrder = ["xformOp:transform"]'
    oblique = only(scene(light("CylinderLight", f"float inputs:length = 3\nfloat inputs:radius = 0.2\n{sheared}")))
    assert (oblique.radius, oblique.shape.tolist()) == (
        pytest.approx(0.2), [[1.5, pytest.approx(0.1), 0], [0, pytest.approx(0.2), 0], [0, 0, pytest.approx(0.2)]],
    )  # fmt: skip
    assert only(scene(light("CylinderLight", SCALED.replace("(2, 3, 4)", "(2, 3, -3)")))).shape is None
    assert not caplog.text
    flat = only(scene(light("CylinderLight", SCALED.replace("(2, 3, 4)", "(2, 3, 4000)"))))
    assert flat.shape is None
    assert "/L is 4000 x 3 across: it is rendered as a round cylinder of the same power" in caplog.text
    assert tube.radiance == (1, 1, 1)
    body = f"bool inputs:normalize = 1\nfloat inputs:intensity = 5\nfloat inputs:length = 3\n{SCALED}"
    assert only(scene(light("CylinderLight", body))).radiance[0] == pytest.approx(5 / (ellipse_perimeter(1.5, 2.0) * 6))


def test_a_line_has_the_intensity_of_the_normalized_cylinder(scene):
    body = "bool treatAsLine = 1\nfloat inputs:radius = 0\nfloat inputs:length = 2\nfloat inputs:intensity = 7"
    line = only(scene(light("CylinderLight", body)))
    # Perpendicular to its axis, a normalized cylinder of area A = 2πrl has the intensity 7 / A · 2rl = 7 / π.
    assert line.radiance[0] * 2 * line.radius * 2 == pytest.approx(7 / np.pi)
    assert line.radius < 0.001


GLOWING = """
def Material "Glow" {
    token outputs:surface.connect = </Glow/S.outputs:surface>
    def Shader "S" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:emissiveColor = (0.5, 1, 2)
        token outputs:surface
    }
}
"""


def mesh_light(body="", api="MeshLightAPI", bound=True):
    binding = "rel material:binding = </Glow>" if bound else ""
    text = light("Cube", f"{body}\n{binding}", f'(prepend apiSchemas = ["{api}", "MaterialBindingAPI"])')
    return GLOWING + text.replace("double size", "")


@pytest.mark.parametrize(
    ("body", "bound", "radiance", "surface"),
    [
        ("", True, (1.5, 3, 0), True),
        ("", False, (3, 3, 0), True),
        ('token light:materialSyncMode = "independent"', True, (3, 3, 0), True),
        ('token light:materialSyncMode = "noMaterialResponse"', True, (3, 3, 0), False),
        ("bool inputs:normalize = 1", False, (3 / 24, 3 / 24, 0), True),
    ],
    ids=["tinted", "no glow", "independent", "no material", "normalized"],
)
def test_a_mesh_light_shines_as_its_material_sync_mode_says(scene, body, bound, radiance, surface):
    found = scene(mesh_light(f"{body}\ncolor3f inputs:color = (1, 1, 0)\nfloat inputs:intensity = 3", bound=bound))
    lamp = only(found)
    assert isinstance(lamp, MeshLight)
    assert lamp.radiance == pytest.approx(radiance)
    assert (lamp.surface, len(found.meshes)) == (surface, int(surface))
    assert lamp.mesh.area == pytest.approx(24)
    assert lamp.emits_beams


def test_a_glowing_mesh_makes_beams_where_asked(scene, caplog):
    asked = only(scene(mesh_light("bool photonbeams:enabled = 1", api="GeomModelAPI")))
    assert (asked.radiance, asked.surface, asked.emits_beams) == ((0.5, 1, 2), True, True)
    assert scene(mesh_light("bool photonbeams:enabled = 1", api="GeomModelAPI", bound=False)).lights == ()
    assert "/L.photonbeams:enabled is to make beams, but its material emits no light: it makes none" in caplog.text


PANEL = """
def Mesh "Panel%d" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (%d, 0, 0), (%d, 1, 0), (0, 1, 0)]
    rel material:binding = </Glow>
    %s
}
"""


DRAWN = """
def BasisCurves "Beams" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"]) {
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, 0, 0), (1, 0, 0)]
    float[] widths = [0.1] (
        interpolation = "constant"
    )
}
"""


def test_a_glowing_mesh_is_a_lamp(scene, caplog):
    alone = only(scene(mesh_light(api="GeomModelAPI")))
    asked = only(scene(mesh_light("bool photonbeams:enabled = 1", api="GeomModelAPI")))
    assert (alone.radiance, alone.emits_beams, alone.both_sides) == (asked.radiance, asked.emits_beams, False)
    assert scene(mesh_light("bool photonbeams:enabled = 0", api="GeomModelAPI")).lights == ()
    other = 'def SphereLight "Other" {\n%s\n}\n'
    _, beside = scene(mesh_light(api="GeomModelAPI") + other % "").lights
    assert (beside.name, beside.radiance, beside.emits_beams, beside.surface) == ("/L", asked.radiance, True, True)
    off = mesh_light("bool photonbeams:enabled = 0", api="GeomModelAPI")
    assert only(scene(off + other % "")).name == "/Other"
    assert only(scene(GLOWING + PANEL % (1, 1, 1, "") + DRAWN)).name == "/Panel1"
    assert not caplog.text
    wide = 'float3 xformOp:scale = (9, 9, 9)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    assert only(scene(mesh_light(wide, api="GeomModelAPI") + 'def Sphere "Ball" {\n}\n')).both_sides  # a sky


def test_a_glowing_sheet_shines_from_both_sides_and_the_brightest_sheets_light_the_scene(scene, caplog):
    sizes = [3, 9, 1, 7, 8, 2, 6, 5, 4, 10]
    found = scene(GLOWING + "".join(PANEL % (number, size, size, "") for number, size in enumerate(sizes))).lights
    assert [each.name for each in found] == [f"/Panel{number}" for number, size in enumerate(sizes) if size > 2]
    assert all(each.both_sides and each.surface for each in found)
    assert "/Panel2 glows, but lights nothing: only the 8 brightest such surfaces are lamps" in caplog.text


def test_a_light_that_lights_everything_gives_no_warning(scene, caplog):
    scene(light("RectLight"))
    assert not caplog.text


def test_a_light_without_diffuse_and_specular_lights_the_fog_alone(scene):
    assert only(scene(light("RectLight"))).lights_surfaces
    body = "float inputs:diffuse = 0\nfloat inputs:specular = 0"
    assert not only(scene(light("DiskLight", body))).lights_surfaces


def test_beam_settings_are_read_with_and_without_the_api_applied(scene):
    body = """
        bool photonbeams:enabled = 0
        int photonbeams:count = 1000
        float photonbeams:intensity = 2
        token photonbeams:lightGroup = "key"
        int photonbeams:seed = 9"""
    for extra in ("", '(prepend apiSchemas = ["PhotonBeamsLightAPI"])'):
        result = only(scene(f'def Scope "S{len(extra)}"\n{{\n{light("SphereLight", body, extra)}\n}}\n'))
        assert (result.emits_beams, result.beam_count, result.beam_scale) == (False, 1000, 2)
        assert (result.group, result.seed) == ("key", 9)


def test_a_light_without_settings_makes_beams_and_a_dome_makes_none_unless_asked(scene):
    assert only(scene(light("SphereLight"))).emits_beams
    assert only(scene(light("SphereLight", "", '(prepend apiSchemas = ["PhotonBeamsLightAPI"])'))).beam_count is None
    assert not only(scene(light("DomeLight"))).emits_beams
    assert not only(scene(light("DomeLight", "", '(prepend apiSchemas = ["PhotonBeamsLightAPI"])'))).emits_beams
    assert only(scene(light("DomeLight", "bool photonbeams:enabled = 1"))).emits_beams


def test_a_portal_is_no_surface(scene):
    text = f'def Xform "W" {{\n{SCALED}\n{PORTAL}\n}}\n' + light("SphereLight", "rel photonbeams:portal = </W/Window>")
    result = scene(text)
    assert result.meshes == ()
    portal = only(result).portal
    assert portal.name == "/W/Window"
    assert np.allclose(portal.points.min(axis=0), [1, 2, 3])
    assert np.allclose(portal.points.max(axis=0), [3, 5, 3])


def test_several_portals_become_one_mesh(scene):
    text = PORTAL + 'def Plane "Door" {\n}\n' + light("SphereLight", "rel photonbeams:portal = [</Window>, </Door>]")
    result = scene(text)
    assert result.meshes == ()
    assert only(result).portal.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]


def test_a_portal_is_no_surface_if_it_comes_after_its_light(scene):
    assert scene(light("SphereLight", "rel photonbeams:portal = </Window>") + PORTAL).meshes == ()


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("", r"/L\.photonbeams:portal names /Window"),
        ('def Xform "Window" {\n}', r"/L\.photonbeams:portal names /Window, a Xform"),
        ('def "Window" {\n}', "names /Window, a prim without a type"),
        (
            PORTAL.replace("(1, 1, 0), (0, 1, 0)", "(2, 0, 0), (3, 0, 0)"),
            "names /Window, which has no area",
        ),
        ('def Mesh "Window" {\n}', r"names /Window, which has no area"),
    ],
)
def test_a_portal_that_lets_no_light_through_is_an_error(scene, target, message):
    with pytest.raises(SceneError, match=message):
        scene(light("SphereLight", "rel photonbeams:portal = </Window>") + target)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("int photonbeams:count = 0", r"/L\.photonbeams:count is 0"),
        ("int photonbeams:count = -5", r"/L\.photonbeams:count is -5"),
        ("int photonbeams:count = 200000000", r"/L\.photonbeams:count is 200000000"),
        ("int64 photonbeams:count = 10000000000", r"/L\.photonbeams:count is 10000000000"),
        ("float photonbeams:intensity = -1", r"/L\.photonbeams:intensity is -1.*"),
        ("float inputs:intensity = nan", r"/L\.inputs:intensity is nan"),
        ("float inputs:intensity = -2", r"/L\.inputs:intensity is -2.*"),
        (
            "color3f inputs:color = (1, -1, 0)",
            r"/L\.inputs:color is .*",
        ),
        ("float inputs:exposure = inf", r"/L\.inputs:exposure is inf"),
        ("float inputs:radius = -1", r"/L\.inputs:radius is -1.*"),
        ('token photonbeams:lightGroup = "a b"', r"/L\.photonbeams:lightGroup is 'a b'"),
        (
            "rel photonbeams:look = </Nowhere>",
            r"/L\.photonbeams:look names /Nowhere",
        ),
        ("rel photonbeams:look = </L>", r"/L\.photonbeams:look names /L, a SphereLight"),
    ],
)
def test_attributes_out_of_range_are_errors_that_name_them(scene, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(light("SphereLight", body))


@pytest.mark.parametrize(("kind", "name"), [("RectLight", "width"), ("RectLight", "height"), ("DiskLight", "radius")])
def test_a_flat_light_without_area_is_an_error(scene, kind, name):
    with pytest.raises(SceneError, match=rf"/L\.inputs:{name} is 0"):
        scene(light(kind, f"float inputs:{name} = 0"))


def test_lights_are_instanced_too(scene):
    text = f"""
        class "Proto" {{
        {light("SphereLight")}
        }}
        def Xform "A" (
            instanceable = true
            references = </Proto>
        ) {{
            double3 xformOp:translate = (5, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}"""
    result = only(scene(text))
    assert result.name == "/A/L"
    assert np.allclose(result.center, [5, 0, 0])


def test_a_dome_has_its_rotation_without_scale(scene):
    body = """
        float xformOp:rotateY = 90
        float3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:rotateY", "xformOp:scale"]"""
    result = only(scene(light("DomeLight", body)))
    assert isinstance(result, DomeLight)
    assert np.allclose(result.to_world @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(result.to_world @ result.to_world.T, np.eye(3))
    assert result.image is None
    assert result.radiance != BLACK


@pytest.mark.parametrize(
    ("up", "axis", "pole", "middle"),
    [
        ("Y", "scene", [0, 1, 0], [0, 0, 1]),
        ("Z", "scene", [0, 0, 1], [0, -1, 0]),
        ("Y", "Z", [0, 0, 1], [0, -1, 0]),
        ("Z", "Y", [0, 1, 0], [0, 0, 1]),
    ],
)
def test_a_dome_light_1_turns_its_pole_to_the_axis(scene, up, axis, pole, middle):
    result = only(scene(light("DomeLight_1", f'uniform token poleAxis = "{axis}"'), f'upAxis = "{up}"'))
    assert np.allclose(result.to_world @ [0, 1, 0], pole)
    assert np.allclose(result.to_world @ [0, 0, 1], middle)


def test_a_dome_light_has_its_pole_on_y_whatever_is_up(scene):
    assert np.allclose(only(scene(light("DomeLight"), 'upAxis = "Z"')).to_world, np.eye(3))


TURNED = """
    double3 xformOp:translate = (1, 2, 3)
    float xformOp:rotateX = 90
    float3 xformOp:scale = (2, 3, -4)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]
"""


@pytest.mark.parametrize("kind", ["SphereLight", "DiskLight", "RectLight", "DistantLight", "DomeLight"])
def test_a_lights_frame_holds_its_axes_and_place_but_not_its_size(scene, kind):
    frame = only(scene(light(kind, TURNED))).frame
    # The rotation by 90 degrees about X turns local Y to the world's +Z and local Z to −Y, which the negative scale
    # flips to +Y.
    assert np.allclose(frame, [[1, 0, 0, 1], [0, 0, 1, 2], [0, 1, 0, 3], [0, 0, 0, 1]], atol=1e-6)


@pytest.mark.parametrize("kind", ["SphereLight", "DiskLight", "RectLight", "DistantLight"])
def test_a_sheared_lights_frame_looks_where_the_light_shines(scene, kind):
    sheared = """
        matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0.5, 0), (0, 0, 1, 0), (0, 0, 0, 1))
        uniform token[] xformOpOrder = ["xformOp:transform"]"""
    found = only(scene(light(kind, sheared)))
    assert np.allclose(found.frame[:3, :3].T @ found.frame[:3, :3], np.eye(3), atol=1e-12)
    assert np.allclose(-found.frame[:3, 2], found.axis)
    assert found.frame[1, 1] > 0.8  # the frame stays about as upright as the light


GREY = [[[0.25], [0.5]], [[0.75], [1.0]]]


@pytest.mark.parametrize("kind", ["SphereLight", "DiskLight", "RectLight", "DistantLight"])
def test_a_gobo_is_read_with_its_settings(scene, image, kind):
    body = f"""
        asset photonbeams:gobo = @{image("a.exr", GREY, "float")}@
        float photonbeams:gobo:angle = 40
        float photonbeams:gobo:width = 3
        token photonbeams:gobo:wrap = "repeat" """
    gobo = only(scene(light(kind, body))).gobo
    assert gobo.colors[..., 0].tolist() == [[0.25, 0.5], [0.75, 1.0]]
    assert (gobo.angle, gobo.width, gobo.repeat, gobo.aspect) == (40, 3, True, 1)


def test_a_gobo_has_defaults_and_8_bit_colours_are_decoded(scene, image):
    path = image("a.png", [[[0.5, 0.5, 0.5, 1.0]]])
    gobo = only(scene(light("SphereLight", f"asset photonbeams:gobo = @{path}@"))).gobo
    assert (gobo.angle, gobo.repeat) == (None, False)
    assert gobo.colors.tolist() == [[pytest.approx([0.2159] * 3, abs=2e-3)]]
    assert only(scene(light("SphereLight", "asset photonbeams:gobo = @@"))).gobo is None


def test_a_rectangle_lights_texture_lies_on_it_unless_it_has_a_gobo(scene, image):
    texture = f"asset inputs:texture:file = @{image('t.exr', GREY, 'float')}@"
    assert only(scene(light("RectLight", texture))).gobo.image.shape == (2, 2, 1)
    other = f"asset photonbeams:gobo = @{image('g.exr', [[[1.0]]], 'float')}@"
    assert only(scene(light("RectLight", f"{texture}\n{other}"))).gobo.image.shape == (1, 1, 1)
    assert only(scene(light("DiskLight", texture))).gobo is None


@pytest.mark.parametrize(
    ("axis", "turn", "up"),
    [("Y", 0, (0, 1, 0)), ("Z", 90, (0, 0, 1)), ("Y", 90, (0, 0, -1)), ("Z", 0, (0, 1, 0))],
    ids=["window", "window of Z", "skylight", "skylight of Z"],
)
def test_an_image_on_a_portal_is_upright_on_the_stage(scene, image, axis, turn, up):
    turned = f'float xformOp:rotateX = {turn}\nuniform token[] xformOpOrder = ["xformOp:rotateX"]\n}}'
    body = f"rel photonbeams:portal = </Window>\nasset photonbeams:portal:gobo = @{image('a.exr', GREY, 'float')}@"
    found = scene(light("SphereLight", body) + PORTAL.replace("}", turned), f'upAxis = "{axis}"')
    assert only(found).portal_gobo.image.shape == (2, 2, 1)
    assert tuple(only(found).portal_gobo.up) == up


def test_each_of_several_portals_has_the_image_on_it(scene, image):
    windows = PORTAL + PORTAL.replace("Window", "Other")
    picture = image("a.exr", GREY, "float")
    body = f"rel photonbeams:portal = [</Window>, </Other>]\nasset photonbeams:portal:gobo = @{picture}@"
    gobos = only(scene(light("SphereLight", body) + windows)).portal_gobo
    assert [each.over.name for each in gobos] == ["/Window", "/Other"]


@pytest.mark.parametrize(
    ("kind", "body", "message"),
    [
        ("SphereLight", "asset photonbeams:gobo = @gone.png@", r"gobo names gone\.png"),
        (
            "SphereLight",
            "asset photonbeams:gobo = @IMAGE@\nfloat photonbeams:gobo:angle = 180",
            "angle is 180",
        ),
        ("DistantLight", "asset photonbeams:gobo = @IMAGE@", "gobo:width is not given"),
        ("DistantLight", "asset photonbeams:gobo = @IMAGE@\nfloat photonbeams:gobo:width = 0", "width is 0"),
        ("SphereLight", 'asset photonbeams:gobo = @IMAGE@\ntoken photonbeams:gobo:wrap = "clamp"', "wrap is 'clamp'"),
        ("SphereLight", "asset photonbeams:gobo = @TEXT@", r"gobo names .*text\.png"),
        (
            "SphereLight",
            "asset photonbeams:portal:gobo = @IMAGE@\nrel photonbeams:portal = </Ball>",
            "portal:gobo lies on /Ball, which is not flat",
        ),
    ],
)
def test_images_that_no_light_can_shine_through_are_errors(scene, image, kind, body, message):
    body = body.replace("IMAGE", str(image("a.exr", GREY, "float")))
    path = image("n.exr", [[[0.5]]], "float")
    path.with_name("text.png").write_text("no image")
    body = body.replace("TEXT", str(path.with_name("text.png")))
    with pytest.raises(SceneError, match=rf"/L\.photonbeams:.*{message}"):
        scene(light(kind, body) + 'def Sphere "Ball" {\n}')


@pytest.mark.parametrize(("kind", "name"), [("SphereLight", "photonbeams:gobo"), ("DomeLight", "inputs:texture:file")])
def test_pixels_below_0_bring_no_light(scene, image, caplog, kind, name):
    picture = image("a.exr", [[[0.5, 0.5, 0.5], [-0.25, 1.0, 0.0]]], "float")
    found = only(scene(light(kind, f"asset {name} = @{picture}@")))
    pixels = found.gobo.image if kind == "SphereLight" else found.image
    assert pixels.tolist() == [[[0.5, 0.5, 0.5], [0.0, 1.0, 0.0]]]
    assert f"/L.{name} has a pixel of -0.25: expected 0 or more; 0 is used" in caplog.text


def test_images_that_do_nothing_are_warned_of(scene, image, caplog):
    black = image("b.exr", [[[0.0]]], "float")
    found = scene(
        light("SphereLight", f"asset photonbeams:gobo = @{black}@\nasset photonbeams:portal:gobo = @{black}@")
        + light("DomeLight", f"asset photonbeams:gobo = @{black}@").replace('"L"', '"Dome"')
    )
    assert found.lights[0].gobo is not None
    assert "/L.photonbeams:gobo is black: no light passes through it" in caplog.text
    assert "/L.photonbeams:portal:gobo is not rendered: expected a photonbeams:portal" in caplog.text
    assert "/Dome.photonbeams:gobo is not rendered on a dome light" in caplog.text


def test_a_gobo_may_change_with_time(usd, image):
    first, later = image("a.exr", [[[0.5]]], "float"), image("b.exr", [[[1.0]]], "float")
    body = f"asset photonbeams:gobo.timeSamples = {{ 1: @{first}@, 2: @{later}@ }}"
    stage = usd(light("SphereLight", body))
    assert [read_scene(stage, time).lights[0].gobo.image.item() for time in (1, 2)] == [0.5, 1.0]


def test_a_light_says_what_becomes_of_scattered_light(scene):
    light = scene('def SphereLight "L" {\n}').lights[0]
    assert (light.scattered, light.bounces) == ("physical", None)
    text = 'def SphereLight "L" {\ntoken photonbeams:scattered = "look"\nint photonbeams:bounces = 4\n}'
    light = scene(text).lights[0]
    assert (light.scattered, light.bounces) == ("look", 4)


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ('token photonbeams:scattered = "some"', "scattered is 'some'"),
        ("int photonbeams:bounces = -2", "bounces is -2"),
        ('string photonbeams:bounces = "many"', "bounces is 'many'"),
    ],
)
def test_what_cannot_be_scattered_light_is_an_error(scene, attribute, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: /L\.photonbeams:{message}"):
        scene(f'def SphereLight "L" {{\n{attribute}\n}}')
