"""The shading context of looks: all inputs that factors may read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque
from ..numerics.given import Number, Numbers, derived, finite, given_color, given_number
from ..runtime.device import Array3f, Float
from ..scene import Medium, SceneError, arguments, number, shown
from ..scene.places import ZERO
from .described import Described, constructor
from .vocabulary import NAMES

if TYPE_CHECKING:
    from .factors import Value

#: The inputs of expressions and Python functions: from their names there to attributes of `ShadingContext`.
INPUTS = {name: each.attribute for name, each in NAMES.items()}

#: Attributes that differ between beams, between positions in space, and with the distance from the axis.
OF_BEAMS = frozenset({"random", "id", "generation"})
OF_PLACES = frozenset({"position", "local", "point"})
OF_RADII = frozenset({"radius", "rho2"})

_MOST = 3e38  # of a number in single precision


class Fog(Described):
    """The coefficients of a homogeneous medium as Dr.Jit values, whose gradients may be enabled.

    Parameters
    ----------
    medium
        The medium whose coefficients are taken. See `Fog.of` for coefficients that have gradients enabled already.

    Attributes
    ----------
    extinction, scattering
        Coefficients σt and σs per channel and scene unit, an Array3f.
    anisotropy
        Mean cosine g of the phase function, a Float.

    Raises
    ------
    SceneError
        If the argument is not a `Medium`.

    Examples
    --------
    How does the radiance change with the extinction of the fog?

    >>> import drjit as dr
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> fog = pb.looks.Fog(pb.Medium(scattering=0.1))
    >>> dr.enable_grad(fog.extinction)
    >>> radiance = pb.estimate(beams, [-3, 0, 2], [1, 0, 0], medium=fog)
    >>> dr.backward(radiance)
    >>> bool(dr.all(dr.grad(fog.extinction) < 0, axis=None))
    True
    """

    extinction: Array3f
    scattering: Array3f
    anisotropy: Float

    @constructor
    def __init__(self, medium: Medium) -> None:
        self.extinction = opaque(medium.extinction)
        self.scattering = opaque(medium.scattering)
        self.anisotropy = opaque(medium.anisotropy)

    @classmethod
    @arguments
    def of(cls, scattering: Numbers, absorption: Numbers = 0.0, anisotropy: Number = 0.0) -> Fog:
        """Return a fog with these coefficients, attached to the AD graph where they are. σt is their sum.

        Parameters
        ----------
        scattering, absorption
            Coefficients σs and σa per scene unit, 0 or more: one number for all channels, or three. Default of the
            absorption: 0.
        anisotropy
            Mean cosine g of the phase function, −0.99 to 0.99. Default: 0.

        Raises
        ------
        SceneError
            If a number is out of range.

        Examples
        --------
        >>> fog = pb.looks.Fog.of(scattering=0.1, absorption=[0.0, 0.1, 0.3])
        >>> [round(channel[0], 3) for channel in fog.extinction]
        [0.1, 0.2, 0.4]
        """
        expected = "one or three finite numbers of at least 0"
        scattered = given_color(scattering, "a fog's scattering", expected, 0.0)
        absorbed = given_color(absorption, "a fog's absorption", expected, 0.0)
        mean = given_number(anisotropy, "a fog's anisotropy", "a number from -0.99 to 0.99", -0.99, 0.99)
        fog = cls(Medium(scattered.plain, absorbed.plain, float(mean.plain)))
        fog.scattering = derived(lambda each: each, scattered, color=True)
        fog.extinction = derived(lambda each, more: each + more, scattered, absorbed, color=True)
        fog.anisotropy = mean.value
        return fog


class LightContext(Described):
    """The inputs of looks that all beams of a light share: the time, and the light's number and space.

    Parameters
    ----------
    frame
        Frame number. Default: 0.
    time
        Time in seconds. Default: 0.
    light
        Number of the light. Default: 0.
    to_world
        (4, 4) transform from the light's space to world space, for column vectors. Default: the identity.
    zero
        (x, y, z) where the coordinates that looks see begin, in those of the beams. Default: at 0, they are the same.

    Raises
    ------
    SceneError
        If a value is not a number, if `to_world` is not a finite matrix that has an inverse, or if `zero` is not three
        finite numbers.

    Notes
    -----
    The values are opaque to kernels: the frames of a sequence share their kernels.

    Examples
    --------
    A look that flickers, at 0.5 seconds:

    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> look = pb.Look(along="pulse(2 * time)", eye=1.0, angle=1.0)
    >>> bright, dark = (
    ...     pb.estimate(beams, [-3, 0, 2], [1, 0, 0], look=look, context=pb.looks.LightContext(time=time)).numpy()
    ...     for time in (0.5, 0.75)
    ... )
    >>> bool(np.all(bright > 0)), bool(np.all(dark > 0))
    (True, False)
    """

    frame: Float
    time: Float
    light: Float

    @constructor
    def __init__(
        self, frame: float = 0.0, time: float = 0.0, light: int = 0, to_world: npt.ArrayLike | None = None,
        zero: npt.ArrayLike = ZERO,
    ) -> None:  # fmt: skip
        self.frame, self.time, self.light = (
            opaque(number(value, f"a context's {name}", -_MOST, _MOST))
            for value, name in ((frame, "frame"), (time, "time"), (light, "light"))
        )
        begin = finite(zero, "a context's zero", "three finite numbers", (3,))
        # Far from zero, places as looks see them need double precision; what looks give has single precision again.
        self.zero: Any = None  # nothing is added near zero: kernels, and so the rounding in them, stay as they are
        if np.any(begin):
            kind: Any = dr.float64_array_t(Array3f)
            self.zero = kind(*begin.tolist())
            dr.make_opaque(self.zero)
        matrix = np.eye(4)
        matrix[:3, 3] = 0.0 - begin
        if to_world is not None:
            expected = "a matrix (4, 4) of finite numbers, with an inverse"
            turned = finite(to_world, "a context's to_world", expected, (4, 4))
            if np.linalg.det(turned) == 0:
                raise SceneError(f"a context's to_world is {shown(to_world)}: expected {expected}")
            matrix = np.linalg.inv(turned)
        self.rows = [opaque(row) for row in matrix[:3, :3]]
        self.shift = opaque(matrix[:3, 3])

    def to_local(self, point: Array3f) -> Array3f:
        """Return a `point` of world space in the light's space."""
        turned = [dr.dot(row, point) for row in self.rows]
        return type(point)(*turned) + self.shift


@dataclass(frozen=True)
class ShadingContext:
    """The inputs of a factor at a shading point: Dr.Jit arrays of one width, or numbers.

    Attributes
    ----------
    distance
        The factor's own distance in scene units: from the light (along) or to the camera (eye). Default: 0.
    depth
        The part of `distance` that is in the medium. Default: 0.
    fraction
        Distance from the light as a fraction of the whole light path, 0 to 1. Default: 0.
    from_light, to_camera
        Distances from the light and to the camera in scene units, for all factors. Default: 0.
    cosine
        Cosine of the angle between the light's direction and the direction to the camera; 1 is straight into the
        lens. Default: 0.
    rho2
        Squared distance from the beam's axis in radii, 0 to 1. Default: 0.
    place
        Function that returns the position in the coordinates of the beams, an Array3f. Default: None, their origin.
    beam
        The beam; its attribute `identity` holds `random`, `id` and `generation`. Default: None, all of them 0.
    ray
        Number of the ray, or None if rays are not numbered.
    fog
        The medium, or None if there is none.
    context
        The inputs that all beams of a light share, or None for time 0 and light 0 in world space.

    Notes
    -----
    A factor of one's own reads these attributes and properties in its method `evaluate`; a `looks.Function` takes them
    by the names of `looks.INPUTS`. Those that a look does not read are not computed.

    Examples
    --------
    >>> at = pb.looks.ShadingContext(distance=2.0, fraction=0.5)
    >>> round(pb.looks.Expression("1 - s ** 2").evaluate(at)[0], 3)
    0.75
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

    def own(self, distance: Number, depth: Number) -> ShadingContext:
        """Return the context of a factor whose own distance and depth are `distance` and `depth`."""
        return replace(self, distance=distance, depth=depth)

    @property
    def medium(self) -> Fog:
        """The fog; raises SceneError if there is none, because a physical factor needs it."""
        if self.fog is None:
            raise SceneError("this look has a physical factor: give estimate() a medium, or set along, eye and angle")
        return self.fog

    @property
    def radius(self) -> Number:
        """Distance from the beam's axis in radii, 0 to 1."""
        return dr.sqrt(self.rho2)

    @property
    def angle(self) -> Number:
        """Angle between the light's direction and that to the camera, in degrees; 0 is straight into the lens."""
        return dr.rad2deg(dr.acos(dr.clip(self.cosine, -1, 1)))

    @property
    def point(self) -> Array3f:
        """Position in the coordinates of the beams, which the renderer may measure from near the shot."""
        return self.place() if self.place is not None else Array3f(0)

    @property
    def position(self) -> Array3f:
        """Position in world space; far from zero it has double precision."""
        zero = self._shared.zero
        return self.point if zero is None else self.point - zero

    @property
    def local(self) -> Array3f:
        """Position in the light's space, in which the light looks along −Z."""
        return self._shared.to_local(self.point)

    @property
    def time(self) -> Float:
        """Time in seconds."""
        return self._shared.time

    @property
    def frame(self) -> Float:
        """Frame number."""
        return self._shared.frame

    @property
    def light(self) -> Float:
        """Number of the light."""
        return self._shared.light

    @property
    def random(self) -> Float:
        """The beam's random number from 0 to 1, the same in every frame."""
        return self._identity.x

    @property
    def id(self) -> Float:
        """The beam's number."""
        return self._identity.y

    @property
    def generation(self) -> Float:
        """Number of times that the light was scattered before; 0 is straight from the light."""
        return self._identity.z

    @property
    def _shared(self) -> LightContext:
        return self.context or LightContext()

    @property
    def _identity(self) -> Array3f:
        return Array3f(0) if self.beam is None else self.beam.identity


class _Watched:
    """A stand-in for a ShadingContext that remembers which attributes are read."""

    def __init__(self, at: ShadingContext) -> None:
        self._at, self.asked = at, set[str]()

    def __getattr__(self, name: str) -> Any:
        self.asked.add(name)
        return getattr(self._at, name)


def inputs_of(evaluate: Callable[..., Value], at: ShadingContext) -> frozenset[str]:
    """Return the names of the `ShadingContext` attributes that a factor reads."""
    watched = _Watched(at)
    evaluate(watched)
    return frozenset(watched.asked)
