"""A shader node that is evaluated, and the points where.

Values are (N, 1) for numbers and (N, 3) for colours and vectors, or have a single row if they are the same everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

_SAMPLES = 4096


class UnknownNodeError(Exception):
    """A node has no known value; the text is its name."""


@dataclass(frozen=True)
class Points:
    """Where nodes are evaluated: coordinates (N, 3) of each kind."""

    generated: Any
    object: Any
    uv: Any
    normal: Any
    facing: Any = 1.0  # (N, 1) the cosine between the normal and the direction to the camera
    #: Colours (N, 4) of images that are known here, by their nodes.
    images: dict[Any, Any] = field(default_factory=dict)
    #: Whether the light that reaches the camera is wanted, and not that which lights the scene.
    seen: bool = True


@cache
def anywhere() -> Points:
    """Return points of a surface of which nothing is known: their coordinates are spread evenly."""
    random = np.random.default_rng(0)
    unit = random.random((_SAMPLES, 3))
    normal = random.normal(size=(_SAMPLES, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Seen from afar, a convex body shows as much of each squared cosine.
    return Points(unit, 2 * unit - 1, random.random((_SAMPLES, 3)), normal, np.sqrt(random.random((_SAMPLES, 1))))


@dataclass(frozen=True)
class Call:
    """A node that is evaluated.

    Attributes
    ----------
    source, points
        The output that is wanted, and where.
    value
        Returns the values of an input.
    """

    source: Any
    points: Points
    value: Callable[[Any], Any]

    @property
    def node(self) -> Any:
        """The node."""
        return self.source.node

    @property
    def output(self) -> str:
        """The name of the output."""
        return str(self.source.name)

    @property
    def is_number(self) -> bool:
        """Whether the output is a number."""
        return bool(self.source.type == "VALUE")

    def __getitem__(self, name: str) -> Any:
        """Return the values of an input by its name."""
        return self.value(self.node.inputs[name])

    def inputs(self) -> list[Any]:
        """Return the values of the inputs that count, in their order."""
        return [self.value(each) for each in self.node.inputs if each.enabled]

    def place(self, otherwise: Any = None) -> Any:
        """Return the coordinates (N, 3) of a texture, which are the generated ones, or others, without a link."""
        socket = self.node.inputs.get("Vector")
        if socket is not None and socket.is_linked:
            return self.value(socket)
        return self.points.generated if otherwise is None else otherwise

    def unknown(self) -> UnknownNodeError:
        """Return the error that says that the node has no known value."""
        return UnknownNodeError(self.node.name)


def own_value(socket: Any) -> Any:
    """Return the value that a socket has without a link, as a single row."""
    return np.atleast_2d(np.asarray(socket.default_value, np.float64))[:, :3]


#: By the type of a node: what makes the values of its outputs.
Functions = dict[str, Callable[[Call], Any]]


def of_inputs(function: Callable[..., Any]) -> Callable[[Call], Any]:
    """Return what makes values by a function of the inputs alone."""
    return lambda call: function(*call.inputs())
