"""Where a look is evaluated: everything that its factors may ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..runtime.device import Array3f, Float
from ..scene import Medium, SceneError
from .vocabulary import NAMES

#: The inputs by the names that expressions and Python functions use, and the attributes of `At` that answer them.
INPUTS = {name: each.attribute for name, each in NAMES.items()}

#: Attributes of `At` that differ between beams, between places in space, and with the distance from the axis.
OF_BEAMS = frozenset({"random", "id", "generation"})
OF_PLACES = frozenset({"position", "local"})
OF_RADII = frozenset({"radius", "rho2"})


class Fog:
    """The coefficients of a `Medium` as opaque Dr.Jit values, whose gradients may be enabled.

    `extinction` and `scattering` per channel and scene unit, `anisotropy` of the phase function.
    """

    def __init__(self, medium: Medium) -> None:
        self.extinction = opaque(medium.extinction)
        self.scattering = opaque(medium.scattering)
        self.anisotropy = dr.opaque(Float, medium.anisotropy)


class Context:
    """What all beams of a light have in common: the time, the light's number and its space; opaque.

    Parameters
    ----------
    frame, time
        Frame number, and seconds.
    light
        Number of the light.
    to_world
        (4, 4) from the light's space to the world's, for column vectors.
    """

    def __init__(self, frame: float = 0.0, time: float = 0.0, light: int = 0, to_world: Any = None) -> None:
        self.frame, self.time = dr.opaque(Float, float(frame)), dr.opaque(Float, float(time))
        self.light = dr.opaque(Float, float(light))
        matrix = np.eye(4) if to_world is None else np.linalg.inv(np.asarray(to_world, dtype=np.float64))
        self._rows = [opaque(row) for row in matrix[:3, :3]]
        self._shift = opaque(matrix[:3, 3])

    def to_local(self, point: Any) -> Any:
        """Return a point of the world in the light's space."""
        turned = [dr.dot(row, point) for row in self._rows]
        return type(point)(*turned) + self._shift


@dataclass(frozen=True)
class At:
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
    context: Context | None = None

    def own(self, distance: Any, depth: Any) -> At:
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
    """Stands for an At and remembers what it is asked for."""

    def __init__(self, at: At) -> None:
        self._at, self.asked = at, set[str]()

    def __getattr__(self, name: str) -> Any:
        self.asked.add(name)
        return getattr(self._at, name)


def inputs_of(evaluate: Callable[[Any], Any], at: At) -> frozenset[str]:
    """Return the names of At's attributes that a factor asks for."""
    watched = _Watched(at)
    evaluate(watched)
    return frozenset(watched.asked)
