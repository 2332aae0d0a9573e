"""Openings: holes that visible light passes, and only those, are found in stages and in Mitsuba scenes."""

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.render.scene_frame import begin
from photonbeams.transport.guiding import pilot
from photonbeams.transport.simulation import Simulation
from photonbeams.transport.strata import Allotment
from photonbeams.transport.tuning import Tuning
from photonbeams.world.cameras.cameras import View, Window
from photonbeams.world.described import world_of_scene
from tests.helpers.comparison import EYE, HOLE_X, HOLE_Y, HOLE_Z, comparison_scene
from tests.helpers.comparison import camera as stage_camera
from tests.helpers.fog_room import LAMPS, room
from tests.helpers.mitsuba_scenes import by_beams, camera, comparison, cube_of, fog, frames, load, rgb
from tests.helpers.sweep import sweep

HOLE = np.array([[HOLE_X, HOLE_Y[0], HOLE_Z[0]], [HOLE_X, HOLE_Y[1], HOLE_Z[1]]])
WINDOW = np.array([[-2, 1.2, -0.8], [-2, 2.0, -0.3]])


def portals(scene):
    """Return the portals that the emitters of a scene get, by the names of the emitters."""
    light = begin(scene, scene.sensors()[0], by_beams(beams=4096)).light
    strata = light.simulation.strata(light.world)
    return {each.emitter.name: each.emitter.portal for each in strata if each.emitter.portal is not None}


def check_around(portal, hole):
    """Check that a portal lies in the wall of a hole, and contains all of the hole and little else."""
    corner, *edges = portal.sides
    corners = corner + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ np.array(edges)
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = np.ptp(hole, axis=0)
    assert np.abs(corners[:, 0] - hole[0, 0]).max() < 0.01
    assert (low < hole[0] + 0.02 * size + 0.01).all() and (high > hole[1] - 0.02 * size - 0.01).all()
    assert (high - low < 1.3 * size + 0.01).all()  # a margin on each side, and a strip that little light passes


@pytest.mark.parametrize("lamp", LAMPS)
def test_a_window_is_found_for_each_kind_of_lamp(lamp):
    (portal,) = portals(room(lamp)).values()
    check_around(portal, WINDOW)


def test_a_hole_in_a_box_whose_walls_name_their_fog_is_found():
    (portal,) = portals(comparison(48, 27)).values()
    check_around(portal, HOLE)


@pytest.mark.parametrize("bounces", sweep([0, 2], [2]))
def test_the_hole_of_a_stage_is_found(bounces):
    world = world_of_scene(comparison_scene(portal=False), viewpoints=[EYE])
    simulation = Simulation(Tuning(0, max_bounces=bounces), Allotment(4096))
    views = [View(stage_camera(EYE), Window.full(48, 27)).projection]
    (opening,) = simulation.guided(world, views).guides.openings.values()
    check_around(opening.portal, HOLE)


def test_a_lamp_of_which_little_is_seen_takes_the_window_that_another_lamp_has():
    found = portals(room("sun", "sky"))
    assert set(found) == {"sun", "sky"}
    for each in found.values():
        check_around(each, WINDOW)


def test_light_that_nothing_stops_has_no_portal():
    """A lamp in the open has no portal, although the camera sees only a hundredth of the fog that it lights."""
    lamp = {"type": "point", "position": [0, 0, 3], "intensity": rgb(1.0)}
    scene = load(fog=cube_of(fog(0.2), 4), lamp=lamp, sensor=camera([3.5, 0, 0], [0, 0, 0], fov=6))
    assert portals(scene) == {}


def test_a_lamp_within_the_picture_has_no_portal():
    lamp = {"type": "sphere", "center": [0, 0, 0], "radius": 0.1, "emitter": {"type": "area", "radiance": rgb(1.0)}}
    assert portals(load(fog=cube_of(fog(0.5)), lamp=lamp, sensor=camera())) == {}


def test_a_fitted_portal_keeps_the_mean_and_has_less_noise(monkeypatch):
    """Sunlight in a room keeps its mean, with any number of bounces; rounds alone have twice the variance."""
    means, variances, scene = [], [], room("sun")
    for portal in (True, False):
        if not portal:
            monkeypatch.setattr(pilot, "fitted", lambda *_: None)
            monkeypatch.setattr(pilot._Learning, "follow", lambda *_: None)
        found = np.array([each.views()[0]["beams"] for each in frames(scene, by_beams(passes=1, beams=4096), 8)])
        means.append((found.mean(), found.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(8)))
        variances.append(np.mean(found.var(axis=0, ddof=1) / found.mean(axis=0) ** 2))
    (own, own_error), (other, other_error) = means
    assert abs(own - other) < 4 * np.hypot(own_error, other_error)
    # 8 × 576 values that are smooth over about ten pixels give a variance to about ten per cent, and a ratio to 14 %.
    # It is 0.48, and three deviations are 0.2; with lines, guides are as good as the portal: 0.93.
    assert variances[0] < 0.7 * variances[1]


@pytest.mark.parametrize("wide", [1, 4])
def test_a_hole_in_a_bent_wall_is_a_rectangle_between_its_edges(wide):
    """A drum of 48 sides around a lamp has a hole, `wide` sides wide and 0.3 high."""
    turn, corners = 2 * np.pi / 48, [[(-2, -2, z), (2, -2, z), (2, 2, z), (-2, 2, z)] for z in (-1, 1)]
    for side in range(48):
        edges = [(np.cos(each * turn), np.sin(each * turn)) for each in (side, side + 1)]
        for low, high in [(-1, -0.15), (0.15, 1)] if side < wide else [(-1, 1)]:
            corners.append([(*edges[0], low), (*edges[1], low), (*edges[1], high), (*edges[0], high)])
    faces = np.array([[4 * each + a for a in (0, b, b + 1)] for each in range(len(corners)) for b in (1, 2)])
    drum = scene.Mesh("/Drum", np.reshape(corners, (-1, 3)).astype(float), faces)
    lamp, mist = scene.SphereLight("/Lamp", 50.0, center=(0, 0, 0), radius=0.02), scene.Medium(scattering=0.1)
    eye, target = np.array([4, 0.26 * wide / 2, 5]), np.array([4, 0.26 * wide / 2, 0])
    own = scene.Camera.look_at(origin=eye, target=target, up=(0, 1, 0), name="/C", fov=50)
    world = world_of_scene(scene.Scene(meshes=(drum,), lights=(lamp,), media=(mist,)), viewpoints=[eye])
    simulation = Simulation(Tuning(0, max_bounces=0), Allotment(4096))
    (opening,) = simulation.guided(world, [View(own, Window.full(48, 27)).projection]).guides.openings.values()
    corner, *sides = opening.portal.sides
    x, y, z = (corner + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ sides).T
    # Seen from the lamp it is the hole, with margins of 2 % per side and the spread of some 900 rays.
    angle, height, away = np.arctan2(y, x), z / np.hypot(x, y), np.hypot(x, y)
    assert angle.min() == pytest.approx(0, abs=0.04 * wide * turn)
    assert angle.max() == pytest.approx(wide * turn, rel=0.04)
    assert [height.min(), height.max()] == pytest.approx([-0.15, 0.15], rel=0.1)
    # In the plane of a side beside the hole, the other edge is up to 0.52 tan(15 degrees) from the wall.
    assert np.abs(away - 1).max() < 0.14
