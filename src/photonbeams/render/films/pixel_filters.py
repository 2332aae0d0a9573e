"""Pixel filters of Mitsuba's, through which samples are summed; None is the box."""

from __future__ import annotations

from math import ceil
from typing import Any

import drjit as dr
import numpy as np

from ...runtime.device import Float, mitsuba

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


def margin_of(reconstruction: Any) -> int:
    """Return how many pixels a filter reaches beyond a crop window."""
    return 0 if reconstruction is None else ceil(float(reconstruction.radius()) - 0.5)
