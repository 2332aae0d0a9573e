"""Quadrature rules on [−1, 1] and their use on [a, b], for NumPy and Dr.Jit values alike.

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
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["MOST_POINTS", "Rule", "gauss_legendre", "riemann"]

#: A rule is unrolled into the kernel that uses it, so its size is bounded; 64 Gauss points already count as converged.
MOST_POINTS = 256


@dataclass(frozen=True, eq=False, repr=False)
class Rule:
    """A quadrature rule: ∫ f over [−1, 1] ≈ Σ `weights` · f(`points`).

    Attributes
    ----------
    name
        What messages and tables call it.
    points, weights
        (n,) float64, in [−1, 1], and with the sum 2; read-only.

    Raises
    ------
    ValueError
        If points and weights are no such arrays.
    """

    name: str
    points: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("points", "weights"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or not values.size or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} of the rule {self.name}: expected one row of finite numbers")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if self.points.shape != self.weights.shape:
            raise ValueError(
                f"the rule {self.name} has {len(self.points)} points and {len(self.weights)} weights: "
                "expected as many of the one as of the other"
            )
        if np.any(np.abs(self.points) > 1):
            raise ValueError(f"points of the rule {self.name}: expected numbers between -1 and 1")
        if abs(self.weights.sum() - 2) > 1e-9:
            raise ValueError(f"weights of the rule {self.name} sum to {self.weights.sum():g}: expected 2")

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"{self.name}({len(self)})"

    def integrate(self, f: Callable[[Any], Any], a: Any, b: Any, breaks: Iterable[Any] = ()) -> Any:
        """Return the integral of `f` from `a` to `b` (Talk, eq. 2).

        Parameters
        ----------
        f
            Takes a value shaped like the bounds, and returns anything that can be scaled and added: a number, an
            array, an `Array3f`. It is called n times for each piece.
        a, b
            Numbers, NumPy arrays or Dr.Jit arrays. Swapping them changes the sign.
        breaks
            Where `f` has kinks, each a number or an array as the bounds are, in any order. The rule is used on each
            piece between them, since across a kink no rule converges faster than its square. A break outside the
            interval has no effect.

        Returns
        -------
        The integral, of the type that `f` returns. The rule's points and weights are the only literals that it brings
        into a kernel: bounds and breaks stay data.

        Examples
        --------
        >>> round(gauss_legendre(2).integrate(lambda x: x**3, 0.0, 2.0), 12)
        4.0
        >>> round(gauss_legendre(2).integrate(abs, -1.0, 3.0, breaks=[0.0]), 12)
        5.0
        """
        a, b = _bound(a), _bound(b)
        inner = _inner(breaks)
        if not inner:
            return self._piece(f, a, b)
        low, high = _minimum(a, b), _maximum(a, b)
        edges = [low, *_sorted([_maximum(low, _minimum(edge, high)) for edge in inner]), high]
        total = sum(self._piece(f, *piece) for piece in pairwise(edges))
        return total * _sign(a, b)

    def _piece(self, f: Callable[[Any], Any], a: Any, b: Any) -> Any:
        """Return the integral over [a, b], on which `f` has no kink."""
        half, middle = (b - a) * 0.5, (a + b) * 0.5
        # tolist(): a NumPy scalar times a Dr.Jit array would be a NumPy array.
        nodes = zip(self.points.tolist(), self.weights.tolist(), strict=True)
        return sum(f(half * x + middle) * weight for x, weight in nodes) * half


def gauss_legendre(n: int) -> Rule:
    """Return the Gauss–Legendre rule with `n` points, exact for polynomials of degree 2n − 1 (Talk, eq. 1).

    Raises
    ------
    ValueError
        If `n` is no whole number from 1 to 256.

    Examples
    --------
    >>> gauss_legendre(2).points.round(4).tolist(), gauss_legendre(2).weights.round(4).tolist()
    ([-0.5774, 0.5774], [1.0, 1.0])
    """
    return _gauss_legendre(_point_count(n))


def riemann(n: int) -> Rule:
    """Return the Riemann sum of `n` equal steps, each sampled in its middle; the error falls as n⁻².

    Raises
    ------
    ValueError
        If `n` is no whole number from 1 to 256.

    Examples
    --------
    >>> riemann(4).points.tolist(), riemann(4).weights.tolist()
    ([-0.75, -0.25, 0.25, 0.75], [0.5, 0.5, 0.5, 0.5])
    """
    return _riemann(_point_count(n))


# A cached rule is one object, so that rules may be compared and used as keys.
@cache
def _gauss_legendre(n: int) -> Rule:
    return Rule("gauss_legendre", *np.polynomial.legendre.leggauss(n))


@cache
def _riemann(n: int) -> Rule:
    return Rule("riemann", (2 * np.arange(n) + 1) / n - 1, np.full(n, 2 / n))


def _point_count(n: Any) -> int:
    """Return `n` if a rule can have so many points."""
    try:
        count = operator.index(n)
    except TypeError:
        count = 0
    if isinstance(n, bool) or not 1 <= count <= MOST_POINTS:
        raise ValueError(f"n is {n!r}: expected a whole number of points from 1 to {MOST_POINTS}")
    return count


def _bound(value: Any) -> Any:
    """Return a bound as a Python float, a float array of NumPy, or the Dr.Jit array that it is."""
    if _is_drjit(value):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in "buif":
        raise TypeError(f"bound is {value!r}: expected a number, a NumPy array or a Dr.Jit array")
    if array.ndim == 0:
        return float(array)
    return array if array.dtype.kind == "f" else array.astype(np.float64)


def _inner(breaks: Iterable[Any]) -> list[Any]:
    """Return the breaks as bounds."""
    if _is_drjit(breaks) or not isinstance(breaks, Iterable):
        raise TypeError(f"breaks is {breaks!r}: expected a sequence, with one number or array for each break")
    return [_bound(edge) for edge in breaks]


def _sorted(values: list[Any]) -> list[Any]:
    """Return the values in ascending order, element by element; min/max pairs, since arrays have no one order."""
    values = list(values)
    for stop in range(len(values) - 1, 0, -1):
        for i in range(stop):
            values[i], values[i + 1] = _minimum(values[i], values[i + 1]), _maximum(values[i], values[i + 1])
    return values


def _is_drjit(value: Any) -> bool:
    """Tell whether `value` is a Dr.Jit array, without importing Dr.Jit for those who only use NumPy."""
    drjit = sys.modules.get("drjit")
    return drjit is not None and bool(drjit.is_array_v(value))


def _library(*values: Any) -> Any:
    """Return the module whose `minimum` and `maximum` take these values."""
    return sys.modules["drjit"] if any(map(_is_drjit, values)) else np


def _minimum(a: Any, b: Any) -> Any:
    """Return the smaller of two values; of two floats a float, for a NumPy scalar would swallow Dr.Jit arrays."""
    return min(a, b) if isinstance(a, float) and isinstance(b, float) else _library(a, b).minimum(a, b)


def _maximum(a: Any, b: Any) -> Any:
    """Return the larger of two values."""
    return max(a, b) if isinstance(a, float) and isinstance(b, float) else _library(a, b).maximum(a, b)


def _sign(a: Any, b: Any) -> Any:
    """Return −1 where the bounds are swapped, else 1."""
    if isinstance(a, float) and isinstance(b, float):
        return -1.0 if b < a else 1.0
    library = _library(a, b)
    return library.select(b < a, -1.0, 1.0) if library is not np else np.where(b < a, -1.0, 1.0)
