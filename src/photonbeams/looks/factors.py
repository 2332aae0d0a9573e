"""The four programmable factors of a beam's look (Nowrouzezahrai et al. 2011, "Art"), and how they compose.

    contribution = power · along(s) · across(ρ) · eye(t) · angle(θ)

A factor takes a `ShadingContext` and returns a number or a colour. Factors work on Dr.Jit arrays of any precision.
Their parameters are opaque, so that changing one does not recompile a kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, Union

import drjit as dr
import numpy as np

from ..numerics.given import Number, Numbers, given, given_color, given_number
from ..runtime.device import Array3f, Float
from ..scene import SceneError, arguments, shown
from .context import ShadingContext
from .described import Described, constructor

#: A corner of the integrand: the name of an input ("fraction", "distance", "eye", "radius") and its value there.
Corner: TypeAlias = tuple[str, float]

#: The value of a factor in a kernel: a number or a colour for each lane.
Value: TypeAlias = Union["Float", "Array3f"]
#: Anything that can be used as a factor: a factor, a number, a colour, an expression's text, or a Python function.
FactorLike: TypeAlias = Union["Factor", Numbers, str, Callable[..., Any]]


class Factor(Described):
    """Base of the factors of a look: along, eye, angle, or a factor of a profile. Subclasses implement `evaluate`.

    Attributes
    ----------
    corners
        Corners of the factor, as (input, value) pairs: quadrature splits its interval there.
    rough
        Whether the factor may have corners that are not in `corners`: quadrature then takes finer steps.
    wild
        Whether the factor may be negative or not finite: such values are clamped to light.
    of_rays
        Whether the factor depends on which ray is evaluated, as through samples along it.

    Notes
    -----
    Factors multiply (`*`) and add (`+`) with each other, with numbers, colours, expressions and functions. See also
    `mix` and `clamp`. In a product of a factor and a Dr.Jit array, the factor comes first.

    References
    ----------
    Nowrouzezahrai, Johnson, Selle, Lacewell, Kaschalk, Jarosz, "A Programmable System for Artistic Volumetric Lighting"
    (2011).

    Examples
    --------
    A factor of one's own:

    >>> class Twinkle(pb.looks.Factor):
    ...     rough = True
    ...
    ...     def evaluate(self, at):
    ...         return 1 - 0.5 * at.random
    >>> look = pb.Look(along=Twinkle() * pb.looks.Attenuation())
    """

    # NumPy arrays leave the product to the factor, instead of making one product for each entry.
    __array_ufunc__ = None

    corners: tuple[Corner, ...] = ()
    rough: bool = False
    wild: bool = False
    of_rays: bool = False

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the factor's value, a Float or an Array3f, for the inputs of a shading context `at`."""
        raise SceneError(f"{type(self).__name__} has no method evaluate(self, at): expected one that returns its value")

    def split(self, at: ShadingContext) -> tuple[Any, Any]:
        """Return (value, exponent), so that the factor `at` a shading context is value · exp(exponent).

        The exponents of a look are summed, so that only one exponential is needed, the most expensive operation.
        """
        return self.evaluate(at), 0.0

    def __mul__(self, other: FactorLike) -> Factor:
        if getattr(other, "is_profile", False):
            return NotImplemented  # the profile has its own product
        return Product((self, factor(other)))

    __rmul__ = __mul__

    def __add__(self, other: FactorLike) -> Factor:
        return Sum((self, factor(other)))

    __radd__ = __add__

    def mix(self, other: FactorLike, amount: FactorLike = 0.5) -> Factor:
        """Return the factor self · (1 − amount) + other · amount.

        Parameters
        ----------
        other
            A factor, or anything that can be used as one.
        amount
            A number, or anything that can be used as a factor. Default: 0.5.

        Examples
        --------
        >>> warm, cold = pb.looks.Constant([1, 0.7, 0.4]), pb.looks.Constant([0.3, 0.5, 1])
        >>> along = warm.mix(cold, "smoothstep(0.3, 0.6, s)")
        """
        return Mix(self, factor(other), factor(amount))

    def clamp(self, low: Number = 0.0, high: Number = 1.0) -> Factor:
        """Return the factor with its values clamped to [`low`, `high`], by default to [0, 1]."""
        return Clamp(self, low, high)


class Product(Factor):
    """A product of factors.

    Parameters
    ----------
    factors
        A list or tuple of one or more factors, or of anything that can be used as one.

    Raises
    ------
    SceneError
        If the list is empty, or if a part cannot be used as a factor.

    Notes
    -----
    Usually written with `*`.

    References
    ----------
    Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011), which multiplies a
    colour texture by physical attenuation.

    Examples
    --------
    >>> product = pb.looks.Power(exponent=1.0) * [1.0, 0.5, 0.25]
    >>> value = product.evaluate(pb.looks.ShadingContext(distance=1.0))
    >>> [round(channel[0], 3) for channel in value]
    [0.5, 0.25, 0.125]
    """

    @arguments
    def __init__(self, factors: Sequence[FactorLike]) -> None:
        listed = _factors(factors, "a product")
        flat = [inner for each in listed for inner in (each.factors if isinstance(each, Product) else (each,))]
        self.factors: tuple[Factor, ...] = tuple(flat)
        _inherit(self, self.factors)

    def __repr__(self) -> str:
        return " * ".join(f"({each})" if isinstance(each, Sum) else repr(each) for each in self.factors)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the product of the factors' values."""
        value, exponent = self.split(at)
        return value * dr.exp(exponent)

    def split(self, at: ShadingContext) -> tuple[Any, Any]:
        """Return the product of the values and the sum of the exponents."""
        value, exponent = self.factors[0].split(at)
        for each in self.factors[1:]:
            more, further = each.split(at)
            value, exponent = value * more, exponent + further
        return value, exponent


class Sum(Factor):
    """A sum of factors.

    Parameters
    ----------
    factors
        A list or tuple of one or more factors, or of anything that can be used as one.

    Raises
    ------
    SceneError
        If the list is empty, or if a part cannot be used as a factor.

    Notes
    -----
    Usually written with `+`.

    Examples
    --------
    A falloff that does not go to zero:

    >>> total = 0.8 * pb.looks.Power(exponent=2.0) + 0.2
    >>> round(total.evaluate(pb.looks.ShadingContext(distance=1.0))[0], 3)
    0.4
    """

    @arguments
    def __init__(self, factors: Sequence[FactorLike]) -> None:
        self._factors = _factors(factors, "a sum")
        _inherit(self, self._factors)

    def __repr__(self) -> str:
        return " + ".join(map(repr, self._factors))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the sum of the factors' values."""
        value = self._factors[0].evaluate(at)
        for each in self._factors[1:]:
            value = value + each.evaluate(at)
        return value


class Mix(Factor):
    """A mixture of two factors: first · (1 − amount) + second · amount.

    Parameters
    ----------
    first, second
        Factors, or anything that can be used as one.
    amount
        A number, or anything that can be used as a factor. Default: 0.5.

    Raises
    ------
    SceneError
        If an argument cannot be used as a factor.

    Notes
    -----
    Usually written `first.mix(second, amount)`. An amount outside of 0 to 1 extrapolates; a look clamps negative light
    to 0.

    Examples
    --------
    >>> mixture = pb.looks.Mix([1.0, 0.7, 0.4], [0.3, 0.5, 1.0], amount="s")  # warm at the light, cold at the end
    >>> value = mixture.evaluate(pb.looks.ShadingContext(fraction=0.5))
    >>> [round(channel[0], 3) for channel in value]
    [0.65, 0.6, 0.7]
    """

    @constructor
    def __init__(self, first: FactorLike, second: FactorLike, amount: FactorLike = 0.5) -> None:
        self._first, self._second, self._amount = _factors((first, second, amount), "a mixture")
        _inherit(self, (self._first, self._second, self._amount))
        self.wild = True  # an amount beyond 0 to 1 makes colours negative

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the mixture."""
        first = self._first.evaluate(at)
        return first + (self._second.evaluate(at) - first) * self._amount.evaluate(at)


class Clamp(Factor):
    """A factor whose values are clamped to [low, high].

    Parameters
    ----------
    inner
        A factor, or anything that can be used as one.
    low, high
        Limits. Default: 0 and 1.

    Raises
    ------
    SceneError
        If `low` is greater than `high`, or if `inner` cannot be used as a factor.

    Notes
    -----
    Usually written `factor.clamp(low, high)`.

    Examples
    --------
    >>> clamped = pb.looks.Clamp("2 * s", high=1.5)
    >>> round(clamped.evaluate(pb.looks.ShadingContext(fraction=0.9))[0], 3)
    1.5
    """

    @constructor
    def __init__(self, inner: FactorLike, low: Number = 0.0, high: Number = 1.0) -> None:
        least, most = (given_number(each, "a clamp's limit", "a number") for each in (low, high))
        if not least.plain <= most.plain:
            text = f"a factor is clamped to {shown(low)} to {shown(high)}: expected low to be at most high"
            raise SceneError(text)
        self._inner, self._low, self._high = factor(inner), least.value, most.value
        _inherit(self, (self._inner,))
        self.wild = self._inner.wild or bool(least.plain < 0)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the clamped values."""
        return dr.minimum(dr.maximum(self._inner.evaluate(at), self._low), self._high)


class Decay(Factor):
    """A factor exp(exponent). Subclasses implement `exponent`."""

    def exponent(self, at: ShadingContext) -> Value:
        """Return the exponent, which is usually 0 or less."""
        raise SceneError(f"{type(self).__name__} has no method exponent(self, at): expected one that returns it")

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the exponential."""
        return dr.exp(self.exponent(at))

    def split(self, at: ShadingContext) -> tuple[Any, Any]:
        """Return 1 and the exponent."""
        return 1.0, self.exponent(at)


class Constant(Factor):
    """A constant number or colour.

    Parameters
    ----------
    value
        One number, or three for a scene-linear colour. Default: 1.

    Raises
    ------
    SceneError
        If the value is neither one nor three finite numbers.

    Examples
    --------
    >>> look = pb.Look(along=pb.looks.Constant([1, 0.8, 0.5]) * pb.looks.Attenuation())
    >>> look.along
    Constant(value=[1, 0.8, 0.5]) * Attenuation()
    """

    @constructor
    def __init__(self, value: Numbers = 1.0) -> None:
        numbers = given_color(value, "a constant factor", "a finite number or three")
        self._value = numbers.value
        self.wild = bool(np.any(numbers.plain < 0))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the constant."""
        return self._value


def factor(value: FactorLike, argument: str = "distance", name: str = "a factor") -> Factor:
    """Return a factor, a number, a colour, an expression's text, or a Python function as a factor."""
    if isinstance(value, Factor):
        return value
    if isinstance(value, type):
        raise SceneError(f"{name} is the class {value.__name__}: expected an instance, {value.__name__}(...)")
    if isinstance(value, str):
        from .patterns import Expression  # a factor itself, as Function is: their modules import this one

        return Expression(value)
    if callable(value):
        from .functions import Function

        return Function(value, argument)
    if getattr(value, "is_profile", False):
        raise SceneError(f"{name} is a profile, {shown(value)}: expected a factor; profiles belong across the beam")
    expected = "a factor, a number, a colour, an expression or a function"
    given(value, name, expected)
    return Constant(value)


def _factors(values: Sequence[FactorLike], name: str) -> tuple[Factor, ...]:
    """Return the parts of a sum or a product as factors."""
    if not isinstance(values, list | tuple) or not values:
        raise SceneError(f"{name} of factors is {shown(values)}: expected a list or tuple of one or more")
    return tuple(factor(each, name=f"a part of {name}") for each in values)


def _inherit(whole: Factor, parts: tuple[Factor, ...]) -> None:
    """Give a factor the corners of its parts, and each flag that any of them has."""
    whole.corners = tuple(corner for each in parts for corner in each.corners)
    for flag in ("rough", "wild", "of_rays"):
        setattr(whole, flag, any(getattr(each, flag) for each in parts))
