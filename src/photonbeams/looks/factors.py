"""The four programmable factors of a beam's look (Nowrouzezahrai et al. 2011, "Art"), and how they compose.

    contribution = power · along(s) · across(ρ) · eye(t) · angle(θ)

A factor sees where it is evaluated (`At`) and answers a number or a colour. Everything is written for Dr.Jit arrays of
any precision; parameters are opaque, so that changing one does not compile a kernel anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..device import Array3f, Float
from ..scene import Medium


class Fog:
    """The coefficients of a `Medium` as opaque Dr.Jit values."""

    def __init__(self, medium: Medium) -> None:
        self.extinction = dr.opaque(Array3f, list(medium.extinction))
        self.scattering = dr.opaque(Array3f, list(medium.scattering))
        self.anisotropy = dr.opaque(Float, medium.anisotropy)


@dataclass(frozen=True)
class At:
    """Where a factor is evaluated.

    Attributes
    ----------
    distance
        Scene units: from the light (along) or from the camera (eye).
    depth
        The part of `distance` that lies in the medium.
    fraction
        `distance` over the length of the light's whole path, 0 to 1 (along).
    cosine
        Cosine between the direction of the light and the direction toward the camera (angle): 1 is straight into
        the lens.
    fog
        The medium, or None where there is none.
    """

    distance: Any = 0.0
    depth: Any = 0.0
    fraction: Any = 0.0
    cosine: Any = 0.0
    fog: Fog | None = None

    @property
    def medium(self) -> Fog:
        """The fog; raises ValueError where a physical factor meets no medium."""
        if self.fog is None:
            raise ValueError("this look has a physical factor: give estimate() a medium, or set along, eye and angle")
        return self.fog


class Factor:
    """One of along, eye and angle. Subclasses answer `evaluate`; factors multiply with each other and with numbers."""

    #: Positions of corners, in units of fraction or distance: quadrature splits its interval there.
    corners_fraction: tuple[float, ...] = ()
    corners_distance: tuple[float, ...] = ()

    def evaluate(self, at: At) -> Any:
        """Return the factor's value: a Float, or an Array3f."""
        raise NotImplementedError

    def split(self, at: At) -> tuple[Any, Any]:
        """Return (value, exponent) with the factor equal to value · exp(exponent).

        The exponents of a look are summed before one exponential is taken of them: it is the dearest step of all.
        """
        return self.evaluate(at), 0.0

    def __mul__(self, other: Any) -> Factor:
        return Product((self, factor(other)))

    __rmul__ = __mul__


class Product(Factor):
    """The product of factors, as the Talk multiplies a colour texture by physical attenuation."""

    def __init__(self, factors: tuple[Factor, ...]) -> None:
        flat = [inner for each in factors for inner in (each.factors if isinstance(each, Product) else (each,))]
        self.factors: tuple[Factor, ...] = tuple(flat)
        self.corners_fraction = tuple(c for each in self.factors for c in each.corners_fraction)
        self.corners_distance = tuple(c for each in self.factors for c in each.corners_distance)

    def evaluate(self, at: At) -> Any:
        """Return the product of the factors' values."""
        value, exponent = self.split(at)
        return value * dr.exp(exponent)

    def split(self, at: At) -> tuple[Any, Any]:
        """Return the product of the values and the sum of the exponents."""
        value, exponent = self.factors[0].split(at)
        for each in self.factors[1:]:
            more, further = each.split(at)
            value, exponent = value * more, exponent + further
        return value, exponent


class Decay(Factor):
    """A factor exp(exponent). Subclasses answer `exponent`."""

    def exponent(self, at: At) -> Any:
        """Return the exponent, not above 0 in what is not an artist's whim."""
        raise NotImplementedError

    def evaluate(self, at: At) -> Any:
        """Return the exponential."""
        return dr.exp(self.exponent(at))

    def split(self, at: At) -> tuple[Any, Any]:
        """Return 1 and the exponent."""
        return 1.0, self.exponent(at)


class Constant(Factor):
    """The same value everywhere: a number or a colour."""

    def __init__(self, value: Any = 1.0) -> None:
        numbers = np.asarray(value, dtype=np.float64)
        if numbers.shape not in ((), (3,)) or not np.all(np.isfinite(numbers)):
            raise ValueError(f"a constant factor is {value}: expected a finite number or three")
        self._value = dr.opaque(Array3f, numbers.tolist()) if numbers.shape else dr.opaque(Float, float(numbers))

    def evaluate(self, at: At) -> Any:
        """Return the constant."""
        return self._value


class Function(Factor):
    """Any Python function of Dr.Jit arrays: of the distance (along, eye) or of the cosine (angle).

    It is traced into the kernel. Numbers that it closes over become part of the kernel: make them
    `drjit.opaque(...)` values where they change from frame to frame.
    """

    def __init__(self, function: Callable[[Any], Any], argument: str = "distance") -> None:
        self._function, self._argument = function, argument

    def evaluate(self, at: At) -> Any:
        """Call the function."""
        return self._function(getattr(at, self._argument))


def factor(value: Any, argument: str = "distance") -> Factor:
    """Return `value` as a factor: a Factor, a number, a colour, or a Python function of `argument`."""
    if isinstance(value, Factor):
        return value
    if callable(value):
        return Function(value, argument)
    return Constant(value)
