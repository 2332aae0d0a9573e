"""Values of inputs of shader nodes: numbers and colours, images, attributes of meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .images import MISSING, is_missing
from .shading.baking import image_behind
from .shading.evaluation import UnknownNodeError, evaluated
from .shading.links import linked_to
from .shading.links import output_of as output_of
from .shading.links import source_of as source_of

_SAME = 1e-5  # values that differ relatively by less are the same

#: Called with a sentence about what is not rendered as in Blender.
Told = Callable[[str], None]


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


def value_of(node: Any, name: str, told: Told, *, bakes: bool = False) -> Value | None:
    """Return the value of a node's input; None if the node has none of that name.

    Nodes that have the same value everywhere are computed. Those that vary count as their mean, which is told, except
    for an image and, if it `bakes`, what nodes make of images.
    """
    socket = node.inputs.get(name)
    return None if socket is None else _value(node, socket, told, bakes)


def _value(node: Any, socket: Any, told: Told, bakes: bool = False) -> Value:
    """Return the value of a socket of a node."""
    source = linked_to(socket)
    if source is None or not source.is_output:
        return _plain((source or socket).default_value)
    made = source.node
    if made.type == "TEX_IMAGE" and made.image is not None and is_missing(made.image):
        told(f"the file of {made.image.name} is missing: it is magenta, as in Blender")
        return MISSING
    if made.type == "TEX_IMAGE" and made.image is not None:
        return Texture(made, source.name == "Alpha")
    if made.type in ("VERTEX_COLOR", "ATTRIBUTE") and source.name == "Color":
        return Attribute(made.layer_name if made.type == "VERTEX_COLOR" else made.attribute_name)
    try:
        found = evaluated(source)
    except UnknownNodeError as unknown:
        told(sentence_of_unknown(node, socket, unknown))
        return _plain(socket.default_value)
    if np.ptp(found, axis=0).max() > _SAME * max(np.abs(found).max(), _SAME):
        if bakes and (image := image_behind(source)) is not None:
            return Texture(image, output=source)
        told(f"{socket.name} of {node.name} comes from {made.name} and varies, which is not rendered: its mean is used")
    mean = found.mean(axis=0, dtype=np.float64)
    return float(mean) if found.ndim == 1 else tuple(mean.tolist())


def sentence_of_unknown(node: Any, socket: Any, unknown: UnknownNodeError) -> str:
    """Return a sentence about an input that has its own value, as what is linked to it is not rendered."""
    value = ", ".join(f"{each:.4g}" for each in np.ravel(socket.default_value)[:3])
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
    """Return the number of an input, the mean of a colour's channels; images count as `otherwise`."""
    found = value_of(node, name, told)
    if isinstance(found, Texture | Attribute):
        told(f"the image of {name} of {node.name} is not rendered: it counts as {otherwise:g}")
    if isinstance(found, tuple):
        return sum(found[:3]) / 3
    return found if isinstance(found, float) else otherwise


def color_of(node: Any, name: str, told: Told) -> tuple[float, float, float]:
    """Return the colour of an input; images count as white."""
    found = value_of(node, name, told)
    if isinstance(found, Texture | Attribute):
        told(f"the image of {name} of {node.name} is not rendered: it counts as white")
    if isinstance(found, tuple):
        return found[0], found[1], found[2]
    return (found,) * 3 if isinstance(found, float) else (1.0, 1.0, 1.0)


def _plain(value: Any) -> Value:
    try:
        return tuple(float(each) for each in value)
    except TypeError:
        return float(value)
