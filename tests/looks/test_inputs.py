"""The inputs of factors: positions, times and beams; and functions and expressions that are wrong."""

import functools
import sys

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.looks.context import INPUTS
from photonbeams.numerics.hashing import hash32
from photonbeams.runtime.device import Array3f, Float, UInt32
from photonbeams.scene import SceneError

MEDIUM = pb.Medium((0.2, 0.1, 0.1))
PLAIN = {"along": 1.0, "eye": 1.0, "angle": 1.0}
#: Three thin beams along z, side by side.
BEAMS = {
    "start": [[-1, 0, 0], [0, 0, 0], [1, 0, 0]], "end": [[-1, 0, 2], [0, 0, 2], [1, 0, 2]],
    "radius_start": 1e-3, "radius_end": 1e-3, "power": [[1, 1, 1]],
}  # fmt: skip
#: A ray across each beam, from y = −4: at a quarter of the first beam, at half of the second, …
ORIGIN = np.array([[-1, -4, 0.5], [0, -4, 1.0], [1, -4, 1.5]])
DIRECTION = (0, 1, 0)


def seen(look, context=None, estimator="auto", **fields):
    """Return the radiance along the rays relative to that of a plain look, (3 rays, 3 channels)."""
    beams = pb.Beams(**{**BEAMS, **fields})
    found = pb.estimate(beams, ORIGIN, DIRECTION, look=look, medium=MEDIUM, context=context, estimator=estimator)
    return np.asarray(found, dtype=float) / plain(estimator)


@functools.cache
def plain(estimator):
    look = pb.Look(**PLAIN)
    found = pb.estimate(pb.Beams(**BEAMS), ORIGIN, DIRECTION, look=look, medium=MEDIUM, estimator=estimator)
    return np.asarray(found, dtype=float)


TO_WORLD = np.array([[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]])  # turned, then moved
#: Each input's value on the three rays.
VALUES = {
    "s": [0.25, 0.5, 0.75],
    "distance": [0.5, 1.0, 1.5],
    "r": None,
    "t": [4, 4, 4],
    "angle": [90, 90, 90],
    "cosine": [0, 0, 0],
    "P": [[-1, 0, 0.5], [0, 0, 1.0], [1, 0, 1.5]],
    "Pl": (np.array([[-1, 0, 0.5], [0, 0, 1.0], [1, 0, 1.5]]) - [1, 2, 3]) @ TO_WORLD[:3, :3],
    "time": [2.5] * 3,
    "frame": [60] * 3,
    "random": [0.125, 0.5, 0.875],
    "id": [7, 8, 9],
    "light": [3] * 3,
    "generation": [0, 1, 2],
}
FIELDS = {"random": [0.125, 0.5, 0.875], "id": [7, 8, 9], "generation": [0, 1, 2]}


@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
@pytest.mark.parametrize("name", [name for name in INPUTS if VALUES[name] is not None])
def test_an_input_is_what_its_name_says(name, estimator):
    context = pb.looks.LightContext(frame=60, time=2.5, light=3, to_world=TO_WORLD)
    expected = np.asarray(VALUES[name], dtype=float)
    expected = np.repeat(expected[:, None], 3, axis=1) if expected.ndim == 1 else expected
    # Every slot of the look uses the input, with an offset of its own so that no value is negative; a beam's light is
    # their product.
    offsets = 200.0 * (name == "angle") + np.array([10.0, 11.0, 13.0, 16.0])
    along, eye, angle, across = offsets
    look = pb.Look(
        along=pb.looks.Function(_named(name, along)),
        eye=f"{name} + {eye}",
        angle=f"{name} + {angle}",
        across=pb.looks.Epanechnikov() * pb.looks.Expression(f"{name} + {across}"),
    )
    found = seen(look, context, estimator, **FIELDS)
    product = np.prod([expected + each for each in offsets], axis=0)
    # Beams are a thousandth wide, so each input changes by a thousandth across them, and the product by the sum of what
    # its factors change; float32 rounds 216 to 2e-5.
    change = sum(product / (expected + each) for each in offsets)
    assert np.all(np.abs(found - product) <= 2e-3 * change)


def _named(name, offset):
    """Return a function of two parameters, one of which has this name."""
    namespace = {}
    exec(f"def look({name}, {'s' if name != 's' else 't'}): return {name} + {offset}", namespace)
    return namespace["look"]


@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
def test_the_radius_is_that_of_the_place_on_the_ray(estimator):
    """The mean of ρ² over a chord through the axis of a uniform cylinder is 1/3."""
    look = pb.Look(**PLAIN, across=pb.looks.Uniform() * pb.looks.Expression("r * r"))
    plain = pb.Look(**PLAIN, across=pb.looks.Uniform())
    values = [
        np.asarray(pb.estimate(pb.Beams(**BEAMS), ORIGIN, DIRECTION, look=each, estimator=estimator), dtype=float)
        for each in (look, plain)
    ]
    np.testing.assert_allclose(values[0] / values[1], 1 / 3, rtol=1e-3)


def test_beams_without_names_have_a_random_number_each_and_their_place_as_number():
    count = 4000
    beams = pb.Beams(np.zeros((count, 3)), np.ones((count, 3)), 0.1, 0.1, (1, 1, 1))
    random, number, generation = np.asarray(beams.identity(), dtype=float)
    assert np.array_equal(number, np.arange(count)) and not generation.any()
    assert random.min() >= 0 and random.max() < 1
    assert len(np.unique(random)) > 0.99 * count
    # Uniform: mean and variance within four standard deviations.
    assert random.mean() == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / count))
    assert np.corrcoef(random[:-1], random[1:])[0, 1] == pytest.approx(0, abs=4 / np.sqrt(count))


def test_what_a_look_does_not_ask_for_is_not_packed():
    plain = pb.Look().bind(MEDIUM, 2.0)
    assert not (plain.of_beams or plain.by_radius or plain.of_places)
    assert pb.Look(along="random").bind(MEDIUM, 2.0).of_beams
    assert pb.Look(across=lambda r, s: r * s).bind(MEDIUM, 2.0).by_radius
    assert pb.Look(eye=pb.looks.Noise()).bind(MEDIUM, 2.0).of_places


def test_noise_is_one_in_the_mean_and_goes_with_the_light():
    rng = np.random.default_rng(3)
    points = rng.uniform(-50, 50, (20_000, 3))

    def values(noise, context=None):
        at = pb.looks.ShadingContext(place=lambda: Array3f(points.T), context=context)
        return np.asarray(noise.evaluate(at), dtype=float)

    found = values(pb.looks.Noise(1, scale=2, contrast=1))
    # 20,000 points in a space of 50³ noise cells are nearly independent; contrast 1 clips nothing.
    assert found.mean() == pytest.approx(1, abs=5 * found.std() / np.sqrt(len(found)))
    assert found.std() > 0.15 and found.min() >= 0
    np.testing.assert_allclose(values(pb.looks.Noise(0.0)), 1)
    moved = pb.looks.LightContext(to_world=[[1, 0, 0, 3], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    with_light = values(pb.looks.Noise(space="light"), moved)
    points = points - [3, 0, 0]
    np.testing.assert_allclose(with_light, values(pb.looks.Noise(), moved), atol=1e-4)


def test_noise_drifts_by_its_speed():
    points = np.random.default_rng(4).uniform(-5, 5, (500, 3))

    def values(points, time):
        at = pb.looks.ShadingContext(place=lambda: Array3f(points.T), context=pb.looks.LightContext(time=time))
        return np.asarray(pb.looks.Noise(drift=(1, 0, -2), scale=0.5).evaluate(at), dtype=float)

    np.testing.assert_allclose(values(points + np.array([3, 0, -6]), 3.0), values(points, 0.0), atol=1e-3)
    assert np.abs(values(points, 3.0) - values(points, 0.0)).mean() > 0.1


def test_variation_scales_each_beam_by_its_random_number():
    found = seen(pb.Look(**{**PLAIN, "along": pb.looks.Variation(0.5)}), **FIELDS)
    np.testing.assert_allclose(found[:, 0], [0.625, 1.0, 1.375], rtol=1e-4)


def test_factors_compose():
    ramp = pb.looks.ColorRamp([0, 1], [[0, 0, 0], [1, 1, 1]])
    cases = {
        "sum": (ramp + 0.5, [0.75, 1, 1.25]),
        "number plus factor": (0.5 + ramp, [0.75, 1, 1.25]),
        "mixture": (ramp.mix(2.0, 0.5), [1.125, 1.25, 1.375]),
        "mixture by a factor": (pb.looks.Constant(4.0).mix(0.0, ramp), [3, 2, 1]),
        "clamp": (ramp.clamp(0.3, 0.6), [0.3, 0.5, 0.6]),
        "expression": ("smoothstep(0, 1, s)", [0.15625, 0.5, 0.84375]),
        "product": (ramp * "2 * s", [0.125, 0.5, 1.125]),
    }
    for what, (factor, expected) in cases.items():
        found = seen(pb.Look(**{**PLAIN, "along": factor}))
        np.testing.assert_allclose(found[:, 0], expected, atol=2e-3, err_msg=what)


def test_an_expression_of_the_radius_alone_is_a_normalised_profile():
    look = pb.Look(across="7 * (1 - r * r)")
    assert look.modulation is None
    x = np.linspace(0, 1, 50)
    np.testing.assert_allclose(look.across.density(Float(x)), pb.looks.Epanechnikov().density(Float(x)), atol=1e-4)
    assert pb.Look(across="1 - r * s").modulation is not None
    assert pb.Look(across="[1, r, 0]").modulation is not None


def compiled():
    return [each for each in dr.kernel_history() if each["type"].name == "JIT" and not each["cache_hit"]]


def test_other_numbers_in_a_look_compile_nothing():
    def render(number):
        factors = {
            "along": pb.looks.Expression(f"smoothstep(0, {number}, s) * noise({number} * P + time)")
            * pb.looks.Variation(number),
            "across": pb.looks.Smoothstep(number) * pb.looks.Noise(scale=number, drift=(number, 0, 0)),
            "eye": pb.looks.Fade(number, 10, "linear"),
            "angle": pb.looks.ColorRamp([0, number], [[1, 1, 1], [number] * 3], space="angle"),
        }
        return seen(pb.Look(**factors), pb.looks.LightContext(number, number, 2, TO_WORLD + 0 * number))

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        render(0.5)
        dr.kernel_history_clear()
        first = render(0.25)
        assert not compiled()
    assert np.any(first != render(0.5))


def test_another_width_or_number_of_knots_compiles_nothing():
    """Chords end where a profile is dark, at a ρ that is an input of kernels, as corners are."""

    def render(width, count):
        ramp = pb.looks.ColorRamp(
            np.linspace(0, 1, count), np.linspace([1, 1, 1], [0.5, 0.2, 1], count), space="radius"
        )
        return seen(pb.Look(**{**PLAIN, "across": pb.looks.Gaussian(width) * ramp}))

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        render(0.1, 3)
        dr.kernel_history_clear()
        render(0.05, 9)
        assert not compiled()


def test_light_is_neither_negative_nor_endless():
    def spiked(distance, s):  # which the check does not sample
        return dr.select(dr.abs(distance - 1.0) < 1e-3, Float(dr.inf), 0.5)

    for factor, expected in (
        (lambda distance: dr.sin(5 * distance), np.maximum(np.sin([2.5, 5.0, 7.5]), 0)),
        (pb.looks.Constant(1.0) + -2.0, [0, 0, 0]),
        (pb.looks.Constant([-1, -1, -1]), [0, 0, 0]),
        (pb.looks.Function(spiked), [0.5, 0, 0.5]),
    ):
        np.testing.assert_allclose(seen(pb.Look(**{**PLAIN, "along": factor}))[:, 0], expected, atol=5e-3)
    assert not seen(pb.Look(**{**PLAIN, "angle": lambda cosine: -1 - cosine})).any()


def test_factors_that_leave_single_precision_are_an_error():
    with pytest.raises(SceneError, match=r"factors reach more than 1e\+18 together: expected smaller numbers"):
        seen(pb.Look(along=1e15, eye=1e15, angle=1.0))


def test_a_function_of_double_precision_is_rounded():
    double = dr.float64_array_t(Float)
    found = seen(pb.Look(**{**PLAIN, "along": lambda s: double(s) * 0.5}))
    np.testing.assert_allclose(found[:, 0], [0.25, 0.5, 0.75], atol=2e-3)


def test_an_exit_in_a_function_is_told_in_a_sentence():
    with pytest.raises(SceneError, match="the look's function <lambda> failed: 3"):
        seen(pb.Look(along=lambda s: sys.exit(3)))


@pytest.mark.parametrize("text", ["r > 0.95", "pulse(10 * r, 0.2)", "exp(-((r - 0.9) / 0.01) ** 2)"])
def test_steps_by_radius_are_projected_as_they_are_integrated(text):
    """A step by radius is accurate to 1/400 of the radius, with six points on each of 64 pieces."""
    look = pb.Look(**PLAIN, across=pb.looks.Uniform() * pb.looks.Expression(text))
    beams = pb.Beams([[0, 0, 0]], [[0, 0, 2]], 0.1, 0.1, [[1, 1, 1]])
    x = np.linspace(-0.095, 0.095, 200)
    origin = np.stack([x, np.full(200, -4.0), np.ones(200)], axis=1)
    found, exact = (
        np.asarray(pb.estimate(beams, origin, (0, 1, 0), look=look, estimator=each, rule=rule), dtype=float)[:, 0]
        for each, rule in (("auto", pb.gauss_legendre(6)), ("frustum", pb.riemann(256)))
    )
    assert found.mean() == pytest.approx(exact.mean(), rel=0.01)


def test_corners_by_radius_are_known_in_every_slot():
    ramp = pb.looks.ColorRamp([0, 0.3, 1], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], space="radius")
    for slot in ("along", "eye", "angle", "across"):
        assert ("radius", pytest.approx(0.3)) in pb.Look(**{**PLAIN, slot: ramp}).bind(MEDIUM, 2.0).corners


def test_a_function_that_goes_wrong_is_told_in_a_sentence():
    def fails(s):
        raise KeyError("nothing")

    for look, message in (
        (pb.Look(along=fails), "the look's function fails failed: 'nothing'"),
        (pb.Look(along=lambda s: "red"), "returns a str: expected a Float, an Array3f or a number"),
        (pb.Look(along=lambda s: None), "returns a NoneType"),
        (pb.Look(along=lambda s: dr.log(s)), "factor along is not finite everywhere"),
        (pb.Look(eye=lambda t: 0 / t), "factor eye is not finite everywhere"),
        (pb.Look(across=lambda r, s: Array3f(r, s, dr.nan)), "factor across is not finite everywhere"),
        (pb.Look(angle=lambda cosine: dr.sqrt(cosine)), "factor angle is not finite everywhere"),
        (pb.Look(along=lambda s: Float([1, 2])), "returns 2 values for"),
    ):
        with pytest.raises(SceneError, match=message):
            seen(look)
    with pytest.raises(ValueError, match="has a parameter 'speed': expected one of s, distance, r"):
        pb.Look(along=lambda s, speed: s)
    with pytest.raises(ValueError, match='expression "1 - x", column 5'):
        pb.Look(along="1 - x")
    with pytest.raises(ValueError, match=r"clamped to 1 to 0: expected low to be at most high"):
        pb.looks.Constant(1).clamp(1, 0)


@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("amount is 2: expected a number from 0 to 1", lambda: pb.looks.Noise(2)),
        ("contrast is -1", lambda: pb.looks.Noise(contrast=-1)),
        ("scale is 0: expected a positive size", lambda: pb.looks.Noise(scale=0)),
        ("octaves is 9: expected a whole number from 1 to 8", lambda: pb.looks.Noise(octaves=9)),
        ("drift is \\(1, 2\\): expected three finite numbers", lambda: pb.looks.Noise(drift=(1, 2))),
        ("evolution is nan", lambda: pb.looks.Noise(evolution=float("nan"))),
        ("space is 'object': expected one of world, light", lambda: pb.looks.Noise(space="object")),
        ("variation is -1", lambda: pb.looks.Variation(-1)),
        ("inner radius is 1: expected a number from 0 to 0.99", lambda: pb.looks.Hollow(1)),
        ("softness is 0", lambda: pb.looks.Hollow(0.5, 0)),
        ("from 2 to 1", lambda: pb.looks.Fade(2, 1)),
    ],
)
def test_bad_parameters_are_told_in_a_sentence(message, make):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_hash_is_spread_over_all_bits():
    bits = np.asarray(hash32(dr.arange(UInt32, 4096)), dtype=np.uint32)
    for bit in range(32):  # each is set for half of the numbers, within five standard deviations
        assert ((bits >> bit) & 1).mean() == pytest.approx(0.5, abs=5 * 0.5 / 64)
