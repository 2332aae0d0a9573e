"""Stages that seem to have no light: surfaces that glow are lamps, and a sun that is too dim is named."""

import re

import numpy as np
import pytest

import photonbeams as pb

CAMERA = """
def Camera "Cam" {
    token projection = "orthographic"
    float horizontalAperture = 20
    float verticalAperture = 20
    double3 xformOp:translate = (0, 1.9, 0)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
    uniform token subdivisionScheme = "none"
}
"""
GLOWING = """
def Mesh "Lamp" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [%s]
    point3f[] points = [(-0.5, 2, -0.5), (0.5, 2, -0.5), (0.5, 2, 0.5), (-0.5, 2, 0.5)]
    uniform token subdivisionScheme = "none"
    rel material:binding = </Glow>
}
def Material "Glow" {
    token outputs:surface.connect = </Glow/S.outputs:surface>
    def Shader "S" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:emissiveColor = (15, 10, 5)
        token outputs:surface
    }
}
"""
RECTANGLE = """
def RectLight "Lamp" {
    float inputs:intensity = 5
    color3f inputs:color = (3, 2, 1)
    double3 xformOp:translate = (0, 2, 0)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
"""


def floor(stage):
    """Return the mean colour of a floor of 2 by 2 below a lamp, (3,)."""
    frame = pb.Shot(stage).render(width=16, height=16, passes=8)
    return frame.layers["surface"].reshape(-1, 3).mean(axis=0)


def test_a_glowing_sheet_lights_a_floor_as_a_rectangle_light_does_whatever_its_winding(usd):
    expected = floor(usd(CAMERA + RECTANGLE))
    assert expected[0] > 0.2
    for winding in ("0, 1, 2, 3", "3, 2, 1, 0"):
        assert floor(usd(CAMERA + GLOWING % winding)) == pytest.approx(expected, rel=0.02)


def test_a_sun_that_leaves_surfaces_black_is_named_with_the_exposure_that_shows_them(usd, caplog):
    sun = """
    def DistantLight "Sun" {
        float inputs:intensity = 1.6
        bool inputs:normalize = %d
        float xformOp:rotateX = -90
        uniform token[] xformOpOrder = ["xformOp:rotateX"]
    }
    """
    dark = floor(usd(CAMERA + sun % 0))
    found = re.search(
        r"/Sun gives an irradiance .*1.6 over 0.53 degrees.* black: ([\d.]+) stops more show them", caplog.text
    )
    assert found
    # A facing plane then gets an irradiance of π: the floor reflects 18 % of it, and mirrors some into the camera.
    assert np.all(np.abs(dark * 2 ** float(found[1]) - 0.3) < 0.12)
    caplog.clear()
    floor(usd(CAMERA + sun % 1))
    floor(usd(CAMERA.replace("Aperture = 20\n", "Aperture = 20\n    float exposure = 14\n", 1) + sun % 0))
    floor(usd(CAMERA + sun % 0 + 'def SphereLight "Lamp" {\n}\n'))
    assert "black" not in caplog.text
