"""A picture of a Mitsuba scene: the mean of passes, each with its own light paths and camera paths.

Radii shrink from pass to pass by R_{i+1} / R_i = (i + α) / (i + 1), so that bias and variance both vanish (Progressive
Photon Beams, Jarosz et al. 2011). Memory is that of one pass, however many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..estimators.estimate import DEFAULT_RULE, check_estimator
from ..estimators.points import Points
from ..numerics.samples import Samples
from ..quadrature import Rule
from ..runtime.device import Float, UInt32, mitsuba
from ..transport import paths
from ..transport.beams import Lit, lit
from ..transport.emission import Emitted, Emitters
from ..transport.events import perturbs
from ..transport.guiding import Watch
from ..transport.radii import Limits
from ..world import warnings as doubts
from ..world.media import Media, RenderedMedium
from ..world.sensors import Sensor
from ..world.surroundings import Surroundings, place_of_sensor, places_of
from . import camera_paths as eye
from .film import Picture, Sums
from .gathering import Gathering
from .passes import OVERLAP, Statistics, accumulate, subpixel
from .photons import Arrived, translucent

mi = mitsuba()

# Least and greatest radius in units of a medium's radius (of photons: the scene's), and the greatest in free paths.
# Wide beams stick out of small media, and blur what changes within a free path: at these bounds a ball of 10 free paths
# is 1 to 3 % dark after 16 passes, 10 % in its rim, and noise is what it is with beams twice as wide.
FLOOR, CEILING, FREE_PATHS = 1e-4, 0.05, 0.25
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
        (None: 1e-4 and 0.05 of the medium's radius, and a quarter of a mean free path).
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
        for name, most in (("passes", 2**31 - 1), ("paths", scene.MOST_BEAMS), ("rr_depth", 2**31 - 1)):
            if not 1 <= getattr(self, name) <= most:
                raise scene.SceneError(f"{name} is {getattr(self, name)}: expected 1 to {most}")
        if self.max_depth is not None and not 0 <= self.max_depth < 2**31:
            raise scene.SceneError(f"max_depth is {self.max_depth}: expected -1, for any, or 0 to {2**31 - 1}")
        for name in ("radius", "min_radius", "max_radius", "time_limit", "overlap"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise scene.SceneError(f"{name} is {value}: expected a number above 0")
        if self.min_radius and self.max_radius and self.min_radius > self.max_radius:
            raise scene.SceneError(f"min_radius is {self.min_radius}: expected max_radius, {self.max_radius}, at most")
        if not 0 < self.alpha <= 1:
            raise scene.SceneError(f"alpha is {self.alpha}: expected a number above 0, of at most 1")

    @property
    def max_events(self) -> int | None:
        """The most events on a light path that the camera sees without a mirror: two edges are none."""
        return None if self.max_depth is None else self.max_depth - 2


class Frame:
    """The sums over the passes of one sensor's picture; `warned` is what `doubts.warn` has said of the scene."""

    def __init__(self, plugin: Any, sensor: Any, settings: Settings, warned: set[str] | None = None) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._plugin, self.sensor = plugin, Sensor(sensor)
        with self.statistics.phase("build"):
            self._volumes = Media.of(plugin)
            if settings.short:
                self._volumes.all = tuple(each.ending() for each in self._volumes.all)
            self._emitters = Emitters(plugin, settings.seed)
        self._radius, self._perturbed = _radius(plugin), perturbs(plugin)
        with self.statistics.phase("build"):
            self._surroundings = self._survey()
        doubts.warn(plugin, self._surroundings, set() if warned is None else warned)
        sizes = [self._size(each) for each in self._volumes.all]
        self._reach = min(max(sizes, default=np.inf), self._radius)
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
            arrived = Arrived(landed, limits, settings.max_events, self._translucent)
        statistics.beams += sum(len(each.beams) for each in sets.values())
        looking = eye.Looking(
            self._plugin, self._volumes, settings.max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces,
        )  # fmt: skip
        offset = subpixel(number)
        primary = self.sensor.rays(offset, self._sums.order, samples)
        sight = eye.begin(looking, primary, self._sums.order, self._surroundings)
        picture = Picture(self.sensor.width * self.sensor.height)
        gathering = Gathering(
            self.sensor, self._volumes, sets, settings.max_depth, settings.estimator, self._points, statistics
        )
        steps = eye.follow(looking, sight, samples, arrived)
        while True:
            with statistics.phase("surfaces"):
                following = next(steps, None)
            if following is None:
                break
            picture.add_surfaces(*following)
            with statistics.phase("beams"):
                gathering.add(primary, *following)
        with statistics.phase("beams"):
            gathering.finish()
        picture.beams = gathering.radiance
        self._sums.add(picture, offset)
        statistics.passes += 1

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
        begun = paths.begin(tracing, emitted, self._surroundings)
        for segments, landed in paths.trace(tracing, begun, dr.opaque(UInt32, 1), dr.opaque(UInt32, 0)):
            result += watch.importance(segments, landed if self.settings.surfaces else None, count)
        return result

    def _survey(self) -> Surroundings:
        """Return the media around the emitters and the sensor."""
        sensor = place_of_sensor(self.sensor.plugin)
        return Surroundings(self._plugin, self._volumes, places_of(self._plugin), sensor)

    def _size(self, volume: RenderedMedium) -> float:
        """Return the radius of a medium, that of the scene at most."""
        return min(self._surroundings.sizes.get(volume.number, np.inf), self._radius)

    def _tracing(self) -> paths.Tracing:
        """Return how light paths are traced."""
        settings = self.settings
        return paths.Tracing(
            self._plugin, self._volumes, settings.max_events, settings.rr_depth, settings.overlap, self._reach,
            settings.paths, float(self._emitters.power.max()), scene.ESCAPE * self._radius, settings.short,
            self._perturbed,
        )  # fmt: skip

    def simulated(self, number: int) -> tuple[dict[int, Lit], list[paths.Landed], Limits]:
        """Return the beams of pass `number`, by the numbers of media, its photons on surfaces, and bounds of radii."""
        settings = self.settings
        shrunk = float(np.prod([(i + settings.alpha) / (i + 1) for i in range(1, number + 1)]))
        tracing = self._tracing()
        emitted = self._emitters.emit(settings.paths, number)
        first = dr.opaque(UInt32, (number * settings.paths) & 0xFFFFFFFF)
        begun = paths.begin(tracing, emitted, self._surroundings)
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
            size = self._size(volume)
            if volume.tracked is None:
                widest = FREE_PATHS / max(*volume.medium.extinction, 1e-30)
        low = settings.radius or settings.min_radius or FLOOR * size
        high = settings.radius or settings.max_radius or max(min(CEILING * size, widest), low)
        return Limits(*(dr.opaque(Float, each) for each in (low, high, scale)))

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


def render(
    plugin: Any,
    sensor: Any,
    settings: Settings = Settings(),
    progress: Callable[[int, Frame], None] | None = None,
    state: Mapping[str, np.ndarray] | None = None,
    warned: set[str] | None = None,
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
    warned
        Texts of warnings that were given, and are not given again.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered.
    """

    def begin() -> Frame:
        frame = Frame(plugin, sensor, settings, warned)
        if state is not None:
            frame.restore(state)
        return frame

    frame = accumulate(begin, settings.passes, settings.time_limit, progress)
    frame.statistics.error = frame.error()
    if progress is not None:
        progress(frame.statistics.passes, frame)
    return frame
