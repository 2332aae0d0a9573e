"""Interpolation of knots: none, linear, smooth, Catmull–Rom, monotone."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from ..numerics.given import Given
from ..runtime.device import Float
from ..scene import Array, SceneError, choice, shown

Interpolation = Literal["none", "linear", "smooth", "catmull-rom", "monotone"]

# A kernel reads the ramp from a table. With 1024 points, a corner moves by at most half a thousandth of the ramp.
RESOLUTION = 1024


def interpolate(knots: Array, colors: Array, interpolation: Interpolation, x: npt.ArrayLike) -> Array:
    """Return the ramp's colours (K, 3) at x (K,); constant before the first and after the last knot.

    "smooth" eases by 3t² − 2t³ between neighbours; "catmull-rom" takes each knot's slope from its two neighbours;
    "monotone" is Fritsch–Carlson (PCHIP): it never overshoots the knots' colours.
    """
    place = np.clip(np.asarray(x, dtype=np.float64), knots[0], knots[-1])
    if len(knots) == 1:
        return np.broadcast_to(colors[0], (*place.shape, 3))
    if interpolation in ("catmull-rom", "monotone"):
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # take long to import

        monotone = interpolation == "monotone"
        slopes = np.gradient(colors, knots, axis=0)
        curve = PchipInterpolator(knots, colors) if monotone else CubicHermiteSpline(knots, colors, slopes)
        return curve(place)
    index = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
    t = (place - knots[index]) / (knots[index + 1] - knots[index])
    if interpolation == "none":
        t = np.floor(t)  # which is 1 at the last knot
    elif interpolation == "smooth":
        t = t * t * (3 - 2 * t)
    return colors[index] + t[..., None] * (colors[index + 1] - colors[index])


def check_ramp(knots: Array, colors: Array, interpolation: Interpolation) -> None:
    """Raise SceneError unless these arrays are a ramp."""
    choice(interpolation, "interpolation", get_args(Interpolation))
    if knots.ndim != 1 or not len(knots) or colors.shape != (len(knots), 3):
        raise SceneError(f"a ramp has knots {knots.shape} and colours {colors.shape}: expected (M,) and (M, 3)")
    if not (np.all(np.isfinite(knots)) and np.all(np.isfinite(colors))):
        raise SceneError("a ramp has a knot or a colour that is not finite: expected finite numbers")
    if np.any(np.diff(knots) <= 0):
        raise SceneError(f"a ramp's knots are {shown(knots.tolist())}: expected positions that ascend")


def ramp_ends(knots: Given) -> Given:
    """Return the positions of a ramp's knots; a single knot, whose ramp is constant, gets an interval of length 1."""
    if len(knots.plain) > 1:
        return knots
    (only,) = knots.rows
    return Given(knots.plain[0] + np.arange(2.0), None if only.attached is None else only.attached + Float([0.0, 1.0]))


def ramp_table(knots: Array, colors: Array, interpolation: Interpolation) -> Array:
    """Return a ramp's table, (RESOLUTION, 3), from its first knot to its last."""
    places = np.linspace(knots[0], knots[-1], RESOLUTION)
    # Catmull–Rom may undershoot, but light is not negative.
    return np.maximum(interpolate(knots, colors, interpolation, places), 0.0)
