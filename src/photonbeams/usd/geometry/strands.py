"""Read BasisCurves, NurbsCurves and HermiteCurves as strands: points along curves, denser where these bend more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...scene import Array
from ...scene.vectors import unit
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Values
from .splines import BASES, WRAPS, Spans, expected_points, span_counts, varying_counts
from .velocities import carried

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


def read_strands(reading: Reading, prim: Usd.Prim, most: int) -> Strands | None:
    """Return the curves of a prim in its own space, or None, with a warning, if there are none.

    `most` is about the most points that they may have; an even selection of the curves is left out only if these have
    more points by themselves.
    """
    found = read_points(reading, prim)
    if found is None:
        return None
    sample, points, counts = found
    if prim.IsA(UsdGeom.NurbsCurves):
        return _nurbs(sample, prim, points, counts)
    if prim.IsA(UsdGeom.HermiteCurves):
        return _hermite(sample, prim, points, counts, most)
    kind, wrap = basis_of(reading, prim)
    chosen = span_counts(counts, kind, wrap) > 0
    if not chosen.all():
        text = f"has {np.count_nonzero(~chosen)} curves whose number of points is not {expected_points(kind, wrap)}"
        reading.warn(prim, f"{text}: they are skipped", "curveVertexCounts")
    return _basis(points, counts, _thinned(reading, prim, counts, chosen, most), kind, wrap, most)


def read_points(reading: Reading, prim: Usd.Prim) -> tuple[Reading, Array, Array] | None:
    """Return the reading of the curves' time sample, their points, and how many each has; None without points.

    Raises
    ------
    SceneError
        The counts do not sum to the number of points.
    """
    moved = carried(reading, prim)
    sample = moved.reading if moved is not None else reading
    points = moved.points if moved is not None else reading.array(prim, "points", 3)
    counts = sample.integers(prim, "curveVertexCounts")
    if points is None or not len(counts):
        reading.warn(prim, "has no points: it is skipped")
        return None
    if counts.sum() != len(points) or np.any(counts < 0):
        text = f"sums to {counts.sum()}: expected {len(points)}, the number of points, and no negative counts"
        raise reading.fail(prim, "curveVertexCounts", text)
    return sample, points, counts


def _thinned(reading: Reading, prim: Usd.Prim, counts: Array, chosen: Array, most: int) -> Array:
    """Return the chosen curves, or every n-th of them if they have too many points."""
    step = -(-int(counts[chosen].sum()) // most)
    if step < 2:
        return chosen
    reading.warn(prim, f"has {len(counts)} curves: one in {step} is rendered, to limit memory", "curveVertexCounts")
    return chosen & (np.arange(len(counts)) % step == 0)


def _basis(points: Array, counts: Array, chosen: Array, kind: str, wrap: str, most: int) -> Strands | None:
    spans = Spans.of(counts, chosen, kind, wrap)
    if not len(spans.curve):
        return None
    pieces = np.ones(len(spans.curve), dtype=np.int64)
    if kind != "linear":
        extended = np.concatenate([points, 2 * points[spans.phantoms[:, 0]] - points[spans.phantoms[:, 1]]])
        pieces = _pieces(extended[spans.index], most)
    span, t = spans.nodes(pieces)
    lengths = {
        "constant": 1, "uniform": len(counts), "varying": int(varying_counts(counts, kind, wrap).sum()),
        "vertex": len(points),
    }  # fmt: skip
    return Strands(
        spans.at(points, span, t), spans.curve[span], spans.closed, lengths,
        lambda values: spans.values_at(values, span, t),
    )  # fmt: skip


def _pieces(controls: Array, most: int) -> Array:
    """Return how many pieces each span needs, from its control points (S, K, 3): a curve turns less than they do."""
    steps = unit(np.diff(controls, axis=1))
    cosines = np.einsum("ski,ski->sk", steps[:, 1:], steps[:, :-1]).clip(-1, 1)
    wanted = np.clip(np.ceil(np.arccos(cosines).sum(axis=1) / _TURN), 1, _MOST_PIECES).astype(np.int64)
    return np.minimum(wanted, max(1, most // len(controls)))


def _hermite(reading: Reading, prim: Usd.Prim, points: Array, counts: Array, most: int) -> Strands | None:
    """Return Hermite curves as Bézier curves, whose inner control points follow from the tangents."""
    directions = reading.array(prim, "tangents", 3)
    if directions is None or len(directions) != len(points):
        count = 0 if directions is None else len(directions)
        raise reading.fail(prim, "tangents", f"has {count} values: expected {len(points)}, as many as points")
    controls = np.stack([points - directions / 3, points, points + directions / 3], axis=1).reshape(-1, 3)
    last = np.cumsum(counts)
    ends = np.concatenate([3 * (last - counts), 3 * last - 1])
    inner = np.delete(np.arange(len(controls)), np.unique(ends[ends >= 0]))
    found = _basis(controls[inner], np.maximum(3 * counts - 2, 0), counts > 1, "bezier", "nonperiodic", most)
    if found is None:
        return None
    lengths = {**found.lengths, "vertex": len(points), "varying": len(points)}

    def at(values: Values) -> Array:
        kind = "varying" if values.interpolation == "vertex" else values.interpolation
        return found.at(Values(values.values, kind))

    return Strands(found.points, found.curve, False, lengths, at)


def _nurbs(reading: Reading, prim: Usd.Prim, points: Array, counts: Array) -> Strands | None:
    """Return NURBS curves, evaluated within their ranges."""
    from scipy import sparse  # takes long to import
    from scipy.interpolate import BSpline

    orders = reading.integers(prim, "order")
    if len(orders) not in (1, len(counts)):
        raise reading.fail(prim, "order", f"has {len(orders)} values: expected {len(counts)}, one for each curve")
    orders = np.broadcast_to(orders, (len(counts),))
    knots = floats(reading, prim, "knots")
    if len(knots) != (counts + orders).sum() or np.any(orders < 2):
        text = f"has {len(knots)} values: expected {(counts + orders).sum()}, the sum of all points and orders"
        raise reading.fail(prim, "knots", text)
    ranges = reading.array(prim, "ranges", 2)
    blocks, curve = [], []
    begin = 0
    for number, (count, order) in enumerate(zip(counts.tolist(), orders.tolist(), strict=True)):
        own = knots[begin : begin + count + order]
        begin += count + order
        first, last = (own[order - 1], own[count]) if count >= order else (0.0, 0.0)
        if ranges is not None and len(ranges) == len(counts):
            first, last = max(first, ranges[number, 0]), min(last, ranges[number, 1])
        ordered = count >= order and last > first and bool(np.all(np.diff(own) >= 0))
        number_of_samples = (1 if order == 2 else 8) * (count - order + 1) + 1
        samples = np.linspace(first, last, number_of_samples if ordered else 0)
        if not ordered:
            reading.warn(prim, f"gives curve {number} no range: it is skipped", "knots")
        blocks.append(BSpline.design_matrix(samples, own, order - 1) if ordered else sparse.csr_array((0, count)))
        curve.append(np.full(len(samples), number))
    matrix = sparse.block_diag(blocks, format="csr") if blocks else sparse.csr_array((0, len(points)))
    if not matrix.shape[0]:
        return None
    weighted = rational(reading, prim, matrix)
    lengths = {"constant": 1, "uniform": len(counts), "vertex": len(points)}
    curves = np.concatenate(curve)

    def at(values: Values) -> Array:
        if values.interpolation == "vertex":
            return np.asarray(weighted @ values.values)
        return values.values[curves if values.interpolation == "uniform" else np.zeros(len(curves), int)]

    return Strands(at(Values(points, "vertex")), curves, False, lengths, at)


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
