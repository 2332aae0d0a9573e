"""Factors along the beam, toward the camera and by the view angle, against NumPy; products, numbers and functions."""

import drjit as dr
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

import photonbeams as pb
from photonbeams.looks.along import Texture
from photonbeams.looks.ramp import RESOLUTION, interpolate
from photonbeams.runtime.device import Array3f, Float

EPSILON32 = float(np.finfo(np.float32).eps)
MEDIUM = pb.Medium((0.3, 0.2, 0.1), (0.05, 0.1, 0.2), 0.4)
EXTINCTION = np.array(MEDIUM.extinction)

DISTANCE = np.linspace(0, 5, 257).astype(np.float32).astype(float)
DEPTH = np.maximum(DISTANCE - 1.5, 0)
FRACTION = DISTANCE / 5


def values(factor, **given):
    """Return a factor's values at DISTANCE, (N, 3)."""
    at = {"distance": DISTANCE, "depth": DEPTH, "fraction": FRACTION} | given
    found = factor.evaluate(
        pb.looks.ShadingContext(**{name: Float(x) for name, x in at.items()}, fog=pb.looks.Fog(MEDIUM))
    )
    return np.asarray(Array3f(0) + dr.zeros(Float, len(DISTANCE)) + found, dtype=float).T


def colour(x):
    """Return a grey (N,) as (N, 3)."""
    return np.repeat(np.asarray(x, dtype=float)[:, None], 3, axis=1)


def polynomial(x):
    return np.clip(1 - 2 * x + 0.5 * x**2, 0, None)


FACTORS = {
    "attenuation": (pb.looks.Attenuation(), np.exp(-EXTINCTION * DEPTH[:, None])),
    "exponential": (pb.looks.Exponential(0.7), colour(np.exp(-DISTANCE / 0.7))),
    "three exponentials": (pb.looks.Exponential([0.5, 1, 2]), np.exp(-DISTANCE[:, None] / [0.5, 1, 2])),
    "power": (pb.looks.Power(2, 0.5), colour((1 + DISTANCE / 0.5) ** -2)),
    "root": (pb.looks.Power(0.5), colour((1 + DISTANCE) ** -0.5)),
    "polynomial": (pb.looks.Polynomial([1, -2, 0.5]), colour(polynomial(FRACTION))),
    "polynomial of colours": (
        pb.looks.Polynomial([[1, 2, 3], [0, -1, -6]]),
        np.stack([0 * FRACTION + 1, 2 - FRACTION, np.maximum(3 - 6 * FRACTION, 0)], axis=1),
    ),
    "polynomial over a distance": (
        pb.looks.Polynomial([0, 1], begin=1, end=3, space="distance"),
        colour(np.clip((DISTANCE - 1) / 2, 0, 1)),
    ),
    "number": (pb.Look(along=0.25).along, colour(np.full_like(DISTANCE, 0.25))),
    "colour": (pb.Look(along=(1, 2, 3)).along, np.tile([1.0, 2.0, 3.0], (len(DISTANCE), 1))),
    "function": (pb.Look(along=lambda s: dr.exp(-s) * s).along, colour(np.exp(-DISTANCE) * DISTANCE)),
    "function of colours": (
        pb.Look(along=lambda s: Array3f(s, 2 * s, 1)).along,
        np.stack([DISTANCE, 2 * DISTANCE, np.ones_like(DISTANCE)], axis=1),
    ),
    "product": (
        pb.looks.Attenuation() * pb.looks.Power(2, 0.5) * 3 * pb.looks.Exponential(4),
        np.exp(-EXTINCTION * DEPTH[:, None]) * 3 * colour((1 + DISTANCE / 0.5) ** -2 * np.exp(-DISTANCE / 4)),
    ),
    "number times factor": (2 * pb.looks.Exponential(1), colour(2 * np.exp(-DISTANCE))),
    "colour times factor": ([1, 2, 3] * pb.looks.Exponential(1), np.exp(-DISTANCE)[:, None] * [1, 2, 3]),
}


@pytest.mark.parametrize("name", FACTORS)
def test_a_factor_is_its_formula(name):
    factor, expected = FACTORS[name]
    # Exponents reach 10, and exp() multiplies their rounding; the device's exp and log are accurate to some 1e-6.
    np.testing.assert_allclose(values(factor), expected, rtol=10 * EPSILON32 + 3e-6, atol=1e-6)


# -- Ramps and textures -----------------------------------------------------------------------------------------------

KNOTS = np.array([0.1, 0.3, 0.55, 0.9])
COLOURS = np.array([[1.0, 0.0, 0.2], [0.2, 1.0, 0.3], [0.3, 0.5, 1.0], [0.0, 0.1, 0.6]])


def by_hand(interpolation, x):
    """Return the ramp from its definition."""
    x = np.clip(x, KNOTS[0], KNOTS[-1])
    if interpolation == "monotone":
        return PchipInterpolator(KNOTS, COLOURS)(x)
    if interpolation == "catmull-rom":
        slopes = [(COLOURS[1] - COLOURS[0]) / (KNOTS[1] - KNOTS[0])]
        for i in (1, 2):  # the parabola through a knot and its two neighbours
            before, after = KNOTS[i] - KNOTS[i - 1], KNOTS[i + 1] - KNOTS[i]
            low, high = (COLOURS[i] - COLOURS[i - 1]) / before, (COLOURS[i + 1] - COLOURS[i]) / after
            slopes.append((low * after + high * before) / (before + after))
        slopes.append((COLOURS[3] - COLOURS[2]) / (KNOTS[3] - KNOTS[2]))
        return np.maximum(CubicHermiteSpline(KNOTS, COLOURS, slopes)(x), 0)
    result = []
    for place in x:
        i = max(k for k in range(4) if KNOTS[k] <= place)
        if i == 3 or interpolation == "none":
            result.append(COLOURS[i])
            continue
        t = (place - KNOTS[i]) / (KNOTS[i + 1] - KNOTS[i])
        t = 3 * t**2 - 2 * t**3 if interpolation == "smooth" else t
        result.append((1 - t) * COLOURS[i] + t * COLOURS[i + 1])
    return np.array(result)


@pytest.mark.parametrize("interpolation", ["none", "linear", "smooth", "catmull-rom", "monotone"])
@pytest.mark.parametrize("space", ["fraction", "distance"])
def test_a_ramp_interpolates_its_knots(interpolation, space):
    begin, end = (0.0, 1.0) if space == "fraction" else (1.0, 4.0)
    place = FRACTION if space == "fraction" else (DISTANCE - 1) / 3
    ramp = pb.looks.ColorRamp(KNOTS, COLOURS, interpolation, begin, end, space)
    expected, found = by_hand(interpolation, place), values(ramp)
    step = (KNOTS[-1] - KNOTS[0]) / (RESOLUTION - 1)
    smooth = np.abs(place[:, None] - KNOTS).min(axis=1) > step
    # Between table entries a smooth piece errs by an eighth of its second derivative (at most 60) times step²; a corner
    # of slope up to 10 is cut by a quarter of the slope times the step; a jump becomes a line one step long.
    corner = np.inf if interpolation == "none" else 10 * step / 4
    assert np.abs(found - expected)[smooth].max() <= 60 * step**2 / 8 + 1e-5
    assert np.abs(found - expected).max() <= corner + 1e-5


@pytest.mark.parametrize("interpolation", ["none", "linear", "smooth", "catmull-rom", "monotone"])
def test_a_ramp_has_its_knots_colours_at_its_knots(interpolation):
    np.testing.assert_allclose(interpolate(KNOTS, COLOURS, interpolation, KNOTS), COLOURS, atol=1e-14)
    one = pb.looks.ColorRamp([0.5], [[1, 2, 3]], interpolation)
    np.testing.assert_allclose(values(one), np.tile([1.0, 2.0, 3.0], (len(DISTANCE), 1)))


def test_catmull_rom_gives_no_negative_light_and_monotone_does_not_overshoot():
    knots, bumpy = [0, 0.3, 0.4, 1], [[0] * 3, [0] * 3, [1] * 3, [1] * 3]
    assert values(pb.looks.ColorRamp(knots, bumpy, "catmull-rom")).min() >= 0
    found = values(pb.looks.ColorRamp(knots, bumpy, "monotone"))
    assert found.min() >= 0 and found.max() <= 1


def test_steps_lie_where_their_knots_are():
    ramp = pb.looks.ColorRamp(KNOTS, COLOURS, "none")
    beside = KNOTS[:, None] + [-1e-6, 1e-6]
    found = np.array(ramp.evaluate(pb.looks.ShadingContext(fraction=Float(beside.ravel().tolist()))))
    expected = np.stack([COLOURS[[0, 0, 1, 2]], COLOURS], axis=1).reshape(-1, 3)
    np.testing.assert_allclose(found.T, expected, rtol=1e-6)


def test_corners_of_ramps_and_polynomials_are_told_to_the_quadrature():
    def named(space, places):
        return [(space, pytest.approx(place)) for place in places]

    for kind in ("none", "linear", "smooth", "catmull-rom", "monotone"):
        assert list(pb.looks.ColorRamp(KNOTS, COLOURS, kind).corners) == named("fraction", KNOTS)
    assert list(pb.looks.Fade(1, 3).corners) == named("distance", (1, 3))
    assert list(pb.looks.Texture(COLOURS).corners) == named("fraction", np.linspace(0, 1, len(COLOURS)))
    ramp = pb.looks.ColorRamp(KNOTS, COLOURS, "linear", 1, 3, "distance")
    assert list(ramp.corners) == named("distance", 1 + 2 * KNOTS)
    assert list(pb.looks.Polynomial([1, 2], 0.25, 0.5).corners) == named("fraction", (0.25, 0.5))
    assert pb.looks.ColorRamp(KNOTS, COLOURS, space="angle").corners == ()
    for made in (
        pb.looks.Product,
        pb.looks.Sum,
        lambda pair: pair[0].mix(*pair),
        lambda pair: pb.looks.Sum(pair).clamp(),
    ):
        both = made((pb.looks.ColorRamp(KNOTS, COLOURS), pb.looks.Polynomial([1, 2], 1, 2, "distance")))
        for corner in [*named("fraction", KNOTS), *named("distance", (1, 2))]:
            assert corner in both.corners
    look = pb.Look(along=1.0, eye=ramp, across=pb.looks.ColorRamp(KNOTS, COLOURS, space="radius"), angle=1.0)
    assert list(look.bind(None, 4.0).corners) == [*named("eye", 1 + 2 * KNOTS), *named("radius", KNOTS)]


def test_a_texture_is_linear_between_its_columns():
    pixels = np.random.default_rng(1).uniform(size=(9, 3))
    expected = np.stack([np.interp(FRACTION, np.linspace(0, 1, 9), channel) for channel in pixels.T], axis=1)
    np.testing.assert_allclose(values(Texture(pixels)), expected, atol=3e-6)
    late = np.stack([np.interp((DISTANCE - 1) / 2, np.linspace(0, 1, 9), channel) for channel in pixels.T], axis=1)
    np.testing.assert_allclose(values(Texture(pixels, 1, 3, "distance")), late, atol=3e-6)


def test_an_images_rows_are_averaged_and_grey_serves_all_channels():
    image = np.random.default_rng(2).uniform(size=(4, 16, 3))
    np.testing.assert_allclose(values(Texture(image)), values(Texture(image.mean(axis=0))), atol=1e-6)
    grey = np.linspace(0, 1, 5)[:, None]
    np.testing.assert_allclose(values(Texture(grey)), colour(FRACTION), atol=3e-6)
    np.testing.assert_allclose(values(Texture([[1, 2, 3]])), np.tile([1.0, 2, 3], (len(DISTANCE), 1)))


# -- The view angle ---------------------------------------------------------------------------------------------------

COSINE = np.linspace(-1, 1, len(DISTANCE)).astype(np.float32).astype(float)


def henyey_greenstein(g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * COSINE) ** 1.5)


def test_view_angle_factors_are_their_formulas():
    scattering = np.array(MEDIUM.scattering)
    cases = {
        pb.looks.Scattering(): scattering * henyey_greenstein(0.4)[:, None],
        pb.looks.Isotropic(): scattering * colour(np.full_like(COSINE, 1 / (4 * np.pi))),
        pb.looks.Glow(0.8, 0.25, 3): scattering * (0.75 / (4 * np.pi) + 0.25 * 3 * henyey_greenstein(0.8))[:, None],
        pb.Look(angle=lambda c: 1 + c).angle: colour(1 + COSINE),
        pb.Look(angle=0.5).angle: colour(np.full_like(COSINE, 0.5)),
    }
    for factor, expected in cases.items():
        # At g = 0.8 cancellation in 1 + g² − 2 g cos multiplies the rounding by 40, before the power of 1.5.
        np.testing.assert_allclose(values(factor, cosine=COSINE), expected, rtol=100 * EPSILON32)


@pytest.mark.parametrize("g", [-0.9, -0.3, 0.0, 0.5, 0.95])
def test_the_phase_function_is_normalised(g):
    x, w = np.polynomial.legendre.leggauss(400)
    from photonbeams.looks.angle import henyey_greenstein as phase

    total = 2 * np.pi * np.sum(w * np.asarray(phase(Float(x), Float(g)), dtype=float))
    assert total == pytest.approx(1, abs=1e-4)  # float32 rounds numbers near 2, whose difference is (1 − |g|)² = 0.0025


# -- Looks ------------------------------------------------------------------------------------------------------------


def test_a_look_is_physical_unless_told():
    look = pb.Look().bind(MEDIUM, 5.0)
    s, t = Float(DISTANCE), Float(DISTANCE[::-1].copy())
    at = look.at(distance=s, from_light=s, depth=Float(DEPTH), fraction=Float(FRACTION), to_camera=t)
    path = np.asarray(look.light(at, t), dtype=float).T
    expected = np.exp(-EXTINCTION * (DEPTH + DISTANCE[::-1])[:, None])
    np.testing.assert_allclose(path, expected, rtol=1e-5)
    angle = np.asarray(look.angle(Float(COSINE)), dtype=float).T
    np.testing.assert_allclose(angle, np.array(MEDIUM.scattering) * henyey_greenstein(0.4)[:, None], rtol=1e-5)


def test_the_path_is_along_times_eye():
    for along in (
        2.0,
        pb.looks.Exponential([1, 2, 3]),
        pb.looks.ColorRamp(KNOTS, COLOURS) * pb.looks.Attenuation(),
        lambda s: 1 / (1 + s),
    ):
        for eye in (0.5, pb.looks.Attenuation(), pb.looks.Power(1) * pb.looks.Exponential(2)):
            look = pb.Look(along=along, eye=eye).bind(MEDIUM, 5.0)
            s, d, f, t = Float(DISTANCE), Float(DEPTH), Float(FRACTION), Float(DISTANCE / 2)
            product = look.along(s, d, f) * look.eye(t, t)
            at = look.at(distance=s, from_light=s, depth=d, fraction=f, to_camera=t)
            np.testing.assert_allclose(np.asarray(look.light(at, t)), np.asarray(product), rtol=1e-5, atol=1e-7)


def test_rates_tell_how_fast_the_factors_change():
    look = pb.Look(along=pb.looks.Exponential(0.5), eye=pb.looks.Power(2, 0.25), angle=1.0).bind(None, 4.0)
    # Differences over 1/511 of the reach err, at the steep beginning, by that step over the falloff's length.
    assert look.rate_along[0] == pytest.approx(2, rel=0.02)
    assert look.rate_fraction[0] == 0
    assert look.rate_eye[0] == pytest.approx(8, rel=0.1)
    ramp = pb.Look(along=pb.looks.ColorRamp([0, 0.25, 1], [[1] * 3, [0] * 3, [0] * 3]), eye=1.0, angle=1.0).bind(
        None, 4.0
    )
    assert ramp.rate_fraction[0] == pytest.approx(4, rel=0.02)
    assert ramp.rate_along[0] == 0 and ramp.rate_eye[0] == 0


@pytest.mark.parametrize("make", [pb.looks.Attenuation, pb.looks.Scattering, pb.looks.Isotropic, pb.looks.Glow])
def test_a_physical_factor_without_a_medium_says_so(make):
    with pytest.raises(ValueError, match="physical factor: give estimate\\(\\) a medium"):
        make().evaluate(pb.looks.ShadingContext(depth=Float(1), cosine=Float(0)))


NAN = float("nan")


@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("exponential falloff's length is 0: expected a positive number", lambda: pb.looks.Exponential(0)),
        ("length is", lambda: pb.looks.Exponential([1, -1, 1])),
        ("length is nan", lambda: pb.looks.Exponential(NAN)),
        ("power falloff's length is -1", lambda: pb.looks.Power(2, -1)),
        ("exponent", lambda: pb.looks.Power(NAN)),
        ("finite coefficients", lambda: pb.looks.Polynomial([])),
        ("finite coefficients", lambda: pb.looks.Polynomial([1, NAN])),
        ("from 1 to 0: expected an end beyond its begin", lambda: pb.looks.Polynomial([1], 1, 0)),
        (
            "space is 'time': expected one of fraction, distance, radius, angle",
            lambda: pb.looks.Polynomial([1], space="time"),
        ),
        ("interpolation is 'cubic': expected one of none, linear", lambda: pb.looks.ColorRamp(KNOTS, COLOURS, "cubic")),
        ("expected \\(M,\\) and \\(M, 3\\)", lambda: pb.looks.ColorRamp(KNOTS, COLOURS[:3])),
        ("expected \\(M,\\) and \\(M, 3\\)", lambda: pb.looks.ColorRamp([], np.zeros((0, 3)))),
        ("not finite", lambda: pb.looks.ColorRamp([0, NAN], COLOURS[:2])),
        ("expected positions that ascend", lambda: pb.looks.ColorRamp([0, 0.5, 0.5], COLOURS[:3])),
        ("texture along the beam has shape \\(4, 2\\)", lambda: Texture(np.zeros((4, 2)))),
        ("texture", lambda: Texture(np.full((4, 3), NAN))),
        ("constant factor is nan", lambda: pb.Look(along=NAN)),
        ("constant factor is \\[1, 2\\]", lambda: pb.Look(eye=[1, 2])),
        ("anisotropy is 1: expected a number from -0.99 to 0.99", lambda: pb.looks.Glow(1)),
        ("mix is 2: expected a number from 0 to 1", lambda: pb.looks.Glow(mix=2)),
        ("gain is -1: expected a number that is not negative", lambda: pb.looks.Glow(gain=-1)),
        ("gain is nan", lambda: pb.looks.Glow(gain=NAN)),
    ],
)
def test_bad_factors_are_told_in_a_sentence(message, make):
    with pytest.raises(ValueError, match=message):
        make()
