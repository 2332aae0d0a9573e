"""Procedural noise: its values against a NumPy twin, and the properties that artists see."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.looks import noise
from photonbeams.numerics import arrays
from photonbeams.runtime.device import Array2f, Array3f, Float
from tests.helpers.kernels import compiled
from tests.helpers.sweep import sweep
from tests.looks import noise_twin as twin

EPSILON32 = float(np.finfo(np.float32).eps)
DIMENSIONS = [1, 2, 3, 4]
COUNT = 100_000
#: A mean of independent numbers lies within five standard deviations, except for one seed in a million.
SIGMAS = 5


def double():
    return dr.float64_array_t(Float)


def arguments(points, kind=None):
    """Return points (n, N) as the functions' arguments: a float, a float and time, a vector, or a vector and time.

    Their memory is aligned, because Dr.Jit compiles other kernels for NumPy's, which sometimes is.
    """
    scalar = kind or double()
    number = np.float32 if scalar is Float else np.float64
    axes = [scalar(arrays._aligned(axis, number)) for axis in points]
    if len(axes) < 3:
        return axes
    vector = Array3f if scalar is Float else dr.float64_array_t(Array3f)
    return [vector(*axes[:3]), *axes[3:]]


def values(function, points, *more, **keywords):
    """Return a noise at points (n, N) in float64."""
    *p, time = (*arguments(points), None) if len(points) in (1, 3) else arguments(points)
    return np.asarray(function(*p, *more, time=time, **keywords), dtype=float)


def spread(rng, n, count=COUNT, reach=1e6):
    """Return points in cells so far apart that the noise at them is independent."""
    return rng.uniform(-reach, reach, (n, count))


@pytest.mark.parametrize("n", DIMENSIONS)
def test_noise_is_its_definition(rng, n):
    points = np.hstack([spread(rng, n, 500, 3), spread(rng, n, 500, 1e5)])
    # Coordinates of 1e5 have ulps of 1.5e-11, but their whole part is removed exactly: only rounding near 1 is left.
    np.testing.assert_allclose(values(noise.snoise, points), twin.snoise(points), atol=1e-13)
    np.testing.assert_allclose(values(noise.noise, points), twin.noise(points), atol=1e-13)
    np.testing.assert_allclose(values(noise.vnoise, points), twin.vnoise(points), atol=1e-13)
    np.testing.assert_array_equal(values(noise.cellnoise, points), twin.cellnoise(points))


@pytest.mark.parametrize("n", DIMENSIONS)
def test_peaks_are_bent_into_the_range(rng, n):
    points = spread(rng, n)
    peaks = points[:, np.argsort(-np.abs(values(noise.snoise, points)))[:50]]
    found = values(noise.snoise, peaks)
    assert np.abs(found).min() > 0.75
    np.testing.assert_allclose(found, twin.snoise(peaks), atol=1e-13)


@pytest.mark.parametrize("n", DIMENSIONS)
def test_noise_of_float32_is_that_of_float64(rng, n):
    points = spread(rng, n, 1000, 50).astype(np.float32)
    found = noise.snoise(*arguments(points, Float))
    assert type(found) is Float
    # The whole part is removed exactly; the fade, with coefficients up to 15, and n products have ten roundings each.
    np.testing.assert_allclose(np.asarray(found), twin.snoise(points), atol=40 * EPSILON32)


@pytest.mark.parametrize("n", sweep([1, 3, 4], [1, 4]))
def test_octaves_are_summed_as_defined(rng, n):
    points = spread(rng, n, 500, 10)
    lacunarity, gain = double()(2.3), double()(0.6)
    for function, expected in ((noise.fbm, twin.fbm), (noise.turbulence, twin.turbulence)):
        # The last of six octaves has coordinates of some 640, with their ulps, and slopes of some 3 · 2.3^5 · 0.6^5.
        np.testing.assert_allclose(values(function, points), expected(points), atol=1e-11)
        found = values(function, points, octaves=4, lacunarity=lacunarity, gain=gain)
        np.testing.assert_allclose(found, expected(points, 4, 2.3, 0.6), atol=1e-11)
    np.testing.assert_allclose(values(noise.fbm, points, 1), values(noise.noise, points), atol=1e-15)


@pytest.mark.parametrize("n", DIMENSIONS)
def test_noise_has_its_range_its_mean_and_the_same_deviation_in_all_dimensions(rng, n):
    points = spread(rng, n)
    signed, unsigned = values(noise.snoise, points), values(noise.noise, points)
    assert np.abs(signed).max() <= 1 and unsigned.min() >= 0 and unsigned.max() <= 1
    # The values are not all near the middle: some are beyond three standard deviations.
    assert signed.max() > 0.75 and signed.min() < -0.75
    error = SIGMAS / np.sqrt(COUNT)
    assert abs(signed.mean()) < error * 0.25 and abs(unsigned.mean() - 0.5) < error * 0.125
    # A deviation's relative error is half the variance's; 8-bit gradients add 0.4 %, the bend near ±1 takes off less.
    assert signed.std() == pytest.approx(0.25, rel=error + 0.01)


@pytest.mark.parametrize("n", DIMENSIONS)
def test_signed_noise_is_zero_at_whole_coordinates(rng, n):
    lattice = rng.integers(-1000, 1000, (n, 1000)).astype(float)
    assert np.all(values(noise.snoise, lattice) == 0)


@pytest.mark.parametrize("n", DIMENSIONS)
def test_noise_and_its_slope_are_continuous(rng, n):
    """Second differences are of order h²; a jump of the slope would give order h, a jump of the value order 1."""
    h = 1e-4
    # Half of the points lie on the boundary of a cell; at some of the others the noise is at the bend, ¾.
    points = spread(rng, n, 20_000, 1000)
    points[0, ::2] = np.round(points[0, ::2])
    steps = np.zeros((n, 1))
    steps[0] = h
    before, here, after = (values(noise.snoise, points + k * steps) for k in (-1, 0, 1))
    steepest = np.abs(after - before).max() / (2 * h)
    # The second derivative between planes a and b is at most 1.8 times fade'' (b − a) + 2 fade' (b' − a'), where
    # |a|, |b| ≤ n and |a'|, |b'| ≤ 1. The bend near ±1 adds twice the slope's square. The factor of 2 below is for
    # steeper slopes between the points.
    curvature = 1.8 * (5.8 * 2 * n + 2 * 1.9 * 2) + 2 * steepest**2
    assert np.abs(before - 2 * here + after).max() <= 2 * curvature * h**2
    assert np.abs(after - before).max() > h  # the noise is not constant


@pytest.mark.parametrize("n", DIMENSIONS)
@pytest.mark.parametrize("period", [256, 4096, 65536, 2**24])
def test_noise_has_no_period(rng, n, period):
    points = spread(rng, n, 20_000)
    here = values(noise.snoise, points)
    for axis in range(n):
        moved = points.copy()
        moved[axis] += period
        correlation = np.corrcoef(here, values(noise.snoise, moved))[0, 1]
        assert abs(correlation) < SIGMAS / np.sqrt(20_000)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_noise_varies_alike_along_all_axes_and_across_diagonals(rng, n):
    points, h = spread(rng, n), 1e-3
    variances = []
    for axis in range(n):
        step = np.zeros((n, 1))
        step[axis] = h
        slope = (values(noise.snoise, points + step) - values(noise.snoise, points - step)) / (2 * h)
        variances.append(slope.var())
    # A slope's fourth moment is below six squared variances, so a variance of N slopes errs by √(5 / N).
    error = SIGMAS * np.sqrt(5 / COUNT)
    np.testing.assert_allclose(variances, np.mean(variances), rtol=error)
    step = np.full((n, 1), h / np.sqrt(n))
    slope = (values(noise.snoise, points + step) - values(noise.snoise, points - step)) / (2 * h)
    # By symmetry slopes along different axes are uncorrelated, so that every direction has the mean of their variances.
    assert slope.var() == pytest.approx(np.mean(variances), rel=error)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0.6, 0, 0.8), (0.48, 0.6, 0.64)])
def test_noise_has_one_size_in_all_directions(rng, direction):
    """Along every line noise has half a cycle per cell, because the bump about a lattice point is two cells wide."""
    steps, cells = 16, 64
    line = np.arange(steps * cells) / steps
    points = spread(rng, 3, 200)[:, :, None] + np.array(direction)[:, None, None] * line
    lines = values(noise.snoise, points.reshape(3, -1)).reshape(200, -1) * np.hanning(len(line))
    power = (np.abs(np.fft.rfft(lines, axis=1)) ** 2).mean(axis=0)
    frequency = np.fft.rfftfreq(len(line), 1 / steps)
    assert power[frequency < 1].sum() > 0.98 * power.sum()
    # Lines through noise also have large structures: the median of their power lies below the bumps' frequency.
    middle = np.interp(0.5, np.cumsum(power) / power.sum(), frequency)
    assert 0.2 < middle < 0.5


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_noise_along_a_line_of_the_lattice_does_not_die(axis):
    """Noise does not vanish along a lattice line, as it would with Perlin's gradients toward the edges of a cube."""
    points = np.zeros((3, 64 * 16))
    points[axis] = np.arange(64 * 16) / 16
    cells = values(noise.snoise, points).reshape(64, 16)
    assert np.all(np.ptp(cells, axis=1) > 0.01)
    assert cells.std() > 0.15


def test_a_vectors_noises_are_independent_of_each_other_and_of_the_scalar(rng):
    points = spread(rng, 3)
    all_four = np.vstack([values(noise.vnoise, points), values(noise.snoise, points)])
    assert np.abs(np.corrcoef(all_four) - np.eye(4)).max() < SIGMAS / np.sqrt(COUNT)


@pytest.mark.parametrize("n", [2, 4])
def test_time_animates_without_jumps(rng, n):
    points = spread(rng, n, 10_000, 100)
    soon, late = points.copy(), points.copy()
    soon[-1] += 1e-3
    late[-1] += 2
    here = values(noise.snoise, points)
    # Slopes have a standard deviation of about 0.75, and none exceeds ten times that.
    assert 0 < np.abs(values(noise.snoise, soon) - here).max() < 1e-2
    assert abs(np.corrcoef(here, values(noise.snoise, late))[0, 1]) < SIGMAS / np.sqrt(10_000)


def test_octaves_do_not_vanish_together():
    lattice = np.stack(np.meshgrid(*[np.arange(8.0)] * 3)).reshape(3, -1)
    assert (values(noise.fbm, lattice) - 0.5).std() > 0.05


def test_fbm_rarely_leaves_its_range_and_turbulence_has_creases(rng):
    points = spread(rng, 3)
    brownian, creased = values(noise.fbm, points), values(noise.turbulence, points)
    assert brownian.mean() == pytest.approx(0.5, abs=SIGMAS * 0.15 / np.sqrt(COUNT))
    # Independent octaves of deviation 2^−k / 8 sum to one of 0.144: 0 and 1 lie beyond three deviations, so 0.3 %.
    assert np.mean((brownian < 0) | (brownian > 1)) < 3e-3
    assert creased.min() >= 0.5 and creased.mean() > 0.6


def test_cells_are_constant_and_evenly_spread(rng):
    lattice = rng.integers(-10_000, 10_000, (3, COUNT)).astype(float)
    found = values(noise.cellnoise, lattice + rng.uniform(0, 1, lattice.shape))
    np.testing.assert_array_equal(found, values(noise.cellnoise, lattice))
    assert found.min() >= 0 and found.max() < 1
    counts = np.histogram(found, 20, (0, 1))[0]
    # Chi squared of 19 degrees of freedom: 19 ± √38.
    assert np.sum((counts - COUNT / 20) ** 2) / (COUNT / 20) < 19 + SIGMAS * np.sqrt(38)
    # Neighbouring cells are uncorrelated.
    for axis in range(3):
        step = np.zeros((3, 1))
        step[axis] = 1
        beside = values(noise.cellnoise, lattice + step)
        assert abs(np.corrcoef(found, beside)[0, 1]) < SIGMAS / np.sqrt(COUNT)


def test_random_numbers_are_those_of_their_seeds_and_of_every_precision():
    numbers = np.arange(COUNT)
    single = np.asarray(noise.random(Float(numbers.astype(np.float32)), Float(3)), dtype=float)
    wide = np.asarray(noise.random(double()(numbers.astype(float)), double()(3)), dtype=float)
    np.testing.assert_array_equal(single, wide)
    np.testing.assert_array_equal(single, twin.random(numbers, np.full(COUNT, 3.0)))
    assert single.min() >= 0 and single.max() < 1
    assert single.mean() == pytest.approx(0.5, abs=SIGMAS * np.sqrt(1 / 12 / COUNT))
    other = np.asarray(noise.random(Float(numbers.astype(np.float32))), dtype=float)
    assert abs(np.corrcoef(single, other)[0, 1]) < SIGMAS / np.sqrt(COUNT)
    assert noise.random(Float(0))[0] == noise.random(Float(-0.0))[0]
    vectors = np.asarray(noise.random(Array3f([1, 1, 2], [2, 2, 1], [3, 4, 3])))
    assert len(set(vectors.tolist())) == 3


@pytest.mark.parametrize("size", [1e5, 2.0**24, 2.0**31, 3e9, 1e18, 1e30])
def test_large_coordinates_break_nothing(size):
    for kind in (Float, double()):
        for far in (size, -size):
            points = [[far, far], [0.3, far], [0.7, -far], [0.1, 1.9]]
            for n in DIMENSIONS:
                for function in (noise.snoise, noise.noise, noise.cellnoise):
                    found = np.asarray(function(*arguments(points[:n], kind)))
                    assert np.all(np.isfinite(found)) and np.abs(found).max() <= 1
            assert np.all(np.isfinite(np.asarray(noise.fbm(*arguments(points[:3], kind), octaves=8))))


def test_negative_cells_are_not_mirrored(rng):
    points = spread(rng, 3, 20_000, 100)
    mirrored = values(noise.snoise, -points)
    assert abs(np.corrcoef(values(noise.snoise, points), mirrored)[0, 1]) < SIGMAS / np.sqrt(20_000)


def test_a_vector_of_two_is_noise_of_the_plane(rng):
    x, y = (Float(axis) for axis in spread(rng, 2, 100, 10).astype(np.float32))
    np.testing.assert_array_equal(np.asarray(noise.noise(Array2f(x, y))), np.asarray(noise.noise(x, y)))


def test_values_compile_no_kernel():
    def evaluate(value):
        lacunarity, gain, time = (dr.opaque(Float, value + k) for k in (2, 0.5, 0))
        point = dr.opaque(Array3f, [value, 1, 2])
        dr.eval(noise.fbm(point, 3, lacunarity, gain, time), noise.vnoise(point, time), noise.random(point, gain))

    evaluate(0.0)
    assert not compiled(evaluate, 0.25)


@pytest.mark.parametrize("octaves", [0, 9, -1])
def test_bad_octaves_are_told_in_a_sentence(octaves):
    with pytest.raises(ValueError, match=f"octaves is {octaves}: expected 1 to 8"):
        noise.fbm(Float(0), octaves)
