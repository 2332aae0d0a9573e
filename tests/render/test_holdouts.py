"""Beams end at another picture's depth as they do at surfaces, also within a pixel, and edges have no halo."""

import dataclasses

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.render.holdouts import HoldoutDepth, slopes
from photonbeams.render.seen.depth_layers import DepthLayers
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import render
from photonbeams.world.cameras.cameras import View, Window
from photonbeams.world.shutter import Moment, Shutter
from tests.helpers.comparison import quad
from tests.helpers.kernels import compiled

WIDTH, HEIGHT = 40, 24
WINDOW = Window.full(WIDTH, HEIGHT)
FOG = scene.Medium(scattering=(0.2, 0.2, 0.2))
CAMERA = scene.Camera("/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.6)
LENS = dataclasses.replace(CAMERA, lens_radius=0.1, focus_distance=4.0)
# A floor that is seen at grazing angles, and beams close under it at many distances.
FLOOR = quad("/floor", [[-40, -0.5, 0], [40, -0.5, 0], [40, -0.5, -40], [-40, -0.5, -40]])
AWAY = -np.linspace(2.5, 8.0, 40)
UNDER = scene.DrawnBeams(
    "/under", *(np.stack([0 * AWAY + x, 0 * AWAY - 0.53, AWAY], axis=1) for x in (-3, 3)),
    np.full(40, 0.02), np.full(40, 0.02), np.ones((40, 3)),
)  # fmt: skip
BEAM = scene.DrawnBeams(
    "/beam", np.array([[-3.0, -0.53, -4.0]]), np.array([[3.0, -0.53, -4.0]]), np.full(1, 0.02), np.full(1, 0.02),
    np.ones((1, 3)),
)  # fmt: skip
THROUGH = dataclasses.replace(BEAM, start=np.array([[-1.0, 0.6, -4.0]]), end=np.array([[1.0, -1.2, -3.0]]))


def beams_layer(camera=CAMERA, meshes=(), beams=UNDER, depth=None, passes=4, window=WINDOW, place=(0.5, 0.5)):
    still = Shutter.still(scene.Scene(tuple(meshes), (), (beams,), (FOG,)), camera)
    held = [HoldoutDepth(depth, window, place)] if depth is not None else []
    return render(still, window, Settings(passes=passes), holdouts=held).layers()


def floor_depth(place=(0.5, 0.5)):
    """Return the floor's planar depth; it is infinite where no floor is seen."""
    down = (np.arange(HEIGHT) + place[1]) / HEIGHT * 0.6 - 0.3
    depth = np.where(down > 0, 0.5 / np.maximum(down, 1e-9), np.inf)
    return np.repeat(np.where(depth < 40, depth, np.inf)[:, None], WIDTH, axis=1)


@pytest.mark.parametrize("camera", [CAMERA, LENS])
def test_nothing_of_a_beam_behind_a_slanted_plane_is_seen_at_any_place_of_a_pixel(camera):
    open_air = beams_layer(camera)["beams"]
    held = beams_layer(camera, depth=floor_depth())["beams"]
    own = beams_layer(camera, [FLOOR])["beams"]
    assert open_air.max() > 0.02
    assert own.max() == 0
    # Five units away, the floor's depth changes by more than one unit within a pixel. If the depth of its centre held
    # for the whole pixel, a tenth of the light would be seen.
    assert held.max() < 1e-6 * open_air.max()


def test_through_a_lens_beams_end_at_a_holdout_as_they_do_at_surfaces():
    own = beams_layer(LENS, [FLOOR], THROUGH)["beams"]
    held = beams_layer(LENS, beams=THROUGH, depth=floor_depth())["beams"]
    # At the horizon, where the floor ends, pixels see the floor from only a part of the lens.
    below = slice(HEIGHT // 2 + 3, None)
    assert not np.allclose(own[below], beams_layer(beams=THROUGH)["beams"][below], atol=0.1 * own.max())
    assert np.allclose(held[below], own[below], atol=1e-3 * own.max())
    # A deep floor is the flat one, and what covers 0.3 before it, at any depth, leaves 0.7 of the light behind it.
    depth = floor_depth()
    floor = np.where(np.isfinite(depth), depth, 1e6).ravel()
    one = np.ones_like(floor)
    deep = DepthLayers.of_samples(np.ones(depth.shape, int), floor, floor, one)
    assert np.allclose(beams_layer(LENS, beams=THROUGH, depth=deep)["beams"][below], held[below], atol=1e-6 * own.max())
    front = np.where(floor > 2.2, 1 + floor % 1, 0.9 * floor)
    both = [np.stack(each, axis=1).ravel() for each in ((floor, front), (floor, front), (one, 0.3 * one))]
    thin = DepthLayers.of_samples(np.full(depth.shape, 2), *both)
    wide = dataclasses.replace(THROUGH, radius_start=np.full(1, 0.8), radius_end=np.full(1, 0.8))
    light, whole = (
        beams_layer(LENS, beams=wide, depth=each, passes=16)["beams"][below, :, 0].astype(np.float64)
        for each in (thin, deep)
    )
    # The light of a pixel and pass is drawn or not; it varies over the lens, at most by its own size.
    error = 4 * np.sqrt(2 * 0.3 * 0.7 * (whole**2).sum() / 16) / whole.sum()
    assert light.sum() / whole.sum() == pytest.approx(0.7, abs=error) and error < 0.1


def test_beams_end_at_a_holdout_as_they_do_at_surfaces():
    own = beams_layer(meshes=[FLOOR], beams=THROUGH)["beams"]
    held = beams_layer(beams=THROUGH, depth=floor_depth())["beams"]
    assert own.max() > 0.01
    assert not np.allclose(own, beams_layer(beams=THROUGH)["beams"], atol=0.1 * own.max())
    # The float32 rounding of 1/Z, divided by the smallest angle between beam and floor.
    assert np.allclose(held, own, atol=1e-4 * own.max())


def test_depths_may_be_those_of_any_place_in_the_pixel():
    place = (0.75, 0.75)
    centre = beams_layer(beams=THROUGH, depth=floor_depth())["beams"]
    corner = beams_layer(beams=THROUGH, depth=floor_depth(place), place=place)["beams"]
    assert np.allclose(centre, corner, atol=1e-4 * centre.max())


def test_an_edge_is_between_two_pixels_and_makes_no_third_depth():
    """A beam between a near card and a far wall is seen in full beside the card, and not at all behind it."""
    depth = np.full((HEIGHT, WIDTH), 8.0)
    depth[:, : WIDTH // 2] = 2.0
    between = dataclasses.replace(BEAM, start=np.array([[-3.0, 0.0, -5.0]]), end=np.array([[3.0, 0.0, -5.0]]))
    seen = beams_layer(beams=between, depth=depth)["beams"]
    whole = beams_layer(beams=between)["beams"]
    assert seen[:, : WIDTH // 2].max() == 0
    assert np.array_equal(seen[:, WIDTH // 2 :], whole[:, WIDTH // 2 :])


def test_slats_thinner_than_a_pixel_hide_the_part_of_it_that_they_cover():
    """A holdout of four times the size has slanted slats, each a third of a pixel wide, between camera and beam."""
    row, column = np.mgrid[: 4 * HEIGHT, : 4 * WIDTH]
    slat = (column + 0.3 * row) % 9 < 1.4
    beam = dataclasses.replace(
        BEAM, start=np.array([[-3.0, 0.0, -5.0]]), end=np.array([[3.0, 0.0, -5.0]]),
        radius_start=np.full(1, 0.9), radius_end=np.full(1, 0.9),
    )  # fmt: skip
    layers = beams_layer(beams=beam, depth=np.where(slat, 2.0, 8.0), passes=16)
    whole, seen = beams_layer(beams=beam, passes=16)["beams"][..., 0], layers["beams"][..., 0]
    covered = slat.reshape(HEIGHT, 4, WIDTH, 4).mean(axis=(1, 3))
    lit = whole > 0.1 * whole.max()
    assert lit.sum() > 150 and 0.1 < covered[lit].mean() < 0.3
    error = seen[lit] / whole[lit] - (1 - covered[lit])
    # 16 stratified samples of a pixel, of which an edge crosses a few strata: each errs by less than 1/16 on average.
    assert np.sqrt((error**2).mean()) < 1 / 16 and abs(error.mean()) < 3 / 16 / np.sqrt(lit.sum())
    # One depth of each pixel would make dashes: some pixels hidden, others not.
    assert np.isin(layers["depth"], (2, 8)).all() and np.sqrt(((layers["depth"][..., 0][lit] == 2) ** 2).mean()) > 0.3


def test_slopes_are_those_of_planes_and_none_at_peaks():
    ramp = np.array([[1.0, 3.0, 5.0, 9.0]])
    assert slopes(ramp, 1).tolist() == [[2.0, 2.0, 2.0, 4.0]]
    assert slopes(np.array([[1.0, 5.0, 1.0]]), 1).tolist() == [[4.0, 0.0, -4.0]]
    assert slopes(ramp.T, 0).tolist() == slopes(ramp, 1).T.tolist()
    assert slopes(ramp, 0).tolist() == [[0.0] * 4]


def test_surfaces_are_not_seen_under_a_holdout_and_fog_is_that_before_it():
    layers = beams_layer(meshes=[FLOOR], beams=THROUGH, depth=np.full((HEIGHT, WIDTH), 3.0))
    assert not layers["surface"].any()
    assert not layers["rgba"][..., 3].any()
    assert np.array_equal(layers["rgba"][..., :3], layers["beams"])
    assert np.all(layers["depth"] == np.float32(3.0))
    x, y = (np.arange(WIDTH) + 0.5) / WIDTH - 0.5, (np.arange(HEIGHT) + 0.5) / HEIGHT * 0.6 - 0.3
    length = 3.0 * np.sqrt(1 + x**2 + y[:, None] ** 2)
    # The layer is a mean over places in the pixel, whose distances differ by half a pixel's slope, 1/80.
    assert np.allclose(layers["transmittance"][..., 0], np.exp(-0.2 * length), rtol=0.2 * 3.0 / 80)
    far = beams_layer(depth=np.full((HEIGHT, WIDTH), np.inf))
    assert np.all(far["transmittance"] == 1)
    assert np.array_equal(far["beams"], beams_layer()["beams"])


def test_a_holdout_stands_still_before_a_moving_camera():
    def at(fraction):
        matrix = np.eye(4)
        matrix[2, 3] = 0.5 * fraction
        moved = dataclasses.replace(CAMERA, to_world=matrix)
        return Moment(state, (moved,))

    state = scene.Scene((), (), (BEAM,), (FOG,))
    held = [HoldoutDepth(np.full((HEIGHT, WIDTH), 3.9), WINDOW)]
    layers = render(Shutter(at, moving=True), WINDOW, Settings(passes=4), holdouts=held).layers()
    # The camera moves away from the beam, which stays behind the holdout.
    assert layers["beams"].max() == 0
    assert np.all(layers["depth"] == np.float32(3.9))


def test_a_second_holdout_of_other_depths_compiles_nothing():
    beams_layer(depth=floor_depth())
    still = Shutter.still(scene.Scene((), (), (THROUGH,), (FOG,)), CAMERA)
    held = [HoldoutDepth(np.full((HEIGHT, WIDTH), 2.5), WINDOW, (0.7, 0.7))]
    assert not compiled(lambda: render(still, WINDOW, Settings(passes=2), holdouts=held))


def test_cosines_are_those_of_the_angle_to_the_cameras_axis():
    camera = dataclasses.replace(CAMERA, horizontal_offset=0.2)
    found = View(camera, WINDOW).cosines((0.5, 0.5))
    x, y = (np.arange(WIDTH) + 0.5) / WIDTH - 0.5 + 0.2, (np.arange(HEIGHT) + 0.5) / HEIGHT * 0.6 - 0.3
    assert np.allclose(found, 1 / np.sqrt(1 + x**2 + y[:, None] ** 2), rtol=1e-6)


def test_a_holdout_of_another_shape_is_refused():
    with pytest.raises(scene.SceneError, match=r"shape \(24, 30\): expected \(24, 40\)"):
        HoldoutDepth(np.ones((24, 30)), WINDOW)
