"""Fog of a stage that falls with height, and has wisps."""

import numpy as np
import pytest

from photonbeams import Shot
from photonbeams.scene import FogDensity, FogNoise, SceneError
from photonbeams.usd.stage import read_scene
from tests.helpers.sweep import sweep

API = '(prepend apiSchemas = ["PhotonBeamsMediumAPI"])'
SHAPED = """
    color3f photonbeams:absorption = (0.1, 0.2, 0.4)
    float photonbeams:height:falloff = 1.5
    float photonbeams:height:ground = -0.5
"""
WISPS = """
    float photonbeams:noise:amount = 0.5
    float photonbeams:noise:scale = 3
    int photonbeams:noise:octaves = 2
    float photonbeams:noise:contrast = 1
    float3 photonbeams:noise:drift = (1, 2, 3)
    float photonbeams:noise:evolution = 0.25
"""


def test_a_fog_falls_with_height_and_has_wisps(scene, usd, caplog):
    found = scene(f'def Scope "F" {API} {{\n{SHAPED}{WISPS}\n}}').medium
    assert found.density == FogDensity(1.5, -0.5, FogNoise(0.5, 3, 2, 1, (1, 2, 3), 0.25))
    stage = usd(f'def Scope "F" {API} {{\n{SHAPED}{WISPS}\n}}\ndef Camera "C" {{\n}}\ndef DomeLight "L" {{\n}}')
    density = Shot(stage).read(36)[0].media[0].density
    assert (density.up, density.seconds) == ("Y", 1.5)  # of 24 frames
    assert scene(f'def Cube "F" {API} {{\ncolor3f photonbeams:scattering = (1, 1, 1)\n}}').medium.density is None
    assert not caplog.text


def test_a_volume_has_the_density_of_its_field(scene, caplog, tmp_path):
    grid = tmp_path / "even.vol"
    head = np.array([1, 2, 2, 2, 1], "<i4").tobytes() + np.array([-1, -1, -1, 1, 1, 1], "<f4").tobytes()
    grid.write_bytes(b"VOL\3" + head + np.ones(8, "<f4").tobytes())
    (medium,) = scene(f"""def Volume "V" {API} {{
        {SHAPED}
        rel field:density = </V/D>
        def OpenVDBAsset "D" {{ asset filePath = @{grid}@ }}
    }}""").media
    assert medium.density is None
    assert "/V.photonbeams:height:falloff is not used: a Volume has the density of its field" in caplog.text


BOXED = """
    def Xform "House" {
        double3 xformOp:translate = (7, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Room" {
            float3 xformOp:scale = (2, 1, 1)
            float3 xformOp:scale.timeSamples = { 1: (2, 1, 1), 2: (3, 1, 1) }
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
        def SphereLight "Lamp" { double3 xformOp:translate = (0, 3, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"] }
    }
"""


def test_fog_fills_the_box_around_prims(usd, scene):
    fog = f'def Scope "F" {API} {{\n{SHAPED}rel photonbeams:box = %s\n}}{BOXED}'
    for time, wide in ((1, 2), (2, 3)):
        points = read_scene(usd(fog % "</House/Room>"), time).media[0].mesh.points
        np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [(7 - wide, -1, -1), (7 + wide, 1, 1)])
    found = scene(fog % "[</House/Room>, </House/Lamp>]").media[0].mesh
    np.testing.assert_allclose(found.points.max(axis=0)[1], 3.5)
    unseen = 'def Cube "Room" {\nuniform token purpose = "guide"\ntoken visibility = "invisible"'
    helper = scene((fog % "</House/Room>").replace('def Cube "Room" {', unseen)).media[0].mesh
    np.testing.assert_allclose(helper.points.max(axis=0), (9, 1, 1))
    with pytest.raises(SceneError, match=r"/F.photonbeams:box names /No: expected a prim that is on the stage"):
        scene(fog % "</No>")
    with pytest.raises(SceneError, match=r"names no space for fog: the box around /F is empty"):
        scene(fog % "</F>")


@pytest.mark.parametrize("box", sweep([True, False], keep=[False]), ids=["box", "endless"])
def test_transmittance_is_the_closed_form_in_any_unit_and_far_from_the_origin(usd, box):
    """Rays straight down, and slanted ones, through fog in front of a floor, on a stage in centimetres.

    Everything is 100 times as large as in the closed form, and lies 1,000 of its units from the origin.
    """
    size, far = 100.0, 1e5
    place = f"double3 xformOp:translate = ({far}, {far}, {{}})"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"{}]'
    kind = f"""def Cube "F" {API} {{
        {place.format(size)}
        double3 xformOp:scale = (400, 400, {1.5 * size})
        {order.format(', "xformOp:scale"')}""" if box else f'def Scope "F" {API} {{'  # fmt: skip
    corners = ", ".join(f"({far + x * 900}, {far + y * 900}, 0)" for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    stage = usd(f"""
        {kind}
            color3f photonbeams:absorption = (0.002, 0.004, 0.008)
            float photonbeams:height:falloff = 80
            float photonbeams:height:ground = 30
        }}
        def Mesh "Floor" {{
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
            point3f[] points = [{corners}]
        }}
        def DistantLight "L" {{ int photonbeams:count = 4 }}
        def Camera "C" {{
            {place.format(3 * size)}
            float3 xformOp:rotateXYZ = (10, 0, 0)
            {order.format(', "xformOp:rotateXYZ"')}
        }}""", 'upAxis = "Z"\nmetersPerUnit = 0.01')  # fmt: skip
    found = Shot(stage).render(passes=32, width=8, height=8).layers["transmittance"]

    def integral(height):
        return min(height, 30) + 80 * -np.expm1(-max(height - 30, 0) / 80)

    top = 2.5 * size if box else 3 * size  # of the cube, or the camera's height
    # The fog between two heights, times the length of rays per unit of height. The camera looks down, turned about x.
    x, y = np.meshgrid((np.arange(8) - 3.5) / 8 * 20.955 / 50, (3.5 - np.arange(8)) / 8 * 20.955 / 50)
    slopes = np.sqrt(1 + x**2 + y**2) / (np.cos(np.radians(10)) - np.sin(np.radians(10)) * y)
    depth = (integral(top) - integral(0)) * slopes[..., None] * np.array([0.002, 0.004, 0.008])
    # A pass spreads by 2 %, and a pixel's slope by 1 %.
    np.testing.assert_allclose(found, np.exp(-depth), rtol=0.02)
