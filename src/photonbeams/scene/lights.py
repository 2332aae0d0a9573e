"""Lights, after UsdLux, with the settings of their beams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .checks import BLACK, MOST_BEAMS, Array, Color, SceneError, color, number, rgb, shown, whole
from .profiles import Profile
from .surfaces import Mesh, UVTexture

if TYPE_CHECKING:
    from ..looks import Look

#: What beams of scattered light may be.
SCATTERED = ("physical", "look", "off")


@dataclass(frozen=True)
class Shaping:
    """UsdLuxShapingAPI: a light's cone, its soft edge, its focus and its profile; angles in degrees from its axis."""

    cone_angle: float = 90.0
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = BLACK
    profile: Profile | None = None


@dataclass(frozen=True)
class Gobo:
    """An image that a light shines through.

    Attributes
    ----------
    image
        (H, W, C) scene-linear, first row on top. One channel or two are grey, three or four a colour; a second and a
        fourth channel are not used.
    angle
        Degrees that its width covers before a point, a spot or a sphere, below 180; None: the light's cone.
    width
        Its width in scene units, of distant lights.
    repeat
        Whether it goes on for ever, of these and of distant lights; if not, there is no light beside it.
    up
        Of an image on a portal: the direction in world space that its upper edge is nearest to.

    Raises
    ------
    SceneError
        An image without pixels or not of three axes, an angle not between 0 and 180, a width not above 0.
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
        """Height over width, of square pixels."""
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
        Light group: beams of the light go to the layer `beams_<group>`; "" is the unnamed group.
    look
        The look of the light's beams, or None for the physical one.
    emits_beams, beam_count, beam_scale, seed
        Whether the light makes beams, how many a pass (None: the renderer's default), a factor on their power alone,
        and the seed of their samples.
    portal
        The mesh through which the light reaches the shot, or None. It is no surface. Of a Mitsuba scene: a flat mesh,
        or the id of a flat shape with a null BSDF.
    gobo, portal_gobo
        Images that the light shines through: of its own, and over the bounding rectangle of its portal.
    scattered
        What beams of its light are that was scattered before: "physical", "look" (as those straight from the light),
        or "off".
    bounces
        How often its light is scattered before it is scattered toward the camera; None: the renderer's choice.

    Raises
    ------
    SceneError
        A factor that is negative or not finite, another word for `scattered`, a negative number of bounces or beams, a
        portal or an image of another type.
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
    """Attributes of all lights; a portal is a mesh.

    Attributes
    ----------
    name
        Prim path.
    radiance
        Emitted radiance after intensity, exposure, colour, temperature and `normalize`. For a point: radiant
        intensity. For a distant light of no angle: irradiance.
    shaping
        The light's cone and focus, or None for neither.
    surface_scale
        A factor on the light that surfaces get from it; its beams shine either way.
    shadow_distance, shadow_color
        How near to a surface others have to be to cast a shadow on it, and which part of the light is left in it. On
        beams shadows are black and without end.
    seen
        Whether the light itself is in pictures.
    frame
        (4, 4) transform from the light's own space to the world, for column vectors: the light shines along its −Z, +Y
        is up, its origin is the light's place. Axes of unit length, square to each other, without the light's size;
        mirrored where the light is.
    unlit, unshadowed
        Names of meshes that the light does not shine on, and of those that do not stop it, nor its beams.
    guides
        Points (M, 3) along each of the curves that lead the light's beams: see `beams.guides`.
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
        """Whether surfaces are lit by it."""
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


@dataclass(frozen=True)
class SphereLight(Light):
    """A sphere; `radius` 0 is a point. `axis` is the unit direction that shaping is measured from (local −Z)."""

    center: Array = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))


@dataclass(frozen=True)
class FlatLight(Light):
    """A rectangle or an ellipse that emits to one side: center ± half_x ± half_y, along half_x × half_y's −normal.

    `axis` is the unit emission direction (local −Z). `disk` tells the ellipse with these half axes from the rectangle.
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
    """The mantle of a cylinder, without its ends: its axis is `center` ± `half`. `axis` is as a sphere light's."""

    center: Array = field(default_factory=lambda: np.zeros(3))
    half: Array = field(default_factory=lambda: np.array([0.5, 0.0, 0.0]))
    radius: float = 0.5
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))

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
    """A mesh that emits evenly from its outer side: `radiance`, times an image where it has one.

    `surface` says whether the mesh is a surface of the scene as well: it is then seen as its material has it, and not
    as the light.
    """

    mesh: Mesh | None = field(default=None, kw_only=True)
    image: UVTexture | None = None
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    surface: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.mesh, Mesh) and self.mesh.area > 0):
            raise SceneError(f"{self.name}: expected a mesh that has an area")


@dataclass(frozen=True)
class DistantLight(Light):
    """Light from infinity along the unit vector `axis`, from a cone of `angle` degrees (full width)."""

    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    angle: float = 0.53


@dataclass(frozen=True)
class DomeLight(Light):
    """An environment: `radiance` times an optional latitude-longitude image (H, W, 3), oriented by a rotation.

    The image is oriented as UsdLuxDomeLight has its latlong format: +Y is up, its middle looks along local +Z;
    `to_world` (3, 3) turns local directions into world directions. Makes no beams unless asked: `lights_media` tells
    whether it lights the media that say they are lit by domes all the same, sampled along camera paths.
    """

    image: Array | None = None
    to_world: Array = field(default_factory=lambda: np.eye(3))
    lights_media: bool = False
