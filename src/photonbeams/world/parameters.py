"""The parameters of Mitsuba's objects, to find out whether anything has changed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import drjit as dr

from ..runtime.device import mitsuba

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiObject, SceneParameters

mi = mitsuba()


def values_of(parameters: SceneParameters) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of what Mitsuba's `traverse` returns, without parameters that have no value."""
    for name in list(parameters.properties):
        try:
            value = parameters[name]
        except TypeError:  # such as parameters of hair, which Mitsuba lists but cannot return
            continue
        yield name, value


class Parameters:
    """A snapshot of all parameters of some Mitsuba objects; two are equal if no parameter has changed in between.

    Setting a parameter creates a new Dr.Jit variable, so only the variables' numbers are compared, not their values.
    While the variables are held here, no other variable gets their numbers.
    """

    def __init__(self, *objects: MiObject) -> None:
        self._held: list[Any] = []
        self._names: list[Any] = []
        for each in objects:
            for name, value in values_of(mi.traverse(each)):
                self._names.append((name, *self._variables(value)))

    def _variables(self, value: Any) -> list[Any]:
        """Return the numbers of a value's variables, or the value itself where it has none."""
        if hasattr(value, "matrix"):  # a transform, which is no array
            return self._variables(value.matrix)
        if dr.is_tensor_v(value):
            return [*value.shape, *self._variables(value.array)]
        if not dr.is_array_v(value):
            return [value]
        if dr.depth_v(value) > 1:
            return [number for each in value for number in self._variables(each)]
        self._held.append(type(value)(value))  # a copy: components of a vector are views, which follow it
        return [value.index if dr.is_jit_v(value) else tuple(value)]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parameters) and self._names == other._names
