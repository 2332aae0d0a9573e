"""A picture of a Mitsuba scene: the mean of passes, each with its own light paths and camera paths.

Radii shrink from pass to pass by R_{i+1} / R_i = (i + α) / (i + 1), so that bias and variance both vanish (Progressive
Photon Beams, Jarosz et al. 2011). Memory is that of one pass, however many there are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..estimators.points import Points
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Float, UInt32, mitsuba
from ..transport import paths
from ..transport.beams import Lit, lit
from ..transport.emission import Emitted, Emitters
from ..transport.events import perturbs
from ..transport.guiding import Watch
from ..transport.radii import Limits
from ..world import warnings as doubts
from ..world.media import Media, RenderedMedium, boxes, number, parts
from ..world.sensors import Sensor
from . import camera_paths as eye
from .checkpoint import Checkpoint
from .film import Film, PassPicture, films_state, reconstruction_filter, restore_films
from .gathering import Gathering
from .passes import Progress, Statistics, accumulate, subpixel
from .photons import Arrived, translucent
from .settings import DEFAULT_PATHS, DEFAULTS, Settings

mi = mitsuba()

# Least and greatest radius in units of a medium's radius (of photons: the scene's), and the greatest in free paths.
# Wide beams stick out of small media, and blur what changes within a free path: at these bounds a ball of 10 free paths
# is 1 to 3 % dark after 16 passes, 10 % in its rim, and noise is what it is with beams twice as wide.
FLOOR, CEILING, FREE_PATHS = 1e-4, 0.05, 0.25
# Greatest radius of a scene: the squares and cubes of what is longer are beyond the numbers that there are.
LARGEST = 1e9


class Frame:
    """The sums over the passes of one sensor's picture; `warned` is what `doubts.warn` has said of the scene."""

    def __init__(self, plugin: Any, sensor: Any, settings: Settings, warned: set[str] | None = None) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._plugin, self.sensor = plugin, Sensor(sensor)
        self._paths, self._max_depth = settings.beams or DEFAULT_PATHS, settings.depth()
        # Of a light path that the camera sees without a mirror: two edges are no scattering.
        self._most_events = None if self._max_depth is None else self._max_depth - 2
        with self.statistics.phase("build"):
            self._volumes = Media.of(plugin)
            if settings.short:
                self._volumes.all = tuple(each.ending() for each in self._volumes.all)
            self._emitters = Emitters(plugin, settings.seed)
        everywhere = _everywhere(plugin, sensor)
        doubts.warn(plugin, everywhere, set() if warned is None else warned)
        self._otherwise = dr.opaque(UInt32, number(everywhere))
        self._radius, self._perturbed = _radius(plugin), perturbs(plugin)
        self._sizes = _sizes(plugin)
        self._reach = min(max(self._sizes.values(), default=np.inf), self._radius)
        if settings.guiding in (None, True) and self.sensor.view is not None:
            with self.statistics.phase("guide"):
                self._emitters.learn(self._importance)
        self._points, self._translucent = Points(settings.rule), translucent(plugin)
        film = self.sensor.film
        left, top = map(int, film.crop_offset())
        reconstruction = reconstruction_filter(settings.pixel_filter, film.rfilter())
        self._film = Film((self.sensor.height, self.sensor.width), (left, top), reconstruction)

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        settings, statistics = self.settings, self.statistics
        samples = Samples(settings.seed, number)
        with statistics.phase("trace"):
            sets, landed, limits = self.simulated(number)
            arrived = Arrived(landed, limits, self._most_events, self._translucent)
        statistics.beams += sum(len(each.beams) for each in sets.values())
        looking = eye.Looking(
            self._plugin, self._volumes, self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces,
        )  # fmt: skip
        offset = subpixel(number)
        primary = self.sensor.rays(offset, self._film.order, samples)
        sight = eye.begin(looking, primary, self._film.order, self._otherwise)
        picture = _blank(self.sensor.width * self.sensor.height)
        gathering = Gathering(
            self.sensor, self._volumes, sets, self._max_depth, settings.estimator, self._points, statistics
        )
        steps = eye.follow(looking, sight, samples, arrived)
        while True:
            with statistics.phase("surfaces"):
                following = next(steps, None)
            if following is None:
                break
            _add_surfaces(picture, *following)
            with statistics.phase("beams"):
                gathering.add(primary, *following)
        with statistics.phase("beams"):
            gathering.finish()
        picture.beams = [("", gathering.radiance)]
        self._film.add(picture, offset)
        statistics.passes += 1

    def error(self) -> float:
        """Return the relative standard error so far."""
        return self._film.error()

    def state(self) -> dict[str, np.ndarray]:
        """Return what another frame of the same scene and settings goes on from."""
        return films_state([self._film], self.statistics)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the state of another frame; raises SceneError where that is of another picture."""
        restore_films([self._film], self.statistics, state)

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
        return paths.Tracing(
            self._plugin, self._volumes, self._most_events, settings.rr_depth, settings.overlap, self._reach,
            self._paths, float(self._emitters.power.max()), scene.ESCAPE * self._radius, settings.short,
            self._perturbed,
        )  # fmt: skip

    def simulated(self, number: int) -> tuple[dict[int, Lit], list[paths.Landed], Limits]:
        """Return the beams of pass `number`, by the numbers of media, its photons on surfaces, and bounds of radii."""
        settings = self.settings
        shrunk = float(np.prod([(i + settings.alpha) / (i + 1) for i in range(1, number + 1)]))
        tracing = self._tracing()
        emitted = self._emitters.emit(self._paths, number)
        first = dr.opaque(UInt32, (number * self._paths) & 0xFFFFFFFF)
        begun = paths.begin(tracing, emitted, self._otherwise)
        steps = list(paths.trace(tracing, begun, dr.opaque(UInt32, settings.seed & 0xFFFFFFFF), first))
        segments = [each for each, _ in steps if each is not None]
        bright = [volume for volume in self._volumes.all if max(volume.medium.scattering) > 0]
        found = {
            volume.number: lit(volume, segments, self._limits(shrunk, volume), settings.short) for volume in bright
        }
        result = {own: each for own, each in found.items() if each is not None}
        dr.eval(result)
        landed = [each for _, each in steps if each is not None] if settings.surfaces else []
        return result, landed, self._limits(shrunk)

    def _limits(self, scale: float, volume: RenderedMedium | None = None) -> Limits:
        """Return the bounds of radii of beams in a medium, or of photons, in a pass that shrinks them by `scale`."""
        settings, size, widest = self.settings, self._radius, np.inf
        if volume is not None:
            size = min(self._sizes.get(volume.number, np.inf), size)
            if volume.tracked is None:
                widest = FREE_PATHS / max(*volume.medium.extinction, 1e-30)
        low = settings.radius or settings.min_radius or FLOOR * size
        high = settings.radius or settings.max_radius or max(min(CEILING * size, widest), low)
        return Limits(*(dr.opaque(Float, each) for each in (low, high, scale)))

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers, (H, W, C) float32: means over the passes, through the film's reconstruction filter."""
        return self._film.layers()


def _blank(count: int) -> PassPicture:
    """Return what a pass sees of so many pixels before its camera paths begin."""
    surface, alpha, depth = dr.zeros(Array3f, count), dr.zeros(Float, count), dr.full(Float, dr.inf, count)
    return PassPicture(surface, alpha, depth=depth)


def _add_surfaces(picture: PassPicture, sight: eye.Sight, seen: eye.Seen) -> None:
    """Add what camera paths see of surfaces in one step."""
    dr.scatter_add(picture.surface, seen.radiance, sight.pixel, sight.alive)
    first = sight.alive & sight.primary & seen.solid
    dr.scatter(picture.alpha, Float(1), sight.pixel, first)
    dr.scatter(picture.depth, seen.end, sight.pixel, first)
    dr.eval(picture.surface, picture.alpha, picture.depth)


def _sizes(plugin: Any) -> dict[int, float]:
    """Return the radius of a ball around all shapes that hold a medium, by the numbers of media."""
    found = boxes(parts(plugin, mi.Shape))
    return {own: float(np.linalg.norm(np.ravel(box.extents()))) / 2 or np.inf for own, box in found.items()}


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


def render(
    plugin: Any,
    sensor: Any,
    settings: Settings = DEFAULTS,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    content: str = "",
    warned: set[str] | None = None,
) -> Frame:
    """Render a Mitsuba scene from one of its sensors.

    Parameters
    ----------
    plugin, sensor
        Mitsuba's scene and sensor.
    settings
        Passes, light paths, radii.
    progress
        Called with the number of finished passes, before the first and after each.
    checkpoint, content
        Where passes are kept on the way, and a hash of what is rendered: passes of another content are refused.
    warned
        Texts of warnings that were given, and are not given again.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered.
    """
    film, state = sensor.film(), None
    if checkpoint is not None:
        window = [[int(each) for each in part] for part in (film.size(), film.crop_size(), film.crop_offset())]
        state = checkpoint.begin(content, sensor.id(), window, replace(settings, passes=1, time_limit=None))

    def begin() -> Frame:
        frame = Frame(plugin, sensor, settings, warned)
        if state is not None:
            frame.restore(state)
        return frame

    return accumulate(begin, settings, progress, checkpoint)
