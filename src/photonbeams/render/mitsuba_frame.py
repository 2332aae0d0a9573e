"""A picture of a Mitsuba scene: the mean of passes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .checkpoint import Checkpoint
from .passes import Progress, accumulate
from .renderer import SceneFrame
from .settings import DEFAULTS, Settings


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
