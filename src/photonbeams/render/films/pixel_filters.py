"""Pixel filters of Mitsuba's, through which samples are summed; None is the box."""

from __future__ import annotations

from math import ceil
from typing import Any

import drjit as dr
import numpy as np

from ...numerics.arrays import to_float
from ...runtime.device import Array2f, Float, UInt32, mitsuba

mi = mitsuba()

_STEPS = 1024  # of integrals over a filter


def reconstruction_filter(name: str | None, own: Any = None) -> Any:
    """Return Mitsuba's pixel filter called `name`, or `own` if the name is None; None for the box."""
    chosen = own if name is None else mi.load_dict({"type": name})
    return None if chosen is None or chosen.is_box_filter() else chosen


def averaged(reconstruction: Any) -> float:
    """Return how many pixels a filter averages: the factor (∫f)² / ∫f² by which it lowers independent noise in pixels.

    For the box it is 1. Filters are products of the same function of x and of y.
    """
    if reconstruction is None:
        return 1.0
    f = filter_weights(reconstruction)
    return float(2 * float(reconstruction.radius()) * f.sum() ** 2 / (_STEPS * (f * f).sum())) ** 2


def filter_weights(reconstruction: Any) -> np.ndarray:
    """Return the weights of a filter from one end to the other."""
    radius = float(reconstruction.radius())
    weights: np.ndarray = reconstruction.eval(dr.linspace(Float, -radius, radius, _STEPS)).numpy()
    return weights


def spread(reconstruction: Any, place: Array2f) -> Array2f:
    """Return places around a pixel's, whose square is [0, 1)², that are as dense as a filter is heavy.

    `place` is uniform in the unit square. Negative lobes of a filter count as 0.
    """
    radius = float(reconstruction.radius())
    total = np.cumsum(np.maximum(filter_weights(reconstruction), 0), dtype=np.float64)
    inverse = np.interp(np.linspace(0, 1, _STEPS), total / total[-1], np.linspace(-radius, radius, _STEPS))
    table, result = to_float(inverse), []
    for axis in place:
        at = axis * (_STEPS - 1)
        first = dr.minimum(UInt32(at), _STEPS - 2)
        low, high = dr.gather(Float, table, first), dr.gather(Float, table, first + 1)
        result.append(0.5 + dr.lerp(low, high, at - Float(first)))
    return Array2f(*result)


def margin_of(reconstruction: Any) -> int:
    """Return how many pixels a filter reaches beyond a crop window."""
    return 0 if reconstruction is None else ceil(float(reconstruction.radius()) - 0.5)
