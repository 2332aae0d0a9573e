"""Pictures from fewer rays than pixels, against pictures from a ray for every pixel."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.estimators.estimate import ENDLESS
from photonbeams.estimators.image import estimate_image
from photonbeams.estimators.lanes import Lattice, PixelRays
from photonbeams.estimators.points import Points
from photonbeams.numerics.arrays import to_float
from photonbeams.runtime.device import Array2f, Float, mitsuba
from photonbeams.scene import Camera
from photonbeams.world.cameras.cameras import View, Window
from tests.helpers.mitsuba_scenes import comparison

mi = mitsuba()

WIDTH, HEIGHT, TOLERANCE = 400, 220, 0.002
MEDIUM = pb.Medium(scattering=0.1, absorption=0.02)
POINTS = Points(pb.gauss_legendre(6))
CAMERA = Camera(
    "/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.55, focus_distance=4.0
)
PLACE = (0.3, 0.6)


def fan(rng, count, radius=0.3):
    """Return beams that cross the picture and begin and end outside it."""
    y = rng.uniform(-1.5, 1.5, (count, 2))
    z = rng.uniform(-7, -4, (count, 2))
    start, end = (np.stack([np.full(count, x), y[:, i], z[:, i]], axis=1) for i, x in enumerate((-9.0, 9.0)))
    return pb.Beams(start, end, radius, 1.2 * radius, rng.uniform(0.5, 1, (count, 3)))


def seen(beams, tolerance=TOLERANCE, look=None, t_max=ENDLESS, estimator="auto", near=0.0, crop=None):
    """Return the radiance of pixels, (H, W, 3), and how many tests it took."""
    window = Window(WIDTH, HEIGHT, crop) if crop else Window.full(WIDTH, HEIGHT)
    (height, width), view = window.shape, View(CAMERA, window)
    rays, count = view.rays(PLACE), width * height
    far = to_float(np.broadcast_to(np.asarray(t_max, dtype=np.float64).reshape(-1), count).copy()) / rays.facing
    begin = dr.full(Float, near, count) / rays.facing
    lattice = Lattice.of(WIDTH, HEIGHT, window.crop[:2], Array2f(*PLACE))
    found = estimate_image(
        beams, view.projection, PixelRays(*rays[:3], far, begin, lattice=lattice), look=look or pb.Look(),
        medium=MEDIUM, estimator=estimator, points=POINTS, tolerance=tolerance,
    )  # fmt: skip
    return found.radiance.numpy().T.reshape(height, width, 3), found.billboard_tests + found.frustum_tests


def errors(fast, exact):
    """Return relative errors of pixels that are not dim."""
    bright = exact.mean(axis=2) > 0.05 * exact.mean()
    return np.abs(fast - exact).mean(axis=2)[bright] / exact.mean(axis=2)[bright]


@pytest.mark.parametrize("estimator", ["auto", "billboard", "frustum"])
@pytest.mark.parametrize("near", [0.0, 0.5])
def test_a_fan_of_wide_beams_takes_a_fraction_of_the_tests_and_errs_as_little_as_asked(rng, estimator, near):
    beams = fan(rng, 512, radius=0.5)
    exact, all_tests = seen(beams, 0.0, estimator=estimator, near=near)
    fast, tests = seen(beams, estimator=estimator, near=near)
    assert tests < 0.4 * all_tests
    found = errors(fast, exact)
    assert np.median(found) < TOLERANCE
    assert np.percentile(found, 95) < 3 * TOLERANCE
    assert fast.mean() == pytest.approx(exact.mean(), rel=TOLERANCE)


def test_the_camera_within_wide_beams_takes_a_fraction_of_the_tests(rng):
    start = np.stack([rng.uniform(-0.6, 0.6, 256), rng.uniform(-0.4, 0.4, 256), np.full(256, 2.0)], axis=1)
    beams = pb.Beams(start, start * 1.5 + [0, 0, -12.0], 0.4, 0.9, np.ones((256, 3)))
    (exact, all_tests), (fast, tests) = (seen(beams, each) for each in (0.0, TOLERANCE))
    assert tests < 0.5 * all_tests
    assert np.median(errors(fast, exact)) < TOLERANCE


def test_looks_that_are_not_smooth_are_seen_through_every_pixel(rng):
    look, beams = pb.Look(along=pb.looks.Expression("1 + 0.5 * sin(9 * s)")), fan(rng, 8)
    (exact, all_tests), (fast, tests) = (seen(beams, each, look) for each in (0.0, TOLERANCE))
    assert tests == all_tests
    np.testing.assert_array_equal(fast, exact)


def test_noise_is_cheaper_and_about_the_same(rng):
    """Of narrow beams fewer are frusta: noise over a chord is then that in its middle.

    A frustum begins where noise changes by half of itself over half a chord, h k = 0.5. The mean of a wave over that,
    sin(0.5) / 0.5, is 4 % less than the wave; a pixel has some dozens of beams, and noise is a part of their light.
    """
    look = pb.Look(along=pb.looks.Noise(scale=2.0, octaves=3) * pb.looks.Attenuation())
    beams = fan(rng, 400, radius=0.03)
    (exact, all_tests), (fast, tests) = (seen(beams, each, look) for each in (0.0, TOLERANCE))
    lit = exact > 0.05 * exact.max()
    assert tests < 0.8 * all_tests  # fewer beams are frusta
    relative = (fast[lit] - exact[lit]) / exact[lit].mean()
    assert 0 < np.sqrt((relative**2).mean()) < 0.005
    assert abs(relative.mean()) < 0.001


def test_a_step_of_a_ramp_is_found(rng):
    look = pb.Look(along=pb.looks.ColorRamp([0, 9.0], [[1, 1, 1], [0, 0, 1]], "none"))
    beams = fan(rng, 512, radius=0.5)
    exact, fast = (seen(beams, each, look)[0] for each in (0.0, TOLERANCE))
    assert np.median(errors(fast, exact)) < TOLERANCE
    assert np.percentile(errors(fast, exact), 95) < 3 * TOLERANCE


def test_no_light_crosses_an_edge_of_depth(rng):
    # Surfaces in front of the fan, behind it and within it, with edges at arbitrary pixels.
    depth = rng.choice([2.0, 5.5, 12.0], (8, 13)).repeat(30, 0).repeat(32, 1)[:HEIGHT, :WIDTH]
    beams = fan(rng, 64)
    exact, fast = (seen(beams, each, t_max=depth)[0] for each in (0.0, TOLERANCE))
    assert not exact[depth < 3].any()
    np.testing.assert_array_equal(fast[depth < 3], 0)
    # Rays across an edge cannot predict what lies behind it: pixels beside an edge are as accurate as all others.
    edge = np.abs(np.diff(depth, axis=1, prepend=depth[:, :1])) > 0
    bright = edge & (exact.mean(axis=2) > 0.05 * exact.mean())
    assert bright.any()
    assert np.median((np.abs(fast - exact).mean(axis=2) / exact.mean(axis=2).clip(1e-9))[bright]) < TOLERANCE


def test_a_plane_that_cuts_the_beams_is_no_edge(rng):
    # A slanted wall within the fan: its inverse depth is linear on the screen.
    depth = 1 / np.linspace(1 / 4.5, 1 / 7, WIDTH)[None, :].repeat(HEIGHT, 0)
    beams = fan(rng, 512, radius=0.5)
    (exact, all_tests), (fast, tests) = (seen(beams, each, t_max=depth) for each in (0.0, TOLERANCE))
    assert tests < 0.6 * all_tests
    assert np.median(errors(fast, exact)) < TOLERANCE


def test_rims_of_a_beam_are_as_they_are():
    beams = pb.Beams([[-0.8, 0.0, -5.0]], [[0.9, 0.3, -5.0]], 0.5, 0.5, [[1, 1, 1]])
    exact, fast = (seen(beams, each)[0] for each in (0.0, TOLERANCE))
    # A rim is an edge: the tolerance there is relative to the brightest radiance.
    assert np.abs(fast - exact).max() < 8 * TOLERANCE * exact.max()


def test_a_crop_window_has_the_same_rays_in_step(rng):
    crop = (37, 21, 253, 149)
    beams = fan(rng, 512, radius=0.5)
    whole, part = seen(beams)[0][crop[1] : crop[3], crop[0] : crop[2]], seen(beams, crop=crop)[0]
    # At its border, where the whole picture interpolates, the crop is exact.
    assert np.median(errors(part, whole)) < 0.1 * TOLERANCE
    assert errors(part, whole).max() < 8 * TOLERANCE


def test_the_numbers_are_the_same_every_time(rng):
    beams = fan(rng, 64)
    np.testing.assert_array_equal(seen(beams)[0], seen(beams)[0])


def test_a_picture_of_a_scene_differs_by_as_little_as_asked():
    scene = comparison(400, 224)
    given = {"type": "photon_beams", "paths": 2048, "max_depth": 2, "method": "beams"}
    exact, fast = (
        np.array(mi.render(scene, integrator=mi.load_dict({**given, "gather_error": error}), spp=1))[..., :3]
        for error in (0.0, TOLERANCE)
    )
    assert not np.array_equal(exact, fast)
    found = errors(fast, exact)
    assert np.median(found) < TOLERANCE
    assert np.percentile(found, 95) < 3 * TOLERANCE
