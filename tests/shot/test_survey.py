"""A survey of a scene finds the windows that are there, and what light does by its formulas."""

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.shot.survey import DEPTH, Survey
from tests.helpers.comparison import box, quad
from tests.helpers.windows import WINDOWS, camera, room


def survey(content, own=None):
    own = own or camera()
    return Survey(content, {own.name: own})


def found_at(sides):
    """Return the middles and the sizes of rectangles by axis, in the order of the middles."""
    corners = np.array([[c, c + x + y] for c, x, y in sides])
    middles = corners.mean(axis=1)
    order = np.lexsort(np.round(middles.T, 1))
    return middles[order], np.abs(np.diff(corners, axis=1))[:, 0][order]


def test_each_window_of_two_walls_is_an_opening():
    middles, sizes = found_at(survey(room()).openings["/Sun"])
    known, size = found_at([(low, high - low, np.zeros(3)) for low, high in WINDOWS])
    # Rectangles end where the last of about 900 rays passes, with a margin of 2 % per side: see `guiding.openings`.
    assert np.allclose(middles, known, atol=0.02)
    assert np.allclose(sizes, size, atol=0.06)


def test_light_in_the_open_comes_through_no_opening():
    lamp = scene.SphereLight(
        "/Lamp", 50.0, center=(2.5, 2.9, 2), axis=(0, -1, 0), radius=0.02, shaping=scene.Shaping(cone_angle=25)
    )
    found = survey(room(lamp))
    assert found._pilot.openings(["/Lamp"]) == {"/Lamp": []}
    assert found.openings == {}  # not looked for, because all of the light is seen
    assert found.shafts == ["/Lamp"]
    assert found.reach["/Lamp"].in_fog == pytest.approx(1, abs=1e-3)


def test_a_floor_is_no_wall_around_an_opening():
    floor = quad("/Floor", [[-20, 0, -20], [20, 0, -20], [20, 0, 20], [-20, 0, 20]])
    smoke = scene.Medium(scattering=0.2, mesh=box("/Smoke", (-3, 0.1, -3), (3, 8, 3)), name="/Smoke")
    axis = np.array([0.6, -0.3, -0.75])
    sun = scene.DistantLight("/Sun", 3e4, axis=axis / np.linalg.norm(axis), angle=0.5)
    own = scene.Camera.look_at(origin=(0, 3, 15), target=(0, 3, 0), name="/Camera", fov=50)
    found = survey(scene.Scene(meshes=(floor, smoke.mesh), lights=(sun,), media=(smoke,)), own)
    assert found.shafts == ["/Sun"]
    assert found.openings == {"/Sun": []}


def test_white_paper_shows_irradiance_over_pi_where_light_falls():
    floor = quad("/Floor", [[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]])
    above = quad("/Above", [[-9, 1, -9], [0, 1, -9], [0, 1, 9], [-9, 1, 9]])
    slope = 60.0
    axis = np.array([0, -np.cos(np.radians(slope)), np.sin(np.radians(slope))])
    sun = scene.DistantLight("/Sun", 2.0, axis=axis, angle=0.0)
    own = scene.Camera.look_at(origin=(0, 0.9, 0), target=(0, 0, 0), up=(0, 0, 1), name="/Camera", fov=60)
    found = survey(scene.Scene(meshes=(floor, above), lights=(sun,)), own)
    fraction, level = found.white("/Camera", "/Sun")
    assert level == pytest.approx(2.0 * np.cos(np.radians(slope)) / np.pi, rel=1e-5)
    assert fraction == pytest.approx(0.5, abs=0.02)  # the other half is in the shadow of what is above
    assert found.lit("/Camera") == fraction
    assert found.exposure("/Camera") == pytest.approx(np.log2(0.5 / (0.5 * level)), abs=0.06)
    # The median distance on a plane that fills a picture of 60 by 36 degrees is not far above that of its middle.
    assert 0.9 < found.distance < 1.0
    assert found.scattering == float(f"{DEPTH / found.distance:.1g}")
