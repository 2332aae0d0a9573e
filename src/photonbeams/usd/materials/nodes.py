"""Read nodes that compute: constants, primvars, arithmetic and channels, in UsdShade, MaterialX and Arnold."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...scene import Array, rgb
from ..common.openusd import UsdShade
from .corrections import CORRECTIONS
from .network import Network, Node
from .values import PrimvarValue, Value, channels, mix

Function = Callable[..., Array]


def _primvar(*names: str, fallback: tuple[str, ...] = ("fallback", "default")) -> Node:
    """Return a reader of nodes that look up the primvar named by one of these inputs."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        name = next((str(found) for each in names if (found := network.plain(node, each))), "")
        instead = network.first(node, *fallback)
        if not name:
            return instead
        constant = instead if isinstance(instead, np.ndarray) else np.zeros(3)
        return PrimvarValue(name, constant)

    return read


def _function(function: Function, *inputs: tuple[tuple[str, ...], float | Sequence[float]]) -> Node:
    """Return a reader of nodes that are a function of inputs; each input has names and a default."""

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
    """Return a reader of nodes that pass on one of their inputs."""
    return lambda network, node, output: network.first(node, *names)


def _approximated(*names: str) -> Node:
    """Return a reader of nodes that are approximated by one of their inputs."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        network.lose(node, f"is a '{node.GetShaderId()}', which is not rendered: its input {names[0]} is used as it is")
        return network.first(node, *names)

    return read


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


def _mean_of(*names: str) -> Node:
    """Return a reader of noise between two colours, which is approximated by their mean."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        network.lose(node, f"is a '{node.GetShaderId()}', which is not rendered: the mean of its colours is used")
        found = [network.value(node, name) for name in names]
        first, second = (np.full(1, 1.0 - i) if each is None else each for i, each in enumerate(found))
        return network.combined(node, lambda a, b: (a + b) / 2, first, second)

    return read


def _trigo(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's trigonometric functions of an angle with a frequency and a phase."""
    function = {"cos": np.cos, "sin": np.sin, "tan": np.tan}.get(str(network.plain(node, "function", "cos")), np.cos)
    phase, frequency = network.number_or(node, 0.0, "phase"), network.number_or(node, 1.0, "frequency")
    value = network.value(node, "input")
    if value is None:
        return None
    return network.combined(node, lambda a, factor, added: function(a * factor + added), value, frequency, phase)


def _switched(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read a switch that chooses one of up to twenty inputs by a number."""
    index = network.number_or(node, 0.0, "index")
    inputs = [network.value(node, f"input{i}") for i in range(20) if node.GetInput(f"input{i}")]
    if not inputs:
        return None

    def chosen(number: Array, *values: Array) -> Array:
        place = np.clip(np.floor(number).astype(int), 0, len(values) - 1)
        return sum((np.where(place == i, each, 0.0) for i, each in enumerate(values)), np.zeros(1))

    return network.combined(node, chosen, index, *(np.zeros(1) if each is None else each for each in inputs))


def _converted(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's conversion between colour models, which is rendered only if both are the same."""
    models = [str(network.plain(node, name, "RGB")).upper() for name in ("from", "to")]
    if models[0] != models[1]:
        network.lose(node, f"is from {models[0]} to {models[1]}, which is not rendered: its input is used as it is")
    return network.value(node, "input")


def _smoothstep(value: Array, low: Array, high: Array) -> Array:
    t = np.clip((value - low) / np.where(high == low, 1, high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _remap(value: Array, low: Array, high: Array, to_low: Array, to_high: Array) -> Array:
    return to_low + (value - low) / np.where(high == low, 1, high - low) * (to_high - to_low)


_FIRST, _SECOND = ("in1", "input1"), ("in2", "input2")
_IN = ("in", "input")


def _arithmetic() -> dict[str, Node]:
    """Return nodes of functions, by their names in MaterialX and, with a prefix, in Arnold."""
    two: dict[str, tuple[Function, float]] = {
        "add": (np.add, 0.0), "subtract": (np.subtract, 0.0), "multiply": (np.multiply, 1.0),
        "divide": (np.divide, 1.0), "power": (lambda a, b: np.maximum(a, 0) ** b, 1.0),
        "min": (np.minimum, 0.0), "max": (np.maximum, 0.0), "modulo": (np.mod, 1.0),
    }  # fmt: skip
    one: dict[str, Function] = {
        "absval": np.abs, "abs": np.abs, "sqrt": lambda a: np.sqrt(np.maximum(a, 0)), "floor": np.floor,
        "ceil": np.ceil, "negate": np.negative, "sin": np.sin, "cos": np.cos, "exp": np.exp,
        "complement": lambda a: 1 - a,
    }  # fmt: skip
    nodes = {name: _function(function, (_FIRST, 0.0), (_SECOND, default)) for name, (function, default) in two.items()}
    nodes.update({name: _function(function, (_IN, 0.0)) for name, function in one.items()})
    nodes.update({f"arnold:{name}": node for name, node in list(nodes.items())})
    return nodes


NODES: dict[str, Node] = {
    **_arithmetic(),
    **{
        name: _function(function, *(((each,), default) for each, default in inputs))
        for name, (function, inputs) in CORRECTIONS.items()
    },
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
    "arnold:color_jitter": _approximated("input"),
    "arnold:shuffle": _approximated("color"),
    "arnold:layer_rgba": _approximated("input1"),
    "arnold:noise": _mean_of("color1", "color2"),
    "arnold:trigo": _trigo,
    "arnold:switch_rgba": _switched,
    "arnold:color_convert": _converted,
    "arnold:user_data_int": _primvar("attribute"),
    "arnold:clamp": _function(np.clip, (_IN, 0.0), (("min",), 0.0), (("max",), 1.0)),
    "smoothstep": _function(_smoothstep, (_IN, 0.0), (("low",), 0.0), (("high",), 1.0)),
    "arnold:flat": _passed("color"),
    "arnold:two_sided": _passed("front"),
    "arnold:flakes": _approximated("flake_color"),
    **dict.fromkeys(("separate2", "separate3", "separate4"), _passed("in")),  # their outputs are channels
    "extract": _extract,
    "combine2": _combine("in1", "in2"),
    "combine3": _combine("in1", "in2", "in3"),
    "combine4": _combine("in1", "in2", "in3", "in4"),
    "mix": _function(mix, (("bg",), 0.0), (("fg",), 0.0), (("mix",), 0.0)),
    "arnold:mix_rgba": _function(mix, (("input1",), 0.0), (("input2",), 0.0), (("mix",), 0.5)),
    "invert": _function(lambda a, amount: amount - a, (_IN, 0.0), (("amount",), 1.0)),
    "clamp": _function(np.clip, (_IN, 0.0), (("low",), 0.0), (("high",), 1.0)),
    **dict.fromkeys(("remap", "range"), _function(
        _remap, (_IN, 0.0), (("inlow",), 0.0), (("inhigh",), 1.0), (("outlow",), 0.0), (("outhigh",), 1.0)
    )),
    "arnold:range": _function(
        _remap, (_IN, 0.0), (("input_min",), 0.0), (("input_max",), 1.0), (("output_min",), 0.0),
        (("output_max",), 1.0),
    ),
}  # fmt: skip
