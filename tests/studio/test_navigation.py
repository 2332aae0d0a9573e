"""Moving a free camera: it turns about a point in front of it and stays upright."""

import numpy as np
import pytest

from photonbeams.scene import Camera
from photonbeams.studio.navigation import moved, orbited, pivot_distance

UPS = np.array([[0.0, 1, 0], [0, 0, 1]])
UP = pytest.mark.parametrize("up", UPS, ids=["y", "z"])


def seen_from(place, target=(0, 0, 0), up=UPS[0]):
    return Camera.look_at(place, target, up).to_world


def pivot(pose, distance):
    return pose[:3, 3] - distance * pose[:3, 2]


@UP
def test_an_orbit_keeps_the_point_the_distance_and_the_horizon(up, rng):
    pose = seen_from((3, 2, 4), (1, 0, 0.5), up)
    before = pivot(pose, 2.5)
    for yaw, pitch in rng.uniform(-0.5, 0.5, (40, 2)):
        pose = orbited(pose, up, 2.5, yaw, pitch)
        np.testing.assert_allclose(pivot(pose, 2.5), before, atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
        assert pose[:3, 0] @ up == pytest.approx(0, abs=1e-12) and pose[:3, 1] @ up > 0


@UP
def test_the_view_turns_to_the_left_and_up(up):
    pose = seen_from((3, 1, 2), up=up)
    left, higher = (orbited(pose, up, 1.0, *angles) for angles in ((0.1, 0), (0, 0.1)))
    assert -left[:3, 2] @ pose[:3, 0] == pytest.approx(-np.sin(0.1) * np.linalg.norm(np.cross(pose[:3, 2], up)))
    assert np.arccos(higher[:3, 2] @ pose[:3, 2]) == pytest.approx(0.1) and -higher[:3, 2] @ pose[:3, 1] > 0


@UP
@pytest.mark.parametrize("pitch", [-10.0, 10.0])
def test_a_camera_never_turns_over(up, pitch):
    pose = orbited(seen_from((3, 1, 2), up=up), up, 1.0, 0.3, pitch)
    assert np.degrees(np.arcsin(-pose[:3, 2] @ up)) == pytest.approx(np.copysign(89, pitch))


def test_a_camera_that_looks_steeper_comes_back_alone():
    pose = seen_from((0.001, 5, 0))
    assert -orbited(pose, UPS[0], 5.0, 0, -0.2)[:3, 2] @ UPS[0] == pytest.approx(-pose[:3, 2] @ UPS[0], abs=1e-12)
    assert np.arccos(orbited(pose, UPS[0], 5.0, 0, 0.2)[:3, 2] @ pose[:3, 2]) == pytest.approx(0.2)


def test_movements_are_along_the_cameras_own_axes():
    pose = seen_from((3, 2, 4))
    np.testing.assert_allclose(moved(pose, 1, 2, 3)[:3, 3], (pose @ [1, 2, -3, 1])[:3])
    np.testing.assert_allclose(moved(pose, 1, 2, 3)[:3, :3], pose[:3, :3], atol=1e-15)


@pytest.mark.parametrize(
    "place, target, distance",
    [((0, 0, 4), (0, 0, 0), 4), ((0, 3, 4), (0, 3, 0), 4), ((0, 0, 4), (0, 0, 8), 2), ((0, 0, 0), (0, 0, -1), 1)],
    ids=["at the origin", "past it", "away from it", "from it"],
)
def test_the_subject_is_guessed_where_the_view_passes_the_origin(place, target, distance):
    assert pivot_distance(seen_from(place, target)) == pytest.approx(distance)
