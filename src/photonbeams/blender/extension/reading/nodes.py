"""Values of inputs of shader nodes: numbers and colours, images, attributes of meshes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .images import is_missing
from .prims import Told
from .shading.baking import image_behind
from .shading.calls import UnknownNodeError, anywhere, own_value
from .shading.evaluation import Evaluation, varies
from .shading.links import output_of as output_of
from .shading.links import source_of as source_of


@dataclass(frozen=True)
class Texture:
    """An image that makes a value: its node, and whether it is the image's alpha; or the output that is made of it."""

    node: Any
    alpha: bool = False
    output: Any = None


@dataclass(frozen=True)
class Attribute:
    """An attribute of meshes that makes a colour; "" is the one that is active for rendering."""

    name: str


#: A number, a colour, or the image or the attribute that makes it.
Value = float | tuple[float, ...] | Texture | Attribute


def telling(told: Told, whose: str) -> Told:
    """Return what tells sentences about something of a name."""
    return lambda text: told(f"{whose}: {text}")


def value_of(node: Any, name: str, told: Told, *, bakes: bool = False) -> Value | None:
    """Return the value of a node's input; None if the node has none of that name.

    Nodes that have the same value everywhere are computed. Those that vary count as their mean, which is told, except
    for an image and, if it `bakes`, what nodes make of images.
    """
    socket = node.inputs.get(name)
    return None if socket is None else _value(node, socket, told, bakes)


def _value(node: Any, socket: Any, told: Told, bakes: bool = False) -> Value:
    """Return the value of a socket of a node."""
    source = source_of(socket)
    made = None if source is None else source.node
    if made is not None and made.type == "TEX_IMAGE" and made.image is not None:
        if not is_missing(made.image):
            return Texture(made, source.name == "Alpha")
        told(f"the file of {made.image.name} is missing: it is magenta, as in Blender")
    if made is not None and made.type in ("VERTEX_COLOR", "ATTRIBUTE") and source.name == "Color":
        return Attribute(made.layer_name if made.type == "VERTEX_COLOR" else made.attribute_name)
    try:
        values = Evaluation(anywhere()).input(socket)
    except UnknownNodeError as unknown:
        told(sentence_of_unknown(node, socket, unknown))
        values = own_value(socket)
    if made is not None and varies(values):
        if bakes and (image := image_behind(source)) is not None:
            return Texture(image, output=source)
        told(f"{socket.name} of {node.name} comes from {made.name} and varies, which is not rendered: its mean is used")
    mean = values.mean(axis=0).tolist()
    return mean[0] if len(mean) == 1 else tuple(mean)


def sentence_of_unknown(node: Any, socket: Any, unknown: UnknownNodeError) -> str:
    """Return a sentence about an input that has its own value, as what is linked to it is not rendered."""
    value = ", ".join(f"{each:.4g}" for each in own_value(socket)[0])
    return f"{socket.name} of {node.name} comes from {unknown}, which is not rendered: its own value ({value}) is used"


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
    """Return the number of an input; images count as `otherwise`, as does an input that the node does not have."""
    return _constant(node, name, told, otherwise, f"{otherwise:g}")


def color_of(node: Any, name: str, told: Told) -> tuple[float, float, float]:
    """Return the colour of an input; images count as white, as does an input that the node does not have."""
    return _constant(node, name, told, (1.0, 1.0, 1.0), "white")


def _constant(node: Any, name: str, told: Told, otherwise: Any, said: str) -> Any:
    value = value_of(node, name, told)
    if isinstance(value, Texture | Attribute):
        told(f"the image of {name} of {node.name} is not rendered: it counts as {said}")
    return value if isinstance(value, type(otherwise)) else otherwise
