"""A function on [0, 1] as a table with linear interpolation: the form of ramps, textures and profiles in a kernel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import padded, to_float
from ..numerics.given import SMALLEST
from ..runtime.device import Array2f, Array3f, Array4f, Float, UInt32
from ..scene import Array, SceneError
from .factors import Value


class Places:
    """Ascending places in device memory: neither their values nor their number is part of a kernel.

    Parameters
    ----------
    values
        One or more numbers, in any order.
    """

    def __init__(self, values: Iterable[float]) -> None:
        places = sorted({*values})
        self._data = to_float(padded(places))
        self.count = dr.opaque(UInt32, len(places))

    def __call__(self, number: UInt32) -> Float:
        """Return the place with this number."""
        return dr.gather(Float, self._data, dr.minimum(number, self.count - 1))


class Table:
    """A table of M ≥ 2 values at equal steps of [0, 1], clamped outside.

    Parameters
    ----------
    values
        (M,) numbers or (M, 3) colours; a Float or an Array3f stays attached to the AD graph.
    steps
        Places in [0, 1] where colours change at once, at most one of them between two entries.

    Raises
    ------
    SceneError
        If there are fewer than two values, or if they have another shape.

    Notes
    -----
    A look-up gathers one packet with both neighbours (numbers) or two packets (colours), since gathers, not arithmetic,
    limit the speed of the estimators' loops.
    """

    def __init__(self, values: Value | npt.ArrayLike, steps: npt.ArrayLike = ()) -> None:
        if dr.is_jit_v(values):  # Dr.Jit arrays stay attached to the AD graph
            self._attach(values, steps)
            return
        numbers = np.asarray(values, dtype=np.float32)
        if numbers.ndim not in (1, 2) or len(numbers) < 2:
            raise SceneError(f"a table has shape {numbers.shape}: expected (M,) or (M, 3) with M of at least 2")
        self.colour = numbers.ndim == 2
        if self.colour:
            packed = np.zeros((len(numbers), 4), np.float32)
            packed[:, :3] = numbers
            packed[:, 3] = _steps(steps, len(numbers))
        else:
            packed = np.stack([numbers, np.append(numbers[1:], numbers[-1])], axis=1)
        self._data = to_float(packed)
        self._last = dr.opaque(UInt32, len(numbers) - 1)

    def _attach(self, values: Any, steps: npt.ArrayLike) -> None:
        count = dr.width(values)
        if count < 2:
            raise SceneError(f"a table has {count} entries: expected at least 2")
        self.colour = dr.depth_v(values) == 2
        number, last = dr.arange(UInt32, count), dr.opaque(UInt32, count - 1)
        if self.colour:
            packet: Any = Array4f(values.x, values.y, values.z, to_float(_steps(steps, count)))
        else:
            packet = Array2f(values, dr.gather(Float, values, dr.minimum(number + 1, last)))
        self._data = dr.zeros(Float, dr.size_v(packet) * count)
        dr.scatter(self._data, packet, number)
        self._last = last

    def __call__(self, x: Float) -> Value:
        """Return the interpolated value at x (of any width): a Float, or an Array3f for a table of colours."""
        place = dr.clip(x, 0, 1) * type(x)(self._last)
        # A NaN becomes an arbitrary index; `minimum` keeps the gather inside of the table.
        index = dr.minimum(UInt32(place), self._last - 1)
        weight = place - type(x)(index)
        if self.colour:
            low = dr.gather(Array4f, self._data, index)
            high = dr.gather(Array4f, self._data, index + 1)
            weight = dr.select(low.w > 0, dr.select(weight < low.w, 0, 1), weight)
            return dr.lerp(Array3f(low.xyz), Array3f(high.xyz), weight)
        pair = dr.gather(Array2f, self._data, index)
        return dr.lerp(pair.x, pair.y, weight)


def _steps(places: npt.ArrayLike, count: int) -> Array:
    """Return, for each of `count` entries, how far toward the next one the colour changes at once, or 0."""
    result = np.zeros(count)
    place = np.asarray(places, dtype=np.float64) * (count - 1)
    entry = np.maximum(np.ceil(place) - 1, 0).astype(np.int64)
    result[entry] = np.maximum(place - entry, SMALLEST)
    return result
