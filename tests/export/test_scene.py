"""Scenes in Mitsuba's terms: cameras, the places of media, and ids."""

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.export.scene import Twin, sensor_of, twin_of
from photonbeams.runtime.device import mitsuba
from photonbeams.world.cameras.cameras import View, Window
from tests.helpers.comparison import box

mi = mitsuba()


def turned(angle):
    result = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    result[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    result[:3, 3] = 1, 2, 3
    return result


@pytest.mark.parametrize("crop", [(0, 0, 24, 16), (3, 4, 20, 12)])
@pytest.mark.parametrize("size", [(24, 16), (24, 30)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_rays_of_the_sensor_are_those_of_the_camera(projection, size, crop):
    camera = scene.Camera("/c", turned(0.3), 2.4, 2.4, 1.6, 0.5, -0.3, projection, (0.1, 1000))
    window = Window(*size, crop)
    sensor = mi.load_dict(sensor_of(camera, window, reach=5.0))
    height, width = window.shape
    assert tuple(sensor.film().crop_size()) == (width, height)
    rays = View(camera, window).rays((0.5, 0.5))
    index = np.arange(width * height)
    place = mi.Point2f((index % width + 0.5) / width, (index // width + 0.5) / height)
    found, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5), True)
    direction, origin = (np.broadcast_to(np.array(each), (3, len(index))) for each in (rays.direction, rays.origin))
    assert np.allclose(np.array(found.d), direction, atol=1e-6)
    # Mitsuba's rays begin at its near plane, on the lines of the camera's rays.
    ahead = np.array(found.o) - origin
    assert np.allclose(np.cross(ahead, direction, axis=0), 0, atol=2e-6)
    assert np.max(np.abs(ahead)) < 1e-3


def test_clipping_planes_cut_off_nothing_of_the_scene():
    camera = scene.Camera("/c", np.eye(4), clipping=(1.0, 2.0))
    sensor = sensor_of(camera, Window.full(4, 4), reach=50.0)
    assert sensor["near_clip"] <= 50e-4 and sensor["far_clip"] >= 500


@pytest.mark.parametrize("points", [(0.2, 0.3, 0.4), (0.999, 0.999, 0.001), (1.001, 0.5, 0.5), (-3, 0.5, 0.5)])
def test_points_are_inside_of_a_box_where_their_coordinates_are(points):
    mesh = box("/box", (0, 0, 0), (1, 1, 1))
    assert (mesh.winding(np.array(points)) > 0.5) == all(0 < each < 1 for each in points)


def test_a_panorama_is_told():
    with pytest.raises(scene.SceneError, match="/dome is fisheyeEquisolid, and Mitsuba has no such sensor"):
        sensor_of(scene.Camera.panorama("/dome", np.eye(4), "fisheyeEquisolid"), Window.full(4, 4), 1.0)


def test_a_box_is_closed_until_it_lacks_a_face():
    mesh = box("/box", (0, 0, 0), (1, 1, 1))
    assert mesh.closed
    assert not scene.Mesh("/box", mesh.points, mesh.faces[1:]).closed


def test_ids_differ_by_more_than_their_case():
    twin = Twin("files")
    found = [twin.id_of(path) for path in ("/World/Lamp", "/world/lamp", "/World.Lamp", "/Ä")]
    assert found == ["World-Lamp", "world-lamp-2", "World-Lamp-3", "part"]


def test_a_point_in_the_fog_says_so():
    fog = scene.Medium((0.1, 0.1, 0.1), mesh=box("/fog", (-1, -1, -1), (1, 1, 1)))
    lights = tuple(
        scene.SphereLight(f"/{name}", (1, 1, 1), center=np.array(at, dtype=float))
        for name, at in (("In", (0, 0, 0)), ("Out", (0, 2, 0)))
    )
    twin = twin_of(scene.Scene(lights=lights, media=(fog,)), scene.Camera("/c", np.eye(4)), Window.full(4, 4), "files")
    assert twin.parts["In"]["medium"] == {"type": "ref", "id": "fog-medium"}
    assert "medium" not in twin.parts["Out"]
    assert set(twin.files) == {"fog.ply"} and not twin.lost


def test_tubes_and_meshes_that_shine_are_shapes_with_emitters():
    ball = box("/box", (-1, -1, -1), (1, 1, 1))
    profile = scene.Profile([0, 90], [0], [[1, 0]])
    lights = (
        scene.CylinderLight("/Tube", (1, 2, 3), half=np.array([0, 2.0, 0]), radius=0.5),
        scene.MeshLight("/Mesh", (1, 2, 3), mesh=ball, shaping=scene.Shaping(180, profile=profile)),
        scene.MeshLight("/Glow", (1, 2, 3), mesh=ball, surface=True),
    )
    twin = twin_of(scene.Scene(lights=lights), scene.Camera("/c", np.eye(4)), Window.full(4, 4), "files")
    tube, mesh = twin.parts["Tube-shape"], twin.parts["Mesh-shape"]
    assert (tube["type"], tube["p0"], tube["p1"], tube["radius"]) == ("cylinder", [0, -2, 0], [0, 2, 0], 0.5)
    assert tube["Tube"]["radiance"] == mesh["Mesh"]["radiance"] == {"type": "rgb", "value": [1, 2, 3]}
    assert (mesh["type"], list(twin.files)) == ("ply", ["Mesh.ply"])
    assert any("/Glow is left out: in Mitsuba its light is what its material emits" in each for each in twin.lost)
    assert any("/Mesh.inputs:shaping:ies:file is left out" in each for each in twin.lost)
