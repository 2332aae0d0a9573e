"""Volumes: fields in .vdb and .vol files, and the shaders of their materials."""

import struct
from functools import partial

import numpy as np
import pytest

from examples.vdb import write_vdb
from photonbeams import Shot
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.usd.stage import read_scene
from photonbeams.volumes.dense import parts_of

FOG = """
    color3f photonbeams:scattering = (0.1, 0.2, 0.3)
    color3f photonbeams:absorption = (0.01, 0.02, 0.03)
"""
API = '(prepend apiSchemas = ["PhotonBeamsMediumAPI"])'


def volume(file="smoke.vol", scale=1.0):
    return f"""
        def Volume "F" {API} {{
            {FOG}
            double3 xformOp:translate = (5, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            rel field:density = </F/D>
            def OpenVDBAsset "D" {{
                asset filePath = @{file}@
                float3 xformOp:scale = ({scale}, {scale}, {scale})
                uniform token[] xformOpOrder = ["xformOp:scale"]
            }}
        }}"""


@pytest.mark.parametrize("channels", [1, 3])
def test_a_volume_with_a_density_is_a_medium_on_a_grid(scene, tmp_path, caplog, channels):
    values = np.random.default_rng(0).random((2, 3, 4, channels)).astype(np.float32)
    file = tmp_path / "smoke.vol"
    mitsuba().VolumeGrid(values).write(str(file))
    (medium,) = scene(volume(file, scale=2.0)).media
    assert np.array_equal(medium.grid.values, values[..., 0] if channels == 1 else values)
    assert np.allclose(medium.grid.to_world @ [1, 1, 1, 1], [7, 2, 2, 1])  # the unit cube, twice as large, at x = 5
    assert medium.scattering == pytest.approx((0.1, 0.2, 0.3))
    assert (medium.name, medium.bounded) == ("/F", True)
    assert not caplog.text


def test_a_volume_fills_the_bounding_box_of_its_file(scene, tmp_path):
    header = struct.pack("<3sB5i6f", b"VOL", 3, 1, 1, 1, 2, 1, -1, -2, -3, 1, 2, 3)
    file = tmp_path / "smoke.vol"
    file.write_bytes(header + np.array([1, 2], dtype="<f4").tobytes())
    grid = scene(volume(file)).media[0].grid
    assert grid.values.tolist() == [[[1]], [[2]]]
    assert np.allclose(grid.to_world @ [0, 0, 0, 1], [4, -2, -3, 1])
    assert np.allclose(grid.to_world @ [1, 1, 1, 1], [6, 2, 3, 1])


def test_a_volume_without_fog_is_no_medium(scene, caplog):
    assert scene('def Volume "F" {\n}').media == ()
    assert (
        "/F is a Volume without a field: expected field:density, a relationship to a prim with a filePath; it"
        in caplog.text
    )


HEADER = struct.pack("<3sB5i6f", b"VOL", 3, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 1)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, r"/F/D\.filePath names .*smoke\.vol"),
        (b"VOL", r"expected a grid that can be read \(it has 3 bytes\)"),
        (b"LOV" + HEADER[3:], r"its header is not that of float32 data"),
        (HEADER, r"it ends before its 1 values"),
        (HEADER[:8] + struct.pack("<4i", 0, 4, 4, 1) + HEADER[24:], "it has 0 x 4 x 4 cells"),
        (
            HEADER[:8] + struct.pack("<4i", 1, 1, 1, 99) + HEADER[24:] + bytes(396),
            "it has 99 channels",
        ),
        (HEADER[:8] + struct.pack("<4i", 2**30, 2**30, 2**30, 1) + HEADER[24:], r"it ends before its \d+ values"),
        (HEADER + struct.pack("<f", np.nan), r"grid has values that are negative or not finite"),
        (HEADER[:36] + struct.pack("<3f", 0, 1, 1) + struct.pack("<f", 1), r"grid has a transform that is flat"),
    ],
)
def test_densities_that_cannot_be_read_are_errors(scene, tmp_path, data, message):
    file = tmp_path / "smoke.vol"
    if data is not None:
        file.write_bytes(data)
    with pytest.raises(SceneError, match=message):
        scene(volume(file))


def test_a_volume_whose_density_is_no_field_is_an_error(scene):
    with pytest.raises(SceneError, match=r"/F\.field:density names no field"):
        scene(f'def Volume "F" {API} {{\n{FOG}\n}}')
    with pytest.raises(SceneError, match=r"/G\.filePath names no file"):
        scene(f'def Volume "F" {API} {{\n{FOG}\nrel field:density = </G>\n}}\ndef Scope "G" {{\n}}')


VALUES = np.zeros((4, 5, 6), np.float32)
VALUES[1:3, 1:4, 1:5] = np.arange(1, 25, dtype=np.float32).reshape(2, 3, 4) / 8


@pytest.fixture
def smoke(tmp_path):
    """Write a .vdb file with a density, a temperature and a colour; return the text of a volume of these fields."""
    colors = np.stack([VALUES / 4, VALUES / 8, (VALUES > 0) * 1.0], axis=-1)
    write_vdb(tmp_path / "smoke.vdb", {"density": VALUES, "temperature": VALUES / 3, "Cd": colors}, half=False)
    return volume_of(tmp_path / "smoke.vdb")


def volume_of(file, fields=("density", "temperature", "Cd"), more="", material=""):
    assets = "\n".join(
        f"""rel field:{name} = </V/{name}>
        def OpenVDBAsset "{name}" {{
            token fieldName = "{name}"
            asset filePath = @{file}@
        }}"""
        for name in fields
    )
    api = '(prepend apiSchemas = ["MaterialBindingAPI"])' if material else ""
    return f"""def Volume "V" {api} {{
        {"rel material:binding = </M>" if material else ""}
        {more}
        {assets}
    }}
    {material}"""


def shader(kind, *inputs, context=""):
    lines = "\n".join(inputs)
    return f"""def Material "M" {{
        token outputs:{context}volume.connect = </M/S.outputs:out>
        def Shader "S" {{
            uniform token info:id = "{kind}"
            {lines}
            token outputs:out
        }}
    }}"""


@pytest.mark.parametrize(
    ("dome", "lit"),
    [
        ("", True),
        ("bool photonbeams:enabled = 0", False),
        ("bool photonbeams:enabled = 1", False),  # the dome then makes beams instead
        ("rel collection:lightLink:excludes = </V>", False),
    ],
)
def test_domes_light_fog_unless_they_say_what_they_do(scene, smoke, dome, lit):
    text = f'def DomeLight "Sky" {{\n{dome}\n}}\n'
    for fog in (smoke, f'def Scope "V" {API} {{\n{FOG}\n}}\n'):
        assert [light.name for light in scene(fog + text).sky] == ["/Sky"] * lit
    assert not scene(text).sky


def test_a_volume_is_a_medium_as_other_renderers_show_it(scene, smoke, caplog):
    (medium,) = scene(smoke).media
    assert np.array_equal(medium.grid.values[1:-1, 1:-1, 1:-1], VALUES[1:3, 1:4, 1:5])
    assert np.allclose(medium.grid.to_world @ [0, 0, 0, 1], [0, 0, 0, 1])  # the values have a margin of one voxel of 0
    assert np.allclose(medium.grid.to_world @ [1, 1, 1, 1], [6, 5, 4, 1])
    assert medium.scattering == medium.absorption == (0.5, 0.5, 0.5)
    assert medium.emission is None and medium.scattering_color is None
    assert not caplog.text


def test_arnolds_standard_volume(scene, tmp_path, smoke):
    material = shader(
        "arnold:standard_volume", "float inputs:density = 3", "float inputs:scatter = 0.5",
        "color3f inputs:scatter_color = (1, 0.5, 0)", "float inputs:scatter_anisotropy = 0.3",
        "color3f inputs:transparent = (0.5, 0.25, 1)", "float inputs:transparent_depth = 2",
        'string inputs:scatter_color_channel = "Cd"', "float inputs:temperature = 2",
        "float inputs:blackbody_kelvin = 1000", "float inputs:emission = 0.5", context="arnold:",
    )  # fmt: skip
    (medium,) = scene(volume_of(tmp_path / "smoke.vdb", material=material)).media
    extinction = 3 * np.log([2, 4, 1]) / 2
    assert medium.extinction == pytest.approx(tuple(extinction))
    assert medium.scattering == pytest.approx(tuple(extinction * [0.5, 0.25, 0]))
    assert medium.anisotropy == pytest.approx(0.3)
    assert np.allclose(medium.scattering_color.values[1:-1, 1:-1, 1:-1, 0], np.minimum(VALUES[1:3, 1:4, 1:5] / 4, 1))
    # The luminance is half of 5.670374e-14 T⁴ / π at T = 2000 K.
    hot = medium.emission.values[1:-1, 1:-1, 1:-1][VALUES[1:3, 1:4, 1:5] == 3][0]
    assert hot @ [0.2126, 0.7152, 0.0722] == pytest.approx(0.5 * 5.670374e-14 * 2000**4 / np.pi, rel=1e-3)
    assert hot[0] > hot[1] > hot[2]


@pytest.mark.parametrize("node", [True, False], ids=["MaterialX", "Karma"])
def test_materialx_and_karma(scene, tmp_path, smoke, node):
    inputs = (
        "vector3f inputs:absorption = (0.1, 0.2, 0.3)",
        "vector3f inputs:scattering.connect = </M/Product.outputs:out>",
        "float inputs:anisotropy = -0.4",
    )
    material = shader("kma_volume", *inputs, "color3f inputs:emission = (0, 0, 2)", context="mtlx:" if node else "")
    extra = """
        def Shader "Product" {
            uniform token info:id = "ND_multiply_vector3FA"
            vector3f inputs:in1.connect = </M/Field.outputs:out>
            float inputs:in2 = 0.5
            vector3f outputs:out
        }
        def Shader "Field" {
            uniform token info:id = "ND_geompropvalue_vector3"
            string inputs:geomprop = "Cd"
            vector3f outputs:out
        }"""
    if node:
        material = material.replace('"kma_volume"', '"ND_anisotropic_vdf"')
        material = material.replace('def Shader "S"', 'def Shader "Vdf"', 1)
        extra += """
        def Shader "S" {
            uniform token info:id = "ND_volume_volumeshader"
            token inputs:vdf.connect = </M/Vdf.outputs:out>
            token inputs:edf.connect = </M/Edf.outputs:out>
            token outputs:out
        }
        def Shader "Edf" {
            uniform token info:id = "ND_uniform_edf"
            color3f inputs:color = (0, 0, 2)
            token outputs:out
        }"""
    material = f"{material.rstrip()[:-1]}{extra}\n}}"
    (medium,) = scene(volume_of(tmp_path / "smoke.vdb", material=material)).media
    assert medium.scattering == pytest.approx((0.5, 0.5, 0.5))
    assert medium.absorption == pytest.approx((0.1, 0.2, 0.3))
    assert medium.anisotropy == pytest.approx(-0.4)
    assert np.allclose(medium.scattering_color.values[1:-1, 1:-1, 1:-1, 1], np.minimum(VALUES[1:3, 1:4, 1:5] / 8, 1))
    assert np.allclose(medium.emission.values[1:-1, 1:-1, 1:-1, 2], 2 * VALUES[1:3, 1:4, 1:5])


def test_a_shader_that_is_not_known_is_read_by_usual_names(scene, tmp_path, smoke, caplog):
    material = shader("Smoke", "float inputs:densityScale = 2", "float inputs:albedo.connect = </M/A.outputs:out>")
    material = (
        material.rstrip()[:-1]
        + """
        def Shader "A" {
            uniform token info:id = "UsdPrimvarReader_float"
            string inputs:varname = "albedo"
            float outputs:out
        }
    }"""
    )
    (medium,) = scene(volume_of(tmp_path / "smoke.vdb", material=material, more="float primvars:albedo = 0.25")).media
    assert medium.scattering == pytest.approx((0.5,) * 3)
    assert medium.absorption == pytest.approx((1.5,) * 3)
    assert "/M/S is a volume shader 'Smoke', which is not known: its densityScale, albedo" in caplog.text


def test_files_of_a_sequence(usd, tmp_path):
    for frame in (1, 2):
        write_vdb(tmp_path / f"smoke.{frame}.vdb", {"density": VALUES * frame})
    body = volume_of("x", ("density",)).replace(
        "asset filePath = @x@",
        f"asset filePath.timeSamples = {{ 1: @{tmp_path}/smoke.1.vdb@, 2: @{tmp_path}/smoke.2.vdb@ }}",
    )
    stage = usd(body)
    first, second, third = (read_scene(stage, time).media[0].grid.values for time in (1, 1.9, 2))
    assert second is first
    assert np.array_equal(third, 2 * first)


def test_a_volume_of_a_sequence_that_is_empty_at_first_is_a_medium(scene, tmp_path):
    write_vdb(tmp_path / "smoke.vdb", {"density": np.zeros((3, 3, 3))})
    (medium,) = scene(volume_of(tmp_path / "smoke.vdb", ("density",))).media
    assert not medium.grid.values.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('fieldName = "density"', 'fieldName = "fuel"'), r"it has no grid fuel, but density"),
        (('fieldName = "density"', 'fieldName = "density"\nint fieldIndex = 1'), "no grid density with fieldIndex 1"),
        (("smoke.vdb", "smoke.f3d"), r"/V/density\.filePath names .*"),
    ],
)
def test_fields_that_are_not_there_are_errors(scene, tmp_path, change, message):
    write_vdb(tmp_path / "smoke.vdb", {"density": VALUES})
    with pytest.raises(SceneError, match=message):
        scene(volume_of(tmp_path / "smoke.vdb", ("density",)).replace(*change))


def test_values_below_zero_count_as_zero_with_a_warning(scene, tmp_path, caplog):
    write_vdb(tmp_path / "smoke.vdb", {"density": VALUES - 2})
    (medium,) = scene(volume_of(tmp_path / "smoke.vdb", ("density",))).media
    assert medium.grid.values.min() == 0
    assert "/V/density.filePath has a grid with values down to -2: those below 0 count as 0" in caplog.text


def test_a_sequence_that_is_blurred_is_the_mean_of_its_instants(usd, tmp_path):
    """The transmittance of a blurred sequence is the mean over the times of the shutter interval.

    Each of the four grids is homogeneous, so rays are tracked without noise and the transmittance is known.
    """
    densities = (0.2, 1.0, 0.5, 3.0)
    for index, density in enumerate(densities):
        data = np.full((2, 2, 2), density, "<f4").tobytes()
        (tmp_path / f"smoke.{index}.vol").write_bytes(
            struct.pack("<3sB5i6f", b"VOL", 3, 1, 2, 2, 2, 1, -1, -1, -1, 1, 1, 1) + data
        )
    files = ", ".join(f"{1 + index / 8}: @{tmp_path}/smoke.{index}.vol@" for index in range(4))
    stage = usd(f"""
        def Volume "V" {API} {{
            color3f photonbeams:absorption = (0.5, 1, 2)
            rel field:density = </V/D>
            def OpenVDBAsset "D" {{ asset filePath.timeSamples = {{ {files} }} }}
        }}
        def DistantLight "L" {{ int photonbeams:count = 4 }}
        def Camera "C" {{
            token projection = "orthographic"
            float horizontalAperture = 10
            float verticalAperture = 10
            double shutter:close = 0.5
            double3 xformOp:translate = (0, 0, 4)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}""")
    found = Shot(stage).render(1, passes=4, width=2, height=2).layers["transmittance"]
    times = (np.arange(64) + 0.5) / 128
    instants = [np.exp(-2 * densities[int(8 * time)] * np.array([0.5, 1, 2])) for time in times]
    # A ray that passes a boundary continues a little behind it, here by 5e-5 units.
    assert np.allclose(found, np.mean(instants, axis=0), rtol=3e-4)


def test_a_temperature_that_cannot_be_read_leaves_the_smoke(usd, tmp_path, caplog, smoke):
    material = shader("arnold:standard_volume", context="arnold:")
    body = volume_of(tmp_path / "smoke.vdb", material=material)
    (medium,) = read_scene(usd(body.replace('fieldName = "temperature"', 'fieldName = "heat"')), 1).media
    assert medium.emission is None and medium.grid.values.max() == 3
    assert "it has no grid heat" in caplog.text and "it emits no light" in caplog.text


def test_a_fire_too_cold_to_glow_is_named_with_its_kelvin(usd, tmp_path, caplog, smoke):
    for kelvin, said in ((0.5, True), (1000, False)):  # the hottest voxel is 1
        caplog.clear()
        given = ('token inputs:emission_mode = "blackbody"', f"float inputs:blackbody_kelvin = {kelvin}")
        body = volume_of(tmp_path / "smoke.vdb", material=shader("arnold:standard_volume", *given, context="arnold:"))
        read_scene(usd(body), 1)
        text = "is 0.5 K at its hottest, too cold to glow: expected 798 to 10000 K, by the field temperature times"
        assert (text in caplog.text) == said


def test_fog_that_is_named_and_not_there_is_not_asked_for(usd, tmp_path, caplog):
    body = volume_of(tmp_path / "gone.vdb") + '\ndef SphereLight "L" {\n}\ndef Camera "C" {\n}'
    Shot(usd(body)).subject.layers(Shot(usd(body)).viewpoint, None)
    assert "gone.vdb: expected a .vdb or .vol file, but there is none; it is skipped" in caplog.text
    assert "there is no fog" not in caplog.text


def test_puffs_that_are_far_apart_are_media_of_their_own(scene, tmp_path, monkeypatch, caplog):
    """Links find each of them by the volume's path."""
    values = np.zeros((200, 16, 16), np.float32)
    values[:8, :8, :8] = values[-8:, -8:, -8:] = 0.5
    write_vdb(tmp_path / "puffs.vdb", {"density": values})
    monkeypatch.setattr("photonbeams.usd.media.volumes.parts_of", partial(parts_of, most=4_000))
    lamp = """def SphereLight "Lamp" (prepend apiSchemas = ["CollectionAPI:lightLink"]) {
        rel collection:lightLink:excludes = </F>
    }
    """
    found = scene(volume(tmp_path / "puffs.vdb") + "\n" + lamp)
    assert [each.name for each in found.media] == ["/F", "/F[part 2]"]
    assert [each.grid.values.shape for each in found.media] == [(10, 10, 10)] * 2
    assert found.lights[0].unlit_media == {"/F", "/F[part 2]"}
    assert "too many voxels" not in caplog.text


@pytest.mark.parametrize(("closes", "count"), [(0.0, 0), (0.5, 1)])
def test_velocities_are_told_once_where_a_shutter_is_open(tmp_path, caplog, closes, count):
    write_vdb(tmp_path / "puff.vdb", {"density": VALUES})
    smoke = volume("puff.vdb").replace("rel field:density", "rel field:v = </F/D>\n            rel field:density")
    camera = f'def Camera "C" {{\n    double shutter:close = {closes}\n}}\n'
    (tmp_path / "s.usda").write_text(f"#usda 1.0\n{camera}{smoke}\n")
    shot = Shot.open(tmp_path / "s.usda")
    for _ in range(2):
        shot.subject.exposure(shot.viewpoint, 0, True, True)
    told = [each.getMessage() for each in caplog.records if "field:v" in each.getMessage()]
    assert len(told) == count and all("/F.field:v is not used" in each and len(each) <= 300 for each in told)
