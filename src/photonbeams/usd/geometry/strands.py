"""Read BasisCurves, NurbsCurves and HermiteCurves as strands: points along curves, denser where these bend more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ...beams.curves import segments
from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Values
from .splines import BASES, MATRICES, WRAPS, Spans, expected_points, span_counts, varying_counts
from .velocities import PointSample

_TURN = np.radians(12.0)  # the most that a piece turns
_MOST_PIECES = 16  # of a span


@dataclass(frozen=True)
class Strands:
    """Points (N, 3) along curves, one curve after another, and how their primvars are looked up.

    Attributes
    ----------
    curve
        (N,) the curve that each point is on.
    closed
        Whether curves end where they begin.
    lengths
        How many values a primvar of each interpolation has.
    at
        A function from a primvar's values to its values at the points, (N, C).
    """

    points: Array
    curve: Array
    closed: bool
    lengths: dict[str, int]
    at: Callable[[Values], Array]

    @cached_property
    def segments(self) -> tuple[Array, Array]:
        """The points at both ends of each segment."""
        first, last, _ = segments(np.unique(self.curve, return_counts=True)[1], self.closed)
        return first, last

    @cached_property
    def tangents(self) -> Array:
        """The direction of the curve at each point, (N, 3): the mean of the adjacent segments."""
        first, last = self.segments
        directions = unit(self.points[last] - self.points[first])
        sums = np.zeros_like(self.points)
        np.add.at(sums, first, directions)
        np.add.at(sums, last, directions)
        sums[~np.any(sums, axis=1)] = [0.0, 0.0, 1.0]
        return unit(sums)


def read_strands(reading: Reading, prim: Usd.Prim, most: int) -> Strands | None:
    """Return the curves of a prim in its own space, or None, with a warning, if there are none.

    `most` is about the most points that they may have; an even selection of the curves is left out only if these have
    more points by themselves.
    """
    found = read_points(reading, prim)
    if found is None:
        return None
    sample, points, counts = found
    lengths = {"constant": 1, "uniform": len(counts), "vertex": len(points)}
    if prim.IsA(UsdGeom.NurbsCurves):
        return _nurbs(sample, prim, points, lengths)
    if prim.IsA(UsdGeom.HermiteCurves):
        return _hermite(sample, prim, points, lengths, most=most)
    kind, wrap = basis_of(reading, prim)
    chosen = span_counts(counts, kind, wrap) > 0
    if not chosen.all():
        text = f"has {np.count_nonzero(~chosen)} curves whose number of points is not {expected_points(kind, wrap)}"
        reading.warn(prim, f"{text}: they are skipped", "curveVertexCounts")
    step = -(-int(counts[chosen].sum()) // most)
    if step > 1:
        text = f"has {len(counts)} curves: one in {step} is rendered, to limit memory"
        reading.warn(prim, text, "curveVertexCounts")
        chosen &= np.arange(len(counts)) % step == 0
    lengths["varying"] = int(varying_counts(counts, kind, wrap).sum())
    return _along(Spans.of(counts, chosen, kind, wrap), points, lengths, most)


def read_points(reading: Reading, prim: Usd.Prim) -> tuple[Reading, Array, Array] | None:
    """Return the reading of the curves' time sample, their points, and how many each has; None without points.

    Raises
    ------
    SceneError
        The counts do not sum to the number of points.
    """
    sample = PointSample.of(reading, prim)
    points, counts = sample.points, sample.reading.integers(prim, "curveVertexCounts")
    if points is None or not len(counts):
        reading.warn(prim, "has no points: it is skipped")
        return None
    if counts.sum() != len(points) or np.any(counts < 0):
        text = f"sums to {counts.sum()}: expected {len(points)}, the number of points, and no negative counts"
        raise reading.fail(prim, "curveVertexCounts", text)
    return sample.reading, points, counts


def _along(
    spans: Spans, points: Array, lengths: dict[str, int], most: int, *, primvars: Spans | None = None
) -> Strands | None:
    """Return points along spans, whose primvars, on other spans or these, have these lengths; None without spans."""
    if not len(spans.curve):
        return None
    span, t = spans.nodes(_pieces(spans.controls(points), most))
    at = partial((primvars or spans).values_at, span=span, t=t)
    return Strands(spans.at(points, span, t), spans.curve[span], spans.closed, lengths=lengths, at=at)


def _pieces(controls: Array, most: int) -> Array:
    """Return how many pieces each span needs, from its control points (S, K, 3): a curve turns less than they do."""
    if controls.shape[1] == 2:
        return np.ones(len(controls), dtype=np.int64)
    steps = unit(np.diff(controls, axis=1))
    cosines = np.einsum("ski,ski->sk", steps[:, 1:], steps[:, :-1]).clip(-1, 1)
    wanted = np.clip(np.ceil(np.arccos(cosines).sum(axis=1) / _TURN), 1, _MOST_PIECES).astype(np.int64)
    return np.minimum(wanted, max(1, most // len(controls)))


def _hermite(reading: Reading, prim: Usd.Prim, points: Array, lengths: dict[str, int], *, most: int) -> Strands | None:
    """Return Hermite curves as Bézier curves, whose inner control points follow from the tangents."""
    counts, directions = reading.integers(prim, "curveVertexCounts"), reading.array(prim, "tangents", 3)
    if directions is None or len(directions) != len(points):
        count = 0 if directions is None else len(directions)
        raise reading.fail(prim, "tangents", f"has {count} values: expected {len(points)}, as many as points")
    straight = Spans.of(counts, counts > 1, "linear", "nonperiodic")  # as primvars are
    first, last = straight.index.T
    index = np.stack([first, len(points) + first, 2 * len(points) + last, last], axis=1)
    controls = np.concatenate([points, points + directions / 3, points - directions / 3])
    bent = replace(straight, matrix=MATRICES["bezier"], index=index)
    return _along(bent, controls, {**lengths, "varying": len(points)}, most, primvars=straight)


def _nurbs(reading: Reading, prim: Usd.Prim, points: Array, lengths: dict[str, int]) -> Strands | None:
    """Return NURBS curves, evaluated within their ranges."""
    from scipy import sparse  # takes long to import

    counts, orders = reading.integers(prim, "curveVertexCounts"), reading.integers(prim, "order")
    if len(orders) not in (1, len(counts)):
        raise reading.fail(prim, "order", f"has {len(orders)} values: expected {len(counts)}, one for each curve")
    orders = np.broadcast_to(orders, (len(counts),))
    knots, sizes = floats(reading, prim, "knots"), counts + orders
    if len(knots) != sizes.sum() or np.any(orders < 2):
        text = f"has {len(knots)} values: expected {sizes.sum()}, the sum of all points and orders"
        raise reading.fail(prim, "knots", text)
    ranges = reading.array(prim, "ranges", 2)
    if ranges is None or len(ranges) != len(counts):
        ranges = np.broadcast_to([-np.inf, np.inf], (len(counts), 2))
    blocks = []
    for number, own in enumerate(np.split(knots, np.cumsum(sizes)[:-1])):
        basis = nurbs_basis(own, int(orders[number]), ranges[number], 1 if orders[number] == 2 else 8)
        if basis is None:
            reading.warn(prim, f"gives curve {number} no range: it is skipped", "knots")
        blocks.append(sparse.csr_array((0, counts[number])) if basis is None else basis[0])
    matrix = sparse.block_diag(blocks, format="csr")
    if not matrix.shape[0]:
        return None
    weighted = rational(reading, prim, matrix)
    curve = np.repeat(np.arange(len(counts)), [block.shape[0] for block in blocks])

    def at(values: Values) -> Array:
        return weighted @ values.values if values.interpolation == "vertex" else values.of_parts(curve)

    return Strands(weighted @ points, curve, False, lengths=lengths, at=at)


def nurbs_basis(knots: Array, order: int, ends: Array, pieces: int) -> tuple[Any, Array] | None:
    """Return the matrix of the basis functions at parameters between these ends, and the parameters scaled to 0 to 1.

    There are so many pieces between two knots. None: the knots decrease, or leave no interval between the ends.
    """
    from scipy.interpolate import BSpline

    count = len(knots) - order
    if count < order or np.any(np.diff(knots) < 0):
        return None
    first, last = max(knots[order - 1], ends[0]), min(knots[count], ends[1])
    if not first < last:
        return None
    places = np.linspace(first, last, pieces * (count - order + 1) + 1)
    return BSpline.design_matrix(places, knots, order - 1), (places - first) / (last - first)


def rational(reading: Reading, prim: Usd.Prim, basis: Any) -> Any:
    """Return the sparse matrix of a NURBS, from that of its basis (N, P), by the weights of its points."""
    from scipy import sparse

    weights = floats(reading, prim, "pointWeights")
    weights = weights if len(weights) == basis.shape[1] and np.all(weights > 0) else np.ones(basis.shape[1])
    return sparse.diags_array(1 / (basis @ weights)) @ basis @ sparse.diags_array(weights)


def basis_of(reading: Reading, prim: Usd.Prim) -> tuple[str, str]:
    """Return the basis of cubic curves, or "linear", and how the curves wrap."""
    linear = reading.value(prim, "type", "cubic") == "linear"
    basis = "linear" if linear else reading.choice(prim, "basis", "bezier", BASES)
    return basis, reading.choice(prim, "wrap", "nonperiodic", WRAPS)


def floats(reading: Reading, prim: Usd.Prim, name: str) -> Array:
    """Return an array of numbers, (N,), empty if there is none."""
    found = reading.array(prim, name, 1)
    return np.zeros(0) if found is None else found[:, 0]
