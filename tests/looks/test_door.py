"""Looks in Python: how they are shown, and what their messages say about wrong arguments."""

import inspect
import pickle
import types

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import looks
from photonbeams.runtime.device import Float
from photonbeams.scene import SceneError

#: Values that most arguments of a factor cannot be.
WRONG = {
    "none": None, "text": "x", "object": object(), "class": dict, "NaN": float("nan"), "endless": float("inf"),
    "empty": [], "ragged": [[1, 2], [3]], "holed": [1, None], "complex": 1j, "matrix": np.ones((2, 2)),
    "beams": pb.Beams([[0, 0, 0]], [[0, 0, 1]], 1, 1, [[1, 1, 1]]), "look": pb.Look(), "huge": 10**400,
    "module": types, "truth": np.bool_(True), "bytes": b"12", "vector": dr.scalar.Array2f(1, 2), "negative": -1,
    "lambda": lambda a, b: a,
}  # fmt: skip
CLASSES = [
    each
    for each in (getattr(looks, name) for name in looks.__all__)
    if inspect.isclass(each)
    and issubclass(each, looks.Factor | looks.Across | looks.Fog | looks.LightContext | looks.Look)
    and each not in (looks.Factor, looks.Across)
]  # fmt: skip


def attempt(make):
    """Return the message of the error that a call raises, or None if it raises none."""
    try:
        make()
    except SceneError as error:
        return str(error)
    return None


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_any_argument_is_taken_or_told_in_a_sentence(kind):
    names = [name for name in inspect.signature(kind.__init__).parameters if name != "self"]
    for name in names:
        for value in WRONG.values():
            given = {"knots": [0, 1], "colors": [[1, 1, 1]] * 2, "inner": 0.5, "outer": 0.8, "length": 1.0}
            given = {key: each for key, each in given.items() if key in names}
            said = attempt(lambda given=given | {name: value}: kind(**given))
            assert said is None or (len(said) <= 300 and "\n" not in said)
    said = attempt(lambda: kind(nothing=1))
    assert said == f"{kind.__name__} has no argument 'nothing'. Expected {', '.join(names) or 'none'}"


@pytest.mark.parametrize("slot", ["along", "across", "eye", "angle"])
def test_a_slot_says_what_it_expects(slot):
    for name in ("object", "class", "ragged", "holed", "complex", "beams", "look", "module", "bytes"):
        said = attempt(lambda name=name: pb.Look(**{slot: WRONG[name]}))
        assert said is not None and said.startswith(slot) and "expected" in said
    said = attempt(lambda: pb.Look(**{slot: looks.Noise}))
    assert said == f"{slot} is the class Noise: expected an instance, Noise(...)"


@pytest.mark.parametrize("number", ["none", "object", "NaN", "ragged", "complex", "beams", "bytes", "huge"])
def test_arithmetic_with_what_is_no_number_is_told_in_a_sentence(number):
    factor = looks.Attenuation()
    for make in (lambda x: factor * x, lambda x: x * factor, lambda x: factor + x, lambda x: factor.mix(1, x),
                 lambda x: factor.clamp(x, 1), lambda x: looks.Biweight() * x):  # fmt: skip
        assert attempt(lambda make=make: make(WRONG[number])) is not None


def test_a_wrong_keyword_is_answered_with_the_right_ones():
    for make, sentence in (
        (lambda: pb.Look(colour=1), "Look has no argument 'colour'. Expected along, across, eye, angle, surfaces"),
        (
            lambda: pb.Look(angel=1),
            "Look has no argument 'angel', did you mean angle? Expected along, across, eye, angle, surfaces",
        ),
        (
            lambda: pb.Look(*range(6)),
            "Look got 6 positional arguments: expected up to 5, along, across, eye, angle, surfaces",
        ),
        (lambda: looks.Exponential(), "Exponential lacks length: expected length"),
        (lambda: looks.Glow(mixx=1), "Glow has no argument 'mixx', did you mean mix? Expected anisotropy, mix, gain"),
        (lambda: pb.thin(part=1), "thin has no argument 'part'. Expected fraction, keep_light"),
    ):
        assert attempt(make) == sentence


def test_numpy_leaves_products_to_factors_and_profiles():
    for product in (np.float64(2) * looks.Attenuation(), np.ones(3) * looks.Attenuation()):
        assert isinstance(product, looks.Product)
    assert isinstance(np.ones(3) * looks.Biweight(), looks.Modulated)
    assert isinstance(looks.Noise() * looks.Biweight(), looks.Modulated)


def test_a_look_shows_its_factors_with_their_numbers():
    assert repr(pb.Look()) == "Look(along=Attenuation(), across=Epanechnikov(), eye=Attenuation(), angle=Scattering())"
    along = looks.Exponential(Float(0.7)) * (looks.Power(2) + 0.5) * [1, 0.5, 0.25]
    look = pb.Look(along, looks.Gaussian() * looks.Variation(0.2), "1 - s", looks.Constant(1).clamp(0, 0.5))
    assert repr(look) == (
        "Look(along=Exponential(length=0.7) * (Power(exponent=2, length=1) + Constant(value=0.5)) * "
        "Constant(value=[1, 0.5, 0.25]), across=Gaussian(width=0.35) * Variation(amount=0.2), "
        "eye=Expression(text='1 - s'), angle=Clamp(inner=Constant(value=1), low=0, high=0.5))"
    )
    assert repr(looks.Texture(np.ones((64, 3)))) == (
        "Texture(pixels=<numbers (64, 3)>, begin=0, end=1, space='fraction')"
    )
    assert repr(pb.Look(across=lambda rho: 1 - rho).across) == "Function(<function <lambda>>)"


# -- Equality ------------------------------------------------------------------------------------------------------


def shape(rho):
    return 1 - rho


MAKERS = [
    lambda: looks.Attenuation(), lambda: looks.Scattering(), lambda: looks.Power(1.5),
    lambda: looks.Power(1.5, length=2),
    lambda: looks.Constant([1, 2, 3]), lambda: looks.Constant(np.array([1.0, 2, 4])), lambda: looks.Expression("1 - s"),
    lambda: looks.ColorRamp([0, 1], [[1, 0, 0], [0, 1, 0]]), lambda: looks.ColorRamp([0, 1], [[1, 0, 0], [0, 1, 1]]),
    lambda: looks.Power() * [1, 2, 3], lambda: looks.Power() + 1, lambda: looks.Power().mix(2.0),
    lambda: looks.Constant(2).clamp(0, 1), lambda: looks.Function(shape), lambda: looks.Gaussian(0.4),
    lambda: looks.Gaussian(0.4) * "1 - s", lambda: looks.Epanechnikov(), lambda: looks.LightContext(),
    lambda: looks.Fog(pb.Medium(0.1)), lambda: looks.Fog(pb.Medium(0.2)), lambda: pb.Look(),
    lambda: pb.Look(along="1 - s"), lambda: pb.Look(along=looks.Power(), eye=looks.Power()),
]  # fmt: skip


def test_looks_and_their_parts_are_equal_by_content():
    first, second = ([make() for make in MAKERS] for _ in range(2))
    bound = [pb.Look(along=each).bind(pb.Medium(0.1), 1.0) for each in first[:2]]  # which computes what looks keep
    assert len(bound) == 2
    for index, own in enumerate(first):
        assert [own == other for other in second] == [index == other for other in range(len(second))], own
        assert pickle.loads(pickle.dumps(own)) == own
    assert len({*first, *second}) == len(MAKERS)
    power = looks.Power()
    assert pb.Look(along=power, eye=power) == first[-1]  # one factor twice is like two
    assert looks.Function(shape) != looks.Function(lambda rho: 1 - rho) and pb.Look() != "Look()"
    assert pb.scene.BeamSettings(look=pb.Look(eye=2.0)) == pb.scene.BeamSettings(look=pb.Look(eye=2.0))


def test_factors_of_ones_own_are_equal_by_what_they_hold():
    class Twinkle(looks.Factor):
        def __init__(self, size):
            self.size = size

        def evaluate(self, at):
            return 1 - self.size * at.random

    assert Twinkle(2) == Twinkle(2) != Twinkle(3) and pb.Look(along=Twinkle(2)) == pb.Look(along=Twinkle(2))


# -- Factors of one's own that are not finished --------------------------------------------------------------------


class Empty(looks.Factor):
    pass


class EmptyDecay(looks.factors.Decay):
    pass


class Numbers(looks.Factor):
    def __init__(self, value):
        self.value = value

    def evaluate(self, at):
        return self.value(at.distance)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (Empty(), "Empty has no method evaluate(self, at): expected one that returns its value"),
        (EmptyDecay(), "EmptyDecay has no method exponent(self, at): expected one that returns it"),
        (
            Numbers(lambda s: np.exp(-s)),
            "returns a ndarray: expected a Float, an Array3f or a number, made by functions",
        ),
        (Numbers(lambda s: np.float64(2) * s), "Dr.Jit, not of NumPy"),
        (
            lambda s: np.maximum(s, 0.5),
            "returns a ndarray: expected a Float, an Array3f or a number, made by functions",
        ),
        (Numbers(lambda s: np.array([1, 0.5, 0.2])), "returns a ndarray"),
        (Numbers(lambda s: None), "returns a NoneType: expected a Float, an Array3f or a number"),
        (Numbers(lambda s: "red"), "returns a str: expected"),
    ],
)
def test_a_factor_without_a_value_is_told_in_a_sentence(factor, message):
    beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    for own in ({"along": factor}, {"eye": factor}, {"across": looks.Uniform() * factor}):
        said = attempt(
            lambda own=own: pb.estimate(beams, [[-3, 0, 2]], [1, 0, 0], look=pb.Look(**own), medium=pb.Medium(0.1))
        )
        assert said is not None and message in said and len(said) <= 300


def test_numbers_of_numpy_are_numbers():
    bound = pb.Look(along=Numbers(lambda s: s * np.float64(2) + np.float32(1))).bind(pb.Medium(0.1), 4.0)
    assert bound.along(distance=Float(1), depth=Float(1), fraction=Float(0.5))[0] == 3


def test_a_profile_without_a_shape_is_told_in_a_sentence():
    class EmptyProfile(looks.Across):
        pass

    said = "EmptyProfile has no method shape(self, rho): expected one that returns the profile"
    assert attempt(lambda: pb.Look(across=EmptyProfile())) == said
