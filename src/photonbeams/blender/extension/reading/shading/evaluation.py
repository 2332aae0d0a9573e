"""Values of shader nodes at points: what the manual of Blender says of each node, over arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from ..images import MISSING, is_missing
from .links import linked_to
from .noise import fractal, hashed

_SAMPLES = 4096
_STEPS = 1025  # of tabulated curves and ramps
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class UnknownNodeError(Exception):
    """A node has no known value; the text is its name."""


@dataclass(frozen=True)
class Points:
    """Where nodes are evaluated: coordinates (N, 3) of each kind."""

    generated: Any
    object: Any
    uv: Any
    normal: Any
    facing: Any  # (N,) the cosine between the normal and the direction to the camera
    #: Colours (N, 4) of images that are known here, by their nodes.
    images: dict[Any, Any] = field(default_factory=dict)
    #: Whether the light that reaches the camera is wanted, and not that which lights the scene.
    seen: bool = True

    def __len__(self) -> int:
        return len(self.generated)


@cache
def anywhere() -> Points:
    """Return points of a surface of which nothing is known: their coordinates are spread evenly."""
    random = np.random.default_rng(0)
    unit = random.random((_SAMPLES, 3))
    normal = random.normal(size=(_SAMPLES, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Seen from afar, a convex body shows as much of each squared cosine.
    return Points(unit, 2 * unit - 1, random.random((_SAMPLES, 3)), normal, np.sqrt(random.random(_SAMPLES)))


def sky_points(directions: Any) -> Points:
    """Return the points of a world in directions (N, 3)."""
    return Points(directions, directions, directions, directions, np.ones(len(directions)), seen=False)


def inside_points(low: Any, high: Any) -> Points:
    """Return points in the bounding box of an object, in its own space."""
    unit = anywhere().generated
    found = low + unit * (np.asarray(high) - low)
    return Points(unit, found, unit, anywhere().normal, np.ones(len(unit)))


def evaluated(source: Any, points: Points | None = None) -> Any:
    """Return the values (N,), or the vectors or colours (N, 3), of a node's output at points, by default anywhere.

    Raises
    ------
    UnknownNodeError
        A node of another kind has an influence.
    """
    return Evaluation(points or anywhere()).output(source)


class Evaluation:
    """Values at some points; each node is evaluated once.

    Parameters
    ----------
    points
        Where.
    nodes
        The function of each type of node, by default `NODES`.
    """

    def __init__(self, points: Points, nodes: dict[str, Function] | None = None) -> None:
        self.points, self._nodes = points, nodes or NODES
        self._known: dict[Any, Any] = {}

    def output(self, source: Any) -> Any:
        """Return the values of an output."""
        groups = tuple(each.own.as_pointer() for each in getattr(source, "groups", ()))
        node = source.node
        key = (node.as_pointer(), source.identifier, groups)
        if key not in self._known:
            function = self._nodes.get(node.type)
            if function is None:
                raise UnknownNodeError(node.name)
            try:
                found = np.asarray(function(self, node, source), np.float64)
            except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:  # of another version
                raise UnknownNodeError(node.name) from error
            is_vector = source.type != "VALUE"
            if is_vector and (found.ndim < 2 or found.shape[1] == 1):
                found = np.repeat(found.reshape(-1, 1), 3, axis=1)
            elif not is_vector and found.ndim == 2:
                found = found @ _LUMINANCE if source.type == "RGBA" else found.mean(axis=1)
            self._known[key] = np.broadcast_to(found, (len(self.points), *found.shape[1:]))
        return self._known[key]

    def input(self, socket: Any) -> Any:
        """Return the values of an input, (N,) or (N, 3)."""
        source = linked_to(socket)
        if source is not None and source.is_output:
            found = self.output(source)
            if socket.type == "VALUE" and found.ndim == 2:
                return found @ _LUMINANCE if source.type == "RGBA" else found.mean(axis=1)
            return found if socket.type == "VALUE" or found.ndim == 2 else np.repeat(found[:, None], 3, axis=1)
        return self.own(source or socket)

    def own(self, socket: Any) -> Any:
        """Return the value that a socket has without a link, (N,) or (N, 3)."""
        value = np.asarray(socket.default_value, np.float64)
        value = value[:3] if value.ndim else value
        return np.broadcast_to(value, (len(self.points), *value.shape))

    def number(self, node: Any, name: str, otherwise: float = 0.0) -> Any:
        """Return the values (N,) of an input by its name."""
        socket = node.inputs.get(name)
        return np.full(len(self.points), otherwise) if socket is None else self.input(socket)

    def place(self, node: Any, name: str = "Vector") -> Any:
        """Return the coordinates (N, 3) of a texture."""
        socket = node.inputs.get(name)
        if socket is not None and socket.is_linked:
            return self.input(socket)
        return self.points.uv if node.type == "TEX_IMAGE" else self.points.generated


def _column(values: Any) -> Any:
    return np.reshape(values, (-1, 1))


def _constant(run: Evaluation, node: Any, source: Any) -> Any:
    return run.own(source)


def _enabled(node: Any) -> list[Any]:
    return [each for each in node.inputs if each.enabled]


# Colours.


def _hsv(color: Any) -> Any:
    """Return hue, saturation and value, (N, 3), of colours."""
    high, low = color.max(axis=1), color.min(axis=1)
    span = np.where(high > low, high - low, 1)
    r, g, b = color.T
    hue = np.select([high == low, high == r, high == g], [0 * r, (g - b) / span % 6, (b - r) / span + 2],
                    (r - g) / span + 4)  # fmt: skip
    return np.stack([hue / 6, np.where(high > 0, (high - low) / np.where(high == 0, 1, high), 0), high], axis=1)


def _rgb(hsv: Any) -> Any:
    hue, saturation, value = hsv.T
    turns = (hue[:, None] * 6 + np.array([0, 4, 2])) % 6
    pure = np.clip(np.abs(turns - 3) - 1, 0, 1)
    return value[:, None] * (1 + saturation[:, None] * (pure - 1))


def _of_hsv(first: Any, second: Any, taken: tuple[bool, bool, bool]) -> Any:
    """Return the first colours with some of hue, saturation and value of the second, if these have a hue."""
    a, b = _hsv(first), _hsv(second)
    mixed = _rgb(np.where(np.array(taken), b, a))
    return np.where(_column(b[:, 1] > 0) if taken[0] else True, mixed, first)


_BLENDS: dict[str, Callable[[Any, Any], Any]] = {
    "MIX": lambda a, b: b, "ADD": np.add, "MULTIPLY": np.multiply, "SUBTRACT": np.subtract,
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b),
    "DIVIDE": lambda a, b: np.where(b == 0, a, a / np.where(b == 0, 1, b)),
    "DIFFERENCE": lambda a, b: np.abs(a - b), "EXCLUSION": lambda a, b: np.maximum(a + b - 2 * a * b, 0),
    "DARKEN": np.minimum, "LIGHTEN": np.maximum,
    "OVERLAY": lambda a, b: np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b)),
    "DODGE": lambda a, b: np.where(a == 0, 0, np.where(b >= 1, 1, np.minimum(a / np.maximum(1 - b, 1e-9), 1))),
    "BURN": lambda a, b: np.where(b <= 0, 0, np.clip(1 - (1 - a) / np.maximum(b, 1e-9), 0, 1)),
    "SOFT_LIGHT": lambda a, b: (1 - a) * b * a + a * (1 - (1 - b) * (1 - a)),
    "LINEAR_LIGHT": lambda a, b: a + 2 * b - 1,
    "HUE": partial(_of_hsv, taken=(True, False, False)), "SATURATION": partial(_of_hsv, taken=(False, True, False)),
    "VALUE": partial(_of_hsv, taken=(False, False, True)), "COLOR": partial(_of_hsv, taken=(True, True, False)),
}  # fmt: skip


def _mix(run: Evaluation, node: Any, _source: Any) -> Any:
    if node.type == "MIX":
        factor, first, second = (run.input(each) for each in _enabled(node)[:3])
        blend = node.blend_type if node.data_type == "RGBA" else "MIX"
        clamps, bounded = node.clamp_factor, node.data_type == "RGBA" and node.clamp_result
    else:
        factor, first, second = (run.input(each) for each in node.inputs)
        blend, clamps, bounded = node.blend_type, True, node.use_clamp
    factor = np.clip(factor, 0, 1) if clamps else factor
    if first.ndim == 2 and factor.ndim == 1:
        factor = _column(factor)
    found = first + factor * (_BLENDS[blend](first, second) - first)
    return np.clip(found, 0, 1) if bounded else found


def _ramp(run: Evaluation, node: Any, source: Any) -> Any:
    at = np.linspace(0, 1, _STEPS)
    table = np.array([node.color_ramp.evaluate(each) for each in at])
    where = np.clip(run.input(node.inputs[0]), 0, 1)
    if source.name == "Alpha":
        return np.interp(where, at, table[:, 3])
    return np.stack([np.interp(where, at, table[:, k]) for k in range(3)], axis=1)


def _curves(run: Evaluation, node: Any, _source: Any) -> Any:
    node.mapping.initialize()
    factor, value = run.input(node.inputs[0]), run.input(node.inputs[1])
    curves = node.mapping.curves
    low, high = (-1.0, 1.0) if node.type == "CURVE_VEC" else (0.0, 1.0)
    if value.ndim == 1:
        return value + factor * (_through(node.mapping, curves[0], value, low, high) - value)
    shared = value
    if node.type == "CURVE_RGB":  # the last one is of all channels, and first
        shared = _through(node.mapping, curves[3], value, low, high)
    changed = [_through(node.mapping, curves[k], shared[:, k], low, high) for k in range(3)]
    return value + _column(factor) * (np.stack(changed, axis=1) - value)


def _through(mapping: Any, curve: Any, values: Any, low: float, high: float) -> Any:
    at = np.linspace(low, high, _STEPS)
    return np.interp(values, at, [mapping.evaluate(curve, each) for each in at])


def _hue_saturation(run: Evaluation, node: Any, _source: Any) -> Any:
    color = run.input(node.inputs["Color"])
    factor = run.number(node, "Factor" if "Factor" in node.inputs else "Fac", 1.0)
    hue, saturation, value = _hsv(np.maximum(color, 0)).T
    hue = (hue + run.number(node, "Hue", 0.5) + 0.5) % 1
    saturation = np.clip(saturation * run.number(node, "Saturation", 1.0), 0, 1)
    changed = np.maximum(_rgb(np.stack([hue, saturation, value * run.number(node, "Value", 1.0)], axis=1)), 0)
    return color + _column(factor) * (changed - color)


def _bright_contrast(run: Evaluation, node: Any, _source: Any) -> Any:
    bright, contrast = (_column(run.number(node, each)) for each in ("Bright", "Contrast"))
    return np.maximum((1 + contrast) * run.input(node.inputs["Color"]) + bright - 0.5 * contrast, 0)


def _gamma(run: Evaluation, node: Any, _source: Any) -> Any:
    color = run.input(node.inputs["Color"])
    return np.where(color > 0, np.maximum(color, 1e-30) ** _column(run.number(node, "Gamma", 1.0)), color)


def _invert(run: Evaluation, node: Any, _source: Any) -> Any:
    factor, color = run.input(node.inputs[0]), run.input(node.inputs[1])
    return color + _column(factor) * (1 - 2 * color)


def _separated(run: Evaluation, node: Any, source: Any) -> Any:
    value, place = run.input(node.inputs[0]), [each.name for each in node.outputs].index(source.name)
    mode = getattr(node, "mode", "RGB")
    if mode == "HSL":
        raise UnknownNodeError(node.name)
    return (_hsv(value) if mode == "HSV" or node.type == "SEPHSV" else value)[:, place]


def _combined(run: Evaluation, node: Any, _source: Any) -> Any:
    value = np.stack([run.input(each) for each in list(node.inputs)[:3]], axis=1)
    if getattr(node, "mode", "RGB") == "HSL":
        raise UnknownNodeError(node.name)
    return _rgb(value) if getattr(node, "mode", "RGB") == "HSV" or node.type == "COMBHSV" else value


def _blackbody(run: Evaluation, node: Any, _source: Any) -> Any:
    """Return a black body's colour of luminance 1, by Planck's law at three wavelengths, which is about right."""
    kelvin = np.clip(run.input(node.inputs[0]), 800, 12000)[:, None]
    waves = np.array([612e-9, 549e-9, 465e-9])  # of the primaries of Rec. 709
    shine = waves**-5.0 / np.expm1(0.014388 / (waves * kelvin))
    white = waves**-5.0 / np.expm1(0.014388 / (waves * 6500.0))
    found = shine / white
    return found / (found @ _LUMINANCE)[:, None]


# Numbers and vectors.

_MATH: dict[str, Callable[..., Any]] = {
    "ADD": lambda a, b, c: a + b, "SUBTRACT": lambda a, b, c: a - b, "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: np.where(b == 0, 0, a / np.where(b == 0, 1, b)),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c, "POWER": lambda a, b, c: np.nan_to_num(np.float_power(a, b)),
    "LOGARITHM": lambda a, b, c: np.where((a > 0) & (b > 0), _log(a) / np.where(b == 1, 1, _log(b)), 0),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)), "INVERSE_SQRT": lambda a, b, c: np.maximum(a, 1e-12) ** -0.5,
    "ABSOLUTE": lambda a, b, c: np.abs(a), "EXPONENT": lambda a, b, c: np.exp(np.minimum(a, 80)),
    "MINIMUM": lambda a, b, c: np.minimum(a, b), "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: 1.0 * (a < b), "GREATER_THAN": lambda a, b, c: 1.0 * (a > b),
    "SIGN": lambda a, b, c: np.sign(a), "COMPARE": lambda a, b, c: 1.0 * (np.abs(a - b) <= np.maximum(c, 1e-5)),
    "ROUND": lambda a, b, c: np.floor(a + 0.5), "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a), "TRUNC": lambda a, b, c: np.trunc(a), "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: np.where(b == 0, 0, np.fmod(a, np.where(b == 0, 1, b))),
    "FLOORED_MODULO": lambda a, b, c: np.where(b == 0, 0, np.mod(a, np.where(b == 0, 1, b))),
    "SNAP": lambda a, b, c: np.where(b == 0, 0, np.floor(a / np.where(b == 0, 1, b)) * b),
    "PINGPONG": lambda a, b, c: np.where(b == 0, 0, np.abs(np.mod(a - b, 2 * np.where(b == 0, 1, b)) - b)),
    "WRAP": lambda a, b, c: np.where(b == c, c, np.mod(a - c, np.where(b == c, 1, b - c)) + c),
    "SINE": lambda a, b, c: np.sin(a), "COSINE": lambda a, b, c: np.cos(a), "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1, 1)), "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1, 1)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a), "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a), "COSH": lambda a, b, c: np.cosh(a), "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a), "DEGREES": lambda a, b, c: np.degrees(a),
    "SMOOTH_MIN": lambda a, b, c: np.minimum(a, b), "SMOOTH_MAX": lambda a, b, c: np.maximum(a, b),
}  # fmt: skip


def _log(value: Any) -> Any:
    return np.log(np.maximum(value, 1e-30))


def _math(run: Evaluation, node: Any, _source: Any) -> Any:
    sides = [run.input(each) for each in node.inputs]
    found = _MATH[node.operation](*sides)
    return np.clip(found, 0, 1) if node.use_clamp else found


def _falloff(run: Evaluation, node: Any, source: Any) -> Any:
    """Return the strength of a lamp whose light falls with the square of the distance, as all light does here."""
    if source.name != "Quadratic" or np.any(run.number(node, "Smooth") > 0):
        raise UnknownNodeError(f"{source.name} of {node.name}")
    return run.number(node, "Strength")


def _length(value: Any) -> Any:
    return np.linalg.norm(value, axis=1)


_VECTORS: dict[str, Callable[..., Any]] = {
    "SCALE": lambda a, b, c, s: a * s[:, None], "LENGTH": lambda a, b, c, s: _length(a),
    "DISTANCE": lambda a, b, c, s: _length(a - b), "DOT_PRODUCT": lambda a, b, c, s: (a * b).sum(axis=1),
    "CROSS_PRODUCT": lambda a, b, c, s: np.cross(a, b),
    "NORMALIZE": lambda a, b, c, s: a / np.maximum(_length(a), 1e-30)[:, None],
}  # fmt: skip


def _vector_math(run: Evaluation, node: Any, _source: Any) -> Any:
    a, b, c = (run.input(each) for each in list(node.inputs)[:3])
    if node.operation in _VECTORS:
        return _VECTORS[node.operation](a, b, c, run.number(node, "Scale", 1.0))
    if node.operation not in _MATH:
        raise UnknownNodeError(node.name)
    return _MATH[node.operation](a, b, c)


def _map_range(run: Evaluation, node: Any, _source: Any) -> Any:
    if node.data_type != "FLOAT":
        raise UnknownNodeError(node.name)
    value, low, high, to_low, to_high = (run.input(each) for each in _enabled(node)[:5])
    t = (value - low) / np.where(high == low, 1, high - low)
    if node.interpolation_type == "STEPPED":
        steps = np.maximum(run.input(_enabled(node)[5]), 1e-9)
        t = np.floor(t * (steps + 1)) / steps
    elif node.interpolation_type != "LINEAR":
        t = np.clip(t, 0, 1)
        t = t * t * (3 - 2 * t) if node.interpolation_type == "SMOOTHSTEP" else t**3 * (t * (6 * t - 15) + 10)
    return to_low + (np.clip(t, 0, 1) if node.clamp else t) * (to_high - to_low)


def _clamp(run: Evaluation, node: Any, _source: Any) -> Any:
    value, first, second = (run.input(each) for each in node.inputs)
    low, high = (
        (np.minimum(first, second), np.maximum(first, second)) if node.clamp_type == "RANGE" else (first, second)
    )
    return np.minimum(np.maximum(value, low), high)


def _mapping(run: Evaluation, node: Any, _source: Any) -> Any:
    value = run.place(node)
    location, rotation, scale = (run.number(node, name, 0.0 if name != "Scale" else 1.0)[:1]
                                 for name in ("Location", "Rotation", "Scale"))  # fmt: skip
    location, rotation, scale = (np.broadcast_to(_column(each) if each.ndim == 1 else each, (1, 3))
                                 for each in (location, rotation, scale))  # fmt: skip
    turn = _turn(rotation[0])
    match node.vector_type:
        case "POINT":
            return (value * scale) @ turn.T + location
        case "TEXTURE":
            return ((value - location) @ turn) / np.where(scale == 0, 1, scale)
        case "VECTOR":
            return (value * scale) @ turn.T
    found = (value / np.where(scale == 0, 1, scale)) @ turn.T
    return found / np.maximum(_length(found), 1e-30)[:, None]


def _turn(angles: Any) -> Any:
    """Return the matrix of Euler angles, about X first."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @ about_y @ about_x


# What is known of a point.


def _coordinates(run: Evaluation, node: Any, source: Any) -> Any:
    points = run.points
    return {"Generated": points.generated, "UV": points.uv, "Normal": points.normal}.get(source.name, points.object)


def _geometry(run: Evaluation, node: Any, source: Any) -> Any:
    if source.name in ("Backfacing", "Pointiness"):
        return np.full(len(run.points), 0.0 if source.name == "Backfacing" else 0.5)
    return run.points.normal if "ormal" in source.name or source.name == "Incoming" else run.points.object


def _light_path(run: Evaluation, node: Any, source: Any) -> Any:
    camera = source.name in ("Is Camera Ray", "Is Transmission Ray")
    diffuse = source.name in ("Is Diffuse Ray", "Is Reflection Ray", "Diffuse Depth", "Ray Depth")
    return np.full(len(run.points), float(camera if run.points.seen else diffuse))


def _facing(run: Evaluation, node: Any, source: Any) -> Any:
    if node.type == "FRESNEL":
        return _dielectric(run.points.facing, np.maximum(run.number(node, "IOR", 1.5), 1e-5))
    blend = np.clip(run.number(node, "Blend", 0.5), 0, 1 - 1e-5)
    if source.name == "Fresnel":
        return _dielectric(run.points.facing, 1 / np.maximum(1 - blend, 1e-5))
    return 1 - run.points.facing ** np.where(blend < 0.5, 2 * blend, 0.5 / (1 - blend))


def _dielectric(cosine: Any, eta: Any) -> Any:
    """Return Fresnel's reflectance."""
    inner = np.sqrt(np.maximum(eta**2 - 1 + cosine**2, 0))
    a = (inner - cosine) / (inner + cosine)
    b = (cosine * (inner + cosine) - 1) / (cosine * (inner - cosine) + 1)
    return np.where(eta**2 - 1 + cosine**2 > 0, 0.5 * a**2 * (1 + b**2), 1)


def _occlusion(run: Evaluation, node: Any, source: Any) -> Any:
    return run.input(node.inputs["Color"]) if source.name == "Color" else np.ones(len(run.points))


# Textures.


def _noise(run: Evaluation, node: Any, source: Any) -> Any:
    detail, roughness, lacunarity = (run.number(node, each, other) for each, other in
                                     (("Detail", 2.0), ("Roughness", 0.5), ("Lacunarity", 2.0)))  # fmt: skip
    place = run.place(node) * _column(run.number(node, "Scale", 5.0))
    if node.noise_dimensions == "1D":
        place = np.zeros_like(place)
    if node.noise_dimensions in ("1D", "4D"):
        place = place + _column(run.number(node, "W")) * 1.37
    octaves = float(detail.mean())
    parts = [fractal(place + shift, octaves, roughness, lacunarity)
             for shift in (0.0, 143.7, 271.3)[: 1 if source.type == "VALUE" else 3]]  # fmt: skip
    return parts[0] if len(parts) == 1 else np.stack(parts, axis=1)


def _voronoi(run: Evaluation, node: Any, source: Any) -> Any:
    """Return what the nearest of points that are one in each cell has: its distance or colour."""
    place = run.place(node) * _column(run.number(node, "Scale", 5.0))
    if source.name not in ("Distance", "Color"):
        raise UnknownNodeError(node.name)
    cell, spread = np.floor(place).astype(np.int64), run.number(node, "Randomness", 1.0)[:, None]
    nearest, color, second = np.full(len(place), np.inf), np.zeros((len(place), 3)), np.full(len(place), np.inf)
    for each in np.ndindex(3, 3, 3):
        around = cell + each - 1
        random = np.stack([hashed(around + 31 * k) for k in range(1, 4)], axis=1) / 2.0**32
        away = _length(around + spread * random - place)
        closer = away < nearest
        second = np.where(closer, nearest, np.minimum(second, away))
        nearest, color = np.where(closer, away, nearest), np.where(closer[:, None], random, color)
    return color if source.name == "Color" else second if node.feature == "F2" else nearest


def _checker(run: Evaluation, node: Any, source: Any) -> Any:
    place = run.place(node) * _column(run.number(node, "Scale", 5.0))
    odd = np.floor((place + 1e-6) * 0.999999).astype(int).sum(axis=1) % 2 == 0
    if source.type == "VALUE":
        return 1.0 * odd
    return np.where(odd[:, None], run.input(node.inputs["Color1"]), run.input(node.inputs["Color2"]))


def _brick(run: Evaluation, node: Any, source: Any) -> Any:
    place = run.place(node) * _column(run.number(node, "Scale", 5.0))
    wide, high = run.number(node, "Brick Width", 0.5), run.number(node, "Row Height", 0.25)
    row = np.floor(place[:, 1] / high)
    shift = np.where(row % max(node.offset_frequency, 1) == 0, node.offset * wide, 0)
    x, y = (place[:, 0] + shift) % wide, place[:, 1] - row * high
    edge = run.number(node, "Mortar Size", 0.02)
    mortar = np.minimum(np.minimum(x, wide - x), np.minimum(y, high - y)) < edge
    if source.type == "VALUE":
        return 1.0 * mortar
    number = np.stack([np.floor((place[:, 0] + shift) / wide), row, 0 * row], axis=1).astype(np.int64)
    tint = np.clip(hashed(number) / 2.0**32 + run.number(node, "Bias"), 0, 1)[:, None]
    first, second, between = (run.input(node.inputs[each]) for each in ("Color1", "Color2", "Mortar"))
    return np.where(mortar[:, None], between, first + tint * (second - first))


def _gradient(run: Evaluation, node: Any, source: Any) -> Any:
    x, y, z = run.place(node).T
    ball = np.maximum(1 - np.sqrt(x * x + y * y + z * z), 0)
    found = {
        "LINEAR": x, "QUADRATIC": np.maximum(x, 0) ** 2, "DIAGONAL": (x + y) / 2, "SPHERICAL": ball,
        "EASING": (t := np.clip(x, 0, 1)) * t * (3 - 2 * t), "QUADRATIC_SPHERE": ball**2,
        "RADIAL": np.arctan2(y, x) / (2 * np.pi) + 0.5,
    }[node.gradient_type]  # fmt: skip
    return np.clip(found, 0, 1)


def _wave(run: Evaluation, node: Any, source: Any) -> Any:
    place = run.place(node) * _column(run.number(node, "Scale", 5.0))
    if node.wave_type == "BANDS":
        axis = {"X": [20, 0, 0], "Y": [0, 20, 0], "Z": [0, 0, 20]}.get(node.bands_direction, [10, 10, 10])
        phase = place @ np.array(axis)
    else:
        away = {"X": [0, 1, 1], "Y": [1, 0, 1], "Z": [1, 1, 0]}.get(node.rings_direction, [1, 1, 1])
        phase = 20 * _length(place * away)
    phase = phase + run.number(node, "Phase Offset")
    bent = run.number(node, "Distortion")
    if np.any(bent != 0):
        detail = float(run.number(node, "Detail", 2.0).mean())
        scale = _column(run.number(node, "Detail Scale", 1.0))
        phase = phase + bent * (2 * fractal(place * scale, detail, run.number(node, "Detail Roughness", 0.5), 2.0) - 1)
    turns = phase / (2 * np.pi)
    match node.wave_profile:
        case "SIN":
            return 0.5 + 0.5 * np.sin(phase - np.pi / 2)
        case "SAW":
            return turns - np.floor(turns)
    return 2 * np.abs(turns - np.floor(turns + 0.5))


def _white_noise(run: Evaluation, node: Any, source: Any) -> Any:
    cells = np.floor(run.place(node) * 2.0**20).astype(np.int64)
    parts = [hashed(cells + 77 * k) / 2.0**32 for k in range(1 if source.type == "VALUE" else 3)]
    return parts[0] if len(parts) == 1 else np.stack(parts, axis=1)


def _image(run: Evaluation, node: Any, source: Any) -> Any:
    known = run.points.images.get(node.as_pointer())
    if known is None:
        pixels = pixels_of(node.image)
        if pixels is None and node.image is not None and is_missing(node.image):
            pixels = np.array([[[*MISSING, 1.0]]])
        if pixels is None:
            raise UnknownNodeError(node.name)
        height, width = pixels.shape[:2]
        u, v = run.place(node)[:, :2].T
        column, row = ((each * size).astype(np.int64) % size for each, size in ((u, width), (v, height)))
        known = pixels[row, column]
    return known[:, 3] if source.name == "Alpha" else known[:, :3]


def _environment(run: Evaluation, node: Any, source: Any) -> Any:
    pixels = pixels_of(node.image)
    if pixels is None or node.projection != "EQUIRECTANGULAR":
        raise UnknownNodeError(node.name)
    x, y, z = run.place(node).T
    height, width = pixels.shape[:2]
    u = np.arctan2(y, -x) / (2 * np.pi) + 0.5
    v = np.arctan2(z, np.hypot(x, y)) / np.pi + 0.5
    return pixels[np.clip((v * height).astype(int), 0, height - 1), (u * width).astype(int) % width, :3]


def pixels_of(image: Any) -> Any:
    """Return the scene-linear pixels (H, W, 4) of an image, from the bottom row up; None if it has none."""
    if image is None or not image.size[0] or image.channels not in (3, 4):
        return None
    flat = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    found = flat.reshape(image.size[1], image.size[0], image.channels)
    if image.channels == 3:
        found = np.concatenate([found, np.ones_like(found[..., :1])], axis=-1)
    if not image.is_float and not image.colorspace_settings.is_data and image.colorspace_settings.name == "sRGB":
        color = found[..., :3]
        found[..., :3] = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    return found


def _through_input(name: str) -> Callable[..., Any]:
    return lambda run, node, source: run.input(node.inputs[name])


#: By the type of a node: the function of the values of its output.
Function = Callable[[Evaluation, Any, Any], Any]
NODES: dict[str, Function] = {
    "RGB": _constant, "VALUE": _constant, "MIX": _mix, "MIX_RGB": _mix, "VALTORGB": _ramp, "CURVE_RGB": _curves,
    "CURVE_VEC": _curves, "CURVE_FLOAT": _curves, "HUE_SAT": _hue_saturation, "BRIGHTCONTRAST": _bright_contrast,
    "GAMMA": _gamma, "INVERT": _invert, "RGBTOBW": _through_input("Color"), "SEPARATE_COLOR": _separated,
    "COMBINE_COLOR": _combined, "SEPRGB": _separated, "COMBRGB": _combined, "SEPHSV": _separated, "COMBHSV": _combined,
    "SEPXYZ": _separated, "COMBXYZ": _combined, "BLACKBODY": _blackbody, "MATH": _math, "VECT_MATH": _vector_math,
    "MAP_RANGE": _map_range, "CLAMP": _clamp, "MAPPING": _mapping, "TEX_COORD": _coordinates,
    "UVMAP": lambda run, node, source: run.points.uv, "NEW_GEOMETRY": _geometry, "LIGHT_PATH": _light_path,
    "LAYER_WEIGHT": _facing, "FRESNEL": _facing, "AMBIENT_OCCLUSION": _occlusion, "TEX_NOISE": _noise,
    "TEX_VORONOI": _voronoi, "TEX_CHECKER": _checker, "TEX_BRICK": _brick, "TEX_GRADIENT": _gradient, "TEX_WAVE": _wave,
    "TEX_WHITE_NOISE": _white_noise, "TEX_IMAGE": _image, "TEX_ENVIRONMENT": _environment,
    "LIGHT_FALLOFF": _falloff,
}  # fmt: skip
