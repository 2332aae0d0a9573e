"""UsdGeomCamera."""

import logging

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import list_cameras, read_camera

PLACED = """
    double3 xformOp:translate = (1, 2, 3)
    float3 xformOp:rotateXYZ = (10, 20, 30)
    float3 xformOp:scale = (2, 3, 4)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
"""
TWO = """
def Xform "A" {
    def Camera "cam" {
    }
}
def Xform "B" {
    def Camera "cam" {
    }
    def Camera "side" {
    }
}
"""


def camera(body=""):
    return f'def Camera "C" {{\n{body}\n}}\n'


def test_apertures_and_focal_length_are_tenths_of_a_scene_unit(usd):
    result = read_camera(
        usd(
            camera(
                """
                float focalLength = 35
                float horizontalAperture = 36
                float verticalAperture = 24
                float horizontalApertureOffset = 2
                float verticalApertureOffset = -1
                float2 clippingRange = (0.5, 200)"""
            )
        )
    )
    assert (result.focal_length, result.horizontal_aperture, result.vertical_aperture) == pytest.approx((3.5, 3.6, 2.4))
    assert (result.horizontal_offset, result.vertical_offset) == pytest.approx((0.2, -0.1))
    assert result.clipping == (0.5, 200)
    assert not result.orthographic
    assert result.name == "/C"


def test_what_is_not_authored_is_as_usd_has_it(usd):
    result = read_camera(usd(camera()))
    assert (result.focal_length, result.horizontal_aperture, result.vertical_aperture) == pytest.approx(
        (5, 2.0955, 1.52908)
    )


def test_exposure_is_as_usd_has_it(usd):
    assert read_camera(usd(camera("float fStop = 4\nfloat focusDistance = 2"))).exposure_scale == 1
    body = """
        float exposure = 1
        float exposure:iso = 400
        float exposure:time = 0.5
        float exposure:fStop = 2
        float exposure:responsivity = 3"""
    assert read_camera(usd(camera(body))).exposure_scale == pytest.approx(2 * 4 * 0.5 * 3 / 2**2)
    stage = usd(camera("float exposure.timeSamples = { 1: 0, 3: 2 }"))
    assert read_camera(stage, time=2).exposure_scale == 2


def test_a_black_exposure_and_a_wrong_projection_are_warned_of_once(usd, caplog):
    caplog.set_level(logging.WARNING, "photonbeams")
    stage, warnings = usd(camera('float exposure:iso = 0\ntoken projection = "fisheye"')), Warnings()
    for _ in range(2):
        result = read_camera(stage, warnings=warnings)
    assert result.exposure_scale == 0 and not result.orthographic
    told = [message.partition("stage.usda: ")[2] for message in caplog.messages]
    assert told == [
        "/C.projection is 'fisheye': expected one of perspective, orthographic; perspective is used",
        "/C.exposure:iso multiplies all light by 0: the picture is black",
    ]


def test_an_orthographic_camera_needs_no_lens(usd):
    result = read_camera(usd(camera('token projection = "orthographic"\nfloat horizontalAperture = 40')))
    assert result.orthographic
    assert result.horizontal_aperture == pytest.approx(4)


def test_the_transform_is_rigid_and_for_column_vectors(usd):
    stage = usd(camera(PLACED))
    matrix = read_camera(stage).to_world
    assert np.allclose(matrix[:3, 3], [1, 2, 3])
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3))
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    world = UsdGeom.Camera(stage.GetPrimAtPath("/C")).ComputeLocalToWorldTransform(0)
    forward = world.TransformDir(Gf.Vec3d(0, 0, -1)).GetNormalized()
    assert np.allclose(matrix[:3, :3] @ [0, 0, -1], forward)


def test_a_view_is_the_same_as_usds_own_frustum(usd):
    body = PLACED + "float horizontalApertureOffset = 3\nfloat verticalApertureOffset = 2"
    stage = usd(camera(body))
    ours = read_camera(stage)
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/C")).GetCamera(0).frustum
    # The upper right corner of the window at distance 1.
    x = (ours.horizontal_aperture / 2 + ours.horizontal_offset) / ours.focal_length
    y = (ours.vertical_aperture / 2 + ours.vertical_offset) / ours.focal_length
    ray = ours.to_world[:3, :3] @ np.array([x, y, -1.0])
    near = np.array(frustum.ComputeCorners()[3]) - ours.to_world[:3, 3]
    assert np.allclose(ray / np.linalg.norm(ray), near / np.linalg.norm(near), atol=1e-6)


def test_a_mirrored_camera_sees_as_it_would_unmirrored(usd):
    body = 'float3 xformOp:scale = (-1, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    assert np.allclose(read_camera(usd(camera(body))).to_world, np.eye(4))


def test_a_camera_moves_with_time(usd):
    body = """
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (4, 0, 0)
        }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    stage = usd(camera(body))
    assert np.allclose(read_camera(stage, "C", 2).to_world[:3, 3], [2, 0, 0])


def test_cameras_are_found_by_path_and_by_name(usd):
    stage = usd(TWO)
    assert list_cameras(stage) == ["/A/cam", "/B/cam", "/B/side"]
    assert read_camera(stage, "/B/cam").name == "/B/cam"
    assert read_camera(stage, "side").name == "/B/side"
    assert read_camera(stage, "B/cam").name == "/B/cam"
    assert read_camera(stage).name == "/A/cam"


def test_the_render_settings_name_the_camera(usd):
    settings = """
    def Scope "Render" {
        def RenderSettings "S" {
            rel camera = <%s>
        }
    }"""
    metadata = 'renderSettingsPrimPath = "/Render/S"'
    assert read_camera(usd(TWO + settings % "/B/side", metadata)).name == "/B/side"
    with pytest.raises(SceneError, match="the render settings name /B/gone, which is not a camera: /A/cam is used"):
        read_camera(usd(TWO + settings % "/B/gone", metadata), warnings=Warnings(strict=True))
    assert read_camera(usd(TWO + settings % "/B/gone", metadata)).name == "/A/cam"


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("", None, r"stage\.usda has no camera"),
        (TWO, "top", "has no camera 'top'"),
        (TWO, "cam", "has several cameras 'cam'"),
        (camera("float focalLength = 0"), None, r"/C\.focalLength is 0"),
        (camera("float horizontalAperture = -1"), None, r"/C\.horizontalAperture is -1.*"),
        (camera("float verticalAperture = nan"), None, r"/C\.verticalAperture is nan"),
        (camera("float exposure = inf"), None, r"/C\.exposure is inf"),
        (camera("float exposure = 90"), None, r"/C\.exposure .* multiply light by 1\.2.*"),
        (camera("float exposure:iso = -100"), None, r"/C\.exposure:iso is -100.*"),
        (camera("float exposure:fStop = 0"), None, r"/C\.exposure:fStop is 0"),
        (camera("float2 clippingRange = (5, 1)"), None, r"/C\.clippingRange is \(5, 1\)"),
        (
            camera('float3 xformOp:scale = (0, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:scale"]'),
            None,
            "/C is scaled to zero",
        ),
    ],
)
def test_a_camera_that_makes_no_picture_is_an_error(usd, text, name, message):
    with pytest.raises(SceneError, match=message):
        read_camera(usd(text), name, warnings=Warnings(strict=True))
