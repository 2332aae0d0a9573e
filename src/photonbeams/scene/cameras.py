"""Cameras, and the filters of their films."""

from __future__ import annotations

from dataclasses import dataclass

from .checks import Array

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
