"""Numbers that a user gives, possibly with gradients enabled: checked in NumPy, and attached to Dr.Jit's AD graph.

Kernels take the plain number as an opaque input, whatever it was computed from, so that a step of an optimiser compiles
no kernel. Only `drjit.replace_grad` connects that input to the graph from which an attached number was computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, Union

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..runtime.device import Array3f, Float, UInt32
from ..scene import Array, SceneError, at_bounds, has_gradients, numbers, shown
from .arrays import opaque, to_float, to_vectors

#: A number; a Dr.Jit `Float` of one entry may have gradients enabled.
Number: TypeAlias = Union[float, "Float"]
#: Numbers or vectors, (M,) or (M, 3), as NumPy takes them, or a Dr.Jit array of them, whose gradients may be enabled.
Numbers: TypeAlias = Union[npt.ArrayLike, "Float", "Array3f", "TensorXf"]

#: The largest number for single precision.
LARGEST = 1e38
#: The smallest number by which single precision can divide.
SMALLEST = 1e-37

# Step of central differences in double precision, relative to the number: they err by some 1e-10.
_STEP = 1e-6


if TYPE_CHECKING:
    from drjit.auto.ad import TensorXf

    from .types import Floats


class Given(NamedTuple):
    """Numbers in NumPy and, if gradients are enabled, the same as one attached Float, row by row (else None)."""

    plain: Array
    attached: Any = None

    def at_least(self, axes: int) -> Given:
        """Return the numbers with at least this many `axes`; axes of one entry are added in front."""
        return Given(np.array(self.plain, ndmin=axes), self.attached)

    @property
    def rows(self) -> list[Given]:
        """The entries along the first axis."""
        size = self.plain[0].size if len(self.plain) else 0
        if self.attached is None:
            return [Given(row) for row in self.plain]
        entries = dr.arange(UInt32, size)
        parts = (dr.gather(Float, self.attached, entries + _index(size * number)) for number in range(len(self.plain)))
        return [Given(row, part) for row, part in zip(self.plain, parts, strict=True)]

    @property
    def vectors(self) -> Array3f:
        """Attached numbers (N, 3) as an Array3f."""
        first = 3 * dr.arange(UInt32, len(self.plain))
        return Array3f(*(dr.gather(Float, self.attached, first + _index(axis)) for axis in range(3)))

    @property
    def value(self) -> Any:
        """One number as a Float, or three as an Array3f; opaque, and attached if the numbers are."""
        value = opaque(self.plain)
        if self.attached is None:
            return value
        entries = [dr.gather(Float, self.attached, _index(i)) for i in range(self.plain.size)]
        return dr.replace_grad(value, type(value)(*entries))


def given(value: object, name: str, expected: str, bounds: tuple[float, ...] = ()) -> Given:
    """Return the numbers that a user gave, as `scene.at_bounds` does; if `value` is none, SceneError says so.

    The message says what was `expected` of `name`.
    """
    attached = has_gradients(value)
    plain = numbers(dr.detach(value) if attached else value, name, expected)
    return Given(at_bounds(plain, *bounds), _flat(value) if attached else None)


def given_number(
    value: object, name: str, expected: str, low: float = -LARGEST, high: float = LARGEST,
    shapes: tuple[tuple[int, ...], ...] = ((),),
) -> Given:  # fmt: skip
    """Return one number, or numbers of one of these shapes, from `low` to `high`.

    Else SceneError says what was `expected` of `name`.
    """
    found = given(value, name, expected, (low, high))
    plain = found.plain.reshape(()) if found.plain.size == 1 else found.plain
    if plain.shape not in shapes or not np.all((plain >= low) & (plain <= high)):
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    return Given(plain, found.attached)


def given_color(value: object, name: str, expected: str, low: float = -LARGEST) -> Given:
    """Return one number or three, none below `low`; else SceneError says what was `expected` of `name`."""
    return given_number(value, name, expected, low, shapes=((), (3,)))


def finite(value: object, name: str, expected: str, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape, in double precision; else SceneError says what was `expected` of `name`."""
    found = numbers(value, name, expected).astype(np.float64)
    if found.shape != shape or not np.all(np.isfinite(found)):
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    return found


def _index(entry: int) -> UInt32:
    """Return the index of an entry, as an input: kernels of derivatives would be others for each entry."""
    return dr.opaque(UInt32, entry)


def _flat(value: Any) -> Float:
    """Return all entries of an array, or of arrays in lists, as one Float, attached: vector after vector."""
    if isinstance(value, list | tuple):
        return dr.concat([_flat(each) for each in value])
    if not dr.is_array_v(value):
        return to_float(np.asarray(value, dtype=np.float64))
    if dr.is_tensor_v(value):
        return Float(value.array)
    return Float(dr.ravel(value) if dr.depth_v(value) > 1 else value)


def derived(function: Callable[..., Floats], *parts: Given, color: bool = False) -> Any:
    """Return a function of numbers as an input of kernels: a Float or an Array3f, attached if one of them is.

    The function must take NumPy's and Dr.Jit's numbers. With `color`, a single number is repeated three times.
    """
    plain = np.asarray(function(*(each.plain for each in parts)))
    value = opaque(np.broadcast_to(plain.reshape(-1), (3,)) if color else plain)
    if all(each.attached is None for each in parts):
        return value
    return dr.replace_grad(value, type(value)(function(*(each.value for each in parts))))


def table(function: Callable[..., Array], *parts: Given) -> Any:
    """Return the result of a NumPy function of numbers, (K,) or (K, 3), or an attached Float or Array3f of it.

    Its derivatives by the numbers with gradients are central differences in double precision.
    """
    plain = [each.plain for each in parts]
    values = function(*plain)
    if all(each.attached is None for each in parts):
        return values
    tangent: Any = 0
    for place, each in enumerate(parts):
        for entry in range(each.plain.size if each.attached is not None else 0):
            number = dr.gather(Float, each.attached, _index(entry))
            tangent = tangent + _device(_slope(function, plain, place, entry)) * number
    return dr.replace_grad(_device(values), tangent)


def _slope(function: Callable[..., Array], plain: Sequence[Array], place: int, entry: int) -> Array:
    """Return the derivative of a function by one entry of one of its arguments."""
    step = _STEP * max(1.0, abs(plain[place].flat[entry]))
    ends = []
    for sign in (1, -1):
        moved = plain[place].copy()
        moved.flat[entry] += sign * step
        ends.append(function(*plain[:place], moved, *plain[place + 1 :]))
    return (ends[0] - ends[1]) / (2 * step)


def _device(values: Array) -> Any:
    return to_vectors(values) if np.ndim(values) == 2 else to_float(values)
