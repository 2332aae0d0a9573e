"""Smooth normals on coarse meshes: where they face away from the camera, or mirror it below the mesh, nothing is black.

A cube of six quads has normals between its faces, of which some look away from a camera that sees a side at a slant.
"""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.runtime.device import mitsuba
from photonbeams.world.surfaces.shapes import shape_of
from tests.helpers.mitsuba_scenes import camera, load

mi = mitsuba()

EYE, AT, FOV = (1.2, 0.2, 4.0), (0.0, 0.0, 0.0), 16
CORNERS = scene.Mesh.box("/Cube", (-0.5,) * 3, (0.5,) * 3)
ALBEDO = 0.5
MATERIALS = {
    "diffuse": scene.Material(diffuse=(ALBEDO,) * 3, ior=1.0),
    "mirror": scene.Material(diffuse=(1.0,) * 3, metallic=1.0, roughness=0.0),
}
BSDFS = {
    "diffuse": {"type": "twosided", "side": {"type": "diffuse", "reflectance": ALBEDO}},
    "mirror": {"type": "twosided", "side": {"type": "conductor", "material": "none"}},
}


def cube(material):
    normals = CORNERS.points / np.linalg.norm(CORNERS.points, axis=1, keepdims=True)
    return scene.Mesh("/Cube", CORNERS.points, CORNERS.faces, normals, material=material)


def stage(name):
    sky = scene.DomeLight("/Sky", (1.0,) * 3)
    eye = scene.Camera.look_at(EYE, AT, fov=FOV)
    return pb.Shot(scene.Scene(lights=(sky,), meshes=(cube(MATERIALS[name]),)), eye)


def in_mitsuba(name):
    shape = shape_of(cube(scene.Material()), mi.load_dict(BSDFS[name]))
    sky = {"type": "constant", "radiance": 1.0}
    return pb.Shot(load(cube=shape, sky=sky, sensor=camera(EYE, AT, fov=FOV)))


@pytest.mark.parametrize("shot", [stage, in_mitsuba])
@pytest.mark.parametrize("name", MATERIALS)
def test_smooth_normals_lose_little_light_under_an_even_sky(shot, name):
    """A mirror shows the sky everywhere.

    A normal that is tilted by θ sends (1 − cos θ) / 2 of a diffuse surface's light below the surface, and θ is at most
    the angle between a cube's diagonal and its axis, whose cosine is 1 / √3.
    """
    frame = shot(name).render(passes=128 if name == "diffuse" else 4, width=24, height=24, max_depth=4)
    image = frame.layers["rgba"].astype(float)
    seen = image[..., :3].mean(axis=2)[image[..., 3] > 0.999]
    assert len(seen) > 100
    if name == "mirror":
        np.testing.assert_allclose(seen, 1, atol=1e-3)
        return
    # Of so many passes with two samples of light or more, each of 0 to 1, a pixel's error is at most 0.5 / √256.
    assert seen.min() > ALBEDO * (1 + 1 / np.sqrt(3)) / 2 - 4 * 0.5 / 16 * ALBEDO
    assert seen.max() < ALBEDO + 4 * 0.5 / 16 * ALBEDO
