"""Nodes that compute: constants, primvars, arithmetic, channels, normal maps; in UsdShade, MaterialX and Arnold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import UsdShade

from ...scene import Array, rgb
from .network import Network, Node
from .values import PrimvarValue, Value, channels, identity, mapped

Function = Callable[..., Array]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def _primvar(*names: str, fallback: tuple[str, ...] = ("fallback", "default")) -> Node:
    """Return a reader of nodes that look up a primvar, whose name is in one of these inputs."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        name = next((str(found) for each in names if (found := network.plain(node, each))), "")
        instead = network.first(node, *fallback)
        if not name:
            return instead
        constant = instead if isinstance(instead, np.ndarray) else np.zeros(3)
        return PrimvarValue(name, constant, identity)

    return read


def _function(function: Function, *inputs: tuple[tuple[str, ...], Any]) -> Node:
    """Return a reader of nodes that are a function of inputs, each with its names and its default."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        found = [network.first(node, *names) for names, _ in inputs]
        if all(each is None for each in found):
            return None
        filled = [
            np.atleast_1d(np.asarray(default, dtype=np.float64)) if value is None else value
            for value, (_, default) in zip(found, inputs, strict=True)
        ]
        return network.combined(node, function, *filled)

    return read


def _passed(*names: str) -> Node:
    """Return a reader of nodes that give one of their inputs on."""
    return lambda network, node, output: network.first(node, *names)


def _approximated(*names: str) -> Node:
    """Return a reader of nodes of which nothing but one of their inputs is rendered."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        network.lose(node, f"is a '{node.GetShaderId()}', which is not rendered: its input {names[0]} is used as it is")
        return network.first(node, *names)

    return read


def _separate(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read one channel, by the name of the output."""
    value = network.value(node, "in")
    letter = output.removeprefix("out").lower()
    index = "rgba".find(letter) if letter in "rgba" else "xyzw".find(letter)
    return None if value is None else channels(value, [max(index, 0)])


def _extract(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    value = network.value(node, "in")
    return None if value is None else channels(value, [int(network.plain(node, "index", 0))])


def _combine(*names: str, alpha: float = 0.0) -> Node:
    """Return a reader of nodes that put the channels of these inputs side by side."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        parts = [network.value(node, name) for name in names]
        if all(each is None for each in parts):
            return None
        defaults = [0.0, 0.0, 0.0, alpha]
        filled = [np.array([defaults[i]]) if each is None else each for i, each in enumerate(parts)]
        return network.combined(node, _side_by_side, *filled)

    return read


def _side_by_side(*values: Array) -> Array:
    shape = np.broadcast_shapes(*(each.shape[:-1] for each in values))
    return np.concatenate([np.broadcast_to(each, (*shape, each.shape[-1])) for each in values], axis=-1)[..., :4]


def _normal_map(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read normals in tangent space of a picture of them, n / 2 + 1 / 2."""
    picture = network.first(node, "in", "input")
    if picture is None:
        return None
    strength = network.vector(node, "strength" if node.GetInput("strength") else "scale", (1.0, 1.0))
    signed = not network.plain(node, "color_to_signed", True)
    factor = np.array([*strength, 1.0])
    return mapped(lambda values: (rgb(values) if signed else 2 * rgb(values) - 1) * factor, picture)


def _remap(value: Array, low: Array, high: Array, to_low: Array, to_high: Array) -> Array:
    return to_low + (value - low) / np.where(high == low, 1, high - low) * (to_high - to_low)


def _saturated(value: Array, amount: Array) -> Array:
    grey = (rgb(value) @ _LUMINANCE)[..., None]
    return grey + amount * (rgb(value) - grey)


def _corrected(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's colour correction: gamma, saturation, exposure, factor and offset; no hue and no contrast."""
    value = network.value(node, "input")
    if value is None:
        return None
    gamma, exposure, saturation = (
        float(network.vector(node, name, (default,))[0])
        for name, default in (("gamma", 1.0), ("exposure", 0.0), ("saturation", 1.0))
    )
    factor, offset = network.vector(node, "multiply", (1.0,) * 3), network.vector(node, "add", (0.0,) * 3)
    for name, neutral in (("hue_shift", 0.0), ("contrast", 1.0)):
        if network.vector(node, name, (neutral,))[0] != neutral:
            network.lose(node, "is not rendered: it is ignored", name)

    def corrected(colors: Array) -> Array:
        curved = np.maximum(rgb(colors), 0) ** (1 / max(gamma, 1e-3))
        return _saturated(curved, np.array([saturation])) * 2**exposure * factor + offset

    return mapped(corrected, value)


_FIRST, _SECOND = ("in1", "input1"), ("in2", "input2")
_IN = ("in", "input")


def _arithmetic() -> dict[str, Node]:
    """Return nodes of functions by what they are called in MaterialX, and with a prefix in Arnold."""
    two: dict[str, tuple[Function, float]] = {
        "add": (np.add, 0.0), "subtract": (np.subtract, 0.0), "multiply": (np.multiply, 1.0),
        "divide": (np.divide, 1.0), "power": (lambda a, b: np.maximum(a, 0) ** b, 1.0),
        "min": (np.minimum, 0.0), "max": (np.maximum, 0.0), "modulo": (np.mod, 1.0),
    }  # fmt: skip
    one: dict[str, Function] = {
        "absval": np.abs, "abs": np.abs, "sqrt": lambda a: np.sqrt(np.maximum(a, 0)), "floor": np.floor,
        "ceil": np.ceil, "negate": np.negative, "sin": np.sin, "cos": np.cos, "exp": np.exp,
        "luminance": lambda a: np.repeat((rgb(a) @ _LUMINANCE)[..., None], 3, axis=-1), "complement": lambda a: 1 - a,
    }  # fmt: skip
    nodes = {name: _function(function, (_FIRST, 0.0), (_SECOND, default)) for name, (function, default) in two.items()}
    nodes.update({name: _function(function, (_IN, 0.0)) for name, function in one.items()})
    nodes.update({f"arnold:{name}": node for name, node in list(nodes.items())})
    return nodes


NODES: dict[str, Node] = {
    **_arithmetic(),
    "UsdPrimvarReader": _primvar("varname"),
    "HwPrimvar": _primvar("varname"),
    "geompropvalue": _primvar("geomprop"),
    "geompropvalueuniform": _primvar("geomprop"),
    "geomcolor": lambda network, node, output: PrimvarValue("displayColor", np.zeros(3)),
    "PxrPrimvar": _primvar("varname", fallback=("defaultColor", "defaultFloat")),
    "arnold:user_data_rgb": _primvar("attribute"),
    "arnold:user_data_rgba": _primvar("attribute"),
    "arnold:user_data_float": _primvar("attribute"),
    "constant": _passed("value"),
    "dot": _passed("in"),
    "convert": _passed("in"),
    "arnold:float_to_rgb": _combine(*"rgb"),
    "arnold:float_to_rgba": _combine(*"rgba", alpha=1.0),
    "arnold:rgb_to_vector": _passed("input"),
    "arnold:vector_to_rgb": _passed("input"),
    "arnold:rgb_to_float": _function(lambda a: rgb(a).mean(axis=-1, keepdims=True), (_IN, 0.0)),
    "arnold:color_correct": _corrected,
    "arnold:color_jitter": _approximated("input"),
    "arnold:shuffle": _approximated("color"),
    "arnold:layer_rgba": _approximated("input1"),
    "arnold:noise": _function(lambda a, b: (a + b) / 2, (("color1",), 1.0), (("color2",), 0.0)),
    "arnold:flat": _passed("color"),
    "arnold:two_sided": _passed("front"),
    "arnold:flakes": _approximated("flake_color"),
    "separate2": _separate,
    "separate3": _separate,
    "separate4": _separate,
    "extract": _extract,
    "combine2": _combine("in1", "in2"),
    "combine3": _combine("in1", "in2", "in3"),
    "combine4": _combine("in1", "in2", "in3", "in4"),
    "mix": _function(lambda bg, fg, mix: bg + mix * (fg - bg), (("bg",), 0.0), (("fg",), 0.0), (("mix",), 0.0)),
    "arnold:mix_rgba": _function(
        lambda a, b, mix: a + mix * (b - a), (("input1",), 0.0), (("input2",), 0.0), (("mix",), 0.5)
    ),
    "invert": _function(lambda a, amount: amount - a, (_IN, 0.0), (("amount",), 1.0)),
    "clamp": _function(np.clip, (_IN, 0.0), (("low",), 0.0), (("high",), 1.0)),
    "saturate": _function(_saturated, (_IN, 0.0), (("amount",), 1.0)),
    "remap": _function(
        _remap, (_IN, 0.0), (("inlow",), 0.0), (("inhigh",), 1.0), (("outlow",), 0.0), (("outhigh",), 1.0)
    ),
    "range": _function(
        _remap, (_IN, 0.0), (("inlow",), 0.0), (("inhigh",), 1.0), (("outlow",), 0.0), (("outhigh",), 1.0)
    ),
    "arnold:range": _function(
        _remap, (_IN, 0.0), (("input_min",), 0.0), (("input_max",), 1.0), (("output_min",), 0.0),
        (("output_max",), 1.0),
    ),
    "colorcorrect": _approximated("in"),
    "normalmap": _normal_map,
    "arnold:normal_map": _normal_map,
}  # fmt: skip
