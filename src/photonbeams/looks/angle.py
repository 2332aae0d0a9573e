"""View-angle shading: how much of a beam's light turns toward the camera."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..runtime.device import Float
from .at import At
from .factors import Factor

_INV_4PI = 0.07957747154594767


def henyey_greenstein(cosine: Any, anisotropy: Any) -> Any:
    """Return the phase function (1 − g²) / (4π (1 + g² − 2 g cos)^1.5) of the scattering angle's cosine."""
    base = 1 + anisotropy * anisotropy - 2 * anisotropy * cosine
    return _INV_4PI * (1 - anisotropy * anisotropy) * dr.rsqrt(base) ** 3


class Scattering(Factor):
    """The physical factor σs · phase(cos θ), Henyey–Greenstein with the medium's anisotropy."""

    def evaluate(self, at: At) -> Any:
        """Return scattering coefficient times phase function."""
        return at.medium.scattering * henyey_greenstein(at.cosine, at.medium.anisotropy)


class Isotropic(Factor):
    """σs / 4π from every side: the medium's brightness without its view dependence."""

    def evaluate(self, at: At) -> Any:
        """Return a quarter of the scattering coefficient over π."""
        return at.medium.scattering * _INV_4PI


class Glow(Factor):
    """An exaggerated forward glow: σs times (1 − mix) isotropic + mix · Henyey–Greenstein of `anisotropy`.

    `gain` scales the glow alone, so a beam aimed at the lens flares while the others stay as they are.

    Raises
    ------
    ValueError
        An anisotropy that is not −0.99 to 0.99, a mix that is not 0 to 1, a negative gain.
    """

    def __init__(self, anisotropy: float = 0.8, mix: float = 0.5, gain: float = 1.0) -> None:
        if not -0.99 <= anisotropy <= 0.99:
            raise ValueError(f"a glow's anisotropy is {anisotropy}: expected a number from -0.99 to 0.99")
        if not 0 <= mix <= 1 or not gain >= 0:
            raise ValueError(f"a glow has mix {mix} and gain {gain}: expected 0 to 1, and not negative")
        self._anisotropy = dr.opaque(Float, anisotropy)
        self._base, self._glow = dr.opaque(Float, (1 - mix) * _INV_4PI), dr.opaque(Float, mix * gain)

    def evaluate(self, at: At) -> Any:
        """Return the mixture times the scattering coefficient."""
        lobe = henyey_greenstein(at.cosine, self._anisotropy)
        return at.medium.scattering * dr.fma(self._glow, lobe, self._base)
