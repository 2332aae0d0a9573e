"""A look: the four factors together, and bound to a medium so that estimators can call it."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..arrays import to_float
from ..device import Float
from ..scene import Medium
from .across import Across, Epanechnikov, across
from .along import Attenuation
from .angle import Scattering
from .factors import At, Factor, Fog, factor

_RATE_SAMPLES = 512


class Look:
    """How beams look: a product of four factors, each physical unless given.

    Parameters
    ----------
    along
        Colour along the beam. Physical: `Attenuation()`. Factors multiply: `ColorRamp(...) * Attenuation()`.
    across
        Profile over the cross-section. Default: `Epanechnikov()`.
    eye
        Change toward the camera. Physical: `Attenuation()`.
    angle
        View-angle shading. Physical: `Scattering()`, σs times the phase function.

    Each may be a factor of this package, a number or colour, or a Python function of Dr.Jit arrays: of the distance
    from the light (along), of ρ (across), of the distance to the camera (eye), of the scattering angle's cosine
    (angle).

    Examples
    --------
    >>> import photonbeams as pb
    >>> look = pb.Look(along=pb.ColorRamp([0, 1], [[1, 0.9, 0.6], [0.8, 0.1, 0]]) * pb.Attenuation())
    """

    def __init__(self, along: Any = None, across: Any = None, eye: Any = None, angle: Any = None) -> None:
        self.along: Factor = Attenuation() if along is None else factor(along)
        self.across: Across = _profile(across)
        self.eye: Factor = Attenuation() if eye is None else factor(eye)
        self.angle: Factor = Scattering() if angle is None else factor(angle, "cosine")

    def bind(self, medium: Medium | None, reach: float) -> BoundLook:
        """Return the look in this medium, for beams and rays of at most `reach` scene units."""
        return BoundLook(self, None if medium is None else Fog(medium), reach)


def _profile(value: Any) -> Across:
    return Epanechnikov() if value is None else across(value)


class BoundLook:
    """A look in a medium: what estimators evaluate.

    Attributes
    ----------
    rate_along, rate_fraction, rate_eye
        How fast the factors change: largest slope over largest value, per scene unit of beam, per fraction of the
        beam, and per scene unit of ray. The billboard replaces a factor by its value at one point; these tell over
        which chords it may.
    """

    def __init__(self, look: Look, fog: Fog | None, reach: float) -> None:
        self._look, self._fog = look, fog
        self.corners_fraction = look.along.corners_fraction
        self.corners_distance = look.along.corners_distance
        grid = np.linspace(0, 1, _RATE_SAMPLES)
        distance = to_float(grid * reach)
        moving = self.along(distance, distance, dr.opaque(Float, 0.5))
        by_fraction = self.along(dr.opaque(Float, 0.0), dr.opaque(Float, 0.0), to_float(grid))
        toward = self.eye(distance, distance)
        self.rate_along = dr.opaque(Float, _rate(moving) / reach)
        self.rate_fraction = dr.opaque(Float, _rate(by_fraction))
        self.rate_eye = dr.opaque(Float, _rate(toward) / reach)

    @property
    def profile(self) -> Across:
        """The profile across the beam."""
        return self._look.across

    def along(self, distance: Any, depth: Any, fraction: Any) -> Any:
        """Return the colour at a distance from the light, `depth` of it in the medium."""
        return self._look.along.evaluate(At(distance=distance, depth=depth, fraction=fraction, fog=self._fog))

    def eye(self, distance: Any, depth: Any) -> Any:
        """Return the change over a distance to the camera, `depth` of it in the medium."""
        return self._look.eye.evaluate(At(distance=distance, depth=depth, fog=self._fog))

    def path(self, distance: Any, depth: Any, fraction: Any, reach: Any, reach_depth: Any) -> Any:
        """Return along · eye: at a distance from the light, seen over the distance `reach`."""
        look, fog = self._look, self._fog
        along, fading = look.along.split(At(distance=distance, depth=depth, fraction=fraction, fog=fog))
        eye, dimming = look.eye.split(At(distance=reach, depth=reach_depth, fog=fog))
        return along * eye * dr.exp(fading + dimming)

    def angle(self, cosine: Any) -> Any:
        """Return the view-angle shading for the cosine between the light's direction and that to the camera."""
        return self._look.angle.evaluate(At(cosine=cosine, fog=self._fog))


def _rate(value: Any) -> float:
    """Return the largest slope over the unit interval, relative to the largest value."""
    samples = np.asarray(dr.zeros(Float, _RATE_SAMPLES) + value, dtype=np.float64)
    slope = np.abs(np.diff(samples, axis=-1)).max(initial=0.0) * (_RATE_SAMPLES - 1)
    peak = np.abs(samples).max(initial=0.0)
    return float(slope / peak) if np.isfinite(slope) and peak > 0 else 0.0
