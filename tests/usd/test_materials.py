"""UsdPreviewSurface materials and their textures."""

import zipfile

import numpy as np
import pytest

from photonbeams.scene import Material, SceneError, UVTexture
from photonbeams.usd.stage import open_stage, read_scene

# Two rows: the upper red and half transparent, the lower a grey of which sRGB's 0.5 is 0.214.
ROWS = [[[1, 0, 0, 0.5]], [[0.5, 0.5, 0.5, 1]]]
SRGB_HALF = ((128 / 255 + 0.055) / 1.055) ** 2.4


def material(inputs, shaders="", kind="UsdPreviewSurface"):
    return f"""
    def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
        texCoord2f[] primvars:other = [(0.5, 0.5)] (interpolation = "constant")
        color3f[] primvars:displayColor = [(0.3, 0.2, 0.1)] (interpolation = "constant")
        rel material:binding = </Mat>
    }}
    def Material "Mat" {{
        token outputs:surface.connect = </Mat/S.outputs:surface>
        float2 inputs:frame = (2, 3)
        string inputs:uvs = "other"
        def Shader "S" {{
            uniform token info:id = "{kind}"
            {inputs}
            token outputs:surface
        }}
        {shaders}
    }}"""


def texture(body="", file="rows.png", outputs="float3 outputs:rgb\nfloat outputs:a\nfloat outputs:r", more=""):
    return f"""def Shader "T" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        {body}
        {outputs}
    }}
    {more}"""


DIFFUSE = "color3f inputs:diffuseColor.connect = </Mat/T.outputs:rgb>"


@pytest.fixture
def read(usd, image):
    """Write a texture, open a stage that names it, and return its only mesh."""

    def result(text, pixels=ROWS, kind="uint8", name="rows.png"):
        path = image(name, pixels, kind)
        (mesh,) = read_scene(usd(text.replace("@rows.png@", f"@{path}@"))).meshes
        return mesh

    return result


def test_plain_inputs_are_read(scene):
    inputs = """
        color3f inputs:diffuseColor = (0.1, 0.2, 0.3)
        color3f inputs:emissiveColor = (4, 5, 6)
        float inputs:roughness = 0.25
        float inputs:metallic = 1
        float inputs:ior = 1.25
        float inputs:clearcoat = 0.5
        float inputs:clearcoatRoughness = 0.125
        float inputs:opacity = 0.75"""
    found = scene(material(inputs)).meshes[0].material
    assert found.diffuse == pytest.approx((0.1, 0.2, 0.3))
    assert found.emissive == (4, 5, 6)
    assert (found.roughness, found.metallic, found.ior) == (0.25, 1, 1.25)
    assert (found.clearcoat, found.clearcoat_roughness, found.opacity) == (0.5, 0.125, 0.75)


def test_what_is_not_authored_is_as_usd_preview_surface_has_it(scene):
    assert scene(material("")).meshes[0].material == Material()


def test_an_input_may_come_from_the_materials_interface(scene):
    text = material("color3f inputs:diffuseColor.connect = </Mat.inputs:tint>").replace(
        "float2 inputs:frame", "color3f inputs:tint = (0.5, 0.25, 0)\nfloat2 inputs:frame"
    )
    assert scene(text).meshes[0].material.diffuse == (0.5, 0.25, 0)


def test_a_texture_is_decoded_to_linear_with_its_top_row_first(read):
    found = read(material(DIFFUSE, texture())).material.diffuse
    assert isinstance(found, UVTexture)
    assert found.pixels.shape == (2, 1, 3)
    assert found.pixels.dtype == np.float32
    assert np.allclose(found.pixels[0, 0], [1, 0, 0])
    assert np.allclose(found.pixels[1, 0], SRGB_HALF, atol=1e-5)


@pytest.mark.parametrize(
    ("space", "kind", "name", "expected"),
    [
        ("auto", "uint8", "rows.png", SRGB_HALF),
        ("sRGB", "uint8", "rows.png", SRGB_HALF),
        ("raw", "uint8", "rows.png", 128 / 255),
        ("auto", "float", "rows.exr", 0.5),
        ("auto", "uint16", "rows.png", 0.5),
        ("sRGB", "float", "rows.exr", ((0.5 + 0.055) / 1.055) ** 2.4),
    ],
)
def test_source_color_spaces(read, space, kind, name, expected):
    text = material(DIFFUSE, texture(f'token inputs:sourceColorSpace = "{space}"'))
    assert np.allclose(read(text, kind=kind, name=name).material.diffuse.pixels[1], expected, atol=1e-4)


def test_scale_and_bias_are_applied_after_decoding(read):
    body = "float4 inputs:scale = (0.5, 1, 1, 1)\nfloat4 inputs:bias = (0, 0.25, 0, 0)"
    found = read(material(DIFFUSE, texture(body))).material.diffuse
    assert np.allclose(found.pixels[0, 0], [0.5, 0.25, 0])


def test_a_channel_of_a_texture_feeds_a_number(read):
    inputs = """
        float inputs:opacity.connect = </Mat/T.outputs:a>
        float inputs:roughness.connect = </Mat/T.outputs:r>"""
    found = read(material(inputs, texture())).material
    assert found.opacity.pixels.shape == (2, 1, 1)
    assert np.allclose(found.opacity.pixels[:, 0, 0], [0.5, 1], atol=0.005)  # alpha is never sRGB
    assert np.allclose(found.roughness.pixels[:, 0, 0], [1, SRGB_HALF], atol=1e-5)


def test_an_opacity_threshold_cuts_out(read):
    inputs = "float inputs:opacity.connect = </Mat/T.outputs:a>\nfloat inputs:opacityThreshold = 0.7"
    assert read(material(inputs, texture())).material.opacity.pixels[:, 0, 0].tolist() == [0, 1]


def test_a_grey_image_colours_all_channels(read):
    found = read(material(DIFFUSE, texture()), pixels=[[[0.25], [0.5]]]).material.diffuse
    assert np.allclose(found.pixels[0, 1], 128 / 255)


@pytest.mark.parametrize(
    ("body", "expected", "warning"),
    [
        ("", "repeat", ""),
        ('token inputs:wrapS = "clamp"\ntoken inputs:wrapT = "clamp"', "clamp", ""),
        ('token inputs:wrapS = "mirror"\ntoken inputs:wrapT = "mirror"', "mirror", ""),
        ('token inputs:wrapS = "black"\ntoken inputs:wrapT = "black"', "clamp", "is 'black', which is not rendered"),
        ('token inputs:wrapS = "repeat"\ntoken inputs:wrapT = "clamp"', "repeat", "wrapS is used for both"),
    ],
)
def test_wrap_modes(read, caplog, body, expected, warning):
    assert read(material(DIFFUSE, texture(body))).material.diffuse.wrap == expected
    assert warning in caplog.text
    assert bool(warning) == bool(caplog.text)


READER = """
    def Shader "R" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname.connect = </Mat.inputs:uvs>
        float2 outputs:result
    }
"""


def test_texture_coordinates_are_those_that_the_reader_names(read):
    found = read(material(DIFFUSE, texture("float2 inputs:st.connect = </Mat/R.outputs:result>", more=READER)))
    assert np.allclose(found.uvs, 0.5)
    plain = READER.replace("varname.connect = </Mat.inputs:uvs>", 'varname = "st"')
    found = read(material(DIFFUSE, texture("float2 inputs:st.connect = </Mat/R.outputs:result>", more=plain)))
    assert np.allclose(found.uvs, found.points[:, :2])


def test_a_2d_transform_scales_then_rotates_then_translates(read):
    transform = (
        READER
        + """
    def Shader "X" {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </Mat/R.outputs:result>
        float inputs:rotation = 90
        float2 inputs:scale.connect = </Mat.inputs:frame>
        float2 inputs:translation = (0.5, 0)
        float2 outputs:result
    }"""
    )
    found = read(material(DIFFUSE, texture("float2 inputs:st.connect = </Mat/X.outputs:result>", more=transform)))
    # (1, 1) scaled is (2, 3), rotated by 90° counter-clockwise (−3, 2), translated (−2.5, 2).
    assert np.allclose(found.material.diffuse.uv_transform @ [1, 1, 1], [-2.5, 2, 1])
    assert np.allclose(found.uvs, 0.5)


def test_a_texture_without_a_file_gives_its_fallback(scene):
    text = material(DIFFUSE, texture("float4 inputs:fallback = (0.5, 0.25, 0, 1)", file=""))
    assert scene(text).meshes[0].material.diffuse == (0.5, 0.25, 0)


def test_a_mesh_without_texture_coordinates_has_the_mean_colour(read, caplog):
    text = material(DIFFUSE, texture())
    lines = [line for line in text.splitlines() if "texCoord2f" not in line]
    found = read("\n".join(lines))
    assert found.uvs is None
    assert np.allclose(found.material.diffuse, [(1 + SRGB_HALF) / 2, SRGB_HALF / 2, SRGB_HALF / 2], atol=1e-5)
    assert "/M has no primvar 'st' for its textures: their mean colour is used" in caplog.text


def test_a_primvar_reader_gives_the_diffuse_colour(scene):
    reader = """def Shader "P" {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "displayColor"
        float3 outputs:result
    }"""
    text = material("color3f inputs:diffuseColor.connect = </Mat/P.outputs:result>", reader)
    assert scene(text).meshes[0].material.diffuse == pytest.approx((0.3, 0.2, 0.1))


def test_another_shader_is_named_and_display_color_is_used(scene, caplog):
    found = scene(material("", kind="FancySurface")).meshes[0].material
    assert found.diffuse == pytest.approx((0.3, 0.2, 0.1))
    assert "/Mat has a surface shader 'FancySurface': expected UsdPreviewSurface" in caplog.text


def test_what_is_not_rendered_of_a_material_is_named(read, caplog):
    inputs = """
        normal3f inputs:normal.connect = </Mat/T.outputs:rgb>
        int inputs:useSpecularWorkflow = 1
        float inputs:clearcoat.connect = </Mat/T.outputs:r>"""
    found = read(material(inputs, texture())).material
    assert "/Mat/S.inputs:normal is not rendered" in caplog.text
    assert "/Mat/S.inputs:useSpecularWorkflow is not rendered" in caplog.text
    assert "/Mat/S.inputs:clearcoat is a texture: its mean is used" in caplog.text
    assert found.clearcoat == pytest.approx((1 + SRGB_HALF) / 2)


def test_tiled_textures_are_named_and_their_fallback_used(scene, caplog):
    text = material(DIFFUSE, texture("float4 inputs:fallback = (1, 1, 1, 1)", file="a.<UDIM>.png"))
    assert scene(text).meshes[0].material.diffuse == (1, 1, 1)
    assert "/Mat/T names a.<UDIM>.png, tiles are not rendered" in caplog.text


def test_a_material_bound_to_a_parent_is_inherited(scene):
    text = (
        material("color3f inputs:diffuseColor = (1, 0, 0)")
        + """
    def Xform "A" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        rel material:binding = </Mat>
        def Cube "C" {
        }
    }"""
    )
    assert {mesh.name: mesh.material.diffuse for mesh in scene(text).meshes}["/A/C"] == (1, 0, 0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"names gone\.png: expected an image file, there is none"),
        (b"no picture", "expected an image that can be"),
    ],
)
def test_an_unreadable_texture_is_an_error_with_prim_attribute_and_file(scene, tmp_path, content, message):
    name = "gone.png"
    if content is not None:
        name = str(tmp_path / "broken.png")
        (tmp_path / "broken.png").write_bytes(content)
    with pytest.raises(SceneError, match=rf"stage\.usda: /Mat/T\.inputs:file .*{message}") as error:
        scene(material(DIFFUSE, texture(file=name)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (
            "color3f inputs:diffuseColor = (nan, 0, 0)",
            r"/Mat/S\.inputs:diffuseColor is .*: expected one or three finite",
        ),
        (
            "color3f inputs:emissiveColor = (-1, 0, 0)",
            r"/Mat/S\.inputs:emissiveColor is .*: expected one or three finite",
        ),
        ("float inputs:roughness = -0.5", r"/Mat/S\.inputs:roughness is -0\.5: expected a finite number at least 0"),
        ("float inputs:opacity = 2", r"/Mat/S\.inputs:opacity is 2\.0: expected a finite number at least 0 at most 1"),
    ],
)
def test_inputs_out_of_range_are_errors_that_name_them(scene, inputs, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(material(inputs))


def test_a_texture_inside_a_usdz_package_is_read(image, tmp_path):
    picture = image("rows.png", ROWS).read_bytes()
    text = "#usda 1.0\n" + material(DIFFUSE, texture()).replace(" }", "\n}")
    with zipfile.ZipFile(tmp_path / "shot.usdz", "w", zipfile.ZIP_STORED) as package:
        package.writestr("shot.usda", text)
        package.writestr("rows.png", picture)
    (mesh,) = read_scene(open_stage(tmp_path / "shot.usdz")).meshes
    assert np.allclose(mesh.material.diffuse.pixels[0, 0], [1, 0, 0])


def test_a_dome_has_its_image_decoded_and_other_formats_are_named(usd, image, caplog):
    path = image("sky.exr", [[[2, 3, 4], [5, 6, 7]]], "float")
    body = f'def DomeLight "D" {{\nasset inputs:texture:file = @{path}@\ntoken inputs:texture:format = "%s"\n}}'
    (light,) = read_scene(usd(body % "latlong")).lights
    assert light.image.tolist() == [[[2, 3, 4], [5, 6, 7]]]
    (light,) = read_scene(usd(body % "mirroredBall")).lights
    assert light.image is None
    assert "/D.inputs:texture:format is 'mirroredBall', which is not rendered" in caplog.text


def test_pixels_that_are_not_finite_are_an_error(scene, image):
    path = image("sky.exr", [[[np.nan, 3, 4]]], "float")
    with pytest.raises(SceneError, match=r"/D\.inputs:texture:file names .*sky\.exr: expected pixels that are finite"):
        scene(f'def DomeLight "D" {{\nasset inputs:texture:file = @{path}@\n}}')
