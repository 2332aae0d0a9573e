"""Cameras, and the filters of their films."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .checks import Array, SceneError
from .vectors import unit

#: Pixel filters, by the names of Mitsuba's plug-ins.
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")


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

    @classmethod
    def look_at(
        cls, origin: Sequence[float] | Array, target: Sequence[float] | Array,
        up: Sequence[float] | Array = (0.0, 1.0, 0.0), fov: float = 40.0, aspect: float = 16 / 9, name: str = "camera",
    ) -> Camera:  # fmt: skip
        """Return a pinhole camera at a point that looks at another one, `fov` degrees wide.

        `aspect` is its width over its height.

        Raises
        ------
        SceneError
            Points that are the same or not finite, `up` along the line of sight, a width not between 0 and 180 degrees.
        """
        places = np.array([origin, target, up], dtype=np.float64)
        back = places[0] - places[1]
        side = np.cross(places[2], back)
        if not np.linalg.norm(side) > 0 or not np.isfinite(np.linalg.norm(side)):
            raise SceneError(f"camera {name}: expected two different points, and up across the line between them")
        if not 0 < fov < 180 or not aspect > 0:
            raise SceneError(f"camera {name}: fov is {fov}, aspect {aspect}: expected 0 to 180 degrees, and above 0")
        to_world = np.eye(4)
        to_world[:3] = np.column_stack([unit(side), unit(np.cross(back, side)), unit(back), places[0]])
        width = 2 * cls.focal_length * float(np.tan(np.radians(fov) / 2))
        return cls(name, to_world, horizontal_aperture=width, vertical_aperture=width / aspect)
