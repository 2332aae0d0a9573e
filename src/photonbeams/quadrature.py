"""Quadrature rules on [−1, 1], and their use on [a, b] with NumPy or Dr.Jit values.

Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011), equations 1 and 2: on [a, b]
the points are (b − a)/2 · x_i + (a + b)/2, and the sum is scaled by (b − a)/2.
"""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .constants import MOST_POINTS

if TYPE_CHECKING:
    from .numerics.types import Floats


@dataclass(frozen=True, eq=False, repr=False)
class Rule:
    """A quadrature rule: ∫ f over [−1, 1] ≈ Σ `weights` · f(`points`).

    Attributes
    ----------
    name
        Name of the rule in messages and tables.
    points
        (n,) positions in [−1, 1]. They are kept as a read-only float64 array.
    weights
        (n,) weights, whose sum is 2. They are kept as a read-only float64 array.

    Raises
    ------
    ValueError
        If points and weights are not two rows of equally many finite numbers, if a point is outside of [−1, 1], or if
        the weights do not sum to 2.

    Notes
    -----
    `len(rule)` is the number of points n.

    References
    ----------
    Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011), equations 1 and 2.

    Examples
    --------
    Simpson's rule integrates cubic polynomials exactly:

    >>> simpson = pb.Rule("simpson", [-1, 0, 1], [1 / 3, 4 / 3, 1 / 3])
    >>> round(simpson.integrate(lambda x: x**3, 0.0, 2.0), 12)
    4.0
    """

    name: str
    points: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("points", "weights"):
            given = getattr(self, name)
            partly = np.iscomplexobj(given) or np.ma.is_masked(given)  # NumPy takes real parts, and what is masked
            try:
                values = np.empty(0) if partly else np.array(given, dtype=np.float64)
            except (TypeError, ValueError):
                values = np.empty(0)
            if values.ndim != 1 or not values.size or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} of the rule {self.name}: expected one row of finite numbers")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if self.points.shape != self.weights.shape:
            raise ValueError(
                f"the rule {self.name} has {len(self.points)} points and {len(self.weights)} weights: "
                "expected as many weights as points"
            )
        if np.any(np.abs(self.points) > 1):
            raise ValueError(f"points of the rule {self.name}: expected numbers between -1 and 1")
        if abs(self.weights.sum() - 2) > 1e-9:
            raise ValueError(f"weights of the rule {self.name} sum to {self.weights.sum():g}: expected 2")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rule) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[str, bytes, bytes]:
        return self.name, self.points.tobytes(), self.weights.tobytes()

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"{self.name}({len(self)})"

    def integrate(self, f: Callable[..., Floats], a: Floats, b: Floats, breaks: Iterable[Floats] = ()) -> Any:
        """Return the integral of `f` from `a` to `b` (Johnson et al. 2011, equation 2).

        Parameters
        ----------
        f
            Function of a value shaped like the bounds. It returns anything that can be scaled and added: a number, an
            array, an `Array3f`. It is called n times for each piece of the interval.
        a, b
            Bounds: numbers, NumPy arrays or Dr.Jit arrays. Swapping them changes the sign.
        breaks
            Positions of the kinks of `f`, in any order, each a number or an array like the bounds. The rule is applied
            to each piece between them, because no rule converges faster than n⁻² across a kink. A break outside the
            interval has no effect.

        Returns
        -------
        The integral, of the type that `f` returns. Only the rule's points and weights become literals of a kernel;
        bounds and breaks remain data.

        Raises
        ------
        TypeError
            If a bound or a break is not a number or an array, or if `breaks` is not a sequence.

        Examples
        --------
        >>> round(pb.gauss_legendre(2).integrate(lambda x: x**3, 0.0, 2.0), 12)
        4.0
        >>> round(pb.gauss_legendre(2).integrate(abs, -1.0, 3.0, breaks=[0.0]), 12)
        5.0
        """
        a, b = _bound(a), _bound(b)
        inner = _inner(breaks)
        if not inner:
            return self._piece(f, a, b)
        library: Any = sys.modules["drjit"] if any(map(_is_drjit, (a, b, *inner))) else np
        low, high = library.minimum(a, b), library.maximum(a, b)
        inside = [library.maximum(low, library.minimum(edge, high)) for edge in inner]
        # Arrays have no single order, so this is a bubble sort of pairs, element by element.
        for stop in range(len(inside) - 1, 0, -1):
            for i in range(stop):
                pair = inside[i : i + 2]
                inside[i : i + 2] = library.minimum(*pair), library.maximum(*pair)
        pieces = pairwise(map(_bound, (low, *inside, high)))
        total = sum(self._piece(f, *piece) for piece in pieces)
        swapped = b < a
        return total * ((1.0 - 2.0 * swapped) if library is np else library.select(swapped, -1.0, 1.0))

    def _piece(self, f: Callable[..., Floats], a: Floats, b: Floats) -> Any:
        """Return the integral over [a, b], where `f` has no kink."""
        half, middle = (b - a) * 0.5, (a + b) * 0.5
        # tolist(): a NumPy scalar times a Dr.Jit array would be a NumPy array.
        nodes = zip(self.points.tolist(), self.weights.tolist(), strict=True)
        return sum(f(half * x + middle) * weight for x, weight in nodes) * half


def gauss_legendre(n: int) -> Rule:
    """Return the Gauss–Legendre rule with `n` points, which is exact for polynomials up to degree 2n − 1.

    Parameters
    ----------
    n
        Number of points, 1 to 256.

    Raises
    ------
    ValueError
        If `n` is not a whole number from 1 to 256.

    References
    ----------
    Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011), equation 1.

    Examples
    --------
    >>> rule = pb.gauss_legendre(2)
    >>> rule.points.round(4).tolist(), rule.weights.round(4).tolist()
    ([-0.5774, 0.5774], [1.0, 1.0])
    """
    return _gauss_legendre(_point_count(n))


def riemann(n: int) -> Rule:
    """Return the Riemann sum of `n` equal steps, each sampled at its middle.

    Parameters
    ----------
    n
        Number of steps, 1 to 256.

    Raises
    ------
    ValueError
        If `n` is not a whole number from 1 to 256.

    Notes
    -----
    This is the midpoint rule; the error falls as n⁻².

    Examples
    --------
    >>> rule = pb.riemann(4)
    >>> rule.points.tolist(), rule.weights.tolist()
    ([-0.75, -0.25, 0.25, 0.75], [0.5, 0.5, 0.5, 0.5])
    """
    return _riemann(_point_count(n))


@cache
def _gauss_legendre(n: int) -> Rule:
    return Rule("gauss_legendre", *np.polynomial.legendre.leggauss(n))


@cache
def _riemann(n: int) -> Rule:
    return Rule("riemann", (2 * np.arange(n) + 1) / n - 1, np.full(n, 2 / n))


def _point_count(n: int) -> int:
    """Return `n` as an int, or raise ValueError if no rule can have that many points."""
    try:
        count = operator.index(n)
    except TypeError:
        count = 0
    if isinstance(n, bool) or not 1 <= count <= MOST_POINTS:
        raise ValueError(f"n is {n!r}: expected a whole number of points from 1 to {MOST_POINTS}")
    return count


def _bound(value: Floats) -> Floats:
    """Return a bound as a Python float or a NumPy float array; Dr.Jit arrays are returned unchanged."""
    if _is_drjit(value):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in "buif" or np.ma.is_masked(value):
        text = " ".join(repr(value).split())[:60]
        raise TypeError(f"bound is {text}: expected a number, a NumPy array without a mask or a Dr.Jit array")
    if array.ndim == 0:
        return float(array)
    return array if array.dtype.kind == "f" else array.astype(np.float64)


def _inner(breaks: Iterable[Floats]) -> list[Floats]:
    """Return the breaks as bounds."""
    if _is_drjit(breaks) or not isinstance(breaks, Iterable):
        raise TypeError(f"breaks is {breaks!r}: expected a sequence, with one number or array for each break")
    return [_bound(edge) for edge in breaks]


def _is_drjit(value: object) -> bool:
    """Return whether `value` is a Dr.Jit array, without importing Dr.Jit where only NumPy is used."""
    drjit = sys.modules.get("drjit")
    return drjit is not None and bool(drjit.is_array_v(value))
