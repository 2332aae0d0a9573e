"""Frames of Mitsuba scenes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.samples import Samples
from ..transport import paths
from ..transport.emission import Emitted
from ..transport.guiding import Watch
from ..transport.scene_emitters import emission_of, shared_anew
from ..transport.simulation import Simulation
from ..world.scene_world import SceneWorld
from ..world.sensors import Sensor
from ..world.warnings import warn
from ..world.world import World
from .camera_paths import Lighting
from .checkpoint import Checkpoint
from .film import Film, reconstruction_filter
from .frame import Eye, Frame, Simulated
from .passes import Progress, accumulate, subpixel
from .scene_lighting import SceneLighting
from .settings import DEFAULT_PATHS, DEFAULTS, Settings


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


def render(
    plugin: Any,
    sensor: Any,
    settings: Settings = DEFAULTS,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    content: str = "",
    warned: set[str] | None = None,
) -> SceneFrame:
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

    def begin() -> SceneFrame:
        frame = SceneFrame(plugin, sensor, settings, warned)
        if state is not None:
            frame.restore(state)
        return frame

    return accumulate(begin, settings, progress, checkpoint)
