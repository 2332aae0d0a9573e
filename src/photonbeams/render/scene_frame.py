"""Frames of Mitsuba scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .. import scene
from ..numerics.samples import Samples
from ..runtime.device import Array2f
from ..transport.scene_emitters import emission_of, redistribute
from ..transport.simulation import Simulation, Tuning
from ..world.cameras import View
from ..world.scene_lamps import names_of
from ..world.scene_world import SceneWorld
from ..world.sensors import Sensor, window_of
from ..world.sources import Source
from ..world.surroundings import Place, place_of_sensor
from ..world.warnings import warn
from ..world.world import World
from .camera_paths import Lighting
from .checkpoint import identity
from .film import Film, group_layers, reconstruction_filter
from .frame import FrameRenderer, PassRenderer, Simulated, ViewRays
from .holdouts import HoldoutDepth
from .memory import check_memory
from .passes import PLAIN_RUN, RunOptions, Statistics, accumulate
from .scene_lighting import SceneLighting
from .settings import DEFAULT_PATHS, DEFAULTS, Settings
from .walks import WalkedEmitters, Walking


class LitScene:
    """A Mitsuba scene whose light is traced pass by pass.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin.
    settings, tuning
        How it is rendered, and how its light paths are traced.
    beams
        As in `Extras`.
    cameras
        What light paths are guided toward; none: they are not guided.
    warned
        Texts of warnings that were given.
    statistics
        They get the time that this takes.
    max_depth
        The longest path in edges; None: any.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered; beams of an emitter that is not there.
    """

    def __init__(
        self, plugin: Any, eye: Place, settings: Settings, tuning: Tuning, beams: Mapping[str, scene.BeamSettings],
        cameras: Sequence[View], warned: set[str] | None, statistics: Statistics, max_depth: int | None,
    ) -> None:  # fmt: skip
        with statistics.phase("build"):
            own = _EmitterSettings.of(plugin, beams)
            self.sources = own.sources
            self.world = SceneWorld(plugin, eye, own.sources, own.beams)
            if settings.short:
                self.world.media.all = tuple(each.for_short_beams() for each in self.world.media.all)
            walked = own.walked(self.world, settings)
            groups = [own.sources[each].group for each in own.numbers]
            self.walks = walks_of(self.world, walked, groups, tuning, max_depth)
            emission = emission_of(self.world, settings.beams or DEFAULT_PATHS, settings.seed, own.numbers, walked)
        warn(plugin, self.world.surroundings, set() if warned is None else warned)
        named = len(own.sources) > 1 or own.sources[0].look is not None or own.sources[0].beam_scale != 1
        self.simulation = Simulation(self.world, emission, tuning, own.sources, self.world.sizes, named)
        if settings.guiding in (None, True) and cameras:
            with statistics.phase("guide"):
                # Of whole pictures, or a crop would not be that part of the picture.
                views = [each.whole().projection for each in cameras]
                redistribute(emission, self.simulation.guide(views))

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        limits = self.simulation.tuning.limits(number, self.world.radius)
        return Simulated(self.world, *self.simulation.simulated(number), limits)


class ScenePasses(PassRenderer):
    """Passes over a Mitsuba scene, whose light is that of `_lit_scene`."""

    _lit_scene: LitScene

    def _lighting(self, world: World) -> Lighting:
        assert isinstance(world, SceneWorld)
        return SceneLighting(world)

    def _walkings(self, world: World) -> Mapping[str, Walking]:
        return self._lit_scene.walks

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        return self._lit_scene.simulated(number)


class SceneRenderer(ScenePasses, FrameRenderer):
    """A frame of a Mitsuba scene.

    Parameters
    ----------
    plugin, sensor
        The scene, and the sensor that looks at it.
    settings
        How it is rendered.
    warned
        Texts of warnings that were given.
    extras
        What the scene itself does not say.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered; beams of an emitter that is not there.
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
        self._lit_scene = LitScene(
            plugin, place_of_sensor(sensor), settings, self._tuning, extras.beams,
            cameras if len(cameras) == len(self._sensors) else (), warned, self.statistics, self._max_depth,
        )  # fmt: skip
        self.simulation = self._lit_scene.simulation
        window = self._sensors[0].window
        reconstruction = reconstruction_filter(settings.pixel_filter, sensor.film().rfilter())
        layers = group_layers({source.group for source in self._lit_scene.sources})
        self._films = [Film(window.shape, window.crop[:2], reconstruction, layers) for _ in self._sensors]

    def _view_rays(self, number: int, view: int, places: Array2f, samples: Samples, moving: bool) -> ViewRays:
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
        return self._lit_scene.world, ViewRays(primary, None, holdout=None if holdout is None else holdout.depth)


@dataclass(frozen=True)
class Extras:
    """What is rendered of a Mitsuba scene beyond what it says itself.

    Attributes
    ----------
    beams
        What is said of beams, by the ids of emitters or of their shapes; "" are all others.
    eyes
        Cameras that look instead of the sensor, one for each view.
    holdouts
        For each view, where beams end, instead of at the scene's own surfaces.
    depth
        Whether the layer of depths is wanted.
    """

    beams: Mapping[str, scene.BeamSettings] = field(default_factory=dict)
    eyes: Sequence[scene.Camera] = ()
    holdouts: Sequence[HoldoutDepth] = ()
    depth: bool = True


def groups_of(plugin: Any, beams: Mapping[str, scene.BeamSettings]) -> dict[str, str]:
    """Return the layer of each light group of a scene."""
    return group_layers({source.group for source in _EmitterSettings.of(plugin, beams).sources})


@dataclass(frozen=True)
class _EmitterSettings:
    """The beam settings of a scene by emitter; the sources that they make, and by emitter the number of its source."""

    beams: list[scene.BeamSettings]
    sources: list[Source]
    numbers: list[int]

    @classmethod
    def of(cls, plugin: Any, given: Mapping[str, scene.BeamSettings]) -> _EmitterSettings:
        """Return the settings that are given by the names of emitters, as in `Extras`."""
        usual = given.get("", scene.BeamSettings())
        emitters = [names_of(each) for each in plugin.emitters()]
        for name in given:
            if name and not any(name in names for names in emitters):
                known = ", ".join(dict.fromkeys(names[-1] for names in emitters if names)) or "none"
                raise scene.SceneError(f"the scene has no emitter '{name}': expected one of {known}")
        beams = [next((given[name] for name in names if name in given), usual) for names in emitters]
        different = list({id(each): each for each in beams}.values()) or [usual]
        numbers = [next(place for place, each in enumerate(different) if each is own) for own in beams]
        sources = []
        for place, each in enumerate(different):
            name = next((names[-1] for names, own in zip(emitters, numbers, strict=True) if own == place and names), "")
            own = Source(place, name, each.group, each.look, each.emits_beams, each.beam_scale, each.scattered)
            sources.append(replace(own, bounces=each.bounces))
        return cls(beams, sources, numbers)

    def walked(self, world: SceneWorld, settings: Settings) -> list[int]:
        """Return the numbers of the emitters whose light walks meet."""
        if settings.method == "beams" or settings.program is not None or settings.short or not settings.surfaces:
            return []
        return [
            number for number, (own, lamp) in enumerate(zip(self.beams, world.lamps, strict=True))
            if own == scene.BeamSettings(group=own.group) and lamp is None
        ]  # fmt: skip


def walks_of(
    world: SceneWorld, walked: Sequence[int], groups: Sequence[str], tuning: Tuning, max_depth: int | None
) -> dict[str, Walking]:
    """Return the walks for emitters by light groups; `groups` are those of all emitters of the scene."""
    result = {}
    for group in dict.fromkeys(groups[each] for each in walked):
        numbers = [each for each in walked if groups[each] == group]
        result[group] = Walking(WalkedEmitters(world, numbers), max_depth, tuning.rr_depth)
    return result


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
        A hash of what is rendered: passes of another content are refused.
    warned
        Texts of warnings that were given, and are not given again.
    extras
        What the scene itself does not say.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered.
    """
    own = extras or Extras()
    about = "" if not run.named else identity(
        content, sensor.id(), window_of(sensor.film()), replace(settings, passes=1, time_limit=None), own.beams,
        own.eyes, [each.depth for each in own.holdouts],
    )  # fmt: skip

    def begin(_: int | None) -> SceneRenderer:
        return SceneRenderer(plugin, sensor, settings, warned, extras)

    return accumulate(begin, settings, run, about)
