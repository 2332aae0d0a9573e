"""Radiance of beams toward any rays: the estimators without an image.

The estimators are those of Jarosz, Nowrouzezahrai, Sadeghi, Jensen, "A Comprehensive Theory of Volumetric Radiance
Estimation using Photon Points and Beams" (2011); the frustum's integral along a ray's chord is computed by
Gauss–Legendre quadrature (Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011),
equations 1 and 2).
"""

from __future__ import annotations

from types import NoneType
from typing import TYPE_CHECKING, Any, Literal

import drjit as dr
import numpy as np

from ..beams import Beams
from ..constants import DEFAULT_POINTS, ESTIMATORS
from ..looks import BoundLook, Fog, LightContext, Look
from ..numerics.arrays import near_one, to_float, to_uint
from ..numerics.given import LARGEST, Numbers, given
from ..quadrature import Rule, gauss_legendre
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Medium, SceneError, arguments, choice, instance, shown
from . import gradients
from .billboard import billboard_sum
from .coarse_rays import RayImages
from .frustum import frustum_sum
from .geometry import Rays
from .grid import sum_over_grid
from .points import Points
from .records import Packed, pack

if TYPE_CHECKING:
    from drjit.auto.ad import TensorXf

    from ..looks.factors import Value

#: How a beam's radiance is estimated: as a flat billboard (1D), in its frustum (2D), or by a blend of both.
Estimator = Literal["auto", "billboard", "frustum"]

DEFAULT_RULE = gauss_legendre(DEFAULT_POINTS)

#: Pairs of beams and rays up to which testing all pairs is as fast as a grid. On two cores a grid of few beams takes
#: 10 ms, the time of 3 million tests.
MOST_PAIRS = 3_000_000

# The end of an endless ray; its square still fits into a float32.
ENDLESS = 1e18


@arguments
def estimate(
    beams: Beams, origin: Numbers, direction: Numbers, t_max: Numbers | None = None, *, look: Look | None = None,
    medium: Medium | Fog | None = None, estimator: Estimator = "auto", rule: Rule = DEFAULT_RULE,
    t_min: Numbers | None = None, close: Beams | None = None, time: Numbers | None = None,
    context: LightContext | None = None,
) -> TensorXf:  # fmt: skip
    """Return the radiance of beams toward rays.

    Parameters
    ----------
    beams
        The beams. Where they move, the beams at shutter open.
    origin, direction
        (..., 3) origins of the rays in scene units, such as (N, 3) or (H, W, 3), and their directions, of any length
        above 0.
    t_max, t_min
        (...) distances along each ray, in scene units, to the first surface (default: there is none) and to the point
        where the medium begins (default: 0).
    look
        The look of all beams. Default: `Look()`, which is physical.
    medium
        The fog; needed if the look has a physical factor. Default: None.
    estimator
        "billboard" (beam × beam 1D), "frustum" (beam × beam 2D), or "auto", which blends both: the frustum takes over
        near a beam's wall and ends, and where factors or radius vary over the ray's chord. Default: "auto".
    rule
        Quadrature of the frustum. Default: `gauss_legendre(6)`.
    close, time
        The same beams at shutter close, if they move (all their numbers change linearly over time), and the (...) times
        of the rays, from 0 at shutter open to 1 at shutter close.
    context
        Time, number and space of the light, for looks that read them. Default: time 0 and light 0 in world space.

    Returns
    -------
    TensorXf
        (..., 3) radiances, leading shapes broadcast as in NumPy. If numbers of the beams, the look, a `looks.Fog` or
        the rays have gradients enabled, they have the derivatives of the frustum by twelve points or more a chord.

    Raises
    ------
    SceneError
        If an argument does not fit, if a physical look has no medium, or if derivatives need more pairs of rays and
        beams than the memory holds (16 million, or a sixth of that for looks that change in space or with corners).

    Examples
    --------
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> radiance = pb.estimate(beams, [[-3, 0, 2], [-3, 1, 2]], [1, 0, 0], medium=pb.Medium(scattering=0.1))
    >>> np.asarray(radiance, dtype=float).round(3).tolist()
    [[0.123, 0.123, 0.123], [0.0, 0.0, 0.0]]
    """
    _check_arguments(beams, look, medium, estimator, rule, context)
    check_motion(beams, close, time)
    rays, shape = _rays(origin, direction, t_min, t_max, time if close is not None else None)
    found: Any = Float()
    if rays is not None:
        asked: dict[str, Any] = {"estimator": estimator, "points": Points(rule), "close": close, "context": context}
        found = dr.ravel(estimate_rays(beams, rays, look=look or Look(), medium=medium, **asked))
    return dr.tensor_t(Float)(found, (*shape, 3))  # type: ignore[operator]


def _check_arguments(
    beams: object, look: object, medium: object, estimator: str, rule: object, context: object
) -> None:
    """Raise SceneError if one of these arguments of `estimate` has the wrong type, or is unknown."""
    instance(beams, "estimate: beams", Beams)
    instance(look, "estimate: look", Look, NoneType)
    instance(medium, "estimate: medium", Medium, Fog, NoneType)
    instance(rule, "estimate: rule", Rule)
    instance(context, "estimate: context", LightContext, NoneType)
    check_estimator(estimator)


def estimate_rays(
    beams: Beams,
    rays: Rays,
    *,
    look: Look,
    medium: Medium | Fog | None,
    estimator: str = "auto",
    points: Points,
    close: Beams | None = None,
    context: LightContext | None = None,
    images: RayImages | None = None,
) -> Any:
    """Return the radiance of beams toward N rays, each with its own origin, t_min and t_max.

    A grid is used unless there are few beams or rays; the result is the same, to float32 rounding. With `images`, beams
    with smooth looks are gathered along fewer rays. If beams, fog or look are attached to the AD graph, the result is
    attached, too.
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
            images = images if bound.smooth and close is None else None
            result = sum_over_grid(
                beams=beams,
                close=close,
                packed=packed,
                rays=rays,
                look=bound,
                estimator=estimator,
                points=points,
                images=images,
            )
        else:
            result = sum_over_all(packed, rays, bound, estimator, points)
    if not (bound.attached or dr.grad_enabled(beams, close, rays.origin, rays.direction, rays.t_min, rays.t_max)):
        return result
    packed = pack(beams, Array3f(0), shared=False, close=close, identity=bound.of_beams)
    return dr.replace_grad(result, gradients.radiance(packed, rays, bound, count))


def bind(
    look: Look, beams: Beams, close: Beams | None, medium: Medium | Fog | None, context: LightContext | None = None
) -> BoundLook:
    """Return a look in a medium, for these beams."""
    ends = [each for state in (beams, close) if state is not None for each in (state.start, state.end)]
    low, high = (dr.zeros(Array3f, 1) + sign * dr.inf for sign in (1, -1))
    for each in ends:
        low = dr.minimum(low, Array3f(*(dr.min(axis) for axis in each)))
        high = dr.maximum(high, Array3f(*(dr.max(axis) for axis in each)))
    box = np.asarray(low, dtype=float)[:, 0], np.asarray(high, dtype=float)[:, 0]
    return look.bind(medium, reach(beams, close), context, box)


def sum_over_all(packed: Packed, rays: Rays, look: BoundLook, estimator: str, points: Points) -> Array3f:
    """Return the radiance of all beams toward all rays."""
    first, stop = UInt32(0), dr.opaque(UInt32, packed.count)

    def number(i: UInt32) -> UInt32:
        return i

    radiance = Array3f(0)
    if estimator != "frustum":
        radiance += billboard_sum(
            rays=[rays],
            first=first,
            stop=stop,
            number=number,
            packed=packed,
            look=look,
            points=points,
            blended=estimator == "auto",
        )[0]
    if estimator != "billboard":
        radiance += frustum_sum(rays, first, stop, number, packed, look, points, blended=estimator == "auto")
    dr.eval(radiance)
    return radiance


def check_estimator(estimator: str) -> None:
    """Raise SceneError unless `estimator` is one of ESTIMATORS."""
    choice(estimator, "estimator", ESTIMATORS)


def check_motion(beams: Beams, close: Beams | None, time: Numbers | None) -> None:
    """Raise SceneError unless `close` can be `beams` at another time."""
    if close is None:
        return
    if not isinstance(close, Beams):
        raise SceneError(f"close is a {type(close).__name__}: expected the same Beams at shutter close")
    if time is None:
        raise SceneError("beams move, but the rays have no time: expected times from 0 to 1, one for each ray")
    both = [{name for name in Beams.DRJIT_STRUCT if getattr(each, name) is not None} for each in (beams, close)]
    if len(beams) != len(close) or both[0] != both[1]:
        raise SceneError(f"{close} at shutter close are not {beams} at shutter open: expected the same beams")


def reach(beams: Beams, close: Beams | None = None) -> float:
    """Return the greatest length of a light path, over which the look's variation is measured."""
    length = dr.norm(beams.end - beams.start)
    if beams.offset is not None:
        length = length + beams.offset
    own = max(float(dr.max(length)[0]), 1e-6)
    return own if close is None else max(own, reach(close))


def _rays(
    origin: Numbers, direction: Numbers, t_min: Numbers | None, t_max: Numbers | None, time: Numbers | None
) -> tuple[Rays | None, tuple[int, ...]]:
    """Return the rays (None if there are none) and the shape to which they are broadcast."""
    given = (
        _lanes(origin, "origin", 3),
        _lanes(direction, "direction", 3),
        _lanes(0.0 if t_min is None else t_min, "t_min"),
        _lanes(ENDLESS if t_max is None else t_max, "t_max"),
        _lanes(0.0 if time is None else time, "time"),
    )
    shapes = [shape for _, shape in given]
    try:
        shape = np.broadcast_shapes(*shapes)
    except ValueError:
        text = ", ".join(map(str, shapes))
        raise SceneError(
            f"origin, direction, t_min, t_max and time have shapes {text}: expected shapes that broadcast"
        ) from None
    if 0 in shape:
        return None, shape
    origin, direction, low, high, times = (_spread(value, own, shape) for value, own in given)
    if bool(dr.any(~((times >= 0) & (times <= 1)))):
        raise SceneError("time is out of range: expected numbers from 0 (shutter open) to 1 (shutter close)")
    active = dr.full(Bool, True, int(np.prod(shape)))
    ahead = near_one(direction)
    length = dr.norm(ahead)
    if bool(dr.any(~((length > 0) & dr.isfinite(length)))):
        raise SceneError("a ray has no direction: expected vectors of positive, finite length")
    rays = Rays(
        dr.select(active, origin, 0), dr.select(active, ahead / length, 0),
        dr.select(active, dr.minimum(high, ENDLESS), 0), dr.select(active, low, 0),
        time=None if time is None else dr.select(active, times, 0),
    )  # fmt: skip
    dr.eval(rays.origin, rays.direction, rays.t_max, rays.t_min, rays.time)
    return rays, shape


def _lanes(value: Any, name: str, size: int = 1) -> tuple[Any, tuple[int, ...]]:
    """Return numbers, or vectors of three, as a Float or an Array3f, and their leading shape."""
    expected = "finite numbers (..., 3)" if size == 3 else "numbers (...), one for each ray"
    if value is not None and dr.is_jit_v(value):
        shape = tuple(value.shape) if dr.is_tensor_v(value) else tuple(value.shape)[::-1]
        flat = value.array if dr.is_tensor_v(value) else dr.ravel(value)
    else:
        found = given(value, name, expected)
        shape, flat = found.plain.shape, found.attached
        if not np.all(np.abs(found.plain) <= LARGEST if size == 3 else ~np.isnan(found.plain)):
            raise SceneError(f"{name} is {shown(value)}: expected {expected}")
        if flat is None:
            flat = to_float(np.clip(found.plain, -LARGEST, LARGEST))
    if size == 1:
        return Float(flat), shape
    if shape[-1:] != (3,):
        raise SceneError(f"{name} has shape {shape}: expected {expected}")
    return dr.unravel(Array3f, Float(flat)), shape[:-1]


def _spread(value: Value, own: tuple[int, ...], shape: tuple[int, ...]) -> Value:
    """Return the entries of an array of the shape `own`, broadcast to `shape`; a single entry stays single."""
    count = int(np.prod(own))
    if own == shape or count == 1:
        return value
    places = np.broadcast_to(np.arange(count).reshape(own), shape)
    return dr.gather(type(value), value, to_uint(places))
