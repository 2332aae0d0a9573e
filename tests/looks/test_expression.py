"""Expressions: every function and operator against NumPy, and an error message for every invalid text."""

import pickle
import re
import time
from functools import cache

import drjit as dr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photonbeams.looks import expression, guarded
from photonbeams.looks.expression import ParsedExpression, parse
from photonbeams.looks.syntax import ExpressionError
from photonbeams.looks.vocabulary import CONSTANTS, FUNCTIONS, NAMES
from photonbeams.numerics.arrays import to_float
from photonbeams.runtime.device import Array3f, Float, UInt32
from tests.helpers.kernels import compiled
from tests.looks import noise_twin

EPSILON = float(np.finfo(np.float64).eps)
EPSILON32 = float(np.finfo(np.float32).eps)
LARGEST = guarded.LARGEST


def device_value(value, wide=True):
    """Return NumPy numbers (N,) or (N, 3) as a Dr.Jit value."""
    scalar = dr.float64_array_t(Float) if wide else Float
    vector = dr.float64_array_t(Array3f) if wide else Array3f
    numbers = np.asarray(value, dtype=np.float64 if wide else np.float32)
    if numbers.ndim < 2:
        return scalar(numbers.ravel().copy())
    return vector(*(scalar(axis.copy()) for axis in numbers.T))


def evaluated(text, inputs, wide=True):
    """Return the value of an expression for NumPy inputs, as NumPy, (N,) or (N, 3)."""
    return all_evaluated([text], inputs, wide)[text]


def all_evaluated(texts, inputs, wide=True):
    """Return the values of expressions by their texts, by a single kernel, since each takes time to compile."""
    given_values = {name: device_value(value, wide) for name, value in inputs.items()}
    values = {text: parse(text).evaluate(given_values.__getitem__) for text in texts}
    dr.eval(values)
    return {text: np.asarray(value, dtype=float).T for text, value in values.items()}


# -- Functions and operators against NumPy -----------------------------------------------------------------------------

N = 400
_rng = np.random.default_rng(3)
#: Numbers of both signs, near zero and far from it, some of them whole.
X = np.concatenate([_rng.normal(0, 2, N // 2), _rng.integers(-5, 6, N // 4), _rng.normal(0, 300, N // 4)])
Y = np.concatenate([_rng.normal(0, 2, N // 2), _rng.integers(-3, 4, N // 2)])
UNIT = np.linspace(0, 1, N)
POSITION = _rng.normal(0, 4, (N, 3))
INPUTS = {"s": X, "t": Y, "r": UNIT, "P": POSITION, "Pl": POSITION[::-1].copy(), "time": Y}


def safe_power(x, y):
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    result = np.zeros(x.shape)
    for k in np.ndindex(x.shape):
        if x[k] == 0:
            result[k] = y[k] == 0
        elif x[k] > 0 or y[k] == round(y[k]):
            result[k] = np.clip(x[k] ** y[k], -LARGEST, LARGEST)
    return result


def safe_divide(a, b):
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    return np.divide(a, b, out=np.zeros(a.shape), where=b != 0)


def safe_mod(a, b):
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    return np.mod(a, b, out=np.zeros(a.shape), where=b != 0)


def linearstep(low, high, x):
    return np.interp(x, [low, high], [0, 1]) if low < high else 1 - np.interp(x, [high, low], [0, 1])


def smooth(t):
    return 3 * t**2 - 2 * t**3


def bell(t):
    return np.where(t > 0, 2 ** (-8 * (1 - t) ** 2), 0)


def band(x, source, reach, falloff):
    return np.interp(
        x, [source - reach - falloff, source - reach, source + reach, source + reach + falloff], [0, 1, 1, 0]
    )


def bias(x, b):
    return safe_power(np.maximum(x, 0), np.log(b) / np.log(0.5))


def s_curve(x, c):
    x = np.clip(x, 0, 1)
    return np.where(x < 0.5, bias(2 * x, 1 - c) / 2, 1 - bias(2 - 2 * x, 1 - c) / 2)


def hsv(h, s, v):
    """Return colours (N, 3), by the six corners of the colour wheel."""
    corners = np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
    pure = np.stack([np.interp(6 * np.mod(h, 1), np.arange(7), corner) for corner in corners.T], axis=1)
    return v[:, None] * (1 - s[:, None] * (1 - pure))


def columns(*parts):
    return np.stack(np.broadcast_arrays(*parts), axis=1).astype(float)


P, PL = POSITION, INPUTS["Pl"]
WITH_TIME = np.vstack([P.T, Y])
CASES = {
    # Operators.
    "s + t": X + Y,
    "s - t * 2.5": X - Y * 2.5,
    "s / t": safe_divide(X, Y),
    "s % t": safe_mod(X, Y),
    "s ** t": safe_power(X, Y),
    "(s * 0.01) ** 2": (X * 0.01) ** 2,
    "(-2) ** 3 + -2 ** 2": np.array([-12.0]),
    "2 ** 3 ** 2": np.array([512.0]),
    "-s": -X,
    "+s": X,
    "s < t": X < Y,
    "s <= round(s)": np.round(X) >= X,
    "s > t": X > Y,
    "s >= round(s)": np.round(X) <= X,
    "s == round(s)": np.round(X) == X,
    "s != round(s)": np.round(X) != X,
    "-1 < s <= 2 != t": (X > -1) & (X <= 2) & (Y != 2),
    "s > 0 and t > 0 and r": (X > 0) & (Y > 0) & (UNIT != 0),
    "s > 0 or t > 0": (X > 0) | (Y > 0),
    "not s": X == 0,
    "not s > 0 or t > 0": ~(X > 0) | (Y > 0),
    "s if t > 0 else r": np.where(Y > 0, X, UNIT),
    "1 if s > 1 else 2 if s > 0 else 3": np.select([X > 1, X > 0], [1.0, 2.0], 3.0),
    "s * pi + e": X * np.pi + np.e,
    # Vectors.
    "P * s": P * X[:, None],
    "s - P": X[:, None] - P,
    "P / Pl % 3": safe_mod(safe_divide(P, PL), 3),
    "-P": -P,
    "[s, 2, t]": columns(X, 2, Y),
    "P.x + 2 * P.y - P.z": P[:, 0] + 2 * P[:, 1] - P[:, 2],
    "P.r + 2 * P.g - P.b": P[:, 0] + 2 * P[:, 1] - P[:, 2],
    "P[0] + 2 * P[1] - P[2]": P[:, 0] + 2 * P[:, 1] - P[:, 2],
    "P if s > 0 else 1": np.where((X > 0)[:, None], P, 1),
    "[1, 0, 0] if s > 0 else P": np.where((X > 0)[:, None], [[1, 0, 0]], P),
    "(P + 1).x": P[:, 0] + 1,
    # Functions, in the order of their table.
    "abs(s)": np.abs(X),
    "sign(s)": np.sign(X),
    "floor(s)": np.floor(X),
    "ceil(s)": np.ceil(X),
    "round(s)": np.round(X),
    "fract(s)": X - np.floor(X),
    "frac(P)": P - np.floor(P),
    "mod(s, 3)": np.mod(X, 3),
    "min(s, t)": np.minimum(X, Y),
    "max(P, s)": np.maximum(P, X[:, None]),
    "clamp(s, -1, 2)": np.clip(X, -1, 2),
    "mix(s, t, r)": X * (1 - UNIT) + Y * UNIT,
    "lerp([1, 0, 0], [0, 0, 2], r)": columns(1 - UNIT, 0, 2 * UNIT),
    "select(s > 0, t, P)": np.where((X > 0)[:, None], Y[:, None], P),
    "step(1, s)": X >= 1,
    "boxstep(s, 1)": X >= 1,
    "linearstep(-1, 2, s)": linearstep(-1, 2, X),
    "linearstep(2, -1, s)": linearstep(2, -1, X),
    "linearstep(1, 1, s)": X >= 1,
    "smoothstep(-1, 2, s)": smooth(linearstep(-1, 2, X)),
    "smoothstep(-1, 2, P)": smooth(linearstep(-1, 2, P)),
    "gaussstep(-1, 2, s)": bell(linearstep(-1, 2, X)),
    "remap(s, 1, 0.5, 2, 0)": band(X, 1, 0.5, 2),
    "remap(s, 1, 0.5, 2, 1)": smooth(band(X, 1, 0.5, 2)),
    "remap(s, 1, -0.5, -2, 2)": bell(band(X, 1, 0.5, 2)),
    "remap(s, 1, 2, 0, 0)": np.abs(X - 1) < 2,
    "fit(s, -1, 3, 5, 1)": 5 + (X + 1) / 4 * -4,
    "fit(s, 1, 1, 5, 9)": np.full(N, 5.0),
    "bias(r, 0.3)": bias(UNIT, 0.3),
    "bias(r, 1)": np.ones(N) * (UNIT > 0) + (UNIT == 0),
    "contrast(r, 0.8)": s_curve(UNIT, 0.8),
    "gain(s, 0.2)": s_curve(X, 0.2),
    "gamma(s, 2.2)": safe_power(np.maximum(X, 0), 1 / 2.2),
    "pow(s, t)": safe_power(X, Y),
    "exp(s / 10)": np.minimum(np.exp(X / 10), LARGEST),
    "log(s)": np.log(np.maximum(X, 1e-18)),
    "sqrt(s)": np.sqrt(np.maximum(X, 0)),
    "sin(s)": np.sin(X),
    "cos(P)": np.cos(P),
    "tan(s)": np.tan(X),
    "asin(s)": np.arcsin(np.clip(X, -1, 1)),
    "acos(s)": np.arccos(np.clip(X, -1, 1)),
    "atan(s)": np.arctan(X),
    "atan2(s, t)": np.arctan2(X, Y),
    "radians(s)": np.radians(X),
    "degrees(s)": np.degrees(X),
    "pulse(s)": np.mod(X, 1) < 0.5,
    "pulse(s, 0.2)": np.mod(X, 1) < 0.2,
    "triangle(s)": 1 - np.abs(1 - 2 * np.mod(X, 1)),
    "wave(s)": np.sin(np.pi * X) ** 2,
    "vec(s, t, 1)": columns(X, Y, 1),
    "rgb(r, 0, 1)": columns(UNIT, 0, 1),
    "length(P)": np.linalg.norm(P, axis=1),
    "dot(P, Pl)": np.sum(P * PL, axis=1),
    "cross(P, Pl)": np.cross(P, PL),
    "normalize(P)": P / np.linalg.norm(P, axis=1, keepdims=True),
    "norm(0 * P)": 0 * P,
    "luminance(P)": P @ [0.2126, 0.7152, 0.0722],
    "hsv(s, r, 2)": hsv(X, UNIT, np.full(N, 2.0)),
    "hsvtorgb([s, r, t])": hsv(X, UNIT, Y),
    "hash(s)": noise_twin.random(X, np.zeros(N)),
    "hash(s, 3)": noise_twin.random(X, np.full(N, 3.0)),
    "rand(P)": noise_twin.random(*P.T, np.zeros(N)),
    "cellnoise(P)": noise_twin.cellnoise(P.T),
    "cellnoise(s, time)": noise_twin.cellnoise(np.stack([X, Y])),
    "noise(P)": noise_twin.noise(P.T),
    "noise(s)": noise_twin.noise(X[None]),
    "noise(P, time)": noise_twin.noise(WITH_TIME),
    "snoise(P, time=time)": noise_twin.snoise(WITH_TIME),
    "vnoise(P)": noise_twin.vnoise(P.T).T,
    "fbm(P)": noise_twin.fbm(P.T),
    "fbm(P, 3, 2.5, 0.25)": noise_twin.fbm(P.T, 3, 2.5, 0.25),
    "fbm(P, gain=0.25, octaves=2, time=time)": noise_twin.fbm(WITH_TIME, 2, gain=0.25),
    "turbulence(P, 4)": noise_twin.turbulence(P.T, 4),
}


@cache
def some_cases(number):
    """Return the values of a dozen cases."""
    return all_evaluated(list(CASES)[12 * number : 12 * number + 12], INPUTS)


@pytest.mark.parametrize("text", CASES)
def test_an_expression_is_its_formula(text):
    found, expected = some_cases(list(CASES).index(text) // 12)[text], np.asarray(CASES[text], dtype=float)
    assert parse(text).kind == ("vector" if expected.ndim == 2 else "scalar")
    expected = np.broadcast_to(expected, np.broadcast_shapes(found.shape, expected.shape))
    # x ** y has the rounding of y log2 x, up to some 60, in its exponent. The fraction of a number near 1000, and the
    # last octave of a noise, have that many ulps of error. Dr.Jit's tangent has fewer digits near its poles.
    tolerance = 1e-9 if "tan(" in text else 4000 * EPSILON
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)


def test_every_function_has_a_case():
    used = " ".join(CASES)
    assert not [name for name in FUNCTIONS if not re.search(rf"\b{name}\(", used)]


@pytest.mark.parametrize("text", ["smoothstep(0, 0.2, r) * (1 - r) ** 2", "mix([1, 0.5, 0], [0, 0, 1], r) * fbm(P, 2)"])
def test_single_precision_is_close_to_double(text):
    found, exact = evaluated(text, INPUTS, wide=False), evaluated(text, INPUTS)
    # Inputs of up to 20 are rounded, and noise has slopes of some 4 per unit.
    np.testing.assert_allclose(found, exact, atol=200 * EPSILON32)


RULES = [
    ("1 / 0", 0), ("0 / 0", 0), ("5 % 0", 0), ("sqrt(-1)", 0), ("0 ** 0", 1), ("0 ** -1", 0), ("(-8) ** 0.5", 0),
    ("(-2) ** -1", -0.5), ("log(0)", np.log(1e-18)), ("log(-5)", np.log(1e-18)), ("exp(1000)", LARGEST),
    ("1e18 * 10", LARGEST), ("-1e18 / 0.1", -LARGEST), ("dot([1e18, 1, 1], [1e18, 1, 1]) - 1e18", 0),
    ("1e18 * 1e18 - 1e18 * 1e18", 0), ("9**9**9**9", LARGEST), ("-exp(1000)", -LARGEST),
    ("exp(-1000)", 0), ("exp(1000) * 0", 0),
    ("exp(1000) - exp(1000)", 0), ("exp(1000) / exp(1000)", 1), ("acos(2)", 0), ("atan2(0, 0)", 0),
    ("length(1e18 * [1, 0, 0])", LARGEST), ("normalize([0, 0, 0]).x", 0), ("normalize(1e18 * [3, 4, 0]).y", 0.5**0.5),
    ("mod(1, 0)", 0), ("gamma(2, 0)", 1), ("tan(pi / 2) > 1e6 or tan(pi / 2) < -1e6", 1),
    ("abs(sin(1e18)) <= 1", 1), ("fit(1, 2, 2, 7, 8)", 7), ("bias(0.5, 0) < 1e-9", 1), ("linearstep(1, 1, 1)", 1),
]  # fmt: skip


@pytest.mark.parametrize("wide", [True, False])
def test_what_mathematics_does_not_answer_has_its_rule(wide):
    # The input `s`, which has no effect, decides the precision.
    texts = [f"select(s, s, {text})" for text, _ in RULES]
    found = all_evaluated(texts, {"s": np.zeros(1)}, wide)
    for text, (_, expected) in zip(texts, RULES, strict=True):
        # Components that saturate are equal, and so are those of their unit vector.
        assert found[text][0] == pytest.approx(expected, rel=1e-6, abs=1e-12), text


def test_inputs_that_are_not_finite_count_as_the_largest_number_or_none():
    values = np.array([np.nan, np.inf, -np.inf, 1e30])
    for wide in (True, False):
        found = evaluated("s", {"s": values}, wide)
        np.testing.assert_allclose(found, [0, LARGEST, -LARGEST, LARGEST], rtol=EPSILON32)
        assert np.all(np.isfinite(evaluated("noise(s * [s, 1, 2]) + s ** 3 - s * s", {"s": values}, wide)))


# -- What an expression is ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "kind", "names"), [
    ("1", "scalar", set()), ("pi * e", "scalar", set()), ("s * s", "scalar", {"s"}), ("P", "vector", {"P"}),
    ("fbm(Pl * 2, time=time)", "scalar", {"Pl", "time"}), ("P * random", "vector", {"P", "random"}),
    ("length(P)", "scalar", {"P"}), ("id if light else generation", "scalar", {"id", "light", "generation"}),
])  # fmt: skip
def test_an_expression_knows_its_kind_and_its_names(text, kind, names):
    found = parse(text)
    assert (found.kind, found.names) == (kind, names)
    looked_up = []
    found.evaluate(lambda name: looked_up.append(name) or (Float(0.5) if NAMES[name].kind == "scalar" else Array3f(1)))
    assert sorted(looked_up) == sorted(names)


def test_expressions_are_equal_by_their_text_and_can_be_sent():
    one = parse(" 1 - s\n")
    assert one.text == "1 - s" and repr(one) == "Expression('1 - s')"
    assert one == parse("1 - s") and hash(one) == hash(parse("1 - s")) and one != parse("1 -s") and one != "1 - s"
    sent = pickle.loads(pickle.dumps(one))
    assert isinstance(sent, ParsedExpression) and sent == one and float(sent.evaluate(lambda _: Float(0.25))[0]) == 0.75


def test_values_have_the_types_that_looks_expect():
    assert type(parse("s").evaluate(lambda _: Float(1, 2))) is Float
    assert type(parse("1").evaluate(lambda _: None)) is Float
    assert type(parse("[s, 1, 2]").evaluate(lambda _: Float(1))) is Array3f
    wide = dr.float64_array_t(Float)
    assert type(parse("s * 0.1").evaluate(lambda _: wide(1))) is wide
    assert parse("s * 0.1").evaluate(lambda _: wide(1))[0] == 0.1
    # Integers are accepted and divide as real numbers do; Python's numbers are accepted, too.
    assert float(parse("id / 2").evaluate(lambda _: UInt32(3))[0]) == 1.5
    assert float(parse("frame / 2").evaluate(lambda _: 3)[0]) == 1.5


def test_a_changed_number_compiles_no_kernel():
    def evaluate(number):
        text = f"mix({number} * P, [{number}, 1, s ** {number}], fbm(P * {number}, 2, {number}, 0.5)) + (s < {number})"
        values = {"P": dr.opaque(Array3f, [1, 2, 3]), "s": to_float(np.linspace(1, 2, 8))}
        dr.eval(parse(text).evaluate(values.__getitem__))

    evaluate(0.25)
    for number in (0.75, 0, 1, 2, 1000):
        assert not compiled(evaluate, number)


def test_python_numbers_as_inputs_compile_no_kernel():
    def evaluate(frame):
        dr.eval(parse("sin(frame) * 1.25").evaluate(lambda _: frame))

    evaluate(1)
    assert not compiled(evaluate, 2)


def test_the_tables_tell_all_that_there_is():
    text = expression.describe()
    for name, (_, doc, kind) in NAMES.items():
        assert f"{kind}: {doc}" in text and f"\n{name} " in f"\n{text}"
    for name, function in FUNCTIONS.items():
        assert function.name == name and function.signature in text and function.doc in text
    assert FUNCTIONS["fbm"].signature == "fbm(p, octaves=6, lacunarity=2, gain=0.5, [time])"
    assert FUNCTIONS["fbm"].arity == (1, 5) and FUNCTIONS["clamp"].arity == (3, 3)
    # No function has the name of an input or a constant: one word has one meaning.
    assert not set(FUNCTIONS) & (set(NAMES) | set(CONSTANTS))


# -- Invalid expressions -----------------------------------------------------------------------------------------------

NESTED = "(" * 1000 + "s" + ")" * 1000
ERRORS = {
    "": (1, "the expression is empty: expected an expression"),
    "  \n ": (1, "the expression is empty"),
    "smoothstap(0, 1, s)": (1, r"smoothstap is not a function: expected one of abs, .*; did you mean smoothstep\?"),
    "1 + foo": (5, "foo is not a name: expected one of s, distance, r, t"),
    "p": (1, r"p is not a name: .*; did you mean P\?"),
    "frames": (1, r"did you mean frame\?"),
    "noise": (1, r"noise is a function: expected noise\(p, \[time\]\)"),
    "2 * distance(P)": (5, "distance is not a function: expected distance without brackets"),
    "pi()": (1, "pi is not a function"),
    "clamp(s, 1)": (1, r"clamp has 2 arguments: expected clamp\(x, low, high\)"),
    "clamp()": (1, "clamp has 0 arguments"),
    "sin(s, t)": (1, r"sin has 2 arguments: expected sin\(x\)"),
    "clamp(s, low=0, high=1)": (10, r"clamp has no optional argument low: expected clamp\(x, low, high\)"),
    "fbm(P, octave=3)": (8, "fbm has no optional argument octave: expected one of octaves, lacunarity, gain, time"),
    "fbm(P, 2, octaves=3)": (11, "octaves is given twice"),
    "fbm(P, gain=1, gain=2)": (16, "gain is given twice"),
    "fbm(P, octaves=s)": (16, "octaves is s: expected a whole number from 1 to 8, written out"),
    "fbm(P, 9)": (8, "octaves is 9: expected a whole number from 1 to 8"),
    "fbm(P, 2.5)": (8, "octaves is 2.5"),
    "fbm(P, -1)": (8, "octaves is -1"),
    "remap(s, 0, 1, 2, 3)": (19, "interpolation is 3: expected a whole number from 0 to 2"),
    "smoothstep(s, 0, 1)": (1, r"expected its edges first, smoothstep\(low, high, x\)"),
    "max(*P)": (1, "max has 1 argument"),
    "max(*P, 1)": (5, "no meaning here"),
    "max(s, **P)": (8, r"\*\* has no meaning here"),
    "s +": (4, "the expression ends too early"),
    "s s": (3, "this cannot be read: expected one expression"),
    "(s": (1, r"\( is never closed: expected \)"),
    "[s, 1": (1, r"\[ is never closed: expected \]"),
    "s)": (2, r"\) closes nothing"),
    "(s]": (3, "] closes nothing"),
    "s ^ 2": (3, r"'\^' has no meaning here: expected \*\* for powers"),
    "s > 0 && t > 0": (7, "'&' has no meaning here: expected and"),
    "s > 0 ? 1 : 0": (7, r"'\?' has no meaning here: expected a if condition else b"),
    "$s": (1, "expected names without it"),
    "s\n+ 1": (2, "a character of code 10 has no meaning here: expected a single line"),
    "s\0": (2, "a character of code 0"),
    "s # fade": (3, "expected no comments"),
    "'s'": (1, "there are no strings"),
    "f's'": (2, "there are no strings"),
    "__import__('os')": (12, "there are no strings"),
    "__import__(os)": (1, "__import__ is not a function"),
    "(1).__class__": (1, r"\.__class__ is not a component: expected \.x"),
    "P.__class__.__base__": (1, r"\.__base__ is not a component"),
    "P.w": (1, r"\.w is not a component"),
    "P[3]": (3, "not the number of a component"),
    "P[-1]": (3, "not the number of a component"),
    "P[s]": (3, "not the number of a component"),
    "P[True]": (3, "not the number of a component"),
    "P[0, 1]": (3, "not the number of a component"),
    "P[0:1]": (4, "':' has no meaning here"),
    "s.x": (1, "a scalar has no components"),
    "P.x.y": (1, "a scalar has no components"),
    "s[0]": (1, "a scalar has no components"),
    "P()": (1, "P is not a function"),
    "P.x()": (1, "not the name of a function"),
    "sin(s)(t)": (1, "not the name of a function"),
    "lambda: 1": (7, "':' has no meaning here"),
    "[s for s in P]": (1, "no meaning here"),
    "(s for s in P)": (1, "no meaning here"),
    "(s := 1)": (4, "':' has no meaning here"),
    "s = 1": (3, "cannot be read"),
    "{s}": (1, "expected round or square brackets"),
    "await s": (1, "no meaning here"),
    "(yield s)": (2, "no meaning here"),
    "s is t": (1, "expected < <= > >= == or !="),
    "s in P": (1, "expected < <= > >= == or !="),
    "s // 2": (1, r"expected floor\(a / b\)"),
    "s << 2": (1, r"expected \+ - \* / % or \*\*"),
    "P @ P": (3, "'@' has no meaning here"),
    "~s": (1, "expected not, or 1 - x"),
    "True": (1, "True is not a number"),
    "None": (1, "None is not a number"),
    "...": (1, "Ellipsis is not a number"),
    "1j": (1, "1j is not a number"),
    "1e999": (1, "this number is too large: expected at most 1e.18"),
    "2 * 1e19": (5, "this number is too large"),
    "9" * 4000: (1, "this number is too large"),
    "ｓ + 1": (1, "'ｓ' has no meaning here"),
    "s + ѕ": (5, "'ѕ' has no meaning here"),
    "s − 1": (3, "'−' has no meaning here"),
    "[1, 2]": (1, r"a vector has 2 components: expected three, as in \[1, 0.5, s\]"),
    "[1]": (1, "a vector has 1 component: expected three"),
    "[]": (1, "a vector has 0 components"),
    "[P, 1, 2]": (2, "a component of a vector is a vector: expected a scalar"),
    "(1, 2, 3)": (1, r"expected \[x, y, z\] for a vector"),
    "s, t": (1, r"expected \[x, y, z\] for a vector"),
    "P < 1": (1, "one side of a comparison is a vector: expected a scalar"),
    "0 < P": (5, "one side of a comparison is a vector"),
    "s and P": (7, "one side of and is a vector"),
    "P or s": (1, "one side of or is a vector"),
    "not P": (5, "the operand of not is a vector"),
    "1 if P else 2": (6, "the condition is a vector"),
    "dot(s, P)": (5, "dot's a is a scalar: expected a vector"),
    "vec(1, P, 2)": (8, "vec's y is a vector: expected a scalar"),
    "noise(P, P)": (10, "noise's time is a vector"),
    NESTED: (65, "brackets are nested too deep: expected at most 64"),
    "-" * 4000 + "s": (1, "nested too deep"),
    "not " * 1000 + "s": (257, "nested too deep: expected at most 64"),
    "s" + " + s" * 1000: (1, "nested too deep"),
    "s" + ".x" * 1000: (1, "nested too deep"),
    "2" + " ** 2" * 800: (None, "nested too deep"),
    "max(" + "s, " * 1300 + "s)": (1, "max has 1301 arguments"),
    "s < " + "s < " * 1010 + "s": (None, "too many parts: expected at most 1000"),
    " + ".join(["fbm(P)"] * 20): (None, "an octave of noise counts as 10"),
    "x" * 100_000: (4097, "the expression has 100000 characters: expected at most 4096"),
}


@pytest.mark.parametrize("text", ERRORS, ids=lambda text: ascii(text[:30]))
def test_a_text_that_is_no_expression_is_told_in_a_sentence(text):
    column, reason = ERRORS[text]
    began = time.monotonic()
    with pytest.raises(ExpressionError, match=reason) as caught:
        parse(text)
    assert time.monotonic() - began < 5  # a hang would take minutes
    error = caught.value
    assert column in (None, error.column)
    sentence = str(error)
    assert sentence == f"{sentence.split(', column ')[0]}, column {error.column}: {error.reason}"
    assert sentence.startswith('expression "') and "\n" not in sentence and len(sentence) < 1000


def test_an_error_can_be_sent_and_shows_where_it_is():
    with pytest.raises(ExpressionError) as caught:
        parse("s * " * 100 + "q")
    error = pickle.loads(pickle.dumps(caught.value))
    assert (error.column, error.reason) == (caught.value.column, caught.value.reason)
    with pytest.raises(ExpressionError) as caught:
        parse(f"[s, {'1 + ' * 40}q, {'1 + ' * 40}1]")
    assert str(caught.value).startswith('expression "…') and "q, 1" in str(caught.value)


# -- Any text ----------------------------------------------------------------------------------------------------------

WORDS = [*NAMES, *FUNCTIONS, "pi", "1", "0.5", "if", "else", "and", "or", "not", "(", ")", "[", "]", ",", ".x", "=",
         "+", "-", "*", "**", "/", "%", "<", "==", "lambda", "__class__", " ", "9" * 30, "1e400", "in", "octaves",
         "é"]  # fmt: skip


@given(st.text() | st.lists(st.sampled_from(WORDS), max_size=12).map(" ".join) | st.lists(
    st.sampled_from(WORDS), max_size=12).map("".join))  # fmt: skip
@settings(max_examples=400)
def test_any_text_is_an_expression_or_told_in_a_sentence(text):
    try:
        found = parse(text)
    except ExpressionError as error:
        assert 1 <= error.column <= len(text) + 1 and "\n" not in str(error)
    else:
        assert found.kind in ("scalar", "vector") and found.names <= set(NAMES)


LEAVES = {
    "scalar": [*(name for name, each in NAMES.items() if each.kind == "scalar"), "0", "1", "0.5", "-1", "2", "-3.7",
               "1e18", "-1e18", "1e-18", "1e-45", "100", "pi"],
    "vector": ["P", "Pl", "[0, 0, 0]", "[s, -1, 1e18]", "(P * s)"],
}  # fmt: skip
OPERATORS = ["+", "-", "*", "/", "%", "**"]
CONDITIONS = ["<", "<=", ">", ">=", "==", "!=", "and", "or"]


@st.composite
def expressions(draw, kind, depth):
    """Return the text of an expression of the given kind; it is valid by construction."""

    def part(wanted):
        return draw(expressions(wanted, depth - 1))

    def parts(count):
        """Return parts: at least one of the kind, the others of that kind or scalars."""
        kinds = [draw(st.sampled_from(["scalar", kind])) for _ in range(count)]
        kinds[draw(st.integers(0, count - 1))] = kind
        return [part(each) for each in kinds]

    if depth == 0:
        return draw(st.sampled_from(LEAVES[kind]))
    function = draw(st.sampled_from([None, *(each for each in FUNCTIONS.values() if each.result in ("any", kind))]))
    if function is None:
        forms = {
            "scalar": [
                lambda: f"({part('scalar')} {draw(st.sampled_from(CONDITIONS))} {part('scalar')})",
                lambda: f"(not {part('scalar')})",
                lambda: f"{part('vector')}.{draw(st.sampled_from('xyzrgb'))}",
            ],
            "vector": [lambda: f"[{part('scalar')}, {part('scalar')}, {part('scalar')}]"],
        }[kind]
        both = [
            lambda: f"(-{part(kind)})",
            lambda: f" {draw(st.sampled_from(OPERATORS))} ".join(parts(2)).join("()"),
            lambda: f" if {part('scalar')} else ".join(parts(2)).join("()"),
        ]
        return draw(st.sampled_from([*forms, *both]))()
    taken = function.parameters[: draw(st.integers(*function.arity))]
    free = [each for each in taken if each.kind == "any"]
    any_kinds = iter(parts(len(free)) if function.result == "any" else [part(draw(KINDS)) for _ in free])
    arguments = [
        str(draw(st.integers(each.least, min(each.most, 2)))) if each.kind == "whole"
        else next(any_kinds) if each.kind == "any"
        else part(each.kind)
        for each in taken
    ]  # fmt: skip
    if function.name in ("linearstep", "smoothstep", "gaussstep"):
        arguments[2] = f"({arguments[2]} + s)"  # otherwise SeExpr's order would be suspected
    return f"{function.name}({', '.join(arguments)})"


KINDS = st.sampled_from(["scalar", "vector"])
WILD = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e-45, 1e-20, -1e-20, 3.4e38, -3.4e38, 1e18, 1e9, -2.5, 7.0, float("nan")]


@given(st.lists(st.tuples(KINDS, st.integers(1, 2)).flatmap(lambda each: expressions(*each)), min_size=8, max_size=8),
       st.integers(0, 2**32 - 1))  # fmt: skip
@settings(max_examples=30)
def test_any_expression_of_any_inputs_is_finite(texts, seed):
    """Any expression is finite for any inputs; eight share a kernel, which takes time to compile."""
    rng = np.random.default_rng(seed)

    def lookup(name):
        rows = rng.choice(WILD, (3, 64)).astype(np.float32)
        rows[:, 32:] = rng.normal(0, 10, (3, 32))
        return Float(rows[0].copy()) if NAMES[name].kind == "scalar" else Array3f(*(Float(row.copy()) for row in rows))

    found = [parse(text) for text in texts]
    results = [each.evaluate(lookup) for each in found]
    dr.eval(results)
    for each, value in zip(found, results, strict=True):
        assert np.all(np.isfinite(np.asarray(value))), each
        assert (dr.depth_v(value) > 1) == (each.kind == "vector")
