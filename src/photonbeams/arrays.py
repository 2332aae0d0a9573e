"""NumPy's numbers as Dr.Jit arrays, in memory of their own.

Dr.Jit wraps NumPy's memory as it is, and whether an input is aligned is part of a kernel: kernels would be compiled
again by the chance of an address.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .device import Array3f, Float, UInt32

_ALIGNMENT = 64  # bytes: a vector register


def to_float(numbers: npt.ArrayLike) -> Any:
    """Return numbers, flattened, as a Float."""
    return Float(_aligned(numbers, np.float32))


def to_uint(numbers: npt.ArrayLike) -> Any:
    """Return numbers, flattened, as a UInt32."""
    return UInt32(_aligned(numbers, np.uint32))


def to_vectors(numbers: npt.ArrayLike) -> Any:
    """Return (N, 3) numbers as an Array3f."""
    return Array3f(*(to_float(axis) for axis in np.asarray(numbers).T))


def _aligned(numbers: npt.ArrayLike, kind: type) -> npt.NDArray[Any]:
    given = np.ravel(numbers)
    memory = np.empty(given.size * np.dtype(kind).itemsize + _ALIGNMENT, dtype=np.uint8)
    first = -memory.ctypes.data % _ALIGNMENT
    result: npt.NDArray[Any] = memory[first : first + given.size * np.dtype(kind).itemsize].view(kind)
    result[:] = given
    return result
