"""Tiled pictures against the same rays one by one: with every camera, no tile misses a beam that it shows."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.estimators import cells, image
from photonbeams.estimators.estimate import ENDLESS
from photonbeams.estimators.footprints import footprints
from photonbeams.estimators.image import estimate_image
from photonbeams.estimators.lanes import PixelRays, lane_of
from photonbeams.estimators.points import Points
from photonbeams.estimators.projection import TILE
from photonbeams.estimators.tiles import Bins
from photonbeams.numerics.arrays import to_float
from photonbeams.numerics.hashing import hash32, unit_float
from photonbeams.runtime.device import Array2f, Float, UInt32
from photonbeams.world.cameras.cameras import View, Window
from tests.helpers.kernels import compiled

EPSILON32 = float(np.finfo(np.float32).eps)
MEDIUM = pb.Medium((0.3, 0.2, 0.1), (0.05, 0.1, 0.2), 0.4)
POINTS = Points(pb.gauss_legendre(6))
WIDTH, HEIGHT = 83, 50  # not multiples of a tile


def looking(eye, forward, roll=0.3):
    """Return a camera's matrix, for column vectors."""
    z = -np.asarray(forward, dtype=float) / np.linalg.norm(forward)
    x = np.cross([np.sin(roll), np.cos(roll), 0.1], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([x, np.cross(z, x), z, np.asarray(eye, dtype=float)], axis=1)
    return matrix


PINHOLE = scene.Camera(
    "/camera",
    to_world=looking((0.1, -0.2, 0.3), (0.2, 0.1, -1)),
    focal_length=0.9,
    horizontal_aperture=1.0,
    vertical_aperture=0.6,
)
VIEWS = {
    "pinhole": (PINHOLE, Window.full(WIDTH, HEIGHT)),
    "wide": (dataclasses.replace(PINHOLE, focal_length=0.2), Window.full(WIDTH, HEIGHT)),
    "long lens": (dataclasses.replace(PINHOLE, focal_length=6.0), Window.full(WIDTH, HEIGHT)),
    "shifted": (dataclasses.replace(PINHOLE, horizontal_offset=0.4, vertical_offset=-0.2), Window.full(WIDTH, HEIGHT)),
    "crop": (PINHOLE, Window(200, 120, (20, 33, 20 + WIDTH, 33 + HEIGHT))),
    "orthographic": (
        dataclasses.replace(PINHOLE, projection="orthographic", horizontal_aperture=4.0, vertical_aperture=2.4),
        Window.full(WIDTH, HEIGHT),
    ),
}
LENS = dataclasses.replace(PINHOLE, lens_radius=0.08, focus_distance=2.5)
#: Camera at shutter open and, where it moves, at shutter close.
FILM = {
    "moving beams": (PINHOLE, None),
    "lens": (LENS, None),
    "dolly": (PINHOLE, dataclasses.replace(PINHOLE, to_world=looking((0.3, -0.1, 0.0), (0.2, 0.1, -1)))),
    "pan": (PINHOLE, dataclasses.replace(PINHOLE, to_world=looking((0.1, -0.2, 0.3), (0.35, 0.05, -1), roll=0.2))),
    "lens and pan": (LENS, dataclasses.replace(LENS, to_world=looking((0.2, -0.2, 0.1), (0.3, 0.1, -1)))),
    "orthographic and pan": (
        dataclasses.replace(VIEWS["orthographic"][0]),
        dataclasses.replace(VIEWS["orthographic"][0], to_world=looking((0.2, -0.2, 0.1), (0.3, 0.1, -1))),
    ),
}


def by_group(numbers):
    """Return a lens sample in the unit square and a time sample for each group of pixels."""
    u, v, time = (unit_float(hash32(numbers, UInt32(dimension))) for dimension in range(3))
    return Array2f(u, v), time


class Picture:
    """One view: its projection, and a ray through each pixel's centre."""

    def __init__(self, name, t_max=None):
        view = View(FILM[name][0], Window.full(WIDTH, HEIGHT), FILM[name][1]) if name in FILM else View(*VIEWS[name])
        self.projection = view.projection
        count = WIDTH * HEIGHT
        rays = view.rays((0.5, 0.5), by_group if name in FILM else None)
        self.time = None
        if rays.times is not None:
            x, y = view.pixels()
            self.time = by_group(lane_of(x, y, UInt32(self.projection.columns)))[1]
        self.t_max = np.full(count, ENDLESS) if t_max is None else t_max
        self.rays = PixelRays(*rays[:3], to_float(self.t_max), dr.zeros(Float, count), rays.origins, rays.times)
        dr.eval(self.rays.t_min, self.rays.t_max)

    def tiled(self, beams, look, estimator, close=None, step=None):
        return estimate_image(
            beams, self.projection, self.rays, look=look, medium=MEDIUM, estimator=estimator, points=POINTS,
            close=close, step=step,
        )  # fmt: skip

    def one_by_one(self, beams, look, estimator, close=None):
        found = pb.estimate(
            beams, self.rays.origin, self.rays.direction, t_max=self.rays.t_max,
            look=look, medium=MEDIUM, estimator=estimator, close=close, time=self.time,
        )  # fmt: skip
        return found.numpy()


def pixels(radiance):
    return np.ascontiguousarray(radiance.numpy().T)


def random_beams(rng, count):
    """Return beams of all kinds: through the camera, behind it, thin and far, thick and near, along the view."""
    toward = np.array([0.2, 0.1, -1.0])
    start = rng.uniform(-1, 1, (count, 3)) * rng.choice([0.3, 2, 8], (count, 1))
    start += toward * rng.choice([0, 2], (count, 1))
    end = start + rng.normal(size=(count, 3)) * rng.choice([0.3, 2, 8], (count, 1))
    radius = rng.choice([0.004, 0.03, 0.3], (count, 1)) * rng.uniform(0.1, 1, (count, 2))
    return start, end, radius


def test_short_kernels_give_the_same_picture_and_can_be_ended_between_them(rng, monkeypatch):
    monkeypatch.setattr(image, "_MOST_TESTS", 5000)
    start, end, radius = random_beams(rng, 300)
    beams = pb.Beams(start, end, radius[:, 0], radius[:, 1], rng.uniform(0.1, 1, (300, 3)))
    steps, picture = [], Picture("pinhole")
    once = picture.tiled(beams, pb.Look(), "auto")
    parts = picture.tiled(beams, pb.Look(), "auto", step=lambda: steps.append(1))
    assert np.array_equal(once.radiance.numpy(), parts.radiance.numpy()) and len(steps) > 10
    assert (once.billboard_tests, once.frustum_tests) == (parts.billboard_tests, parts.frustum_tests)

    def end_it():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        picture.tiled(beams, pb.Look(), "auto", step=end_it)


# `auto` has both of the others in it, which are tried alone with one camera of each kind.
ALONE = ("pinhole", "orthographic", "lens and pan", "moving beams")


@pytest.mark.parametrize(
    ("view", "estimator"),
    [
        pytest.param(view, each, marks=() if each == "auto" or view in ALONE else pytest.mark.soak)
        for view in (*VIEWS, *FILM)
        for each in ("billboard", "frustum", "auto")
    ],
)
def test_tiled_equals_untiled(view, estimator, rng):
    picture = Picture(view)
    start, end, radius = random_beams(rng, 300)
    beams = pb.Beams(start, end, radius[:, 0], radius[:, 1], rng.uniform(0.1, 1, (300, 3)))
    close = None
    if view == "moving beams":
        start, end = (each + 0.1 * rng.normal(size=each.shape) for each in (start, end))
        close = pb.Beams(start, end, radius[:, 1], radius[:, 0], rng.uniform(0.1, 1, (300, 3)))
    for look in (pb.Look(), pb.Look(across=pb.looks.Gaussian(), along=pb.looks.Exponential(2), eye=1.0, angle=1.0)):
        found = pixels(picture.tiled(beams, look, estimator, close).radiance)
        expected = picture.one_by_one(beams, look, estimator, close)
        # One packs the beams relative to the camera, the other relative to the world's origin: positions up to 20 units
        # away are rounded to 20 ε, and some radii are 0.0004. A ray at the rim of such a beam may see it or not, so its
        # error is relative to the brightest pixels of the picture; all other rays agree up to rounding.
        error = np.abs(found - expected).max(axis=1)
        scale = np.maximum(expected.max(axis=1), np.quantile(expected, 0.99))
        assert np.quantile(error / scale, 0.98) <= 1000 * EPSILON32
        assert np.linalg.norm(found - expected) <= 20 * EPSILON32 / 0.0004 * np.linalg.norm(expected)


def inside_points(rng, start, end, radius, normal, count):
    """Return points inside beams, (N, count, 3), half of them on the wall; NaN where a slanted end cuts them off."""
    axis = end - start
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis /= length
    up = np.cross(axis, [0.123, 0.456, 0.789])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    right = np.cross(axis, up)
    longest = 1.0 if normal is None else 1 + radius[:, 1:] / length  # a slanted end may reach past the axis' end
    along = rng.choice([0, 1, *rng.random(10)], (len(start), count)) * longest
    reach = radius[:, :1] + np.diff(radius, axis=1) * along
    reach *= np.where(rng.random(along.shape) < 0.5, 1, rng.random(along.shape))
    angle = rng.uniform(0, 2 * np.pi, along.shape)
    points = start[:, None] + axis[:, None] * (along * length)[..., None]
    points += (reach * np.cos(angle))[..., None] * up[:, None] + (reach * np.sin(angle))[..., None] * right[:, None]
    if normal is not None:
        points[np.einsum("npk,nk->np", points - end[:, None], normal) < 0] = np.nan
    return points


def slanted_ends(rng, start, end):
    """Return directions at both ends of pieces of curves, up to 60 degrees from the axis."""
    axis = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    across = np.cross(axis, rng.normal(size=(2, *axis.shape)))
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    found = axis + across * np.tan(np.radians(rng.uniform(0, 60, (2, len(axis), 1))))
    return found / np.linalg.norm(found, axis=2, keepdims=True)


def inside_bends(rng, start, end, radius, tangents, count):
    """Return points inside pieces of curves, (N, count, 3); NaN where the planes at the ends cut them off."""
    axis = end - start
    length = np.linalg.norm(axis, axis=1)[:, None]
    axis = axis / length
    up = np.cross(axis, [0.123, 0.456, 0.789])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = rng.uniform(-1, 1, (len(start), count)) * radius[:, :1] + length * rng.integers(0, 2, (len(start), count))
    angle, across = rng.uniform(0, 2 * np.pi, along.shape), rng.random(along.shape) ** 0.3
    reach = across * radius.max(axis=1)[:, None]
    side = np.cos(angle)[..., None] * up[:, None] + np.sin(angle)[..., None] * np.cross(axis, up)[:, None]
    points = start[:, None] + along[..., None] * axis[:, None] + reach[..., None] * side
    first, last = (
        np.einsum("npk,nk->np", points - place[:, None], each) / np.einsum("nk,nk->n", axis, each)[:, None]
        for place, each in zip((start, end), tangents, strict=True)
    )
    with np.errstate(all="ignore"):
        wide = lerp(radius[:, :1], radius[:, 1:], first / (first - last))
        inside = (first > 0) & (last < 0) & (reach < wide)
    inside &= (along > -radius[:, :1]) & (along < length + radius[:, 1:])
    points[~inside] = np.nan
    return points


def lerp(a, b, weight):
    return a + (b - a) * weight


def on_screen(points, time, rng, camera, close, projection):
    """Return pixel positions (N, P) of world points, each seen from somewhere on the lens, and their depth."""
    matrices = [np.linalg.inv(each.to_world) for each in (camera, close or camera)]
    place = lerp(*(points @ matrix[:3, :3].T + matrix[:3, 3] for matrix in matrices), time[..., None])
    scale, center = ([float(axis[0]) for axis in pair] for pair in (projection.scale, projection.center))
    depth = -place[..., 2]
    if camera.orthographic:
        return center[0] + scale[0] * place[..., 0], center[1] - scale[1] * place[..., 1], np.ones_like(depth)
    angle, reach = rng.uniform(0, 2 * np.pi, depth.shape), camera.lens_radius * np.sqrt(rng.random(depth.shape))
    blur = reach * (1 / depth - (1 / camera.focus_distance if camera.lens_radius else 0))
    x = center[0] + scale[0] * (place[..., 0] / depth - np.cos(angle) * blur)
    return x, center[1] - scale[1] * (place[..., 1] / depth - np.sin(angle) * blur), depth


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("slanted", [False, True, "bent"])
def test_no_tile_misses_a_beam(view, slanted, rng):
    """Every point of a beam that lies in the picture lies in a tile that lists the beam."""
    camera, window = VIEWS[view]
    projection = View(camera, window).projection
    start, end, radius = random_beams(rng, 3000)
    normal = None
    tangents = (None, None)
    if slanted == "bent":
        tangents = slanted_ends(rng, start, end)
    elif slanted:
        normal = rng.normal(size=start.shape) * 0.5 - (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    beams = pb.Beams(
        start, end, radius[:, 0], radius[:, 1], [[1, 1, 1]],
        end_normal=normal, start_tangent=tangents[0], end_tangent=tangents[1],
    )  # fmt: skip
    endless = dr.full(Float, np.inf, projection.tiles)
    lists = Bins(footprints(beams, projection), projection, endless, 0, len(beams)).lists()
    sizes = lists.stop.numpy().astype(int) - lists.first.numpy()
    listed = np.repeat(np.arange(projection.tiles), sizes) * len(beams) + lists.beams.numpy()

    if slanted == "bent":
        points = inside_bends(rng, start, end, radius, tangents, 400)
    else:
        points = inside_points(rng, start, end, radius, normal, 150)
    with np.errstate(all="ignore"):
        x, y, depth = on_screen(points, np.zeros(points.shape[:2]), rng, camera, None, projection)
        # Rounding moves a position on the screen by this many pixels, possibly into the next tile.
        slack = 40 * EPSILON32 * float(projection.scale[0][0]) / depth
        x, y = (np.where(np.abs(axis / TILE - np.round(axis / TILE)) * TILE > slack, axis, np.nan) for axis in (x, y))
        seen = (depth > 1e-4) & (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT)
    tile = y[seen] // TILE * projection.columns + x[seen] // TILE
    number = np.broadcast_to(np.arange(len(beams))[:, None], seen.shape)[seen]
    assert np.count_nonzero(seen) > 5_000
    assert np.all(np.isin(tile.astype(int) * len(beams) + number, listed))


@pytest.mark.parametrize("film", FILM)
@pytest.mark.parametrize("slanted", [False, True])
def test_no_tile_misses_a_beam_out_of_focus_or_in_motion(film, slanted, rng):
    """Every point of a beam, at every time and from every place on the lens, lies in a tile that lists the beam."""
    (camera, close), count = FILM[film], 6000
    projection = View(camera, Window.full(WIDTH, HEIGHT), close).projection
    half = count // 2
    around = camera.to_world[:3, 3] + rng.normal(size=(2, half, 3)) * rng.choice([0.1, 0.4, 2], (1, half, 1))
    both = zip(random_beams(rng, half), (*around, rng.uniform(0.001, 0.05, (half, 2))), strict=True)
    ends = [[np.concatenate(pair) for pair in both]]
    ends.append(
        [each + rng.normal(size=each.shape) * rng.choice([0, 0.05, 0.3, 1], (count, 1)) for each in ends[0][:2]]
    )
    ends[1].append(ends[0][2] * rng.uniform(0.5, 1.5, (count, 2)))
    normal = rng.normal(size=(count, 3)) if slanted else None
    states = [pb.Beams(a, b, r[:, 0], r[:, 1], [[1, 1, 1]], end_normal=normal) for a, b, r in ends]
    endless = dr.full(Float, np.inf, projection.tiles)
    lists = Bins(footprints(states[0], projection, states[1]), projection, endless, 0, count).lists()
    sizes = lists.stop.numpy().astype(int) - lists.first.numpy()
    listed = np.repeat(np.arange(projection.tiles), sizes) * count + lists.beams.numpy()

    seen_points = 0
    for time in (0.0, 0.15, 0.5, 0.8, 1.0):
        points = inside_points(rng, *(lerp(a, b, time) for a, b in zip(*ends, strict=True)), normal, 40)
        with np.errstate(all="ignore"):
            x, y, depth = on_screen(points, np.full(points.shape[:2], time), rng, camera, close, projection)
            slack = 40 * EPSILON32 * float(projection.scale[0][0]) / depth
            away = [np.abs(axis / TILE - np.round(axis / TILE)) * TILE > slack for axis in (x, y)]
            seen = (depth > 1e-4) & (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT) & away[0] & away[1]
        tile = y[seen] // TILE * projection.columns + x[seen] // TILE
        number = np.broadcast_to(np.arange(count)[:, None], seen.shape)[seen]
        assert np.all(np.isin(tile.astype(int) * count + number, listed))
        seen_points += len(number)
    assert seen_points > 10_000


def test_beams_behind_surfaces_are_left_out_and_those_across_them_are_cut(rng):
    # A wall that slants away, in front of some beams and behind others.
    t_max = np.repeat(np.linspace(1.0, 5.0, HEIGHT), WIDTH)
    picture, endless = Picture("pinhole", t_max), Picture("pinhole")
    start = rng.uniform(-1.5, 1.5, (200, 3)) + np.array([0.1, -0.2, -2.7])
    beams = pb.Beams(start, start + rng.normal(size=(200, 3)), 0.05, 0.05, [[1, 1, 1]])
    for estimator in ("billboard", "frustum", "auto"):
        tiled = picture.tiled(beams, pb.Look(), estimator)
        found, expected = pixels(tiled.radiance), picture.one_by_one(beams, pb.Look(), estimator)
        assert np.linalg.norm(found - expected) <= 1e-4 * np.linalg.norm(expected)
        tests = endless.tiled(beams, pb.Look(), estimator)
        assert tiled.billboard_tests + tiled.frustum_tests < 0.8 * (tests.billboard_tests + tests.frustum_tests)


def test_auto_sends_to_the_frustum_only_what_is_near(rng):
    start = rng.uniform(-1, 1, (200, 3)) * np.array([0, 1, 1]) + np.array([-9, 0, -4])  # their ends are out of view
    far = pb.Beams(start, start + np.array([18, 0, 0]), 0.01, 0.01, [[1, 1, 1]])
    picture = Picture("pinhole")
    assert picture.tiled(far, pb.Look(), "auto").frustum_tests == 0
    around = pb.Beams([[0.1, -0.2, 0.3]], [[0.3, -0.1, -0.7]], 0.1, 0.2, [[1, 1, 1]])
    assert picture.tiled(around, pb.Look(), "auto").frustum_tests >= WIDTH * HEIGHT


def test_lists_longer_than_memory_allows_are_worked_off_in_parts(rng, monkeypatch):
    picture = Picture("pinhole")
    start, end, radius = random_beams(rng, 400)
    beams = pb.Beams(start, end, radius[:, 0], radius[:, 1], [[1, 1, 1]])
    whole = picture.tiled(beams, pb.Look(), "auto")
    monkeypatch.setattr(cells, "ENTRIES", 500)
    parts = picture.tiled(beams, pb.Look(), "auto")
    assert parts.billboard_tests == whole.billboard_tests and parts.frustum_tests == whole.frustum_tests
    # The same numbers, summed in another order.
    np.testing.assert_allclose(pixels(parts.radiance), pixels(whole.radiance), rtol=400 * EPSILON32)


def test_other_beams_and_another_camera_compile_nothing(rng):
    def run(view, count):
        start, end, radius = random_beams(rng, count)
        beams = pb.Beams(start, end, radius[:, 0], radius[:, 1], [[1, 1, 1]])
        dr.eval(Picture(view).tiled(beams, look, "auto").radiance)

    look = pb.Look(along=pb.looks.ColorRamp([0, 1], [[1, 0, 0], [0, 0, 1]]) * pb.looks.Attenuation())
    run("pinhole", 300)
    assert not compiled(run, "shifted", 500)


def test_a_picture_without_beams_is_black():
    none = pb.Beams(np.zeros((0, 3)), np.zeros((0, 3)), 0.1, 0.1, np.zeros((0, 3)))
    found = Picture("pinhole").tiled(none, pb.Look(), "auto")
    assert found.billboard_tests == 0 and not pixels(found.radiance).any()
