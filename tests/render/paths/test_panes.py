"""Panes of glass without thickness: light and sight go straight through them, with two sides' Fresnel reflection."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene

RHO, IOR, DOWN = 0.6, 1.5, np.array([0.5, -1.0, 0.0])
COSINE = 1 / np.sqrt(1.25)
FLOOR = scene.Material(diffuse=(RHO,) * 3, ior=1.0)


def card(name, corners, material):
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    return scene.Mesh(name, np.array(corners, dtype=np.float64), faces, material=material)


def flat(name, height, half, material):
    corners = (-half, half), (half, half), (half, -half), (-half, -half)
    return card(name, [[x, height, z] for x, z in corners], material)


def passed(cosine):
    """Return how much light passes a thin pane: (1 − R) / (1 + R), for Fresnel's reflectance R of one of its sides."""
    inside = np.sqrt(1 - (1 - cosine**2) / IOR**2)
    across = ((cosine - IOR * inside) / (cosine + IOR * inside)) ** 2
    along = ((IOR * cosine - inside) / (IOR * cosine + inside)) ** 2
    reflected = (across + along) / 2
    return (1 - reflected) / (1 + reflected)


@pytest.mark.parametrize(
    ("glass", "factor"),
    [(scene.Material(opacity=0.0, roughness=0.0, ior=IOR), passed(COSINE)),
     (scene.Material(opacity=0.3, roughness=0.5, ior=IOR), 0.7)],
    ids=["clear", "faint"],
)  # fmt: skip
@pytest.mark.parametrize("scale", [0.01, 1.0, 300.0])
def test_a_pane_dims_the_sun_and_does_not_bend_it(glass, factor, scale):
    """The floor under a pane, seen from below it, has the light of the sun, and a bounce adds less than 1 %.

    Of the light of the floor, the pane sends back a tenth; it lands where the picture does not show it.
    """
    sun = scene.DistantLight("/Sun", (2.0,) * 3, axis=DOWN / np.linalg.norm(DOWN), angle=0.0)
    meshes = (flat("/Floor", 0.0, 0.3 * scale, FLOOR), flat("/Pane", 2 * scale, 4 * scale, glass))
    camera = scene.Camera.look_at((0, 1 * scale, 2 * scale), (0, 0, 0), fov=3)
    described = scene.Scene(lights=(sun,), meshes=meshes)
    picture = pb.Shot(described, camera).render(passes=1, width=64, height=64, max_depth=5).layers["surface"]
    picture = picture[..., :3].reshape(16, 4, 16, 4, 3).mean(axis=(1, 3))
    expected = RHO / np.pi * 2.0 * COSINE * factor
    assert picture.mean() == pytest.approx(expected, rel=0.01)
    assert picture.std() < 0.05 * expected


def test_a_pane_shows_what_is_straight_behind_it():
    """A slanted pane in front of a glowing card with edges in the middle of pixels' columns."""
    glow = scene.Material(diffuse=(0.0,) * 3, emissive=(1.0, 1.0, 1.0), ior=1.0)
    lit = card("/Card", [[0, -9, -4], [9, -9, -4], [9, 9, -4], [0, 9, -4]], glow)
    slant = card("/Pane", [[-3, -3, -3], [3, -3, -1], [3, 3, -1], [-3, 3, -3]],
                 scene.Material(opacity=0.0, roughness=0.0, ior=IOR))  # fmt: skip
    camera = scene.Camera.look_at((0, 0, 0), (0, 0, -1), fov=10)
    shot = pb.Shot(scene.Scene(meshes=(lit, slant)), camera)
    # All rows show the same: 16 of them have as many samples as one has in 16 times the passes.
    picture = shot.render(passes=32, width=64, height=64, max_depth=5).layers["rgba"][..., 0]
    picture = picture.reshape(4, 16, 64).mean(axis=1)
    cosine = 3 / np.sqrt(10)
    assert picture[:, :32].max() < 0.01
    np.testing.assert_allclose(picture[:, 32:].mean(), passed(cosine), rtol=0.01)
