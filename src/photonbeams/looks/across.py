"""Across the beam: the profile over the cross-section, and its line projection.

A profile is a disc kernel k2(ρ, R) = density(ρ²) / R² with ∫ density · 2πρ dρ = 1 over [0, 1]. Seen as a flat
billboard a beam has the kernel k1 of *the same* profile, its Abel transform (theory of Jarosz et al. 2011, checked in
the tests), or the picture would pop where one estimate hands over to the other:

    k1(u, R) = (2/R) ∫_{u/R}^1 density ρ / √(ρ² − (u/R)²) dρ = √(1 − x) line(x) / R,   x = (u/R)²
    line(x) = 2 ∫_0^1 density(x + (1 − x) v²) dv                    (ρ² = x + (1 − x) v²)

The square root holds all of k1's singular slope at the rim, so `line` is smooth and a table of it is exact enough.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import to_float
from ..numerics.given import Given, given, given_number, table
from ..quadrature import gauss_legendre
from ..runtime.device import Float
from ..scene import SceneError, has_gradients, shown
from .described import Described, constructor, described
from .factors import Factor, FactorLike, Function, Number, Numbers, factor
from .table import Table

_SAMPLES = 1024  # entries of a tabulated profile and of its line projection
_RULE = gauss_legendre(32)

# Profiles are tabulated over ρ², which costs no square root; shapes are smooth in ρ², or have declared corners.
_RADII = np.sqrt(np.linspace(0, 1, _SAMPLES))


class Across(Described):
    """A profile. Subclasses answer `shape`, of any scale; this class normalises and projects it.

    Attributes
    ----------
    corners
        Values of ρ in [0, 1) where the profile is not smooth: quadrature splits its interval there.
    attached
        Whether the profile is attached to the AD graph. Its projection never is: derivatives are the frustum's.
    """

    is_profile = True
    corners: tuple[float, ...] = ()
    attached: bool = False

    __array_ufunc__ = None  # NumPy's arrays leave the product to the profile

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the profile at ρ (float64 NumPy), before it is normalised."""
        raise NotImplementedError

    @cached_property
    def scale(self) -> float:
        """The factor that makes ∫ shape · 2πρ dρ equal 1."""
        total = float(_RULE.integrate(lambda rho: self.shape(rho) * 2 * np.pi * rho, 0.0, 1.0, self._fine_breaks))
        if not np.isfinite(total) or total <= 0:
            raise SceneError("a profile across the beam has no light: expected finite values with a positive sum")
        return 1 / total

    @property
    def _fine_breaks(self) -> tuple[float, ...]:
        return (*self.corners, *np.linspace(0, 1, 17)[1:-1].tolist())

    @cached_property
    def _density(self) -> Table:
        return Table(self.scale * self.shape(_RADII))

    @cached_property
    def _line(self) -> Table:
        x = np.linspace(0, 1, _SAMPLES)

        def integrand(v: Any) -> Any:
            return self.shape(np.sqrt(x + (1 - x) * v * v))

        with np.errstate(divide="ignore", invalid="ignore"):
            breaks = [np.nan_to_num(np.sqrt(np.clip((c * c - x) / (1 - x), 0, 1))) for c in self.corners]
        pieces = (*breaks, *np.linspace(0, 1, 9)[1:-1].tolist())
        return Table(2 * self.scale * _RULE.integrate(integrand, np.zeros_like(x), np.ones_like(x), pieces))

    def __mul__(self, other: FactorLike) -> Modulated:
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


class _Shaped(Across):
    """A profile of numbers whose gradients may be enabled. Subclasses answer `_shape`."""

    def _attach(self, *numbers: Given) -> None:
        """Keep the numbers; where they are attached, so is the profile's table."""
        self._numbers = numbers
        self.attached = any(each.attached is not None for each in numbers)
        if self.attached:  # now: estimates suspend gradients while they gather
            self._density = Table(table(self._scaled, *numbers))

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the profile at ρ."""
        return self._shape(rho, *(each.plain for each in self._numbers))

    def _shape(self, rho: npt.NDArray[np.float64], *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the profile at ρ for these numbers."""
        raise NotImplementedError

    def _scaled(self, *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the table of the normalised profile for these numbers."""

        def weighed(rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            return self._shape(rho, *numbers) * 2 * np.pi * rho

        return 1 / float(_RULE.integrate(weighed, 0.0, 1.0, self._fine_breaks)) * self._shape(_RADII, *numbers)


class Gaussian(_Shaped):
    """exp(−ρ²/2w²), lowered so that it reaches zero at the rim; `width` w is its standard deviation in radii.

    Raises
    ------
    SceneError
        A width that is not 0.02 to 10 radii.
    """

    @constructor
    def __init__(self, width: Number = 0.35) -> None:
        self._attach(given_number(width, "a Gaussian profile's width", "0.02 to 10 radii", 0.02, 10))

    def _shape(self, rho: npt.NDArray[np.float64], *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the lowered Gaussian."""
        rate = 0.5 / numbers[0] ** 2
        return np.exp(-rate * rho * rho) - np.exp(-rate)


class Smoothstep(_Shaped):
    """1 up to ρ = hardness, then down by 1 − 3t² + 2t³ to zero at the rim; hardness 1 is a hard rim.

    Raises
    ------
    SceneError
        A hardness that is not 0 to 1.
    """

    @constructor
    def __init__(self, hardness: Number = 0.0) -> None:
        inner = given_number(hardness, "a profile's hardness", "a number from 0 to 1", 0, 1)
        place = _inner(inner.plain)
        self.corners = (place,) if place > 0 else ()
        self._attach(inner)

    def _shape(self, rho: npt.NDArray[np.float64], *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the eased step."""
        inner = _inner(numbers[0])
        t = np.clip((rho - inner) / (1 - inner), 0, 1)
        return 1 - t * t * (3 - 2 * t)


def _inner(hardness: Any) -> float:
    return min(float(hardness), 0.999)


class Hollow(_Shaped):
    """A hollow shaft: nothing up to ρ = inner, light between there and the rim.

    It rises and falls by 3t² − 2t³, each over half of `softness`, a fraction of the wall's thickness.

    Raises
    ------
    SceneError
        An inner radius that is not 0 to 0.99, a softness that is not 0.01 to 1.
    """

    @constructor
    def __init__(self, inner: Number = 0.5, softness: Number = 1.0) -> None:
        hole = given_number(inner, "a hollow profile's inner radius", "a number from 0 to 0.99", 0, 0.99)
        soft = given_number(softness, "a hollow profile's softness", "a number from 0.01 to 1", 0.01, 1)
        place = float(hole.plain)
        edge = 0.5 * float(soft.plain) * (1 - place)
        self.corners = tuple(sorted({place, place + edge, 1 - edge} - {0.0}))
        self._attach(hole, soft)

    def _shape(self, rho: npt.NDArray[np.float64], *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the wall's profile."""
        inner, softness = numbers
        t = np.clip((rho - inner) / (1 - inner), 0, 1)
        edge = np.clip(np.minimum(t, 1 - t) / (0.5 * softness), 0, 1)
        return edge * edge * (3 - 2 * edge)


class Tabulated(_Shaped):
    """A curve: `values` (M,) at equidistant ρ from the axis to the rim, linear between them.

    Raises
    ------
    SceneError
        Fewer than two values, or values that are negative or not finite.
    """

    @constructor
    def __init__(self, values: Numbers) -> None:
        expected = "at least two finite values, none below 0"
        curve = given(values, "a tabulated profile", expected)
        if curve.plain.ndim != 1 or len(curve.plain) < 2 or not np.all(np.isfinite(curve.plain)):
            raise SceneError(f"a tabulated profile is {shown(values)}: expected {expected}")
        if np.any(curve.plain < 0):
            raise SceneError("a tabulated profile has a negative value: expected values of at least 0")
        # Few knots are corners worth splitting at; many are a smooth curve.
        knots = np.linspace(0, 1, len(curve.plain))[:-1]
        self.corners = tuple(knots.tolist()) if len(knots) <= 4 else (0.0,)
        self._attach(curve)

    def _shape(self, rho: npt.NDArray[np.float64], *numbers: Any) -> npt.NDArray[np.float64]:
        """Return the curve."""
        (values,) = numbers
        return np.interp(rho, np.linspace(0, 1, len(values)), values)


class AcrossFunction(Across):
    """Any Python function of ρ (a Dr.Jit array): tabulated once, normalised, and projected like the others."""

    def __init__(self, function: Callable[[Any], Any], written: Factor | None = None) -> None:
        self._function = Function(function, "radius")
        self._written = written or self._function
        grid = np.linspace(0, 1, 4 * _SAMPLES)
        found = dr.zeros(Float, len(grid)) + self._function.called(to_float(grid))
        values = np.asarray(dr.detach(found), dtype=np.float64)
        if values.shape != grid.shape or not np.all(np.isfinite(values)) or np.any(values < 0):
            raise SceneError("a profile function expects finite values of at least 0 for ρ from 0 to 1")
        self._grid, self._values = grid, values
        self.corners = (0.0,)
        self.attached = has_gradients(found)
        if self.attached:
            self._density = self._attached_density(function)

    def __repr__(self) -> str:
        return repr(self._written)

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the function's values."""
        return np.interp(rho, self._grid, self._values)

    def _attached_density(self, function: Callable[[Any], Any]) -> Table:
        """Return the table of the normalised function, attached as its values are."""
        total = Float(0)
        edges = np.linspace(0, 1, 17)
        for low, high in pairwise(edges):
            rho = low + (high - low) * 0.5 * (1 + _RULE.points)
            total += dr.sum(function(to_float(rho)) * to_float(_RULE.weights * (high - low) * np.pi * rho))
        values = to_float(self.scale * self.shape(_RADII))
        attached: Any = dr.zeros(Float, _SAMPLES) + function(to_float(_RADII)) / total
        return Table(dr.replace_grad(values, attached))  # type: ignore[func-returns-value]


class Modulated(Described):
    """A profile, and a factor that changes it from place to place: colours by radius, noise, an expression.

    The profile is normalised, what the factor makes of it is not: where the factor is 1 the profile is as it was.
    """

    is_profile = True
    __array_ufunc__ = None

    def __init__(self, profile: Across, factor: Factor) -> None:
        if not isinstance(profile, Across) or not isinstance(factor, Factor):
            raise SceneError(
                f"a modulated profile is {shown(profile)} times {shown(factor)}: expected a profile and a factor"
            )
        self.profile, self.factor = profile, factor

    def __mul__(self, other: FactorLike) -> Modulated:
        return Modulated(self.profile, self.factor * factor(other))

    __rmul__ = __mul__

    def __repr__(self) -> str:
        return f"{self.profile} * {described(self.factor)}"


#: What stands for a profile: a profile, a list of values, a function of ρ, an expression, or a factor.
AcrossLike: TypeAlias = Across | Modulated | FactorLike


def across(value: AcrossLike) -> Across | Modulated:
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
    if isinstance(value, type):
        raise SceneError(f"across is the class {value.__name__}: expected one of it, {value.__name__}(...)")
    if not callable(value):
        given(value, "across", "a profile, values from the axis to the rim, an expression, a function or a factor")
        return Tabulated(value)
    function = Function(value, "radius")
    return AcrossFunction(value) if function.arguments == ["radius"] else Modulated(Uniform(), function)


def _written(expression: Factor) -> Across | Modulated:
    """Return an expression as a profile."""
    from .context import ShadingContext, inputs_of

    alone = inputs_of(expression.evaluate, ShadingContext(rho2=Float(0.5))) <= {"radius"}
    value = expression.evaluate(ShadingContext(rho2=Float(0.5)))
    if not alone or dr.size_v(value) == 3:
        return Modulated(Uniform(), expression)
    return AcrossFunction(lambda rho: expression.evaluate(ShadingContext(rho2=rho * rho)), expression)
