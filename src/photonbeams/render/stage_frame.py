"""Frames of stages: with shutter, stereo and holdouts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from .. import scene
from ..beams.guides import known_guides, pieces_along
from ..beams.sets import BeamSet
from ..runtime.device import mitsuba, mitsuba_variant, uncollected
from ..world.cameras.cameras import Window
from ..world.shutter import Moment, Shutter
from .checkpoint import identity
from .films.film import Film
from .films.layers import group_layers
from .films.layers import layer_names as names_of
from .films.pixel_filters import reconstruction_filter
from .frame import DEFAULTS, FrameRenderer, PassMemory
from .holdouts import HoldoutDepth
from .memory import check_memory
from .passes import PLAIN_RUN, RunOptions, Statistics, accumulate
from .settings import Settings, as_passes
from .stage_light import Earlier, light_of_stage
from .views import FrameView


def render(
    shutter: Shutter,
    window: Window,
    settings: Settings = DEFAULTS,
    run: RunOptions = PLAIN_RUN,
    holdouts: Sequence[HoldoutDepth] = (),
    content: str = "",
    viewers: Callable[[], Sequence[scene.Camera]] | None = None,
) -> FrameRenderer:
    """Render one frame.

    Parameters
    ----------
    shutter, window
        The scene and cameras over the shutter interval, and the size of the picture with its crop.
    settings
        Passes, estimator, seed.
    run
        Which passes, callbacks, and what is kept: see `RunOptions`.
    holdouts
        For each view, the depth at which beams end. The scene's own surfaces are then not seen, but still stop light.
    content
        A hash of the content; passes of another content are refused.
    viewers
        Returns the cameras of all frames, for which emission is guided; None: the cameras of this frame.

    Raises
    ------
    SceneError
        If there is nothing to see, a portal has no area, a pass does not fit into memory, or a checkpoint is of another
        picture.
    """
    check(shutter.at(0.0).scene)
    shutter = _in_medium(shutter)
    memory_of(shutter.at(0.0).scene, window, settings)

    about = identity(content, *_identity(shutter, window, settings, holdouts)) if run.named else ""
    begun = begin if run.film is None else run.film.begin
    return accumulate(
        lambda planned: begun(shutter, window, settings, holdouts, viewers, planned), settings, run, about
    )


def _identity(shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[HoldoutDepth]) -> list[Any]:
    """Return what has to be the same for passes to be of one picture, beside the shot's content."""
    program = settings.program and (settings.program.modifier, settings.program.frame)
    return [
        shutter.moving, shutter.at(0.0).cameras, window, program,
        replace(as_passes(settings), program=None), [each.content for each in holdouts],
    ]  # fmt: skip


@uncollected()
def simulate(
    shutter: Shutter, window: Window, settings: Settings = DEFAULTS, number: int = 0,
    viewers: Callable[[], Sequence[scene.Camera]] | None = None,
) -> list[BeamSet]:  # fmt: skip
    """Return the beams of pass `number` of a frame, as in `render`; the scene needs no fog for that."""
    description = shutter.at(0.0).scene
    if not makers(description) and not description.groups:
        raise scene.SceneError("the stage has no light that makes beams: expected a UsdLux light, or drawn beams")
    shutter = _in_medium(shutter)
    memory_of(shutter.at(0.0).scene, window, settings)
    mitsuba(mitsuba_variant())
    light, _ = light_of_stage(shutter, window, settings, Statistics(), viewers, settings.passes, all_beams=True)
    return light.traced(number, lambda: None).sets


def _in_medium(shutter: Shutter) -> Shutter:
    """Return the shot; if it has no medium, with a vacuum as its medium."""
    if shutter.at(0.0).scene.media:
        return shutter
    return replace(shutter, at=_in_vacuum(shutter.at), before=shutter.before and _in_vacuum(shutter.before))


def _in_vacuum(at: Callable[[float], Moment]) -> Callable[[float], Moment]:
    """Return `at` with a medium that does not change light: there are beams only in media."""

    @lru_cache(maxsize=8)
    def moment(fraction: float) -> Moment:
        found = at(fraction)
        return found._replace(scene=replace(found.scene, media=(_VACUUM,)))

    return moment


_VACUUM = scene.Medium(scene.BLACK)


def check(description: scene.Scene) -> None:
    """Raise SceneError if a scene has nothing to see: nothing at all, or no light."""
    if not (description.meshes or description.lights or description.media or description.drawn or description.groups):
        raise scene.SceneError("there is nothing to render: expected meshes, lights, fog or drawn beams")
    if is_unlit(description):
        text = "there is no light, and the picture would be black: expected a UsdLux light, a surface that glows, or "
        raise scene.SceneError(f"{text}drawn beams")


def is_unlit(description: scene.Scene) -> bool:
    """Return whether a scene has no light at any time, and nothing that glows."""
    glowing = any(_glows(mesh.material) for mesh in description.meshes)
    return not (description.lights or description.drawn or description.groups or glowing)


def _glows(material: scene.Material) -> bool:
    return not isinstance(material.emissive, tuple) or any(material.emissive)


def makers(description: scene.Scene) -> list[str]:
    """Return the names of the lights and drawn beams that make beams."""
    lights = [light.name for light in description.lights if light.emits_beams]
    return lights + [each.name for each in description.drawn]


def black(description: scene.Scene) -> list[str]:
    """Return the names of all lights and drawn beams if all of them are black; else an empty list."""
    emitting = [light for light in description.lights if light.emits_beams]
    shining = any(light.beam_scale * max(light.radiance) > 0 for light in emitting)
    if shining or any(len(each.start) and np.max(each.power) > 0 for each in description.drawn):
        return []
    return makers(description)


def memory_of(description: scene.Scene, window: Window, settings: Settings) -> int:
    """Return how many bytes a pass takes; SceneError if it does not fit into memory."""
    usual = settings.beams or scene.DEFAULT_BEAMS
    counts = [usual if light.beam_count is None else light.beam_count for light in description.lights]
    pieces = [_pieces(light) for light in description.lights]
    beams = sum(
        count * each for light, count, each in zip(description.lights, counts, pieces, strict=True) if light.emits_beams
    )
    return check_memory(window, beams, len(groups_of(description)))


def layer_names(description: scene.Scene) -> list[str]:
    """Return the names of a frame's layers, in their order."""
    return names_of(groups_of(description))


def groups_of(description: scene.Scene) -> dict[str, str]:
    """Return the layer of each light group of the shot."""
    groups = {light.group for light in description.lights if light.emits_beams or light.group}
    groups |= {light.group for light in description.sky}
    return group_layers(groups | {drawn.group for drawn in description.drawn} | description.groups)


@uncollected()
def begin(
    shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[HoldoutDepth] = (),
    viewers: Callable[[], Sequence[scene.Camera]] | None = None, planned: int | None = None,
    earlier: Earlier | None = None, memory: PassMemory | None = None, interrupt: Callable[[], None] | None = None,
) -> FrameRenderer:  # fmt: skip
    """Return a frame of a stage without passes.

    Parameters
    ----------
    shutter, window, settings, holdouts, viewers
        As in `render`.
    planned
        How many passes share the shutter interval and each pixel's sample sequence; further passes begin both again.
        None: the number of passes is not known.
    earlier, memory
        An earlier frame of the same shot, and parts of passes that are kept.
    interrupt
        Called between parts of passes; an exception from it ends the frame.
    """
    mitsuba(mitsuba_variant())
    statistics = Statistics(interrupt=interrupt)
    light, worlds = light_of_stage(shutter, window, settings, statistics, viewers, planned, earlier=earlier)
    opened = shutter.at(0.0)
    reconstruction, groups, size = (
        reconstruction_filter(settings.filter_name), groups_of(opened.scene), (window.width, window.height),
    )  # fmt: skip
    films = [
        Film(window.shape, window.crop[:2], reconstruction, groups, settings.denoise, size) for _ in opened.cameras
    ]
    turned: set[str] = set()
    depths: Sequence[HoldoutDepth | None] = holdouts or [None] * len(films)
    views = [
        FrameView(window, partial(worlds.camera, view=view), holdout, turned=turned)
        for view, holdout in zip(range(len(films)), depths, strict=True)
    ]
    return FrameRenderer(
        settings, light, views, films, light.max_depth, statistics, planned, memory=memory, later=shutter.later
    )


def _pieces(light: scene.Light) -> int:
    """Return how many beams a light's guides make from one."""
    return pieces_along(known_guides(light.guides)) + 2 if light.guides else 1
