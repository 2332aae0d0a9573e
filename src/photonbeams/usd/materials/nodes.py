"""Read nodes that compute: constants, primvars, arithmetic and channels, in UsdShade, MaterialX and Arnold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...scene import Array, rgb
from .corrections import CORRECTIONS
from .network import NodeReader, ShaderNode
from .values import Value, channels, mix

Function = Callable[..., Array]

#: The inputs that name the primvar or the field that a node reads, and those with what it is without one.
PRIMVARS = ("varname", "geomprop", "attribute", "fieldname")
_FALLBACKS = ("fallback", "default", "defaultColor", "defaultFloat")

# What Arnold calls inputs of MaterialX.
_ALSO = {"in": "input", "in1": "input1", "in2": "input2"}


def primvar(node: ShaderNode) -> Value | None:
    """Read a node that looks up a primvar."""
    name = next(filter(None, map(node.text, PRIMVARS)), "")
    instead = node.first(*_FALLBACKS)
    return node.network.primvar(name, instead if isinstance(instead, np.ndarray) else np.zeros(3)) if name else instead


def _function(function: Function, inputs: Mapping[str, Any]) -> NodeReader:
    """Return a reader of nodes that are a function of inputs, given with their defaults."""

    def read(node: ShaderNode) -> Value | None:
        values = {name: node.first(name, _ALSO.get(name, name)) for name in inputs}
        if all(value is None for value in values.values()):
            return None
        filled = (
            np.atleast_1d(np.asarray(inputs[name], dtype=np.float64)) if value is None else value
            for name, value in values.items()
        )
        return node.combined(function, *filled)

    return read


def _passed(*names: str) -> NodeReader:
    """Return a reader of nodes that pass on one of their inputs."""
    return lambda node: node.first(*names)


def _approximated(name: str) -> NodeReader:
    """Return a reader of nodes that are approximated by one of their inputs."""

    def read(node: ShaderNode) -> Value | None:
        node.lose(f"is a '{node.label}', which is not rendered: its input {name} is used as it is")
        return node.value(name)

    return read


def ignored(node: ShaderNode) -> None:
    """Note that a node is not rendered."""
    node.lose(f"is a shader '{node.label or 'without an id'}', which is not rendered: it is ignored")


def _extract(node: ShaderNode) -> Value | None:
    value = node.value("in")
    return None if value is None else channels(value, [int(node.plain("index", 0))])


def _side_by_side(*values: Array) -> Array:
    shape = np.broadcast_shapes(*(each.shape[:-1] for each in values))
    return np.concatenate([np.broadcast_to(each, (*shape, each.shape[-1])) for each in values], axis=-1)[..., :4]


def _noise(node: ShaderNode) -> Value:
    """Read noise between two colours, which is approximated by their mean."""
    node.lose(f"is a '{node.label}', which is not rendered: the mean of its colours is used")
    return node.combined(lambda a, b: (a + b) / 2, node.color_or(1.0, "color1"), node.color_or(0.0, "color2"))


def _smoothstep(value: Array, low: Array, high: Array) -> Array:
    t = np.clip((value - low) / np.where(high == low, 1, high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _remap(value: Array, low: Array, high: Array, to_low: Array, to_high: Array) -> Array:
    return to_low + (value - low) / np.where(high == low, 1, high - low) * (to_high - to_low)


# Functions of two numbers, with the default of the second, and of one.
_OF_TWO: dict[str, tuple[Function, float]] = {
    "add": (np.add, 0.0), "subtract": (np.subtract, 0.0), "multiply": (np.multiply, 1.0), "divide": (np.divide, 1.0),
    "power": (lambda a, b: np.maximum(a, 0) ** b, 1.0), "min": (np.minimum, 0.0), "max": (np.maximum, 0.0),
    "modulo": (np.mod, 1.0),
}  # fmt: skip
_OF_ONE: dict[str, Function] = {
    "absval": np.abs, "abs": np.abs, "sqrt": lambda a: np.sqrt(np.maximum(a, 0)), "floor": np.floor, "ceil": np.ceil,
    "negate": np.negative, "sin": np.sin, "cos": np.cos, "exp": np.exp, "complement": lambda a: 1 - a,
}  # fmt: skip
# By their names in MaterialX and, with a prefix, in Arnold.
_ARITHMETIC = {
    **{name: _function(function, {"in1": 0.0, "in2": second}) for name, (function, second) in _OF_TWO.items()},
    **{name: _function(function, {"in": 0.0}) for name, function in _OF_ONE.items()},
}
_FUNCTIONS: dict[str, tuple[Function, Mapping[str, Any]]] = {
    **CORRECTIONS,
    "arnold:float_to_rgb": (_side_by_side, dict.fromkeys("rgb", 0.0)),
    "arnold:float_to_rgba": (_side_by_side, {"r": 0.0, "g": 0.0, "b": 0.0, "a": 1.0}),
    "arnold:rgb_to_float": (lambda a: rgb(a).mean(axis=-1, keepdims=True), {"in": 0.0}),
    "arnold:clamp": (np.clip, {"in": 0.0, "min": 0.0, "max": 1.0}),
    "arnold:mix_rgba": (mix, {"input1": 0.0, "input2": 0.0, "mix": 0.5}),
    "arnold:range": (_remap, {
        "in": 0.0, "input_min": 0.0, "input_max": 1.0, "output_min": 0.0, "output_max": 1.0,
    }),
    **dict.fromkeys(("remap", "range"), (_remap, {
        "in": 0.0, "inlow": 0.0, "inhigh": 1.0, "outlow": 0.0, "outhigh": 1.0,
    })),
    "smoothstep": (_smoothstep, {"in": 0.0, "low": 0.0, "high": 1.0}),
    "clamp": (np.clip, {"in": 0.0, "low": 0.0, "high": 1.0}),
    "combine2": (_side_by_side, {"in1": 0.0, "in2": 0.0}),
    "combine3": (_side_by_side, {"in1": 0.0, "in2": 0.0, "in3": 0.0}),
    "combine4": (_side_by_side, {"in1": 0.0, "in2": 0.0, "in3": 0.0, "in4": 0.0}),
    "mix": (mix, {"bg": 0.0, "fg": 0.0, "mix": 0.0}),
    "invert": (lambda a, amount: amount - a, {"in": 0.0, "amount": 1.0}),
}  # fmt: skip

NODES: dict[str, NodeReader] = {
    **_ARITHMETIC,
    **{f"arnold:{name}": reader for name, reader in _ARITHMETIC.items()},
    **{name: _function(function, inputs) for name, (function, inputs) in _FUNCTIONS.items()},
    **dict.fromkeys(
        ("UsdPrimvarReader", "HwPrimvar", "geompropvalue", "geompropvalueuniform", "PxrPrimvar",
         "arnold:user_data_rgb", "arnold:user_data_rgba", "arnold:user_data_float", "arnold:user_data_int"),
        primvar,
    ),
    "geomcolor": lambda node: node.network.primvar("displayColor", np.zeros(3)),
    "constant": _passed("value"),
    **dict.fromkeys(("dot", "convert", "separate2", "separate3", "separate4"), _passed("in")),
    **dict.fromkeys(("arnold:rgb_to_vector", "arnold:vector_to_rgb"), _passed("input")),
    "extract": _extract,
    "arnold:flat": _passed("color"),
    "arnold:two_sided": _passed("front"),
    **dict.fromkeys(("arnold:color_jitter", "arnold:color_convert", "arnold:trigo"), _approximated("input")),
    "arnold:shuffle": _approximated("color"),
    "arnold:layer_rgba": _approximated("input1"),
    "arnold:switch_rgba": _approximated("input0"),
    "arnold:flakes": _approximated("flake_color"),
    "arnold:noise": _noise,
}  # fmt: skip
