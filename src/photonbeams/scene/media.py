"""Media."""

from __future__ import annotations

from dataclasses import dataclass

from .checks import BLACK, Color, color, number
from .surfaces import Mesh


@dataclass(frozen=True)
class Medium:
    """A homogeneous fog.

    Attributes
    ----------
    scattering, absorption
        Coefficients σs and σa, per channel and scene unit.
    anisotropy
        Mean cosine g of the Henyey–Greenstein phase function, from −0.99 to 0.99.
    mesh
        The closed surface that the fog fills, or None where it fills the whole space.
    surfaces
        Whether it dims surfaces that are seen through it, and light on its way to them; if not, beams alone feel it.

    Raises
    ------
    SceneError
        Coefficients that are negative, not finite, or neither one number nor three; an anisotropy beyond ±0.99. Numbers
        whose gradients are enabled: a `looks.Fog` has those.
    """

    scattering: Color
    absorption: Color = BLACK
    anisotropy: float = 0.0
    mesh: Mesh | None = None
    surfaces: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "scattering", color(self.scattering, "scattering"))
        object.__setattr__(self, "absorption", color(self.absorption, "absorption"))
        number(self.anisotropy, "anisotropy", -0.99, 0.99)

    @property
    def extinction(self) -> Color:
        """σt = σs + σa, per channel and scene unit."""
        return tuple(s + a for s, a in zip(self.scattering, self.absorption, strict=True))  # type: ignore[return-value]
