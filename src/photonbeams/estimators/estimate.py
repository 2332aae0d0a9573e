"""Radiance of beams toward any rays: the estimators without an image."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..looks import BoundLook, Context, Fog, Look
from ..numerics.arrays import to_float, to_vectors
from ..quadrature import Rule, gauss_legendre
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Medium
from . import gradients
from .billboard import billboard_sum
from .frustum import frustum_sum
from .geometry import Rays
from .grid import sum_over_grid
from .points import Points
from .records import Packed, pack

ESTIMATORS = ("auto", "billboard", "frustum")

#: Points that a production needed at most (Talk, section 3).
DEFAULT_RULE = gauss_legendre(6)

#: Beams times rays up to which trying all is no slower: on two cores a grid of few beams takes 10 ms, 3 million tests.
MOST_PAIRS = 3_000_000

# Stands for a ray without end; its square is still a float32.
ENDLESS = 1e18


def estimate(
    beams: Beams,
    origin: Any,
    direction: Any,
    t_max: Any = None,
    *,
    look: Look | None = None,
    medium: Medium | Fog | None = None,
    estimator: str = "auto",
    rule: Rule = DEFAULT_RULE,
    t_min: Any = None,
    close: Beams | None = None,
    time: Any = None,
    context: Context | None = None,
) -> Any:
    """Return the radiance of beams toward rays.

    Parameters
    ----------
    beams
        The beams.
    origin, direction
        (N, 3), or one for all; directions need not be of unit length, distances are in scene units.
    t_max, t_min
        (N,) distance to the first surface, and to where the medium begins. Default: no surface, 0.
    look, medium
        Default look: physical. A medium is needed where the look has a physical factor.
    estimator
        "billboard" (Beam × Beam 1D), "frustum" (2D) or "auto", their blend.
    rule
        Quadrature of the frustum, `gauss_legendre(6)` unless given.
    close, time
        Where beams move: the same beams at shutter close (`beams` being those at shutter open), and (N,) times of the
        rays, 0 at shutter open and 1 at shutter close. In between all numbers of a beam are interpolated linearly.
    context
        For looks that ask for it: the time, and the number and the space of the beams' light.

    Returns
    -------
    Array3f
        (N) radiances; with derivatives, where arrays of the beams, of a `Fog` or of the look have gradients enabled.

    Raises
    ------
    ValueError
        An unknown estimator, shapes that do not agree, a physical look without a medium.
    """
    check_estimator(estimator)
    rays = _rays(origin, direction, t_min, t_max, time if close is not None else None)
    return estimate_rays(
        beams, rays, look=look or Look(), medium=medium, estimator=estimator, points=Points(rule),
        close=close, context=context,
    )  # fmt: skip


def estimate_rays(
    beams: Beams,
    rays: Rays,
    *,
    look: Look,
    medium: Medium | Fog | None,
    estimator: str = "auto",
    points: Points,
    close: Beams | None = None,
    context: Context | None = None,
) -> Any:
    """Return the radiance of beams toward rays, (N,) each, of which each has its own origin, t_min and t_max.

    By a grid, unless there are few of either: the same numbers, to float32 rounding. Where beams, fog or look are
    attached to the AD graph, so is the result.
    """
    check_estimator(estimator)
    check_motion(beams, close, rays.time)
    count = dr.width(rays.direction)
    if len(beams) == 0 or count == 0:
        return dr.zeros(Array3f, count)
    with dr.suspend_grad():
        bound = bind(look, beams, close, medium, context)
        packed = pack(beams, Array3f(0), shared=False, close=close, identity=bound.of_beams)
        if len(beams) * count > MOST_PAIRS:
            result = sum_over_grid(beams, close, packed, rays, bound, estimator, points)
        else:
            result = sum_over_all(packed, rays, bound, estimator, points)
    if not (bound.attached or dr.grad_enabled([each for each in (beams, close) if each is not None])):
        return result
    packed = pack(beams, Array3f(0), shared=False, close=close, identity=bound.of_beams)
    return dr.replace_grad(result, gradients.radiance(packed, rays, bound, count))


def bind(
    look: Look, beams: Beams, close: Beams | None, medium: Medium | Fog | None, context: Context | None = None
) -> BoundLook:
    """Return a look in a medium, for these beams."""
    ends = [each for state in (beams, close) if state is not None for each in (state.start, state.end)]
    low, high = (dr.zeros(Array3f, 1) + sign * dr.inf for sign in (1, -1))
    for each in ends:
        low = dr.minimum(low, Array3f(*(dr.min(axis) for axis in each)))
        high = dr.maximum(high, Array3f(*(dr.max(axis) for axis in each)))
    box = np.asarray(low, dtype=float)[:, 0], np.asarray(high, dtype=float)[:, 0]
    return look.bind(medium, reach(beams, close), context, box)


def sum_over_all(packed: Packed, rays: Rays, look: BoundLook, estimator: str, points: Points) -> Any:
    """Return the radiance of all beams toward all rays."""
    first, stop = UInt32(0), dr.opaque(UInt32, packed.count)

    def number(i: Any) -> Any:
        return i

    radiance = Array3f(0)
    if estimator != "frustum":
        radiance += billboard_sum([rays], first, stop, number, packed, look, points, estimator == "auto")[0]
    if estimator != "billboard":
        radiance += frustum_sum(rays, first, stop, number, packed, look, points, blended=estimator == "auto")
    dr.eval(radiance)
    return radiance


def check_estimator(estimator: str) -> None:
    """Raise ValueError unless `estimator` is one of ESTIMATORS."""
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator is {estimator!r}: expected one of {', '.join(ESTIMATORS)}")


def check_motion(beams: Beams, close: Beams | None, time: Any) -> None:
    """Raise ValueError unless `close` can be `beams` at another time."""
    if close is None:
        return
    if not isinstance(close, Beams):
        raise ValueError(f"close is a {type(close).__name__}: expected the same Beams at shutter close")
    if time is None:
        raise ValueError("beams move and the rays have no time: expected (N,) times from 0 to 1")
    both = [{name for name in Beams.DRJIT_STRUCT if getattr(each, name) is not None} for each in (beams, close)]
    if len(beams) != len(close) or both[0] != both[1]:
        raise ValueError(f"{close} at shutter close are not {beams} at shutter open: expected the same beams")


def reach(beams: Beams, close: Beams | None = None) -> float:
    """Return the greatest length of a light path, over which the look's variation is judged."""
    length = dr.norm(beams.end - beams.start)
    if beams.offset is not None:
        length = length + beams.offset
    own = max(float(dr.max(length)[0]), 1e-6)
    return own if close is None else max(own, reach(close))


def _rays(origin: Any, direction: Any, t_min: Any, t_max: Any, time: Any) -> Rays:
    origin, direction = _vectors(origin, "origin"), _vectors(direction, "direction")
    low = _numbers(0.0 if t_min is None else t_min, "t_min")
    high = _numbers(ENDLESS if t_max is None else t_max, "t_max")
    moment = _numbers(0.0 if time is None else time, "time")
    if bool(dr.any(~((moment >= 0) & (moment <= 1)))):
        raise ValueError("time is out of range: expected numbers from 0, shutter open, to 1, shutter close")
    widths = [dr.width(value) for value in (origin, direction, low, high, moment)]
    count = max(widths)
    if any(width not in (1, count) for width in widths):
        raise ValueError(
            f"origin, direction, t_min, t_max and time have {widths} rays: expected one number of rays, or 1"
        )
    active = dr.full(Bool, True, count)
    length = dr.norm(direction)
    if bool(dr.any(~(length > 0))):
        raise ValueError("a ray has no direction: expected vectors of positive, finite length")
    rays = Rays(
        dr.select(active, origin, 0), dr.select(active, direction / length, 0),
        dr.select(active, dr.minimum(high, ENDLESS), 0), dr.select(active, low, 0),
        time=None if time is None else dr.select(active, moment, 0),
    )  # fmt: skip
    dr.eval(rays.origin, rays.direction, rays.t_max, rays.t_min, rays.time)
    return rays


def _vectors(value: Any, name: str) -> Any:
    if dr.is_jit_v(value):
        return Array3f(value)
    numbers = np.atleast_2d(np.asarray(value, dtype=np.float32))
    if numbers.ndim != 2 or numbers.shape[1] != 3:
        raise ValueError(f"{name} has shape {np.shape(value)}: expected (N, 3)")
    return to_vectors(numbers)


def _numbers(value: Any, name: str) -> Any:
    if dr.is_jit_v(value):
        return Float(value)
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float32))
    if numbers.ndim != 1 or np.any(np.isnan(numbers)):
        raise ValueError(f"{name} has shape {np.shape(value)}: expected (N,) numbers")
    return to_float(numbers)
