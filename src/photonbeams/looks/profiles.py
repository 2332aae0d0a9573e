"""The profiles across the beam that a user chooses from, or writes as values, a function or an expression."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import drjit as dr
import numpy as np

from ..numerics.arrays import to_float
from ..numerics.given import Given, Number, Numbers, given, given_number, table
from ..runtime.device import Float
from ..scene import Array, SceneError, has_gradients, shown
from .across import RADII, RULE, SAMPLES, Across, Modulated
from .context import ShadingContext, inputs_of
from .described import constructor
from .factors import Factor, FactorLike, Value, factor
from .functions import Function
from .table import Table


class _Bump(Across):
    """A profile (n + 1)/π (1 − ρ²)^n. Its line projection has the same form, so it needs no table."""

    _power = 0

    def shape(self, rho: Array) -> Array:
        """Return (1 − ρ²)^n."""
        return (1 - rho * rho) ** self._power

    @cached_property
    def _line_scale(self) -> float:
        # 2 (n + 1)/π ∫_0^1 (1 − v²)^n dv; the integrand is a polynomial, so the rule is exact
        return 2 * (self._power + 1) / np.pi * float(RULE.integrate(lambda v: (1 - v * v) ** self._power, 0.0, 1.0))

    def density(self, rho2: Float) -> Float:
        """Return (n + 1)/π (1 − ρ²)^n."""
        return dr.maximum(1 - rho2, 0) ** self._power * ((self._power + 1) / np.pi)

    def line(self, x: Float) -> Float:
        """Return the smooth part of the line projection."""
        return dr.maximum(1 - x, 0) ** self._power * self._line_scale


class Uniform(_Bump):
    """A flat profile 1/π with a hard rim.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Uniform())
    >>> look.across.shape(np.array([0.0, 0.5, 1.0])).tolist()
    [1.0, 1.0, 1.0]
    """


class Epanechnikov(_Bump):
    """The default profile 2/π (1 − ρ²): smooth inside, with a corner at the rim.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Epanechnikov())
    >>> look.across.shape(np.array([0.0, 0.5, 1.0])).tolist()
    [1.0, 0.75, 0.0]
    """

    _power = 1


class Biweight(_Bump):
    """A profile 3/π (1 − ρ²)², which is smooth at the rim, too.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Biweight())
    >>> look.across.shape(np.array([0.0, 0.5, 1.0])).tolist()
    [1.0, 0.5625, 0.0]
    """

    _power = 2


class _Shaped(Across):
    """A profile with numbers whose gradients may be enabled. Subclasses implement `_shape`."""

    def _attach(self, *numbers: Given) -> None:
        """Keep the numbers. If they are attached to the AD graph, so is the profile's table."""
        self._numbers = numbers
        self.attached = any(each.attached is not None for each in numbers)
        if self.attached:  # not later: estimates suspend gradients while they gather
            self._density = Table(table(self._scaled, *numbers))

    def shape(self, rho: Array) -> Array:
        """Return the profile at ρ."""
        return self._shape(rho, *(each.plain for each in self._numbers))

    def _shape(self, rho: Array, *numbers: Array) -> Array:
        """Return the profile at ρ for these numbers."""
        raise NotImplementedError

    def _scaled(self, *numbers: Array) -> Array:
        """Return the table of the normalised profile for these numbers."""

        def weighed(rho: Array) -> Array:
            return self._shape(rho, *numbers) * 2 * np.pi * rho

        total = float(RULE.integrate(weighed, 0.0, 1.0, self.fine_breaks))
        return self._within(self._shape(RADII * self.support, *numbers)) / total


class Gaussian(_Shaped):
    """A Gaussian profile exp(−ρ²/2w²), lowered so that it is zero at the rim.

    Parameters
    ----------
    width
        Standard deviation w in radii, 0.02 to 10. Default: 0.35.

    Raises
    ------
    SceneError
        If the width is not 0.02 to 10.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Gaussian(width=0.5))
    >>> look.across.shape(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.865, 0.471, 0.0]
    """

    @constructor
    def __init__(self, width: Number = 0.35) -> None:
        self._attach(given_number(width, "a Gaussian profile's width", "0.02 to 10 radii", 0.02, 10))

    def _shape(self, rho: Array, *numbers: Array) -> Array:
        """Return the lowered Gaussian."""
        rate = 0.5 / numbers[0] ** 2
        return np.exp(-rate * rho * rho) - np.exp(-rate)


class Smoothstep(_Shaped):
    """A flat profile with a soft edge: 1 up to ρ = hardness, then eased to zero at the rim by 1 − 3t² + 2t³.

    Parameters
    ----------
    hardness
        Position ρ where the edge begins, 0 to 1; 1 is a hard rim. Default: 0.

    Raises
    ------
    SceneError
        If the hardness is not 0 to 1.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Smoothstep(hardness=0.5))
    >>> look.across.shape(np.array([0.0, 0.5, 0.75, 1.0])).tolist()
    [1.0, 1.0, 0.5, 0.0]
    """

    @constructor
    def __init__(self, hardness: Number = 0.0) -> None:
        inner = given_number(hardness, "a profile's hardness", "a number from 0 to 1", 0, 1)
        place = _inner(inner.plain)
        self.corners = (place,) if place > 0 else ()
        self._attach(inner)

    def _shape(self, rho: Array, *numbers: Array) -> Array:
        """Return the eased step."""
        inner = _inner(numbers[0])
        t = np.clip((rho - inner) / (1 - inner), 0, 1)
        return 1 - t * t * (3 - 2 * t)


def _inner(hardness: Array) -> float:
    return min(float(hardness), 0.999)


class Hollow(_Shaped):
    """The profile of a hollow shaft: no light up to ρ = inner, and a wall of light from there to the rim.

    Parameters
    ----------
    inner
        Inner radius of the wall as a fraction of the beam's radius, 0 to 0.99. Default: 0.5.
    softness
        Fraction of the wall's thickness that is soft edge, 0.01 to 1; half of it lies on each side. The edges rise and
        fall by 3t² − 2t³. Default: 1.

    Raises
    ------
    SceneError
        If the inner radius is not 0 to 0.99, or if the softness is not 0.01 to 1.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Hollow(inner=0.5))
    >>> look.across.shape(np.array([0.0, 0.5, 0.75, 1.0])).tolist()
    [0.0, 0.0, 1.0, 0.0]
    """

    @constructor
    def __init__(self, inner: Number = 0.5, softness: Number = 1.0) -> None:
        hole = given_number(inner, "a hollow profile's inner radius", "a number from 0 to 0.99", 0, 0.99)
        soft = given_number(softness, "a hollow profile's softness", "a number from 0.01 to 1", 0.01, 1)
        place = float(hole.plain)
        edge = 0.5 * float(soft.plain) * (1 - place)
        self.corners = tuple(sorted({place, place + edge, 1 - edge} - {0.0}))
        self._attach(hole, soft)

    def _shape(self, rho: Array, *numbers: Array) -> Array:
        """Return the wall's profile."""
        inner, softness = numbers
        t = np.clip((rho - inner) / (1 - inner), 0, 1)
        edge = np.clip(np.minimum(t, 1 - t) / (0.5 * softness), 0, 1)
        return edge * edge * (3 - 2 * edge)


class Tabulated(_Shaped):
    """A profile that is given as a curve, linear between its values.

    Parameters
    ----------
    values
        (M,) values of 0 or more at equal steps of ρ from the axis to the rim, M ≥ 2, at any scale.

    Raises
    ------
    SceneError
        If there are fewer than two values, or if a value is negative or not finite.

    Examples
    --------
    >>> look = pb.Look(across=pb.looks.Tabulated([0.1, 0.2, 1.0, 0.6, 0.0]))
    >>> look.across.shape(np.array([0.0, 0.5, 0.875])).round(3).tolist()
    [0.1, 1.0, 0.3]
    """

    @constructor
    def __init__(self, values: Numbers) -> None:
        expected = "at least two finite values, none below 0"
        curve = given(values, "a tabulated profile", expected)
        if curve.plain.ndim != 1 or len(curve.plain) < 2 or not np.all(np.isfinite(curve.plain)):
            raise SceneError(f"a tabulated profile is {shown(values)}: expected {expected}")
        if np.any(curve.plain < 0):
            raise SceneError("a tabulated profile has a negative value: expected values of at least 0")
        self.corners = tuple(np.linspace(0, 1, len(curve.plain))[:-1].tolist())
        self._attach(curve)

    def _shape(self, rho: Array, *numbers: Array) -> Array:
        """Return the curve."""
        (values,) = numbers
        return np.interp(rho, np.linspace(0, 1, len(values)), values)


class AcrossFunction(Across):
    """A profile from a Python function of ρ (a Dr.Jit array), which is tabulated once."""

    def __init__(self, function: Callable[[Float], Value | float], written: Factor | None = None) -> None:
        self._function = Function(function, "radius")
        self._written = written or self._function
        grid = np.linspace(0, 1, 4 * SAMPLES)
        found = dr.zeros(Float, len(grid)) + self._function.called(to_float(grid))
        values = np.asarray(dr.detach(found), dtype=np.float64)
        if values.shape != grid.shape or not np.all(np.isfinite(values)) or np.any(values < 0):
            raise SceneError(
                "a profile function is negative, not finite, or a colour: expected finite values of at least 0 "
                "for ρ from 0 to 1"
            )
        self._grid, self._values = grid, values
        self.corners = (0.0,)
        self.attached = has_gradients(found)
        if self.attached:
            self._density = self._attached_density(function)

    def __repr__(self) -> str:
        return repr(self._written)

    def shape(self, rho: Array) -> Array:
        """Return the function's values."""
        return np.interp(rho, self._grid, self._values)

    def _attached_density(self, function: Callable[[Float], Value | float]) -> Table:
        """Return the table of the normalised function, attached to the AD graph like its values."""
        total = Float(0)
        edges = np.linspace(0, 1, 17)
        for low, high in pairwise(edges):
            rho = low + (high - low) * 0.5 * (1 + RULE.points)
            total += dr.sum(function(to_float(rho)) * to_float(RULE.weights * (high - low) * np.pi * rho))
        radii = RADII * self.support
        values = to_float(self._within(self.scale * self.shape(radii)))
        attached: Any = dr.zeros(Float, SAMPLES) + function(to_float(radii)) / total
        return Table(dr.replace_grad(values, attached))  # type: ignore[arg-type, func-returns-value]


#: Anything that can be used as a profile: a profile, a list of values, a function of ρ, an expression, or a factor.
AcrossLike: TypeAlias = Across | Modulated | FactorLike


def across(value: AcrossLike) -> Across | Modulated:
    """Return a profile, a list of values, a Python function, an expression, or a factor as a profile.

    A function or an expression of ρ alone becomes a profile, which is normalised. A factor, and a function or an
    expression of other inputs, modulates the flat profile.
    """
    if isinstance(value, Across | Modulated):
        return value
    if isinstance(value, Factor):
        return Modulated(Uniform(), value)
    if isinstance(value, str):
        return _written(factor(value))
    if isinstance(value, type):
        raise SceneError(f"across is the class {value.__name__}: expected an instance, {value.__name__}(...)")
    if not callable(value):
        given(value, "across", "a profile, values from the axis to the rim, an expression, a function or a factor")
        return Tabulated(value)
    function = Function(value, "radius")
    return AcrossFunction(value) if function.arguments == ["radius"] else Modulated(Uniform(), function)


def _written(expression: Factor) -> Across | Modulated:
    """Return an expression as a profile."""
    alone = inputs_of(expression.evaluate, ShadingContext(rho2=Float(0.5))) <= {"radius"}
    value = expression.evaluate(ShadingContext(rho2=Float(0.5)))
    if not alone or dr.size_v(value) == 3:
        return Modulated(Uniform(), expression)
    return AcrossFunction(lambda rho: expression.evaluate(ShadingContext(rho2=rho * rho)), expression)
