"""Render frames of either kind of scene: outputs, checkpoints, progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import typer

from .animation import Animation, Task, print_plan
from .asked import Asked
from .outputs import Output, chosen_layers, prepare_outputs, write_outputs
from .progress import counted, error_note, held_interrupt, messages

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..render.checkpoint import Checkpoint
    from ..render.passes import Progress, Statistics
    from ..render.settings import Settings


class Job(Protocol):
    """An open scene and the request for it. Methods raise SceneError or BadParameter."""

    settings: Settings

    def cameras(self) -> list[str]:
        """Return the names of all cameras."""

    def tasks(self) -> list[Task]:
        """Return the frames and their files; `settings` are known then."""

    def layers(self, first: Task) -> Sequence[str]:
        """Return the names of the layers that a frame has."""

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """Raise what rendering these frames would raise, as far as that is quickly known."""

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, camera and size."""

    def render(self, task: Task, progress: Progress, checkpoint: Checkpoint | None) -> Frame:
        """Return a frame."""


class Kept(KeyboardInterrupt):
    """Ctrl-C after a checkpoint was written; `done` says so."""

    def __init__(self, done: str) -> None:
        super().__init__(done)
        self.done = done


def run(asked: Asked, opened: Callable[[Asked, Callable[[], None]], Job]) -> None:
    """Render what the flags ask for; `opened` opens the scene, and is given what raises a Ctrl-C held back."""
    with messages(asked.quiet, asked.verbose), held_interrupt() as check:
        asked.start_device()
        job = opened(asked, check)
        if asked.list_cameras:
            typer.echo("\n".join(job.cameras()))
            return
        tasks = job.tasks()
        animation = Animation(tasks, job.settings.passes, asked.skip_existing, asked.progress, asked.quiet)
        todo = animation.todo()
        first = (todo or tasks)[0]
        kept = chosen_layers(asked.layers, first.outputs, job.layers(first))
        job.check(first, todo)
        for task in todo:
            prepare_outputs(task.outputs)
        check()
        if asked.dry_run:
            if not asked.quiet:
                print_plan(job.seen(first), tasks, todo, kept)
            return

        def finish(task: Task, advance: Callable[[int, str], None]) -> Statistics:
            frame = _rendered(job, asked, task, advance, several=len(tasks) > 1)
            for metadata in [frame.metadata, *(each for _, each in frame.views.values())]:
                metadata["commandLine"] = asked.command
            write_outputs(frame, task.outputs, kept, asked.exposure, chosen=asked.layers is not None)
            checkpoint_of(task.outputs).unlink(missing_ok=True)
            return frame.statistics

        animation.render(finish, check)


def _rendered(job: Job, asked: Asked, task: Task, advance: Callable[[int, str], None], *, several: bool) -> Frame:
    """Return a frame, having written checkpoints on the way, the last one when Ctrl-C is pressed."""
    from ..render.checkpoint import Checkpoint

    checkpoint = None
    if asked.checkpoint is not None or asked.resume:
        checkpoint = Checkpoint(checkpoint_of(task.outputs), asked.checkpoint, asked.resume)
    try:
        return job.render(task, lambda done, statistics: advance(done, error_note(statistics.error)), checkpoint)
    except KeyboardInterrupt as interrupt:
        if checkpoint is None or not checkpoint.passes:
            raise
        passes = counted(checkpoint.passes, "pass", "passes")
        flags = "--skip-existing --resume" if several else "--resume"
        verb = "go" if several else "goes"
        raise Kept(f"{checkpoint.path} has {passes}: {flags} {verb} on from there") from interrupt


def checkpoint_of(outputs: Sequence[Output]) -> Path:
    """Return where the checkpoint of a frame is: beside its first output."""
    first = outputs[0].path
    return first.with_name(f"{first.stem}.checkpoint.npz")
