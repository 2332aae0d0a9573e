"""Mitsuba's sensors as cameras, so that beams can be gathered along their rays by tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import joined, taken
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array2f, Array3f, Float, UInt32, mitsuba
from ..media.discovery.surroundings import Place, name_of, named_by, place_of, place_of_sensor
from ..spectra import rgb
from .cameras import View, Window

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiFilm, MiSensor

mi = mitsuba()

# Columns and rows of the rays that find the medium around a camera.
_COARSE = (8, 8)
_PINHOLES = ("PerspectiveCamera", "ThinLensCamera")


@dataclass(frozen=True)
class PrimaryRays:
    """Primary rays of a pass, one for each pixel of the crop window, row by row.

    `near` and `far` bound the rays, and `weight` is their initial throughput. `facing` is planar depth per unit of
    distance, and `origins` and `times` are those of groups of pixels (`world.cameras.CameraRays`). All three are None
    if the sensor has no projection.
    """

    origin: Any
    direction: Any
    near: Any
    far: Any
    weight: Any
    facing: Any = None
    origins: Any = None
    times: Any = None

    @classmethod
    def joined(cls, each: Sequence[PrimaryRays]) -> PrimaryRays:
        """Return the rays of several passes as one, for estimates without tiles."""
        return cls(**joined([one._of_each_ray() for one in each]))

    def taken(self, index: UInt32) -> PrimaryRays:
        """Return the rays at an index."""
        return PrimaryRays(**taken(self._of_each_ray(), index))

    def with_more(self, more: PrimaryRays) -> PrimaryRays:
        """Return these rays followed by more of them; if there is one origin for all, both must share it."""
        shared = {"origin": None} if dr.width(self.origin) == 1 else {}
        both = joined([own._of_each_ray() | shared for own in (self, more)])
        return PrimaryRays(**(both | ({"origin": self.origin} if shared else {})), times=self.times)

    def _of_each_ray(self) -> dict[str, Any]:
        """Return the arrays, each with an entry for every ray."""
        count, names = dr.width(self.direction), ("origin", "direction", "near", "far", "weight", "facing")
        found = {name: getattr(self, name) for name in names}
        return {name: None if own is None else own + dr.zeros(type(own), count) for name, own in found.items()}


class Sensor:
    """A sensor of a Mitsuba scene.

    Attributes
    ----------
    plugin, window
        Mitsuba's sensor, and its film's size and crop window.
    view
        The camera that is given instead of the sensor, or else the sensor as a camera; None if that is neither
        perspective nor orthographic.
    """

    def __init__(self, plugin: MiSensor, camera: scene.Camera | None = None) -> None:
        self.plugin, self.window = plugin, window_of(plugin.film())
        camera = camera or camera_of(plugin)
        self.view = None if camera is None else View(camera, self.window)

    def start(self) -> Place:
        """Return where camera paths begin."""
        if self.view is None or self.view.projection.lens is not None:
            return place_of_sensor(self.plugin)
        # Kernels of the plug-in contain the size of the film.
        return place_of(name_of(self.plugin), *self.view.coarse_rays(*_COARSE), named_by(self.plugin))


def sampled_rays(
    sensor: Any, window: Window, places: Array2f, order: UInt32, samples: Samples, some: UInt32 | None = None
) -> PrimaryRays:
    """Return a ray through each pixel, or `some`, at its place in [0, 1)², as a sensor of Mitsuba's samples them.

    `order` has the pixels' numbers for their samples.
    """
    height, width = window.shape
    index, columns = dr.arange(UInt32, width * height) if some is None else some, dr.opaque(UInt32, width)
    x = (Float(index % columns) + places.x) / dr.opaque(Float, width)
    y = (Float(index // columns) + places.y) / dr.opaque(Float, height)
    aperture = samples.pair(order, Stream.LENS)
    ray, weight = sensor.sample_ray_differential(  # some sensors have no others, such as `irradiancemeter`
        Float(sensor.shutter_open()), Float(0.5), mi.Point2f(x, y), mi.Point2f(aperture), True
    )
    wide = dr.zeros(Array3f, dr.width(index))
    far = dr.minimum(ray.maxt, dr.largest(Float)) + wide.x
    return PrimaryRays(Array3f(ray.o) + wide, Array3f(ray.d) + wide, 0 * wide.x, far, rgb(weight) + wide)


def window_of(film: MiFilm) -> Window:
    """Return the size of Mitsuba's film and its crop window."""
    (width, height), (left, top), (columns, rows) = (
        map(int, each) for each in (film.size(), film.crop_offset(), film.crop_size())
    )
    return Window(width, height, (left, top, left + columns, top + rows))


def camera_of(plugin: MiSensor) -> scene.Camera | None:
    """Return a sensor as a camera with its whole film; None if it is neither perspective nor orthographic."""
    window = window_of(plugin.film())
    kind = plugin.class_name()
    orthographic = kind == "OrthographicCamera"
    if kind not in _PINHOLES and not orthographic:
        return None
    parameters = mi.traverse(plugin)
    world = np.asarray(plugin.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)[..., 0]
    lengths = np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-300)
    left, up, forward = (world[:3, :3] / lengths).T
    shift = [float(np.ravel(parameters.get(f"principal_point_offset_{axis}", 0))[0]) for axis in "xy"]
    across = 2 * lengths[0]
    if not orthographic:
        across *= np.tan(np.radians(float(np.ravel(parameters["x_fov"])[0])) / 2) / lengths[2]
    down = across * window.height / window.width
    if not np.all(np.isfinite([*world.ravel(), across])):
        name = plugin.id() or kind
        raise scene.SceneError(f"sensor {name}: its rays are not finite: expected another transform or field of view")
    to_world = np.eye(4)
    to_world[:3] = np.column_stack([-left, up, -forward, world[:3, 3]])
    lens = float(np.ravel(parameters["aperture_radius"])[0]) if kind == "ThinLensCamera" else 0.0
    focus = float(np.ravel(parameters["focus_distance"])[0]) if kind == "ThinLensCamera" else 0.0
    return scene.Camera(
        name=plugin.id() or kind, to_world=to_world, focal_length=1.0,
        horizontal_aperture=across, vertical_aperture=down,
        horizontal_offset=shift[0] * across, vertical_offset=-shift[1] * down,
        projection="orthographic" if orthographic else "perspective",
        clipping=(parameters["near_clip"], parameters["far_clip"]), lens_radius=lens, focus_distance=focus,
    )  # fmt: skip
