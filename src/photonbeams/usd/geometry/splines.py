"""Linear and cubic BasisCurves as spans, and points along these, as many as their curvature needs.

A span is a polynomial in t from 0 to 1, of control points weighted by the basis (UsdGeomBasisCurves; Catmull and Rom
1974 for `catmullRom`). Values along a curve follow the same basis (vertex) or are linear from span to span (varying).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyder, polyvander

from ...scene import Array
from ...scene.vectors import unit
from .polygons import Values

#: Of bases. Rows: powers of t from 0 up; columns: control points.
MATRICES = {
    "linear": np.array([[1.0, 0], [-1, 1]]),
    "bezier": np.array([[1.0, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]),
    "bspline": np.array([[1.0, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6,
    "catmullRom": np.array([[0.0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2,
}
BASES = tuple(name for name in MATRICES if name != "linear")
WRAPS = ("nonperiodic", "periodic", "pinned")

# The greatest distance of a piece's chord from its curve, over the radius, and greatest turn of a piece, in degrees.
CHORD_ERROR, MOST_TURN = 1 / 200, 4.0
# Places narrower than this fraction of the curve's widest place, such as tips, are not cut more finely than there.
_NARROWEST = 1 / 8
_MOST_PIECES = 256  # of a span
_SAMPLES = 17  # of a span, for its curvature


def _limits(kind: str, wrap: str) -> tuple[int, int]:
    """Return the fewest points of a curve, and how many of its points begin no span."""
    if wrap == "periodic":
        return 3, 0
    if kind == "linear":
        return 2, 1
    if kind == "bezier":
        return 4, 1
    return (2, 1) if wrap == "pinned" else (4, 3)


def _step(kind: str) -> int:
    """Return how many points farther the next span begins."""
    return 3 if kind == "bezier" else 1


def expected_points(kind: str, wrap: str) -> str:
    """Return in words how many points a curve may have."""
    least, step = _limits(kind, wrap)[0], _step(kind)
    return f"{least} or more" if step == 1 else f"{least}, {least + step}, {least + 2 * step} and so on"


def span_counts(counts: Array, kind: str, wrap: str) -> Array:
    """Return how many spans curves of `counts` points have: 0 if they may not have so many points."""
    least, ends = _limits(kind, wrap)
    return np.where((counts >= least) & ((counts - least) % _step(kind) == 0), (counts - ends) // _step(kind), 0)


def varying_counts(counts: Array, kind: str, wrap: str) -> Array:
    """Return how many varying values curves of `counts` points have."""
    return span_counts(counts, kind, wrap) + (0 if wrap == "periodic" else 1)


@dataclass(frozen=True)
class Spans:
    """The spans of some curves.

    Attributes
    ----------
    matrix
        (K, K) matrix of the basis.
    index
        (S, K) numbers of each span's control points; numbers beyond the points refer to `phantoms`.
    varying
        (S, 2) numbers of the varying values at the two ends of each span.
    phantoms
        (P, 2) points (a, b); 2a − b are control points, too: a pinned curve has one before and one after it.
    curve
        (S,) the curve that each span belongs to.
    closed
        Whether curves end where they begin.
    """

    matrix: Array
    index: Array
    varying: Array
    phantoms: Array
    curve: Array
    closed: bool

    @classmethod
    def of(cls, counts: Array, chosen: Array, kind: str, wrap: str) -> Spans:
        """Return the spans of the chosen curves; `counts` are the points of all curves."""
        pinned, closed = wrap == "pinned" and kind in ("bspline", "catmullRom"), wrap == "periodic"
        matrix = MATRICES[kind]
        numbers = np.where(chosen, span_counts(counts, kind, wrap), 0)
        curve = np.repeat(np.arange(len(counts)), numbers)
        first = np.arange(len(curve)) - np.repeat(np.cumsum(numbers) - numbers, numbers)  # of its curve
        begin = np.cumsum(counts) - counts
        count = counts[curve][:, None]
        place = first[:, None] * _step(kind) + np.arange(len(matrix)) - pinned
        index = begin[curve][:, None] + (place % count if closed else place)
        values = varying_counts(counts, kind, wrap)
        varying = np.stack([first, (first + 1) % np.maximum(numbers[curve], 1) if closed else first + 1], axis=1)
        varying += (np.cumsum(values) - values)[curve][:, None]
        phantoms = np.empty((0, 2), dtype=np.int64)
        if pinned:
            ends = begin + counts - 1
            pairs = np.stack([begin, np.minimum(begin + 1, ends), ends, np.maximum(ends - 1, begin)], axis=1)
            phantoms = pairs.reshape(-1, 2)
            extra = int(counts.sum()) + 2 * curve[:, None]
            index = np.where(place < 0, extra, np.where(place >= count, extra + 1, index))
        return cls(matrix, index, varying=varying, phantoms=phantoms, curve=curve, closed=closed)

    def controls(self, values: Array) -> Array:
        """Return the vertex values (V, C) of the control points of each span, (S, K, C)."""
        extended = np.concatenate([values, 2 * values[self.phantoms[:, 0]] - values[self.phantoms[:, 1]]])
        return extended[self.index]

    def at(self, values: Array, span: Array, t: Array, derivative: int = 0) -> Array:
        """Return vertex values (V, C), or their derivatives by t, at parameters t of spans, (N, C)."""
        basis = polyder(self.matrix, derivative)
        weights = polyvander(t, len(basis) - 1) @ basis  # (N, K)
        return np.einsum("nk,nkc->nc", weights, self.controls(values)[span])

    def values_at(self, values: Values, span: Array, t: Array) -> Array:
        """Return a primvar of the curves at parameters t of spans, (N, C)."""
        if values.interpolation == "vertex":
            return self.at(values.values, span, t)
        if values.interpolation == "varying":
            first, last = values.values[self.varying[span]].swapaxes(0, 1)
            return first + t[:, None] * (last - first)
        return values.of_parts(self.curve[span])

    def pieces(self, points: Array, radii: Array) -> Array:
        """Return (S,) how many pieces each span needs, for points (V, 3) and radii (S, SAMPLES) at `samples`.

        They are cubic.
        """
        span, t = self.samples()
        velocity, change = (self.at(points, span, t, order).reshape(-1, _SAMPLES, 3) for order in (1, 2))
        direction = unit(velocity)
        across = change - np.sum(change * direction, axis=2)[..., None] * direction
        widest = np.zeros(int(self.curve.max(initial=-1)) + 1)
        np.maximum.at(widest, self.curve, radii.max(axis=1))
        width = np.maximum(radii, _NARROWEST * widest[self.curve][:, None])
        # A chord lies h² |P''| / 8 from its curve, if the piece is the fraction h of the span.
        bow = np.linalg.norm(across, axis=2) / (8 * CHORD_ERROR * np.maximum(width, 1e-30))
        cosine = np.clip(np.sum(direction[:, 1:] * direction[:, :-1], axis=2), -1, 1)
        turn = np.degrees(np.arccos(cosine)).sum(axis=1) / MOST_TURN
        wanted = np.ceil(np.maximum(np.sqrt(bow.max(axis=1)), turn) - 1e-6)
        return np.clip(np.nan_to_num(wanted, nan=1, posinf=_MOST_PIECES), 1, _MOST_PIECES).astype(np.int64)

    def samples(self) -> tuple[Array, Array]:
        """Return the places on all spans that `pieces` examines: spans and t."""
        count = len(self.curve)
        return np.repeat(np.arange(count), _SAMPLES), np.tile(np.linspace(0, 1, _SAMPLES), count)

    def nodes(self, pieces: Array) -> tuple[Array, Array]:
        """Return the places between pieces, in order, and the ends of open curves: spans and t."""
        span = np.repeat(np.arange(len(pieces)), pieces)
        t = (np.arange(len(span)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / np.repeat(pieces, pieces)
        if self.closed or not len(span):
            return span, t
        lasts = np.flatnonzero(np.diff(self.curve, append=-1))  # the last span of each curve
        where = np.cumsum(pieces)[lasts]
        return np.insert(span, where, lasts), np.insert(t, where, 1.0)
