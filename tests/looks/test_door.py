"""Looks in Python: how they are shown, and what their messages say about wrong arguments."""

import inspect
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
        (lambda: pb.Look(colour=1), "Look has no argument 'colour'. Expected along, across, eye, angle"),
        (
            lambda: pb.Look(angel=1),
            "Look has no argument 'angel', did you mean angle? Expected along, across, eye, angle",
        ),
        (lambda: pb.Look(*range(5)), "Look got 5 positional arguments: expected up to 4, along, across, eye, angle"),
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
