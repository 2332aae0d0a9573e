"""Fewer rays behind mirrors: radiance interpolated from some rays, against radiance evaluated along all of them."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.estimators.coarse_rays import RayImages
from photonbeams.estimators.estimate import estimate_rays
from photonbeams.estimators.geometry import Rays
from photonbeams.estimators.lanes import Lattice
from photonbeams.estimators.points import Points
from photonbeams.numerics.arrays import to_float, to_uint, to_vectors
from photonbeams.runtime.device import Array2f, Array3f, Float, UInt32

WIDTH, HEIGHT, TOLERANCE = 400, 220, 0.002
PLACE = (0.3, 0.6)
MIRROR = np.array([0.6, 0.0, 0.8])  # its normal; the mirror is 3 units in front of the camera


def pixels(rng, corner=(0, 0)):
    """Return columns, rows and film positions of pixels; the place in a pixel is PLACE if column and row are even."""
    y, x = (each.ravel() for each in np.mgrid[:HEIGHT, :WIDTH])
    even = ((x + corner[0]) % 2 == 0) & ((y + corner[1]) % 2 == 0)
    place = np.where(even[:, None], PLACE, rng.random((len(x), 2)))
    return x, y, np.stack([x, y], axis=1) + place


def reflected(film, far=8.0):
    """Return the rays that a plane mirror reflects, of the length `far`."""
    ndc = (film - [WIDTH / 2, HEIGHT / 2]) / WIDTH
    ahead = np.concatenate([ndc, np.ones((len(ndc), 1))], axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    t = 3 * MIRROR[2] / (ahead @ MIRROR)
    origin, direction = ahead * t[:, None], ahead - 2 * (ahead @ MIRROR)[:, None] * MIRROR
    count = len(film)
    return Rays(
        to_vectors(origin), to_vectors(direction), to_float(np.broadcast_to(far, count)), dr.zeros(Float, count),
        index=dr.arange(UInt32, count),
    )  # fmt: skip


def images(film, number=0, corner=(0, 0), least=0.0):
    """Return the `RayImages` of all pixels' rays; `number` is the picture that each ray belongs to."""
    count = len(film)
    return RayImages(
        Lattice.of(WIDTH, HEIGHT, corner, Array2f(*PLACE)), (WIDTH, HEIGHT),
        to_uint(np.broadcast_to(number, count)), dr.arange(UInt32, count),
        Array2f(to_float(film[:, 0]), to_float(film[:, 1])), dr.full(Float, least, count), TOLERANCE,
    )  # fmt: skip


class Field:
    """The radiance of each ray, and a record of the rays that were evaluated."""

    def __init__(self, radiance):
        self.radiance, self.looked = radiance, []

    def __call__(self, index):
        self.looked.append(index.numpy())
        return Array3f(dr.gather(Float, to_float(self.radiance), index))

    def seen(self, images, rays):
        """Return the radiance of all rays, and check that none is evaluated twice."""
        result = images.radiance(rays, self).numpy()[0]
        looked = np.concatenate(self.looked)
        assert len(np.unique(looked)) == len(looked)
        np.testing.assert_array_equal(result[looked], self.radiance[looked].astype(np.float32))
        return result

    @property
    def part(self):
        """The fraction of rays that were evaluated."""
        return sum(map(len, self.looked)) / len(self.radiance)


def waves(film):
    return 1 + 0.5 * np.sin(film[:, 0] / 40) * np.cos(film[:, 1] / 50)


@pytest.mark.parametrize("corner", [(0, 0), (7, 4)])
def test_what_is_smooth_is_looked_at_along_few_rays(rng, corner):
    _, _, film = pixels(rng, corner)
    field = Field(waves(film))
    found = field.seen(images(film, corner=corner), reflected(film))
    assert field.part < 0.2
    error = np.abs(found / field.radiance - 1)
    assert np.median(error) < TOLERANCE and np.percentile(error, 99) < 3 * TOLERANCE


def test_what_is_grainy_is_looked_at_along_all_rays(rng):
    _, _, film = pixels(rng)
    field = Field(rng.uniform(0.5, 1, len(film)))
    field.seen(images(film), reflected(film))
    assert field.part == 1


def test_what_is_grainy_but_faint_in_its_pixel_is_not(rng):
    _, _, film = pixels(rng)
    field = Field(rng.uniform(0.5, 1, len(film)))
    field.seen(images(film, least=1000.0), reflected(film))
    assert field.part < 0.1


def test_pictures_do_not_mix(rng):
    """Radiance is not interpolated between branches: the right half is another one, a hundred times as bright."""
    x, _, film = pixels(rng)
    right = x >= 201
    field = Field(waves(film) * np.where(right, 100, 1))
    found = field.seen(images(film, number=right.astype(int) * 3), reflected(film))
    assert field.part < 0.3
    assert np.abs(found / field.radiance - 1).max() < 10 * TOLERANCE


def test_rays_that_end_elsewhere_than_their_neighbours_are_looked_along(rng):
    x, y, film = pixels(rng)
    board = (np.abs(x - 150) < 30) & (np.abs(y - 100) < 40)
    field = Field(waves(film) * np.where(board, 0.999, 1))  # the radiance does not show the edge
    field.seen(images(film), reflected(film, far=np.where(board, 4.0, 8.0)))
    looked = np.zeros(len(film), dtype=bool)
    looked[np.concatenate(field.looked)] = True
    cell = np.floor((film - PLACE) / 2).astype(int) * 2
    grid = board.reshape(HEIGHT, WIDTH)
    amid = ((cell >= 0) & (cell + 2 < [WIDTH, HEIGHT])).all(axis=1)
    corners = [
        grid[np.where(amid, cell[:, 1] + j, 0), np.where(amid, cell[:, 0] + i, 0)] for i in (0, 2) for j in (0, 2)
    ]
    (u, v), (a, b, c, d) = ((film - PLACE - cell) / 2).T, corners
    told = (1 - u) * ((1 - v) * a + v * b) + u * ((1 - v) * c + v * d)  # the fraction of the board, by its corners
    assert looked[amid & (np.abs(told - board) > 0.01)].all()
    assert field.part < 0.4


def test_few_rays_are_all_looked_along(rng):
    _, _, film = pixels(rng)
    some = to_uint(np.arange(0, len(film), 30))
    field = Field(waves(film)[::30])
    field.seen(images(film).taken(some), reflected(film).taken(some))
    assert field.part == 1


def fan(rng, count=400):
    y, z = rng.uniform(-3, 3, (2, count, 2))
    start, end = (np.stack([np.full(count, x), y[:, i], z[:, i]], axis=1) for i, x in enumerate((-9.0, 9.0)))
    return pb.Beams(start, end, 0.6, 0.7, rng.uniform(0.5, 1, (count, 3)))


def test_beams_in_a_mirror_err_as_little_as_asked(rng):
    _, _, film = pixels(rng)
    rays, beams = reflected(film), fan(rng)
    options = {"look": pb.Look(), "medium": pb.Medium(scattering=0.1), "points": Points(pb.gauss_legendre(6))}
    exact = estimate_rays(beams, rays, **options).numpy().mean(axis=0)
    fast = estimate_rays(beams, rays, images=images(film), **options).numpy().mean(axis=0)
    bright = exact > 0.05 * exact.mean()
    error = np.abs(fast / np.maximum(exact, 1e-30) - 1)[bright]
    assert 0 < np.median(error) < TOLERANCE and np.percentile(error, 95) < 3 * TOLERANCE


def test_looks_that_are_not_smooth_are_seen_along_every_ray(rng):
    _, _, film = pixels(rng)
    rays, beams = reflected(film), fan(rng, 100)
    look = pb.Look(across=pb.looks.Expression("0.5 + 0.5 * noise(4 * P)"))
    options = {"look": look, "medium": pb.Medium(scattering=0.1), "points": Points(pb.gauss_legendre(6))}
    exact = estimate_rays(beams, rays, **options).numpy()
    np.testing.assert_array_equal(estimate_rays(beams, rays, images=images(film), **options).numpy(), exact)
