"""Lights as UsdLux defines them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np

from .checks import AHEAD, ORIGIN, Array, SceneError, Vector, array, number
from .light import Light, SlidePlace
from .shaping import Gobo
from .surfaces import Mesh, UVTexture

_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_SIX = np.concatenate([np.eye(3), -np.eye(3)])

# Half axes of flat and long lights, and the type of maps from a unit shape to the light.
_X: Any = (0.5, 0.0, 0.0)
_Y: Any = (0.0, 0.5, 0.0)
_Linear = Annotated[Array, partial(array, expected="3 x 3 numbers with an inverse", shape=(3, 3), inverse=True)]


@dataclass(frozen=True)
class SphereLight(Light):
    """A sphere or a point that emits in all directions; with a cone it is a spot light.

    Attributes
    ----------
    center
        (3,) position in world space. Default: the origin.
    radius
        In scene units; 0, the default, is a point.
    axis
        (3,) unit direction from which shaping is measured, local −Z.
    shape
        (3, 3) linear map from the unit sphere to the light, for column vectors: an ellipsoid. `radius` is then not 0.
        None, the default: the sphere of this radius.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        Numbers that are negative where they may not be, or not finite; vectors without three numbers; a map without an
        inverse.

    Examples
    --------
    >>> lamp = pb.scene.SphereLight("/Lamp", (50, 40, 30), center=(0, 2, 0), axis=(0, -1, 0),
    ...                             shaping=pb.scene.Shaping(cone_angle=20), group="key")
    >>> lamp.radiance
    (50.0, 40.0, 30.0)
    """

    center: Vector = ORIGIN
    radius: float = 0.0
    axis: Vector = AHEAD
    shape: _Linear | None = None

    @property
    def points(self) -> Array:
        """Points, (N, 3), whose box contains the light."""
        return self.center + (_CORNERS @ self.shape.T if self.shape is not None else self.radius * _SIX)

    def slide(self, gobo: Gobo) -> SlidePlace:
        """Return where the slide `gobo` is before the light: one unit from its centre."""
        side, up, ahead = self._slide_axes()
        width = 2 * np.tan(np.radians(self.slide_angle) / 2)
        return SlidePlace(self.center + ahead, width * side, width * gobo.aspect * up, ahead)


@dataclass(frozen=True)
class FlatLight(Light):
    """A rectangle or an ellipse that emits to one side, that of −(half_x × half_y).

    Attributes
    ----------
    center
        (3,) position in world space. Default: the origin.
    half_x, half_y
        (3,) half axes in scene units: the corners of the rectangle are center ± half_x ± half_y. Default: a square
        with sides of 1 in the XY plane.
    axis
        (3,) unit direction of emission, local −Z.
    disk
        Whether the light is the ellipse with these half axes. False, the default: the rectangle.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        Numbers that are negative where they may not be, or not finite; vectors without three numbers.

    Examples
    --------
    >>> window = pb.scene.FlatLight("/Window", 10.0, half_x=(1, 0, 0), half_y=(0, 0.5, 0))
    >>> window.area
    2.0
    """

    center: Vector = ORIGIN
    half_x: Vector = _X
    half_y: Vector = _Y
    axis: Vector = AHEAD
    disk: bool = False

    @property
    def area(self) -> float:
        """Area in square scene units."""
        box = 4.0 * float(np.linalg.norm(np.cross(self.half_x, self.half_y)))
        return box * np.pi / 4.0 if self.disk else box

    @property
    def points(self) -> Array:
        """Points, (N, 3), whose box contains the light."""
        signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        points: Array = self.center + signs @ np.array([self.half_x, self.half_y])
        return points

    def slide(self, gobo: Gobo) -> SlidePlace:
        """Return where the slide `gobo` is: on the light's face.

        UsdLuxRectLight puts the image's first pixel at (+X, +Y) and its last at (-X, -Y): it is upright as seen from
        the front of the light. Arnold does the same from usdlux_version 25.05 on, and mirrored it before.
        """
        side, up, ahead = self._slide_axes()
        x = self.half_x if np.dot(self.half_x, side) < 0 else -np.asarray(self.half_x)
        y = self.half_y if np.dot(self.half_y, up) > 0 else -np.asarray(self.half_y)
        return SlidePlace(self.center, 2 * x, 2 * y, ahead)


@dataclass(frozen=True)
class CylinderLight(Light):
    """The curved surface of a cylinder, without its ends, as of a fluorescent tube.

    Attributes
    ----------
    center
        (3,) position of the middle in world space. Default: the origin.
    half
        (3,) from the middle to one end, in scene units. Default: half a unit along +X.
    radius
        In scene units, above 0. Default 0.5.
    axis
        (3,) unit direction from which shaping is measured, local −Z.
    shape
        (3, 3) linear map to the light from a cylinder of radius 1 along X, from -1 to 1, for column vectors: it may be
        elliptic, or oblique. `half` and `radius` are then those of a round one of its area. None, the default.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        Numbers that are negative where they may not be, or not finite; vectors without three numbers; no area; a map
        without an inverse.

    Examples
    --------
    >>> tube = pb.scene.CylinderLight("/Tube", 20.0, half=(0.6, 0, 0), radius=0.02)
    >>> round(tube.area, 3)  # 2π · radius · length
    0.151
    """

    center: Vector = ORIGIN
    half: Vector = _X
    radius: float = 0.5
    axis: Vector = AHEAD
    shape: _Linear | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (number(self.radius, f"{self.name}: radius") > 0 and self.area > 0):
            raise SceneError(f"{self.name}: radius is {self.radius:g}, area {self.area:g}: expected numbers above 0")

    @property
    def area(self) -> float:
        """Area in square scene units."""
        return 4.0 * np.pi * self.radius * float(np.linalg.norm(self.half))

    @property
    def points(self) -> Array:
        """Points, (N, 3), whose box contains the light."""
        if self.shape is not None:
            return self.center + _CORNERS @ self.shape.T
        ends = self.center + np.array([[-1.0], [1.0]]) * self.half
        return np.concatenate([ends + self.radius * each for each in _SIX])


@dataclass(frozen=True)
class MeshLight(Light):
    """A mesh that emits evenly, from its outer side or both: `radiance`, times an image where it has one.

    Attributes
    ----------
    mesh
        The mesh, with an area above 0. Required.
    image
        A `UVTexture` that scales the radiance by the mesh's texture coordinates. Default: none.
    axis
        (3,) unit direction from which shaping is measured, local −Z.
    surface
        Whether the mesh is also a surface of the scene: pictures then show its material, not the light. Default False.
    both_sides
        Whether the inner side emits, too, as a glowing surface that is not closed does. Default False.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        No mesh, or one without area; numbers that are negative where they may not be, or not finite.

    Examples
    --------
    >>> triangle = pb.scene.Mesh("/Neon", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> neon = pb.scene.MeshLight("/Neon", (0, 5, 9), mesh=triangle)
    >>> neon.mesh.area
    0.5
    """

    mesh: Mesh | None = field(default=None, kw_only=True)
    image: UVTexture | None = None
    axis: Vector = AHEAD
    surface: bool = False
    both_sides: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.mesh, Mesh) and self.mesh.area > 0):
            raise SceneError(f"{self.name}: expected a mesh with an area above 0")

    @property
    def points(self) -> Array:
        """Points, (N, 3), whose box contains the light."""
        assert self.mesh is not None
        return self.mesh.used_points


@dataclass(frozen=True)
class DistantLight(Light):
    """Light from infinitely far away, such as the sun's.

    Attributes
    ----------
    axis
        (3,) unit direction in which the light travels, local −Z.
    angle
        Degrees that the source covers in the sky, edge to edge. Default 0.53, the sun's; at 0 rays are parallel.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        Numbers that are negative where they may not be, or not finite; vectors without three numbers.

    Examples
    --------
    >>> sun = pb.scene.DistantLight("/Sun", (3, 2.8, 2.4), axis=(0.6, -0.8, 0), angle=0)
    >>> sun.axis
    array([ 0.6, -0.8,  0. ])
    """

    axis: Vector = AHEAD
    angle: float = 0.53
    profile: ClassVar[None] = None  # type: ignore[assignment, misc]

    def slide(self, gobo: Gobo) -> SlidePlace:
        """Return where the slide `gobo` is: in a plane square to the light."""
        side, up, ahead = self._slide_axes()
        return SlidePlace(self.frame[:3, 3], gobo.width * side, gobo.width * gobo.aspect * up, ahead)

    @property
    def irradiance(self) -> float:
        """Irradiance on a plane that faces the light, in its brightest channel."""
        half = np.radians(min(self.angle / 2, 90.0))
        return max(self.radiance) * (float(np.pi * np.sin(half) ** 2) if half > 0 else 1.0)


@dataclass(frozen=True)
class DomeLight(Light):
    """An environment: light from all directions, `radiance` times an image where it has one.

    Attributes
    ----------
    image
        (H, W, 3) latitude-longitude image, scene-linear, oriented as UsdLuxDomeLight defines its latlong format: +Y is
        up, and the middle of the image is seen along local +Z. Default: none, the light is even.
    to_world
        (3, 3) rotation from local to world directions, for column vectors. Default: the identity.
    lights_media
        Whether the dome lights media without beams, by samples along camera paths. Default False.

    Other attributes are those of `Light` and of `BeamSettings`.

    Raises
    ------
    SceneError
        Numbers that are negative where they may not be, or not finite.

    Examples
    --------
    >>> sky = pb.scene.DomeLight("/Sky", 0.5, image=np.ones((2, 4, 3)), emits_beams=False)
    >>> sky.radiance
    (0.5, 0.5, 0.5)
    """

    image: Array | None = None
    to_world: Array = field(default_factory=lambda: np.eye(3))
    lights_media: bool = False
    profile: ClassVar[None] = None  # type: ignore[assignment, misc]
