"""A stage that Blender 5.0.1 exported (data/blender/export.py): every light keeps its power and its place.

The powers were confirmed by rendering the same lights over a grey plane with Cycles.
"""

from pathlib import Path

import numpy as np
import pytest

from examples.vdb import write_vdb
from photonbeams.usd.stage import open_stage, read_camera, read_scene

STAGE = Path(__file__).parent / "data" / "blender" / "blender.usda"


@pytest.fixture(scope="module")
def blender():
    return read_scene(open_stage(STAGE))


@pytest.fixture(scope="module")
def lights(blender):
    return {light.name.split("/")[-1]: light for light in blender.lights}


def flux(light):
    """Return the flux of a diffuse emitter: π times its area times its radiance."""
    area = light.area if hasattr(light, "area") else 4 * np.pi * light.radius**2
    return np.pi * area * np.array(light.radiance)


def test_all_lights_are_read_and_nothing_is_warned_about(lights, caplog):
    assert sorted(lights) == ["disk", "env_light", "point", "rect", "sharp_sun", "soft_spot", "spot", "sun"]
    read_scene(open_stage(STAGE))
    assert not caplog.text


def test_a_spot_of_w_watts_has_the_radiant_intensity_w_over_4_pi(lights):
    spot = lights["spot"]
    assert spot.radius == 0
    assert spot.radiance == pytest.approx((100 / (4 * np.pi),) * 3, rel=1e-6)
    assert np.allclose(spot.center, [1, 2, 3])
    # The rotation by 0.5 about X turns its axis from −Z toward +Y.
    assert np.allclose(spot.axis, [0, np.sin(0.5), -np.cos(0.5)], atol=1e-6)
    assert (spot.shaping.cone_angle, spot.shaping.cone_softness) == pytest.approx((20, 0.3))


def test_spheres_and_areas_emit_their_watts(lights):
    assert flux(lights["soft_spot"]) == pytest.approx([100] * 3, rel=1e-6)
    assert flux(lights["point"]) == pytest.approx([100, 50, 25], rel=1e-6)  # 50 W, an exposure of 1, a colour
    assert flux(lights["rect"]) == pytest.approx([10] * 3, rel=1e-6)
    assert flux(lights["disk"]) == pytest.approx([10] * 3, rel=1e-6)


def test_areas_have_their_size_and_place(lights):
    rect, disk = lights["rect"], lights["disk"]
    assert np.allclose([np.linalg.norm(rect.half_x), np.linalg.norm(rect.half_y)], [2, 1])
    assert np.allclose(rect.axis, [0, 0, -1])
    assert disk.disk
    assert np.allclose(np.linalg.norm(disk.half_x), 1)
    assert np.allclose(disk.center, [5, 2, 3])


def test_a_sun_has_its_strength_as_irradiance_and_its_own_angle(lights):
    sun = lights["sun"]
    assert sun.angle == pytest.approx(1)
    assert np.array(sun.radiance) * np.pi * np.sin(np.radians(0.5)) ** 2 == pytest.approx([3] * 3, rel=1e-5)
    assert np.allclose(sun.axis, [0, 1, 0], atol=1e-6)
    assert lights["sharp_sun"].radiance == (3, 3, 3)


def test_the_world_stands_upright_with_its_middle_toward_x(lights):
    world = lights["env_light"]
    assert np.allclose(world.to_world @ [0, 1, 0], [0, 0, 1])
    assert np.allclose(world.to_world @ [0, 0, 1], [1, 0, 0])
    assert np.linalg.det(world.to_world) == pytest.approx(1)
    assert world.image.shape == (2, 4, 3)
    assert not world.emits_beams


def test_a_world_with_a_rotation_is_taken_at_its_word(tmp_path):
    text = STAGE.read_text().replace("float3 xformOp:rotateXYZ = (0, -0, 0)", "float3 xformOp:rotateXYZ = (90, 0, 90)")
    (tmp_path / "blender.usda").write_text(text.replace("./textures", str(STAGE.parent / "textures")))
    dome = next(light for light in read_scene(open_stage(tmp_path / "blender.usda")).lights if "env" in light.name)
    assert np.allclose(dome.to_world @ [0, 1, 0], [0, 0, 1], atol=1e-6)
    assert np.allclose(dome.to_world @ [0, 0, 1], [1, 0, 0], atol=1e-6)


def env_light(stage):
    return next(light for light in read_scene(stage).lights if light.name.endswith("env_light"))


def test_a_world_keeps_its_correction_under_other_opinions_and_loses_it_to_a_transform(tmp_path):
    name = env_light(open_stage(STAGE)).name
    for change in ("photonbeams:enabled=0", "inputs:exposure=1"):
        assert np.allclose(env_light(open_stage(STAGE, overrides=[f"{name}.{change}"])).to_world @ [0, 1, 0], [0, 0, 1])
    prims = name.strip("/").split("/")
    order = 'uniform token[] xformOpOrder = ["xformOp:rotateX"]\nfloat xformOp:rotateX = 0\n'
    text = "".join(f'over "{prim}"\n{{\n' for prim in prims) + order + "}\n" * len(prims)
    (tmp_path / "turned.usda").write_text(f"#usda 1.0\n{text}")
    turned = env_light(open_stage(STAGE, session_layers=[tmp_path / "turned.usda"]))
    assert np.allclose(turned.to_world, np.eye(3))


def test_a_suns_intensity_that_is_set_over_blenders_is_taken_at_its_word():
    path = next(light.name for light in read_scene(open_stage(STAGE)).lights if light.name.endswith("/sharp_sun"))
    stage = open_stage(STAGE, overrides=[f"{path}.inputs:intensity=8"])
    sun = next(light for light in read_scene(stage).lights if light.name == path)
    assert sun.radiance == (8, 8, 8)


def test_the_camera_has_its_lens_its_shift_and_its_place():
    camera = read_camera(open_stage(STAGE), "camera")
    assert camera.focal_length == pytest.approx(0.035)
    assert camera.horizontal_aperture == pytest.approx(0.036)
    # Blender's shift is in units of the larger side of the picture.
    assert (camera.horizontal_offset, camera.vertical_offset) == pytest.approx((0.0036, -0.0018))
    assert np.allclose(camera.to_world[:3, 3], [0, -10, 2])
    assert np.allclose(camera.to_world[:3, :3] @ [0, 0, -1], [0, 1, 0], atol=1e-6)


def test_meshes_have_their_texture_and_instances_their_place(blender):
    meshes = {mesh.name.split("/")[2]: mesh for mesh in blender.meshes}
    assert len(blender.meshes) == 3
    cube = meshes["Cube"]
    assert np.allclose(np.abs(cube.points), 1)
    assert cube.uvs is not None
    diffuse = cube.material.diffuse.pixels
    assert np.allclose(diffuse[0], [0, 1, 0])  # the top row: green
    assert np.allclose(diffuse[-1], [1, 0, 0])
    for index in range(2):
        ball = meshes[f"copy{index}"]
        assert np.allclose(0.5 * (ball.points.min(axis=0) + ball.points.max(axis=0)), [3 + 3 * index, 0, 0], atol=1e-6)
        assert np.allclose(np.linalg.norm(ball.normals, axis=1), 1)


# What Blender 5.0.1 exports of a volume whose material is a Principled Volume, without its transforms. The custom
# properties are those of the object; those of the volume itself and of its material are not exported.
VOLUME = """#usda 1.0
(
    doc = "Blender v5.0.1"
    upAxis = "Z"
)
def Xform "root" {
    def Xform "Smoke" {
        %s
        custom string userProperties:blender:object_name = "Smoke"
        def Volume "smoke" {
            custom rel field:density = </root/Smoke/smoke/density>
            def OpenVDBAsset "density" {
                token fieldName = "density"
                asset filePath = @./smoke.vdb@
            }
        }
    }
}
"""
PROPERTIES = """custom double3 photonbeams:absorption = (0.06, 0.24, 0.27)
        custom double photonbeams:anisotropy = 0.4
        custom double3 photonbeams:scattering = (0.24, 0.06, 0.03)"""


@pytest.fixture
def smoke(tmp_path):
    """Return a function that reads a volume with these properties of its object."""
    write_vdb(tmp_path / "smoke.vdb", {"density": np.ones((4, 4, 4))})

    def read(properties, *overrides):
        (tmp_path / "stage.usda").write_text(VOLUME % properties)
        return read_scene(open_stage(tmp_path / "stage.usda", overrides=overrides)).media

    return read


def test_a_lost_material_of_a_volume_is_told_with_what_is_used(smoke, caplog):
    (medium,) = smoke("")
    assert (medium.scattering, medium.absorption, medium.anisotropy) == ((0.5,) * 3, (0.5,) * 3, 0)
    (message,) = caplog.messages
    expected = (
        "stage.usda: /root/Smoke/smoke has no material, because Blender writes none for volumes: extinction 1 and"
    )
    assert expected in message and len(message) <= 300
    caplog.clear()
    (medium,) = smoke("", "/root/Smoke/smoke.photonbeams:scattering=0.1")
    assert medium.scattering == pytest.approx((0.1,) * 3) and not caplog.messages


def test_custom_properties_of_blenders_object_reach_its_smoke(smoke, caplog):
    """They would otherwise be a fog that fills the whole space."""
    (medium,) = smoke(PROPERTIES)
    assert medium.grid is not None and not caplog.messages
    assert medium.scattering == pytest.approx((0.24, 0.06, 0.03))
    assert medium.absorption == pytest.approx((0.06, 0.24, 0.27))
    assert medium.anisotropy == pytest.approx(0.4)
    (medium,) = smoke(PROPERTIES, "/root/Smoke/smoke.photonbeams:scattering=0.1")
    assert medium.scattering == pytest.approx((0.1,) * 3)


def test_custom_properties_of_blenders_object_may_be_animated_and_reach_its_light(usd, caplog):
    text = (
        'def Xform "Lamp" {\n custom string photonbeams:lightGroup = "key"\n'
        " custom double photonbeams:intensity.timeSamples = { 1: 1, 9: 3\n }\n"
        ' def SphereLight "Lamp" {\n }\n def Xform "Child" {\n }\n }\n'
        'def Xform "Other" {\n custom string photonbeams:lightGroup = "key"\n def Scope "S" {\n }\n }\n'
    )
    (light,) = read_scene(usd(text, 'doc = "Blender v5.0.1"'), 5.0).lights
    assert (light.group, light.beam_scale) == ("key", pytest.approx(2))
    assert not caplog.messages


LAMPS = """
    def Xform "Ob" {{
        float3 xformOp:scale = ({0}, {0}, {0})
        double3 xformOp:translate = (0, 0, {1})
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        def SphereLight "point" {{ {2}\n float inputs:radius = 0.1\n }}
        def SphereLight "spot" {{ {2}\n float inputs:radius = 0\n bool treatAsPoint = 1\n }}
        def RectLight "rect" {{ {2}\n float inputs:width = 2\n }}
        def DiskLight "disk" {{ {2}\n }}
        def Volume "smoke" {{ rel field:density = <{3}/Ob/smoke/density>
            def OpenVDBAsset "density" {{ asset filePath = @smoke.vdb@\n }}
        }}
    }}
"""


def exported(folder, meters, root, scaled=True, signed=True):
    """Write what Blender 5.0.1 exports of lamps 3 m above the ground in another unit, with or without a root prim."""
    scale = 1 / meters if scaled else 1
    power = "float inputs:intensity = 31.830988\n bool inputs:normalize = 1"
    lamps = LAMPS.format(1 if root else scale, 3 if root else 3 * scale, power, "/root" if root else "")
    if root:
        order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
        lamps = f'def Xform "root" {{\n float3 xformOp:scale = ({scale}, {scale}, {scale})\n {order}\n{lamps}\n}}'
    doc = 'doc = "Blender v5.0.1"\n' if signed else ""
    metadata = f'{doc}metersPerUnit = {meters}\n upAxis = "Z"\n defaultPrim = "{"root" if root else "Ob"}"'
    (folder / "export.usda").write_text(f"#usda 1.0\n(\n{metadata}\n)\n{lamps}")
    if not (folder / "smoke.vdb").exists():
        write_vdb(folder / "smoke.vdb", {"density": np.ones((2, 2, 2), dtype=np.float32)})
    return folder / "export.usda"


def in_metres(stage, meters):
    """Return the radiances of lamps, what points give at a metre, and the smoke's extinction per metre."""
    content = read_scene(stage)
    found = {light.name.split("/")[-1]: np.array(light.radiance) for light in content.lights}
    found["spot"] *= meters**2  # a radiant intensity, whose irradiance is per square unit
    (smoke,) = content.media
    return {**found, "smoke": np.array(smoke.extinction) / meters}


@pytest.mark.parametrize("root", [True, False])
@pytest.mark.parametrize("meters", [0.001, 0.01, 0.0254, 0.3048, 0.9144, 1000.0])
def test_lamps_and_smoke_are_the_same_in_all_units_that_blender_exports(tmp_path, meters, root, caplog):
    right = in_metres(open_stage(exported(tmp_path, 1.0, root)), 1.0)
    assert right["point"] == pytest.approx([100 / (np.pi * 4 * np.pi * 0.1**2)] * 3, rel=1e-6)
    found = in_metres(open_stage(exported(tmp_path, meters, root)), meters)
    for name, value in right.items():  # single precision: of the scale that is written, squared
        assert found[name] == pytest.approx(value, rel=1e-5), name


def test_units_are_converted_only_where_blender_wrote_and_scaled_them(tmp_path):
    right = in_metres(open_stage(exported(tmp_path, 1.0, True)), 1.0)["spot"]
    for given in ({"scaled": False}, {"signed": False}):  # before it offered units, and another program's
        found = read_scene(open_stage(exported(tmp_path, 0.01, True, **given))).lights
        assert next(each for each in found if "spot" in each.name).radiance == pytest.approx(right, rel=1e-6)


@pytest.mark.parametrize(("scale", "meters"), [(1, 0.01), (0.01, 1.0)])
def test_an_export_in_centimetres_that_another_stage_scales_back_keeps_its_light(tmp_path, scale, meters):
    right = in_metres(open_stage(exported(tmp_path, 1.0, True)), 1.0)
    exported(tmp_path, 0.01, True)
    order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
    (tmp_path / "set.usda").write_text(
        f'#usda 1.0\n(\n metersPerUnit = {meters}\n)\ndef Xform "Set" {{\n float3 xformOp:scale = ({scale}, {scale}, '
        f'{scale})\n {order}\n def Xform "Room" (instanceable = 1\n references = @export.usda@) {{}}\n}}\n'
    )
    found = in_metres(open_stage(tmp_path / "set.usda"), meters)
    for name, value in right.items():
        assert found[name] == pytest.approx(value, rel=1e-5), name


def test_an_intensity_that_is_set_over_an_export_in_centimetres_has_the_same_unit(tmp_path):
    exported(tmp_path, 0.01, True)
    stage = open_stage(tmp_path / "export.usda", overrides=["/root/Ob/spot.inputs:intensity=63.661976"])
    found = in_metres(stage, 0.01)
    assert found["spot"] == pytest.approx([200 / (4 * np.pi)] * 3, rel=1e-6)
