"""Cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .checks import Array, SceneError, numbers
from .vectors import near_one, unit

#: How the aperture and the picture are made to fit each other, named as by UsdRenderSettings: the first is the default.
CONFORM_POLICIES = (
    "expandAperture", "cropAperture", "adjustApertureWidth", "adjustApertureHeight", "adjustPixelAspectRatio",
)  # fmt: skip


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
    horizontal_offset, vertical_offset
        Offset of the film from the optical axis. Default 0.
    orthographic
        Whether the projection is orthographic. Default False, which is perspective.
    clipping
        Near and far distance along the optical axis. Default 1e-3 and 1e6.
    lens_radius, focus_distance
        Radius of a thin lens, and the distance along the optical axis at which it is in focus. Default 0, a pinhole.
    exposure_scale
        A factor on all light that the camera sees. Default 1.

    Examples
    --------
    >>> camera = pb.scene.Camera.look_at(origin=(0, 1, 5), target=(0, 1, 0), fov=60)
    >>> camera.to_world[:3, 3]
    array([0., 1., 5.])
    >>> round(camera.horizontal_aperture / camera.vertical_aperture, 3)
    1.778
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "to_world", numbers(self.to_world, f"camera {self.name}: to_world", "4 x 4 numbers"))

    @classmethod
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
        if not 0 < fov < 180 or not aspect > 0:
            raise SceneError(f"camera {name}: fov is {fov}, aspect {aspect}: expected 0 < fov < 180 and aspect > 0")
        to_world = np.eye(4)
        to_world[:3] = np.column_stack([unit(side), unit(np.cross(back, side)), unit(back), places[0]])
        width = 2 * cls.focal_length * float(np.tan(np.radians(fov) / 2))
        return cls(name, to_world, horizontal_aperture=width, vertical_aperture=width / aspect)
