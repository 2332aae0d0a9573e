"""Samples in the unit square, and the maps from it."""

import drjit as dr
import numpy as np
import pytest
from scipy.stats import qmc

from photonbeams.numerics import sampling
from photonbeams.runtime.device import Array2f, Array3f, Float, UInt32
from photonbeams.world import warp

POINTS = 1 << 14


@pytest.fixture(scope="module")
def square():
    """Return stratified points of the unit square."""
    return sampling.sobol_block(POINTS, 0, (1,))[0]


def is_net(points):
    """Return whether every elementary interval of base 2 holds one of 2^m points."""
    count = points.shape[1]
    m = count.bit_length() - 1
    cells = [np.floor(points[0] * 2**k) * 2 ** (m - k) + np.floor(points[1] * 2 ** (m - k)) for k in range(m + 1)]
    return all(len(np.unique(cell)) == count for cell in cells)


def test_sobol_blocks_continue_one_sequence_over_passes():
    whole = np.concatenate(sampling.sobol_block(64, 0, (3, 4)))
    blocks = np.concatenate([np.concatenate(sampling.sobol_block(16, i, (3, 4))) for i in range(4)], axis=1)
    assert np.array_equal(whole, blocks)
    assert is_net(whole[:2])


@pytest.mark.parametrize("block", [0, 1, 77, (1 << 14) - 1])
def test_sobol_points_before_scrambling_are_those_of_scipy(block):
    count = 1 << 12
    sequence = qmc.Sobol(4, scramble=False)
    wanted = (sequence.fast_forward(block * count) if block else sequence).random(count)
    index = block * count + np.arange(count)
    index ^= index >> 1  # SciPy orders points by Gray code
    digits = sampling.sobol_digits(int(index.min()), count)[:, index - index.min()]
    found = sum(((digits >> bit) & 1) * 2.0 ** -(bit + 1) for bit in range(32))
    assert np.array_equal(found.T, wanted)


def test_sobol_points_of_powers_of_two_have_scipys_direction_numbers():
    """Points 2^k are SciPy's direction numbers; others are XORs of these, the last of which take SciPy ten seconds."""
    numbers = qmc.Sobol(4, scramble=False, bits=32)._sv
    for bit in range(32):
        reversed_digits = [int(f"{int(number):032b}"[::-1], 2) for number in numbers[:, bit]]
        assert sampling.sobol_digits(1 << bit, 1)[:, 0].tolist() == reversed_digits


def test_sobol_blocks_of_any_size_continue():
    whole = sampling.sobol_points(700, 0, (9,))
    assert np.array_equal(np.concatenate([sampling.sobol_points(100, i, (9,)) for i in range(7)]), whole)


@pytest.mark.parametrize("key", range(8))
def test_scrambled_sobol_points_are_stratified_in_each_dimension_and_in_all(key):
    points = sampling.sobol_points(4096, 3, (key,))
    assert points.min() >= 0
    assert points.max() < 1
    assert all(len(np.unique(np.floor(column * 4096))) == 4096 for column in points.T)
    # The integral over four dimensions errs far less than with random points, whose standard error is 0.139 / 64.
    assert abs(np.prod(np.sin(np.pi * points), axis=1).mean() - (2 / np.pi) ** 4) < 0.1 * 0.139 / 64


def test_sobol_blocks_differ_by_key():
    assert not np.array_equal(
        sampling.sobol_block(16, 0, (1,))[0].numpy(), sampling.sobol_block(16, 0, (2,))[0].numpy()
    )


@pytest.mark.parametrize("seed", [0, 1, 12345])
def test_samples_of_a_pixel_are_a_net_over_passes(seed):
    assert is_net(sampling.pixel_sample(dr.arange(UInt32, 64), UInt32(seed)).numpy())


def test_two_uses_of_a_pixel_do_not_march_in_step():
    index = dr.arange(UInt32, 4096)
    pairs = np.concatenate([sampling.pixel_sample(index, UInt32(seed)).numpy() for seed in range(4)])
    correlation = np.corrcoef(pairs) - np.eye(8)
    assert np.abs(correlation).max() < 5 / np.sqrt(4096)  # five standard errors of independent samples


def test_sphere_map_preserves_area(square):
    directions = warp.sphere(square).numpy()
    # Moments of the uniform sphere: 0, 1/3, 1/15 (x²y²). Stratified samples err far less than random points.
    assert np.allclose(directions.mean(axis=1), 0, atol=1 / np.sqrt(POINTS))
    assert np.allclose((directions**2).mean(axis=1), 1 / 3, atol=1 / np.sqrt(POINTS))
    assert np.isclose((directions[0] ** 2 * directions[1] ** 2).mean(), 1 / 15, atol=1 / np.sqrt(POINTS))
    assert np.allclose(np.linalg.norm(directions, axis=0), 1, atol=1e-6)


def test_sphere_map_keeps_neighbours_together(square):
    shifted = Array2f(dr.minimum(square.x + 1e-3, 1), square.y)
    step = np.linalg.norm((warp.sphere(shifted) - warp.sphere(square)).numpy(), axis=0)
    assert step.max() < 1e-3 * 8 * np.pi  # the map is continuous, with bounded slope


@pytest.mark.parametrize("power", [0.0, 1.0, 2.5, 40.0])
@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.2])
def test_power_cone_has_the_density_it_says(square, power, angle):
    axis = Array3f(0.36, -0.48, 0.8)
    q = -np.expm1((power + 1) * np.log(np.cos(angle)))
    directions, density = warp.power_cone(square, axis, Float(power), Float(q))
    chord = np.linalg.norm((directions - axis).numpy().astype(np.float64), axis=0)  # 2 sin(θ/2): keeps small angles
    theta = 2 * np.arcsin(chord / 2)
    assert theta.max() < angle * (1 + 1e-3) + 1e-7
    # Uniform in 1 - cos^(k+1), as the density's integral says; float32 rounds the axis and the directions to 1e-7.
    fraction = -np.expm1((power + 1) * np.log(np.cos(theta))) / q
    rounding = 2e-7 * (power + 1) * np.sin(angle) / q + 1e-6
    assert np.abs(np.sort(fraction) - (np.arange(POINTS) + 0.5) / POINTS).max() < 2 / np.sqrt(POINTS) + rounding
    expected = (power + 1) * np.cos(theta) ** power / (2 * np.pi * q)
    assert np.allclose(density.numpy(), expected, rtol=1e-5 * (power + 1), atol=1e-5 * expected.max())


def test_cone_of_half_a_degree_is_uniform_in_float32(square):
    half = np.radians(0.265)
    directions = warp.cone(square, Array3f(0, 0, 1), Float(2 * np.sin(half / 2) ** 2)).numpy()
    radius2 = (directions[0] ** 2 + directions[1] ** 2) / np.sin(half) ** 2
    assert np.allclose(np.quantile(radius2, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.01)


def test_z_order_numbers_pixels_square_by_square():
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(64), np.arange(64)))
    place = sampling.z_order(UInt32(x), UInt32(y)).numpy()
    assert np.array_equal(np.sort(place), np.arange(4096))
    for size in (2, 8, 32):  # each aligned square of pixels is an aligned block of places
        square = place // size**2
        assert all(len(set(square[(x // size == i) & (y // size == i)])) == 1 for i in range(64 // size))
    assert sampling.z_order(UInt32([65535, 0]), UInt32([65535, 1])).numpy().tolist() == [2**32 - 1, 2]
