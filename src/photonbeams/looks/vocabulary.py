"""The vocabulary of expressions: inputs, constants and functions, each with a line for the manual.

The functions have the names and meanings of SeExpr, the expression language of the film, and of GLSL. Where these two
disagree, arguments have GLSL's order: `linearstep`, `smoothstep` and `gaussstep` take their edges before x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import drjit as dr

from . import guarded, noise
from .guarded import Operand, divided, fraction, power, saturated, times, truth, vector_type

Kind = Literal["scalar", "vector"]

#: Number of an expression's parts that an octave of noise counts as, by its cost.
NOISE_PARTS = 10


class Input(NamedTuple):
    """An input: its kind, the attribute of `ShadingContext` that holds it, and its meaning."""

    kind: Kind
    attribute: str
    doc: str


#: The inputs of expressions.
NAMES: dict[str, Input] = {
    "s": Input("scalar", "fraction", "fraction of the light path: 0 at the light, 1 at its end"),
    "distance": Input("scalar", "from_light", "distance from the light, in scene units"),
    "r": Input("scalar", "radius", "fraction of the beam's radius: 0 on the axis, 1 at the rim"),
    "t": Input("scalar", "to_camera", "distance to the camera, in scene units"),
    "angle": Input(
        "scalar", "angle", "degrees between the light's direction and that to the camera: 0 is straight into the lens"
    ),
    "cosine": Input("scalar", "cosine", "cosine of `angle`"),
    "P": Input("vector", "position", "position in the world"),
    "Pl": Input("vector", "local", "position in the light's own space"),
    "time": Input("scalar", "time", "seconds"),
    "frame": Input("scalar", "frame", "frame number, with a fraction within the shutter interval"),
    "random": Input("scalar", "random", "a random number from 0 to 1, different for each beam"),
    "id": Input("scalar", "id", "the beam's number"),
    "light": Input("scalar", "light", "the number of the beam's light"),
    "generation": Input(
        "scalar", "generation", "how many times the beam's light was scattered before: 0 is straight from the light"
    ),
}

CONSTANTS: dict[str, float] = {"pi": math.pi, "e": math.e}


class Parameter(NamedTuple):
    """A parameter of a function."""

    name: str  # in messages, and the keyword of an optional parameter
    kind: Literal["scalar", "vector", "any", "whole"] = "any"  # a whole number is written out
    optional: bool = False
    default: float | None = None  # of an optional parameter; None: there is none
    least: int = 0  # range of a whole number
    most: int = 0

    def __str__(self) -> str:
        if not self.optional:
            return self.name
        return f"[{self.name}]" if self.default is None else f"{self.name}={self.default:g}"


@dataclass(frozen=True)
class ExpressionFunction:
    """A function of expressions."""

    name: str
    parameters: tuple[Parameter, ...]  # in order
    result: Literal["scalar", "vector", "any"]  # "any": a vector if an argument of the kind "any" is a vector
    doc: str  # one line on the value, for the manual
    compute: Callable[..., Any]  # of Dr.Jit values in the parameters' order
    parts: int = 1  # that a call counts as; if `octaves` is a parameter, for each octave

    @property
    def arity(self) -> tuple[int, int]:
        """The smallest and the largest number of arguments."""
        return sum(not each.optional for each in self.parameters), len(self.parameters)

    @property
    def signature(self) -> str:
        """The signature as text: `fbm(p, octaves=6, lacunarity=2, gain=0.5, [time])`."""
        return f"{self.name}({', '.join(map(str, self.parameters))})"


def _mix(a: Operand, b: Operand, amount: Operand) -> Operand:
    return a + times(b - a, amount)


def _clamp(x: Operand, low: Operand, high: Operand) -> Operand:
    return dr.minimum(dr.maximum(x, low), high)


def _linearstep(low: Operand, high: Operand, x: Operand) -> Operand:
    # Equal edges give a step there; descending edges give a step downward.
    return dr.select(low == high, truth(x >= low, x), dr.clip(divided(x - low, high - low), 0, 1))


def _eased(t: Operand) -> Operand:
    return t * t * (3 - 2 * t)


def _bell(t: Operand) -> Operand:
    """Return SeExpr's Gaussian step of t in [0, 1]: the flank of a Gaussian, cut off where it is 1/256."""
    return dr.select(t > 0, dr.exp2(-8 * dr.square(1 - t)), 0)


def _shaped_step(shape: Callable[[Operand], Operand]) -> Callable[..., Operand]:
    return lambda low, high, x: shape(_linearstep(low, high, x))


def _remap(x: Operand, source: Operand, reach: Operand, falloff: Operand, interpolation: int) -> Operand:
    outside = dr.abs(x - source) - dr.abs(reach)
    soft = dr.abs(falloff)
    inside = dr.select(soft == 0, truth(outside < 0, x), 1 - dr.clip(divided(outside, soft), 0, 1))
    return (lambda t: t, _eased, _bell)[interpolation](inside)


def _fit(x: Operand, a1: Operand, b1: Operand, a2: Operand, b2: Operand) -> Operand:
    return a2 + times(divided(x - a1, b1 - a1), b2 - a2)


def _bias(x: Operand, b: Operand) -> Operand:
    exponent = guarded.logarithm(dr.clip(b, 0, 1)) * (1 / math.log(0.5))
    return power(dr.maximum(x, 0), exponent)


def _contrast(x: Operand, amount: Operand) -> Operand:
    inside = dr.clip(x, 0, 1)
    low = inside < 0.5
    half = 0.5 * _bias(2 * dr.select(low, inside, 1 - inside), 1 - amount)
    return dr.select(low, half, 1 - half)


def _gamma(x: Operand, g: Operand) -> Operand:
    return power(dr.maximum(x, 0), divided(type(g)(1), g))


def _select(condition: Operand, a: Operand, b: Operand) -> Operand:
    return dr.select(condition != 0, a, b)


def _vector(x: Operand, y: Operand, z: Operand) -> Operand:
    return vector_type(x)(x, y, z)


def _hsv(hue: Operand, saturation: Operand, value: Operand) -> Operand:
    """Return the colour of a hue (1 is a full turn), by each channel's distance in sextants."""

    def channel(offset: int) -> Operand:
        sextant = 6 * fraction(fraction(hue) + offset / 6)
        amount = dr.clip(dr.minimum(sextant, 4 - sextant), 0, 1)
        return times(value, 1 - times(saturation, amount))

    return _vector(channel(5), channel(3), channel(1))


def _luminance(c: Operand) -> Operand:
    return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z


def _wave(t: Operand) -> Operand:
    return 0.5 - 0.5 * dr.cos(2 * math.pi * fraction(t))


def _triangle(t: Operand) -> Operand:
    return 1 - dr.abs(2 * fraction(t) - 1)


def _parameter(text: str) -> Parameter:
    """Return the parameter that is written as `name`, `name:kind` or `name:kind=default`.

    The kind of a whole number is its range, such as `1-8`; an empty default means that the parameter is optional and
    has no default.
    """
    declared, equals, default = text.partition("=")
    name, _, kind = declared.partition(":")
    least, dash, most = kind.partition("-")
    optional, value = bool(equals), float(default) if default else None
    if dash:
        return Parameter(name, "whole", optional, value, int(least), int(most))
    known: Any = kind or "any"
    return Parameter(name, known, optional, value)


_SUM = f"p octaves:1-{noise.MOST_OCTAVES}=6 lacunarity:scalar=2 gain:scalar=0.5 time:scalar="

# Names, parameters as `_parameter` reads them, kind of the result, function, line for the manual, and parts if not 1.
_ROWS: tuple[tuple[Any, ...], ...] = (
    ("abs", "x", "any", dr.abs, "x without its sign"),
    ("sign", "x", "any", guarded.sign, "-1, 0 or 1: the sign of x"),
    ("floor", "x", "any", dr.floor, "the whole number at or below x"),
    ("ceil", "x", "any", dr.ceil, "the whole number at or above x"),
    ("round", "x", "any", dr.round, "the nearest whole number; halfway between two, the even one"),
    ("fract frac", "x", "any", fraction, "x - floor(x)"),
    ("mod", "a b", "any", guarded.remainder, "a % b, with the sign of b; 0 where b is 0"),
    ("min", "a b", "any", dr.minimum, "the smaller of two"),
    ("max", "a b", "any", dr.maximum, "the larger of two"),
    ("clamp", "x low high", "any", _clamp, "x clamped to [low, high]"),
    ("mix lerp", "a b amount", "any", _mix, "a where amount is 0, b where it is 1, linear between and beyond"),
    ("select", "condition:scalar a b", "any", _select, "a where the condition is not 0, else b"),
    ("step", "edge x", "any", lambda edge, x: truth(x >= edge, x), "0 below the edge, 1 from the edge on"),
    ("boxstep", "x edge", "any", lambda x, edge: truth(x >= edge, x), "step with SeExpr's order of arguments"),
    ("linearstep", "low high x", "any", _linearstep, "0 below low, 1 above high, linear between"),
    ("smoothstep", "low high x", "any", _shaped_step(_eased), "0 below low, 1 above high, smooth between"),
    ("gaussstep", "low high x", "any", _shaped_step(_bell), "0 below low, 1 above high, a Gaussian's flank between"),
    (
        "remap",
        "x source range falloff interpolation:0-2",
        "any",
        _remap,
        "1 where x is within range of source, falling to 0 over falloff: 0 linear, 1 smooth, 2 Gaussian (SeExpr)",
    ),
    ("fit", "x a1 b1 a2 b2", "any", _fit, "x mapped from [a1, b1] to [a2, b2], linear, not clamped"),
    ("bias", "x b", "any", _bias, "x ** (log(b) / log(0.5)): b above 0.5 raises the middle, b below 0.5 lowers it"),
    ("contrast gain", "x amount", "any", _contrast, "an S over [0, 1], steeper for amounts above 0.5, flatter below"),
    ("gamma", "x g", "any", _gamma, "x ** (1 / g); 0 for negative x"),
    ("pow", "x y", "any", power, "x ** y"),
    ("exp", "x", "any", guarded.exponential, "e ** x"),
    ("log", "x", "any", guarded.logarithm, "natural logarithm of x; below 1e-18, that of 1e-18"),
    ("sqrt", "x", "any", guarded.root, "square root; 0 for negative x"),
    ("sin", "x", "any", guarded.sine, "sine of x radians"),
    ("cos", "x", "any", guarded.cosine, "cosine of x radians"),
    ("tan", "x", "any", guarded.tangent, "tangent of x radians"),
    ("asin", "x", "any", guarded.arcsine, "angle in radians whose sine is x, with x clamped to -1 to 1"),
    ("acos", "x", "any", guarded.arccosine, "angle in radians whose cosine is x, with x clamped to -1 to 1"),
    ("atan", "x", "any", dr.atan, "angle in radians whose tangent is x"),
    ("atan2", "y x", "any", dr.atan2, "angle in radians from the x axis to (x, y)"),
    ("radians", "x", "any", lambda x: x * (math.pi / 180), "x degrees in radians"),
    ("degrees", "x", "any", lambda x: saturated(x * (180 / math.pi)), "x radians in degrees"),
    (
        "pulse",
        "t duty:scalar=0.5",
        "any",
        lambda t, duty: truth(fraction(t) < duty, t),
        "1 over the first part `duty` of each unit of t, else 0",
    ),
    ("triangle", "t", "any", _triangle, "0 at whole t, 1 halfway, linear between"),
    ("wave", "t", "any", _wave, "0 at whole t, 1 halfway, a cosine between"),
    ("vec", "x:scalar y:scalar z:scalar", "vector", _vector, "the vector [x, y, z]"),
    ("rgb", "r:scalar g:scalar b:scalar", "vector", _vector, "the colour [r, g, b]"),
    ("length", "v:vector", "scalar", guarded.length, "length of a vector"),
    ("dot", "a:vector b:vector", "scalar", guarded.dot, "scalar product"),
    ("cross", "a:vector b:vector", "vector", guarded.cross, "vector product"),
    ("normalize norm", "v:vector", "vector", guarded.normalized, "the vector scaled to length 1; 0 stays 0"),
    ("luminance", "c:vector", "scalar", _luminance, "Rec. 709 luminance of a colour"),
    ("hsv", "h:scalar s:scalar v:scalar", "vector", _hsv, "colour from hue (1 is a full turn), saturation and value"),
    ("hsvtorgb", "c:vector", "vector", lambda c: _hsv(c.x, c.y, c.z), "colour from a vector [h, s, v], as of hsv"),
    ("hash rand", "x seed:scalar=0", "scalar", noise.random, "a random number from 0 to 1 for each x and seed"),
    ("cellnoise", "p time:scalar=", "scalar", noise.cellnoise, "a random number from 0 to 1 in each unit cell"),
    ("noise", "p time:scalar=", "scalar", noise.noise, "smooth noise from 0 to 1", NOISE_PARTS),
    ("snoise", "p time:scalar=", "scalar", noise.snoise, "smooth noise from -1 to 1", NOISE_PARTS),
    ("vnoise", "p time:scalar=", "vector", noise.vnoise, "three smooth noises from -1 to 1", 3 * NOISE_PARTS),
    (
        "fbm",
        _SUM,
        "scalar",
        noise.fbm,
        "a sum of octaves of noise around 0.5, rarely outside of 0 to 1",
        NOISE_PARTS,
    ),
    ("turbulence", _SUM, "scalar", noise.turbulence, "a sum of octaves of creased noise, 0.5 or more", NOISE_PARTS),
)


def _declared(
    names: str, parameters: str, result: Literal["scalar", "vector", "any"], compute: Callable[..., Operand], doc: str,
    parts: int = 1,
) -> list[ExpressionFunction]:  # fmt: skip
    """Return the functions that a row declares, one for each of its names."""
    listed = tuple(map(_parameter, parameters.split()))
    return [ExpressionFunction(name, listed, result, doc, compute, parts) for name in names.split()]


FUNCTIONS: dict[str, ExpressionFunction] = {each.name: each for row in _ROWS for each in _declared(*row)}


def describe() -> str:
    """Return the tables of inputs, constants and functions as text, one entry a line."""
    inputs = [(name, f"{each.kind}: {each.doc}") for name, each in NAMES.items()]
    constants = [(name, f"scalar: {value:.6g}") for name, value in CONSTANTS.items()]
    functions = [(each.signature, each.doc) for each in FUNCTIONS.values()]
    rows = [*inputs, *constants, *functions]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:{width}}  {doc}" for name, doc in rows)
