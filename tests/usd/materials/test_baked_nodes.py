"""Ramps, colour corrections and bumps: shading nodes that are baked into textures."""

import colorsys

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from photonbeams.scene import UVTexture
from photonbeams.usd.materials.corrections import from_hsv, to_hsv
from photonbeams.usd.materials.ramps import CATMULL_ROM, CONSTANT, LINEAR, MONOTONE, ramp
from photonbeams.usd.stage import read_scene
from tests.usd.materials.networks import PIXELS, STANDARD, material, shader

AT, KNOTS = [0.1, 0.3, 0.4, 0.8, 0.9], np.array([[0.0], [2.0], [2.5], [1.0], [4.0]])
X = np.linspace(0, 1, 97)[:, None]


def colored(*nodes):
    """Return a stage whose diffuse colour is the output of the node N, which is one of these nodes."""
    return material("UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Mat/N.outputs:out>", nodes=nodes)


def test_ramps_are_those_of_numpy_and_scipy():
    def found(kind):
        return ramp(X, AT, [kind] * 5, list(KNOTS))[:, 0]

    x, values = X[:, 0], KNOTS[:, 0]
    assert np.allclose(found(LINEAR), np.interp(x, AT, values))
    assert np.array_equal(found(CONSTANT), values[np.clip(np.searchsorted(AT, x, "right") - 1, 0, None)])
    slopes = np.zeros(5)
    slopes[1:-1] = (values[2:] - values[:-2]) / (np.array(AT)[2:] - np.array(AT)[:-2])
    inside = np.clip(x, AT[0], AT[-1])
    assert np.allclose(found(CATMULL_ROM), CubicHermiteSpline(AT, values, slopes)(inside))
    # SciPy uses other slopes at the ends.
    middle = (x >= AT[1]) & (x <= AT[3])
    assert np.allclose(found(MONOTONE)[middle], PchipInterpolator(AT, values)(x)[middle])


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        (
            "arnold:ramp_rgb",
            ('token inputs:type = "v"', "float[] inputs:position = [1, 0]",
             "color3f[] inputs:color = [(1, 0, 0), (0, 0.5, 1)]"),
            lambda u, v: [v, 0.5 * (1 - v), 1 - v],
        ),
        ("ND_ramplr_color3", ("color3f inputs:valuel = (1, 0, 0)", "color3f inputs:valuer = (0, 0.5, 1)"),
         lambda u, v: [1 - u, 0.5 * u, u]),
        ("ND_ramptb_color3", ("color3f inputs:valuet = (1, 0, 0)", "color3f inputs:valueb = (0, 0.5, 1)"),
         lambda u, v: [v, 0.5 * (1 - v), 1 - v]),
        ("PxrRamp", ("int inputs:rampType = 2", "color3f[] inputs:colors = [(0, 0, 0), (1, 1, 1)]",
                     "float[] inputs:positions = [0, 1]", "int inputs:basis = 1"),
         lambda u, v: [(u + v) / 2] * 3),
    ],
    ids=["arnold", "left to right", "top to bottom", "renderman"],
)  # fmt: skip
def test_ramps_over_uvs_are_images(scene, kind, inputs, expected):
    found = scene(colored(shader("N", kind, *inputs))).meshes[0].material.diffuse
    rows, columns = found.pixels.shape[:2]
    u, v = (np.arange(columns)[None, :] + 0.5) / columns, 1 - (np.arange(rows)[:, None] + 0.5) / rows
    assert np.allclose(found.pixels, np.stack(np.broadcast_arrays(*expected(u, v)), axis=-1), atol=1e-6)


def test_a_ramp_follows_its_input_and_its_knots_may_be_connected(scene):
    nodes = [
        shader("N", "arnold:ramp_rgb", "float inputs:input = 0.25", "color3f[] inputs:color = [(0, 0, 0), (1, 1, 1)]",
               "color3f inputs:color:i1.connect = </Mat/C.outputs:out>"),
        shader("C", "ND_constant_color3", "color3f inputs:value = (0.4, 0.8, 0)"),
    ]  # fmt: skip
    assert scene(colored(*nodes)).meshes[0].material.diffuse == pytest.approx((0.1, 0.2, 0))


def test_hues_are_those_of_colorsys():
    colors = np.random.default_rng(3).random((50, 3))
    colors[:3] = [[0, 0, 0], [0.5, 0.5, 0.5], [1, 0, 0]]
    assert np.allclose(to_hsv(colors), [colorsys.rgb_to_hsv(*each) for each in colors.tolist()])
    assert np.allclose(from_hsv(to_hsv(3 * colors)), 3 * colors)


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        # A hue shift of a third turns red to green. A gamma of 2 takes the square root. A contrast of 2 doubles the
        # difference from 0.18 (Arnold) or 0.5 (MaterialX). An exposure of -1 halves the colour.
        ("arnold:color_correct", ("color3f inputs:input = (0.5, 0, 0)", "float inputs:hue_shift = 0.3333333"),
         (0, 0.5, 0)),
        ("arnold:color_correct", ("color3f inputs:input = (0.25, 0.25, 0.25)", "float inputs:gamma = 2",
                                  "float inputs:contrast = 2", "float inputs:exposure = -1",
                                  "color3f inputs:add = (0.1, 0, 0)"), (0.51, 0.41, 0.41)),
        ("ND_colorcorrect_color3", ("color3f inputs:in = (0.2, 0.4, 0.6)", "float inputs:contrast = 2",
                                    "float inputs:lift = 0.5", "float inputs:gain = 0.5"), (0.1, 0.2, 0.3)),
        ("ND_hsvadjust_color3", ("color3f inputs:in = (0.5, 0.25, 0.25)", "float3 inputs:amount = (0.5, 0, 2)"),
         (1, 1, 1)),
    ],
)  # fmt: skip
def test_colours_are_corrected(scene, caplog, kind, inputs, expected):
    assert scene(colored(shader("N", kind, *inputs))).meshes[0].material.diffuse == pytest.approx(expected, abs=1e-5)
    assert not caplog.text


def test_an_image_with_alpha_goes_with_colours_without(usd, image):
    path = image("a.exr", [[[0.2, 0.4, 0.6, 0.5], [0.8, 1, 0, 1]]], "float")
    nodes = [
        shader("N", "ND_multiply_color3", "color3f inputs:in1.connect = </Mat/T.outputs:out>",
               "color3f inputs:in2 = (1, 0.5, 0)"),
        shader("T", "ND_image_color3", f"asset inputs:file = @{path}@"),
    ]  # fmt: skip
    found = read_scene(usd(colored(*nodes))).meshes[0].material.diffuse
    assert np.allclose(found.pixels, np.array(PIXELS) * [1, 0.5, 0])


def test_what_is_no_function_of_uvs_is_named_and_its_mean_used(scene, caplog):
    found = scene(colored(shader("N", "arnold:noise", "color3f inputs:color1 = (1, 0, 0)"))).meshes[0].material
    assert found.diffuse == (0.5, 0, 0)
    assert "/Mat/N is a 'arnold:noise', which is not rendered: the mean of its colours is used" in caplog.text


HEIGHTS = np.sin(np.arange(16) / 16 * 2 * np.pi) * np.ones((16, 1))


def bumped(usd, image, kind, *inputs, node="N"):
    path = image("h.exr", np.repeat(HEIGHTS[..., None], 3, axis=2), "float")
    nodes = [
        shader("N", kind, *(each.replace("HEIGHT", "</Mat/T.outputs:out>") for each in inputs)),
        shader("M", "ND_normalmap", "float3 inputs:in.connect = </Mat/N.outputs:out>"),
        shader("T", "ND_image_float", f"asset inputs:file = @{path}@"),
    ]
    text = material(STANDARD[0], f"normal3f inputs:normal.connect = </Mat/{node}.outputs:out>", nodes=nodes)
    return read_scene(usd(text)).meshes[0].material


@pytest.mark.parametrize(("kind", "name", "node"), [("ND_bump_vector3", "height", "N"),
                                                    ("ND_heighttonormal_vector3", "in", "M")])  # fmt: skip
def test_heights_in_materialx_are_normals_by_their_slopes(usd, image, kind, name, node):
    found = bumped(
        usd, image, kind, f"float inputs:{name}.connect = HEIGHT", "float inputs:scale = 4", node=node
    ).normal
    assert isinstance(found, UVTexture)
    slope = (np.roll(HEIGHTS, -1, axis=1) - np.roll(HEIGHTS, 1, axis=1)) * 16 / 2 * 4 / 16
    normals = np.stack([-slope, 0 * slope, np.ones_like(slope)], axis=-1) / np.sqrt(1 + slope**2)[..., None]
    assert np.allclose(2 * found.pixels - 1, normals, atol=1e-6)


@pytest.mark.parametrize(("kind", "name", "scale"), [("arnold:bump2d", "bump_map", "bump_height"),
                                                     ("PxrBump", "inputBump", "scale")])  # fmt: skip
def test_heights_in_arnold_and_renderman_are_in_scene_units(usd, image, kind, name, scale):
    found = bumped(usd, image, kind, f"float inputs:{name}.connect = HEIGHT", f"float inputs:{scale} = 0.1")
    assert found.normal is None
    assert np.allclose(found.bump.pixels[..., 0], 0.1 * HEIGHTS, atol=1e-6)


def test_heights_that_are_no_image_are_named(scene, caplog):
    nodes = [
        shader("N", "arnold:bump2d", "float inputs:bump_map.connect = </Mat/R.outputs:out>"),
        shader("R", "arnold:user_data_float", 'string inputs:attribute = "paint"'),
    ]
    text = material(STANDARD[0], "normal3f inputs:normal.connect = </Mat/N.outputs:out>", nodes=nodes)
    assert scene(text).meshes[0].material.bump is None
    assert "/Mat/N has no image for its heights: it is ignored" in caplog.text
