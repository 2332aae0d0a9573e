"""Frames of Mitsuba scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .. import scene
from ..constants import DEFAULT_PATHS
from ..runtime.device import uncollected
from ..world.cameras.cameras import Window
from ..world.cameras.sensors import Sensor, window_of
from ..world.shutter import CameraMotion
from .checkpoint import identity
from .films.film import Film
from .films.layers import group_layers
from .films.pixel_filters import reconstruction_filter
from .frame import DEFAULTS, FrameRenderer
from .holdouts import HoldoutDepth
from .memory import check_memory
from .passes import PLAIN_RUN, RunOptions, Statistics, accumulate
from .pilots.pilot import Findings
from .scene_light import EmitterSettings, light_of
from .settings import Settings, as_passes
from .views import FrameView


@uncollected()
def begin(
    plugin: Any, sensor: Any, settings: Settings = DEFAULTS, warned: set[str] | None = None,
    extras: Extras | None = None,
) -> FrameRenderer:  # fmt: skip
    """Return a frame of a Mitsuba scene without passes.

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
    extras, statistics = extras or Extras(), Statistics()
    sensors = [Sensor(sensor, eye) for eye in extras.eyes or (None,)]
    window = sensors[0].window
    layers = groups_of(plugin, extras.beams)
    memory_of(plugin, window, settings, extras.beams)
    holdouts: Sequence[HoldoutDepth | None] = extras.holdouts or [None] * len(sensors)
    cameras = [each.view for each in sensors if each.view is not None]
    reconstruction = reconstruction_filter(settings.filter_name, sensor.film().rfilter())
    light = light_of(
        plugin=plugin,
        eye=sensors[0].start(),
        settings=settings,
        beams=extras.beams,
        cameras=cameras if len(cameras) == len(sensors) else (),
        warned=warned,
        statistics=statistics,
        findings=extras.findings,
    )
    films = [Film(window.shape, window.crop[:2], reconstruction, layers, settings.denoise) for _ in sensors]
    views = [view_of(each, holdout) for each, holdout in zip(sensors, holdouts, strict=True)]
    return FrameRenderer(settings, light, views, films, settings.depth(), statistics, depth=extras.depth)


def view_of(sensor: Sensor, holdout: HoldoutDepth | None = None) -> FrameView:
    """Return the view of a sensor, which is at rest."""
    if sensor.view is None:
        return FrameView(sensor.window, None, None, sensor.plugin)
    camera = sensor.view.camera
    return FrameView(sensor.window, lambda _: CameraMotion(camera, camera, camera), holdout, clips=True)


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


def memory_of(plugin: Any, window: Window, settings: Settings, beams: Mapping[str, scene.BeamSettings]) -> int:
    """Return how many bytes a pass takes; SceneError if it does not fit into memory."""
    return check_memory(window, settings.beams or DEFAULT_PATHS, len(groups_of(plugin, beams)))


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
) -> FrameRenderer:
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
        own.eyes, [each.content for each in own.holdouts],
    )  # fmt: skip

    return accumulate(lambda _: begin(plugin, sensor, settings, warned, extras), settings, run, about)
