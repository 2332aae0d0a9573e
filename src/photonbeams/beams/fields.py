"""The arrays of `Beams`: their names, their values as Dr.Jit arrays, and the beams that an index selects."""

from __future__ import annotations

from typing import Any, TypeAlias, Union

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import to_float, to_vectors
from ..numerics.given import Numbers
from ..runtime.device import Array3f, Float, UInt32
from ..scene import Array, SceneError, numbers, shown

#: Names of the arrays that are required.
REQUIRED = ("start", "end", "radius_start", "radius_end", "power")
#: Names of the arrays that are optional.
OPTIONAL = (
    "offset", "total", "entry", "end_normal", "start_tangent", "end_tangent", "power_end", "random", "id", "generation",
    "start_normal", "side", "side_normal",
)  # fmt: skip
#: Names of the arrays that hold vectors or colours, (N, 3); the others are (N,).
VECTORS = (
    "start", "end", "power", "end_normal", "start_tangent", "end_tangent", "power_end", "start_normal", "side",
    "side_normal",
)  # fmt: skip
#: Names of the vectors of unit length, or of length 0, and of the arrays that tell beams apart.
UNIT = ("end_normal", "start_tangent", "end_tangent", "start_normal", "side_normal")
NAMING = ("random", "id", "generation")
#: An index of beams, which is a number, a slice, a list, or a NumPy or Dr.Jit array of numbers or truth values.
Index: TypeAlias = Union[int, slice, npt.ArrayLike, "UInt32"]


def count_of(start: Any) -> int:
    """Return the number of beams that begin at `start`."""
    if start is None:  # `beam_array` says so
        return 0
    if dr.is_jit_v(start) and not dr.is_tensor_v(start):
        return int(dr.width(start))
    found = dr.detach(start).numpy() if dr.is_jit_v(start) else numbers(start, *_said("start"))
    return len(np.atleast_2d(found)) if found.size else 0


def _said(name: str) -> tuple[str, str]:
    """Return the name of an argument in messages, and what is expected of it."""
    return f"Beams: {name}", f"numbers of shape {'(N, 3)' if name in VECTORS else '(N,)'}"


def beam_array(value: Numbers | None, name: str, count: int) -> Any:
    """Return `value` as a Float or an Array3f of width `count`; only host values are checked to be finite."""
    vector = name in VECTORS
    if value is None:
        raise SceneError(f"Beams: {name} is not given: expected {_said(name)[1]}")
    if dr.is_jit_v(value):
        return _broadcast(_of_device(value, name), name, count)
    shape = (count, 3) if vector else (count,)
    found = numbers(value, *_said(name))
    if not count and not found.size:  # an empty list has one axis
        found = np.zeros(shape)
    try:
        with np.errstate(over="ignore"):
            wide = np.broadcast_to(found.astype(np.float32, copy=False), shape)
    except ValueError:
        raise SceneError(f"Beams: {name} has shape {found.shape}: expected {shape}") from None
    if not np.all(np.isfinite(wide)):
        raise SceneError(
            f"Beams: {name} of beam {int(np.argwhere(~np.isfinite(wide))[0][0])} is not finite: expected finite numbers"
        )
    return to_vectors(wide) if vector else to_float(wide)


def _of_device(value: Any, name: str) -> Float | Array3f:
    """Return a Dr.Jit array or tensor as a Float or an Array3f that stays attached to the AD graph."""
    vector, shape = name in VECTORS, tuple(value.shape)
    if dr.is_tensor_v(value):
        if vector and len(shape) in (1, 2) and shape[-1] == 3:
            return dr.unravel(Array3f, Float(value.array))
        if not vector and len(shape) < 2:
            return Float(value.array)
    elif dr.depth_v(value) == 1 or (vector and dr.depth_v(value) == 2 and dr.size_v(value) == 3):
        return Array3f(value) if vector else Float(value)
    raise SceneError(f"Beams: {name} is a {type(value).__name__} of shape {shape}: expected {_said(name)[1]}")


def _broadcast(value: Float | Array3f, name: str, count: int) -> Float | Array3f:
    if dr.width(value) == 1 and count > 1:  # one number for all beams: broadcast, so that it can be gathered
        value = value + dr.zeros(Float, count)
    if dr.width(value) != count:
        raise SceneError(f"Beams: {name} has {dr.width(value)} entries: expected {count}, as start has")
    return value


def check_radii(start: Float, end: Float) -> None:
    """Raise SceneError if a radius is negative, or if both radii of a beam are 0."""
    if dr.width(start) and bool(dr.any((start < 0) | (end < 0) | (start + end <= 0))):
        raise SceneError("Beams: a radius is negative, or both of a beam are 0: expected 0 or more, and not both 0")


class _NoSuchBeamError(SceneError, IndexError):
    """No beam has this index. Python's iteration over `beams[i]` ends at an IndexError."""


def _whole(index: Any) -> Array:
    """Return an index as an array; an empty list is an array of no indices, not of no floats."""
    found = np.asarray(index)
    return found.astype(np.int64) if not found.size and found.ndim == 1 else found


def positions(index: Any, count: int) -> Array:
    """Return the positions, (M,), of the beams that an index selects."""
    if index is not None and dr.is_jit_v(index):
        index = index.numpy()
    try:
        found: Array = np.arange(count)[index if isinstance(index, slice | tuple) else _whole(index)]
    except (IndexError, ValueError, TypeError):
        found = np.zeros((0, 0))
    if found.ndim > 1 or isinstance(index, tuple):
        text = f"{count:,} beams are indexed by {shown(index)}: expected a slice, one truth value for each, or numbers"
        raise _NoSuchBeamError(f"{text} from {-count} to {count - 1}")
    return np.atleast_1d(found)
