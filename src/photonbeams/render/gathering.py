"""What camera paths see of the beams of a pass: the pixels' own rays by tiles, all other segments by a grid."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ..beams import Beams
from ..estimators.estimate import ENDLESS, estimate_rays
from ..estimators.geometry import Rays
from ..estimators.image import PixelRays, estimate_image
from ..estimators.points import Points
from ..numerics.arrays import compressed, joined
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..transport.beams import Lit
from ..world.media import Media, RenderedMedium
from ..world.sensors import Primary, Sensor
from . import camera_paths as eye
from .passes import Statistics

# Segments beside the pixels' own rays that are kept for one look into the grid, which takes as long to build as to ask.
_MOST = 1 << 22


class Apart:
    """Segments of camera paths in media behind mirrors and glass."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "origin": Array3f, "direction": Array3f, "far": Float, "throughput": Array3f, "medium": UInt32,
        "pixel": UInt32, "events": UInt32, "seed": UInt32,
    }  # fmt: skip

    origin: Any
    direction: Any
    far: Any
    throughput: Any
    medium: Any
    pixel: Any
    events: Any
    seed: Any

    @classmethod
    def of(cls, sight: eye.Sight, seen: eye.Seen) -> Apart:
        """Return the segments of one step."""
        result = cls()
        result.origin, result.direction = sight.origin + sight.near * sight.direction, sight.direction
        result.far = dr.minimum(seen.end, ENDLESS) - sight.near
        result.throughput, result.medium, result.pixel = sight.throughput, sight.medium, sight.pixel
        result.events, result.seed = sight.events, seen.seed
        return result


class Gathering:
    """The beams' radiance toward pixels, over the steps of a pass.

    Parameters
    ----------
    sensor, volumes
        Whose rays, and through which media.
    light
        The beams, by the numbers of media.
    max_depth
        The longest path in edges, None for any.
    estimator, points, statistics
        As for `estimate_image`; where tests are counted.
    """

    def __init__(
        self, sensor: Sensor, volumes: Media, light: dict[int, Lit], max_depth: int | None, estimator: str,
        points: Points, statistics: Statistics,
    ) -> None:  # fmt: skip
        self._view = None if sensor.view is None else sensor.view.projection
        self._volumes = [each for each in volumes.all if each.number in light]
        self._light, self._max_depth = light, max_depth
        self._estimator, self._points, self._statistics = estimator, points, statistics
        self.radiance = dr.zeros(Array3f, sensor.width * sensor.height)
        self._steps: list[Apart] = []

    def add(self, primary: Primary, sight: eye.Sight, seen: eye.Seen) -> None:
        """Add the segments of one step of camera paths."""
        inside = sight.alive & (sight.medium > 0) & (seen.end > sight.near)
        tiled = inside & sight.primary & Bool(self._view is not None)
        others = inside & ~tiled
        dr.eval(tiled, others)
        for volume in self._volumes:
            own = tiled & (sight.medium == dr.opaque(UInt32, volume.number))
            if self._view is not None and bool(dr.any(own)):
                self._add_tiled(volume, primary, sight, seen, own)
        self._steps += compressed(others, Apart.of(sight, seen))
        if sum(dr.width(each.pixel) for each in self._steps) > _MOST:
            self.finish()

    def _add_tiled(self, volume: RenderedMedium, primary: Primary, sight: eye.Sight, seen: eye.Seen, own: Bool) -> None:
        volume.track(sight.origin, sight.direction, sight.near, seen.end, seen.seed, own)
        rays = PixelRays(
            primary.origin, primary.direction, primary.facing, dr.select(own, dr.minimum(seen.end, ENDLESS), 0),
            dr.select(own, sight.near, 0), primary.lanes,
        )  # fmt: skip
        dr.eval(rays.t_max, rays.t_min)
        assert self._view is not None
        part = estimate_image(
            self._light[volume.number].beams, self._view, rays, look=volume.look, medium=volume.medium,
            estimator=self._estimator, points=self._points,
        )  # fmt: skip
        self.radiance = self.radiance + dr.select(own, part.radiance * sight.throughput, 0)
        dr.eval(self.radiance)
        self._statistics.tests += part.billboard_tests + part.frustum_tests

    def finish(self) -> None:
        """Add what was kept for the grid."""
        if not self._steps:
            return
        widths = [dr.width(each.pixel) for each in self._steps]
        apart = joined(self._steps)
        found = dr.zeros(Array3f, sum(widths))
        for volume in self._volumes:
            own = apart.medium == dr.opaque(UInt32, volume.number)
            for lanes, beams in self._pairs(volume, apart, own):
                dr.scatter(found, self._grid(volume, beams, apart, lanes), lanes)
        first = 0
        for step, width in zip(self._steps, widths, strict=True):  # in turn: a pixel has one path, but several segments
            here = dr.gather(Array3f, found, dr.arange(UInt32, width) + dr.opaque(UInt32, first))
            dr.scatter_add(self.radiance, here * step.throughput, step.pixel)
            dr.eval(self.radiance)
            first += width
        self._steps = []

    def _pairs(self, volume: RenderedMedium, apart: Apart, own: Bool) -> list[tuple[Any, Beams]]:
        """Return lanes and the beams that they see: all, unless together they would be longer than paths may be."""
        light = self._light[volume.number]
        lanes: Any = dr.compress(own)
        if not len(lanes):
            return []
        if self._max_depth is None:
            return [(lanes, light.beams)]
        result = []
        for events in np.unique(dr.gather(UInt32, apart.events, lanes).numpy()):
            beams = light.up_to(self._max_depth - 2 - int(events))
            if beams is not None:
                result.append((dr.compress(own & (apart.events == dr.opaque(UInt32, int(events)))), beams))
        return result

    def _grid(self, volume: RenderedMedium, beams: Beams, apart: Apart, lanes: Any) -> Any:
        count = len(lanes)
        origin, direction = (dr.gather(Array3f, each, lanes) for each in (apart.origin, apart.direction))
        far = dr.gather(Float, apart.far, lanes)
        rays = Rays(origin, direction, far, dr.zeros(Float, count), index=dr.arange(UInt32, count))
        dr.eval(rays.origin, rays.direction, rays.t_max, rays.t_min)
        seed = dr.gather(UInt32, apart.seed, lanes)
        volume.track(origin, direction, rays.t_min, far, seed, dr.full(Bool, True, count))
        return estimate_rays(
            beams, rays, look=volume.look, medium=volume.medium, estimator=self._estimator, points=self._points
        )
