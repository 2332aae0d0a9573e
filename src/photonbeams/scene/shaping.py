"""What forms the light of a lamp: a cone, a focus, an angular profile, and images that it shines through."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from .checks import BLACK, Array, Finite, NotNegative, SceneError, Tint, Vector, numbers, rgb
from .profiles import Profile
from .surfaces import Mesh

_UP: Any = (0.0, 1.0, 0.0)


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
    20.0
    """

    cone_angle: NotNegative = 90.0
    cone_softness: NotNegative = 0.0
    focus: NotNegative = 0.0
    focus_tint: Tint = BLACK
    profile: Profile | None = None


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
    over
        The flat mesh over whose bounding rectangle an image on a portal lies: one of several openings. None, the
        default: the portal.
    seen
        Whether an image on a portal is a pane there, which pictures show and which colors all light that passes it:
        see `Light.windows`. False, the default: the light of its own lamp alone passes through it, unseen.

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

    image: Annotated[Array, partial(numbers, expected="rows, columns and channels")]
    angle: Finite | None = None
    width: Finite = 1.0
    repeat: bool = False
    up: Vector = _UP
    over: Mesh | None = None
    seen: bool = False

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or not self.image.size:
            raise SceneError(f"an image has the shape {self.image.shape}: expected rows, columns and channels")
        if self.angle is not None and not 0 < self.angle < 180:
            raise SceneError(f"angle is {self.angle:g}: expected more than 0 and less than 180 degrees")
        if not self.width > 0:
            raise SceneError(f"width is {self.width:g}: expected a number above 0")

    @property
    def aspect(self) -> float:
        """The image's height over its width; pixels are square."""
        return self.image.shape[0] / self.image.shape[1]

    @property
    def colors(self) -> Array:
        """The image's colours, (H, W, 3)."""
        return rgb(self.image)
