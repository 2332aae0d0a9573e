"""Lights as UsdLux defines them, with the settings of their beams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..constants import MOST_BEAMS
from .checks import BLACK, Array, Color, SceneError, color, number, rgb, shown, whole
from .profiles import Profile
from .surfaces import Mesh, UVTexture

if TYPE_CHECKING:
    from ..looks import Look

#: How beams of light that was scattered before may look.
SCATTERED = ("physical", "look", "off")


@dataclass(frozen=True)
class Shaping:
    """A light's cone, focus and angular profile, as UsdLuxShapingAPI defines them.

    Attributes
    ----------
    cone_angle
        Degrees between the light's axis and the edge of its cone; from 180 on there is no edge. Default 90.
    cone_softness
        Width of the cone's soft edge, as a fraction of `cone_angle`, 0 or more. At 0, the default, the edge is hard;
        above 1 the axis is dimmed, too.
    focus
        Exponent, 0 or more, of the cosine of the angle from the axis, which scales the radiance. Default 0, even light.
    focus_tint
        Colour that the focus fades to away from the axis. Default black.
    profile
        A `Profile`, such as one of an IES file. Default: none.

    Raises
    ------
    SceneError
        Numbers that are negative or not finite.

    Examples
    --------
    >>> spot = pb.scene.Shaping(cone_angle=20, cone_softness=0.1)
    >>> lamp = pb.scene.SphereLight("/Lamp", 50.0, shaping=spot)
    >>> lamp.shaping.cone_angle
    20
    """

    cone_angle: float = 90.0
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = BLACK
    profile: Profile | None = None

    def __post_init__(self) -> None:
        for name in ("cone_angle", "cone_softness", "focus"):
            number(getattr(self, name), name, 0.0)
        object.__setattr__(self, "focus_tint", color(self.focus_tint, "focus_tint"))


@dataclass(frozen=True)
class Gobo:
    """An image that a light shines through.

    Attributes
    ----------
    image
        (H, W, C) scene-linear, first row on top. One or two channels are grey, three or four a colour; a second or
        fourth channel, which is alpha, is not used.
    angle
        Degrees that the image's width covers in front of a point, a spot or a sphere light, more than 0 and less than
        180. None, the default: the light's cone.
    width
        The image's width in scene units, for distant lights. Default 1.
    repeat
        Whether the image is repeated without end in front of these lights. False, the default: beside it there is no
        light.
    up
        (3,) direction in world space, for an image on a portal: the image's upper edge points this way, as far as the
        portal's plane allows. Default: +Y.

    Raises
    ------
    SceneError
        An image without pixels or without three axes, an angle not between 0 and 180, a width not above 0.

    Examples
    --------
    >>> bars = np.tile([[[1.0], [0.0]]], (1, 4, 1))  # eight stripes, a row high
    >>> gobo = pb.scene.Gobo(bars, angle=30)
    >>> gobo.colors.shape, gobo.aspect
    ((1, 8, 3), 0.125)
    """

    image: Array
    angle: float | None = None
    width: float = 1.0
    repeat: bool = False
    up: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))

    def __post_init__(self) -> None:
        if np.ndim(self.image) != 3 or not np.size(self.image):
            raise SceneError(f"an image has the shape {np.shape(self.image)}: expected rows, columns and channels")
        if self.angle is not None and not 0 < number(self.angle, "angle") < 180:
            raise SceneError(f"angle is {self.angle}: expected more than 0 and less than 180 degrees")
        if not number(self.width, "width") > 0:
            raise SceneError(f"width is {self.width}: expected a number above 0")

    @property
    def aspect(self) -> float:
        """The image's height over its width; pixels are square."""
        return self.image.shape[0] / self.image.shape[1]

    @property
    def colors(self) -> Array:
        """The image's colours, (H, W, 3)."""
        return rgb(self.image)


@dataclass(frozen=True, kw_only=True)
class BeamSettings:
    """Settings of the beams of a light, or of an emitter that is described elsewhere, as in a Mitsuba scene.

    Attributes
    ----------
    group
        Light group: the light's beams go to the layer `beams_<group>`. Default "", the unnamed group.
    look
        The look of the light's beams. None, the default, is the physical look.
    emits_beams
        Whether the light makes beams. Default True.
    beam_count
        Beams of the light per pass. None, the default: the renderer's number.
    beam_scale
        A factor on the power of the beams, not on the light on surfaces. Default 1.
    seed
        Seed of the beams' samples. Default 0.
    portal
        The mesh through which the light reaches the shot; it is not rendered as a surface. In a Mitsuba scene: a flat
        mesh, or the id of a flat shape with a null BSDF. Default: none.
    gobo, portal_gobo
        Images that the light shines through: one in front of the light, and one over its portal's bounding rectangle.
        Default: none.
    scattered
        What becomes of beams of the light after it was scattered: "physical" (the default), "look" (they have the look
        of beams that come straight from the light), or "off".
    bounces
        How often the light may be scattered before it is scattered toward the camera. None, the default: the
        renderer's number.

    Raises
    ------
    SceneError
        A factor that is negative or not finite, another word for `scattered`, a negative number of bounces or beams, a
        portal or an image of another type.

    Examples
    --------
    >>> warm = pb.Look(along=pb.looks.ColorRamp([0, 1], [[1, 0.9, 0.6], [0.8, 0.1, 0]]))
    >>> settings = pb.scene.BeamSettings(group="key", look=warm, beam_count=10_000)
    >>> settings.beam_count, settings.scattered
    (10000, 'physical')

    `pb.Shot.open("scene.xml", beams={"lamp": settings})` gives them to the emitter "lamp" of a Mitsuba scene.
    """

    group: str = ""
    look: Look | None = None
    emits_beams: bool = True
    beam_count: int | None = None
    beam_scale: float = 1.0
    seed: int = 0
    portal: Mesh | str | None = None
    gobo: Gobo | None = None
    portal_gobo: Gobo | None = None
    scattered: str = "physical"
    bounces: int | None = None

    def __post_init__(self) -> None:
        number(self.beam_scale, "beam_scale", 0.0)
        if self.scattered not in SCATTERED:
            raise SceneError(f"scattered is {self.scattered!r}: expected {', '.join(SCATTERED)}")
        if self.bounces is not None:
            number(whole(self.bounces, "bounces"), "bounces", 0)
        if self.beam_count is not None:
            number(whole(self.beam_count, "beam_count"), "beam_count", 0, MOST_BEAMS)
        kinds = {"portal": (Mesh, str), "gobo": (Gobo,), "portal_gobo": (Gobo,)}
        for name, kind in kinds.items():
            value = getattr(self, name)
            if value is not None and not isinstance(value, kind):
                expected = "a Mesh or the id of a shape" if name == "portal" else "a Gobo"
                raise SceneError(f"{name} is of type {type(value).__name__}: expected {expected}")


@dataclass(frozen=True)
class Light(BeamSettings):
    """What all lights have in common. Their portals are meshes. Other attributes are those of `BeamSettings`.

    Attributes
    ----------
    name
        Prim path, by which messages and looks refer to the light.
    radiance
        Emitted radiance, one or three numbers, after intensity, exposure, colour, temperature and `normalize`. For a
        point light: radiant intensity. For a distant light of angle 0: irradiance.
    shaping
        The light's cone, focus and profile, a `Shaping`. Default: none.
    portal
        The `Mesh` through which the light reaches the shot; it is not rendered as a surface. Default: none.
    surface_scale
        A factor on the light that surfaces get from it, not on its beams. Default: 1.
    shadow_distance, shadow_color
        On surfaces: only objects closer than this distance cast shadows (default: all), and this fraction of the light
        is left in them, per channel (default: 0). Shadows in beams are always black and unlimited.
    seen
        Whether pictures show the light itself. Default: True.
    frame
        (4, 4) transform from the light's own space to the world, for column vectors: the light shines along its −Z, +Y
        is up, its origin is the light's place. The axes have unit length and are perpendicular; they are without the
        light's size, and mirrored where the light is. Default: the identity.
    unlit, unshadowed
        Names of meshes that the light does not shine on, and of meshes that block neither it nor its beams.
    guides
        Points (M, 3) along each of the curves that lead the light's beams: see `beams.guides`.

    Raises
    ------
    SceneError
        If a number is negative where it may not be, or not finite, or if a vector does not have three numbers.

    Examples
    --------
    The kinds of light have these attributes:

    >>> pb.scene.DistantLight("/Sun", 3.0, surface_scale=0.5).lights_surfaces
    True
    """

    name: str
    radiance: Color
    shaping: Shaping | None = None
    portal: Mesh | None = field(default=None, kw_only=True)
    surface_scale: float = 1.0
    shadow_distance: float = np.inf
    shadow_color: Color = BLACK
    seen: bool = True
    frame: Array = field(default_factory=lambda: np.eye(4))
    unlit: frozenset[str] = frozenset()
    unshadowed: frozenset[str] = frozenset()
    guides: tuple[Array, ...] = ()

    @property
    def lights_surfaces(self) -> bool:
        """Whether the light shines on surfaces."""
        return self.surface_scale > 0

    def __post_init__(self) -> None:
        super().__post_init__()
        number(self.surface_scale, f"{self.name}: surface_scale", 0.0)
        if not self.shadow_distance > 0:
            raise SceneError(f"{self.name}: shadow_distance is {self.shadow_distance}: expected a number above 0")
        object.__setattr__(self, "radiance", color(self.radiance, f"{self.name}: radiance"))
        for name in ("center", "axis", "half", "half_x", "half_y"):
            if hasattr(self, name):
                value = np.asarray(getattr(self, name), dtype=np.float64)
                if value.shape != (3,) or not np.all(np.isfinite(value)):
                    raise SceneError(f"{self.name}: {name} is {shown(getattr(self, name))}: expected 3 finite numbers")
                object.__setattr__(self, name, value)
        if getattr(self, "shape", None) is not None:
            linear = np.asarray(self.shape, dtype=np.float64)  # type: ignore[attr-defined]
            if linear.shape != (3, 3) or not np.all(np.isfinite(linear)) or np.linalg.det(linear) == 0:
                raise SceneError(
                    f"{self.name}: shape is {shown(linear.tolist())}: expected 3 x 3 numbers with an inverse"
                )
            object.__setattr__(self, "shape", linear)


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

    center: Array = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    shape: Array | None = None


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

    center: Array = field(default_factory=lambda: np.zeros(3))
    half_x: Array = field(default_factory=lambda: np.array([0.5, 0.0, 0.0]))
    half_y: Array = field(default_factory=lambda: np.array([0.0, 0.5, 0.0]))
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    disk: bool = False

    @property
    def area(self) -> float:
        """Area in square scene units."""
        box = 4.0 * float(np.linalg.norm(np.cross(self.half_x, self.half_y)))
        return box * np.pi / 4.0 if self.disk else box


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

    center: Array = field(default_factory=lambda: np.zeros(3))
    half: Array = field(default_factory=lambda: np.array([0.5, 0.0, 0.0]))
    radius: float = 0.5
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    shape: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (number(self.radius, f"{self.name}: radius") > 0 and self.area > 0):
            raise SceneError(f"{self.name}: radius is {self.radius:g}, area {self.area:g}: expected numbers above 0")

    @property
    def area(self) -> float:
        """Area in square scene units."""
        return 4.0 * np.pi * self.radius * float(np.linalg.norm(self.half))


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
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    surface: bool = False
    both_sides: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.mesh, Mesh) and self.mesh.area > 0):
            raise SceneError(f"{self.name}: expected a mesh with an area above 0")


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

    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    angle: float = 0.53

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
        Whether the dome lights media without beams, by samples along camera paths: those with `Medium.lit_by_domes`.
        Default False.

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
