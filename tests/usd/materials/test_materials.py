"""UsdPreviewSurface materials and their textures."""

import os
import zipfile

import numpy as np
import pytest

from photonbeams.scene import Material, SceneError, UVTexture
from photonbeams.usd.common.reading import Reading
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.geometry.on_mesh import _missing_tiles
from photonbeams.usd.materials.bound import bound_to
from photonbeams.usd.materials.values import Tiles
from photonbeams.usd.stage import open_stage, read_scene

# Two rows: the upper is red and half transparent, the lower is a grey, 0.5 in sRGB and 0.214 in linear light.
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
    """Return a function that writes a texture, reads a stage that names it, and returns its only mesh."""

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
    assert scene(material("")).meshes[0].material == Material(name="/Mat")


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


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_wrap_modes(read, caplog, wrap):
    body = f'token inputs:wrapS = "{wrap}"\ntoken inputs:wrapT = "{wrap}"'
    assert read(material(DIFFUSE, texture(body))).material.diffuse.wrap == wrap
    assert not caplog.text


PLACES = {  # the texel at coordinate u in an image of n texels; None where a black border begins
    "repeat": lambda u, n: int(np.floor((u % 1) * n)),
    "clamp": lambda u, n: int(np.clip(np.floor(u * n), 0, n - 1)),
    "mirror": lambda u, n: int(np.floor((1 - abs((u % 2) - 1)) * n)),
    "black": lambda u, n: int(np.floor(u * n)) if 0 <= u < 1 else None,
}


@pytest.mark.parametrize(
    ("s", "t"), [("repeat", "clamp"), ("mirror", "black"), ("black", "repeat"), ("clamp", "mirror")]
)
def test_two_wrap_modes_are_seen_as_they_are(read, s, t):
    picture = [[[0.2, 0, 0], [0.4, 0, 0], [0.6, 0, 0]], [[0.5, 1, 0], [0.7, 1, 0], [0.9, 1, 0]]]
    body = f'token inputs:wrapS = "{s}"\ntoken inputs:wrapT = "{t}"\ntoken inputs:sourceColorSpace = "raw"'
    text = material(DIFFUSE, texture(body))
    text = text.replace("[(0, 0), (1, 0), (1, 1), (0, 1)] (", "[(-1.5, -1.5), (2.5, -1.5), (2.5, 2.5), (-1.5, 2.5)] (")
    found = read(text, pixels=picture).material.diffuse
    stored = np.round(np.array(picture) * 255) / 255
    for u, v in np.random.default_rng(1).uniform(-1.5, 2.5, (60, 2)):
        x, y = (found.uv_transform @ [u, v, 1])[:2]
        rows, columns = found.pixels.shape[:2]
        column, row = (int(np.clip(np.floor(a * n), 0, n - 1)) for a, n in ((x, columns), (y, rows)))
        i, j = PLACES[s](u, 3), PLACES[t](v, 2)
        expected = np.zeros(3) if i is None or j is None else stored[1 - j, i]
        assert np.allclose(found.pixels[rows - 1 - row, column], expected, atol=1e-6), (u, v)


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
    # (1, 1) is scaled to (2, 3), rotated by 90° counter-clockwise to (−3, 2), and translated to (−2.5, 2).
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
        float inputs:displacement.connect = </Mat/T.outputs:r>
        float inputs:clearcoat.connect = </Mat/T.outputs:r>"""
    found = read(material(inputs, texture())).material
    assert "/Mat/S.inputs:displacement is not rendered: it is ignored" in caplog.text
    assert "/Mat has a texture for its clearcoat, which is not rendered: its mean is used" in caplog.text
    assert found.clearcoat == pytest.approx((1 + SRGB_HALF) / 2)


def test_normals_are_encoded_as_the_renderer_has_them(read):
    body = """token inputs:sourceColorSpace = "raw"
        float4 inputs:scale = (2, 2, 2, 1)
        float4 inputs:bias = (-1, -1, -1, 0)"""
    found = read(material("normal3f inputs:normal.connect = </Mat/T.outputs:rgb>", texture(body))).material.normal
    assert np.allclose(found.pixels[:, 0], [[1, 0, 0], [128 / 255] * 3], atol=1e-6)


@pytest.mark.parametrize("specular", [0.04, 0.1])
def test_a_grey_specular_colour_is_an_index_of_refraction(scene, specular):
    inputs = f"int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = ({specular}, {specular}, {specular})"
    found = scene(material(f"{inputs}\nfloat inputs:metallic = 1")).meshes[0].material
    assert ((found.ior - 1) / (found.ior + 1)) ** 2 == pytest.approx(specular)
    assert found.metallic == 0


def test_a_bright_specular_colour_is_a_metal(scene):
    inputs = "int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (0.9, 0.6, 0.3)"
    found = scene(material(f"{inputs}\ncolor3f inputs:diffuseColor = (0, 0, 0)")).meshes[0].material
    assert found.metallic == pytest.approx(1)
    assert found.diffuse == pytest.approx((0.9, 0.6, 0.3))


def test_udim_tiles_lie_side_by_side(usd, image):
    for number, red in ((1001, 0.0), (1002, 0.4), (1011, 0.8)):
        path = image(f"a.{number}.png", [[[red, 1, 0]]])
    body = 'token inputs:sourceColorSpace = "raw"\ntoken inputs:wrapS = "black"'
    text = material(DIFFUSE, texture(body, file=str(path).replace("1011", "<UDIM>")))
    found = read_scene(usd(text)).meshes[0].material.diffuse
    assert np.allclose(found.pixels, np.array([[[0.8, 1, 0], [0, 0, 0]], [[0, 1, 0], [0.4, 1, 0]]]), atol=0.01)
    assert np.allclose(found.uv_transform @ [2, 1, 1], [1, 0.5, 1])


@pytest.mark.parametrize(
    ("there", "first", "last", "missing"),
    [
        ((1001, 1003), (0, 0), (1, 1), []),  # a gap, but where no mesh is
        ((1001, 1003), (1, 0), (2, 1), [1002]),
        ((1001,), (0, 0), (2, 1), [1002]),
        ((1001,), (0, 0), (1.00001, 1), []),
        ((1001,), (1, 1), (1, 1), []),  # a point, on the edge
        ((1001, 1011), (0, 0), (2, 2), [1002, 1012]),
        ((1001,), (-1, 0), (0, 1), []),  # no tile has such coordinates
        ((1001,), (10, 0), (11, 1), []),
        ((1001,), (1e30, 0), (float("inf"), float("nan")), []),
        ((1001, 1003), (0, 0), (3, 1), [1002]),  # the corners are in others
        ((1001,), (0, 0), (1.1, 1), [1002]),
        ((1002,), (0.99999994, 0.5), (0.99999994, 0.5), []),  # a point, on the edge but for rounding
        ((1001, 1004, 1031), (0, 0), (4, 4), [1002, 1003, 1011, 1012, 1013, 8]),
    ],
)
def test_udim_tiles_that_a_mesh_uses_and_are_not_there_are_missing(usd, image, there, first, last, missing):
    for number in there:
        path = image(f"a.{number}.png", [[[0, 1, 0]]])
    text = material(DIFFUSE, texture(file=str(path).replace(str(there[-1]), "<UDIM>")))
    corners = [first, (last[0], first[1]), last, (first[0], last[1])]
    warnings = Warnings()
    read_scene(usd(text.replace("[(0, 0), (1, 0), (1, 1), (0, 1)]", str(corners))), warnings=warnings)
    text = "/Mat/T.inputs:file names tiles without {}: expected all that a mesh uses; black or the nearest is used"
    numbers = ", ".join(map(str, missing[:5])) + "".join(f" and {more} more" for more in missing[5:])
    assert warnings.missing_at(1) == [text.format(numbers)] * bool(missing)


def test_a_triangle_uses_the_tiles_that_it_overlaps():
    """A slanted triangle does not use all tiles of its box: points of it are the reference."""
    corners = np.array([[0.3, 0.2], [7.4, 5.1], [1.2, 8.7]])
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], 20000)
    expected = {(int(v), int(u)) for u, v in weights @ corners}
    assert {*_missing_tiles(corners[None], Tiles(None, frozenset()))} == expected


@pytest.mark.parametrize("there", [(1001, 1003), (1001,)])  # placed as the other set, or not
def test_all_images_that_are_combined_have_their_tiles(usd, image, there):
    sets = {"A": (1001, 1002, 1003), "B": there}
    for name, number in ((name, number) for name, numbers in sets.items() for number in numbers):
        path = image(f"{name}.{number}.png", [[[0, 1, 0]]])
    shaders = (
        f"""def Shader "{name}" {{
        uniform token info:id = "ND_image_color3"
        asset inputs:file = @{path.with_name(name)}.<UDIM>.png@
        color3f outputs:out
    }}"""
        for name in sets
    )
    product = """def Shader "P" {
        uniform token info:id = "ND_multiply_color3"
        color3f inputs:in1.connect = </Mat/A.outputs:out>
        color3f inputs:in2.connect = </Mat/B.outputs:out>
        color3f outputs:out
    }"""
    text = material("color3f inputs:diffuseColor.connect = </Mat/P.outputs:out>", "\n".join((product, *shaders)))
    warnings = Warnings()
    read_scene(usd(text.replace("[(0, 0), (1, 0), (1, 1), (0, 1)]", "[(1, 0), (2, 0), (2, 1), (1, 1)]")),
               warnings=warnings)  # fmt: skip
    (missing,) = warnings.missing_at(1)
    assert missing.startswith("/Mat/B.inputs:file names tiles without 1002: expected")


def test_tiles_that_are_not_there_are_named_and_the_fallback_used(scene, caplog):
    text = material(DIFFUSE, texture("float4 inputs:fallback = (1, 1, 1, 1)", file="a.<UDIM>.png"))
    assert scene(text).meshes[0].material.diffuse == (1, 1, 1)
    assert "/Mat/T.inputs:file names a.<UDIM>.png: expected files with numbers from 1001 on" in caplog.text


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


@pytest.mark.parametrize("fallback", ["", "float4 inputs:fallback = (0.5, 0.25, 0, 1)"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "names gone.png: expected an image file, but there is none"),
        (b"no picture", "expected an image that can be read"),
        ("pipe", "expected an image that can be read (it is a named pipe)"),
    ],
)
def test_a_texture_that_cannot_be_read_gives_its_fallback(usd, tmp_path, caplog, content, message, fallback):
    name = "gone.png" if content is None else str(tmp_path / "broken.png")
    if content == "pipe":
        os.mkfifo(name)
    elif content:
        (tmp_path / "broken.png").write_bytes(content)
    (mesh,) = read_scene(usd(material(DIFFUSE, texture(fallback, file=name)))).meshes
    assert mesh.material.diffuse == ((0.5, 0.25, 0) if fallback else Material().diffuse)
    (line,) = [each.getMessage() for each in caplog.records]
    assert "/Mat/T.inputs:file names" in line and message in line
    assert line.endswith(f"{'its fallback' if fallback else 'the default'} is used")
    assert len(line) < 300 + len(str(tmp_path)) * 2


@pytest.mark.parametrize(
    ("inputs", "field", "expected", "message"),
    [
        (
            "color3f inputs:diffuseColor = (nan, 0, 0)",
            "diffuse",
            Material().diffuse,
            "/Mat/S.inputs:diffuseColor is not",
        ),
        (
            "color3f inputs:emissiveColor = (-1, 0, 2)",
            "emissive",
            (0, 0, 2),
            "/Mat has the emissive -1, 0, 2: expec",
        ),
        ("float inputs:roughness = -0.5", "roughness", 0, "/Mat has the roughness -0.5: expected 0 to 1"),
        ("float inputs:opacity = 2", "opacity", 1, "/Mat has the opacity 2: expected 0 to 1"),
        (
            "float inputs:metallic.connect = </Mat/No.outputs:r>",
            "metallic",
            0,
            "connected to /Mat/No.outputs:r: expected",
        ),
        (
            "float inputs:metallic.connect = </Mat/T.outputs:r>",
            "metallic",
            0,
            "is a shader 'Odd', which is not rendered",
        ),
    ],
)
def test_what_an_input_cannot_be_is_named_and_its_default_used(scene, caplog, inputs, field, expected, message):
    odd = 'def Shader "T" {\nuniform token info:id = "Odd"\nfloat outputs:r\n}'
    assert getattr(scene(material(inputs, odd)).meshes[0].material, field) == expected
    assert message in caplog.text


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
    with pytest.raises(SceneError, match=r"/D\.inputs:texture:file names .*sky\.exr"):
        scene(f'def DomeLight "D" {{\nasset inputs:texture:file = @{path}@\n}}')


def test_a_binding_without_its_api_prints_no_line_of_openusd(usd, capfd):
    """OpenUSD warns of it on standard error, with a line of its source: -v shows that."""
    text = material("color3f inputs:diffuseColor = (1, 0, 0)").replace(
        ' (prepend apiSchemas = ["MaterialBindingAPI"])', ""
    )
    stage = usd(text)
    bound = bound_to(Reading(stage), stage.GetPrimAtPath("/M"))
    assert bound is not None
    assert "BindingsAtPrim" not in capfd.readouterr().err
