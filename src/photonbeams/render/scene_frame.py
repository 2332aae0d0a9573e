"""Frames of Mitsuba scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .. import scene
from ..constants import DEFAULT_PATHS
from ..numerics.samples import BITS, Samples
from ..runtime.device import Array2f
from ..world.cameras.sensors import Sensor, window_of
from ..world.media.surroundings import place_of_sensor
from ..world.world import World
from .checkpoint import identity
from .choice import Pixels
from .costs import power_below
from .film import Film, averaged, group_layers, reconstruction_filter
from .frame import DEFAULTS, FrameRenderer, ViewRays
from .holdouts import HoldoutDepth
from .memory import check_memory
from .passes import PLAIN_RUN, RunOptions, accumulate
from .scene_light import EmitterSettings, Findings, ScenePasses, light_of
from .settings import Settings, as_passes


class SceneRenderer(ScenePasses, FrameRenderer):
    """A frame of a Mitsuba scene.

    Parameters
    ----------
    plugin, sensor
        The scene, and the sensor that looks at it.
    settings
        How it is rendered.
    warned
        Texts of warnings that have been given already.
    extras
        Options that the scene itself does not contain.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered, or beams are set for an emitter that does not exist.
    """

    def __init__(
        self, plugin: Any, sensor: Any, settings: Settings, warned: set[str] | None = None,
        extras: Extras | None = None,
    ) -> None:  # fmt: skip
        super().__init__(settings, settings.depth(), None)
        extras = extras or Extras()
        self._sensors = [Sensor(sensor, eye) for eye in extras.eyes or (None,)]
        check_memory(self._sensors[0].window, settings.beams or DEFAULT_PATHS)
        self._has_depth = extras.depth
        self._holdouts: Sequence[HoldoutDepth | None] = extras.holdouts or [None] * len(self._sensors)
        cameras = [each.view for each in self._sensors if each.view is not None]
        window = self._sensors[0].window
        reconstruction = reconstruction_filter(settings.filter_name, sensor.film().rfilter())
        pixels = Pixels(len(self._sensors) * window.width * window.height, averaged(reconstruction))
        self.light = light_of(
            plugin, place_of_sensor(sensor), settings, self._tuning, extras.beams,
            cameras if len(cameras) == len(self._sensors) else (), pixels, warned,
            self.statistics, self._max_depth, extras.findings,
        )  # fmt: skip
        layers = groups_of(plugin, extras.beams)
        self._films = [
            Film(window.shape, window.crop[:2], reconstruction, layers, settings.denoise) for _ in self._sensors
        ]
        self._plan(window)

    def _light_paths(self) -> int:
        return self.light.simulation.emission.count

    def together(self, number: int) -> int:
        """Return how many passes from `number` on are best rendered at once."""
        if self.light.simulation.emission.strata or self._holdouts[0] is not None:
            return 1
        # Sample sequences begin again after 2^BITS passes.
        return power_below(min(self._wide, (1 << BITS) - number % (1 << BITS)))

    def _view_rays(
        self, number: int, view: int, places: Array2f, samples: Samples, moving: bool = False
    ) -> ViewRays:  # fmt: skip
        sensor, holdout = self._sensors[view], self._holdouts[view]
        primary = sensor.rays(places, self._films[view].order, samples)
        if sensor.view is None or holdout is None:
            return ViewRays(primary, None if sensor.view is None else sensor.view.projection)
        far = holdout.distances(sensor.view, primary.facing, places, sensor.on_lens(samples))
        return ViewRays(replace(primary, far=far), sensor.view.projection, holdout=far)

    def _pinhole(self, view: int) -> tuple[World, ViewRays] | None:
        if not self._has_depth:
            return None
        film, holdout = self._films[view], self._holdouts[view]
        primary = self._sensors[view].rays(film.centers(), film.order, self._samples(0), sharp=True)
        return self.light.world, ViewRays(primary, None, holdout=None if holdout is None else holdout.depth)


@dataclass(frozen=True)
class Extras:
    """Options for rendering a Mitsuba scene that the scene itself does not contain.

    Attributes
    ----------
    beams
        Settings of beams by the ids of emitters or of their shapes; "" stands for all others.
    eyes
        Cameras that replace the sensor, one for each view.
    holdouts
        For each view, the depth at which beams end instead of at the scene's own surfaces.
    depth
        Whether the depth layer is wanted.
    findings
        Results of pilots for this scene, if there are any.
    """

    beams: Mapping[str, scene.BeamSettings] = field(default_factory=dict)
    eyes: Sequence[scene.Camera] = ()
    holdouts: Sequence[HoldoutDepth] = ()
    depth: bool = True
    findings: Findings | None = None


def groups_of(plugin: Any, beams: Mapping[str, scene.BeamSettings]) -> dict[str, str]:
    """Return the layer of each light group of a scene."""
    return group_layers({source.group for source in EmitterSettings.of(plugin, beams).sources})


def render(
    plugin: Any,
    sensor: Any,
    settings: Settings = DEFAULTS,
    run: RunOptions = PLAIN_RUN,
    content: str = "",
    warned: set[str] | None = None,
    extras: Extras | None = None,
) -> SceneRenderer:
    """Render a Mitsuba scene from one of its sensors.

    Parameters
    ----------
    plugin, sensor
        Mitsuba's scene and sensor.
    settings
        Passes, light paths, radii.
    run
        Which passes, callbacks, and what is kept: see `RunOptions`.
    content
        A hash of the content; passes of another content are refused.
    warned
        Texts of warnings that have been given, and are not given again.
    extras
        Options that the scene itself does not contain.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered.
    """
    own = extras or Extras()
    about = "" if not run.named else identity(
        content, sensor.id(), window_of(sensor.film()), as_passes(settings), own.beams,
        own.eyes, [each.depth for each in own.holdouts],
    )  # fmt: skip

    def begin(_: int | None) -> SceneRenderer:
        return SceneRenderer(plugin, sensor, settings, warned, extras)

    return accumulate(begin, settings, run, about)
