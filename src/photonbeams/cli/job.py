"""Render frames of a stage or a Mitsuba scene, with outputs, checkpoints and progress."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import typer

from ..runtime.limits import check_address_space
from .animation import Animation, Task, print_plan
from .outputs import checkpoint_of, chosen_layers, finish_frame, prepare_outputs, snapshots_of, write_frame
from .progress import HeldSignals, counted, error_note, held_signals, messages, snapshots
from .request import RenderRequest

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..render.films.frame_sums import FrameSums
    from ..render.passes import PlannedPasses, Progress, Statistics
    from ..render.settings import Settings
    from ..shot import Shot


# Bytes of a pixel's sums in a view, and of the program with a scene.
_SUMS_BYTES, _PROGRAM_BYTES = 300, 1 << 30


class Job(ABC):
    """An open scene and what the flags ask of it. Methods raise SceneError or BadParameter."""

    settings: Settings
    _request: RenderRequest
    _shot: Shot
    _size: tuple[int, int]

    @abstractmethod
    def cameras(self) -> list[str]:
        """Return the names of all cameras."""

    @abstractmethod
    def tasks(self) -> list[Task]:
        """Return the frames and their files, and set `settings`."""

    @abstractmethod
    def layers(self, first: Task) -> Sequence[str]:
        """Return the names of the layers that a frame has."""

    @abstractmethod
    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """Raise what rendering these frames would raise, as far as a quick look can tell."""

    @abstractmethod
    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, camera and size."""

    @property
    @abstractmethod
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""

    def render(self, task: Task, progress: Progress | None, **kept: Any) -> Frame:
        """Return a rendered frame; `kept` are further arguments of `Shot.render`."""
        return self._shot.render(task.number, progress=progress, **kept, **self._given)

    def part(self, task: Task, part: PlannedPasses, progress: Progress | None = None) -> FrameSums:
        """Return the sums of some passes of a frame."""
        return self._shot.render_part(part, task.number, progress=progress, **self._given)

    def memory(self) -> int:
        """Return about how many bytes a pass needs; a large stage or many beams need more."""
        return _PROGRAM_BYTES + self.picture_memory()

    def picture_memory(self) -> int:
        """Return about how many bytes the picture needs."""
        from ..images.frame import pixels_of
        from ..render.memory import PIXEL_BYTES

        views = 2 if self._request.eyes.stereo and self._request.eyes.eye is None else 1
        left, top, right, bottom = pixels_of(self._given["crop"], *self._size, overscan=True)
        return (right - left) * (bottom - top) * (PIXEL_BYTES + views * _SUMS_BYTES)


def layers_with(names: Sequence[str], settings: Settings) -> list[str]:
    """Return the names of a frame's layers: `names`, and those that the settings add."""
    from ..render.films.sums import NOISY

    more = {"normal": settings.normals, "albedo": settings.albedo}
    noisy = [NOISY + name for name in names if name.startswith(("surface", "beams"))] if settings.keep_noisy else []
    return [*names, *(name for name, wanted in more.items() if wanted), *noisy]


class Kept(KeyboardInterrupt):
    """A signal that ended a render after a checkpoint was written; `done` says so."""

    def __init__(self, done: str) -> None:
        super().__init__(done)
        self.done = done


def opened(request: RenderRequest, check: Callable[[], None]) -> Job:
    """Open the scene of a request; `check` raises KeyboardInterrupt for a delayed Ctrl-C."""
    from .stage import StageJob
    from .xml import MitsubaJob

    return MitsubaJob(request, check) if request.is_mitsuba else StageJob(request, check)


def run(request: RenderRequest) -> None:
    """Render what the flags ask for."""
    shown, passes = request.shown, request.passes
    with messages(shown.quiet, shown.verbose), held_signals() as check, snapshots(passes.snapshot) as due:
        request.device.start()
        with check.forced():
            job = opened(request, check)
        if request.views.list_cameras:
            typer.echo("\n".join(job.cameras()))
            return
        tasks = job.tasks()
        part = None if passes.part is None else passes.part.of(job.settings.passes)
        count = len(part) if part is not None else None if job.settings.error else job.settings.passes
        animation = Animation(tasks, count, request.files.skip_existing, shown.progress, shown.quiet)
        todo = animation.todo()
        kept = _ready(job, request, tasks, todo, check)
        if shown.dry_run:
            if not shown.quiet:
                print_plan(job.seen((todo or tasks)[0]), tasks, todo, kept)
            return
        farm = request.farm.options_of(request.device.threads)
        if farm is not None:
            from .farm import FarmAnimation

            FarmAnimation(job, request, tasks, todo, kept, check, due).render(farm)
            return

        def finish(task: Task, advance: Callable[[int, str], None]) -> Statistics:
            if part is not None:
                return _part_written(job, part, task, advance, check)
            frame = _rendered(job, request, task, advance, kept, due, check, several=len(tasks) > 1)
            finish_frame(frame, task.outputs, request, kept)
            return frame.statistics

        animation.render(finish, check)


def _ready(
    job: Job, request: RenderRequest, tasks: Sequence[Task], todo: Sequence[Task], check: HeldSignals
) -> Sequence[str]:
    """Check all that can be checked before the first pass; return the layers that files keep."""
    from ..render.films.denoising import check_denoiser

    first = (todo or tasks)[0]
    with check.forced():
        kept = chosen_layers(request.files.layers, first.outputs, job.layers(first))
        job.check(first, todo)
    check_address_space(job.picture_memory())
    for task in todo:
        prepare_outputs(task.outputs)
    if job.settings.denoise:
        check_denoiser()
    check()
    return kept


def _part_written(
    job: Job, numbers: range, task: Task, advance: Callable[[int, str], None], check: HeldSignals
) -> Statistics:
    """Render some passes of a frame, and write their sums."""
    from ..render.passes import PlannedPasses, Statistics

    begun, start = numbers.start, time.perf_counter()
    part = PlannedPasses(numbers, job.settings.passes)
    with check.forced():
        sums = job.part(task, part, lambda done, _: advance(done, f"from {begun}"))
    for output in task.outputs:
        sums.save(output.path)
    return Statistics(len(sums), sums.beams, sums.tests, {"passes": time.perf_counter() - start})


def _rendered(
    job: Job, request: RenderRequest, task: Task, advance: Callable[[int, str], None], kept: Sequence[str],
    due: Callable[[], bool], check: HeldSignals, *, several: bool,
) -> Frame:  # fmt: skip
    """Render a frame, writing checkpoints and snapshots on the way, and a checkpoint if a signal ends it."""
    from ..render.checkpoint import Checkpoint

    checkpoint = None
    passes = request.passes
    if passes.checkpoint is not None or passes.resume:
        checkpoint = Checkpoint(checkpoint_of(task.outputs), passes.checkpoint, passes.resume)

    def progress(done: int, statistics: Statistics) -> None:
        advance(done, error_note(statistics.error, job.settings.error))

    def snapshot(frame: Callable[[], Frame]) -> None:
        if due():
            write_frame(frame(), snapshots_of(task.outputs), request, kept)

    def kept_passes() -> str | None:
        if checkpoint is None or not checkpoint.passes:
            return None
        done = counted(checkpoint.passes, "pass", "passes")
        flags = "--skip-existing --resume go" if several else "--resume goes"
        return f"{checkpoint.path} has {done}: {flags} on from there"

    def rescue() -> str | None:
        if checkpoint is not None:
            checkpoint.rescue()
        return kept_passes()

    try:
        with check.forced(rescue):
            return job.render(task, progress, checkpoint=checkpoint, snapshot=snapshot)
    except KeyboardInterrupt as interrupt:
        if (text := kept_passes()) is None:
            raise
        raise Kept(text) from interrupt
