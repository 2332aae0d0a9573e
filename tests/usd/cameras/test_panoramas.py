"""Panoramic cameras as photonbeams' attributes describe them, and as other programs write them."""

import logging

import numpy as np
import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import read_camera

PXR = 'def PxrSphereCamera "Proj" {\n    float inputs:hsweep = 180\n    float inputs:vsweep = 90\n}\n'
POLY = """token cameraProjectionType = "fisheyePolynomial"
    float fthetaWidth = 1000
    float fthetaHeight = 500
    float fthetaCx = 600
    float fthetaPolyB = 0.002"""


def camera(body):
    return f'def Camera "C" {{\n    {body}\n}}\n'


def field(found):
    """Return the degrees that a camera sees across and down."""
    return np.degrees([found.horizontal_aperture, found.vertical_aperture])


@pytest.mark.parametrize(
    ("body", "projection", "seen"),
    [
        ('token photonbeams:projection = "equirectangular"', "equirectangular", (360, 180)),
        ('token photonbeams:projection = "equirectangular"\nfloat2 photonbeams:fieldOfView = (180, 90)',
         "equirectangular", (180, 90)),
        ('token photonbeams:projection = "fisheyeEquidistant"', "fisheyeEquidistant", (180, 180)),
        ('token photonbeams:projection = "fisheyeEquidistant"\nfloat2 photonbeams:fieldOfView = (220, 160)',
         "fisheyeEquidistant", (220, 160)),
        ('token primvars:arnold:camera = "spherical_camera"', "equirectangular", (360, 180)),
        ('string primvars:arnold:camera = "fisheye_camera"\nfloat primvars:arnold:fov = 160', "fisheyeEquidistant",
         (160, 160)),
        ('string primvars:arnold:camera = "fisheye_camera"\nfloat horizontalAperture = 20\nfloat focalLength = 10',
         "fisheyeEquidistant", (90, 90)),
        ('token cameraProjectionType = "fisheyeSpherical"', "equirectangular", (360, 180)),
        ('token cameraProjectionType = "fisheyeEquidistant"\nfloat fthetaMaxFov = 200', "fisheyeEquidistant",
         (200, 200)),
        (POLY, "fisheyeEquidistant", np.degrees([2, 1])),
        ("rel ri:projection = </Proj>", "equirectangular", (180, 90)),
        ("token outputs:ri:projection.connect = </Proj.outputs:result>", "equirectangular", (180, 90)),
    ],
)  # fmt: skip
def test_the_projection_and_field_of_view_are_those_that_the_file_says(usd, caplog, body, projection, seen):
    with caplog.at_level(logging.WARNING):
        found = read_camera(usd(camera(body) + PXR))
    assert found.projection == projection
    np.testing.assert_allclose(field(found), seen, rtol=1e-6)
    assert found.angle == pytest.approx(max(seen))
    assert not caplog.records


def test_sensors_are_shifted_by_the_same_fraction_of_the_picture(usd):
    found = read_camera(usd(camera(POLY)))
    assert found.horizontal_offset / found.horizontal_aperture == pytest.approx(-0.1)  # the middle is at 0.6
    body = (
        'token photonbeams:projection = "equirectangular"\nfloat horizontalAperture = 20\nfloat verticalAperture = 20\n'
    )
    found = read_camera(usd(camera(f"{body}float verticalApertureOffset = 5")))
    assert found.vertical_offset == pytest.approx(np.pi / 4)


@pytest.mark.parametrize(
    ("body", "named"),
    [
        ('string primvars:arnold:camera = "cyl_camera"', "primvars:arnold:camera is cyl_camera"),
        ('token cameraProjectionType = "fisheyeKannalaBrandtK3"', "cameraProjectionType is fisheyeKannalaBrandtK3"),
        (f"{POLY}\nfloat fthetaPolyC = 1e-6", "cameraProjectionType is fisheyePolynomial"),
        ('token omni:lensdistortion:model = "opencvFisheye"', "omni:lensdistortion:model is opencvFisheye"),
        ("bool karma:camera:use_lensshader = 1", "karma:camera:use_lensshader is a lens shader"),
        ("rel ri:projection = </Proj>", "ri:projection is PxrCylinderCamera"),
    ],
)
def test_what_is_not_rendered_is_told_in_one_sentence(usd, body, named):
    warnings = Warnings()
    stage = usd(camera(body) + PXR.replace("PxrSphereCamera", "PxrCylinderCamera"))
    assert read_camera(stage, warnings=warnings).projection == "perspective"
    (text,) = warnings.given
    assert f"/C.{named}, which is not rendered" in text and len(text) <= 300


def test_cameras_of_perspective_and_parallel_projection_are_not_told(usd):
    body = """string primvars:arnold:camera = "persp_camera"
    token cameraProjectionType = "pinhole"
    rel ri:projection = </Proj>"""
    warnings = Warnings()
    found = read_camera(usd(camera(body) + PXR.replace("PxrSphereCamera", "PxrCamera")), warnings=warnings)
    assert found.projection == "perspective" and not warnings.given


def test_a_field_of_view_that_cannot_be_is_told_with_its_camera(usd):
    body = 'token photonbeams:projection = "equirectangular"\nfloat2 photonbeams:fieldOfView = (400, 90)'
    with pytest.raises(SceneError, match=r"camera /C: field of view is \(400.0, 90.0\): expected two angles"):
        read_camera(usd(camera(body)))


def test_a_lens_of_a_panoramic_camera_is_told(usd):
    warnings = Warnings()
    body = 'token photonbeams:projection = "equirectangular"\nfloat fStop = 2\nfloat focusDistance = 3'
    assert read_camera(usd(camera(body)), warnings=warnings).lens_radius == 0
    assert "fStop is not used" in next(iter(warnings.given))
