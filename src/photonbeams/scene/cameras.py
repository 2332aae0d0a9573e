"""Cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from .checks import Array, Finite, NotNegative, SceneError, Transform, array, choice, number, numbers, shown
from .declared import arguments
from .vectors import near_one, unit

#: How the aperture and the picture are made to fit each other, named as by UsdRenderSettings: the first is the default.
CONFORM_POLICIES = (
    "expandAperture", "cropAperture", "adjustApertureWidth", "adjustApertureHeight", "adjustPixelAspectRatio",
)  # fmt: skip

#: The projections of fisheyes: how far from the middle of the film, in focal lengths, an angle from the axis is seen.
FISHEYES: Mapping[str, Callable[[float], float]] = {
    "fisheyeEquidistant": lambda angle: angle,
    "fisheyeEquisolid": lambda angle: 2 * float(np.sin(angle / 2)),
    "fisheyeStereographic": lambda angle: 2 * float(np.tan(angle / 2)),
    "fisheyeOrthographic": lambda angle: float(np.sin(angle)),
}
#: A panorama whose columns are longitudes and whose rows are latitudes (lat-long).
EQUIRECTANGULAR = "equirectangular"
#: All projections.
PROJECTIONS = ("perspective", "orthographic", EQUIRECTANGULAR, *FISHEYES)

_Length = Annotated[float, partial(number, minimum=1e-37)]


def _clipping(value: object, name: str) -> tuple[float, float]:
    near, far = array(value, name, "two finite numbers, the nearer one first", (2,)).tolist()
    if not near < far:
        raise SceneError(f"{name} is {shown(value)}: expected two finite numbers, the nearer one first")
    return near, far


@dataclass(frozen=True)
class Camera:
    """A camera as UsdGeomCamera describes it, with all lengths in scene units.

    Attributes
    ----------
    name
        Prim path, for messages and for an EXR's header.
    to_world
        (4, 4) rigid transform for column vectors; the camera looks along its −Z, +Y is up.
    focal_length
        Default 5.
    horizontal_aperture, vertical_aperture
        Width and height of the film; for an orthographic camera those of the view. Default 2.0955 and 1.52908.
        Divided by the focal length, they are the angles of an equirectangular camera in radians.
    horizontal_offset, vertical_offset
        Offset of the film from the optical axis. Default 0.
    projection
        One of `scene.cameras.PROJECTIONS`. Default "perspective".
    clipping
        Near and far distance along the optical axis, or along each ray of a panorama. Default 1e-3 and 1e6.
    lens_radius, focus_distance
        Radius of a thin lens, and the distance along the optical axis at which it is in focus. Default 0, a pinhole.
    exposure_scale
        A factor on all light that the camera sees. Default 1.
    angle
        Degrees that a panoramic camera sees in all: beyond a fisheye's the picture is black. Default 180.

    Examples
    --------
    >>> camera = pb.scene.Camera.look_at(origin=(0, 1, 5), target=(0, 1, 0), fov=60)
    >>> camera.to_world[:3, 3]
    array([0., 1., 5.])
    >>> round(camera.horizontal_aperture / camera.vertical_aperture, 3)
    1.778
    """

    called = "camera {name}: {field}"

    name: str
    to_world: Transform
    focal_length: _Length = 5.0
    horizontal_aperture: _Length = 2.0955
    vertical_aperture: _Length = 1.52908
    horizontal_offset: Finite = 0.0
    vertical_offset: Finite = 0.0
    projection: Annotated[str, partial(choice, choices=PROJECTIONS)] = PROJECTIONS[0]
    clipping: Annotated[tuple[float, float], _clipping] = (1e-3, 1e6)
    lens_radius: NotNegative = 0.0
    focus_distance: float = 0.0
    exposure_scale: NotNegative = 1.0
    angle: Annotated[float, partial(number, minimum=1e-6, maximum=360.0)] = 180.0

    @property
    def orthographic(self) -> bool:
        """Whether rays are parallel."""
        return self.projection == "orthographic"

    @property
    def panoramic(self) -> bool:
        """Whether straight lines are seen curved: a fisheye, or an equirectangular camera."""
        return self.projection == EQUIRECTANGULAR or self.projection in FISHEYES

    @property
    def rim(self) -> float:
        """How far from the middle of the film a fisheye sees, in focal lengths."""
        return FISHEYES[self.projection](np.radians(self.angle) / 2)

    @classmethod
    @arguments
    def panorama(
        cls, name: str, to_world: Array, projection: str = EQUIRECTANGULAR, field: Sequence[float] = (), **given: Any
    ) -> Camera:
        """Return an equirectangular or a fisheye camera.

        Parameters
        ----------
        name, to_world, projection
            As for `Camera`.
        field
            Degrees that it sees across and down through the middle of its film: up to 360 and 180 of an equirectangular
            camera, which are the default; up to 360 of a fisheye, by default 180, which is a circle. The larger one is
            a fisheye's `angle`.
        **given
            Other attributes of `Camera`.

        Raises
        ------
        SceneError
            Another projection; a field of 0 or less, or more than the projection can show.

        Examples
        --------
        >>> dome = pb.scene.Camera.panorama("dome", np.eye(4), "fisheyeEquidistant", (180, 180))
        >>> dome.horizontal_aperture == dome.vertical_aperture
        True
        """
        fisheye = FISHEYES.get(choice(projection, f"camera {name}: projection", (EQUIRECTANGULAR, *FISHEYES)))
        # Half of the sphere is all that sin shows, and tan has no end at the back.
        wide = {"fisheyeOrthographic": 180.0, "fisheyeStereographic": 350.0}.get(projection, 360.0)
        most = (360.0, 180.0) if fisheye is None else (wide, wide)
        field = tuple(field) or ((180.0, 180.0) if fisheye else most)
        if len(field) != 2 or not all(0 < own <= end for own, end in zip(field, most, strict=True)):
            text = f"expected two angles above 0, up to {most[0]:g} and {most[1]:g} degrees"
            raise SceneError(f"camera {name}: field of view is {shown(field)}: {text}")
        half = fisheye or (lambda angle: angle)
        width, height = (float(2 * half(np.radians(own) / 2)) for own in field)
        return cls(
            name, to_world, focal_length=1.0, horizontal_aperture=width, vertical_aperture=height,
            projection=projection, angle=max(field) if fisheye else field[0], **given,
        )  # fmt: skip

    @classmethod
    @arguments
    def look_at(
        cls, origin: Sequence[float] | Array, target: Sequence[float] | Array,
        up: Sequence[float] | Array = (0.0, 1.0, 0.0), fov: float = 40.0, aspect: float = 16 / 9, name: str = "camera",
    ) -> Camera:  # fmt: skip
        """Return a pinhole camera at one point that looks at another.

        Parameters
        ----------
        origin, target
            (3,) positions of the camera, and of what is in the middle of its view.
        up
            (3,) direction that is upward in the picture. Default: +Y.
        fov
            Horizontal field of view in degrees, more than 0 and less than 180. Default 40.
        aspect
            Width of the picture over its height. Default 16 / 9.
        name
            The camera's name.

        Raises
        ------
        SceneError
            Points that are equal or not finite, `up` along the line of sight, a field of view or an aspect out of
            range.
        """
        places = numbers([origin, target, up], f"camera {name}", "an origin, a target and an up of 3 numbers")
        places = places.astype(np.float64)
        back = near_one(places[0] - places[1])
        side = np.cross(near_one(places[2]), back)
        if not np.linalg.norm(side) > 0 or not np.isfinite(np.linalg.norm(side)):
            raise SceneError(f"camera {name}: expected two different points, and up not along the line between them")
        if not 0 < fov < 180 or not 0 < aspect < np.inf:
            raise SceneError(f"camera {name}: fov is {fov}, aspect {aspect}: expected 0 < fov < 180 and aspect > 0")
        to_world = np.eye(4)
        to_world[:3] = np.column_stack([unit(side), unit(np.cross(back, side)), unit(back), places[0]])
        width = 2 * cls.focal_length * float(np.tan(np.radians(fov) / 2))
        return cls(name, to_world, horizontal_aperture=width, vertical_aperture=width / aspect)
