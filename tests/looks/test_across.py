"""Profiles across the beam: they are normalised, and their line integrals are those that the billboard needs."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.looks.profiles import AcrossFunction, across
from photonbeams.runtime.device import Float
from tests.helpers.beam_twin import k1

EPSILON32 = float(np.finfo(np.float32).eps)
# A linear table of 1024 entries errs by 1/8 of the second derivative over 1023²; where the profiles below are smooth,
# this derivative is at most some 50.
TABLE = 50 / 8 / 1023**2


def smoothstep(t):
    t = np.clip(t, 0, 1)
    return 1 - t * t * (3 - 2 * t)


#: Profile, its shape in NumPy before normalisation, and the slope in ρ² of its corner, which the table cuts off.
PROFILES = {
    "uniform": (pb.looks.Uniform(), np.ones_like, 0),
    "epanechnikov": (pb.looks.Epanechnikov(), lambda r: 1 - r * r, 0),
    "biweight": (pb.looks.Biweight(), lambda r: (1 - r * r) ** 2, 0),
    "gaussian": (pb.looks.Gaussian(), lambda r: np.exp(-0.5 * (r / 0.35) ** 2) - np.exp(-0.5 / 0.35**2), 0),
    "narrow gaussian": (pb.looks.Gaussian(0.1), lambda r: np.exp(-50 * r * r) - np.exp(-50), 50),
    "wide gaussian": (pb.looks.Gaussian(5), lambda r: np.exp(-0.02 * r * r) - np.exp(-0.02), 0),
    "smoothstep": (pb.looks.Smoothstep(), smoothstep, 0),
    "hard smoothstep": (pb.looks.Smoothstep(0.8), lambda r: smoothstep((r - 0.8) / 0.2), 5),
    "tabulated": (
        pb.looks.Tabulated([1, 0.8, 0.4, 0]),
        lambda r: np.interp(r, [0, 1 / 3, 2 / 3, 1], [1, 0.8, 0.4, 0]),
        1,
    ),
    "hollow": (across([0, 0, 1, 0]), lambda r: np.interp(r, [0, 1 / 3, 2 / 3, 1], [0, 0, 1, 0]), 5),
    "shell": (
        pb.looks.Hollow(0.4, 0.5),
        lambda r: 1 - smoothstep(np.clip(np.minimum(r - 0.4, 1 - r) / 0.15, 0, 1)),
        5,
    ),
    "function": (across(lambda r: (1 - r * r) * (1 + r * r)), lambda r: 1 - r**4, 0),
}
X, W = np.polynomial.legendre.leggauss(40)
EDGES = np.linspace(0, 1, 301)  # thirds, fifths and tenths are edges
RHO = ((EDGES[1:] + EDGES[:-1])[:, None] / 2 + np.diff(EDGES)[:, None] / 2 * X).ravel()
WEIGHT = (np.diff(EDGES)[:, None] / 2 * W).ravel()


def normalised(shape):
    scale = 1 / np.sum(WEIGHT * shape(RHO) * 2 * np.pi * RHO)
    return lambda rho: scale * shape(rho)


def tolerance(profile, corner):
    """Return the error of table and float32: a corner between two entries is cut by 1/4 of its step in slope."""
    return (TABLE + corner / 4 / 1023 + 8 * EPSILON32) * profile(np.linspace(0, 1, 101)).max()


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_is_its_shape_with_the_sum_one(name):
    profile, shape, corner = PROFILES[name]
    exact = normalised(shape)
    rho = np.linspace(0, 1, 3001)
    found = np.asarray(Float(0) + profile.density(Float(rho**2)), dtype=float)
    # A profile with a slope in ρ at the axis has an infinite slope there in ρ², in which it is tabulated.
    kept = rho > (0.1 if name in ("smoothstep", "tabulated", "hollow") else 0)
    assert np.abs(found - exact(rho))[kept].max() <= tolerance(exact, corner)
    middle = (np.arange(200_000) + 0.5) / 200_000  # in ρ²; the area element is π d(ρ²)
    density = np.asarray(Float(0) + profile.density(Float(middle)), dtype=float)
    assert np.pi * density.mean() == pytest.approx(1, abs=max(1e-4, tolerance(exact, corner)))


@pytest.mark.parametrize("name", PROFILES)
def test_the_billboards_kernel_is_the_line_integral_of_the_disc_kernel(name):
    profile, shape, corner = PROFILES[name]
    exact = normalised(shape)
    u = np.linspace(0, 0.999, 500)
    line = np.asarray(Float(0) + profile.line(Float(u * u)), dtype=float)
    # A corner's projection is smoother than the corner: its table errs by no more than the profile's table.
    found = np.sqrt(1 - u * u) * line
    allowed = 2 * tolerance(exact, corner) + (2e-3 * exact(np.zeros(1)) if name in ("tabulated", "hollow") else 0)
    assert np.all(np.abs(found - k1(lambda rho: exact(rho)[..., None], u, pieces=600)[:, 0]) <= allowed)


@pytest.mark.parametrize("name", PROFILES)
def test_a_line_integral_over_all_lines_is_one(name):
    profile = PROFILES[name][0]
    # The substitution u = sin φ removes the square root.
    phi = (np.arange(20_000) + 0.5) / 20_000 * np.pi / 2
    line = np.asarray(Float(0) + profile.line(Float(np.sin(phi) ** 2)), dtype=float)
    assert 2 * np.mean(line * np.cos(phi) ** 2) * np.pi / 2 == pytest.approx(1, abs=1e-3)


def test_closed_forms_of_the_line_projection():
    u = np.linspace(0, 1, 200)
    x = Float(u * u)
    uniform = np.asarray(Float(0) + pb.looks.Uniform().line(x), dtype=float) * np.sqrt(1 - u * u)
    np.testing.assert_allclose(uniform, 2 / np.pi * np.sqrt(1 - u * u), rtol=4 * EPSILON32)
    epanechnikov = np.asarray(pb.looks.Epanechnikov().line(x), dtype=float) * np.sqrt(1 - u * u)
    np.testing.assert_allclose(epanechnikov, 8 / (3 * np.pi) * (1 - u * u) ** 1.5, atol=4 * EPSILON32)


def test_corners_are_told_to_the_quadrature():
    assert pb.looks.Epanechnikov().corners == () and pb.looks.Smoothstep().corners == ()
    assert pb.looks.Smoothstep(0.25).corners == (0.25,)
    assert pb.looks.Tabulated([1, 0.5, 0]).corners == (0.0, 0.5)
    assert pb.looks.Tabulated([1, 0.5, 0]).rings == (0.0,)  # a line has a corner at the axis alone


def test_a_profile_is_cut_only_where_six_points_would_err():
    assert pb.looks.Biweight().rings == pb.looks.Smoothstep().rings == pb.looks.Gaussian(0.35).rings == ()
    assert pb.looks.Tabulated(np.cos(np.linspace(0, np.pi / 2, 64))).rings == ()
    assert pb.looks.Hollow(0.9, 0.5).rings == pytest.approx((0.9, 0.925, 0.975))
    # Six points integrate a Gaussian from −3 to 3 deviations to 1.5e-3.
    (first, *_) = pb.looks.Gaussian(0.1).rings
    assert 0.25 < first < 0.3


def test_a_profile_ends_where_it_is_dark():
    assert (
        pb.looks.Gaussian(0.3).support
        == pb.looks.Epanechnikov().support
        == pb.looks.Tabulated([1, 0.1, 0]).support
        == 1
    )
    # exp(−ρ²/2w²) is a hundred-millionth at 6.07 w.
    assert pb.looks.Gaussian(0.05).support == pytest.approx(0.05 * 6.07, abs=1e-3)
    assert float(pb.looks.Gaussian(0.05).density(Float(0.4**2))[0]) == 0
    assert pb.looks.Tabulated([1, 1, 0, 0, 0]).support == pytest.approx(0.5, abs=1e-3)


def test_a_hard_smoothstep_is_nearly_uniform():
    assert float(pb.looks.Smoothstep(1.0).density(Float(0.5))[0]) == pytest.approx(1 / np.pi, rel=2e-3)


def test_values_and_functions_become_profiles():
    profile = pb.looks.Biweight()
    assert across(profile) is profile
    assert isinstance(across([1, 0]), pb.looks.Tabulated) and isinstance(across(lambda r: 1 - r), AcrossFunction)
    assert isinstance(pb.Look().across, pb.looks.Epanechnikov)
    # A function may return a number.
    assert float(across(lambda _: 3.0).density(Float(0.3))[0]) == pytest.approx(1 / np.pi, rel=1e-5)


@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("width is 0: expected 0.02 to 10 radii", lambda: pb.looks.Gaussian(0)),
        ("width is nan", lambda: pb.looks.Gaussian(float("nan"))),
        ("hardness is 1.5: expected a number from 0 to 1", lambda: pb.looks.Smoothstep(1.5)),
        ("hardness is nan", lambda: pb.looks.Smoothstep(float("nan"))),
        ("at least two finite values", lambda: pb.looks.Tabulated([1])),
        ("at least two finite values", lambda: pb.looks.Tabulated([[1, 0], [1, 0]])),
        ("at least two finite values", lambda: pb.looks.Tabulated([1, float("inf")])),
        ("negative value", lambda: pb.looks.Tabulated([1, -0.1])),
        ("positive sum", lambda: pb.looks.Tabulated([0, 0, 0]).density(Float(0.5))),
        ("finite values of at least 0", lambda: across(lambda r: r - 0.5)),
        ("finite values of at least 0", lambda: across(lambda r: 1 / r)),
    ],
)
def test_bad_profiles_are_told_in_a_sentence(message, make):
    with pytest.raises(ValueError, match=message):
        make()
