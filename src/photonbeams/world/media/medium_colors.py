"""Fog by two colours: the fog and the power with which a beam shows two given colours, and the inverse.

An artist names the colour C0 that a beam shows where it begins, the colour C1 one unit along it, the fog's albedo a and
the distance D from which it is seen. With the attenuation of fog along the beam and towards the eye (Nowrouzezahrai et
al. 2011, *A Programmable System for Artistic Volumetric Lighting*):

    σt = ln(C0 / C1),   σs = a σt,   Φ = C0 (C0 / C1)^D / σs · 1 / (p k1)

The published formula lacks the last factor. With it, the colours are radiances, the numbers of a picture: the middle of
a beam of radius R and the physical look, seen square from the side (θ = 90°), has the radiance
Φ σs p k1 · exp(−σt s) · exp(−σt D). Here p is the phase function at 90°, which is 1/4π in isotropic fog, and k1 is the
profile's line projection, which is 8/(3π R) for the default profile.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...scene import Array, Color, Medium, SceneError, arguments, color, number

if TYPE_CHECKING:
    from ...looks import Across

Colors = float | Sequence[float] | Array

# Bounds of the far colour, as fractions of the near one. Below, no beam would be visible; and where no light is lost,
# none is scattered, so that no power would suffice.
DARKEST, BRIGHTEST = 0.1, 0.999

_LARGEST = 1e30  # of a power: kernels multiply in single precision, which ends at 3e38


@arguments
def medium_of_colors(
    near: Colors,
    far: Colors,
    *,
    albedo: Colors = 1.0,
    distance: float = 0.0,
    far_distance: float = 1.0,
    radius: float = 1.0,
    anisotropy: float = 0.0,
    across: Across | None = None,
) -> tuple[Medium, Color]:
    """Return the fog and the power with which a beam shows two given colours.

    Parameters
    ----------
    near, far
        Scene-linear radiances, one number or three, of the beam's axis at its beginning and at `far_distance` from
        there. Each channel of `far` is clamped to 0.1 to 0.999 of `near`. In a channel where `near` is black, the fog
        has the mean extinction of the other channels, and the beam has no power.
    albedo
        Fraction of the lost light that is scattered, σs / σt, above 0 and up to 1; one number or three. Default: 1.
    distance
        Scene units of fog between the beam and the camera. Default: 0.
    far_distance
        Distance along the beam from its beginning to the point where it is `far`, in scene units. Default: 1.
    radius
        Radius of the beam in scene units. For a shaft of many parallel beams, give the shaft's radius and the profile
        `looks.Uniform()`. Default: 1.
    anisotropy
        Mean cosine g of the fog's phase function, −0.99 to 0.99. Default: 0.
    across
        Profile of the beam. Default: that of the default look, `looks.Epanechnikov()`.

    Returns
    -------
    medium
        The fog.
    power
        The beam's RGB flux Φ.

    Raises
    ------
    SceneError
        If a number is out of range, if `near` is black, if `across` depends on more than the radius, or if the fog over
        `distance` is so dense that the power would be too large to render.

    Notes
    -----
    With C0 = near, C1 = far and D = distance (Nowrouzezahrai et al.), for a far distance of 1:

        σt = ln(C0 / C1),   σs = albedo · σt,   Φ = C0 (C0 / C1)^D / σs · 1 / (p k1)

    The published formula ends before the last factor. With it, the colours are radiances of the picture: those of a
    beam with the physical look, seen square from the side (θ = 90°). p is the phase function at 90°, and k1 the
    profile's line projection, 8 / (3π radius) for the default profile.

    References
    ----------
    Nowrouzezahrai, Johnson, Selle, Lacewell, Kaschalk, Jarosz, "A Programmable System for Artistic Volumetric Lighting"
    (2011).

    Examples
    --------
    >>> medium, power = pb.medium_of_colors((1.0, 0.8, 0.5), (0.6, 0.4, 0.2), albedo=0.9, distance=3.0, radius=0.1)
    >>> [round(channel, 3) for channel in medium.extinction]  # ln(near / far)
    [0.511, 0.693, 0.916]
    >>> near, far = pb.colors_of_medium(medium, power, distance=3.0, radius=0.1)
    >>> [round(channel, 3) for channel in far]
    [0.6, 0.4, 0.2]
    """
    number(distance, "distance", minimum=0.0)
    scattering, absorption = coefficients(near, far, albedo, far_distance)
    medium = Medium(scattering, absorption, anisotropy)
    with np.errstate(over="ignore"):
        reaching = np.asarray(scattering) * np.exp(-np.asarray(medium.extinction) * distance)
        power = np.asarray(color(near, "near")) / np.maximum(reaching, 1e-300) / _side(medium, radius, across)
    if not np.all(power <= _LARGEST):
        text = f"distance is {distance:g}: expected less, because nothing is visible through that much fog"
        raise SceneError(text)
    return medium, color(power, "power")


@arguments
def colors_of_medium(
    medium: Medium,
    power: Colors,
    distance: float = 0.0,
    *,
    far_distance: float = 1.0,
    radius: float = 1.0,
    across: Across | None = None,
) -> tuple[Color, Color]:
    """Return the two colours of a beam in a fog: the inverse of `medium_of_colors`.

    Parameters
    ----------
    medium
        The fog.
    power
        The beam's flux Φ, one number or three.
    distance
        Scene units of fog between the beam and the camera. Default: 0.
    far_distance
        Distance along the beam from its beginning to the point of the second colour, in scene units. Default: 1.
    radius
        Radius of the beam in scene units. Default: 1.
    across
        Profile of the beam. Default: that of the default look, `looks.Epanechnikov()`.

    Returns
    -------
    near, far
        Scene-linear radiances of the beam's axis at its beginning and at `far_distance` from there, seen square from
        the side with the physical look.

    Raises
    ------
    SceneError
        If a number is out of range, or if `across` depends on more than the radius.

    Notes
    -----
    near = Φ σs p k1 exp(−σt · distance) and far = near · exp(−σt · far_distance), with the phase function p at 90° and
    the profile's line projection k1: see `medium_of_colors`.

    References
    ----------
    Nowrouzezahrai, Johnson, Selle, Lacewell, Kaschalk, Jarosz, "A Programmable System for Artistic Volumetric Lighting"
    (2011).

    Examples
    --------
    >>> near, far = pb.colors_of_medium(pb.Medium(scattering=0.2), power=9.0, radius=0.1)
    >>> round(near[0], 3), round(far[0], 3)
    (1.216, 0.995)
    """
    number(distance, "distance", minimum=0.0)
    number(far_distance, "far distance", minimum=0.0)
    extinction = np.asarray(medium.extinction)
    seen = np.asarray(color(power, "power")) * np.asarray(medium.scattering) * _side(medium, radius, across)
    near = seen * np.exp(-extinction * distance)
    return color(near, "near"), color(near * np.exp(-extinction * far_distance), "far")


def coefficients(near: Colors, far: Colors, albedo: Colors = 1.0, far_distance: float = 1.0) -> tuple[Color, Color]:
    """Return the scattering and the absorption of the fog that takes a beam from one colour to another.

    Arguments and errors are those of `medium_of_colors`.
    """
    begin, end, scattered = (
        np.asarray(color(value, name)) for value, name in ((near, "near"), (far, "far"), (albedo, "albedo"))
    )
    number(far_distance, "far distance", minimum=1e-12)
    if not np.any(begin > 0):
        raise SceneError(f"near is {near}: expected a colour that is not black")
    if not np.all((scattered > 0) & (scattered <= 1)):
        raise SceneError(f"albedo is {albedo}: expected one or three numbers above 0 and no more than 1")
    lit = begin > 0
    kept = np.clip(end[lit] / begin[lit], DARKEST, BRIGHTEST)
    extinction = np.full(3, -np.log(kept).mean() / far_distance)
    extinction[lit] = -np.log(kept) / far_distance
    return color(scattered * extinction, "scattering"), color((1 - scattered) * extinction, "absorption")


def _side(medium: Medium, radius: float, across: Across | None) -> float:
    """Return p k1: the side-on radiance of the middle of a beam that scatters one unit of flux per scene unit."""
    from ...looks import Epanechnikov, Modulated
    from ...looks.profiles import across as profile_of
    from ...quadrature import gauss_legendre

    if not number(radius, "radius") > 0:
        raise SceneError(f"radius is {radius}: expected a number above 0")
    try:
        profile = profile_of(Epanechnikov() if across is None else across)
    except ValueError as error:
        raise SceneError(f"across is {across!r}: {error}") from None
    if isinstance(profile, Modulated):
        raise SceneError("across depends on more than the radius: expected a profile of the radius alone")
    breaks = (*profile.corners, *np.linspace(0, 1, 17)[1:-1])
    line = 2 * profile.scale * float(gauss_legendre(16).integrate(profile.shape, 0.0, 1.0, breaks))
    phase = (1 - medium.anisotropy**2) / (4 * np.pi * (1 + medium.anisotropy**2) ** 1.5)
    return phase * line / radius
