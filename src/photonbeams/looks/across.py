"""Profiles across the beam: the profile over the cross-section, and its line projection.

A profile is a disc kernel k2(ρ, R) = density(ρ²) / R² with ∫ density · 2πρ dρ = 1 over [0, 1]. As a flat billboard, a
beam has the kernel k1 of *the same* profile, its Abel transform (theory of Jarosz et al. 2011, checked in the tests);
otherwise the picture would pop where one estimate hands over to the other:

    k1(u, R) = (2/R) ∫_{u/R}^1 density ρ / √(ρ² − (u/R)²) dρ = √(1 − x) line(x) / R,   x = (u/R)²
    line(x) = 2 ∫_0^1 density(x + (1 − x) v²) dv                    (ρ² = x + (1 − x) v²)

The square root contains all of k1's singular slope at the rim, so `line` is smooth and a table of it is exact enough.
"""

from __future__ import annotations

from functools import cached_property

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..quadrature import Rule, gauss_legendre
from ..runtime.device import Float
from ..scene import Array, SceneError, arguments
from .described import Described, described
from .factors import Factor, FactorLike, Value, factor
from .table import Table

#: Entries of a tabulated profile and of its line projection.
SAMPLES = 1024
#: Quadrature over ρ that normalises profiles.
RULE = gauss_legendre(32)
_SIX, _EIGHT = gauss_legendre(6), gauss_legendre(8)
#: Values of ρ at which profiles are tabulated, in units of their support.
RADII = np.linspace(0, 1, SAMPLES)

# Fraction of a profile's peak below which there is no light.
_DARK = 1e-8
# A profile of which this much is lit is taken as lit everywhere.
_NEARLY_ALL = 0.9
# Error of six points on a piece of a chord that asks for one more ring: relative to the chord's light, but at least to
# a thousandth of the brightest chord's; and relative to that.
_ERROR = 1e-3
_ERROR_OF_BRIGHTEST = 6.5e-4
_DIM = 1e-3
# Distances of those chords from the axis, in units of the support.
_CHORDS = np.linspace(0, 0.99, 23)
_THINNEST = 4e-3  # least distance between rings
_PANELS = 12  # of the sums by eight points that pieces are compared with


class Across(Described):
    """Base of the profiles across the beam. Subclasses implement `shape`, at any scale; this class normalises it.

    Attributes
    ----------
    corners
        Values of ρ in [0, 1) where the profile is not smooth: quadrature splits its interval there if it has to.
    attached
        Whether the profile is attached to the AD graph. Its line projection never is, because derivatives are those of
        the frustum estimator.

    Notes
    -----
    ρ is the distance from the axis in radii. A profile may be multiplied by a factor, a number, a colour, an expression
    or a function; this gives a `Modulated` profile.

    The disc kernel is density(ρ²) / R² with ∫ density · 2πρ dρ = 1 over [0, 1], where R is the beam's radius. The
    billboard estimator uses its line projection (Abel transform) √(1 − x) line(x) / R, x = (u/R)², where u is the
    distance between ray and axis.

    References
    ----------
    Jarosz, Nowrouzezahrai, Sadeghi, Jensen, "A Comprehensive Theory of Volumetric Radiance Estimation using Photon
    Points and Beams" (2011).

    Examples
    --------
    A profile of one's own:

    >>> class Cone(pb.looks.Across):
    ...     def shape(self, rho):
    ...         return 1 - rho
    >>> look = pb.Look(across=Cone())
    >>> round(look.across.scale, 3)  # 3/π
    0.955
    """

    is_profile = True
    corners: tuple[float, ...] = ()
    attached: bool = False

    __array_ufunc__ = None  # NumPy's arrays leave the product to the profile

    def shape(self, rho: Array) -> Array:
        """Return the profile before it is normalised, at `rho` from 0 to 1 (a float64 NumPy array)."""
        raise SceneError(f"{type(self).__name__} has no method shape(self, rho): expected one that returns the profile")

    @cached_property
    def scale(self) -> float:
        """The factor that makes ∫ shape · 2πρ dρ equal 1."""
        total = float(RULE.integrate(lambda rho: self.shape(rho) * 2 * np.pi * rho, 0.0, 1.0, self.fine_breaks))
        if not np.isfinite(total) or total <= 0:
            raise SceneError("a profile across the beam has no light: expected finite values with a positive sum")
        return 1 / total

    @property
    def fine_breaks(self) -> tuple[float, ...]:
        """Values of ρ at which quadrature over the profile splits its interval."""
        return (*self.corners, *np.linspace(0, 1, 17)[1:-1].tolist())

    @cached_property
    def support(self) -> float:
        """The ρ beyond which the profile is dark. Chords end there, and so do tables."""
        rho = np.linspace(0, 1, 4 * SAMPLES + 1)
        values = self.shape(rho)
        last = np.flatnonzero(values > _DARK * values.max()).max(initial=0) + 1
        return float(rho[last]) if last < _NEARLY_ALL * len(rho) else 1.0

    @cached_property
    def edge(self) -> Float | float:
        """The support in a kernel: an input of it, but for a profile that is lit everywhere."""
        return 1.0 if self.support == 1 else opaque(self.support)

    @cached_property
    def rings(self) -> tuple[float, ...]:
        """Values of ρ that cut chords into pieces on which six points are accurate; a ring of 0 cuts them at the axis.

        From the axis outward, each ring is the farthest for which the rule errs by little, or a corner before it.
        """
        kinks = [each for each in self.corners if 0 < each < self.support]
        bound, rings, low = self._tolerated(), list[float](), 0.0
        axis = 0.0 in self.corners and bool(np.any(self._error(0.0, self.support, False) > bound))
        # Errors of several pieces add up: the last may err more than others, and a chord that is not cut most.
        while np.any(self._error(low, self.support, axis) > (2 if rings else 3) * bound):
            near, far = low, self.support
            while far - near > _THINNEST:
                middle = (near + far) / 2
                fits = np.all(self._error(low, middle, axis) <= bound)
                near, far = (middle, far) if fits else (near, middle)
            low = max((each for each in kinks if low < each <= far), default=far)
            rings.append(low)
        return (*([0.0] if axis else []), *rings)

    def _tolerated(self) -> Array:
        """Return the error that a piece of each of the chords may have."""
        ends = self._half(self.support)
        light = 2 * self._summed(_EIGHT, np.zeros_like(ends), ends)
        return np.clip(_ERROR * light, _ERROR * _DIM * light.max(), _ERROR_OF_BRIGHTEST * light.max())

    def _error(self, low: float, high: float, axis: bool) -> Array:
        """Return by how much six points err between two rings, for each of the chords."""
        inner, outer = self._half(low), self._half(high)
        whole = (inner == 0) & (not axis)  # from one side of the ring to the other
        begin = np.where(whole, -outer, inner)
        exact = self._summed(_EIGHT, inner, outer) * np.where(whole, 2, 1)
        points = self._summed(_SIX, begin, outer, panels=1)
        return np.abs(points - exact) * np.where(whole, 1, 2)

    def _half(self, ring: float) -> Array:
        """Return half the length of the chords within a ring."""
        return np.sqrt(np.maximum(ring**2 - (_CHORDS * self.support) ** 2, 0))

    def _summed(self, rule: Rule, begin: Array, end: Array, panels: int = _PANELS) -> Array:
        """Return the profile's integral over pieces of the chords, from `begin` to `end` after their middles."""
        square, breaks = (_CHORDS * self.support) ** 2, np.linspace(begin, end, panels + 1)[1:-1]

        def shape(tau: Array) -> Array:
            return self.shape(np.sqrt(np.minimum(square + tau * tau, 1)))

        return np.asarray(rule.integrate(shape, begin, end, breaks))

    @cached_property
    def _density(self) -> Table:
        return Table(self.scale * self._within(self.shape(RADII * self.support)))

    @cached_property
    def _line(self) -> Table:
        x = (RADII * self.support) ** 2

        def integrand(v: Array) -> Array:
            return self.shape(np.sqrt(x + (1 - x) * v * v))

        with np.errstate(divide="ignore", invalid="ignore"):
            kinks = (*self.corners, *self.rings, self.support)
            breaks = [np.nan_to_num(np.sqrt(np.clip((c * c - x) / (1 - x), 0, 1))) for c in kinks]
        pieces = (*breaks, *np.linspace(0, 1, 9)[1:-1].tolist())
        line = RULE.integrate(integrand, np.zeros_like(x), np.ones_like(x), pieces)
        return Table(self._within(2 * self.scale * line))

    def _within(self, values: Array) -> Array:
        """Return values up to the support, dark from there on."""
        return values if self.support == 1 else np.append(values[:-1], 0.0)

    def __mul__(self, other: FactorLike) -> Modulated:
        return Modulated(self, factor(other))

    __rmul__ = __mul__

    def density(self, rho2: Float) -> Value:
        """Return the normalised disc kernel times R², at `rho2` = ρ² from 0 to 1."""
        return self._density(self._place(rho2))

    def line(self, x: Float) -> Value:
        """Return the line projection k1 · R / √(1 − x), at `x` = (u/R)² from 0 to 1."""
        return self._line(self._place(x))

    def _place(self, rho2: Float) -> Float:
        """Return ρ in units of the support; away from 0, where the root has no derivative."""
        rho = dr.sqrt(dr.maximum(rho2, 1e-12))
        return rho if self.support == 1 else rho * dr.rcp(self.edge)


class Modulated(Described):
    """A profile times a factor that changes it from place to place, such as colours by radius, noise or an expression.

    Parameters
    ----------
    profile
        The profile, which is normalised.
    factor
        The factor. Its product with the profile is not normalised: where the factor is 1, the profile is unchanged.

    Raises
    ------
    SceneError
        If `profile` is not an `Across`, or if `factor` is not a `Factor`.

    Notes
    -----
    Usually written as a product, `profile * factor`.

    Examples
    --------
    White inside, violet at the rim:

    >>> ramp = pb.looks.ColorRamp([0, 1], [[1, 1, 1], [0.5, 0.2, 1]], space="radius")
    >>> look = pb.Look(across=pb.looks.Biweight() * ramp)
    >>> look.across, look.modulation is ramp
    (Biweight(), True)
    """

    is_profile = True
    __array_ufunc__ = None

    @arguments
    def __init__(self, profile: Across, factor: Factor) -> None:
        self.profile, self.factor = profile, factor

    def __mul__(self, other: FactorLike) -> Modulated:
        return Modulated(self.profile, self.factor * factor(other))

    __rmul__ = __mul__

    def __repr__(self) -> str:
        return f"{self.profile} * {described(self.factor)}"
