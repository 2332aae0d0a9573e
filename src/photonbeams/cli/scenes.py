"""Open what `photonbeams render` renders, as the flags ask; imported once the device has started."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import typer

from ..images.numbering import PLACEHOLDER
from ..shot import Shot
from ..usd.common.selection import keep
from ..usd.common.warnings import Warnings
from ..usd.layers.frames import check_frames
from ..usd.render_passes import apply_pass
from ..usd.settings import PIXEL_FILTER, RenderSettings, read_settings
from ..usd.stage import enable_domes, list_cameras, open_stage
from .animation import frame_numbers
from .groups import usage_errors
from .programs import load_looks
from .request import RenderRequest

if TYPE_CHECKING:
    from pxr import Usd

    from ..shot.scene_subject import SceneSubject


def camera_names(request: RenderRequest) -> list[str]:
    """Return the names of all cameras, or of all sensors of a Mitsuba scene."""
    if request.is_mitsuba:
        return [*_scene(request).sensors(frame_numbers(request.files.frames, request.outputs)[0])]
    return list_cameras(_stage(request, Warnings(request.strict))[0])


def opened(
    request: RenderRequest, numbers: Sequence[float | None], check: Callable[[], None]
) -> tuple[Shot, RenderSettings]:
    """Return the shot of the request and the render settings of its stage; those of a Mitsuba scene are empty.

    `check` raises KeyboardInterrupt for a delayed Ctrl-C.
    """
    camera, stereo = request.views.camera or None, request.eyes.eyes()
    if request.is_mitsuba:
        if len(numbers) > 1 and not PLACEHOLDER.search(request.scene.name):
            text = f"expected one run of # in {request.scene.name}, too"
            raise typer.BadParameter(f"--frames is {request.files.frames}: {text}")
        return Shot(_scene(request), camera, stereo=stereo), RenderSettings()
    check()
    warnings = Warnings(request.strict)
    stage, path = _stage(request, warnings)
    check_frames(stage, [number for number in numbers if number is not None])
    check()
    own = _render_settings(request, stage, path, warnings)
    shot = Shot(
        stage, camera or own.camera, medium=request.stage.fog.on(stage), stereo=stereo,
        looks=load_looks("--look", request.looks.look or ()), strict=warnings,
        **request.stage.programs.loaded(),
    )  # fmt: skip
    return shot, own


def _scene(request: RenderRequest) -> SceneSubject:
    from ..shot.scene_subject import SceneSubject, values_by_name

    looks = request.looks
    with usage_errors():
        groups = values_by_name(looks.group or (), "--group is", "EMITTER=NAME, such as lamp=key")
        parameters = values_by_name(looks.overrides or (), "--set is")
    return SceneSubject(
        request.scene, load_looks("--look", looks.look or ()), groups, parameters=parameters,
        session_layers=looks.session_layer or (),
    )  # fmt: skip


def _stage(request: RenderRequest, warnings: Warnings) -> tuple[Usd.Stage, str | None]:
    """Return the stage, and the path of its render settings, if one is named."""
    own, looks = request.stage, request.looks
    layers = looks.session_layer or (), looks.overrides or ()
    stage = open_stage(
        request.scene, *layers, warnings, own.texture_limit, own.selection.selection(), own.working_space,
        own.color_space,
    )  # fmt: skip
    if own.dome_beams:
        enable_domes(stage)
    path = None if own.render_pass is None else apply_pass(stage, own.render_pass, warnings)
    keep(stage.GetSessionLayer(), renderSettings=own.render_settings or path)
    return stage, own.render_settings or path


def _render_settings(request: RenderRequest, stage: Usd.Stage, path: str | None, warnings: Warnings) -> RenderSettings:
    """Return the stage's render settings, without warnings about values that flags replace."""
    views = request.views
    flags = {
        "camera": views.camera, "resolution": any(views.res), "dataWindowNDC": views.crop,
        "products": request.outputs, PIXEL_FILTER: "filter" in request.settings.values,
    }  # fmt: skip
    return read_settings(stage, path, [name for name, value in flags.items() if value], warnings)
