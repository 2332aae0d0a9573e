"""Dr.Jit arrays from NumPy arrays, in memory of their own, and back; compress and join arrays and structs of them.

The memory is aligned, because Dr.Jit uses NumPy's memory as it is, and a kernel depends on whether its inputs are
aligned: kernels would be compiled again depending on an address.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..runtime.device import Array3f, Array4f, Bool, Float, UInt32

Array = npt.NDArray[Any]
T = TypeVar("T")  # an array, or a struct of arrays

_ALIGNMENT = 64  # bytes: a vector register


def to_float(numbers: npt.ArrayLike) -> Float:
    """Return numbers, flattened, as a Float."""
    return Float(_aligned(numbers, np.float32))


def to_uint(numbers: npt.ArrayLike) -> UInt32:
    """Return numbers, flattened, as a UInt32."""
    return UInt32(_aligned(numbers, np.uint32))


def to_vectors(numbers: npt.ArrayLike) -> Array3f:
    """Return (N, 3) numbers as an Array3f."""
    return Array3f(*(to_float(axis) for axis in np.asarray(numbers).T))


def to_numpy(parts: Iterable[dr.ArrayBase]) -> Array:
    """Return the components of a vector, or several arrays, as rows (C, N); one entry stands for all.

    The vector's own `numpy()` is not used, because its kernel contains the number of entries, which differs from pass
    to pass.
    """
    rows = [*parts]
    dr.eval(rows)
    return np.stack(np.broadcast_arrays(*(each.numpy() for each in rows)))


def padded(entries: Any) -> Any:
    """Return a sequence or a NumPy array with its last entry repeated, for tables that kernels gather from.

    In Dr.Jit, a gather from an array of one entry is a broadcast, hence another kernel.
    """
    if isinstance(entries, np.ndarray):
        return np.concatenate([entries, entries[-1:]])
    return [*entries, entries[-1]]


def by_number(numbers: Sequence[int], values: npt.ArrayLike) -> Array:
    """Return a table with values at these numbers, and 0 elsewhere, for kernels that gather from it."""
    result = np.zeros(max(numbers, default=0) + 2)
    result[[*numbers]] = values
    return result


def opaque(value: npt.ArrayLike) -> Any:
    """Return numbers as an opaque Float or Array3f: an input of kernels, not a literal in them."""
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.ndim == 0:
        return dr.opaque(Float, float(numbers))
    return Array3f(*(dr.opaque(Float, float(number)) for number in numbers))


def _aligned(numbers: npt.ArrayLike, kind: type) -> Array:
    given = np.ravel(numbers)
    memory = np.empty(given.size * np.dtype(kind).itemsize + _ALIGNMENT, dtype=np.uint8)
    first = -memory.ctypes.data % _ALIGNMENT
    result: Array = memory[first : first + given.size * np.dtype(kind).itemsize].view(kind)
    result[:] = given
    return result


def taken(value: T, index: UInt32) -> T:
    """Return the entries at `index` of an array, or of all arrays in a struct; None stays None."""
    dr.eval(value)  # all at once: a gather would launch a kernel for each array that is not in memory
    return _each(lambda array: dr.gather(type(array), array, index), value)


def channel_mean(color: Any) -> Any:
    """Return the mean of the channels of colors, as a Float.

    `dr.mean` is not used, because its kernels contain the number of entries, which differs from pass to pass.
    """
    return dr.sum(color) * (1 / len(color))


def near_one(vector: Any) -> Any:
    """Return vectors times powers of 2 that bring them near length 1: squares stay in range, and no bit is lost."""
    # A float's bits 23 to 30 are its exponent, plus 127. A power of 2 has no others, and its inverse has 254 less that.
    largest: Any = dr.reinterpret_array(UInt32, Float(dr.detach(dr.max(dr.abs(vector)))))
    exponent = dr.clip(largest >> 23, 1, 253)
    return vector * dr.reinterpret_array(Float, (254 - exponent) << 23)


def indices(keep: Bool) -> Any:
    """Return where an array is true, in order: `dr.compress`, which lets other threads run while kernels do."""
    # Dr.Jit's own function waits for kernels with Python's lock held, and no signal could end a long one.
    dr.eval(keep)
    dr.sync_thread()
    return dr.compress(keep)


def compressed(keep: Bool, *values: object) -> list[Any]:
    """Return the entries of arrays and structs where `keep` is true, in order; an empty list if there are none.

    Everything is made opaque, even values that happen to be constant; otherwise kernels would differ between frames.
    """
    index = indices(keep)
    if not len(index):
        return []
    dr.make_opaque(values)
    return [taken(value, index) for value in values]


def joined(pieces: Sequence[T]) -> T:
    """Return all arrays, or structs of them, as one, in order.

    `dr.concat` is not used, because its kernels contain the lengths, which differ from pass to pass.
    """
    if len(pieces) == 1:
        return pieces[0]
    result = _each(lambda *arrays: dr.empty(type(arrays[0]), sum(map(dr.width, arrays))), *pieces)
    targets = _arrays(result)
    filled = [0] * len(targets)
    # Piece by piece, so that one kernel copies all arrays of a piece: before a second scatter to an array, Dr.Jit
    # launches everything that is pending.
    for piece in pieces:
        first = {begin: dr.opaque(UInt32, begin) for begin in dict.fromkeys(filled)}
        for at, (target, array) in enumerate(zip(targets, _arrays(piece), strict=True)):
            width = dr.width(array)
            dr.scatter(target, array, dr.arange(UInt32, width) + first[filled[at]])
            filled[at] += width
    return result


def packets(*pairs: tuple[Array3f, Any]) -> Float:
    """Return vectors, each with a scalar, as a table from which kernels gather an Array4f.

    Entry number i of pair number k is packet number i · len(pairs) + k. Scalars may be one number for all entries.
    """
    count, each = dr.width(pairs[0][0]), len(pairs)
    result = dr.zeros(Float, count * 4 * each)
    for number, (vector, scalar) in enumerate(pairs):
        packet = Array4f(vector.x, vector.y, vector.z, Float(scalar))
        dr.scatter(result, packet, dr.arange(UInt32, count) * each + number)
    dr.eval(result)
    return result


def unaliased(value: T) -> T:
    """Return an array, or a struct of them, with memory of its own for each component, and nothing constant.

    A kernel that reads one array twice differs from one that reads two.
    """
    dr.make_opaque(value)
    met: set[int] = set()
    result = _each(lambda array: _apart(array, met), value)
    dr.eval(result)
    return result


def equal_entries(one: T, other: T) -> Bool:
    """Return a Bool for each entry of two structs of one kind: whether all of their arrays are equal there."""
    result = Bool(True)
    for a, b in zip(_arrays(one), _arrays(other), strict=True):
        result &= dr.all(a == b) if dr.depth_v(a) > 1 else a == b
    return result


def _apart(array: Any, met: set[int]) -> Any:
    """Return an array, with copies of those components whose memory was `met` before; the others are added there."""
    if dr.depth_v(array) > 1:
        return type(array)(*(_apart(component, met) for component in array))
    if array.index not in met:
        met.add(array.index)
        return array
    # Each mask is a variable of its own, or Dr.Jit would find that two copies are the same.
    return dr.select(dr.opaque(Bool, True), array, type(array)(0))


def _arrays(value: object) -> list[Any]:
    """Return the arrays in a struct."""
    fields = _fields(value)
    if fields is None:
        return [] if value is None else [value]
    return [array for each in fields.values() for array in _arrays(each)]


def _each(function: Callable[..., dr.ArrayBase], *values: object) -> Any:
    """Return a function of arrays, applied to all arrays of structs of one kind."""
    fields = [_fields(value) for value in values]
    if fields[0] is None:
        return None if values[0] is None else function(*values)
    parts = {name: _each(function, *(each[name] for each in fields if each is not None)) for name in fields[0]}
    if isinstance(values[0], dict):
        return parts
    if isinstance(values[0], tuple):
        return getattr(values[0], "_make", tuple)(parts.values())
    result = type(values[0])()
    for name, part in parts.items():
        setattr(result, name, part)
    return result


def _fields(value: object) -> dict[Any, Any] | None:
    """Return the parts of a struct of Dr.Jit, a dictionary or a tuple; None for anything else."""
    if isinstance(value, dict):
        return value
    if isinstance(value, tuple):
        return dict(enumerate(value))
    names = getattr(type(value), "DRJIT_STRUCT", None)
    return None if names is None else {name: getattr(value, name) for name in names}
