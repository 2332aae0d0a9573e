"""View-angle shading: how much of a beam's light turns toward the camera."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..numerics.given import derived, given_number
from .context import ShadingContext
from .described import constructor
from .factors import Factor, Number, Value

_INV_4PI = 0.07957747154594767


def henyey_greenstein(cosine: Any, anisotropy: Any) -> Any:
    """Return the phase function (1 − g²) / (4π (1 + g² − 2 g cos)^1.5) of the scattering angle's cosine."""
    base = 1 + anisotropy * anisotropy - 2 * anisotropy * cosine
    return _INV_4PI * (1 - anisotropy * anisotropy) * dr.rsqrt(base) ** 3


class Scattering(Factor):
    """The physical factor σs · phase(cos θ), Henyey–Greenstein with the medium's anisotropy."""

    def evaluate(self, at: ShadingContext) -> Value:
        """Return scattering coefficient times phase function."""
        return at.medium.scattering * henyey_greenstein(at.cosine, at.medium.anisotropy)


class Isotropic(Factor):
    """σs / 4π from every side: the medium's brightness without its view dependence."""

    def evaluate(self, at: ShadingContext) -> Value:
        """Return a quarter of the scattering coefficient over π."""
        return at.medium.scattering * _INV_4PI


class Glow(Factor):
    """An exaggerated forward glow: σs times (1 − mix) isotropic + mix · Henyey–Greenstein of `anisotropy`.

    `gain` scales the glow alone, so a beam aimed at the lens flares while the others stay as they are.

    Raises
    ------
    SceneError
        An anisotropy that is not −0.99 to 0.99, a mix that is not 0 to 1, a negative gain.
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
        """Return the mixture times the scattering coefficient."""
        lobe = henyey_greenstein(at.cosine, self._anisotropy)
        return at.medium.scattering * dr.fma(self._glow, lobe, self._base)
