"""Interpolation of knots: none, linear, smooth, Catmull–Rom, monotone, by SciPy's interpolators."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

Interpolation = Literal["none", "linear", "smooth", "catmull-rom", "monotone"]

# A kernel reads the ramp from a table; at 1024 points a corner moves by at most half a thousandth of the ramp.
RESOLUTION = 1024


def interpolate(
    knots: npt.NDArray[np.float64], colors: npt.NDArray[np.float64], interpolation: Interpolation, x: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Return the ramp's colours (K, 3) at x (K,); constant before the first and after the last knot.

    "smooth" eases by 3t² − 2t³ between neighbours; "catmull-rom" takes each knot's slope from its two neighbours;
    "monotone" is Fritsch–Carlson (PCHIP): it never overshoots the knots' colours.
    """
    place = np.clip(np.asarray(x, dtype=np.float64), knots[0], knots[-1])
    if len(knots) == 1:
        return np.broadcast_to(colors[0], (*place.shape, 3))
    if interpolation == "monotone":
        return PchipInterpolator(knots, colors)(place)
    if interpolation == "catmull-rom":
        return CubicHermiteSpline(knots, colors, np.gradient(colors, knots, axis=0))(place)
    index = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
    t = (place - knots[index]) / (knots[index + 1] - knots[index])
    if interpolation == "none":
        t = np.where(place >= knots[-1], 1.0, 0.0)
    elif interpolation == "smooth":
        t = t * t * (3 - 2 * t)
    return colors[index] + t[..., None] * (colors[index + 1] - colors[index])


def ramp_table(
    knots: npt.NDArray[np.float64], colors: npt.NDArray[np.float64], interpolation: Interpolation
) -> tuple[npt.NDArray[np.float64], float, float]:
    """Check a ramp and return its table (RESOLUTION, 3) and the positions of the table's two ends."""
    if interpolation not in get_args(Interpolation):
        raise ValueError(f"interpolation is {interpolation!r}: expected one of {', '.join(get_args(Interpolation))}")
    if knots.ndim != 1 or not len(knots) or colors.shape != (len(knots), 3):
        raise ValueError(f"a ramp has knots {knots.shape} and colours {colors.shape}: expected (M,) and (M, 3)")
    if not (np.all(np.isfinite(knots)) and np.all(np.isfinite(colors))):
        raise ValueError("a ramp has a knot or a colour that is not finite")
    if np.any(np.diff(knots) <= 0):
        raise ValueError(f"a ramp's knots are {knots.tolist()}: expected positions that ascend")
    low, high = float(knots[0]), float(knots[-1])
    if low == high:
        high = low + 1.0
    # Catmull–Rom may undershoot: light is not negative.
    values = np.maximum(interpolate(knots, colors, interpolation, np.linspace(low, high, RESOLUTION)), 0.0)
    return values, low, high
