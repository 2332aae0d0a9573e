"""Motion blur, depth of field and stereo of frames, against pinhole pictures of single instants."""

import dataclasses

import drjit as dr
import numpy as np
import pytest
from scipy.stats import t as student

import photonbeams as pb
from photonbeams import scene
from photonbeams.render.holdouts import HoldoutDepth
from photonbeams.render.pilots.beam_noise import beam_cost
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import begin, render
from photonbeams.runtime.device import Array2f, Float
from photonbeams.world.cameras.cameras import View, Window, on_lens
from photonbeams.world.shutter import CameraMotion, Moment, Shutter, slice_of
from photonbeams.world.warp import disk
from tests.helpers.comparison import quad
from tests.helpers.kernels import compiled

WIDTH, HEIGHT = 48, 32
WINDOW = Window.full(WIDTH, HEIGHT)
FOG = scene.Medium(scattering=(0.2, 0.2, 0.2))
CAMERA = scene.Camera(
    "/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.2, vertical_aperture=0.8, focus_distance=4.0
)
SEEDS = 32


def drawn(shift=(0.0, 0.0, 0.0), power=1.0):
    """Return two beams across the view, one four units away and one six to eight, moved by `shift`."""
    start = np.array([[-1.0, -0.6, -4.0], [-0.5, 2.0, -8.0]]) + shift
    end = np.array([[1.2, 0.7, -4.0], [0.4, -2.0, -6.0]]) + shift
    return scene.DrawnBeams("/beams", start, end, np.full(2, 0.1), np.full(2, 0.15), np.full((2, 3), power))


def shot(beams=None, meshes=(), lights=()):
    return scene.Scene(tuple(meshes), tuple(lights), (beams or drawn(),), (FOG,))


def beams_layer(shutter, view=0, **settings):
    settings = {"passes": 1} | settings
    return render(shutter, WINDOW, Settings(**settings)).views()[view]["beams"][..., 0].astype(np.float64)


def through_pixels(lens=(0.0, 0.0), place=(0.5, 0.5)):
    """Return the origin and directions of rays from a point on the lens to points in focus at a place in each pixel."""
    x, y = np.meshgrid((np.arange(WIDTH) + place[0]) / WIDTH - 0.5, 0.5 - (np.arange(HEIGHT) + place[1]) / HEIGHT)
    focus = CAMERA.focus_distance
    target = np.stack([1.2 * x * focus, 0.8 * y * focus, np.full_like(x, -focus)], axis=-1).reshape(-1, 3)
    origin = np.array([*lens, 0.0])
    return origin, target - origin


def instant(beams, lens=(0.0, 0.0), place=(0.5, 0.5)):
    each = pb.Beams(beams.start, beams.end, beams.radius_start, beams.radius_end, beams.power)
    origin, direction = through_pixels(lens, place)
    return pb.estimate(each, origin, direction, medium=FOG).numpy()[:, 0].reshape(HEIGHT, WIDTH).astype(np.float64)


def mean_of(instants):
    """Return the mean of 256 instants, each with its own beams or its own point on the lens.

    The instants are seen through different places in the pixels (the R2 sequence, Roberts 2018).
    """
    places = (np.arange(256)[:, None] / [1.32471795724474602596, 1.32471795724474602596**2]) % 1.0
    return np.mean([instant(*each, place=place) for each, place in zip(instants, places, strict=True)], axis=0)


def blocks(picture):
    """Return means over blocks of 4 × 4 pixels, each pixel of which has its own time and place on the lens."""
    return picture.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean(axis=(1, 3))


def assert_same_mean(frames, reference):
    """Assert that the mean of frames of independent seeds is the reference, by Student's t-test of each block."""
    frames, reference = np.array([blocks(frame) for frame in frames]), blocks(reference)
    error = frames.std(axis=0, ddof=1) / np.sqrt(len(frames))
    # Differences below this are rounding and the error of the reference's own 256 samples.
    floor = 2e-3 * reference.max()
    score = np.abs(frames.mean(axis=0) - reference) / np.hypot(error, floor)
    assert score.max() < student.ppf(1 - 1e-4 / (2 * reference.size), len(frames) - 1)
    # The test has the power to detect an exposure that is wrong by a few percent.
    totals = frames.mean(axis=(1, 2))
    assert totals.std(ddof=1) / np.sqrt(len(frames)) < 0.02 * reference.mean()


def test_a_moving_beam_is_the_mean_of_256_instants():
    shift = np.array([0.5, 0.4, 0.3])
    ends = shot(drawn()), shot(drawn(shift, 2.0))

    def at(fraction):
        state = ends[int(fraction)] if fraction in (0, 1) else shot(drawn(fraction * shift, 1 + fraction))
        return Moment(state, (CAMERA,))

    shutter = Shutter(at, moving=True)
    frames = [beams_layer(shutter, seed=seed) for seed in range(SEEDS)]
    times = (np.arange(256) + 0.5) / 256
    assert_same_mean(frames, mean_of([(drawn(t * shift, 1 + t),) for t in times]))


def test_a_lens_is_the_mean_of_pinholes_all_over_it(rng):
    radius = 0.25
    lens = dataclasses.replace(CAMERA, lens_radius=radius)
    frames = [beams_layer(Shutter.still(shot(), lens), seed=seed) for seed in range(SEEDS)]
    ring, turn = np.meshgrid(radius * np.sqrt((np.arange(16) + 0.5) / 16), (np.arange(16) + 0.5) / 16 * 2 * np.pi)
    places = np.stack([ring * np.cos(turn), ring * np.sin(turn)], axis=-1).reshape(-1, 2)
    sharp, reference = instant(drawn()), mean_of([(drawn(), place) for place in rng.permutation(places)])
    assert_same_mean(frames, reference)
    # The far beam is blurred over two of its diameters.
    assert np.abs(reference - sharp).max() > 0.2 * sharp.max()


@pytest.mark.parametrize("moving", ["beams", "camera"])
def test_a_pass_that_blurs_little_is_seen_at_one_instant(moving):
    """Its rays share one time and one place on the lens; the mean is that of all times and places."""
    shift, lens = np.array([0.05, -0.04, 0.03]), dataclasses.replace(CAMERA, lens_radius=0.06)

    def at(fraction):
        if moving == "beams":
            return Moment(shot(drawn(fraction * shift)), (lens,))
        matrix = np.eye(4)
        matrix[:3, 3] = -fraction * shift
        return Moment(at_rest, (moved(lens, matrix),))

    at_rest, shutter = shot(), Shutter(at, moving=True)
    frame = begin(shutter, WINDOW, Settings(passes=1), planned=1)
    instant_of_pass = frame._instant(0, frame.lit(0)[0])
    assert 0 <= instant_of_pass.time < 1 and instant_of_pass.pinholes[0].camera.lens_radius == 0
    frames = [beams_layer(shutter, seed=seed) for seed in range(2 * SEEDS)]
    angle, places = 2 * np.pi * 0.618034 * np.arange(256), np.sqrt((np.arange(256) + 0.5) / 256)
    on_lens = 0.06 * np.stack([places * np.cos(angle), places * np.sin(angle)], axis=1)
    times = (np.arange(256) * 0.754877666 + 0.5) % 1.0
    assert_same_mean(frames, mean_of([(drawn(t * shift), place) for t, place in zip(times, on_lens, strict=True)]))


@pytest.mark.parametrize(
    ("shift", "powers"),
    [
        ((0.5, 0.4, 0.3), (1.0, 1.0)),
        ((0, 0, 0), (1.0, 2.0)),
        ((0, 0, 0), (0.0, 1.0)),
        ((0, 0, 0), ((1, 0, 0), (0, 0, 1))),
    ],
)
def test_what_moves_far_or_changes_has_its_own_time_in_each_pixel(shift, powers):
    ends = drawn(power=powers[0]), drawn(np.array(shift), powers[1])
    shutter = Shutter(lambda fraction: Moment(shot(ends[int(fraction >= 1)]), (CAMERA,)), moving=True)
    frame = begin(shutter, WINDOW, Settings(passes=1), planned=1)
    assert frame._instant(0, frame.lit(0)[0]) is None


def test_edges_of_surfaces_far_out_of_focus_are_not_seen_at_one_instant():
    """Each pass would show its own sharp edge; of enough passes, the edges lie less than a pixel apart."""
    post = quad("/post", [[-0.1, -9, -0.3], [0.1, -9, -0.3], [0.1, 9, -0.3], [-0.1, 9, -0.3]])
    lens = dataclasses.replace(CAMERA, lens_radius=0.05)
    for meshes, passes, one in (([], 1, True), ([post], 1, False), ([post], 64, True)):
        frame = begin(Shutter.still(shot(meshes=meshes), lens), WINDOW, Settings(passes=passes), planned=passes)
        assert (frame._instant(0, frame.lit(0)[0]) is not None) == one


def test_a_holdout_out_of_focus_does_not_decide_how_a_crop_is_seen():
    """Its edges stay in their pixels, wherever on the lens rays begin."""
    lens = dataclasses.replace(CAMERA, lens_radius=0.05)
    for depth in (0.3, 9.0):
        held = [HoldoutDepth(np.full((HEIGHT, WIDTH), depth), WINDOW)]
        frame = begin(Shutter.still(shot(), lens), WINDOW, Settings(passes=1), held, planned=1)
        assert frame._instant(0, frame.lit(0)[0]) is not None


def test_drawn_beams_have_no_noise():
    frame = begin(Shutter.still(shot(), CAMERA), WINDOW, Settings(passes=1))
    assert beam_cost(frame, frame.lit(0)[0], WIDTH * HEIGHT).noise == 0


def test_a_pinhole_on_the_lens_has_the_rays_of_the_lens_there():
    camera = dataclasses.replace(CAMERA, lens_radius=0.3, horizontal_offset=0.1, vertical_offset=-0.2)
    place, square = (0.5, 0.5), Array2f(0.2, 0.85)
    own = View(camera, WINDOW).rays(place, lambda groups: (square + dr.zeros(Array2f, dr.width(groups)), Float(0)))
    pinhole = View(on_lens(camera, [float(each[0]) for each in disk(square)]).camera, WINDOW)
    found = pinhole.rays(place)
    assert pinhole.projection.lens is None and np.abs(found.origin.numpy()).max() > 0.1
    assert np.allclose(own.origin.numpy(), found.origin.numpy(), atol=1e-6)
    assert np.allclose(own.direction.numpy(), found.direction.numpy(), atol=1e-6)


def test_a_camera_at_a_time_is_the_one_that_rays_have_then():
    c, s = np.cos(0.02), np.sin(0.02)
    matrix = np.array([[c, 0, s, 0.3], [0, 1, 0, -0.2], [-s, 0, c, 0.1], [0, 0, 0, 1]])
    close = moved(CAMERA, matrix)
    own = View(CAMERA, WINDOW, close).rays(
        (0.5, 0.5), lambda groups: (dr.zeros(Array2f, dr.width(groups)), dr.full(Float, 0.3, dr.width(groups)))
    )
    found = View(CameraMotion(CAMERA, CAMERA, close).at(0.3), WINDOW).rays((0.5, 0.5))
    assert np.allclose(own.origin.numpy(), found.origin.numpy(), atol=1e-4)
    assert np.allclose(own.direction.numpy(), found.direction.numpy(), atol=1e-4)


def moved(camera, matrix):
    return dataclasses.replace(camera, to_world=matrix @ camera.to_world)


def test_a_moving_camera_blurs_as_what_it_sees_moving_the_other_way():
    shift = np.array([0.6, -0.3, 0.2])

    def at(fraction):
        matrix = np.eye(4)
        matrix[:3, 3] = fraction * shift
        return Moment(scene_at_rest, (moved(CAMERA, matrix),))

    scene_at_rest = shot()
    frames = [beams_layer(Shutter(at, moving=True), seed=seed) for seed in range(SEEDS)]
    times = (np.arange(256) + 0.5) / 256
    assert_same_mean(frames, mean_of([(drawn(-t * shift),) for t in times]))


def test_a_camera_that_moves_with_the_beams_sees_them_sharp():
    shift = np.array([0.5, 0.1, 0.0])

    def at(fraction):
        matrix = np.eye(4)
        matrix[:3, 3] = fraction * shift
        return Moment(shot(drawn(fraction * shift)), (moved(CAMERA, matrix),))

    found, expected = beams_layer(Shutter(at, moving=True)), beams_layer(Shutter.still(shot(), CAMERA))
    assert np.abs(found - expected).max() < 1e-3 * expected.max()  # float32, two units from the world's origin


def test_a_turning_camera_sees_beams_and_surfaces_at_the_same_place():
    """A beam that runs along a glowing rod stays on it while the camera turns."""
    glow = scene.Material(diffuse=scene.BLACK, emissive=(1.0, 1.0, 1.0))
    rod = quad("/rod", [[-0.05, -1, -4.2], [0.05, -1, -4.2], [0.05, 1, -4.2], [-0.05, 1, -4.2]], glow)
    start, end = np.array([[0.0, -1, -4.1]]), np.array([[0.0, 1, -4.1]])
    beam = scene.DrawnBeams("/beam", start, end, np.array([0.05]), np.array([0.05]), np.ones((1, 3)))
    state = shot(beam, [rod])

    def at(fraction):
        angle = 0.2 * (fraction - 0.5)
        turn = np.array([[np.cos(angle), 0, np.sin(angle), 0], [0, 1, 0, 0], [-np.sin(angle), 0, np.cos(angle), 0]])
        return Moment(state, (moved(CAMERA, np.vstack([turn, [0, 0, 0, 1]])),))

    layers = render(Shutter(at, moving=True), WINDOW, Settings(passes=64)).layers()
    beams, surface = (layers[name][..., 0].astype(float) for name in ("beams", "surface"))
    columns = np.arange(WIDTH) + 0.5
    for picture in (beams, surface):
        assert np.count_nonzero(picture[HEIGHT // 2] > 0.02 * picture.max()) > 6  # blurred over the turn
    middles = [(picture.sum(axis=0) * columns).sum() / picture.sum() for picture in (beams, surface)]
    assert middles[0] == pytest.approx(middles[1], abs=0.1)


def test_a_camera_that_turns_far_within_a_pass_is_warned_of(caplog):
    state = shot()

    def at(fraction):
        c, s = np.cos(2 * fraction), np.sin(2 * fraction)
        return Moment(state, (moved(CAMERA, np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])),))

    render(Shutter(at, moving=True), WINDOW, Settings(passes=2))
    assert [record.getMessage()[:24] for record in caplog.records] == ["/camera turns by 57 degr"]
    caplog.clear()
    render(Shutter(at, moving=True), WINDOW, Settings(passes=4))
    assert not caplog.records


def test_a_moving_surface_covers_a_pixel_for_its_share_of_the_time():
    glow = scene.Material(diffuse=scene.BLACK, emissive=(1.0, 1.0, 1.0))

    def at(fraction):
        x = 2 * fraction - 1
        corners = [[x - 9, -2, -4], [x, -2, -4], [x, 2, -4], [x - 9, 2, -4]]
        return Moment(shot(drawn((0, 0, -9)), [quad("/wall", corners, glow)]), (CAMERA,))

    alpha = render(Shutter(at, moving=True), WINDOW, Settings(passes=16)).layers()["rgba"][..., 3]
    # The edge moves from x = −1 to x = 1 at distance 4; a point is covered once the edge has passed it.
    edge = ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) * 1.2 * 4
    expected = np.clip((1 - edge) / 2, 0, 1)
    assert np.abs(alpha.mean(axis=0) - expected).max() <= 1 / 16 + 1 / WIDTH


def test_without_motion_lens_or_eye_distance_nothing_changes():
    state = shot()
    still = render(Shutter.still(state, CAMERA), WINDOW, Settings(passes=2)).layers()
    eyes = render(Shutter.still(state, CAMERA, dataclasses.replace(CAMERA)), WINDOW, Settings(passes=2)).views()
    for other in eyes:
        assert all(np.array_equal(other[name], still[name]) for name in still)
    repeated = render(Shutter.still(shot(), CAMERA), WINDOW, Settings(passes=2)).layers()
    assert all(np.array_equal(repeated[name], still[name]) for name in still)


def test_another_lens_crop_or_aspect_compiles_nothing():
    """Pictures of the same size in pixels share kernels for any field of view, which a zoom changes in each frame."""
    crop = Window(3 * WIDTH, 4 * HEIGHT, (48, 45, 48 + WIDTH, 45 + HEIGHT))
    for first in (CAMERA, dataclasses.replace(CAMERA, lens_radius=0.05)):
        render(Shutter.still(shot(), first), WINDOW, Settings(passes=1))
        for focal_length, window in ((1.37, WINDOW), (0.71, WINDOW), (1.0, crop)):
            camera = dataclasses.replace(first, focal_length=focal_length)
            assert not compiled(render, Shutter.still(shot(), camera), window, Settings(passes=1))


def test_depth_is_that_of_a_pinhole_as_the_shutter_opens():
    wall = quad("/wall", [[-9, -9, -6], [9, -9, -6], [9, 9, -6], [-9, 9, -6]])
    lens = dataclasses.replace(CAMERA, lens_radius=0.5)
    layers = render(Shutter.still(shot(meshes=[wall]), lens), WINDOW, Settings(passes=2)).layers()
    assert np.allclose(layers["depth"], 6, rtol=1e-5)


def test_depth_is_that_at_shutter_open():
    """The depth of a wall that moves away is that at shutter open, for any number of passes."""

    def at(fraction):
        z = -4 - 10 * fraction
        return Moment(shot(meshes=[quad("/wall", [[-99, -99, z], [99, -99, z], [99, 99, z], [-99, 99, z]])]), (CAMERA,))

    for passes in (1, 4):
        depth = render(Shutter(at, moving=True), WINDOW, Settings(passes=passes)).layers()["depth"]
        assert np.allclose(depth, 4, rtol=1e-5)


def test_a_time_limit_shows_the_whole_shutter():
    """If a time limit ends a render after one of many passes, that pass shows the whole shutter interval."""

    def at(fraction):
        return Moment(shot(drawn(power=1 + 9 * fraction)), (CAMERA,))

    shutter = Shutter(at, moving=True)
    limited = beams_layer(shutter, passes=1000, time_limit=1e-9)
    # Some 40 of 192 groups of pixels see the thin beam, each with a power from 1 to 10: the mean errs by a twelfth. The
    # first thousandth of the shutter interval would have a power of 1 instead of 5.5.
    assert limited.mean() == pytest.approx(instant(drawn(power=5.5)).mean(), rel=0.25)


def test_slices_cover_the_shutter_in_an_order_that_may_be_cut_short():
    for passes in (1, 2, 7, 16):
        slices = [slice_of(number, passes) for number in range(passes)]
        assert np.allclose(sorted(slices), [(k / passes, (k + 1) / passes) for k in range(passes)])
    assert sorted(slice_of(number, 16)[0] for number in range(4)) == [0, 0.25, 0.5, 0.75]
    # If the number of passes is unknown, the slices are the whole interval, then halves, then quarters.
    assert [slice_of(number, None) for number in range(5)] == [(0, 1), (0, 0.5), (0.5, 1), (0, 0.25), (0.5, 0.75)]
    # So many passes are treated as an unknown number: pass 2³⁰ is the second that covers 2⁻³⁰ of the interval.
    assert slice_of(2**30, 2**31 - 1) == (0.5, 0.5 + 2**-30)
