"""View-angle shading: how much of a beam's light turns toward the camera."""

from __future__ import annotations

import drjit as dr

from ..numerics.given import derived, given_number
from ..runtime.device import Float
from .context import ShadingContext
from .described import constructor
from .factors import Factor, Number, Value

_INV_4PI = 0.07957747154594767


def henyey_greenstein(cosine: Float, anisotropy: Float) -> Float:
    """Return the phase function (1 − g²) / (4π (1 + g² − 2 g cos)^1.5) of the scattering angle's cosine."""
    base = 1 + anisotropy * anisotropy - 2 * anisotropy * cosine
    return _INV_4PI * (1 - anisotropy * anisotropy) * dr.rsqrt(base) ** 3


class Scattering(Factor):
    """The physical factor σs · p(cos θ): scattering coefficient times phase function; the default of angle.

    Notes
    -----
    The phase function is that of Henyey and Greenstein, p(cos θ) = (1 − g²) / (4π (1 + g² − 2 g cos θ)^1.5), with the
    medium's anisotropy g. θ is the angle between the light's direction and the direction to the camera. The factor
    needs a medium: `estimate` raises SceneError without one.

    References
    ----------
    Henyey, Greenstein, "Diffuse Radiation in the Galaxy" (1941).

    Examples
    --------
    In isotropic fog, 1 / 4π of the scattering coefficient from every side:

    >>> look = pb.Look(angle=pb.looks.Scattering())
    >>> bound = look.bind(pb.Medium(scattering=0.1, anisotropy=0.0), reach=4.0)
    >>> round(bound.angle(cosine=0.5)[0][0], 6)
    0.007958
    """

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the scattering coefficient times the phase function."""
        return at.medium.scattering * henyey_greenstein(at.cosine, at.medium.anisotropy)


class Isotropic(Factor):
    """Equal brightness σs / 4π from every side, whatever the medium's anisotropy.

    Notes
    -----
    The factor needs a medium: `estimate` raises SceneError without one.

    Examples
    --------
    >>> look = pb.Look(angle=pb.looks.Isotropic())
    >>> bound = look.bind(pb.Medium(scattering=0.1, anisotropy=0.9), reach=4.0)
    >>> [round(bound.angle(cosine=each)[0][0], 6) for each in (-1.0, 1.0)]
    [0.007958, 0.007958]
    """

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the scattering coefficient over 4π."""
        return at.medium.scattering * _INV_4PI


class Glow(Factor):
    """A glow: beams that are aimed at the lens flare, and the others are shaded isotropically.

    Parameters
    ----------
    anisotropy
        Mean cosine g of the glow's Henyey–Greenstein lobe, −0.99 to 0.99; nearer to 1 the flare is narrower.
        Default: 0.8.
    mix
        Fraction of the light in the glow, 0 to 1. Default: 0.5.
    gain
        Factor of the glow alone, 0 or more. Default: 1.

    Raises
    ------
    SceneError
        If the anisotropy is not −0.99 to 0.99, if the mix is not 0 to 1, or if the gain is negative.

    Notes
    -----
    The factor is σs · ((1 − mix) / 4π + gain · mix · p(cos θ)), where p is the Henyey–Greenstein phase function of
    `anisotropy`. It needs a medium, whose σs it takes and whose anisotropy it ignores.

    Examples
    --------
    How much brighter is a beam that points into the lens than one that points away?

    >>> bound = pb.Look(angle=pb.looks.Glow(anisotropy=0.8)).bind(pb.Medium(0.1), reach=4.0)
    >>> toward, away = (bound.angle(cosine=each)[0][0] for each in (1.0, -1.0))
    >>> round(toward / away, 1)
    43.3
    """

    @constructor
    def __init__(self, anisotropy: Number = 0.8, mix: Number = 0.5, gain: Number = 1.0) -> None:
        lobe = given_number(anisotropy, "a glow's anisotropy", "a number from -0.99 to 0.99", -0.99, 0.99)
        amount = given_number(mix, "a glow's mix", "a number from 0 to 1", 0, 1)
        factor = given_number(gain, "a glow's gain", "a number that is not negative", 0)
        self._anisotropy = lobe.value
        self._base = derived(lambda each: (1 - each) * _INV_4PI, amount)
        self._glow = derived(lambda each, much: each * much, amount, factor)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the scattering coefficient times the mixture."""
        lobe = henyey_greenstein(at.cosine, self._anisotropy)
        return at.medium.scattering * dr.fma(self._glow, lobe, self._base)
