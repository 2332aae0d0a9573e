"""The four programmable factors of a beam's look (Nowrouzezahrai et al. 2011, "Art"), and how they compose.

    contribution = power · along(s) · across(ρ) · eye(t) · angle(θ)

A factor takes a `ShadingContext` and returns a number or a colour. Everything is written for Dr.Jit arrays of any
precision; parameters are opaque, so that changing one does not compile a kernel anew.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, Union

import drjit as dr
import numpy as np

from ..numerics.given import Number, Numbers, given, given_color, given_number
from ..runtime.device import Array3f, Float
from ..scene import SceneError, arguments, shown
from .context import INPUTS, ShadingContext
from .described import Described, constructor, described

#: Where the integrand has a corner: the name of an input ("fraction", "distance", "eye", "radius") and its value there.
Corner: TypeAlias = tuple[str, float]

#: What kernels compute: a Dr.Jit number, or a colour, for each lane.
Value: TypeAlias = Union["Float", "Array3f"]
#: What stands for a factor: a factor, a number or a colour, an expression's text, or a Python function.
FactorLike: TypeAlias = Union["Factor", Numbers, str, Callable[..., Any]]


class Factor(Described):
    """One of along, eye and angle, or what modulates a profile. Subclasses answer `evaluate`.

    Factors multiply and add, with each other, with numbers and with colours; see `mix` and `clamp`. Of a Dr.Jit array
    and a factor the factor comes first.
    """

    # NumPy's arrays leave the product to the factor, rather than make one of each of their entries.
    __array_ufunc__ = None

    #: Where the factor has corners: quadrature splits its interval there.
    corners: tuple[Corner, ...] = ()
    #: Whether nobody knows its corners: quadrature takes finer steps.
    rough: bool = False
    #: Whether it may be negative or not finite.
    wild: bool = False
    #: Whether it knows of each ray what others do not, as what was sampled along it.
    of_rays: bool = False

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the factor's value: a Float, or an Array3f."""
        raise NotImplementedError

    def split(self, at: ShadingContext) -> tuple[Any, Any]:
        """Return (value, exponent) with the factor equal to value · exp(exponent).

        The exponents of a look are summed before one exponential is taken of them: it is the dearest step of all.
        """
        return self.evaluate(at), 0.0

    def __mul__(self, other: FactorLike) -> Factor:
        if getattr(other, "is_profile", False):
            return NotImplemented  # for the profile's own product
        return Product((self, factor(other)))

    __rmul__ = __mul__

    def __add__(self, other: FactorLike) -> Factor:
        return Sum((self, factor(other)))

    __radd__ = __add__

    def mix(self, other: FactorLike, amount: FactorLike = 0.5) -> Factor:
        """Return self · (1 − amount) + other · amount; the amount is a number or a factor itself."""
        return Mix(self, factor(other), factor(amount))

    def clamp(self, low: Number = 0.0, high: Number = 1.0) -> Factor:
        """Return the factor with its values clamped to [low, high]."""
        return Clamp(self, low, high)


class Product(Factor):
    """The product of factors, as the Talk multiplies a colour texture by physical attenuation."""

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
    """The sum of factors."""

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
    """first · (1 − amount) + second · amount."""

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
    """A factor's values, clamped to [low, high].

    Raises
    ------
    SceneError
        A range that does not ascend.
    """

    @constructor
    def __init__(self, inner: FactorLike, low: Number = 0.0, high: Number = 1.0) -> None:
        least, most = (given_number(each, "a clamp's limit", "a number") for each in (low, high))
        if not least.plain <= most.plain:
            text = f"a factor is clamped to {shown(low)} to {shown(high)}: expected a range that ascends"
            raise SceneError(text)
        self._inner, self._low, self._high = factor(inner), least.value, most.value
        _inherit(self, (self._inner,))
        self.wild = self._inner.wild or bool(least.plain < 0)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the clamped values."""
        return dr.minimum(dr.maximum(self._inner.evaluate(at), self._low), self._high)


class Decay(Factor):
    """A factor exp(exponent). Subclasses answer `exponent`."""

    def exponent(self, at: ShadingContext) -> Value:
        """Return the exponent, not above 0 in what is not an artist's whim."""
        raise NotImplementedError

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the exponential."""
        return dr.exp(self.exponent(at))

    def split(self, at: ShadingContext) -> tuple[Any, Any]:
        """Return 1 and the exponent."""
        return 1.0, self.exponent(at)


class Constant(Factor):
    """The same value everywhere: a number or a colour.

    Raises
    ------
    SceneError
        No number, nor three, or one that is not finite.
    """

    @constructor
    def __init__(self, value: Numbers = 1.0) -> None:
        numbers = given_color(value, "a constant factor", "a finite number or three")
        self._value = numbers.value
        self.wild = bool(np.any(numbers.plain < 0))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the constant."""
        return self._value


class Function(Factor):
    """Any Python function of Dr.Jit arrays, traced into the kernel.

    A function of one parameter gets the factor's own input, `argument`; one of several gets the inputs that its
    parameters name (`INPUTS`: s, distance, r, t, angle, cosine, P, Pl, time, frame, random, id, light, generation); a
    parameter of the name `at` gets the `ShadingContext` itself. Numbers that the function closes over become part of
    the kernel: make them `drjit.opaque(...)` values where they change from frame to frame.
    """

    rough = wild = True

    @arguments
    def __init__(self, function: Callable[..., Any], argument: str = "distance") -> None:
        if not callable(function) or isinstance(function, type):
            raise SceneError(f"a look's function is {shown(function)}: expected a Python function")
        if not hasattr(ShadingContext, argument):
            raise SceneError(f"a function's argument is {shown(argument)}: expected an attribute of ShadingContext")
        self._function, self.arguments = function, _arguments(function, argument)

    def __repr__(self) -> str:
        return f"Function({described(self._function)})"

    def evaluate(self, at: ShadingContext) -> Value:
        """Call the function."""
        return self.called(*(at if each == "at" else getattr(at, each) for each in self.arguments))

    def called(self, *given: Any) -> Any:
        """Return the function's value for these inputs; SceneError where it fails, or returns no colour."""
        name = getattr(self._function, "__name__", "function")
        try:
            value = self._function(*given)
        except (Exception, SystemExit) as error:
            raise SceneError(f"the look's function {name} failed: {error}") from error
        if not _is_colour(value):
            kind = type(value).__name__
            raise SceneError(f"the look's function {name} returns a {kind}: expected a Float, an Array3f or a number")
        count = max((dr.width(each) for each in given if dr.is_array_v(each)), default=0)
        if count and dr.width(value) not in (1, count):
            text = f"returns {dr.width(value)} values for {count}: expected one for each, or one"
            raise SceneError(f"the look's function {name} {text}")
        double = [dr.type_v(each) == dr.VarType.Float64 for each in (value, *given) if dr.is_array_v(each)]
        if any(double) and dr.is_array_v(value) and not all(double):  # loops keep one precision
            return Array3f(value) if dr.size_v(value) == 3 else Float(value)
        return value


def _is_colour(value: Any) -> bool:
    if dr.is_array_v(value):
        return bool(dr.depth_v(value) == 1 and dr.size_v(value) != 3) or bool(dr.size_v(value) == 3)
    return isinstance(value, int | float | np.number)


# Inputs that give their name to a function's only parameter; s, r and t are taken for any name of the factor's own.
_SPEAKING = frozenset(INPUTS) - {"s", "r", "t"}


def _arguments(function: Callable[..., Any], own: str) -> list[str]:
    """Return the attributes of a ShadingContext that a function's parameters name."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # as of some built-in functions
        return [own]
    names = [
        p.name for p in parameters if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    if names == ["at"]:
        return names
    if len(names) < 2:
        return [INPUTS[name] if name in _SPEAKING else own for name in names] or [own]
    unknown = [name for name in names if name not in INPUTS and name != "at"]
    if unknown:
        raise SceneError(f"a look's function has a parameter {unknown[0]!r}: expected one of {', '.join(INPUTS)}, at")
    return [INPUTS.get(name, name) for name in names]


def factor(value: FactorLike, argument: str = "distance", name: str = "a factor") -> Factor:
    """Return `value` as a factor: a Factor, a number, a colour, an expression's text, or a Python function."""
    if isinstance(value, Factor):
        return value
    if isinstance(value, type):
        raise SceneError(f"{name} is the class {value.__name__}: expected one of it, {value.__name__}(...)")
    if isinstance(value, str):
        from .patterns import Expression  # which is a factor itself

        return Expression(value)
    if callable(value):
        return Function(value, argument)
    if getattr(value, "is_profile", False):
        raise SceneError(f"{name} is a profile, {shown(value)}: expected a factor, for profiles belong across the beam")
    expected = "a factor, a number, a colour, an expression or a function"
    given(value, name, expected)
    return Constant(value)


def _factors(values: Sequence[FactorLike], name: str) -> tuple[Factor, ...]:
    """Return the parts of a sum or a product as factors."""
    if not isinstance(values, list | tuple) or not values:
        raise SceneError(f"{name} of factors is {shown(values)}: expected a list or a tuple of one or more")
    return tuple(factor(each, name=f"a part of {name}") for each in values)


def _inherit(whole: Factor, parts: tuple[Factor, ...]) -> None:
    """Give a factor the corners of its parts, and each flag that any of them has."""
    whole.corners = tuple(corner for each in parts for corner in each.corners)
    for flag in ("rough", "wild", "of_rays"):
        setattr(whole, flag, any(getattr(each, flag) for each in parts))
