"""One frame: the mean of independent passes, each with light paths and camera paths of its own.

A stage and a Mitsuba scene differ in where their worlds, light paths and camera rays come from; all else is the same.
Where anything moves, each pass looks at its own slice of the shutter. Within a slice all motion is linear: light
straight from its lamp is traced at its two ends with the same samples, the camera stands at both, and rays have times
in between. Radii shrink from pass to pass, so that bias and variance both vanish (Progressive Photon Beams, Jarosz et
al. 2011).
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..beams.sets import BeamSet
from ..estimators.points import Points
from ..estimators.tiles import Projection
from ..looks import Context
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..transport import paths
from ..transport.emission import Emitted
from ..transport.guiding import Watch
from ..transport.portal_visibility import lights_seen
from ..transport.radii import Limits
from ..transport.scene_emitters import emission_of, shared_anew
from ..transport.simulation import Simulation, StageSimulation, Tuning
from ..world.cameras import CameraRays, View, Window
from ..world.scene_world import SceneWorld
from ..world.sensors import Primary, Sensor
from ..world.shutter import Moment, Shutter, slice_of, turn, with_lens
from ..world.stage_world import StageWorld
from ..world.warnings import warn
from ..world.world import World
from . import camera_paths
from .camera_paths import Lighting, Viewing
from .film import Film, PassPicture, films_state, reconstruction_filter, restore_films
from .gathering import Estimating, Gathering
from .holdouts import Held
from .passes import Statistics, subpixel
from .photons import PhotonMaps
from .scene_lighting import SceneLighting
from .settings import DEFAULT_PATHS, Settings
from .stage_lighting import StageLighting

_WIDEST_TURN = 30.0  # degrees: half of it in the middle of the way, the camera's axes are shorter by 3.4 %

_LENS, _TIME = 101, 102  # streams of samples

# Passes of a pixel have a block of 2^_BITS places in a sequence, where nobody knows how many there will be.
_BITS = 16


@dataclass(frozen=True)
class Simulated:
    """What light leaves in a pass: beams, photons on surfaces with the bounds of their radii."""

    sets: list[BeamSet]
    hits: list[paths.PhotonHits]
    limits: Limits


@dataclass(frozen=True)
class Eye:
    """A view's rays in a pass, its screen (None where it has none), and a factor on its light.

    `held` is where rays end that see no surfaces, in units of distance, or None.
    """

    primary: Primary
    view: Projection | None
    exposure: float = 1.0
    held: Any = None


class Frame(ABC):
    """The films of all views of a frame.

    Attributes
    ----------
    settings, statistics
        How the frame is rendered, and what it took so far.
    """

    def __init__(self, settings: Settings, max_depth: int | None) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._max_depth = max_depth
        self._points = Points(settings.rule)
        self._films: list[Film] = []

    @abstractmethod
    def _world(self, number: int) -> World:
        """Return what the camera paths of a pass meet."""

    @abstractmethod
    def _lighting(self, world: World) -> Lighting:
        """Return what lights it."""

    @abstractmethod
    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""

    @abstractmethod
    def _eye(self, number: int, view: int, samples: Samples, moving: bool) -> Eye:
        """Return the rays of a view in a pass; `moving` tells that beams move while it looks."""

    @abstractmethod
    def _sharp(self, view: int) -> tuple[World, Eye] | None:
        """Return the pinhole by which depths are seen, and what it sees, where the view itself is blurred."""

    def _clock(self, number: int) -> tuple[float, float]:
        """Return frame number and seconds of a pass, for looks that change with time."""
        return (0.0, 0.0)

    def _samples(self, number: int) -> Samples:
        return Samples(self.settings.seed, number)

    @property
    def _tuning(self) -> Tuning:
        settings = self.settings
        return Tuning(
            settings.seed, None if self._max_depth is None else self._max_depth - 2, settings.rr_depth,
            settings.overlap, settings.alpha, settings.radius, settings.min_radius, settings.max_radius,
            settings.short, settings.surfaces,
        )  # fmt: skip

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        statistics, samples = self.statistics, self._samples(number)
        with statistics.phase("simulate"):
            light = self.simulated(number)
            world = self._world(number)
            most = None if self._max_depth is None else self._max_depth - 2
            photons = PhotonMaps(light.hits, light.limits, most, world.translucent) if light.hits else None
        statistics.beams += sum(len(each.beams) for each in light.sets)
        moving = any(each.close is not None for each in light.sets)
        for view, film in enumerate(self._films):
            with statistics.phase("surfaces"):
                eye = self._eye(number, view, samples, moving)
            seen = self._seen(number, world, eye, film, samples, photons, light.sets)
            if number == 0:
                seen.depth = self._depth(view, film, samples, seen.depth)
            with statistics.phase("beams"):
                film.add(seen, subpixel(number), dr.opaque(Float, eye.exposure))
        statistics.passes += 1

    def _seen(
        self, number: int, world: World, eye: Eye, film: Film, samples: Samples, photons: PhotonMaps | None,
        sets: Sequence[BeamSet],
    ) -> PassPicture:  # fmt: skip
        """Return what a view sees in a pass."""
        clock, statistics = self._clock(number), self.statistics
        viewing = self._viewing(world, eye)
        estimating = Estimating(
            self.settings.estimator, self._points, self._max_depth,
            lambda each: Context(*clock, each.light, each.to_world),
        )  # fmt: skip
        gathering = Gathering(eye.view, eye.primary, world.media, sets, estimating, statistics)
        with statistics.phase("surfaces"):
            begun = camera_paths.begin(viewing, eye.primary, film.order)
        picture = _Picture(dr.width(eye.primary.direction))
        steps = camera_paths.follow(viewing, begun, samples, photons)
        while True:
            with statistics.phase("surfaces"):
                step = next(steps, None)
                if step is not None:
                    picture.add(*step)
            if step is None:
                break
            with statistics.phase("beams"):
                gathering.add(*step)
        with statistics.phase("beams"):
            gathering.finish()
        facing = 1.0 if eye.primary.facing is None else eye.primary.facing
        return PassPicture(
            picture.surface, picture.alpha, [*gathering.radiance.items()], picture.transmittance,
            picture.distance * facing,
        )  # fmt: skip

    def _viewing(self, world: World, eye: Eye) -> Viewing:
        settings = self.settings
        if eye.held is not None:
            world = world.without_surfaces()
            return Viewing(world, _Nothing(), None, settings.rr_depth, True, surfaces=False, sharp=world.sharp)
        return Viewing(
            world, self._lighting(world), self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces, world.sharp,
        )  # fmt: skip

    def _depth(self, view: int, film: Film, samples: Samples, own: Any) -> Any:
        """Return planar depths as a pinhole at shutter open sees them: a blurred depth is the depth of nothing."""
        sharp = self._sharp(view)
        if sharp is None:
            return own
        world, eye = sharp
        if eye.held is not None:
            return eye.held
        viewing = replace(self._viewing(world, eye), surfaces=False)
        picture = _Picture(dr.width(eye.primary.direction))
        begun = camera_paths.begin(viewing, eye.primary, film.order)
        for step in camera_paths.follow(viewing, begun, samples, None):
            picture.add(*step)
        return picture.distance * eye.primary.facing

    def views(self) -> list[dict[str, np.ndarray]]:
        """Return the layers of each view, means over the passes."""
        return [film.layers() for film in self._films]

    def error(self) -> float:
        """Return the relative standard error so far, of the view whose error is the largest."""
        return max(film.error() for film in self._films)

    def state(self) -> dict[str, np.ndarray]:
        """Return what another frame of the same content goes on from."""
        return films_state(self._films, self.statistics)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the state of another frame; raises SceneError where that is of another picture."""
        restore_films(self._films, self.statistics, state)


class _Picture:
    """What camera paths see in a pass, by pixels."""

    def __init__(self, count: int) -> None:
        self.surface, self.transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.distance = dr.zeros(Float, count), dr.full(Float, dr.inf, count)

    def add(self, step: camera_paths.CameraPaths, vertex: camera_paths.CameraVertex) -> None:
        """Add what paths see in one step."""
        dr.scatter_add(self.surface, vertex.radiance, step.pixel, step.alive)
        own = step.alive & step.primary
        dr.scatter(self.transmittance, vertex.transmittance, step.pixel, own)
        first = own & vertex.solid
        dr.scatter(self.alpha, Float(1), step.pixel, first)
        dr.scatter(self.distance, vertex.end, step.pixel, first)
        dr.eval(self.surface, self.transmittance, self.alpha, self.distance)


class _Nothing:
    """What lights a world in which nothing is seen."""

    def lamp(self, origin: Array3f, direction: Array3f) -> None:
        """Return None."""
        return

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(hit.t))

    def direct(self, point: camera_paths.ShadingPoint, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(point.hit.t))


class SceneFrame(Frame):
    """A frame of a Mitsuba scene from one of its sensors; `warned` are texts of warnings that were given."""

    def __init__(self, plugin: Any, sensor: Any, settings: Settings, warned: set[str] | None = None) -> None:
        super().__init__(settings, settings.depth())
        self.sensor = Sensor(sensor)
        with self.statistics.phase("build"):
            self._scene = SceneWorld(plugin, sensor)
            if settings.short:
                self._scene.media.all = tuple(each.ending() for each in self._scene.media.all)
            emission = emission_of(self._scene, settings.beams or DEFAULT_PATHS, settings.seed)
        warn(plugin, self._scene.surroundings, set() if warned is None else warned)
        self.simulation = Simulation(self._scene, emission, self._tuning, self._scene.sources, self._scene.sizes)
        if settings.guiding in (None, True) and self.sensor.view is not None:
            with self.statistics.phase("guide"):
                shared_anew(emission, emission.learn(self._importance))
        film = self.sensor.film
        left, top = map(int, film.crop_offset())
        reconstruction = reconstruction_filter(settings.pixel_filter, film.rfilter())
        self._films = [Film((self.sensor.height, self.sensor.width), (left, top), reconstruction)]

    def _world(self, number: int) -> World:
        return self._scene

    def _lighting(self, world: World) -> Lighting:
        assert isinstance(world, SceneWorld)
        return SceneLighting(world)

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        return Simulated(*self.simulation.simulated(number), self.simulation.limits(number))

    def _eye(self, number: int, view: int, samples: Samples, moving: bool) -> Eye:
        primary = self.sensor.rays(subpixel(number), self._films[view].order, samples)
        return Eye(primary, None if self.sensor.view is None else self.sensor.view.projection)

    def _sharp(self, view: int) -> tuple[World, Eye] | None:
        return None

    def _importance(self, emitted: list[Emitted]) -> np.ndarray:
        """Return how much of light paths is seen."""
        assert self.sensor.view is not None
        watch = Watch(self._scene, self.sensor.view.projection)
        tracing = self.simulation.tracing(0)
        count = sum(dr.width(each.origin) for each in emitted)
        result = np.zeros(count)
        for segments, hits in paths.trace(tracing, paths.begin(tracing, emitted)):
            result += watch.importance(segments, hits if self.settings.surfaces else None, count)
        return result


class StageFrame(Frame):
    """A frame of a stage.

    Parameters
    ----------
    shutter, window
        What is seen, from where, and how large.
    settings
        Passes, estimator, seed.
    holdouts
        For each view, where beams end, instead of at the scene's own surfaces: these are not seen then, but stop light.
    groups
        The layers of light groups.
    """

    def __init__(
        self, shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[Held] = (),
        groups: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(settings, settings.depth(2))
        self._shutter, self._window = shutter, window
        self._slices = None if settings.time_limit is not None else settings.passes
        ends = shutter.ends(0.0, 1.0)
        self._eyes = [np.asarray(camera.to_world)[:3, 3] for moment in ends for camera in moment.cameras]
        self._worlds: list[StageWorld] = []
        light_side: frozenset[str] = frozenset()
        with self.statistics.phase("build"):
            for moment in ends:
                world = self._world_of(moment)
                for camera in moment.cameras:
                    light_side |= lights_seen(world, *View(camera, window).coarse_rays(128, 72))
        self._simulation = StageSimulation(self._tuning, settings.beams or scene.DEFAULT_BEAMS, light_side)
        reconstruction = reconstruction_filter(settings.pixel_filter)
        self._films = [Film(window.shape, window.crop[:2], reconstruction, groups) for _ in ends[0].cameras]
        self._holdouts: Sequence[Held | None] = holdouts or [None] * len(self._films)
        self._turned = False

    def _world_of(self, moment: Moment) -> StageWorld:
        """Return the world of a moment; of those before it, what is still the same is kept."""
        for world in self._worlds:
            if world.description is moment.scene:
                return world
        world = StageWorld.build(
            moment.scene, self._eyes, like=self._worlds[-1] if self._worlds else None, sharp=self._max_depth != 2
        )
        self._worlds = [*self._worlds[-2:], world]
        return world

    def _samples(self, number: int) -> Samples:
        bits = _BITS if self._slices is None else (self.settings.passes - 1).bit_length()
        return Samples(self.settings.seed, number, min(bits, _BITS))

    def _times(self, number: int) -> list[float]:
        """Return the fractions of the shutter at which a pass opens and, where anything moves, closes."""
        return [*slice_of(number, self._slices)] if self._shutter.moving else [0.0]

    def _between(self, number: int) -> Moment:
        times = self._times(number)
        return self._shutter.at(0.5 * (times[0] + times[-1]))

    def _clock(self, number: int) -> tuple[float, float]:
        return self._shutter.clock(0.5 * sum(slice_of(number, self._slices)))

    def _world(self, number: int) -> World:
        return self._world_of(self._between(number))

    def _lighting(self, world: World) -> Lighting:
        assert isinstance(world, StageWorld)
        return StageLighting(world)

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        settings, times, between = self.settings, self._times(number), self._between(number)
        worlds = [self._world_of(moment) for moment in self._shutter.ends(times[0], times[-1])]
        sets, hits = self._simulation.simulated(worlds, number, between.scene.looks())
        if settings.program is not None:
            x, y, z = (float(each[0]) for each in worlds[0].bounds.center)
            bounds = (x, y, z), worlds[0].radius
            sets = settings.program(sets, number, settings.seed, times, between.scene.medium, bounds)
        dr.eval([(each.beams, each.close) for each in sets])
        return Simulated(sets, hits, self._simulation.limits(worlds[0], number))

    def _eye(self, number: int, view: int, samples: Samples, moving: bool) -> Eye:
        times, between = self._times(number), self._between(number)
        cameras = [moment.cameras[view] for moment in self._shutter.ends(times[0], times[-1])]
        self._warn_of_turn(cameras)
        own = View(
            with_lens(cameras[0], between.cameras[view]), self._window,
            cameras[-1] if cameras[-1] is not cameras[0] else None,
        )  # fmt: skip
        sample = (lambda groups: _on_lens(samples, groups)) if own.film or moving else None
        rays = own.rays(subpixel(number), sample)
        held = self._holdouts[view]
        far = None if held is None else held.distances(own, rays, subpixel(number), own.on_lens(sample))
        return Eye(_primary(rays, far), own.projection, own.camera.exposure_scale, far)

    def _sharp(self, view: int) -> tuple[World, Eye] | None:
        held = self._holdouts[view]
        moment = self._shutter.at(0.0)
        camera = moment.cameras[view]
        if held is None and camera.lens_radius == 0 and not self._shutter.moving:
            return None
        sharp = View(replace(camera, lens_radius=0.0), self._window)
        rays = sharp.rays(subpixel(0))
        return self._world_of(moment), Eye(_primary(rays), sharp.projection, held=None if held is None else held.depth)

    def _warn_of_turn(self, cameras: list[scene.Camera]) -> None:
        """Warn once of a camera that turns so far within a pass that a straight line is no picture of its way."""
        angle = turn(cameras[0], cameras[-1])
        if angle > _WIDEST_TURN and not self._turned:
            self._turned = True
            logging.getLogger("photonbeams").warning(
                "%s turns by %.0f degrees within one pass, and is blurred as if straight: expected more passes",
                cameras[0].name, angle,
            )  # fmt: skip


def _on_lens(samples: Samples, groups: UInt32) -> tuple[Any, Any]:
    """Return the place on the lens, in the unit square, and the time in the pass of groups of pixels."""
    return samples.pair(groups, _LENS), samples.pair(groups, _TIME).x


def _primary(rays: CameraRays, far: Any = None) -> Primary:
    count = dr.width(rays.direction)
    far = dr.full(Float, dr.largest(Float), count) if far is None else far
    ones = dr.ones(Array3f, count)
    return Primary(rays.origin, rays.direction, dr.zeros(Float, count), far, ones, rays.facing, rays.lanes)


def passes_of(frame: Frame) -> Iterator[int]:
    """Yield the numbers of the passes that a frame still needs."""
    yield from range(frame.statistics.passes, frame.settings.passes)
