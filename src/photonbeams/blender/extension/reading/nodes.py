"""Values of shader nodes: constants and image textures. Whatever else makes a value, its socket's own is used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: Called with a sentence about what is not rendered as in Blender.
Told = Callable[[str], None]


@dataclass(frozen=True)
class Texture:
    """An image that makes a value: its node, and whether it is the image's alpha."""

    node: Any
    alpha: bool = False


#: A number, a colour, or the image that makes it.
Value = float | tuple[float, ...] | Texture


def output_of(tree: Any, kind: str) -> Any:
    """Return the active output node of a material, a world or a light; None if there is none."""
    for target in ("CYCLES", "ALL", "EEVEE"):
        found = tree.get_output_node(target) if hasattr(tree, "get_output_node") else None
        if found is not None:
            return found
    return next((node for node in tree.nodes if node.type == kind), None)


def source_of(socket: Any) -> Any:
    """Return the socket that a socket is linked to, beyond reroutes and into groups; None if there is none."""
    if socket is None or not socket.is_linked or socket.links[0].is_muted:
        return None
    found = socket.links[0].from_socket
    node = found.node
    if node.mute:
        return None
    if node.type == "REROUTE":
        return source_of(node.inputs[0])
    if node.type == "GROUP" and node.node_tree is not None:
        inside = next((each for each in node.node_tree.nodes if each.type == "GROUP_OUTPUT"), None)
        return None if inside is None else source_of(inside.inputs.get(found.name))
    return found


def value_of(node: Any, name: str, told: Told) -> Value | None:
    """Return the value of a node's input; None if the node has none of that name."""
    socket = node.inputs.get(name)
    return None if socket is None else _value(node, socket, told)


def _value(node: Any, socket: Any, told: Told) -> Value:
    """Return the value of a socket of a node."""
    source = source_of(socket)
    if source is None:
        return _plain(socket.default_value)
    made = source.node
    if made.type == "TEX_IMAGE" and made.image is not None:
        return Texture(made, source.name == "Alpha")
    if made.type in ("RGB", "VALUE"):
        return _plain(source.default_value)
    told(f"{socket.name} of {node.name} comes from {made.name}, which is not rendered: its own value is used")
    return _plain(socket.default_value)


def product_of(node: Any, socket: Any, told: Told) -> tuple[Value, str]:
    """Return the constant and the grid of a volume whose product a socket's value is; "" if no grid is in it."""
    source = source_of(socket)
    made = None if source is None else source.node
    if made is not None and made.type in ("ATTRIBUTE", "VOLUME_INFO"):
        return 1.0, made.attribute_name if made.type == "ATTRIBUTE" else source.name.lower()
    if made is not None and made.type == "MATH" and made.operation == "MULTIPLY":
        (a, first), (b, second) = (product_of(made, each, told) for each in made.inputs[:2])
        if isinstance(a, float) and isinstance(b, float) and not (first and second):
            return a * b, first or second
    return _value(node, socket, told), ""


def number_of(node: Any, name: str, told: Told, otherwise: float = 0.0) -> float:
    """Return the number of an input, the mean of a colour's channels; images count as `otherwise`."""
    found = value_of(node, name, told)
    if isinstance(found, Texture):
        told(f"the image of {name} of {node.name} is not rendered: it counts as {otherwise:g}")
    if isinstance(found, Texture) or found is None:
        return otherwise
    return found if isinstance(found, float) else sum(found[:3]) / 3


def color_of(node: Any, name: str, told: Told) -> tuple[float, float, float]:
    """Return the colour of an input; images count as white."""
    found = value_of(node, name, told)
    if isinstance(found, Texture):
        told(f"the image of {name} of {node.name} is not rendered: it counts as white")
    if isinstance(found, Texture) or found is None:
        return (1.0, 1.0, 1.0)
    return (found,) * 3 if isinstance(found, float) else tuple(found[:3])  # type: ignore[return-value]


def _plain(value: Any) -> Value:
    try:
        return tuple(float(each) for each in value)
    except TypeError:
        return float(value)
