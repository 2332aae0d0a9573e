"""Ready-made modifiers: functions that change beams. `chain` combines several of them into one.

shot = pb.Shot.open("shot.usda", simulate=pb.chain(pb.aim((0, 1, 0), 0.5), pb.thin(0.25)))
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from .. import scene
from ..numerics.arrays import channel_mean, indices, near_one, opaque
from ..numerics.given import finite
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Float, UInt32
from ..scene import SceneError
from . import Beams
from .bending import BeamPaths, bent_length, pieces
from .guides import Guide, led
from .programs import Modifier, PassContext

# Radius times the line projection k1 of the default profile (Epanechnikov) on the axis.
_PEAK = 8 / (3 * np.pi)


@scene.arguments
def aim(target: npt.ArrayLike, amount: float = 1.0) -> Modifier:
    """Return a modifier that turns light paths toward a point.

    Parameters
    ----------
    target
        (3,) the point in world space.
    amount
        From 0, which leaves the paths unchanged, to 1, at which all paths go through the target. Default: 1.

    Raises
    ------
    SceneError
        If the target is not three finite numbers, if the amount is not 0 to 1, or, once it is applied, if beams are
        bent already.

    Notes
    -----
    A path turns about its origin and keeps its length. Surfaces on the new path do not stop it.

    Examples
    --------
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> aimed = pb.aim((8, 0, 0))(beams, pb.PassContext())
    >>> aimed.arrays()["end"].tolist()
    [[4.0, 0.0, 0.0]]
    """
    place = finite(target, "aim: target", "3 finite numbers", (3,))
    amount = scene.number(amount, "aim: amount", 0, 1)

    def aimed(beams: Beams, _: PassContext) -> Beams:
        paths = BeamPaths(beams, "aim")
        to = near_one(opaque(place) - paths.origin)
        to = to * dr.rsqrt(dr.maximum(dr.squared_norm(to), 1e-30))
        mixed = dr.lerp(paths.direction, to, opaque(amount))
        direction = dr.select(dr.squared_norm(mixed) > 1e-12, dr.normalize(mixed), paths.direction)
        result = copy(beams)
        result.start = paths.origin + paths.offset * direction
        result.end = paths.origin + (paths.offset + paths.length) * direction
        if beams.end_normal is not None:
            result.end_normal = -direction
        result.start_normal = result.side = result.side_normal = None
        return result

    return _of_some(aimed)


@scene.arguments
def bend(field: Callable[[Array3f], Array3f] | Sequence[npt.ArrayLike], steps: int = 32) -> Modifier:
    """Return a modifier that bends straight beams by a vector field, or along guide curves.

    Parameters
    ----------
    field
        A function of positions (an `Array3f`) that returns curvature vectors (an `Array3f`): beams turn toward the
        vector, and the length of its component across the beam is the curvature, 1 / the radius of the bend in scene
        units. At zero, beams are straight. Or a sequence of guides, each (M, 3) points: a light path follows the guide
        whose first point is nearest to the path's origin.
    steps
        Number of pieces of each beam in a field, 1 to 4096. Guides set their own number, by how far they turn.
        Default: 32.

    Raises
    ------
    SceneError
        If steps is not 1 to 4096, if a guide does not have two different points, or, once it is applied, if beams are
        bent already.

    Notes
    -----
    A path keeps its power and radii, and falloffs run along it. Surfaces on the new path do not stop it. The field is
    followed by the midpoint rule. A guide bends space along the line on which it leaves its first point, without
    turning about it (parallel transport): a parallel bundle becomes a bent tube.

    Examples
    --------
    A straight beam becomes a quarter of a circle around the origin:

    >>> from photonbeams.runtime.device import Array3f
    >>> beams = pb.Beams([[1, 0, 0]], [[1, np.pi / 2, 0]], 0.1, 0.1, power=[9, 9, 9])
    >>> toward_axis = lambda position: -Array3f(position.x, position.y, 0)
    >>> bent = pb.bend(toward_axis, steps=16)(beams, pb.PassContext())
    >>> len(bent), bool(np.allclose(bent.arrays()["end"][-1], [0, 1, 0], atol=0.01))
    (16, True)
    """
    if callable(field):
        steps = int(scene.number(steps, "bend: steps", 1, 4096))
        return _of_some(lambda beams, _: _along_field(beams, field, steps))
    if isinstance(field, str) or not isinstance(field, Sequence | np.ndarray):
        text = f"bend: field is {scene.shown(field)}: expected a function of positions, or guides of (M, 3) points each"
        raise SceneError(text)
    guides = [Guide.through(points) for points in field]
    return _of_some(lambda beams, _: led(beams, guides))


def _of_some(change: Modifier) -> Modifier:
    """Return a modifier that leaves no beams as they are: Dr.Jit combines no empty arrays with numbers."""
    return lambda beams, context: change(beams, context) if len(beams) else beams


def _along_field(beams: Beams, field: Callable[[Array3f], Array3f], steps: int) -> Any:
    """Return beams that follow x' = d, d' = the field's component across d, by the midpoint rule."""
    paths = BeamPaths(beams, "bend")
    count, width = dr.opaque(UInt32, steps), len(beams)
    inv = dr.rcp(Float(count))
    number = dr.arange(UInt32, width)

    def turned(direction: Array3f, place: Array3f, along: Array3f, length: Float) -> Array3f:
        pull = Array3f(field(place))
        return dr.normalize(direction + length * (pull - dr.dot(pull, along) * along))

    def step(position: Array3f, direction: Array3f, length: Float) -> tuple[Array3f, Array3f]:
        half = 0.5 * length
        between = turned(direction, position, direction, half)
        middle = position + half * direction
        return position + length * between, turned(direction, middle, between, length)

    def walked(position: Array3f, direction: Array3f, distance: Float) -> tuple[Array3f, Array3f, Array3f]:
        points, length = dr.zeros(Array3f, width * (steps + 1)), distance * inv
        dr.scatter(points, position, number * (count + 1))

        def body(i: UInt32, position: Array3f, direction: Array3f) -> tuple[UInt32, Array3f, Array3f]:
            position, direction = step(position, direction, length)
            dr.scatter(points, position, number * (count + 1) + i + 1)
            return i + 1, position, direction

        state = (UInt32(0), Array3f(position), Array3f(direction))
        _, position, direction = dr.while_loop(state, lambda i, *_: i < count, body, label="bend")
        dr.eval(points, position, direction)
        return points, position, direction

    # Bending begins at the light, so that a path through a portal is bent alike on both sides of it.
    way, start, begin = walked(paths.origin, paths.direction, paths.offset)
    points, _, stop = walked(start, begin, paths.length)
    node = dr.arange(UInt32, width * (steps + 1))
    places = dr.gather(Float, paths.length, node // (count + 1)) * inv * Float(node % (count + 1))
    return pieces(beams, paths, points, places, (begin, stop), bent_length(way, width, steps), steps)


@scene.arguments
def thin(fraction: float, keep_light: bool = True) -> Modifier:
    """Return a modifier that keeps a fraction of the beams, the same ones in each frame.

    Parameters
    ----------
    fraction
        Fraction of the beams to keep, above 0 and up to 1. Beams are chosen at random by their `id`.
    keep_light
        Whether the power of the kept beams is divided by `fraction`, so that the picture keeps its brightness on
        average. Default: True.

    Raises
    ------
    SceneError
        If the fraction is not above 0 and up to 1.

    Examples
    --------
    >>> start = np.random.default_rng(0).normal(size=(1000, 3))
    >>> beams = pb.Beams(start, start + [0, 0, 4], 0.1, 0.5, power=[1, 1, 1])
    >>> thinned = pb.thin(0.5)(beams, pb.PassContext())
    >>> 450 < len(thinned) < 550
    True
    >>> thinned[0].arrays()["power"].tolist()
    [[2.0, 2.0, 2.0]]
    """
    fraction = scene.number(fraction, "thin: fraction", 0, 1)
    if fraction == 0:
        raise SceneError("thin: fraction is 0: expected more than 0, up to 1")

    def thinned(beams: Beams, context: PassContext) -> Beams:
        seeds = (context.seed, context.pass_index, zlib.crc32(context.name.encode()))
        bits = hash32(beams.numbers(), *(dr.opaque(UInt32, each & 0xFFFFFFFF) for each in seeds))
        index = indices(unit_float(bits) < opaque(fraction))
        result = beams.take(index)
        return _with_power(result, lambda power: power * opaque(1 / fraction)) if keep_light else result

    return _of_some(thinned)


@scene.arguments
def recolor(color: npt.ArrayLike | Callable[[Beams], Array3f]) -> Modifier:
    """Return a modifier that gives beams another colour: the mean of their power's channels times `color`.

    Parameters
    ----------
    color
        One colour (RGB) for all beams, or a function of `Beams` that returns one for each (an `Array3f`).

    Raises
    ------
    SceneError
        If the colour is not three finite numbers.

    Examples
    --------
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[3, 6, 9])
    >>> warm = pb.recolor((1, 0.5, 0.25))(beams, pb.PassContext())
    >>> warm.arrays()["power"].round(3).tolist()
    [[6.0, 3.0, 1.5]]
    """
    fixed: Any = None if callable(color) else finite(color, "recolor: color", "3 finite numbers", (3,))

    def recolored(beams: Beams, _: PassContext) -> Beams:
        tint = Array3f(color(beams)) if callable(color) else opaque(fixed)
        return _with_power(beams, lambda power: channel_mean(power) * tint)

    return _of_some(recolored)


@scene.arguments
def clamp(power: float | None = None, radiance: float | None = None) -> Modifier:
    """Return a modifier that dims the brightest beams to a limit, in their own colour.

    Parameters
    ----------
    power
        Greatest power (flux) of any channel, 0 or more. Default: no limit.
    radiance
        Greatest brightness of any channel, 0 or more: that of a beam seen square from the side, through its axis at
        the middle of the beam, before fog and shading. Default: no limit.

    Raises
    ------
    SceneError
        If there is no limit, or if a limit is negative.

    Notes
    -----
    The brightness is 8 / (3π) · power / radius, with the radius at the middle of the beam: the line projection of the
    default profile, `looks.Epanechnikov`, on the axis.

    Examples
    --------
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[3, 6, 9])
    >>> dimmed = pb.clamp(power=3)(beams, pb.PassContext())
    >>> dimmed.arrays()["power"].round(3).tolist()
    [[1.0, 2.0, 3.0]]
    """
    most = None if power is None else scene.number(power, "clamp: power", 0)
    brightest = None if radiance is None else scene.number(radiance, "clamp: radiance", 0)
    if most is None and brightest is None:
        raise SceneError("clamp has no limit: expected power, radiance, or both")

    def clamped(beams: Beams, _: PassContext) -> Beams:
        last = beams.power if beams.power_end is None else beams.power_end
        peak = dr.maximum(dr.max(beams.power), dr.max(last))
        limit = dr.full(Float, dr.inf, len(beams)) if most is None else opaque(most)
        if brightest is not None:
            middle = 0.5 * (beams.radius_start + beams.radius_end)
            limit = dr.minimum(limit, opaque(brightest / _PEAK) * middle)
        factor = dr.minimum(1, limit * dr.rcp(dr.maximum(peak, 1e-30)))
        return _with_power(beams, lambda power: power * factor)

    return _of_some(clamped)


def _with_power(beams: Beams, change: Callable[[Array3f], Array3f]) -> Beams:
    """Return beams whose power is changed, at both ends."""
    result = copy(beams)
    result.power = change(beams.power)
    if beams.power_end is not None:
        result.power_end = change(beams.power_end)
    return result
