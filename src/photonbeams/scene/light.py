"""What all kinds of lights have in common."""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Real
from typing import NamedTuple

import numpy as np

from .beam_settings import BeamSettings
from .checks import BLACK, IDENTITY, Array, Frame, NotNegative, SceneError, Tint, shown
from .profiles import Profile
from .shaping import Gobo, Shaping
from .surfaces import Material, Mesh, UVTexture
from .vectors import Sides, unit

_WIDEST_CONE = 85.0  # degrees from the axis: a wider cone has no slide that covers it
_WIDE_SLIDE = 90.0  # degrees: the width of a slide before a light with a wider cone, or none


class SlidePlace(NamedTuple):
    """Where a light's gobo is: its centre, its sides to the right and upward, and the direction of light, (3,) each."""

    center: Array
    right: Array
    up: Array
    ahead: Array


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
    unlit_media
        Names of media that the light passes unseen: they dim it, but scatter nothing of what comes straight from it.
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

    called = "{name}: {field}"

    name: str
    radiance: Tint
    shaping: Shaping | None = None
    portal: Mesh | None = field(default=None, kw_only=True)
    surface_scale: NotNegative = 1.0
    shadow_distance: float = np.inf
    shadow_color: Tint = BLACK
    seen: bool = True
    frame: Frame = IDENTITY
    unlit: frozenset[str] = frozenset()
    unshadowed: frozenset[str] = frozenset()
    unlit_media: frozenset[str] = frozenset()
    guides: tuple[Array, ...] = ()

    @property
    def shines(self) -> bool:  # type: ignore[override]
        """Whether the light is not black."""
        return max(self.radiance) > 0

    @property
    def lights_surfaces(self) -> bool:  # type: ignore[override]
        """Whether the light shines on surfaces."""
        return self.surface_scale > 0

    @property
    def profile(self) -> Profile | None:
        """The profile of its shaping, which is None for lights that are infinitely far away."""
        return None if self.shaping is None else self.shaping.profile

    @property
    def points(self) -> Array:
        """Points, (N, 3), whose box contains the light; none for lights that are infinitely far away."""
        return np.zeros((0, 3))

    def slide(self, gobo: Gobo) -> SlidePlace | None:
        """Return where the slide `gobo` is before the light; None if the light can have none."""
        return None

    def on_portal(self, gobo: Gobo, sides: Sides) -> SlidePlace:
        """Return where the image `gobo` is over an opening of these `sides`, upright if one faces the light."""
        corner, *edges = sides
        center = corner + 0.5 * (edges[0] + edges[1])
        steep = [abs(edge @ gobo.up) / np.linalg.norm(edge) for edge in edges]
        y, x = (edges[0], edges[1]) if steep[0] > steep[1] else (edges[1], edges[0])
        y = y if y @ gobo.up >= 0 else -y
        normal = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
        place, axis = getattr(self, "center", None), getattr(self, "axis", None)
        ahead = center - place if place is not None else np.asarray(axis) if axis is not None else normal
        if normal @ ahead < 0:  # with x to the right and y up, x × y points at the viewer, as the light does
            x, normal = -x, -normal
        return SlidePlace(center, x, y, normal)

    def windows(self) -> tuple[Mesh, ...]:
        """Return panes of glass for the images on the portal that pictures show, each over its opening."""
        result = []
        for gobo in self.portal_gobos:
            opening = gobo.over or self.portal
            sides = opening.rectangle() if opening is not None and gobo.seen else None
            if opening is not None and sides is not None:
                place = self.on_portal(gobo, sides)
                to_image = np.linalg.pinv(np.array([place.right, place.up]))
                image = UVTexture(gobo.colors.astype(np.float32), "clamp")
                places = (opening.points - place.center) @ to_image + 0.5
                glass = Material(roughness=0.0, opacity=0.0, ior=1.0, thin=True, tint=image)
                # Portals are left out of the world, by their names.
                result.append(Mesh(f"{opening.name}/pane", opening.points, opening.faces, uvs=places, material=glass))
        return tuple(result)

    @property
    def slide_angle(self) -> float:
        """The angle that the width of the light's slide covers, in degrees: the slide's own, or the light's cone."""
        if self.gobo is not None and self.gobo.angle is not None:
            return self.gobo.angle
        cone = self.shaping.cone_angle if self.shaping is not None else np.inf
        return 2 * cone if 0 < cone < _WIDEST_CONE else _WIDE_SLIDE

    @property
    def spread(self) -> float:
        """The angle from the axis, in radians, beyond which the light's slide is black."""
        if self.gobo is None:
            return np.pi
        if self.gobo.repeat:
            return np.pi / 2
        half = np.tan(np.radians(self.slide_angle) / 2)
        return float(np.arctan(half * np.hypot(1.0, self.gobo.aspect)))

    def _slide_axes(self) -> tuple[Array, Array, Array]:
        """Return the vectors to the side, up and ahead: those of the light's frame, made square to its axis."""
        axis = self.axis  # type: ignore[attr-defined]
        ahead = unit(axis)
        frame = np.asarray(self.frame, dtype=np.float64)[:3, :3]
        up = frame[:, 1] - (frame[:, 1] @ ahead) * ahead
        if np.linalg.norm(up) < 1e-6:
            up = -frame[:, 2] + (frame[:, 2] @ ahead) * ahead
        up /= np.linalg.norm(up)
        return np.cross(ahead, up) * np.sign(np.linalg.det(frame)), up, ahead

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.shadow_distance, Real) and self.shadow_distance > 0):
            text = f"shadow_distance is {shown(self.shadow_distance)}: expected a number above 0"
            raise SceneError(f"{self.name}: {text}")
