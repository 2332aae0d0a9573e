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

import numpy as np
import numpy.typing as npt

from ..quadrature import gauss_legendre
from ..runtime.device import Float
from ..scene import SceneError, shown
from .described import Described, described
from .factors import Factor, FactorLike, Value, factor
from .table import Table

#: Entries of a tabulated profile and of its line projection.
SAMPLES = 1024
#: Quadrature over ρ that normalises profiles.
RULE = gauss_legendre(32)
#: Values of ρ at which profiles are tabulated, evenly over ρ², which needs no square root; shapes are smooth in ρ² or
#: declare their corners.
RADII = np.sqrt(np.linspace(0, 1, SAMPLES))


class Across(Described):
    """Base of the profiles across the beam. Subclasses implement `shape`, at any scale; this class normalises it.

    Attributes
    ----------
    corners
        Values of ρ in [0, 1) where the profile is not smooth: quadrature splits its interval there.
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

    def shape(self, rho: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
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
    def _density(self) -> Table:
        return Table(self.scale * self.shape(RADII))

    @cached_property
    def _line(self) -> Table:
        x = np.linspace(0, 1, SAMPLES)

        def integrand(v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            return self.shape(np.sqrt(x + (1 - x) * v * v))

        with np.errstate(divide="ignore", invalid="ignore"):
            breaks = [np.nan_to_num(np.sqrt(np.clip((c * c - x) / (1 - x), 0, 1))) for c in self.corners]
        pieces = (*breaks, *np.linspace(0, 1, 9)[1:-1].tolist())
        return Table(2 * self.scale * RULE.integrate(integrand, np.zeros_like(x), np.ones_like(x), pieces))

    def __mul__(self, other: FactorLike) -> Modulated:
        return Modulated(self, factor(other))

    __rmul__ = __mul__

    def density(self, rho2: Float) -> Value:
        """Return the normalised disc kernel times R², at `rho2` = ρ² from 0 to 1."""
        return self._density(rho2)

    def line(self, x: Float) -> Value:
        """Return the line projection k1 · R / √(1 − x), at `x` = (u/R)² from 0 to 1."""
        return self._line(x)


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
