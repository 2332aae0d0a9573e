"""Across the beam: the profile over the cross-section, and its line projection.

A profile is a disc kernel k2(ρ, R) = density(ρ²) / R² with ∫ density · 2πρ dρ = 1 over [0, 1]. Seen as a flat
billboard a beam has the kernel k1 of *the same* profile, its Abel transform (theory of Jarosz et al. 2011, checked in
the tests), or the picture would pop where one estimate hands over to the other:

    k1(u, R) = (2/R) ∫_{u/R}^1 density ρ / √(ρ² − (u/R)²) dρ = √(1 − x) line(x) / R,   x = (u/R)²
    line(x) = 2 ∫_0^1 density(x + (1 − x) v²) dv                    (ρ² = x + (1 − x) v²)

The square root holds all of k1's singular slope at the rim, so `line` is smooth and a table of it is exact enough.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import to_float
from ..quadrature import gauss_legendre
from ..runtime.device import Float
from .factors import Factor, Function, factor
from .table import Table

_SAMPLES = 1024  # entries of a tabulated profile and of its line projection
_RULE = gauss_legendre(32)


class Across:
    """A profile. Subclasses answer `shape`, of any scale; this class normalises and projects it.

    Attributes
    ----------
    corners
        Values of ρ in [0, 1) where the profile is not smooth: quadrature splits its interval there.
    """

    corners: tuple[float, ...] = ()

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the profile at ρ (float64 NumPy), before it is normalised."""
        raise NotImplementedError

    @cached_property
    def scale(self) -> float:
        """The factor that makes ∫ shape · 2πρ dρ equal 1."""
        total = float(_RULE.integrate(lambda rho: self.shape(rho) * 2 * np.pi * rho, 0.0, 1.0, self._fine_breaks))
        if not np.isfinite(total) or total <= 0:
            raise ValueError("a profile across the beam expects finite values with a positive sum")
        return 1 / total

    @property
    def _fine_breaks(self) -> tuple[float, ...]:
        return (*self.corners, *np.linspace(0, 1, 17)[1:-1].tolist())

    @cached_property
    def _density(self) -> Table:
        # Tabulated over ρ², which costs no square root; shapes are smooth in ρ², or have declared corners.
        return Table(self.scale * self.shape(np.sqrt(np.linspace(0, 1, _SAMPLES))))

    @cached_property
    def _line(self) -> Table:
        x = np.linspace(0, 1, _SAMPLES)

        def integrand(v: Any) -> Any:
            return self.shape(np.sqrt(x + (1 - x) * v * v))

        with np.errstate(divide="ignore", invalid="ignore"):
            breaks = [np.nan_to_num(np.sqrt(np.clip((c * c - x) / (1 - x), 0, 1))) for c in self.corners]
        pieces = (*breaks, *np.linspace(0, 1, 9)[1:-1].tolist())
        return Table(2 * self.scale * _RULE.integrate(integrand, np.zeros_like(x), np.ones_like(x), pieces))

    def __mul__(self, other: Any) -> Modulated:
        return Modulated(self, factor(other))

    __rmul__ = __mul__

    def density(self, rho2: Any) -> Any:
        """Return the normalised disc kernel times R² at ρ² in [0, 1]."""
        return self._density(rho2)

    def line(self, x: Any) -> Any:
        """Return k1 · R / √(1 − x) at x = (u/R)²."""
        return self._line(x)


class _Bump(Across):
    """(n + 1)/π (1 − ρ²)^n, whose line projection is again such a power: no table is needed."""

    _power = 0

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return (1 − ρ²)^n."""
        return (1 - rho * rho) ** self._power

    @cached_property
    def _line_scale(self) -> float:
        # 2 (n + 1)/π ∫_0^1 (1 − v²)^n dv, a polynomial, so the rule is exact
        return 2 * (self._power + 1) / np.pi * float(_RULE.integrate(lambda v: (1 - v * v) ** self._power, 0.0, 1.0))

    def density(self, rho2: Any) -> Any:
        """Return (n + 1)/π (1 − ρ²)^n."""
        return self._bump(rho2) * ((self._power + 1) / np.pi)

    def line(self, x: Any) -> Any:
        """Return the line projection's smooth part."""
        return self._bump(x) * self._line_scale

    def _bump(self, x: Any) -> Any:
        base = dr.maximum(1 - x, 0)
        result = type(base)(1)
        for _ in range(self._power):
            result = result * base
        return result


class Uniform(_Bump):
    """The constant disc 1/π, with a hard rim."""


class Epanechnikov(_Bump):
    """2/π (1 − ρ²): smooth inside, a corner at the rim."""

    _power = 1


class Biweight(_Bump):
    """3/π (1 − ρ²)²: smooth at the rim too."""

    _power = 2


class Gaussian(Across):
    """exp(−ρ²/2w²), lowered so that it reaches zero at the rim; `width` w is its standard deviation in radii.

    Raises
    ------
    ValueError
        A width that is not 0.02 to 10 radii.
    """

    def __init__(self, width: float = 0.35) -> None:
        if not 0.02 <= width <= 10:
            raise ValueError(f"a Gaussian profile's width is {width}: expected 0.02 to 10 radii")
        self._width = width

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the lowered Gaussian."""
        rate = 0.5 / self._width**2
        return np.exp(-rate * rho * rho) - np.exp(-rate)


class Smoothstep(Across):
    """1 up to ρ = hardness, then down by 1 − 3t² + 2t³ to zero at the rim; hardness 1 is a hard rim.

    Raises
    ------
    ValueError
        A hardness that is not 0 to 1.
    """

    def __init__(self, hardness: float = 0.0) -> None:
        if not 0 <= hardness <= 1:
            raise ValueError(f"hardness is {hardness}: expected 0 to 1")
        self._inner = min(hardness, 0.999)
        self.corners = (self._inner,) if self._inner > 0 else ()

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the eased step."""
        t = np.clip((rho - self._inner) / (1 - self._inner), 0, 1)
        return 1 - t * t * (3 - 2 * t)


class Hollow(Across):
    """A hollow shaft: nothing up to ρ = inner, light between there and the rim.

    It rises and falls by 3t² − 2t³, each over half of `softness`, a share of the wall's thickness.

    Raises
    ------
    ValueError
        An inner radius that is not 0 to 0.99, a softness that is not 0.01 to 1.
    """

    def __init__(self, inner: float = 0.5, softness: float = 1.0) -> None:
        if not 0 <= inner <= 0.99 or not 0.01 <= softness <= 1:
            raise ValueError(
                f"a hollow profile has inner {inner} and softness {softness}: expected 0 to 0.99 and 0.01 to 1"
            )
        self._inner, self._softness = inner, softness
        edge = 0.5 * softness * (1 - inner)
        self.corners = tuple(sorted({inner, inner + edge, 1 - edge} - {0.0}))

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the wall's profile."""
        t = np.clip((rho - self._inner) / (1 - self._inner), 0, 1)
        edge = np.clip(np.minimum(t, 1 - t) / (0.5 * self._softness), 0, 1)
        return edge * edge * (3 - 2 * edge)


class Tabulated(Across):
    """A curve: `values` (M,) at equidistant ρ from the axis to the rim, linear between them.

    Raises
    ------
    ValueError
        Fewer than two values, or values that are negative or not finite.
    """

    def __init__(self, values: Sequence[float]) -> None:
        self._values = np.asarray(values, dtype=np.float64)
        if self._values.ndim != 1 or len(self._values) < 2 or not np.all(np.isfinite(self._values)):
            raise ValueError("a tabulated profile expects at least two finite values")
        if np.any(self._values < 0):
            raise ValueError("a tabulated profile has a negative value: expected values of at least 0")
        # Few knots are corners worth splitting at; many are a smooth curve.
        knots = np.linspace(0, 1, len(self._values))[:-1]
        self.corners = tuple(knots.tolist()) if len(knots) <= 4 else (0.0,)

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the curve."""
        return np.interp(rho, np.linspace(0, 1, len(self._values)), self._values)


class AcrossFunction(Across):
    """Any Python function of ρ (a Dr.Jit array): tabulated once, normalised, and projected like the others."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        grid = np.linspace(0, 1, 4 * _SAMPLES)
        values = np.asarray(dr.zeros(Float, len(grid)) + function(to_float(grid)), dtype=np.float64)
        if values.shape != grid.shape or not np.all(np.isfinite(values)) or np.any(values < 0):
            raise ValueError("a profile function expects finite values of at least 0 for ρ from 0 to 1")
        self._grid, self._values = grid, values
        self.corners = (0.0,)

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the function's values."""
        return np.interp(rho, self._grid, self._values)


class Modulated:
    """A profile, and a factor that changes it from place to place: colours by radius, noise, an expression.

    The profile is normalised, what the factor makes of it is not: where the factor is 1 the profile is as it was.
    """

    def __init__(self, profile: Across, factor: Factor) -> None:
        self.profile, self.factor = profile, factor

    def __mul__(self, other: Any) -> Modulated:
        return Modulated(self.profile, self.factor * other)

    __rmul__ = __mul__


def across(value: Any) -> Across | Modulated:
    """Return `value` as a profile: an Across, a list of values, a Python function of ρ, an expression, or a factor.

    A function or an expression of ρ alone is a profile, normalised like the others. A factor, or what asks for more,
    modulates the constant disc.
    """
    if isinstance(value, Across | Modulated):
        return value
    if isinstance(value, Factor):
        return Modulated(Uniform(), value)
    if isinstance(value, str):
        return _written(factor(value))
    if not callable(value):
        return Tabulated(value)
    function = Function(value, "radius")
    return AcrossFunction(value) if function.arguments == ["radius"] else Modulated(Uniform(), function)


def _written(expression: Factor) -> Across | Modulated:
    """Return an expression as a profile."""
    from .at import At, inputs_of

    alone = inputs_of(expression.evaluate, At(rho2=Float(0.5))) <= {"radius"}
    value = expression.evaluate(At(rho2=Float(0.5)))
    if not alone or dr.size_v(value) == 3:
        return Modulated(Uniform(), expression)
    return AcrossFunction(lambda rho: expression.evaluate(At(rho2=rho * rho)))
