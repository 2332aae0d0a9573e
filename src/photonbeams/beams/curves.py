"""Curved beams: polylines of pieces that share one falloff over the whole curve (Nowrouzezahrai et al. 2011).

If pieces were cut straight across, they would leave a wedge open on the outside of a bend and overlap on its inside. So
two pieces meet at the plane that halves the bend, perpendicular to the bisector of their directions; by symmetry, their
cross-sections agree on it. With n pieces of a smooth curve, the error of the picture is of the order n⁻².
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Array, SceneError, arguments, numbers
from ..scene.vectors import unit
from . import Beams

# Corners of more degrees than this are not joined: both pieces are cut straight across, since near a hairpin the plane
# that halves the bend runs along the beam.
SHARPEST = 150.0


def directions(start: npt.ArrayLike, end: npt.ArrayLike) -> Array:
    """Return the unit directions of pieces, (N, 3); the direction of a piece without length is zero."""
    return unit(np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64))


def tangents(axis: npt.ArrayLike, following: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the light's directions at both ends of pieces, (N, 3) each: `start_tangent` and `end_tangent` of `Beams`.

    Parameters
    ----------
    axis
        (N, 3) unit directions of the pieces.
    following
        (N,) index of the piece that continues at each piece's end, or −1 if there is none.

    Notes
    -----
    Where no piece adjoins, the tangent is the piece's own direction. The two faces of a curve are thus perpendicular to
    its first and last pieces, not exactly to the curve; their error, and no other, is of the order n⁻¹.
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
    """Return the beams of curves, from the first point of each to its last, joined except at hairpins (above 150°).

    Parameters
    ----------
    points
        (M, 3) points on the curves in scene units, one curve after the other.
    radius
        (M,) radii at the points in scene units, or one radius for all.
    power
        RGB flux: (3,) for all curves, (curves, 3) for each curve, or (M, 3) for each point.
    counts
        (curves,) number of points of each curve, 2 or more. Default: all points are one curve.
    closed
        Whether each curve ends where it begins. The closing piece is added. Default: False.

    Returns
    -------
    Beams
        One beam for each piece; its `id` is the number of its curve. Falloffs run over the whole curve.

    Raises
    ------
    SceneError
        If shapes do not agree, or if a curve has fewer than two points.

    Examples
    --------
    >>> turn = np.linspace(0, np.pi / 2, 65)
    >>> arc = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    >>> beams = pb.curved(arc, radius=0.05, power=(1, 1, 1))
    >>> len(beams)
    64
    >>> round(float(beams.arrays()["total"][0]), 3)  # length of the curve
    1.571
    """
    points = np.atleast_2d(numbers(points, "points", "(M, 3) points").astype(np.float64))
    sizes = _sizes(points, counts)
    radius = numbers(radius, "radius", "one number, or one for each point, (M,)").astype(np.float64)
    power = numbers(power, "power", "colours of shape (3,), (curves, 3) or (M, 3)").astype(np.float64)
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


def _sizes(points: Array, counts: npt.ArrayLike | None) -> Array:
    """Return the number of points of each curve."""
    given = numbers([len(points)] if counts is None else counts, "counts", "whole numbers, (curves,)")
    sizes = np.atleast_1d(given).astype(np.int64)
    if points.ndim != 2 or points.shape[1] != 3 or sizes.sum() != len(points) or np.any(sizes < 2):
        raise SceneError(
            f"points has shape {points.shape} and counts are {sizes.tolist()}: expected (M, 3) points, where M is the "
            "sum of the counts, and at least 2 points for each curve"
        )
    return sizes


def segments(counts: npt.ArrayLike, closed: bool) -> tuple[Array, Array, Array]:
    """Return the indices of each segment's first point, last point and following segment (−1: none)."""
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
    """Return the distance along its curve at which each piece begins, (N,), and the length of its curve, (N,).

    The pieces of each curve are in order, and so are the curves.
    """
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
