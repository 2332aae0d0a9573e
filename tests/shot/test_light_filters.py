"""Filters of lights in pictures: a blocker is as dark as a mesh in its place, in fog and on surfaces."""

import dataclasses

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from tests.helpers.comparison import box, quad

GREY = scene.Material(diffuse=(0.5, 0.5, 0.5))
FLOOR = quad("/Floor", [[-6, 0, -6], [-6, 0, 6], [6, 0, 6], [6, 0, -6]], GREY)
FOG = pb.Medium((0.1, 0.1, 0.1), name="/Fog", mesh=box("/Fog", [-5, -1, -5], [5, 5, 5]))
LAMP = scene.SphereLight(
    "/Lamp", (800.0,) * 3, center=np.array([0, 3.5, 0]), radius=0.05, axis=np.array([0, -1.0, 0]),
    shaping=scene.Shaping(cone_angle=50),
)  # fmt: skip
CAMERA = scene.Camera.look_at([0, 1.5, 9], [0, 1.5, 0], fov=50, aspect=1.5)
SMALL = {"width": 48, "passes": 8, "beams": 2048}
PLACE = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 2.6], [0, 0, 1, 0], [0, 0, 0, 1]])
LOW, HIGH = np.array([0.25, 2.5, -0.25]), np.array([0.75, 2.7, 0.25])
FLAG = scene.Blocker("/Flag", 0.5 * (HIGH - LOW), frame=PLACE)


def picture(*lights, meshes=(FLOOR,), **more):
    shot = pb.Shot(scene.Scene(meshes=list(meshes), lights=list(lights), media=[FOG]), CAMERA)
    return shot.render(**SMALL, **more).layers


def filtered(*filters, **more):
    return picture(dataclasses.replace(LAMP, filters=filters), **more)


@pytest.fixture(scope="module")
def whole():
    return picture(LAMP)


def test_a_blocker_is_as_dark_as_a_mesh_in_its_place(whole):
    blocked, stopped = filtered(FLAG), picture(LAMP, meshes=(FLOOR, box("/Flag", LOW, HIGH)))
    away = np.ones((32, 48), bool)
    away[5:11, 22:32] = False  # the mesh is seen there, and behind it less fog
    for name, most in (("beams", 0.1), ("surface", 0.02)):
        shadow = (whole[name] - stopped[name])[away]
        difference = np.abs(blocked[name] - stopped[name])[away]
        assert np.max(shadow / np.maximum(whole[name][away], 1e-6)) > 0.4
        # Beams end at a mesh as wide as it lets them be, but at a blocker as wide as they are.
        assert difference.max() < most * shadow.max()
        assert difference.mean() < 0.05 * shadow.mean()


@pytest.mark.parametrize("bounces", [0, 1])
def test_surfaces_and_beams_have_the_same_fraction_of_filtered_light(whole, bounces):
    """A quarter of all light, and of what it becomes when it is scattered once more."""
    whole = whole if bounces == 0 else picture(LAMP, max_depth=3)
    quarter = filtered(scene.DistanceRamp("/Quarter", [0.0], [[0.25, 0.5, 1.0]]), max_depth=2 + bounces)
    for name in ("beams", "surface"):
        ratio = quarter[name].reshape(-1, 3).sum(axis=0) / whole[name].reshape(-1, 3).sum(axis=0)
        assert np.allclose(ratio, [0.25, 0.5, 1], rtol=1e-3 if bounces == 0 else 0.02)
