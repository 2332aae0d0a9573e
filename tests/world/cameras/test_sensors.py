"""Rays of cameras against those of Mitsuba's own sensors."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.samples import Samples
from photonbeams.render.scene_frame import view_of
from photonbeams.runtime.device import Array2f, Float, UInt32, mitsuba
from photonbeams.world.cameras.sensors import Sensor, window_of
from tests.helpers.mitsuba_scenes import T, camera, load

mi = mitsuba()
WIDE = {"width": 24, "height": 10}
OFFSET = (0.3, 0.6)


def rays(given):
    """Return a sensor, the origins and directions of our rays, (H, W, 3), and the rays themselves."""
    sensor = load(sensor=given).sensors()[0]
    window = window_of(sensor.film())
    height, width = window.shape
    count = width * height
    places = Array2f(*OFFSET) + dr.zeros(Float, count)
    found = view_of(Sensor(sensor)).rays(0, places, dr.arange(UInt32, count), Samples(0, 0)).primary
    shape = (3, height, width)
    origin, direction = (each.numpy() * np.ones((1, count)) for each in (found.origin, found.direction))
    return sensor, origin.reshape(shape).transpose(1, 2, 0), direction.reshape(shape).transpose(1, 2, 0), found


def mitsubas(sensor, aperture=(0.5, 0.5)):
    """Return the origins and directions of Mitsuba's rays through the same places."""
    width, height = (int(each) for each in sensor.film().crop_size())
    x, y = np.meshgrid((np.arange(width) + OFFSET[0]) / width, (np.arange(height) + OFFSET[1]) / height)
    place = mi.Point2f(x.ravel().astype(np.float32), y.ravel().astype(np.float32))
    ray, _ = sensor.sample_ray(Float(0), Float(0.5), place, mi.Point2f(*aperture), True)
    ones = np.ones((1, width * height))
    return tuple((each.numpy() * ones).reshape(3, height, width).transpose(1, 2, 0) for each in (ray.o, ray.d))


CAMERAS = {
    "plain": {},
    "vertical": {"fov_axis": "y"},
    "smaller": {"fov_axis": "smaller"},
    "diagonal": {"fov_axis": "diagonal"},
    "principal point": {"principal_point_offset_x": 0.2, "principal_point_offset_y": -0.1},
    "mirrored": {"to_world": T().look_at([1, 2, 4], [0, 0.5, 0], [0, 1, 0.2]).scale([-1, 1, 1])},
    "cropped": {"film": {"type": "hdrfilm", **WIDE, "crop_offset_x": 5, "crop_offset_y": 2, "crop_width": 7,
                         "crop_height": 6}},
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_rays_are_mitsubas(name, kind):
    more = dict(CAMERAS[name])
    if kind == "orthographic" and name not in ("plain", "mirrored", "cropped"):
        pytest.skip("no such parameter")
    given = {**camera((1, 2, 4), (0, 0.5, 0), **WIDE), "type": kind, **more}
    if kind == "orthographic":
        del given["fov"]
    sensor, origin, direction, found = rays(given)
    assert found.facing is not None  # one of our own cameras, for whose rays tiles list beams
    their_origin, their_direction = mitsubas(sensor)
    np.testing.assert_allclose(direction, their_direction, atol=2e-6)
    # Mitsuba's rays begin at the near plane.
    apart = np.cross(their_origin - origin, direction)
    np.testing.assert_allclose(apart, 0, atol=1e-5)


def test_rays_of_a_lens_meet_in_its_focal_plane():
    given = {
        **camera((1, 2, 4), (0, 0.5, 0), **WIDE),
        "type": "thinlens",
        "aperture_radius": 0.2,
        "focus_distance": 3.0,
    }
    sensor, origin, direction, _ = rays(given)
    center, forward = np.array([1, 2, 4]), np.array([-1, -1.5, -4]) / np.linalg.norm([1, 1.5, 4])
    assert 0.05 < np.linalg.norm(origin - center, axis=-1).max() < 0.201
    np.testing.assert_allclose((origin - center) @ forward, 0, atol=1e-5)
    # Mitsuba's rays through the middle of the lens, up to the focal plane.
    _, their_direction = mitsubas(sensor)
    there = center + their_direction * (3.0 / (their_direction @ forward))[..., None]
    ours = origin + direction * ((3.0 - (origin - center) @ forward) / (direction @ forward))[..., None]
    np.testing.assert_allclose(ours, there, atol=2e-4)


def test_other_sensors_send_their_own_rays():
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    _, _, direction, found = rays({"type": "distant", "direction": [0, 0, 1], "film": film})
    np.testing.assert_allclose(direction, np.broadcast_to([0, 0, 1], direction.shape), atol=1e-6)
    assert found.facing is None and found.origins is None and found.times is None
