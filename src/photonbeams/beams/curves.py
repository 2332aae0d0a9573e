"""Curved beams: polylines of pieces that share one falloff over the whole curve (Nowrouzezahrai et al. 2011).

Beamlets that were cut straight across would leave a wedge open on the outside of a bend and lie over each other on its
inside. So both end at the plane that halves the bend, across the bisector of their directions: by symmetry their
cross-sections agree on it. Of n pieces of a smooth curve the picture then errs by the order n⁻².
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Array, SceneError, arguments, numbers
from ..scene.vectors import unit
from . import Beams

# Pieces that turn by more, in degrees, are not joined but cut straight across: near a hairpin, the plane that halves
# the bend runs along the beam.
SHARPEST = 150.0


def directions(start: npt.ArrayLike, end: npt.ArrayLike) -> Array:
    """Return the (N, 3) unit directions of pieces; of one without length, zero."""
    return unit(np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64))


def tangents(axis: npt.ArrayLike, following: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the light's directions at both ends of pieces, (N, 3) each, as `Beams` takes them.

    Parameters
    ----------
    axis
        (N, 3) unit directions of the pieces.
    following
        (N,) number of the piece that goes on where each ends, or −1 for none.

    Notes
    -----
    Where no other piece adjoins, it is the piece's own direction. A curve is thus cut across its first and its last
    piece, not quite across itself: its two faces, and they alone, err by the order n⁻¹.
    """
    axis, following = np.asarray(axis, dtype=np.float64), np.asarray(following, dtype=np.int64)
    first, last = axis.copy(), axis.copy()
    before = np.flatnonzero(following >= 0)
    behind = following[before]
    halfway = axis[before] + axis[behind]
    length = np.linalg.norm(halfway, axis=1)
    joined = length > 2 * np.cos(np.radians(SHARPEST / 2))
    halfway = halfway[joined] / length[joined, None]
    last[before[joined]], first[behind[joined]] = halfway, halfway
    return first, last


@arguments
def curved(
    points: npt.ArrayLike,
    radius: npt.ArrayLike,
    power: npt.ArrayLike,
    counts: npt.ArrayLike | None = None,
    closed: bool = False,
) -> Beams:
    """Return the beams of curves, along each of which the light goes from its first point to its last.

    Parameters
    ----------
    points
        (M, 3) points on the curves, one curve after the other.
    radius
        (M,) radii at the points, or one for all.
    power
        (3,), (curves, 3) or (M, 3): the power of all curves, of each, or at each point.
    counts
        (curves,) number of points of each curve, two or more. Default: one curve.
    closed
        Whether each curve ends where it begins.

    Raises
    ------
    SceneError
        Shapes that do not agree, a curve of fewer than two points.

    Examples
    --------
    >>> import numpy as np
    >>> import photonbeams as pb
    >>> turn = np.linspace(0, np.pi / 2, 65)
    >>> beams = pb.curved(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), 0.05, (1, 1, 1))
    >>> len(beams)
    64
    """
    points = np.atleast_2d(numbers(points, "points", "(M, 3) points").astype(np.float64))
    given = numbers([len(points)] if counts is None else counts, "counts", "whole numbers, (curves,)")
    sizes = np.atleast_1d(given).astype(np.int64)
    if points.ndim != 2 or points.shape[1] != 3 or sizes.sum() != len(points) or np.any(sizes < 2):
        raise SceneError(
            f"points has shape {points.shape} and counts are {sizes.tolist()}: expected (M, 3) points, M the sum of "
            "the counts, and at least 2 points a curve"
        )
    radius = numbers(radius, "radius", "one number, or one a point, (M,)").astype(np.float64)
    power = numbers(power, "power", "colours, (3,), (curves, 3) or (M, 3)").astype(np.float64)
    first, last, following = segments(sizes, closed)
    start, end = points[first], points[last]
    radii = _each(radius, (len(points),), "radius")
    per_curve = np.shape(power) == (len(sizes), 3) and len(sizes) != len(points)
    colours = np.repeat(np.asarray(power), sizes, axis=0) if per_curve else _each(power, (len(points), 3), "power")
    number = np.repeat(np.arange(len(sizes)), sizes)[first]
    offset, total = lengths(start, end, number)
    start_tangent, end_tangent = tangents(directions(start, end), following)
    graded = np.shape(power) == (len(points), 3)
    return Beams(
        start, end, radii[first], radii[last], colours[first], offset=offset, total=total,
        start_tangent=start_tangent, end_tangent=end_tangent, power_end=colours[last] if graded else None, id=number,
    )  # fmt: skip


def segments(counts: npt.ArrayLike, closed: bool) -> tuple[Array, Array, Array]:
    """Return the first point, the last point and the following segment (−1: none) of each segment of curves."""
    sizes = np.asarray(counts, dtype=np.int64)
    starts = np.cumsum(sizes) - sizes
    first = np.arange(sizes.sum())
    last = first + 1
    closing = np.isin(first, starts + sizes - 1)
    last[closing] = starts
    if closed:
        return first, last, last.copy()
    first, last = first[~closing], last[~closing]
    following = np.arange(1, len(first) + 1)
    following[np.isin(last, starts + sizes - 1)] = -1
    return first, last, following


def lengths(start: npt.ArrayLike, end: npt.ArrayLike, curve: npt.ArrayLike) -> tuple[Array, Array]:
    """Return how far along its curve each piece begins, and how long its curve is; pieces are in order."""
    length = np.linalg.norm(np.subtract(end, start), axis=-1)
    curve = np.asarray(curve, dtype=np.int64)
    total = np.bincount(curve, weights=length, minlength=int(curve.max(initial=-1)) + 1)
    before = np.cumsum(total) - total
    offset = np.maximum(np.cumsum(length) - length - before[curve], 0)
    return offset, total[curve]


def _each(values: npt.ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise SceneError(f"{name} has shape {np.shape(values)}: expected {shape}, or one for all") from None
