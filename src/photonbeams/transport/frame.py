"""A picture of a Mitsuba scene: the mean of passes, each with its own light paths and camera paths.

Radii shrink from pass to pass by R_{i+1} / R_i = (i + α) / (i + 1), so that bias and variance both vanish (Progressive
Photon Beams, Jarosz et al. 2011). Memory is that of one pass, however many there are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..arrays import to_float
from ..beams import Beams
from ..device import Array3f, Bool, Float, UInt32, mitsuba
from ..estimators.estimate import DEFAULT_RULE, ENDLESS, check_estimator, estimate_rays
from ..estimators.geometry import Rays
from ..estimators.image import PixelRays, estimate_image
from ..estimators.points import Points
from ..quadrature import Rule
from ..render.frame import OVERLAP, Statistics, subpixel
from ..simulation.sampling import z_order
from . import eye, paths
from .beams import Lit, lit
from .emission import Emitted, Emitters
from .footprints import Limits
from .guiding import Watch
from .photons import Arrived, translucent
from .samples import Samples
from .sensors import Primary, Sensor
from .tracking import Track
from .volumes import Volume, Volumes, number, parts

mi = mitsuba()

# Least and greatest radius in units of the scene's radius.
FLOOR, CEILING = 1e-4, 0.05
# How far light goes that leaves the scene, in units of its radius.
ESCAPE = 8.0
# Greatest radius of a scene: the squares and cubes of what is longer are beyond the numbers that there are.
LARGEST = 1e9


@dataclass(frozen=True)
class Settings:
    """How a Mitsuba scene is rendered.

    Attributes
    ----------
    passes, time_limit, seed
        Number of passes; seconds after which no further one is begun (None: no limit); seed of all samples.
    paths
        Light paths a pass.
    max_depth, rr_depth, hide_emitters
        As Mitsuba's `volpath` has them: the longest path in edges (None: any), the events after which Russian roulette
        begins, whether the camera sees emitters.
    radius
        Radius of all beams in the first pass; None: from photon differentials, between `min_radius` and `max_radius`
        (None: 1e-4 and 0.05 of the scene's radius).
    overlap
        Width of beams in spacings of their neighbours.
    alpha
        How fast radii shrink; 1 is not at all.
    guiding
        Whether a pilot pass learns where light comes from that the camera sees, to send more light paths from there.
    short
        Whether beams end at their path's next event, instead of the next surface.
    estimator, rule
        "auto", "billboard" or "frustum", and the frustum's quadrature.
    surfaces
        Whether surfaces are shaded; if not, there are beams alone.
    """

    passes: int = 16
    time_limit: float | None = None
    seed: int = 0
    paths: int = 1 << 14
    max_depth: int | None = None
    rr_depth: int = 5
    hide_emitters: bool = False
    radius: float | None = None
    min_radius: float | None = None
    max_radius: float | None = None
    overlap: float = OVERLAP
    alpha: float = 0.7
    guiding: bool = True
    short: bool = False
    estimator: str = "auto"
    rule: Rule = DEFAULT_RULE
    surfaces: bool = True

    def __post_init__(self) -> None:
        check_estimator(self.estimator)
        for name, most in (("passes", 2**31 - 1), ("paths", 100_000_000), ("rr_depth", 2**31 - 1)):
            if not 1 <= getattr(self, name) <= most:
                raise scene.SceneError(f"{name} is {getattr(self, name)}: expected 1 to {most}")
        if self.max_depth is not None and not 0 <= self.max_depth < 2**31:
            raise scene.SceneError(f"max_depth is {self.max_depth}: expected -1, for any, or 0 to {2**31 - 1}")
        for name in ("radius", "min_radius", "max_radius", "time_limit", "overlap"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise scene.SceneError(f"{name} is {value}: expected a number above 0")
        if not 0 < self.alpha <= 1:
            raise scene.SceneError(f"alpha is {self.alpha}: expected a number above 0, of at most 1")


class Frame:
    """The sums over the passes of one sensor's picture."""

    def __init__(self, plugin: Any, sensor: Any, settings: Settings) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._plugin, self.sensor = plugin, Sensor(sensor)
        with self.statistics.phase("build"):
            self._volumes = Volumes.of(plugin)
            self._emitters = Emitters(plugin, settings.seed)
        self._otherwise = dr.opaque(UInt32, number(_everywhere(plugin, sensor)))
        self._radius = _radius(plugin)
        if settings.guiding and self.sensor.view is not None:
            with self.statistics.phase("guide"):
                self._emitters.learn(self._importance)
        self._points, self._translucent = Points(settings.rule), translucent(plugin)
        self._sums = Sums(self.sensor)

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        settings, statistics = self.settings, self.statistics
        samples = Samples(settings.seed, number)
        with statistics.phase("trace"):
            sets, landed, limits = self.simulated(number)
            most = None if settings.max_depth is None else settings.max_depth - 2
            arrived = Arrived(landed, limits, most, self._translucent)
        statistics.beams += sum(len(each.beams) for each in sets.values())
        looking = eye.Looking(
            self._plugin, self._volumes, settings.max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces,
        )  # fmt: skip
        offset = subpixel(number)
        primary = self.sensor.rays(offset, self._sums.order, samples)
        sight = eye.begin(looking, primary, self._sums.order, self._otherwise)
        picture = Picture(self.sensor.width * self.sensor.height)
        steps = eye.follow(looking, sight, samples, arrived)
        while True:
            with statistics.phase("surfaces"):
                following = next(steps, None)
            if following is None:
                break
            sight, seen = following
            picture.add_surfaces(sight, seen)
            with statistics.phase("beams"):
                for volume in self._volumes.all:
                    if volume.number in sets:
                        self._gather(volume, sets[volume.number], primary, sight, seen, picture)
        self._sums.add(picture, offset)
        statistics.passes += 1
        statistics.count_kernels()

    def error(self) -> float:
        """Return the relative standard error of the mean so far, the median over the pixels that have light.

        From the passes' own differences, as if they were independent; they continue low-discrepancy sequences, so it
        tends to be less. NaN before there are two.
        """
        return self._sums.error(self.statistics.passes)

    def state(self) -> dict[str, np.ndarray]:
        """Return the sums so far, from which another frame of the same scene and settings can go on."""
        return {**self._sums.state(), "passes": np.array(self.statistics.passes)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the sums of another frame; raises SceneError where they are not of such a picture."""
        self._sums.restore(state)
        self.statistics.passes = int(state["passes"])

    def _importance(self, emitted: list[Emitted]) -> np.ndarray:
        """Return how much of light paths is seen."""
        assert self.sensor.view is not None
        watch = Watch(self._plugin, self._volumes, self.sensor.view.projection)
        tracing = self._tracing()
        count = sum(dr.width(each.origin) for each in emitted)
        result = np.zeros(count)
        begun = paths.begin(tracing, emitted, self._otherwise)
        for segments, landed in paths.trace(tracing, begun, dr.opaque(UInt32, 1), dr.opaque(UInt32, 0)):
            result += watch.importance(segments, landed if self.settings.surfaces else None, count)
        return result

    def _tracing(self) -> paths.Tracing:
        """Return how light paths are traced."""
        settings = self.settings
        densest = max((max(each.medium.extinction) for each in self._volumes.all), default=0.0)
        most = None if settings.max_depth is None else settings.max_depth - 2
        return paths.Tracing(
            self._plugin, self._volumes, most, settings.rr_depth, settings.overlap,
            min(self._radius, 1 / max(densest, 1e-12)), ESCAPE * self._radius, settings.short,
        )  # fmt: skip

    def simulated(self, number: int) -> tuple[dict[int, Lit], list[paths.Landed], Limits]:
        """Return the beams of pass `number`, by the numbers of media, its photons on surfaces, and bounds of radii."""
        settings = self.settings
        shrunk = float(np.prod([(i + settings.alpha) / (i + 1) for i in range(1, number + 1)]))
        low = settings.radius or settings.min_radius or FLOOR * self._radius
        high = settings.radius or settings.max_radius or max(CEILING * self._radius, low)
        limits = Limits(*(dr.opaque(Float, each) for each in (low, high, shrunk)))
        tracing = self._tracing()
        emitted = self._emitters.emit(settings.paths, number)
        first = dr.opaque(UInt32, (number * settings.paths) & 0xFFFFFFFF)
        begun = paths.begin(tracing, emitted, self._otherwise)
        steps = list(paths.trace(tracing, begun, dr.opaque(UInt32, settings.seed & 0xFFFFFFFF), first))
        segments = [each for each, _ in steps if each is not None]
        bright = [volume for volume in self._volumes.all if max(volume.medium.scattering) > 0]
        found = {volume.number: lit(volume, segments, limits) for volume in bright}
        result = {own: each for own, each in found.items() if each is not None}
        dr.eval(result)
        landed = [each for _, each in steps if each is not None] if settings.surfaces else []
        return result, landed, limits

    def _gather(
        self, volume: Volume, light: Lit, primary: Primary, sight: eye.Sight, seen: eye.Seen, picture: Picture
    ) -> None:
        """Add the beams of a medium toward the segments of camera paths in it."""
        inside = sight.alive & (sight.medium == dr.opaque(UInt32, volume.number)) & (seen.end > sight.near)
        tiled = inside & sight.primary & Bool(self.sensor.view is not None)
        others = inside & ~tiled
        dr.eval(tiled, others)
        settings = self.settings
        if bool(dr.any(tiled)):
            if volume.tracked is not None:
                way = volume.way(sight.origin, sight.direction, sight.near, seen.end, seen.seed)
                volume.tracked.track = Track(way, volume.extinction, tiled)
            view = self.sensor.view
            assert view is not None
            rays = PixelRays(
                primary.origin, primary.direction, primary.facing,
                dr.select(tiled, dr.minimum(seen.end, ENDLESS), 0), dr.select(tiled, sight.near, 0), primary.lanes,
            )  # fmt: skip
            dr.eval(rays.t_max, rays.t_min)
            part = estimate_image(
                light.beams, view.projection, rays, look=volume.look, medium=volume.medium,
                estimator=settings.estimator, points=self._points,
            )  # fmt: skip
            picture.beams += dr.select(tiled, part.radiance * sight.throughput, 0)
            self.statistics.tests += part.billboard_tests + part.frustum_tests
        for lanes, beams in self._apart(others, sight, light):
            self._gather_others(volume, beams, sight, seen, lanes, picture)
        dr.eval(picture.beams)

    def _apart(self, others: Bool, sight: eye.Sight, light: Lit) -> Iterator[tuple[Any, Beams]]:
        """Yield lanes and the beams that they see: all, unless together they would be longer than paths may be."""
        lanes: Any = dr.compress(others)
        if not len(lanes):
            return
        if self.settings.max_depth is None:
            yield lanes, light.beams
            return
        for events in np.unique(dr.gather(UInt32, sight.events, lanes).numpy()):
            beams = light.up_to(self.settings.max_depth - 2 - int(events))
            lanes = dr.compress(others & (sight.events == dr.opaque(UInt32, int(events))))
            if beams is not None:
                yield lanes, beams

    def _gather_others(
        self, volume: Volume, beams: Beams, sight: eye.Sight, seen: eye.Seen, index: Any, picture: Picture
    ) -> None:
        start = dr.gather(Float, sight.near, index)
        direction = dr.gather(Array3f, sight.direction, index)
        origin = dr.gather(Array3f, sight.origin, index) + start * direction
        far = dr.minimum(dr.gather(Float, seen.end, index), ENDLESS) - start
        rays = Rays(origin, direction, far, dr.zeros(Float, len(index)), index=dr.arange(UInt32, len(index)))
        if volume.tracked is not None:
            way = volume.way(origin, direction, rays.t_min, far, dr.gather(UInt32, seen.seed, index))
            volume.tracked.track = Track(way, volume.extinction, dr.full(Bool, True, len(index)))
        dr.eval(rays.origin, rays.direction, rays.t_max, rays.t_min)
        radiance = estimate_rays(
            beams, rays, look=volume.look, medium=volume.medium, estimator=self.settings.estimator, points=self._points
        )
        self.statistics.tests += len(beams) * len(index)
        throughput, pixel = dr.gather(Array3f, sight.throughput, index), dr.gather(UInt32, sight.pixel, index)
        dr.scatter_add(picture.beams, radiance * throughput, pixel)  # a pixel has one path, so there is no race

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers, (H, W, C) float32: means over the passes, through the film's reconstruction filter."""
        return self._sums.layers()


def _radius(plugin: Any) -> float:
    """Return the radius of a scene, 1 of one that is a point or nothing."""
    box = plugin.bbox()
    if not box.valid():
        return 1.0
    low, high = (np.ravel(np.asarray(each, dtype=float)) for each in (box.min, box.max))
    size = float(np.linalg.norm(high - low) / 2)
    if not size <= LARGEST:
        raise scene.SceneError(f"the scene has a radius of {size:g} units: expected {LARGEST:g} at most")
    return size or 1.0


def _everywhere(plugin: Any, sensor: Any) -> Any:
    """Return the medium that fills the whole space: what sensor or emitters name, and no shape has inside."""
    bounded = {number(each.interior_medium()) for each in parts(plugin, mi.Shape)}
    named = [each.get_medium() for each in (sensor, *plugin.emitters())]
    return next((each for each in named if each is not None and number(each) not in bounded), None)


class Picture:
    """What one pass sees, by pixels."""

    def __init__(self, count: int) -> None:
        self.beams, self.surface = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.depth = dr.zeros(Float, count), dr.full(Float, dr.inf, count)

    def add_surfaces(self, sight: eye.Sight, seen: eye.Seen) -> None:
        """Add what paths see of surfaces in one step."""
        dr.scatter_add(self.surface, seen.radiance, sight.pixel, sight.alive)
        first = sight.alive & sight.primary & seen.solid
        dr.scatter(self.alpha, Float(1), sight.pixel, first)
        dr.scatter(self.depth, seen.end, sight.pixel, first)
        dr.eval(self.surface, self.alpha, self.depth)


_SUMS = ("surface", "beams", "alpha", "weight", "light", "squares", "depth")


class Sums:
    """The weighted sums over passes of a picture, through the film's reconstruction filter."""

    def __init__(self, sensor: Sensor) -> None:
        self._filter, self._shape = sensor.film.rfilter(), (sensor.height, sensor.width)
        count = sensor.width * sensor.height
        index, columns = dr.arange(UInt32, count), dr.opaque(UInt32, sensor.width)
        left, top = (int(each) for each in sensor.film.crop_offset())
        self._x, self._y = index % columns, index // columns
        self.order = z_order(self._x + dr.opaque(UInt32, left), self._y + dr.opaque(UInt32, top))
        self.surface, self.beams = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.weight = dr.zeros(Float, count), dr.zeros(Float, count)
        self.light, self.squares = dr.zeros(Float, count), dr.zeros(Float, count)
        self.depth = dr.full(Float, dr.inf, count)
        self._empty = True
        dr.eval(self.order, self._x, self._y)

    def add(self, picture: Picture, offset: tuple[float, float]) -> None:
        """Add a pass whose samples lie at `offset` in each pixel.

        All pixels have the same offset, so the filter is a convolution; as gathers, whose order is always the same.
        """
        reach = int(np.ceil(self._filter.radius() - 0.5 - 1e-6)) if not self._filter.is_box_filter() else 0
        for down in range(-reach, reach + 1):
            for right in range(-reach, reach + 1):
                weight = self._weight(right + offset[0] - 0.5) * self._weight(down + offset[1] - 0.5)
                if weight != 0:
                    self._add(picture, right, down, weight)
        value = dr.dot(picture.surface + picture.beams, Array3f(1 / 3))
        self.light, self.squares = self.light + value, self.squares + value * value
        dr.eval(self.surface, self.beams, self.alpha, self.weight, self.light, self.squares)
        if self._empty:
            self.depth, self._empty = picture.depth, False

    def error(self, passes: int) -> float:
        """Return the median relative standard error of the mean."""
        if passes < 2:
            return float("nan")
        mean, squares = self.light.numpy() / passes, self.squares.numpy() / passes
        lit = mean > 0
        variance = np.maximum(squares - mean * mean, 0)[lit] / (passes - 1)
        return float(np.median(np.sqrt(variance) / mean[lit])) if lit.any() else 0.0

    def state(self) -> dict[str, np.ndarray]:
        """Return the sums."""
        return {name: getattr(self, name).numpy() for name in _SUMS}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take sums from elsewhere."""
        for name in _SUMS:
            own = getattr(self, name)
            if name not in state or state[name].shape != own.numpy().shape:
                raise scene.SceneError("the checkpoint is of another picture")
            kind: Any = type(own)
            setattr(self, name, kind(*map(to_float, state[name])) if kind is Array3f else to_float(state[name]))
        self._empty = False

    def _weight(self, distance: float) -> float:
        return 1.0 if self._filter.is_box_filter() else float(np.ravel(self._filter.eval(Float(distance)))[0])

    def _add(self, picture: Picture, right: int, down: int, weight: float) -> None:
        height, width = (dr.opaque(UInt32, each) for each in self._shape)
        x, y = self._x + dr.opaque(UInt32, right & 0xFFFFFFFF), self._y + dr.opaque(UInt32, down & 0xFFFFFFFF)
        inside = (x < width) & (y < height)  # a number below 0 is a large one
        index, factor = y * width + x, dr.opaque(Float, weight)
        self.surface = self.surface + factor * dr.gather(Array3f, picture.surface, index, inside)
        self.beams = self.beams + factor * dr.gather(Array3f, picture.beams, index, inside)
        self.alpha = self.alpha + factor * dr.gather(Float, picture.alpha, index, inside)
        self.weight = self.weight + dr.select(inside, factor, 0)

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers."""
        height, width = self._shape
        inverse = dr.rcp(self.weight)

        def picture(value: Any) -> np.ndarray:
            return np.ascontiguousarray(value.numpy().reshape(-1, height, width).transpose(1, 2, 0))

        surface, beams = picture(self.surface * inverse), picture(self.beams * inverse)
        alpha = picture(self.alpha * inverse)
        return {
            "rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams,
            "depth": picture(self.depth),
        }  # fmt: skip


def render(
    plugin: Any,
    sensor: Any,
    settings: Settings = Settings(),
    progress: Callable[[int, Frame], None] | None = None,
    state: Mapping[str, np.ndarray] | None = None,
) -> Frame:
    """Render a Mitsuba scene from one of its sensors.

    Parameters
    ----------
    plugin, sensor
        Mitsuba's scene and sensor.
    settings
        Passes, paths, radii.
    progress
        Called with the number of finished passes, before the first and after each.
    state
        Of a frame that was not finished, to go on from: see `Frame.state`.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered.
    """
    begin = time.perf_counter()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        frame = Frame(plugin, sensor, settings)
        if state is not None:
            frame.restore(state)
        for index in range(frame.statistics.passes, settings.passes):
            if progress is not None:
                progress(index, frame)
            frame.add_pass(index)
            if settings.time_limit is not None and time.perf_counter() - begin > settings.time_limit:
                break
    if progress is not None:
        progress(frame.statistics.passes, frame)
    return frame
