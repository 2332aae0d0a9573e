"""Values of shader nodes at points: each node is evaluated once."""

from __future__ import annotations

from typing import Any

import numpy as np

from .calls import Call, Functions, Points, anywhere, own_value
from .functions import COLORS, LUMINANCE, NUMBERS
from .links import linked_to
from .patterns import PATTERNS

_SAME = 1e-5  # values that differ relatively by less are the same
_NODES: Functions = {**COLORS, **NUMBERS, **PATTERNS}


def evaluated(source: Any, points: Points | None = None) -> Any:
    """Return the values of a node's output at points, by default anywhere; errors as of `Evaluation.output`."""
    return Evaluation(points or anywhere()).output(source)


class Evaluation:
    """Values at some points.

    Parameters
    ----------
    points
        Where.
    others
        Functions of types of nodes that have no value elsewhere.
    """

    def __init__(self, points: Points, others: Functions | None = None) -> None:
        self._points, self._functions = points, {**_NODES, **(others or {})}
        self._values: dict[Any, Any] = {}

    def output(self, source: Any) -> Any:
        """Return the values of an output.

        Raises
        ------
        UnknownNodeError
            A node of another kind has an influence.
        """
        if source not in self._values:
            call = Call(source, self._points, self.input)
            try:
                with np.errstate(all="ignore"):
                    values = np.atleast_2d(np.asarray(self._functions[source.node.type](call), np.float64))
            except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:  # of another version
                raise call.unknown() from error
            # What cannot be computed, such as a division by zero, is 0.
            self._values[source] = _converted(np.nan_to_num(values, posinf=0, neginf=0), source.type, "")
        return self._values[source]

    def input(self, socket: Any) -> Any:
        """Return the values of an input."""
        source = linked_to(socket)
        if source is not None and source.is_output:
            return _converted(self.output(source), socket.type, source.type)
        return own_value(source or socket)


def varies(values: Any) -> bool:
    """Return whether values are not the same everywhere, but for rounding."""
    return bool(np.ptp(values, axis=0).max() > _SAME * max(np.abs(values).max(), _SAME))


def _converted(values: Any, kind: str, origin: str) -> Any:
    """Return values as sockets of a kind have them: of colours the luminance, of vectors the mean."""
    if kind != "VALUE":
        return np.repeat(values, 3, axis=1) if values.shape[1] == 1 else values
    if values.shape[1] == 1:
        return values
    return values @ LUMINANCE if origin == "RGBA" else values.mean(axis=1, keepdims=True)
