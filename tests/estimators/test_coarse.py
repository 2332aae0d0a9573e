"""Wide smooth beams along fewer rays than pixels, against all pixels' own rays."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.estimators.coarse import widest_step
from photonbeams.estimators.estimate import ENDLESS
from photonbeams.estimators.image import estimate_image
from photonbeams.estimators.lanes import PixelRays
from photonbeams.estimators.points import Points
from photonbeams.estimators.tiles import TILE
from photonbeams.numerics.arrays import to_float
from photonbeams.runtime.device import Float, mitsuba
from photonbeams.scene import Camera
from photonbeams.world.cameras import View, Window
from transport.scenes import comparison

mi = mitsuba()

WIDTH, HEIGHT, TOLERANCE = 320, 176, 0.002
MEDIUM = pb.Medium(scattering=0.1, absorption=0.02)
POINTS = Points(pb.gauss_legendre(6))
CAMERA = Camera(
    "/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.55, focus_distance=4.0
)


def fan(rng, count, radius=0.3):
    """Return beams across the picture, that begin and end beside it."""
    y = rng.uniform(-1.5, 1.5, (count, 2))
    z = rng.uniform(-7, -4, (count, 2))
    start, end = (np.stack([np.full(count, x), y[:, i], z[:, i]], axis=1) for i, x in enumerate((-9.0, 9.0)))
    return pb.Beams(start, end, radius, 1.2 * radius, rng.uniform(0.5, 1, (count, 3)))


def seen(beams, tolerance=TOLERANCE, look=None, t_max=ENDLESS, estimator="auto", near=0.0):
    """Return the radiance of pixels, (H, W, 3), and how many tests it took."""
    view = View(CAMERA, Window.full(WIDTH, HEIGHT))
    rays, count = view.rays((0.3, 0.6)), WIDTH * HEIGHT
    far = to_float(np.broadcast_to(np.asarray(t_max, dtype=np.float64).reshape(-1), count).copy())
    begin = dr.full(Float, near, count) / rays.facing
    found = estimate_image(
        beams, view.projection, PixelRays(*rays[:3], far, begin), look=look or pb.Look(), medium=MEDIUM,
        estimator=estimator, points=POINTS, tolerance=tolerance,
    )  # fmt: skip
    return found.radiance.numpy().T.reshape(HEIGHT, WIDTH, 3), found.billboard_tests


@pytest.mark.parametrize("estimator", ["auto", "billboard"])
@pytest.mark.parametrize("near", [0.0, 0.5])
def test_a_fan_of_wide_beams_takes_a_fraction_of_the_tests_and_errs_as_little_as_asked(rng, estimator, near):
    beams = fan(rng, 512, radius=0.5)
    exact, all_tests = seen(beams, 0.0, estimator=estimator, near=near)
    coarse, tests = seen(beams, estimator=estimator, near=near)
    assert tests < 0.35 * all_tests
    # Steps grow with the number of beams, so that their sum errs by as much as is asked for.
    assert np.abs(coarse - exact).mean() < TOLERANCE * exact.mean()
    assert coarse.mean() == pytest.approx(exact.mean(), rel=0.5 * TOLERANCE)


def test_twice_the_step_has_four_times_the_error():
    profile = pb.looks.Biweight()
    assert widest_step(profile, 4 * TOLERANCE) / widest_step(profile, TOLERANCE) == pytest.approx(2, rel=0.15)


@pytest.mark.parametrize(
    "look",
    [
        pb.Look(across=pb.looks.Biweight() * pb.looks.Noise(scale=0.5)),
        pb.Look(along=pb.looks.Expression("1 + 0.5 * sin(9 * s)")),
        pb.Look(along=pb.looks.ColorRamp([0, 0.5], [[1, 1, 1], [0, 0, 1]], "none")),
    ],
)
def test_looks_that_are_not_smooth_are_seen_through_every_pixel(rng, look):
    beams = fan(rng, 8)
    (exact, all_tests), (coarse, tests) = (seen(beams, each, look) for each in (0.0, TOLERANCE))
    assert tests == all_tests
    np.testing.assert_array_equal(coarse, exact)


def tiles_of(picture):
    """Return the tiles of a picture, (rows, columns, TILE, TILE, 3)."""
    return picture.reshape(HEIGHT // TILE, TILE, WIDTH // TILE, TILE, 3).swapaxes(1, 2)


def test_no_light_crosses_an_edge_of_depth(rng):
    # Things before the fan, behind it, and amid it, with edges anywhere.
    depth = rng.choice([2.0, 5.5, 12.0], (6, 10)).repeat(30, 0).repeat(32, 1)[:HEIGHT, :WIDTH]
    beams = fan(rng, 4)
    exact, coarse = (seen(beams, each, t_max=depth)[0] for each in (0.0, TOLERANCE))
    dark = exact.sum(axis=2) == 0
    assert dark.any() and not dark.all()
    # A tile whose nearest surface may hide a part of a beam is exact.
    hidden = tiles_of(depth[..., None] + np.zeros(3)).min(axis=(2, 3, 4)) < 8
    np.testing.assert_array_equal(tiles_of(coarse)[hidden], tiles_of(exact)[hidden])
    assert not coarse[dark & (depth < 3)].any()


def test_ends_of_beams_are_exact():
    beams = pb.Beams([[-0.8, 0.0, -5.0]], [[0.9, 0.3, -5.0]], 0.5, 0.5, [[1, 1, 1]])
    (exact, all_tests), (coarse, tests) = (seen(beams, each) for each in (0.0, 0.02))
    assert tests < all_tests
    # A rim is an edge: wherever the picture changes by more than a stroke may, it does so by the same numbers.
    steps = np.abs(np.diff(exact[..., 0], axis=1)).max(axis=0)
    sharp = np.flatnonzero(steps > 0.5 * steps.max())
    assert len(sharp)
    np.testing.assert_array_equal(coarse[:, sharp], exact[:, sharp])


def test_the_numbers_are_the_same_every_time(rng):
    beams = fan(rng, 16)
    np.testing.assert_array_equal(seen(beams)[0], seen(beams)[0])


def test_a_picture_of_a_scene_differs_by_as_little_as_asked():
    scene = comparison(160, 96)
    given = {"type": "photon_beams", "paths": 2048, "max_depth": 2, "radius": 0.2, "method": "beams"}
    exact, coarse = (
        np.array(mi.render(scene, integrator=mi.load_dict({**given, "gather_error": error}), spp=1)).mean(axis=2)
        for error in (0.0, 0.01)
    )
    assert not np.array_equal(exact, coarse)
    assert np.abs(coarse - exact).mean() < 0.01 * exact.mean()
