"""The layer `normal`: a sphere has the normals of its formula, and a normal-mapped card those of its map."""

import numpy as np
import OpenEXR
import pytest

import photonbeams as pb
from photonbeams.images.files import read_layers

STAGE = """
def Camera "Cam" {
    float focalLength = 50
    float horizontalAperture = 24
    float verticalAperture = 24
    double3 xformOp:translate = (0.013, 0.007, 6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Sphere "Ball" {
    double radius = 1
}
def Mesh "Card" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 3, 2, 1]
    point3f[] points = [(-9, -9, -3), (9, -9, -3), (9, 9, -3), (-9, 9, -3)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    rel material:binding = </Mat>
}
def Material "Mat" {
    token outputs:surface.connect = </Mat/S.outputs:surface>
    def Shader "S" {
        uniform token info:id = "UsdPreviewSurface"
        normal3f inputs:normal.connect = </Mat/T.outputs:rgb>
        token outputs:surface
    }
    def Shader "T" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @normals.exr@
        token inputs:sourceColorSpace = "raw"
        float4 inputs:scale = (2, 2, 2, 1)
        float4 inputs:bias = (-1, -1, -1, 0)
        float3 outputs:rgb
    }
}
def SphereLight "Lamp" {
    float inputs:radius = 0.1
    double3 xformOp:translate = (0, 5, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


@pytest.fixture(scope="module")
def layers(tmp_path_factory):
    tilted = np.array([0.36, 0.48, 0.8])
    path = tmp_path_factory.mktemp("stage") / "stage.usda"
    path.write_text(f"#usda 1.0\n{STAGE}")
    pixels = np.tile((tilted / 2 + 0.5).astype(np.float32), (2, 2, 1))
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": pixels}).write(str(path.with_name("normals.exr")))
    frame = pb.Shot.open(path).render(passes=1, width=31, height=31, beams=16, normals=True)
    file = tmp_path_factory.mktemp("out") / "frame.exr"
    frame.write(file)
    return frame.layers, read_layers(file), file


def test_normals_are_in_world_space_toward_the_camera_as_maps_tilt_them(layers):
    normal, depth = layers[0]["normal"], layers[0]["depth"][..., 0]
    # Pixels are square; 31 of them span 24 / 50 at unit distance.
    x, y = np.meshgrid((np.arange(31) - 15) / 31 * 0.48, (15 - np.arange(31)) / 31 * 0.48)
    points = np.stack([x, y, -np.ones_like(x)], axis=-1) * depth[..., None] + [0.013, 0.007, 6]
    ball = np.linalg.norm(points, axis=-1) < 1.5
    assert ball.sum() > 50
    # The ball is a mesh with linear normals; half an edge spans the angle whose cosine is the smallest radius.
    radius = np.linalg.norm(points[ball], axis=-1)
    expected, toward = points[ball] / radius[:, None], [0.013, 0.007, 6] - points[ball]
    facing = np.sum(expected * toward, axis=-1) / np.linalg.norm(toward, axis=-1)
    error, bend = np.abs(normal[ball] - expected).max(axis=-1), np.arccos(radius.min())
    assert error[facing > bend].max() < bend**3
    assert error.max() < bend  # at the rim, normals are bent so that they mirror rays away from the facet
    # The card's faces wind around −z, away from the camera: the tangent frame is (x, y mirrored by its handedness, −z).
    card = normal[~ball]
    assert np.allclose(card, card[0], atol=1e-5)
    assert card[0] == pytest.approx([-0.36, -0.48, 0.8], abs=1e-5)


def test_a_file_has_normals_in_x_y_and_z_in_single_precision(layers):
    with OpenEXR.File(str(layers[2]), separate_channels=True) as file:
        (part,) = [part for part in file.parts if part.name() == "normal"]
        assert {name: each.pixels.dtype for name, each in part.channels.items()} == dict.fromkeys("XYZ", np.float32)
    assert np.array_equal(layers[1]["normal"], layers[0]["normal"])
