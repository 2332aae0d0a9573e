"""Nodes of colours, numbers and vectors, and of points: what the manual of Blender says of each, over arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from mathutils import Euler

from .calls import Call, Functions, UnknownNodeError, of_inputs, own_value

LUMINANCE = np.array([[0.2126], [0.7152], [0.0722]])
_STEPS = 1025  # of tabulated curves and ramps


def _hsv(color: Any) -> tuple[Any, ...]:
    """Return the hue, the saturation and the value, (N, 1) each, of colours."""
    r, g, b = np.split(color, 3, axis=1)
    high, low = color.max(axis=1, keepdims=True), color.min(axis=1, keepdims=True)
    span = np.where(high > low, high - low, 1)
    turns = np.select([high == low, high == r, high == g], [0 * r, (g - b) / span % 6, (b - r) / span + 2],
                      (r - g) / span + 4)  # fmt: skip
    return turns / 6, np.where(high > 0, (high - low) / high, 0), high


def _rgb(hue: Any, saturation: Any, value: Any) -> Any:
    pure = np.clip(np.abs((hue * 6 + np.array([0, 4, 2])) % 6 - 3) - 1, 0, 1)
    return value * (1 + saturation * (pure - 1))


def _of_hsv(first: Any, second: Any, taken: str) -> Any:
    """Return the first colours with some of hue, saturation and value of the second, if these have a hue."""
    theirs = _hsv(second)
    parts = [b if letter in taken else a for letter, a, b in zip("hsv", _hsv(first), theirs, strict=True)]
    return np.where((theirs[1] > 0) | ("h" not in taken), _rgb(*parts), first)


_BLENDS: dict[str, Callable[[Any, Any], Any]] = {
    "MIX": lambda a, b: b, "ADD": np.add, "MULTIPLY": np.multiply, "SUBTRACT": np.subtract,
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b), "DIVIDE": lambda a, b: np.where(b == 0, a, a / b),
    "DIFFERENCE": lambda a, b: np.abs(a - b), "EXCLUSION": lambda a, b: np.maximum(a + b - 2 * a * b, 0),
    "DARKEN": np.minimum, "LIGHTEN": np.maximum,
    "OVERLAY": lambda a, b: np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b)),
    "DODGE": lambda a, b: np.where(a == 0, 0, np.where(b >= 1, 1, np.minimum(a / (1 - b), 1))),
    "BURN": lambda a, b: np.where(b <= 0, 0, np.clip(1 - (1 - a) / b, 0, 1)),
    "SOFT_LIGHT": lambda a, b: (1 - a) * b * a + a * (1 - (1 - b) * (1 - a)),
    "LINEAR_LIGHT": lambda a, b: a + 2 * b - 1,
    "HUE": partial(_of_hsv, taken="h"), "SATURATION": partial(_of_hsv, taken="s"),
    "VALUE": partial(_of_hsv, taken="v"), "COLOR": partial(_of_hsv, taken="hs"),
}  # fmt: skip


def _mix(call: Call) -> Any:
    node, (factor, first, second) = call.node, call.inputs()
    is_color = getattr(node, "data_type", "RGBA") == "RGBA"  # as of the older node MixRGB
    blend = _BLENDS[node.blend_type if is_color else "MIX"]
    factor = np.clip(factor, 0, 1) if getattr(node, "clamp_factor", True) else factor
    mixed = first + factor * (blend(first, second) - first)
    is_bounded = is_color and getattr(node, "clamp_result" if node.type == "MIX" else "use_clamp")
    return np.clip(mixed, 0, 1) if is_bounded else mixed


def _ramp(call: Call) -> Any:
    at = np.linspace(0, 1, _STEPS)
    table = np.array([call.node.color_ramp.evaluate(each) for each in at])
    (factor,) = call.inputs()
    channels = table[:, 3:] if call.output == "Alpha" else table[:, :3]
    return np.stack([np.interp(factor[:, 0], at, each) for each in channels.T], axis=1)


def _curves(call: Call) -> Any:
    mapping, (factor, value) = call.node.mapping, call.inputs()
    mapping.initialize()
    at = np.linspace(-1.0 if call.node.type == "CURVE_VEC" else 0.0, 1.0, _STEPS)

    def through(curve: Any, numbers: Any) -> Any:
        return np.interp(numbers, at, [mapping.evaluate(curve, each) for each in at])

    # The last curve of colours is of all channels, and first.
    shared = through(mapping.curves[3], value) if call.node.type == "CURVE_RGB" else value
    changed = [through(curve, channel) for curve, channel in zip(mapping.curves, shared.T, strict=False)]
    return value + factor * (np.stack(changed, axis=1) - value)


def _hue_saturation(turn: Any, saturated: Any, brighter: Any, factor: Any, color: Any) -> Any:
    hue, saturation, value = _hsv(np.maximum(color, 0))
    changed = _rgb((hue + turn + 0.5) % 1, np.clip(saturation * saturated, 0, 1), value * brighter)
    return color + factor * (np.maximum(changed, 0) - color)


def _separated(call: Call) -> Any:
    (value,), mode = call.inputs(), getattr(call.node, "mode", "RGB")
    if mode == "HSL":
        raise call.unknown()
    parts = _hsv(value) if mode == "HSV" else np.split(value, 3, axis=1)
    return parts[[each.name for each in call.node.outputs].index(call.output)]


def _combined(call: Call) -> Any:
    parts, mode = call.inputs(), getattr(call.node, "mode", "RGB")
    if mode == "HSL":
        raise call.unknown()
    return _rgb(*parts) if mode == "HSV" else np.hstack(np.broadcast_arrays(*parts))


def _blackbody(kelvin: Any) -> Any:
    """Return a black body's colour of luminance 1, by Planck's law at three wavelengths, which is about right."""
    waves = np.array([612e-9, 549e-9, 465e-9])  # of the primaries of Rec. 709
    shine = np.expm1(0.014388 / (waves * 6500.0)) / np.expm1(0.014388 / (waves * np.clip(kelvin, 800, 12000)))
    return shine / (shine @ LUMINANCE)


COLORS: Functions = {
    "MIX": _mix, "MIX_RGB": _mix, "VALTORGB": _ramp, "CURVE_RGB": _curves, "CURVE_VEC": _curves, "CURVE_FLOAT": _curves,
    "HUE_SAT": of_inputs(_hue_saturation),
    "BRIGHTCONTRAST": of_inputs(lambda color, bright, contrast: np.maximum(
        (1 + contrast) * color + bright - 0.5 * contrast, 0)),
    "GAMMA": of_inputs(lambda color, gamma: np.where(color > 0, color**gamma, color)),
    "INVERT": of_inputs(lambda factor, color: color + factor * (1 - 2 * color)),
    "RGBTOBW": of_inputs(lambda color: color @ LUMINANCE),
    "SEPARATE_COLOR": _separated, "SEPXYZ": _separated, "COMBINE_COLOR": _combined, "COMBXYZ": _combined,
    "BLACKBODY": of_inputs(_blackbody),
}  # fmt: skip


def length_of(vectors: Any) -> Any:
    """Return the lengths (N, 1) of vectors."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


_MATH: dict[str, Callable[..., Any]] = {
    "ADD": np.add, "SUBTRACT": np.subtract, "MULTIPLY": np.multiply, "DIVIDE": np.divide, "POWER": np.float_power,
    "MULTIPLY_ADD": lambda a, b, c: a * b + c, "LOGARITHM": lambda a, b: np.log(a) / np.log(b),
    "SQRT": np.sqrt, "INVERSE_SQRT": lambda a: 1 / np.sqrt(a), "ABSOLUTE": np.abs,
    "EXPONENT": lambda a: np.exp(np.minimum(a, 80)), "MINIMUM": np.minimum, "MAXIMUM": np.maximum, "LESS_THAN": np.less,
    "GREATER_THAN": np.greater, "SIGN": np.sign, "COMPARE": lambda a, b, c: np.abs(a - b) <= np.maximum(c, 1e-5),
    "ROUND": lambda a: np.floor(a + 0.5), "FLOOR": np.floor, "CEIL": np.ceil, "TRUNC": np.trunc,
    "FRACT": lambda a: a - np.floor(a), "MODULO": np.fmod, "FLOORED_MODULO": np.mod,
    "SNAP": lambda a, b: np.floor(a / b) * b, "PINGPONG": lambda a, b: np.abs(np.mod(a - b, 2 * b) - b),
    "WRAP": lambda a, b, c: np.where(b == c, c, np.mod(a - c, b - c) + c),
    "SINE": np.sin, "COSINE": np.cos, "TANGENT": np.tan, "ARCSINE": lambda a: np.arcsin(np.clip(a, -1, 1)),
    "ARCCOSINE": lambda a: np.arccos(np.clip(a, -1, 1)), "ARCTANGENT": np.arctan, "ARCTAN2": np.arctan2,
    "SINH": np.sinh, "COSH": np.cosh, "TANH": np.tanh, "RADIANS": np.radians, "DEGREES": np.degrees,
    "SMOOTH_MIN": lambda a, b, _: np.minimum(a, b), "SMOOTH_MAX": lambda a, b, _: np.maximum(a, b),
    "SCALE": np.multiply, "LENGTH": length_of, "DISTANCE": lambda a, b: length_of(a - b), "CROSS_PRODUCT": np.cross,
    "DOT_PRODUCT": lambda a, b: (a * b).sum(axis=1, keepdims=True), "NORMALIZE": lambda a: a / length_of(a),
}  # fmt: skip


def _math(call: Call) -> Any:
    value = _MATH[call.node.operation](*call.inputs())
    return np.clip(value, 0, 1) if getattr(call.node, "use_clamp", False) else value


def _falloff(call: Call) -> Any:
    """Return the strength of a lamp whose light falls with the square of the distance, as all light does here."""
    if call.output != "Quadratic" or np.any(call["Smooth"] > 0):
        raise UnknownNodeError(f"{call.output} of {call.node.name}")
    return call["Strength"]


def _map_range(call: Call) -> Any:
    node, (value, low, high, to_low, to_high, *steps) = call.node, call.inputs()
    if node.data_type != "FLOAT":
        raise call.unknown()
    t = (value - low) / np.where(high == low, 1, high - low)
    match node.interpolation_type:
        case "STEPPED":
            t = np.floor(t * (steps[0] + 1)) / steps[0]
        case "SMOOTHSTEP":
            t = np.clip(t, 0, 1)
            t = t * t * (3 - 2 * t)
        case "SMOOTHERSTEP":
            t = np.clip(t, 0, 1)
            t = t**3 * (t * (6 * t - 15) + 10)
    return to_low + (np.clip(t, 0, 1) if node.clamp else t) * (to_high - to_low)


def _clamp(call: Call) -> Any:
    value, low, high = call.inputs()
    if call.node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.clip(value, low, high)


def _mapping(call: Call) -> Any:
    value = call.place()
    location, rotation, scale = (call[name][:1] for name in ("Location", "Rotation", "Scale"))
    turn = np.array(Euler(rotation[0]).to_matrix())
    match call.node.vector_type:
        case "POINT":
            return (value * scale) @ turn.T + location
        case "TEXTURE":
            return (value - location) @ turn / scale
        case "VECTOR":
            return (value * scale) @ turn.T
    turned = (value / scale) @ turn.T
    return turned / length_of(turned)


# What is known of a point.


def _coordinates(call: Call) -> Any:
    points = call.points
    return {"Generated": points.generated, "UV": points.uv, "Normal": points.normal}.get(call.output, points.object)


def _geometry(call: Call) -> Any:
    if call.is_number:
        return 0.5 if call.output == "Pointiness" else 0.0
    return call.points.normal if "ormal" in call.output or call.output == "Incoming" else call.points.object


def _light_path(call: Call) -> Any:
    camera = call.output in ("Is Camera Ray", "Is Transmission Ray")
    diffuse = call.output in ("Is Diffuse Ray", "Is Reflection Ray", "Diffuse Depth", "Ray Depth")
    return camera if call.points.seen else diffuse


def _layer_weight(call: Call) -> Any:
    blend = np.clip(call["Blend"], 0, 1 - 1e-5)
    if call.output == "Fresnel":
        return _dielectric(call.points.facing, 1 / (1 - blend))
    return 1 - call.points.facing ** np.where(blend < 0.5, 2 * blend, 0.5 / (1 - blend))


def _dielectric(cosine: Any, eta: Any) -> Any:
    """Return Fresnel's reflectance."""
    inner = np.sqrt(eta**2 - 1 + cosine**2)
    a = (inner - cosine) / (inner + cosine)
    b = (cosine * (inner + cosine) - 1) / (cosine * (inner - cosine) + 1)
    return np.where(eta**2 - 1 + cosine**2 > 0, 0.5 * a**2 * (1 + b**2), 1)


NUMBERS: Functions = {
    "MATH": _math, "VECT_MATH": _math, "MAP_RANGE": _map_range, "CLAMP": _clamp, "MAPPING": _mapping,
    "TEX_COORD": _coordinates, "UVMAP": lambda call: call.points.uv, "NEW_GEOMETRY": _geometry,
    "LIGHT_PATH": _light_path, "LAYER_WEIGHT": _layer_weight, "LIGHT_FALLOFF": _falloff,
    "FRESNEL": lambda call: _dielectric(call.points.facing, np.maximum(call["IOR"], 1e-5)),
    "AMBIENT_OCCLUSION": lambda call: 1.0 if call.is_number else call["Color"],
    "RGB": lambda call: own_value(call.source), "VALUE": lambda call: own_value(call.source),
}  # fmt: skip
