"""A look: the four factors of a beam."""

from __future__ import annotations

from types import NoneType
from typing import Literal

from ..runtime.digest import ByContent
from ..scene import Medium, arguments, choice, instance
from .across import Across, Modulated
from .along import Attenuation
from .angle import Scattering
from .bound_look import BoundLook, Box
from .context import Fog, LightContext
from .factors import Factor, FactorLike, factor
from .profiles import AcrossLike, Epanechnikov
from .profiles import across as profile_of

#: What a look may do to the surfaces that beams hit.
SURFACES = ("off", "tint")


class Look(ByContent):
    """The appearance of beams: a product of four factors, each of them physical unless it is given.

    Parameters
    ----------
    along
        Colour along the beam, from the light to its end. Factors multiply: `ColorRamp(...) * Attenuation()`.
        Default: `looks.Attenuation()`.
    across
        Profile over the cross-section. A factor that is multiplied to it may depend on any input.
        Default: `looks.Epanechnikov()`.
    eye
        Change toward the camera. Default: `looks.Attenuation()`.
    angle
        View-angle shading. Default: `looks.Scattering()`, the scattering coefficient times the phase function.
    surfaces
        What the look does to surfaces that the beams hit: "off" (the default), nothing; or "tint": the light that they
        reflect is multiplied by `along` at the end of the light path (fraction 1), without `Attenuation`.

    Raises
    ------
    SceneError
        If an argument cannot be used as a factor or as a profile, or if the profile has no light; another word for
        `surfaces`.

    Notes
    -----
    A beam contributes power · along(s) · across(ρ) · eye(t) · angle(θ), where s is the distance from the light, ρ the
    distance from the axis in radii, t the distance to the camera, and θ the angle between the light's direction and
    that to the camera.

    Each factor may be a factor of `photonbeams.looks`, a number, a colour, the text of an expression, or a Python
    function of Dr.Jit arrays. A function of one parameter takes the distance from the light (along), ρ (across), the
    distance to the camera (eye) or the cosine of θ (angle); a function of several parameters takes the inputs that they
    name: see `looks.Function`.

    Numbers may be Dr.Jit arrays with gradients enabled; the result of `estimate` is then attached to them.

    References
    ----------
    Nowrouzezahrai, Johnson, Selle, Lacewell, Kaschalk, Jarosz, "A Programmable System for Artistic Volumetric Lighting"
    (2011).

    Examples
    --------
    >>> ramp = pb.looks.ColorRamp([0, 1], [[1, 0.9, 0.6], [0.8, 0.1, 0]])
    >>> pb.Look(along=ramp * pb.looks.Attenuation(), across=pb.looks.Gaussian(0.4)).across
    Gaussian(width=0.4)
    >>> pb.Look(along="1 - s", eye=1.0)
    Look(along=Expression(text='1 - s'), across=Epanechnikov(), eye=Constant(value=1), angle=Scattering())
    """

    @arguments
    def __init__(
        self,
        along: FactorLike | None = None,
        across: AcrossLike | None = None,
        eye: FactorLike | None = None,
        angle: FactorLike | None = None,
        surfaces: Literal["off", "tint"] = "off",
    ) -> None:
        self.along: Factor = Attenuation() if along is None else factor(along, name="along")
        profile = Epanechnikov() if across is None else profile_of(across)
        self.across: Across = profile.profile if isinstance(profile, Modulated) else profile
        _ = self.across.scale  # raises the error of a profile without light now, not in a kernel
        self.modulation: Factor | None = profile.factor if isinstance(profile, Modulated) else None
        self.eye: Factor = Attenuation() if eye is None else factor(eye, "to_camera", "eye")
        self.angle: Factor = Scattering() if angle is None else factor(angle, "cosine", "angle")
        self.surfaces = choice(surfaces, "surfaces", SURFACES)

    def __repr__(self) -> str:
        across = self.across if self.modulation is None else Modulated(self.across, self.modulation)
        surfaces = "" if self.surfaces == "off" else f", surfaces={self.surfaces!r}"
        return f"Look(along={self.along}, across={across}, eye={self.eye}, angle={self.angle}{surfaces})"

    def bind(
        self,
        medium: Medium | Fog | None,
        reach: float,
        context: LightContext | None = None,
        box: Box = ((-1.0,) * 3, (1.0,) * 3),
    ) -> BoundLook:
        """Return the look in a medium, in the form that estimators evaluate.

        Parameters
        ----------
        medium
            The fog, or None if no factor needs one.
        reach
            Greatest length of the light paths, in scene units.
        context
            What the beams of a light have in common: time, number and space of the light. Default: frame 0, light 0 in
            world space.
        box
            Two opposite corners of the box that contains the beams, in world space. Default: from −1 to 1.

        Raises
        ------
        SceneError
            If a factor needs a medium and there is none, if it is neither a number nor a colour, or if it is not finite
            somewhere.

        Examples
        --------
        >>> bound = pb.Look(along="1 - s").bind(pb.Medium(0.1), reach=4.0)
        >>> round(bound.along(distance=1.0, depth=1.0, fraction=0.25)[0], 3)
        0.75
        """
        instance(medium, "medium", Medium, Fog, NoneType)
        fog = Fog(medium) if isinstance(medium, Medium) else medium
        return BoundLook(self, fog, reach, context, box)
