"""Materials of other renderers, and nodes that compute values, are read as the nearest UsdPreviewSurface."""

import shlex

import numpy as np
import pytest

from photonbeams.scene import UVTexture
from photonbeams.usd.stage import open_stage, read_scene
from tests.usd.materials.networks import PIXELS, STANDARD, material, shader

OPEN = ["ND_open_pbr_surface_surfaceshader", "arnold:openpbr_surface"]


@pytest.mark.parametrize("kind", STANDARD)
def test_a_standard_surface_is_read_input_by_input(scene, caplog, kind):
    inputs = (
        "float inputs:base = 0.5", "color3f inputs:base_color = (0.4, 0.6, 0.8)", "float inputs:metalness = 0.25",
        "float inputs:specular_roughness = 0.375", "float inputs:specular_IOR = 1.25", "float inputs:coat = 0.5",
        "float inputs:coat_roughness = 0.125", "color3f inputs:coat_color = (1, 0.5, 1)",
        "float inputs:emission = 2", "color3f inputs:emission_color = (1, 2, 3)",
    )  # fmt: skip
    found = scene(material(kind, *inputs)).meshes[0].material
    # A coat of weight 0.5 tints what is below it by the mean of white and the coat's colour.
    assert found.diffuse == pytest.approx((0.2, 0.3 * 0.75, 0.4))
    assert (found.metallic, found.roughness, found.ior) == (0.25, 0.375, 1.25)
    assert (found.clearcoat, found.clearcoat_roughness, found.opacity) == (0.5, 0.125, 1)
    assert found.emissive == (2, 4, 6)
    assert not caplog.text


@pytest.mark.parametrize(("kind", "roughness"), [(STANDARD[0], 0.2), (OPEN[0], 0.3)])
def test_surfaces_in_layers_have_their_own_defaults(scene, kind, roughness):
    found = scene(material(kind)).meshes[0].material
    assert found.diffuse == pytest.approx((0.8,) * 3)
    assert (found.roughness, found.ior, found.metallic, found.opacity) == (roughness, 1.5, 0, 1)


def test_a_specular_weight_scales_the_reflectance_at_normal_incidence(scene):
    found = scene(material(STANDARD[0], "float inputs:specular = 0.25")).meshes[0].material
    assert ((found.ior - 1) / (found.ior + 1)) ** 2 == pytest.approx(0.25 * 0.04)
    assert scene(material(STANDARD[0], "float inputs:specular = 0")).meshes[0].material.ior == 1


@pytest.mark.parametrize(
    ("kind", "transmission", "ior"),
    [(STANDARD[1], "transmission", "specular_IOR"), (OPEN[0], "transmission_weight", "specular_ior")],
)
def test_transmission_is_glass_of_its_tint(scene, kind, transmission, ior):
    inputs = f"float inputs:{transmission} = 1", f"float inputs:{ior} = 1.33"
    found = scene(material(kind, *inputs, "color3f inputs:transmission_color = (0.5, 1, 0.75)")).meshes[0].material
    assert (found.opacity, found.presence, found.tint) == (0, False, (0.5, 1, 0.75))
    assert found.ior == pytest.approx(1.33)


@pytest.mark.parametrize(("kind", "thin"), [(STANDARD[0], "thin_walled"), (OPEN[0], "geometry_thin_walled")])
def test_a_thin_wall_keeps_its_tint_which_may_be_an_image_or_a_primvar(scene, image, kind, thin):
    """Its two sides are one: it is no cut-out."""
    name = "transmission_weight" if kind == OPEN[0] else "transmission"
    inputs = f"float inputs:{name} = 1", f"bool inputs:{thin} = 1"
    texture = shader("N", "arnold:image", f"asset inputs:filename = @{image('a.exr', PIXELS, 'float')}@")
    connected = "color3f inputs:transmission_color.connect = </Mat/N.outputs:out>"
    found = scene(material(kind, *inputs, connected, nodes=(texture,))).meshes[0].material
    assert (found.opacity, found.presence, found.thin) == (0, False, True)
    np.testing.assert_allclose(found.tint.pixels, PIXELS, atol=1e-3)
    reader = shader("N", "ND_geompropvalue_color3", 'string inputs:geomprop = "paint"')
    found = scene(material(kind, *inputs, connected, nodes=(reader,))).meshes[0].material
    np.testing.assert_allclose(found.tint.values, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])


@pytest.mark.parametrize(
    ("kind", "clear", "color"),
    [("PxrSurface", "refractionGain", "refractionColor"), ("arnold:standard", "Kt", "Kt_color"),
     ("ND_gltf_pbr_surfaceshader", "transmission", "base_color")],
)  # fmt: skip
def test_glass_of_other_renderers_has_its_colour(scene, kind, clear, color):
    found = scene(material(kind, f"float inputs:{clear} = 1", f"color3f inputs:{color} = (0.5, 1, 0.75)"))
    assert (found.meshes[0].material.opacity, found.meshes[0].material.tint) == (0, (0.5, 1, 0.75))


def test_opacity_of_a_standard_surface_cuts_out(scene):
    found = scene(material(STANDARD[0], "color3f inputs:opacity = (0.5, 0.5, 0.5)")).meshes[0].material
    assert (found.opacity, found.presence) == (0.5, True)


def test_what_is_lost_of_a_layer_is_named(scene, caplog):
    inputs = "float inputs:subsurface = 0.5", "color3f inputs:subsurface_color = (1, 0, 0)", "float inputs:sheen = 1"
    found = scene(material(STANDARD[0], *inputs)).meshes[0].material
    assert found.diffuse == pytest.approx((0.9, 0.4, 0.4))
    assert "/Mat/S.inputs:subsurface is rendered as diffuse reflection" in caplog.text
    assert "/Mat/S.inputs:sheen is not rendered: it is ignored" in caplog.text


@pytest.mark.parametrize(
    ("kind", "inputs", "diffuse", "emissive"),
    [
        (
            "arnold:lambert",
            ("color3f inputs:Kd_color = (1, 0.5, 0)", "float inputs:Kd = 0.5"),
            (0.5, 0.25, 0),
            (0, 0, 0),
        ),
        ("arnold:flat", ("color3f inputs:color = (1, 0.5, 0)",), (0, 0, 0), (1, 0.5, 0)),
        ("arnold:utility", ("color3f inputs:color = (1, 0.5, 0)",), (1, 0.5, 0), (0, 0, 0)),
        ("ND_surface_unlit", ("color3f inputs:emission_color = (1, 0.5, 0)",), (0, 0, 0), (1, 0.5, 0)),
        ("ND_UsdPreviewSurface_surfaceshader", ("color3f inputs:diffuseColor = (1, 0.5, 0)",), (1, 0.5, 0), (0, 0, 0)),
        ("PxrDiffuse", ("color3f inputs:diffuseColor = (1, 0.5, 0)",), (1, 0.5, 0), (0, 0, 0)),
    ],
)
def test_simple_surfaces(scene, caplog, kind, inputs, diffuse, emissive):
    found = scene(material(kind, *inputs)).meshes[0].material
    assert found.diffuse == pytest.approx(diffuse)
    assert found.emissive == pytest.approx(emissive)
    assert not caplog.text


@pytest.mark.parametrize("kind", ["PxrDisneyBsdf", "SomeShader"])
def test_another_shader_is_named_and_read_by_its_usual_names(scene, caplog, kind):
    found = scene(material(kind, "color3f inputs:baseColor = (1, 0.5, 0)", "float inputs:roughness = 0.25"))
    assert found.meshes[0].material.diffuse == pytest.approx((1, 0.5, 0))
    assert found.meshes[0].material.roughness == 0.25
    (record,) = caplog.records
    assert f"/Mat/S is a '{kind}': it is rendered as the nearest UsdPreviewSurface" in record.getMessage()


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        (
            "ND_multiply_color3",
            ("color3f inputs:in1 = (1, 0.5, 0)", "color3f inputs:in2 = (0.5, 0.5, 0.5)"),
            (0.5, 0.25, 0),
        ),
        ("ND_multiply_color3FA", ("color3f inputs:in1 = (1, 0.5, 0)", "float inputs:in2 = 0.5"), (0.5, 0.25, 0)),
        ("arnold:multiply", ("color3f inputs:input1 = (1, 0.5, 0)", "color3f inputs:input2 = (1, 1, 0)"), (1, 0.5, 0)),
        ("ND_subtract_color3", ("color3f inputs:in1 = (1, 0.5, 0)", "color3f inputs:in2 = (0.5, 0.5, 0)"), (0.5, 0, 0)),
        (
            "ND_mix_color3",
            ("color3f inputs:fg = (1, 0, 0)", "color3f inputs:bg = (0, 1, 0)", "float inputs:mix = 0.25"),
            (0.25, 0.75, 0),
        ),
        ("ND_constant_color3", ("color3f inputs:value = (1, 0.5, 0)",), (1, 0.5, 0)),
        ("ND_invert_color3", ("color3f inputs:in = (1, 0.5, 0)",), (0, 0.5, 1)),
        ("ND_clamp_color3", ("color3f inputs:in = (3, 0.5, 0)", "float inputs:high = 0.75"), (0.75, 0.5, 0)),
        ("ND_combine3_color3", ("float inputs:in1 = 1", "float inputs:in2 = 0.5"), (1, 0.5, 0)),
        ("ND_luminance_color3", ("color3f inputs:in = (1, 0, 0)",), (0.2126,) * 3),
    ],
)
def test_nodes_of_constants(scene, kind, inputs, expected):
    connected = "color3f inputs:diffuseColor.connect = </Mat/N.outputs:out>"
    text = material("UsdPreviewSurface", connected, nodes=[shader("N", kind, *inputs)])
    assert scene(text).meshes[0].material.diffuse == pytest.approx(expected)


def test_nodes_may_be_in_graphs_and_behind_interfaces(scene):
    graph = """def NodeGraph "G" {
        color3f inputs:tint = (1, 0.5, 0)
        color3f outputs:result.connect = </Mat/G/N.outputs:out>
        def Shader "N" {
            uniform token info:id = "ND_multiply_color3FA"
            color3f inputs:in1.connect = </Mat/G.inputs:tint>
            float inputs:in2 = 0.5
            color3f outputs:out
        }
    }"""
    connected = "color3f inputs:base_color.connect = </Mat/G.outputs:result>"
    found = scene(material(STANDARD[1], connected, nodes=[graph], context="mtlx:")).meshes[0].material
    assert found.diffuse == pytest.approx((0.5, 0.25, 0))


def test_a_loop_of_nodes_ends(scene, caplog):
    loop = shader("N", "ND_add_color3", "color3f inputs:in1.connect = </Mat/N.outputs:out>")
    scene(material("UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Mat/N.outputs:out>", nodes=[loop]))
    assert "in a loop: it is ignored" in caplog.text


@pytest.mark.parametrize(
    ("kind", "file", "more"),
    [
        ("ND_image_color3", "file", ()),
        ("ND_tiledimage_color3", "file", ("float2 inputs:uvtiling = (3, 2)", "float2 inputs:uvoffset = (0.5, 0)")),
        (
            "arnold:image",
            "filename",
            ("float inputs:sscale = 3", "float inputs:tscale = 2", "float inputs:soffset = -0.5"),
        ),
    ],
)
def test_images_of_other_networks(usd, image, kind, file, more):
    path = image("a.exr", PIXELS, "float")
    nodes = [
        shader("T", kind, f"asset inputs:{file} = @{path}@", *more),
        shader(
            "N", "ND_multiply_color3FA", "color3f inputs:in1.connect = </Mat/T.outputs:out>", "float inputs:in2 = 0.5"
        ),
    ]
    text = material(STANDARD[1], "color3f inputs:base_color.connect = </Mat/N.outputs:out>", nodes=nodes)
    found = read_scene(usd(text)).meshes[0].material.diffuse
    assert isinstance(found, UVTexture)
    assert np.allclose(found.pixels, 0.5 * np.array(PIXELS))
    expected = [2.5, 2, 1] if more else [1, 1, 1]
    assert np.allclose(found.uv_transform @ [1, 1, 1], expected)


def test_a_place2d_moves_its_image_and_not_the_uvs(usd, image):
    """As in MaterialX, an image that is scaled by 2 is twice as large, and an offset of 0.25 moves it to the right."""
    inputs = "float2 inputs:scale = (2, 2)", "float2 inputs:offset = (0.25, 0)", "float inputs:rotate = 90"
    nodes = [
        shader("T", "ND_image_color3", f"asset inputs:file = @{image('a.exr', PIXELS, 'float')}@",
               "float2 inputs:texcoord.connect = </Mat/P.outputs:out>"),
        shader("P", "ND_place2d_vector2", *inputs),
    ]  # fmt: skip
    text = material(STANDARD[1], "color3f inputs:base_color.connect = </Mat/T.outputs:out>", nodes=nodes)
    found = read_scene(usd(text)).meshes[0].material.diffuse
    # (1, 0.5) is divided by 2 to (0.5, 0.25), rotated clockwise to (0.25, −0.5), and moved to (0, −0.5).
    assert np.allclose(found.uv_transform @ [1, 0.5, 1], [0, -0.5, 1])


def test_primvars_vary_over_the_surface(scene):
    nodes = [
        shader("R", "arnold:user_data_rgb", 'string inputs:attribute = "paint"'),
        shader("N", "arnold:multiply", "color3f inputs:input1.connect = </Mat/R.outputs:out>",
               "color3f inputs:input2 = (0.5, 1, 1)"),
    ]  # fmt: skip
    inputs = "float inputs:Kd = 1", "color3f inputs:Kd_color.connect = </Mat/N.outputs:out>"
    (mesh,) = scene(material("arnold:lambert", *inputs, nodes=nodes)).meshes
    for point, color in zip(mesh.points, mesh.material.diffuse.values, strict=True):
        assert color.tolist() == [0.5 * point[0], point[1], 0]


def test_an_image_of_arnold_is_flipped(scene, image):
    file = f"asset inputs:filename = @{image('a.exr', PIXELS, 'float')}@"
    for name, expected in (("sflip", [[-1, 0, 1], [0, 1, 0]]), ("tflip", [[1, 0, 0], [0, -1, 1]])):
        node = shader("N", "arnold:image", file, f"bool inputs:{name} = 1")
        connected = "color3f inputs:base_color.connect = </Mat/N.outputs:out>"
        found = scene(material(STANDARD[0], connected, nodes=[node])).meshes[0].material.diffuse
        assert np.array_equal(found.uv_transform, [*expected, [0, 0, 1]])


@pytest.mark.parametrize(("kind", "letters"), [("color3", "rgb"), ("vector4", "xyzw")])
def test_a_separated_channel_is_that_of_its_output(scene, caplog, kind, letters):
    value = {"color3": "(0.25, 0.5, 0.75)", "vector4": "(0.25, 0.5, 0.75, 1)"}[kind]
    separate = shader("N", f"ND_separate{len(letters)}_{kind}", f"color{len(letters)}f inputs:in = {value}")
    for index, letter in enumerate(letters):
        connected = f"float inputs:specular_roughness.connect = </Mat/N.outputs:out{letter}>"
        node = separate.replace("color3f outputs:out", f"float outputs:out{letter}")
        found = scene(material(STANDARD[1], connected, nodes=[node], context="mtlx:")).meshes[0].material
        assert found.roughness == (index + 1) / 4
    assert not caplog.text


def test_colours_are_converted_from_the_space_that_they_name(scene):
    """White stays white, and AP1's red has the Rec.709 values of OpenColorIO's ACES configuration."""
    for space, value, expected in (
        ("lin_ap1", "(1, 1, 1)", (1, 1, 1)),
        ("acescg", "(0.5, 0.25, 0.25)", np.clip(0.25 + 0.25 * np.array([1.70505, -0.13026, -0.02400]), 0, None)),
        ("srgb_texture", "(0.5, 0.5, 0.5)", (((0.5 + 0.055) / 1.055) ** 2.4,) * 3),
        ("raw", "(0.5, 0.25, 0)", (0.5, 0.25, 0)),
    ):
        colored = f'color3f inputs:diffuseColor = {value} (\ncolorSpace = "{space}"\n)'
        assert scene(material("UsdPreviewSurface", colored)).meshes[0].material.diffuse == pytest.approx(
            expected, abs=1e-4
        )


@pytest.mark.parametrize(("space", "factor"), [("lin_rec709", 1.0), ("srgb_texture", 0.6038273), ("raw", 1.0)])
def test_an_assets_own_colour_space_wins_over_auto(usd, image, space, factor):
    path = image("a.exr", [[[0.8, 0.8, 0.8], [0, 0, 0]]], "float")
    texture = shader("T", "UsdUVTexture", f'asset inputs:file = @{path}@ (\ncolorSpace = "{space}"\n)')
    text = material("UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Mat/T.outputs:rgb>", nodes=[texture])
    text = text.replace("color3f outputs:out", "color3f outputs:rgb")
    found = read_scene(usd(text)).meshes[0].material.diffuse
    assert np.allclose(found.pixels[0, 0], factor if factor != 1 else 0.8, atol=1e-4)


def test_the_network_that_loses_least_is_read(scene, caplog):
    other = shader("A", "arnold:standard_surface", "float inputs:sheen = 1")
    more = "token outputs:arnold:surface.connect = </Mat/A.outputs:surface>"
    text = material("UsdPreviewSurface", "color3f inputs:diffuseColor = (1, 0, 0)", nodes=[other], more=more)
    assert scene(text).meshes[0].material.diffuse == (1, 0, 0)
    glass = shader("A", "ND_standard_surface_surfaceshader", "float inputs:transmission = 1")
    text = material("UsdPreviewSurface", "color3f inputs:diffuseColor = (1, 0, 0)", nodes=[glass],
                    more=more.replace("arnold", "mtlx"))  # fmt: skip
    assert scene(text).meshes[0].material.opacity == 0
    assert not caplog.text


def test_blenders_opaque_glass_is_named_with_the_flag_that_makes_it_clear(usd, caplog):
    text = material("UsdPreviewSurface", "float inputs:ior = 1.45")
    for before, after in (("/Mat", "/ClearGlass"), ('"Mat"', '"ClearGlass"')):
        text = text.replace(before, after)
    stage = usd(text, 'doc = "Blender v5.0.1"')
    assert read_scene(stage).meshes[0].material.opacity == 1
    assert "/ClearGlass is opaque, because Blender writes no transmission" in caplog.text
    flag, argument = shlex.split(caplog.messages[-1].partition("for glass: ")[2])
    assert flag == "--set"
    mended = open_stage(stage.GetRootLayer().realPath, overrides=[argument])
    assert read_scene(mended).meshes[0].material.opacity == 0


def test_nvidias_shaders_have_their_textures_as_inputs(usd, image):
    path = image("a.exr", PIXELS, "float")
    text = material(
        "x", f"asset inputs:diffuse_texture = @{path}@", "float inputs:metallic_constant = 0.5", context="mdl:"
    )
    text = text.replace(
        'uniform token info:id = "x"',
        '''uniform token info:implementationSource = "sourceAsset"
        uniform token info:mdl:sourceAsset:subIdentifier = "OmniPBR"''',
    )
    found = read_scene(usd(text)).meshes[0].material
    assert np.allclose(found.diffuse.pixels, PIXELS)
    assert found.metallic == 0.5
