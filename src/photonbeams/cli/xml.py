"""`photonbeams render scene.xml`: a Mitsuba scene by photon beams."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from .animation import Animation, Task, print_plan
from .flags import Quality
from .outputs import Output, check_outputs, chosen_layers, prepare_outputs, write_outputs
from .progress import Progress, counted, error_note, held_interrupt, messages

if TYPE_CHECKING:
    from ..render.mitsuba_frame import Frame, Settings
    from ..render.passes import Statistics
    from ..shot.mitsuba import MitsubaScene

LAYERS = ("rgba", "surface", "beams", "depth")

#: Flags that a Mitsuba scene has a use for; the others are about stages.
FLAGS = {
    "scene", "output", "picture", "layers", "camera", "list_cameras", "res", "res_scale", "crop", "passes",
    "time_limit", "beams", "estimator", "rule", "order", "overrides", "exposure", "seed", "threads", "device",
    "progress", "dry_run", "quiet", "verbose", "skip_existing", "checkpoint", "resume",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the flags ask for."""

    path: Path
    outputs: Sequence[Output]
    quality: Quality
    camera: str | None
    parameters: Sequence[str]
    res: tuple[int, int]
    res_scale: float
    crop: tuple[float, float, float, float] | None
    layers: str | None
    exposure: float
    checkpoint: float | None
    resume: bool
    skip_existing: bool
    progress: Progress | None
    dry_run: bool
    list_cameras: bool
    quiet: bool
    verbose: bool
    command: str


class Kept(KeyboardInterrupt):
    """Ctrl-C after a checkpoint was written; `done` says so."""

    def __init__(self, done: str) -> None:
        super().__init__(done)
        self.done = done


def check_given(context: typer.Context) -> None:
    """Refuse flags that are about stages."""
    flags = {each.name: each.opts[0] for each in context.command.params}
    for name in context.params:
        source = getattr(context.get_parameter_source(name), "name", "")
        if source == "COMMANDLINE" and name not in FLAGS:
            raise typer.BadParameter(f"{flags[name]} is for stages: a Mitsuba scene (.xml) has no use for it")


def render_xml(asked: Asked, start: Callable[[], None]) -> None:
    """Render a Mitsuba scene; `start` starts the device."""
    if asked.checkpoint is not None and not asked.checkpoint > 0:
        raise typer.BadParameter(f"--checkpoint is {asked.checkpoint}: expected a positive number of seconds")
    with messages(asked.quiet, asked.verbose), held_interrupt() as check:
        start()
        from ..shot.mitsuba import MitsubaScene

        scene = MitsubaScene(asked.path, asked.camera, _parameters(asked.parameters))
        if asked.list_cameras:
            typer.echo("\n".join(scene.cameras))
            return
        if not asked.dry_run:
            check_outputs(asked.outputs)
        width, height = scene.resize(asked.res[0] or None, asked.res[1] or None)
        scale = asked.res_scale
        width, height = scene.resize(max(1, round(scale * width)), max(1, round(scale * height)), asked.crop)
        settings = _settings(scene.settings, asked.quality)
        kept = chosen_layers(asked.layers, asked.outputs, LAYERS)
        task = Task(None, asked.path.stem, tuple(asked.outputs))
        animation = Animation([task], settings.passes, asked.skip_existing, asked.progress, asked.quiet)
        if animation.todo():
            prepare_outputs(asked.outputs)
        check()
        if asked.dry_run:
            scene.check(settings)
            if not asked.quiet:
                seen_by = scene.sensor.id() or scene.cameras[0]
                print_plan(f"{asked.path} seen by {seen_by}, {width} x {height} pixels", [task], animation.todo(), kept)
            return

        def finish(task: Task, advance: Callable[..., None]) -> Statistics:
            frame = _render(scene, settings, asked, advance)
            frame.metadata["commandLine"] = asked.command
            write_outputs(frame, task.outputs, kept, asked.exposure, chosen=asked.layers is not None)
            checkpoint_of(task.outputs).unlink(missing_ok=True)
            statistics: Statistics = frame.statistics
            return statistics

        animation.render(finish, check)


def _settings(own: Settings, quality: Quality) -> Settings:
    """Return the scene's settings, and what flags give instead."""
    values = quality.values(len(own.rule))
    if "beams" in values:
        values["paths"] = values.pop("beams")
    return replace(own, **values)


def _render(scene: MitsubaScene, settings: Settings, asked: Asked, advance: Callable[..., None]) -> Any:
    """Return the frame, having written checkpoints on the way, the last one when Ctrl-C is pressed."""
    from ..shot.mitsuba import load_checkpoint, save_checkpoint

    path = checkpoint_of(asked.outputs)
    state = load_checkpoint(path, scene, settings) if asked.resume else None
    written, kept = time.perf_counter(), 0

    def save(passes: int, frame: Frame) -> None:
        nonlocal written, kept
        if asked.checkpoint is not None and passes:
            save_checkpoint(path, scene, frame)
            written, kept = time.perf_counter(), passes

    def done(passes: int, frame: Frame) -> None:
        try:
            advance(passes, error_note(frame.error()))
        except KeyboardInterrupt:
            save(passes, frame)
            raise
        due = asked.checkpoint is not None and time.perf_counter() - written >= asked.checkpoint
        if due and passes < settings.passes:
            save(passes, frame)

    try:
        return scene.render(settings, done, state)
    except KeyboardInterrupt as interrupt:
        if kept:
            raise Kept(f"{path} has {counted(kept, 'pass', 'passes')}: --resume goes on from there") from interrupt
        raise


def checkpoint_of(outputs: Sequence[Output]) -> Path:
    """Return where the checkpoint of a render is: beside its first output."""
    first = outputs[0].path
    return first.with_name(f"{first.stem}.checkpoint.npz")


def _parameters(texts: Sequence[str]) -> dict[str, str]:
    """Return the file's parameters that flags give."""
    result = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not name or not _:
            raise typer.BadParameter(f"--set is {text}: expected NAME=VALUE, a parameter of the .xml")
        result[name] = value
    return result
