"""A network of shader nodes: the values of its nodes' inputs, its surface, and notes about what cannot be rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ...scene import Array
from ..common.openusd import Sdf, Usd, UsdShade
from ..common.reading import Reading
from .values import PrimvarValue, Value, as_color, as_number, channels, combinable, mapped

#: A function that reads a node: it returns its value, or None if there is none.
NodeReader = Callable[["ShaderNode"], "Value | None"]


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
Reader = Callable[["ShaderNode"], Surface]


_DEEPEST = 64  # nodes in a chain, which also ends loops
_LETTERS = {"r": 0, "g": 1, "b": 2, "a": 3, "x": 0, "y": 1, "z": 2, "w": 3}
_WHOLE = ("out", "rgb", "rgba", "result", "resultRGB", "resultRGBA", "xyz")


@dataclass
class Network:
    """A network of nodes at the time of a reading.

    Attributes
    ----------
    nodes
        The readers of nodes, by the nodes' categories.
    other
        The reader of all other nodes.
    primvar
        Returns the value of a primvar by its name, and by what is used if there is none.
    losses
        Warnings about what is not rendered as the network defines it, which are given if it is rendered.
    outputs
        The values of outputs that were read.
    depth
        How many nodes are being read, each for the one before.
    """

    reading: Reading
    nodes: Mapping[str, NodeReader]
    other: NodeReader
    primvar: Callable[[str, Array], Value] = PrimvarValue
    losses: list[Callable[[], None]] = field(default_factory=list)
    outputs: dict[Sdf.Path, Value | None] = field(default_factory=dict)
    depth: int = 0


@dataclass(frozen=True)
class ShaderNode:
    """A node of a network, with the values of its inputs.

    Attributes
    ----------
    names
        What the shader calls inputs that readers know by other names; the first of them that is authored counts.
    """

    network: Network
    shader: UsdShade.Shader
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def renamed(self, names: Mapping[str, Sequence[str]]) -> ShaderNode:
        """Return the node with other names of its inputs."""
        return replace(self, names=names)

    def name_of(self, name: str) -> str:
        """Return what the shader calls an input."""
        names = self.names.get(name, (name,))
        return next((each for each in names if each and self.shader.GetInput(each)), names[0])

    @property
    def label(self) -> str:
        """The shader's identifier, its name in an MDL module, or its source file; "" if it has none of these."""
        if name := self.shader.GetShaderId():
            return str(name)
        names = ("info:mdl:sourceAsset:subIdentifier", "info:glslfx:sourceAsset", "info:OSL:sourceAsset")
        attributes = map(self.shader.GetPrim().GetAttribute, names)
        values = (attribute.Get() for attribute in attributes if attribute)
        return next((str(getattr(value, "path", value)) for value in values if value), "")

    @property
    def category(self) -> str:
        """The kind of the node, regardless of the types of its inputs and of who defines it."""
        name = self.label
        if name.startswith("ND_"):
            plain = name.removeprefix("ND_")
            return next((each for each in _SEVERAL_WORDS if plain.startswith(each)), plain.split("_")[0])
        return name.split("_")[0] if name.startswith(("Usd", "Hw")) else name

    def lose(self, text: str, name: str = "") -> None:
        """Note a loss: something that is not rendered."""
        name = f"inputs:{self.name_of(name)}" if name else ""
        self.network.losses.append(partial(self.network.reading.warn, self.shader.GetPrim(), text, name))

    def combined(self, function: Callable[..., Array], *values: Value) -> Value:
        """Apply a function to values, and note a loss if they cannot be combined."""
        if not combinable(values):
            self.lose("combines textures that are placed differently: the mean of the smaller ones is used")
        with np.errstate(all="ignore"):
            return mapped(lambda *arrays: np.nan_to_num(function(*arrays)), *values)

    def color(self, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, as a colour, or None."""
        value = self.first(*names)
        return None if value is None else as_color(value)

    def number(self, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, as a number, or None."""
        value = self.first(*names)
        return None if value is None else as_number(value)

    def color_or(self, default: float, *names: str) -> Value:
        """Return the first of these inputs that is authored, or else the default, as a colour."""
        value = self.color(*names)
        return np.full(3, default) if value is None else value

    def number_or(self, default: float, *names: str) -> Value:
        """Return the first of these inputs that is authored, or else the default, as a number."""
        value = self.number(*names)
        return np.full(1, default) if value is None else value

    def mean(self, name: str) -> Value | None:
        """Return the mean of an input's channels, or None."""
        value = self.color(name)
        return None if value is None else self.combined(lambda colors: colors.mean(axis=-1, keepdims=True), value)

    def first(self, *names: str) -> Value | None:
        """Return the first of these inputs that is authored, or None."""
        return next((value for name in names if (value := self.value(name)) is not None), None)

    def has(self, name: str) -> bool:
        """Return whether an input is authored."""
        return bool(self.shader.GetInput(self.name_of(name)))

    def plain(self, name: str, default: object = None) -> Any:
        """Return an input that is not connected to a node, such as a token, resolved through interfaces."""
        attribute = self.source(name)
        value = None if attribute is None or is_output(attribute) else attribute.Get(self.network.reading.time)
        return default if value is None else value

    def text(self, name: str, default: str = "") -> str:
        """Return an input that is a text, or a number that stands for one."""
        return str(self.plain(name, default))

    def flag(self, name: str, default: bool = False) -> bool:
        """Return an input that is a bool."""
        return bool(self.plain(name, default))

    def scalar(self, name: str, default: float) -> float:
        """Return an input of one constant finite number, or the default."""
        return float(self.vector(name, (default,))[0])

    def vector(self, name: str, default: Sequence[float]) -> Array:
        """Return an input of constant finite numbers, as many as the default has, or the default."""
        value = _numbers(self.plain(name))
        if value is None or value.size not in (1, len(default)) or not np.all(np.isfinite(value)):
            if value is not None:
                self.lose(f"is not {len(default)} finite numbers: {tuple(default)} is used", name)
            return np.array(default, dtype=np.float64)
        return self.colors(name, np.broadcast_to(value, (len(default),)))

    def colors(self, name: str, values: Array) -> Array:
        """Return numbers (C,) or (N, C) of an input, colours in the working space."""
        attribute = self.source(name)
        return values if attribute is None else self.network.reading.in_working_space(attribute, values)

    def source(self, name: str) -> Usd.Attribute | None:
        """Return the attribute that gives an input its value: an output, or the attribute of an authored constant."""
        own = self.shader.GetInput(self.name_of(name)) if name else None
        if not own:
            return None
        lack = self.network.reading.lack
        self.network.losses += [partial(lack, *each) for each in broken(own.GetAttr(), "it is ignored")]
        attributes = UsdShade.Utils.GetValueProducingAttributes(own)
        return attributes[0] if attributes else own.GetAttr()

    def connected(self, name: str) -> ShaderNode | None:
        """Return the node that is connected to an input, or None."""
        attribute = self.source(name)
        return self._at(attribute) if attribute is not None and is_output(attribute) else None

    def _at(self, attribute: Usd.Attribute) -> ShaderNode:
        """Return the node of an attribute in the same network."""
        return ShaderNode(self.network, UsdShade.Shader(attribute.GetPrim()))

    def value(self, name: str) -> Value | None:
        """Return an input's value, or None if it has none."""
        attribute = self.source(name)
        if attribute is None:
            return None
        if is_output(attribute):
            return self._connected_value(attribute)
        numbers = _numbers(attribute.Get(self.network.reading.time))
        if numbers is None:
            return None
        if not np.all(np.isfinite(numbers)):
            self._at(attribute).lose("is not finite: the default is used", name)
            return None
        return self.network.reading.in_working_space(attribute, numbers)

    def _connected_value(self, attribute: Usd.Attribute) -> Value | None:
        """Return the value of a connected node's output, cached."""
        network, node, path = self.network, self._at(attribute), attribute.GetPath()
        if path not in network.outputs:
            if network.depth >= _DEEPEST:
                node.lose(f"is behind more than {_DEEPEST} nodes, or in a loop: it is ignored")
                return None
            network.depth += 1
            try:
                network.outputs[path] = node.output(attribute.GetName().removeprefix("outputs:"))
            finally:
                network.depth -= 1
        return network.outputs[path]

    def output(self, output: str) -> Value | None:
        """Return the value of one of the node's outputs."""
        value = self.network.nodes.get(self.category, self.network.other)(self)
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
