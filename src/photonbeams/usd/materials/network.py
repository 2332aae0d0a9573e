"""A network of shader nodes: the values of its nodes' inputs, its surface, and notes about what cannot be rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...scene import Array
from ..common.openusd import Sdf, Usd, UsdShade
from ..common.reading import Reading
from .values import Value, as_color, as_number, channels, combinable, mapped

#: A function that reads a node: it returns the value of an output, or None if there is none.
Node = Callable[["Network", UsdShade.Shader, str], "Value | None"]


@dataclass
class Surface:
    """The inputs of a surface, None if nothing is authored; see `scene.Material`."""

    diffuse: Value | None = None
    emissive: Value | None = None
    roughness: Value | None = None
    metallic: Value | None = None
    ior: Value | None = None
    clearcoat: Value | None = None
    clearcoat_roughness: Value | None = None
    opacity: Value | None = None
    presence: bool = False
    thin: bool = False
    tint: Value | None = None
    normal: Value | None = None
    bump: Value | None = None


#: A function that reads a surface shader.
Reader = Callable[["Network", UsdShade.Shader], Surface]


_DEEPEST = 64  # nodes in a chain, which also ends loops
_LETTERS = {"r": 0, "g": 1, "b": 2, "a": 3, "x": 0, "y": 1, "z": 2, "w": 3}
_WHOLE = ("out", "rgb", "rgba", "result", "resultRGB", "resultRGBA", "xyz")


class Network:
    """The values of a network's nodes at the time of a reading.

    Attributes
    ----------
    losses
        Warnings about what is not rendered as the network defines it, which are given if it is rendered.
    """

    def __init__(self, reading: Reading, nodes: dict[str, Node]) -> None:
        self.reading = reading
        self.losses: list[Callable[[], None]] = []
        self._nodes, self._known = nodes, dict[Any, Value | None]()
        self._depth = 0

    def lose(self, node: UsdShade.Shader, text: str, name: str = "") -> None:
        """Note a loss: something that is not rendered."""
        self.losses.append(partial(self.reading.warn, node.GetPrim(), text, f"inputs:{name}" if name else ""))

    def combined(self, node: UsdShade.Shader, function: Callable[..., Array], *values: Value) -> Value:
        """Apply a function to values, and note a loss if they cannot be combined."""
        if not combinable(values):
            self.lose(node, "combines textures that are placed differently: the mean of the smaller ones is used")
        with np.errstate(all="ignore"):
            return mapped(lambda *arrays: np.nan_to_num(function(*arrays)), *values)

    def color(self, node: UsdShade.Shader, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, as a colour, or None."""
        value = self.first(node, *names)
        return None if value is None else as_color(value)

    def number(self, node: UsdShade.Shader, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, as a number, or None."""
        value = self.first(node, *names)
        return None if value is None else as_number(value)

    def color_or(self, node: UsdShade.Shader, default: float, *names: str) -> Value:
        """Return the first of these inputs that is authored, or else the default, as a colour."""
        value = self.first(node, *names)
        return as_color(np.full(1, default) if value is None else value)

    def number_or(self, node: UsdShade.Shader, default: float, *names: str) -> Value:
        """Return the first of these inputs that is authored, or else the default, as a number."""
        value = self.first(node, *names)
        return as_number(np.full(1, default) if value is None else value)

    def first(self, node: UsdShade.Shader, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, or None."""
        return next((found for name in names if (found := self.value(node, name)) is not None), None)

    def plain(self, node: UsdShade.Shader, name: str, default: object = None) -> Any:
        """Return an input that is not connected to a node, such as a token, resolved through interfaces."""
        attribute = self.source(node, name)
        value = None if attribute is None or is_output(attribute) else attribute.Get(self.reading.time)
        return default if value is None else value

    def vector(self, node: UsdShade.Shader, name: str, default: tuple[float, ...]) -> Array:
        """Return an input of constant finite numbers, as many as the default has, or the default."""
        value = _numbers(self.plain(node, name))
        if value is None or value.size not in (1, len(default)) or not np.all(np.isfinite(value)):
            if value is not None:
                self.lose(node, f"is not {len(default)} finite numbers: {default} is used", name)
            return np.array(default, dtype=np.float64)
        return self.colors(node, name, np.broadcast_to(value, (len(default),)))

    def colors(self, node: UsdShade.Shader, name: str, values: Array) -> Array:
        """Return numbers (C,) or (N, C) of an input, colours in the working space."""
        attribute = self.source(node, name)
        return values if attribute is None else self.reading.in_working_space(attribute, values)

    def source(self, node: UsdShade.Shader, name: str) -> Usd.Attribute | None:
        """Return the attribute that gives an input its value: an output, or the attribute of an authored constant."""
        own = node.GetInput(name)
        if not own:
            return None
        self.losses += [partial(self.reading.lack, *each) for each in broken(own.GetAttr(), "it is ignored")]
        attributes = UsdShade.Utils.GetValueProducingAttributes(own)
        return attributes[0] if attributes else own.GetAttr()

    def connected(self, node: UsdShade.Shader, name: str) -> UsdShade.Shader | None:
        """Return the node that is connected to an input, or None."""
        attribute = self.source(node, name)
        return UsdShade.Shader(attribute.GetPrim()) if attribute is not None and is_output(attribute) else None

    def value(self, node: UsdShade.Shader, name: str) -> Value | None:
        """Return an input's value, or None if it has none."""
        attribute = self.source(node, name)
        if attribute is None:
            return None
        if is_output(attribute):
            return self._output(attribute)
        found = _numbers(attribute.Get(self.reading.time))
        if found is None:
            return None
        if not np.all(np.isfinite(found)):
            self.lose(UsdShade.Shader(attribute.GetPrim()), "is not finite: the default is used", name)
            return None
        return self.reading.in_working_space(attribute, found)

    def knows(self, kind: str) -> bool:
        """Return whether nodes of a category can be read."""
        return kind in self._nodes

    def _output(self, attribute: Usd.Attribute) -> Value | None:
        """Return the value of a connected node's output, cached."""
        name = attribute.GetName().removeprefix("outputs:")
        key = attribute.GetPath()
        if key in self._known:
            return self._known[key]
        node = UsdShade.Shader(attribute.GetPrim())
        if self._depth >= _DEEPEST:
            self.lose(node, f"is behind more than {_DEEPEST} nodes, or in a loop: it is ignored")
            return None
        self._depth += 1
        try:
            value = self.output(node, name)
        finally:
            self._depth -= 1
        self._known[key] = value
        return value

    def output(self, node: UsdShade.Shader, output: str) -> Value | None:
        """Return the value of a node's output."""
        kind = category(node)
        if kind not in self._nodes:
            self.lose(node, f"is a shader '{shader_id(node) or 'without an id'}', which is not rendered: it is ignored")
            return None
        value = self._nodes[kind](self, node, output)
        if value is None or output in _WHOLE:
            return value
        letter = output.removeprefix("out").removeprefix("result").lower()
        return channels(value, [_LETTERS[letter]]) if letter in _LETTERS else value


def broken(attribute: Usd.Attribute, instead: str) -> Iterator[tuple[Usd.Prim, str, str]]:
    """Yield warnings about connections, also of interfaces, that lead to no value: prim, text, attribute."""
    chain = [attribute]
    for each in chain:  # which grows meanwhile
        for path in each.GetConnections()[:1]:  # only the first one gives the value
            if expected := _expected(path, chain):
                yield each.GetPrim(), f"is connected to {path}: expected {expected}; {instead}", str(each.GetName())
            else:
                chain.append(each.GetStage().GetAttributeAtPath(path))


def _expected(path: Sdf.Path, chain: list[Usd.Attribute]) -> str:
    """Return what a chain of connections expects in place of the attribute at its end, "" if that may give a value."""
    stage = chain[0].GetStage()
    source, prim = stage.GetAttributeAtPath(path), stage.GetPrimAtPath(path.GetPrimPath())
    if not source:
        return f"an attribute that {prim.GetPath()} declares" if prim else "an output on the stage"
    if source in chain:
        return "no loop"
    if is_output(source):
        return ""
    node, given = UsdShade.ConnectableAPI(prim), source.GetConnections() or source.HasAuthoredValue()
    graph = bool(node) and node.IsContainer()  # a material or, oddly, a light, too
    if graph and UsdShade.Output.IsOutput(source):
        return "" if given else "an output that is connected"
    around = chain[-1].GetPath().HasPrefix(prim.GetPath())  # else the default of an interface is no value
    if graph and UsdShade.Input.IsInput(source) and (given or around):
        return ""
    return "an output of a shader, or an input of a material or a graph"


def shader_id(node: UsdShade.Shader) -> str:
    """Return a shader's identifier, its name in an MDL module, or its source file; "" if it has none of these."""
    prim = node.GetPrim()
    for name in ("info:mdl:sourceAsset:subIdentifier", "info:glslfx:sourceAsset", "info:OSL:sourceAsset"):
        value = None if node.GetShaderId() else prim.GetAttribute(name).Get() if prim.HasAttribute(name) else None
        if value:
            return str(getattr(value, "path", value))
    return str(node.GetShaderId() or "")


def category(node: UsdShade.Shader) -> str:
    """Return the kind of a shader node, regardless of the types of its inputs and of who defines it."""
    name = shader_id(node)
    if name.startswith("arnold:"):
        return name
    if name.startswith("ND_"):
        plain = name.removeprefix("ND_")
        return next((each for each in _SEVERAL_WORDS if plain.startswith(each)), plain.split("_")[0])
    return name.split("_")[0] if name.startswith(("Usd", "Hw")) else name


# MaterialX's names end in the types of a node; these kinds contain underscores themselves.
_SEVERAL_WORDS = ("standard_surface", "open_pbr_surface", "surface_unlit", "gltf_pbr", "disney_principled")


def is_output(attribute: Usd.Attribute) -> bool:
    """Return whether an attribute is an output of a node; that of a graph may have a value of its own."""
    node = UsdShade.ConnectableAPI(attribute.GetPrim())
    return bool(node) and not node.IsContainer() and UsdShade.Output.IsOutput(attribute)


def _numbers(value: object) -> Array | None:
    """Return a value as an array (C,), or None if it is not numeric."""
    if value is None or isinstance(value, str | Sdf.AssetPath):
        return None
    try:
        found = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        return None
    return found if found.ndim == 1 and 1 <= found.size <= 4 else None
