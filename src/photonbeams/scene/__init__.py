"""What a shot contains, in plain numbers: the vocabulary between `shot/`, which reads it, and what renders it.

Nothing here knows USD, Mitsuba or Dr.Jit. Lengths are scene units, positions and directions are in world space,
colours are scene-linear Rec.709 unless the stage says otherwise. Every class checks its own numbers, so that what
reaches a kernel is finite and in range; the messages name the field, and `shot/` adds file and prim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .vectors import Plane, plane_of

if TYPE_CHECKING:
    from ..looks import Look

Array = npt.NDArray[Any]
Color = tuple[float, float, float]

DEFAULT_BEAMS = 4096  # a pass, of each light that does not say
MOST_BEAMS = 100_000_000  # that a light may say
MOST_PIXELS = 65536  # of a picture, each way
# In scene units, from the origin. Kernels square distances in single precision, which ends at 1e38.
FARTHEST = 1e12
# How far beyond the bounding sphere, in its radii, light of a lamp goes on that meets no surface. With nothing behind
# them the beams would otherwise end in view; what is further away adds less than a percent of a beam's light.
ESCAPE = 8.0

BLACK: Color = (0.0, 0.0, 0.0)


class SceneError(ValueError):
    """Something in a scene cannot be rendered; the text is one sentence for the user."""


def color(value: float | Sequence[float] | Array, name: str, minimum: float = 0.0) -> Color:
    """Return `value`, a number or three of them, as a colour of finite numbers not below `minimum`."""
    numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)) if np.size(value) in (1, 3) else None
    if numbers is None or not np.all(np.isfinite(numbers)) or np.any(numbers < minimum):
        raise SceneError(f"{name} is {value}: expected one or three finite numbers of at least {minimum:g}")
    return (float(numbers[0]), float(numbers[1]), float(numbers[2]))


def rgb(pixels: Array) -> Array:
    """Return an image's colours, (…, 3): the first three of its channels, or the first one three times."""
    return pixels[..., :3] if pixels.shape[-1] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)


def number(value: float, name: str, minimum: float = -np.inf, maximum: float = np.inf) -> float:
    """Return `value` as a finite float between `minimum` and `maximum`."""
    result = float(value)
    if not np.isfinite(result) or not minimum <= result <= maximum:
        bounds = " ".join(
            words
            for words, bound in ((f"at least {minimum:g}", minimum), (f"at most {maximum:g}", maximum))
            if np.isfinite(bound)
        )
        raise SceneError(f"{name} is {value}: expected a finite number {bounds}".rstrip())
    return result


def whole(value: Any, name: str, of: str = "") -> int:
    """Return a whole number, NumPy's too, as an int; SceneError where it is none, as 64.0 and "4" are."""
    if not isinstance(value, Integral):
        raise SceneError(f"{name} is {value!r}: expected a whole number{of}")
    return int(value)


def real(value: Any, name: str, above: float = -np.inf) -> float:
    """Return a finite number, NumPy's too, as a float; SceneError where it is none, or not above `above`."""
    if isinstance(value, Real) and above < float(value) < np.inf:
        return float(value)
    shown = value if isinstance(value, Real) else repr(value)
    raise SceneError(f"{name} is {shown}: expected a finite number" + (f" above {above:g}" if above > -np.inf else ""))


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
        Coefficients that are negative, not finite, or neither one number nor three; an anisotropy beyond ±0.99.
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


@dataclass(frozen=True)
class Texture:
    """An image over the UV square: `pixels` (H, W, 1 or 3), scene-linear float32, first row at v = 1."""

    pixels: Array
    wrap: str = "repeat"  # repeat | clamp | mirror
    uv_transform: Array = field(default_factory=lambda: np.eye(3))  # (3, 3), applied to (u, v, 1)


@dataclass(frozen=True)
class Material:
    """The inputs of a UsdPreviewSurface that the renderer uses."""

    diffuse: Color | Texture = (0.18, 0.18, 0.18)
    emissive: Color | Texture = BLACK
    roughness: float | Texture = 0.5
    metallic: float | Texture = 0.0
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.01
    opacity: float | Texture = 1.0


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in world space; vertices are split wherever their normal or UV is not shared.

    Attributes
    ----------
    name
        Prim path.
    points, faces
        (V, 3) float64 and (F, 3) int; faces wind counter-clockwise around the outward normal.
    normals, uvs
        (V, 3) and (V, 2), or None: faceted, no texture coordinates.
    """

    name: str
    points: Array
    faces: Array
    normals: Array | None = None
    uvs: Array | None = None
    material: Material = Material()

    @property
    def area(self) -> float:
        """Area in square scene units."""
        corners = self.corners
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * float(np.linalg.norm(normals, axis=1).sum())

    @property
    def used_points(self) -> Array:
        """The points that a triangle has, (P, 3) float64, each once."""
        return np.asarray(self.points, dtype=np.float64)[np.unique(self.faces)]

    @property
    def corners(self) -> Array:
        """The triangles' corners, (F, 3, 3) float64."""
        return np.asarray(self.points, dtype=np.float64)[np.asarray(self.faces).reshape(-1, 3)]

    def plane(self) -> Plane | None:
        """Return the plane that the mesh lies in, or None where it is not flat."""
        return plane_of(self.used_points)


@dataclass(frozen=True)
class Shaping:
    """UsdLuxShapingAPI: a light's cone, its soft edge and its focus (angles in degrees from the light's axis)."""

    cone_angle: float = 90.0
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = BLACK


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


@dataclass(frozen=True)
class Light:
    """What all lights share.

    Attributes
    ----------
    name
        Prim path.
    radiance
        Emitted radiance after intensity, exposure, colour, temperature and `normalize`. For a point: radiant
        intensity. For a distant light of no angle: irradiance.
    group
        Light group: beams of the light go to the layer `beams_<group>`; "" is the unnamed group.
    emits_beams, beam_count, beam_scale, seed
        Whether the light makes beams, how many a pass (None: the renderer's default), a factor on their power alone,
        and the seed of their samples.
    portal
        The mesh through which the light reaches the shot, or None. It is no surface.
    look
        The look of the light's beams, or None for the physical one.
    shaping
        The light's cone and focus, or None for neither.
    lights_surfaces
        Whether surfaces are lit by it; its beams shine either way.
    gobo, portal_gobo
        Images that the light shines through: of its own, and over the bounding rectangle of its portal.
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
    group: str = ""
    emits_beams: bool = True
    beam_count: int | None = None
    beam_scale: float = 1.0
    seed: int = 0
    portal: Mesh | None = None
    look: Look | None = None
    shaping: Shaping | None = None
    lights_surfaces: bool = True
    gobo: Gobo | None = None
    portal_gobo: Gobo | None = None
    frame: Array = field(default_factory=lambda: np.eye(4))
    unlit: frozenset[str] = frozenset()
    unshadowed: frozenset[str] = frozenset()
    guides: tuple[Array, ...] = ()


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
class DistantLight(Light):
    """Light from infinity along the unit vector `axis`, from a cone of `angle` degrees (full width)."""

    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    angle: float = 0.53


@dataclass(frozen=True)
class DomeLight(Light):
    """An environment: `radiance` times an optional latitude-longitude image (H, W, 3), oriented by a rotation.

    The image is oriented as UsdLuxDomeLight has its latlong format: +Y is up, its middle looks along local +Z;
    `to_world` (3, 3) turns local directions into world directions. Makes no beams unless asked.
    """

    image: Array | None = None
    to_world: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Camera:
    """A camera as UsdGeom has it, with lengths in scene units.

    Attributes
    ----------
    to_world
        (4, 4) rigid transform for column vectors; the camera looks along its −Z, +Y is up.
    focal_length, horizontal_aperture, vertical_aperture, horizontal_offset, vertical_offset
        In scene units. For an orthographic camera the apertures are the view's width and height.
    clipping
        Near and far distance.
    lens_radius, focus_distance
        Of a thin lens, and where it is in focus, along the optical axis; a radius of 0 is a pinhole.
    exposure_scale
        What all light that is seen is multiplied with.
    """

    name: str
    to_world: Array
    focal_length: float = 5.0
    horizontal_aperture: float = 2.0955
    vertical_aperture: float = 1.52908
    horizontal_offset: float = 0.0
    vertical_offset: float = 0.0
    orthographic: bool = False
    clipping: tuple[float, float] = (1e-3, 1e6)
    lens_radius: float = 0.0
    focus_distance: float = 0.0
    exposure_scale: float = 1.0


@dataclass(frozen=True)
class DrawnBeams:
    """Beams that someone drew: `start` and `end` (N, 3), `radius_start` and `radius_end` (N,), `power` (N, 3).

    The other arrays are as `Beams` has them, or None: pieces of curves have `offset` and `total` (N,), by which
    falloffs run over the whole curve, `start_tangent` and `end_tangent` (N, 3), by which they are joined, and one `id`,
    the number of their curve.
    """

    name: str
    start: Array
    end: Array
    radius_start: Array
    radius_end: Array
    power: Array
    group: str = ""
    look: Look | None = None
    offset: Array | None = None
    total: Array | None = None
    entry: Array | None = None
    end_normal: Array | None = None
    start_tangent: Array | None = None
    end_tangent: Array | None = None
    power_end: Array | None = None
    random: Array | None = None
    id: Array | None = None
    generation: Array | None = None

    def arrays(self) -> dict[str, Array]:
        """Return all arrays that are set, by the names that `Beams` takes."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        others = ("name", "group", "look")
        return {key: value for key, value in named.items() if key not in others and value is not None}


@dataclass(frozen=True)
class Scene:
    """All of a shot at one time but its camera.

    `bounds` are centre and radius of a sphere around everything at all times, so that beams do not change with what
    moves elsewhere; None: of what is there. `groups` are the light groups that make beams at any time: a frame has the
    layers of these, too, black where nothing of a group shines.
    """

    meshes: tuple[Mesh, ...] = ()
    lights: tuple[Light, ...] = ()
    drawn: tuple[DrawnBeams, ...] = ()
    medium: Medium | None = None
    bounds: tuple[Array, float] | None = None
    groups: frozenset[str] = frozenset()

    def looks(self) -> dict[str, Look | None]:
        """Return the looks of lights and drawn beams by their names."""
        return {light.name: light.look for light in self.lights} | {each.name: each.look for each in self.drawn}
