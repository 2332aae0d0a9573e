"""The photon map against a float64 sum over all photons, and the power that photons carry."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.estimators.photons import FACING, THICKNESS, PhotonMap, Photons
from photonbeams.numerics.arrays import to_float, to_uint, to_vectors
from photonbeams.runtime.device import Array3f
from tests.helpers.kernels import compiled

EPSILON32 = float(np.finfo(np.float32).eps)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_photons(rng, count, sizes=(0.01, 0.5)):
    """Return photons in a cube and on a few of its planes, of radii that differ by decades, as NumPy arrays."""
    position = rng.uniform(-1, 1, (count, 3))
    position[: count // 2, 2] = rng.choice([-1, 0.2, 1.0], count // 2)
    normal = unit(rng.normal(size=(count, 3)))
    normal[: count // 2] = (0, 0, 1)
    radius = np.exp(rng.uniform(*np.log(sizes), count))
    numbers = position, radius, normal, unit(rng.normal(size=(count, 3))), rng.uniform(0.1, 1, (count, 3))
    return [np.asarray(each, dtype=np.float32) for each in numbers]


def photons_of(position, radius, normal, direction, power, depth=0):
    vectors = [to_vectors(each) for each in (position, normal, direction, power)]
    return Photons(vectors[0], to_float(radius), *vectors[1:], depth)


def asked(numbers, position, normal, reflect=lambda direction: Array3f(1), active=True):
    found = PhotonMap(photons_of(*numbers)).radiance(to_vectors(position), to_vectors(normal), reflect, active)
    return np.ascontiguousarray(found.total.numpy().T)


def all_tried(numbers, position, normal, reflect=None):
    """Return the sums over all photons in float64, and for each point whether it is at a rim where rounding decides."""
    places, radius, up, direction, power = (each.astype(np.float64) for each in numbers)
    offset = position[:, None].astype(np.float64) - places
    rho2 = np.sum(offset**2, axis=2) / radius**2
    height = np.abs(np.sum(offset * up, axis=2)) / radius
    facing = normal.astype(np.float64) @ up.T
    covered = (rho2 < 1) & (height < THICKNESS) & (facing > FACING)
    kernel = 2 / np.pi * (1 - rho2) / radius**2 * covered
    light = power if reflect is None else power * reflect(-direction)
    # Differences of numbers up to 2 are rounded to ε, which is ε / R in units of the radius.
    close = 8 * EPSILON32 / radius
    doubtful = np.abs(rho2 - 1) < 4 * close
    doubtful |= (np.abs(height - THICKNESS) < close) & (rho2 < 2)
    doubtful |= (np.abs(facing - FACING) < 8 * EPSILON32) & (rho2 < 2)
    return kernel @ light, np.any(doubtful, axis=1)


@pytest.mark.parametrize("count", [1, 2, 3000])
@pytest.mark.parametrize("sizes", [(0.2, 0.2001), (0.01, 0.5), (0.002, 3.0)])
def test_points_find_the_photons_whose_discs_they_lie_in(count, sizes, rng):
    numbers = random_photons(rng, count, sizes)
    position = rng.uniform(-1.3, 1.3, (3000, 3)).astype(np.float32)
    position[:1000, 2] = rng.choice(np.array([-1, 0.2, 1.0], dtype=np.float32), 1000)
    normal = unit(rng.normal(size=(3000, 3))).astype(np.float32)
    normal[:2000] = (0, 0, 1)
    centres = rng.integers(0, count, 500)
    position[:500], normal[:500] = numbers[0][centres], numbers[2][centres]
    expected, doubtful = all_tried(numbers, position, normal)
    found = asked(numbers, position, normal)
    assert np.mean(doubtful) < 0.1 and np.count_nonzero(expected[:, 0]) >= 250
    # 1 − ρ² is accurate to a few ε and a difference's rounding, ε / R; the kernel at the centre is 2 / (π R²).
    peak = 2 / np.pi / numbers[1].astype(np.float64) ** 2
    covers = np.sum((position[:, None].astype(float) - numbers[0]) ** 2, axis=2) < 1.01 * numbers[1].astype(float) ** 2
    allowed = (covers * (peak * 8 * (2 / numbers[1] + 8))).sum(axis=1) * EPSILON32
    error = np.abs(found - expected).max(axis=1)
    assert np.all(error[~doubtful] <= allowed[~doubtful])


def test_what_reflects_is_asked_for_the_direction_the_light_comes_from(rng):
    numbers = random_photons(rng, 500, (0.2, 0.6))
    position = rng.uniform(-1, 1, (2000, 3)).astype(np.float32)
    position[:, 2] = 0.2
    normal = np.tile(np.array([0, 0, 1], dtype=np.float32), (2000, 1))
    shade = rng.uniform(0.5, 1, 2000).astype(np.float32)
    colour = to_float(shade)  # one value for each point, used for all its photons
    found = asked(numbers, position, normal, lambda w: Array3f(w.x * w.x, dr.maximum(w.z, 0), 1 + w.y) * colour)
    expected, doubtful = all_tried(
        numbers, position, normal, lambda w: np.stack([w[:, 0] ** 2, np.maximum(w[:, 2], 0), 1 + w[:, 1]], axis=1)
    )
    expected *= shade[:, None]
    error = np.abs(found - expected).max(axis=1)[~doubtful]
    # Sums of up to a hundred terms, each accurate to 8 (2 / R + 8) ε of its peak (see above), with R at least 0.2.
    assert error.max() <= 200 * EPSILON32 * expected.max() and np.median(expected) > 0


def test_the_light_on_a_plane_is_the_photons_power(rng):
    """The integral of the estimate over a plane is the sum of the photons' powers, whatever their radii."""
    count, side = 200, 1000
    place = rng.uniform(-1, 1, (count, 3)) * (1, 1, 0)
    radius = rng.uniform(0.05, 0.4, count)
    power = rng.uniform(0.1, 1, (count, 3))
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # the plane has a random orientation
    numbers = [np.asarray(each, dtype=np.float32) for each in (place @ turn, radius, up @ turn, -up @ turn, power)]
    steps = (np.arange(side) + 0.5) / side * 3 - 1.5
    grid = np.stack([*np.meshgrid(steps, steps), np.zeros((side, side))], axis=-1).reshape(-1, 3)
    found = asked(numbers, grid @ turn, np.broadcast_to(up[0] @ turn, grid.shape))
    # The kernel has a corner at the rim of its disc: a sum over squares of width w errs there by less than
    # (w / R)² = 0.4 %, in either direction.
    assert np.allclose(found.sum(axis=0) * (3 / side) ** 2, power.sum(axis=0), rtol=(0.003 / 0.05) ** 2)


def test_surfaces_that_face_away_or_lie_behind_are_not_lit():
    numbers = [np.array(each, dtype=np.float32) for each in ([[0, 0, 0]], [1], [[0, 0, 1]], [[0, 0, -1]], [[1, 1, 1]])]
    position = [[0, 0, 0], [0, 0, 0], [0, 0, 0.2], [0, 0, 0.3], [0, 0, -0.3], [0.99, 0, 0], [1.01, 0, 0], [50, 0, 0]]
    normal = np.tile([0.0, 0.0, 1.0], (len(position), 1))
    normal[1] = (0, 0, -1)
    lit = asked(numbers, np.array(position, dtype=float), normal)[:, 0] > 0
    assert lit.tolist() == [True, False, True, False, False, True, False, False]


def test_points_that_do_not_ask_get_nothing_and_no_photons_give_nothing(rng):
    numbers = random_photons(rng, 50, (0.5, 1.0))
    position, normal = np.zeros((4, 3)), np.tile([0.0, 0.0, 1.0], (4, 1))
    photons = photons_of(*numbers)
    ask = to_float([0, 1, 0, 1]) > 0
    found = (
        PhotonMap(photons).radiance(to_vectors(position), to_vectors(normal), lambda w: Array3f(1), ask).total.numpy()
    )
    assert not found[:, 0].any() and found[:, 1].all() and np.array_equal(found[:, 1], found[:, 3])
    nothing = photons_of(*(each[:0] for each in numbers))
    assert not PhotonMap(nothing).radiance(to_vectors(position), to_vectors(normal), Array3f).total.numpy().any()


def test_a_point_is_lit_by_photons_of_its_greatest_depth_and_less(rng):
    numbers = random_photons(rng, 200, (0.2, 1.0))
    depth = rng.integers(0, 4, 200)
    position, normal = rng.uniform(-1, 1, (60, 3)), np.tile([0.0, 0.0, 1.0], (60, 1))
    most = np.arange(60) % 5
    found = PhotonMap(photons_of(*numbers, to_uint(depth))).radiance(
        to_vectors(position), to_vectors(normal), lambda w: Array3f(1), most=to_uint(most)
    )
    expected = np.zeros((60, 3))
    for limit in range(5):
        few = [each[depth <= limit] for each in numbers]
        expected[most == limit] = asked(few, position[most == limit], normal[most == limit])
    assert expected.any()
    np.testing.assert_allclose(found.total.numpy().T, expected, rtol=1e-5)


def test_each_light_group_has_the_light_of_its_photons(rng):
    numbers, group = random_photons(rng, 200, (0.2, 1.0)), rng.integers(0, 3, 200)
    position, normal = rng.uniform(-1, 1, (60, 3)), np.tile([0.0, 0.0, 1.0], (60, 1))
    photons = photons_of(*numbers)
    photons.group = to_uint(group)
    found = PhotonMap(photons, 3).radiance(to_vectors(position), to_vectors(normal), lambda w: Array3f(1))
    for number, part in enumerate(found.parts):
        expected = asked([each[group == number] for each in numbers], position, normal)
        assert expected.any()
        np.testing.assert_allclose(part.numpy().T, expected, rtol=1e-5)


def test_the_same_photons_give_the_same_bits(rng):
    numbers = random_photons(rng, 5000, (0.05, 0.5))
    position = rng.uniform(-1, 1, (20000, 3))
    normal = np.tile([0.0, 0.0, 1.0], (20000, 1))
    first, second = (asked(numbers, position, normal) for _ in range(2))
    assert first.any() and np.array_equal(first, second)


def test_other_photons_compile_nothing(rng):
    def run(count, points):
        numbers = random_photons(rng, count, (0.05, 0.5))
        return asked(numbers, rng.uniform(-1, 1, (points, 3)), np.tile([0.0, 0.0, 1.0], (points, 1)))

    run(300, 1000)
    assert not compiled(run, 4001, 3000)
