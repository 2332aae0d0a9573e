"""The shading context of looks: everything that their factors may ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque
from ..numerics.given import Number, Numbers, derived, given_color, given_number
from ..runtime.device import Array3f, Float
from ..scene import Array, Medium, SceneError, arguments, color, number, numbers, shown
from .described import Described, constructor
from .vocabulary import NAMES

#: The inputs by the names that expressions and Python functions use: attributes of `ShadingContext`.
INPUTS = {name: each.attribute for name, each in NAMES.items()}

#: Attributes that differ between beams, between places in space, and with the distance from the axis.
OF_BEAMS = frozenset({"random", "id", "generation"})
OF_PLACES = frozenset({"position", "local"})
OF_RADII = frozenset({"radius", "rho2"})


class Fog(Described):
    """The coefficients of a homogeneous medium as Dr.Jit values, whose gradients may be enabled.

    Attributes
    ----------
    extinction, scattering
        Coefficients σt and σs per channel and scene unit.
    anisotropy
        Mean cosine of the phase function.

    Raises
    ------
    SceneError
        What is no `Medium`.

    Examples
    --------
    >>> import drjit as dr
    >>> import photonbeams as pb
    >>> fog = pb.looks.Fog(pb.Medium(0.1, 0.02))
    >>> dr.enable_grad(fog.extinction)
    """

    extinction: Array3f
    scattering: Array3f
    anisotropy: Float

    @constructor
    def __init__(self, medium: Medium) -> None:
        if not isinstance(medium, Medium):
            raise SceneError(f"a fog's medium is {shown(medium)}: expected a Medium")
        self.extinction = opaque(medium.extinction)
        self.scattering = opaque(medium.scattering)
        self.anisotropy = dr.opaque(Float, medium.anisotropy)

    @classmethod
    @arguments
    def of(cls, scattering: Numbers, absorption: Numbers = 0.0, anisotropy: Number = 0.0) -> Fog:
        """Return the fog of these coefficients, attached to the AD graph where they are; σt is their sum.

        Parameters
        ----------
        scattering, absorption
            One number for all channels, or three, not negative.
        anisotropy
            From −0.99 to 0.99.

        Raises
        ------
        SceneError
            Numbers out of range.
        """
        expected = "one or three finite numbers of at least 0"
        scattered = given_color(scattering, "a fog's scattering", expected, 0.0)
        absorbed = given_color(absorption, "a fog's absorption", expected, 0.0)
        mean = given_number(anisotropy, "a fog's anisotropy", "a number from -0.99 to 0.99", -0.99, 0.99)
        fog = cls(Medium(color(scattered.plain, "scattering"), color(absorbed.plain, "absorption"), float(mean.plain)))
        fog.scattering = derived(lambda each: each, scattered, color=True)
        fog.extinction = derived(lambda each, more: each + more, scattered, absorbed, color=True)
        fog.anisotropy = mean.value
        return fog


class LightContext(Described):
    """What all beams of a light have in common: the time, the light's number and its space; opaque.

    Parameters
    ----------
    frame, time
        Frame number, and seconds.
    light
        Number of the light.
    to_world
        (4, 4) from the light's space to the world's, for column vectors.

    Raises
    ------
    SceneError
        What is no number, or no matrix that has an inverse.
    """

    frame: Float
    time: Float
    light: Float

    @constructor
    def __init__(
        self, frame: float = 0.0, time: float = 0.0, light: int = 0, to_world: npt.ArrayLike | None = None
    ) -> None:
        self.frame, self.time, self.light = (
            dr.opaque(Float, number(value, f"a context's {name}"))
            for value, name in ((frame, "frame"), (time, "time"), (light, "light"))
        )
        matrix = np.eye(4) if to_world is None else _inverse(to_world)
        self._rows = [opaque(row) for row in matrix[:3, :3]]
        self._shift = opaque(matrix[:3, 3])

    def to_local(self, point: Any) -> Any:
        """Return a point of the world in the light's space."""
        turned = [dr.dot(row, point) for row in self._rows]
        return type(point)(*turned) + self._shift


def _inverse(to_world: npt.ArrayLike) -> Array:
    expected = "a matrix (4, 4) of finite numbers, with an inverse"
    matrix = numbers(to_world, "a context's to_world", expected).astype(np.float64)
    if matrix.shape == (4, 4) and np.all(np.isfinite(matrix)) and np.linalg.det(matrix) != 0:
        return np.linalg.inv(matrix)
    raise SceneError(f"a context's to_world is {shown(to_world)}: expected {expected}")


@dataclass(frozen=True)
class ShadingContext:
    """Where a factor is evaluated. All values are Dr.Jit arrays of one width, or numbers.

    Attributes
    ----------
    distance
        The factor's own distance, in scene units: from the light (along), or to the camera (eye).
    depth
        The part of `distance` that lies in the medium.
    fraction
        Distance from the light over the length of the light's whole path, 0 to 1.
    from_light, to_camera
        Both distances, whichever the factor.
    cosine
        Cosine between the direction of the light and the direction toward the camera: 1 is straight into the lens.
    rho2
        Squared distance from the beam's axis in radii, 0 to 1.
    place
        Returns the position in world space, (3,).
    beam
        The beam, with `identity`: its random number, its number, its generation.
    ray
        The number of the ray, where rays have numbers.
    fog, context
        The medium, or None where there is none; what the light's beams have in common.
    """

    distance: Any = 0.0
    depth: Any = 0.0
    fraction: Any = 0.0
    from_light: Any = 0.0
    to_camera: Any = 0.0
    cosine: Any = 0.0
    rho2: Any = 0.0
    place: Callable[[], Any] | None = None
    beam: Any = None
    ray: Any = None
    fog: Fog | None = None
    context: LightContext | None = None

    def own(self, distance: Any, depth: Any) -> ShadingContext:
        """Return this for a factor whose own distance is another one."""
        return replace(self, distance=distance, depth=depth)

    @property
    def medium(self) -> Fog:
        """The fog; raises SceneError where a physical factor meets no medium."""
        if self.fog is None:
            raise SceneError("this look has a physical factor: give estimate() a medium, or set along, eye and angle")
        return self.fog

    @property
    def radius(self) -> Any:
        """Distance from the beam's axis in radii, 0 to 1."""
        return dr.sqrt(self.rho2)

    @property
    def angle(self) -> Any:
        """Degrees between the light's direction and that toward the camera: 0 is straight into the lens."""
        return dr.rad2deg(dr.acos(dr.clip(self.cosine, -1, 1)))

    @property
    def position(self) -> Any:
        """Position in world space."""
        return self.place() if self.place is not None else Array3f(0)

    @property
    def local(self) -> Any:
        """Position in the light's space: the light looks along −Z."""
        return self.position if self.context is None else self.context.to_local(self.position)

    @property
    def time(self) -> Any:
        """Seconds."""
        return Float(0) if self.context is None else self.context.time

    @property
    def frame(self) -> Any:
        """Frame number."""
        return Float(0) if self.context is None else self.context.frame

    @property
    def light(self) -> Any:
        """Number of the light."""
        return Float(0) if self.context is None else self.context.light

    @property
    def random(self) -> Any:
        """The beam's random number, 0 to 1: the same in every frame."""
        return Float(0) if self.beam is None else self.beam.identity.x

    @property
    def id(self) -> Any:
        """The beam's number."""
        return Float(0) if self.beam is None else self.beam.identity.y

    @property
    def generation(self) -> Any:
        """How often the light was scattered before: 0 straight from the light."""
        return Float(0) if self.beam is None else self.beam.identity.z


class _Watched:
    """Stands in for a ShadingContext and remembers which attributes are read."""

    def __init__(self, at: ShadingContext) -> None:
        self._at, self.asked = at, set[str]()

    def __getattr__(self, name: str) -> Any:
        self.asked.add(name)
        return getattr(self._at, name)


def inputs_of(evaluate: Callable[[Any], Any], at: ShadingContext) -> frozenset[str]:
    """Return the names of the attributes of a ShadingContext that a factor reads."""
    watched = _Watched(at)
    evaluate(watched)
    return frozenset(watched.asked)
