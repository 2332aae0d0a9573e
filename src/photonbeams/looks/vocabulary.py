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
    """An input: the attribute of `ShadingContext` that holds it, its meaning, and its kind."""

    attribute: str
    doc: str
    kind: Kind = "scalar"


#: The inputs of expressions.
NAMES: dict[str, Input] = {
    "s": Input("fraction", "fraction of the light path: 0 at the light, 1 at its end"),
    "distance": Input("from_light", "distance from the light, in scene units"),
    "r": Input("radius", "fraction of the beam's radius: 0 on the axis, 1 at the rim"),
    "t": Input("to_camera", "distance to the camera, in scene units"),
    "angle": Input(
        "angle", "degrees between the light's direction and that to the camera: 0 is straight into the lens"
    ),
    "cosine": Input("cosine", "cosine of `angle`"),
    "P": Input("position", "position in the world", "vector"),
    "Pl": Input("local", "position in the light's own space", "vector"),
    "time": Input("time", "seconds"),
    "frame": Input("frame", "frame number, with a fraction within the shutter interval"),
    "random": Input("random", "a random number from 0 to 1, different for each beam"),
    "id": Input("id", "the beam's number"),
    "light": Input("light", "the number of the beam's light"),
    "generation": Input(
        "generation", "how many times the beam's light was scattered before: 0 is straight from the light"
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


def _vector(x: Operand, y: Operand, z: Operand) -> Operand:
    return vector_type(x)(x, y, z)


def _hsv(hue: Operand, saturation: Operand, value: Operand) -> Operand:
    """Return the colour of a hue (1 is a full turn), by each channel's distance in sextants."""

    def channel(offset: int) -> Operand:
        sextant = 6 * fraction(fraction(hue) + offset / 6)
        amount = dr.clip(dr.minimum(sextant, 4 - sextant), 0, 1)
        return times(value, 1 - times(saturation, amount))

    return _vector(channel(5), channel(3), channel(1))


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

# Names, parameters as `_parameter` reads them, function, line for the manual, and, if they are not "any" and 1, kind of
# the result and parts.
_ROWS: tuple[tuple[Any, ...], ...] = (
    ("abs", "x", dr.abs, "x without its sign"),
    ("sign", "x", lambda x: truth(x > 0, x) - truth(x < 0, x), "-1, 0 or 1: the sign of x"),
    ("floor", "x", dr.floor, "the whole number at or below x"),
    ("ceil", "x", dr.ceil, "the whole number at or above x"),
    ("round", "x", dr.round, "the nearest whole number; halfway between two, the even one"),
    ("fract frac", "x", fraction, "x - floor(x)"),
    ("mod", "a b", guarded.remainder, "a % b, with the sign of b; 0 where b is 0"),
    ("min", "a b", dr.minimum, "the smaller of two"),
    ("max", "a b", dr.maximum, "the larger of two"),
    ("clamp", "x low high", lambda x, low, high: dr.minimum(dr.maximum(x, low), high), "x clamped to [low, high]"),
    (
        "mix lerp",
        "a b amount",
        lambda a, b, amount: a + times(b - a, amount),
        "a where amount is 0, b where it is 1, linear between and beyond",
    ),
    (
        "select",
        "condition:scalar a b",
        lambda condition, a, b: dr.select(condition != 0, a, b),
        "a where the condition is not 0, else b",
    ),
    ("step", "edge x", lambda edge, x: truth(x >= edge, x), "0 below the edge, 1 from the edge on"),
    ("boxstep", "x edge", lambda x, edge: truth(x >= edge, x), "step with SeExpr's order of arguments"),
    ("linearstep", "low high x", _linearstep, "0 below low, 1 above high, linear between"),
    ("smoothstep", "low high x", _shaped_step(_eased), "0 below low, 1 above high, smooth between"),
    ("gaussstep", "low high x", _shaped_step(_bell), "0 below low, 1 above high, a Gaussian's flank between"),
    (
        "remap",
        "x source range falloff interpolation:0-2",
        _remap,
        "1 where x is within range of source, falling to 0 over falloff: 0 linear, 1 smooth, 2 Gaussian (SeExpr)",
    ),
    ("fit", "x a1 b1 a2 b2", _fit, "x mapped from [a1, b1] to [a2, b2], linear, not clamped"),
    ("bias", "x b", _bias, "x ** (log(b) / log(0.5)): b above 0.5 raises the middle, b below 0.5 lowers it"),
    ("contrast gain", "x amount", _contrast, "an S over [0, 1], steeper for amounts above 0.5, flatter below"),
    ("gamma", "x g", _gamma, "x ** (1 / g); 0 for negative x"),
    ("pow", "x y", power, "x ** y"),
    ("exp", "x", lambda x: saturated(dr.exp(x)), "e ** x"),
    ("log", "x", guarded.logarithm, "natural logarithm of x; below 1e-18, that of 1e-18"),
    ("sqrt", "x", lambda x: dr.sqrt(dr.maximum(x, 0)), "square root; 0 for negative x"),
    ("sin", "x", guarded.sine, "sine of x radians"),
    ("cos", "x", guarded.cosine, "cosine of x radians"),
    ("tan", "x", guarded.tangent, "tangent of x radians"),
    ("asin", "x", lambda x: dr.asin(dr.clip(x, -1, 1)), "angle in radians whose sine is x, with x clamped to -1 to 1"),
    (
        "acos",
        "x",
        lambda x: dr.acos(dr.clip(x, -1, 1)),
        "angle in radians whose cosine is x, with x clamped to -1 to 1",
    ),
    ("atan", "x", dr.atan, "angle in radians whose tangent is x"),
    ("atan2", "y x", dr.atan2, "angle in radians from the x axis to (x, y)"),
    ("radians", "x", lambda x: x * (math.pi / 180), "x degrees in radians"),
    ("degrees", "x", lambda x: saturated(x * (180 / math.pi)), "x radians in degrees"),
    (
        "pulse",
        "t duty:scalar=0.5",
        lambda t, duty: truth(fraction(t) < duty, t),
        "1 over the first part `duty` of each unit of t, else 0",
    ),
    ("triangle", "t", lambda t: 1 - dr.abs(2 * fraction(t) - 1), "0 at whole t, 1 halfway, linear between"),
    ("wave", "t", lambda t: 0.5 - 0.5 * dr.cos(2 * math.pi * fraction(t)), "0 at whole t, 1 halfway, a cosine between"),
    ("vec", "x:scalar y:scalar z:scalar", _vector, "the vector [x, y, z]", "vector"),
    ("rgb", "r:scalar g:scalar b:scalar", _vector, "the colour [r, g, b]", "vector"),
    ("length", "v:vector", guarded.length, "length of a vector", "scalar"),
    ("dot", "a:vector b:vector", guarded.dot, "scalar product", "scalar"),
    ("cross", "a:vector b:vector", guarded.cross, "vector product", "vector"),
    ("normalize norm", "v:vector", guarded.normalized, "the vector scaled to length 1; 0 stays 0", "vector"),
    (
        "luminance",
        "c:vector",
        lambda c: 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z,
        "Rec. 709 luminance of a colour",
        "scalar",
    ),
    ("hsv", "h:scalar s:scalar v:scalar", _hsv, "colour from hue (1 is a full turn), saturation and value", "vector"),
    ("hsvtorgb", "c:vector", lambda c: _hsv(c.x, c.y, c.z), "colour from a vector [h, s, v], as of hsv", "vector"),
    ("hash rand", "x seed:scalar=0", noise.random, "a random number from 0 to 1 for each x and seed", "scalar"),
    ("cellnoise", "p time:scalar=", noise.cellnoise, "a random number from 0 to 1 in each unit cell", "scalar"),
    ("noise", "p time:scalar=", noise.noise, "smooth noise from 0 to 1", "scalar", NOISE_PARTS),
    ("snoise", "p time:scalar=", noise.snoise, "smooth noise from -1 to 1", "scalar", NOISE_PARTS),
    ("vnoise", "p time:scalar=", noise.vnoise, "three smooth noises from -1 to 1", "vector", 3 * NOISE_PARTS),
    ("fbm", _SUM, noise.fbm, "a sum of octaves of noise around 0.5, rarely outside of 0 to 1", "scalar", NOISE_PARTS),
    ("turbulence", _SUM, noise.turbulence, "a sum of octaves of creased noise, 0.5 or more", "scalar", NOISE_PARTS),
)


def _declared(
    names: str, parameters: str, compute: Callable[..., Operand], doc: str,
    result: Literal["scalar", "vector", "any"] = "any", parts: int = 1,
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
