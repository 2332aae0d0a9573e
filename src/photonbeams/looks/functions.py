"""Factors from Python functions of Dr.Jit arrays."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from ..runtime.device import Array3f, Float
from ..scene import SceneError, arguments, shown
from .context import INPUTS, ShadingContext
from .described import described
from .factors import Factor, Value


class Function(Factor):
    """A factor from a Python function of Dr.Jit arrays, which is traced into the kernel.

    Parameters
    ----------
    function
        Returns a number or a colour (a Float, an Array3f or a Python number). Its parameters name the inputs that it
        takes: s, distance, r, t, angle, cosine, P, Pl, time, frame, random, id, light, generation; a parameter `at`
        takes the `ShadingContext`. A single parameter of any other name, and a single s, r or t, takes the input
        `argument`.
    argument
        Attribute of `ShadingContext` that a function of one parameter takes. Default: "distance".

    Raises
    ------
    SceneError
        If it is not a function, or if one of several parameters is not an input. When the factor is evaluated: if the
        function fails, or if it returns neither a number nor a colour.

    Notes
    -----
    Numbers that the function closes over become part of the kernel: make them `drjit.opaque(...)` values if they change
    from frame to frame.

    Examples
    --------
    >>> import drjit as dr
    >>> bands = pb.looks.Function(lambda distance: 0.6 + 0.4 * dr.cos(12 * distance))
    >>> round(bands.evaluate(pb.looks.ShadingContext(distance=0.0)), 3)
    1.0
    >>> torn = pb.looks.Function(lambda r, random: dr.select(r < random, 1.0, 0.0))
    >>> look = pb.Look(across=pb.looks.Uniform() * torn)
    """

    rough = wild = True

    @arguments
    def __init__(self, function: Callable[..., Value | float], argument: str = "distance") -> None:
        if not callable(function) or isinstance(function, type):
            raise SceneError(f"a look's function is {shown(function)}: expected a Python function")
        if not hasattr(ShadingContext, argument):
            raise SceneError(f"a function's argument is {shown(argument)}: expected an attribute of ShadingContext")
        self._function, self.arguments = function, _arguments(function, argument)

    def __repr__(self) -> str:
        return f"Function({described(self._function)})"

    def evaluate(self, at: ShadingContext) -> Value:
        """Call the function."""
        return self.called(*(at if each == "at" else getattr(at, each) for each in self.arguments))

    def called(self, *given: Value | ShadingContext) -> Any:
        """Return the function's value for the inputs `given`; raise SceneError if it fails or returns no colour."""
        name = getattr(self._function, "__name__", "function")
        try:
            value = self._function(*given)
        except (Exception, SystemExit) as error:
            raise SceneError(f"the look's function {name} failed: {error}") from error
        check_value(value, f"the look's function {name}")
        count = max((dr.width(each) for each in given if dr.is_array_v(each)), default=0)
        if count and dr.width(value) not in (1, count):
            text = f"returns {dr.width(value)} values for {count}: expected one for each, or one"
            raise SceneError(f"the look's function {name} {text}")
        double = [dr.type_v(each) == dr.VarType.Float64 for each in (value, *given) if dr.is_array_v(each)]
        if any(double) and dr.is_array_v(value) and not all(double):  # loop states must keep one precision
            return Array3f(value) if dr.size_v(value) == 3 else Float(value)
        return value


def check_value(value: object, name: str) -> None:
    """Raise SceneError unless the value of the factor `name` is a number or a colour for each lane."""
    if not _is_colour(value):
        hint = ", made by functions of Dr.Jit, not of NumPy" if isinstance(value, np.ndarray) else ""
        kind = type(value).__name__
        raise SceneError(f"{name} returns a {kind}: expected a Float, an Array3f or a number{hint}")


def _is_colour(value: object) -> bool:
    if dr.is_array_v(value):
        return dr.depth_v(value) == 1 or dr.size_v(value) == 3
    return isinstance(value, int | float | np.number)


# Inputs that a function's only parameter takes by its name; s, r and t are common names for the factor's own input.
_SPEAKING = frozenset(INPUTS) - {"s", "r", "t"}


def _arguments(function: Callable[..., object], own: str) -> list[str]:
    """Return the attributes of `ShadingContext` that a function's parameters name."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        return [own]
    names = [
        p.name for p in parameters if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    if names == ["at"]:
        return names
    if len(names) < 2:
        return [INPUTS[name] if name in _SPEAKING else own for name in names] or [own]
    unknown = [name for name in names if name not in INPUTS and name != "at"]
    if unknown:
        raise SceneError(f"a look's function has a parameter {unknown[0]!r}: expected one of {', '.join(INPUTS)}, at")
    return [INPUTS.get(name, name) for name in names]
