"""`photonbeams render --workers N` or `--scheduler ADDRESS`: render frames on a farm."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import typer

from ..farm.cluster import connected, dashboard
from ..farm.run import Farm, FarmFrame, FarmState
from ..farm.work import threads_here
from ..render.checkpoint import Checkpoint, check_passes
from ..render.films.frame_sums import FrameSums
from ..runtime.limits import processors
from ..scene import SceneError
from .animation import FrameError, Task, report_line
from .outputs import checkpoint_of, finish_frame, snapshots_of, write_frame
from .progress import bar, counted, frame_line
from .request import RenderRequest

if TYPE_CHECKING:
    from ..farm.work import Opened
    from ..render.passes import Statistics
    from .render import Job


@dataclass(frozen=True)
class Request:
    """What a worker receives: the flags, the index of the first frame to render, and its number of threads."""

    render: RenderRequest
    first: int
    threads: int | None


def open_scene(request: Request) -> Opened:
    """Open the scene of a request on a worker; return a function that renders passes of it."""
    from ..render.passes import PlannedPasses
    from ..render.reuse import FilmMemory
    from .render import Job

    wanted = request.render
    if not wanted.is_mitsuba:  # the command has checked where render products go; this worker may run in another folder
        wanted = replace(wanted, stage=replace(wanted.stage, allow_paths=True))
    try:
        replace(wanted.device, threads=request.threads or threads_here()).start()
        job = Job.open(wanted, lambda: None)
        job = job.ready(job.tasks[request.first], [])
    except typer.BadParameter as error:
        raise SceneError(error.message) from None
    film = FilmMemory() if len(job.tasks) > 1 else None

    def render(frame: int, numbers: range, planned: int | None) -> dict[str, Any]:
        return job.part(job.tasks[frame], PlannedPasses(numbers, planned), film=film).state()

    return render


@dataclass
class FarmAnimation:
    """The frames of a render on a farm, and where they go."""

    job: Job
    todo: Sequence[Task]
    layers: Sequence[str]
    check: Callable[[], None]
    due: Callable[[], bool]
    _begun: float = field(default_factory=time.perf_counter)
    _written: list[Statistics] = field(default_factory=list)
    _frames: Sequence[FarmFrame] = ()
    _files: int = 0

    def render(self) -> None:
        """Render the frames of `todo`; raise FrameError from the error that ends it."""
        every = self.job.request.passes.checkpoint
        self._checkpoints = [Checkpoint(checkpoint_of(task.outputs), every) for task in self.todo]
        try:
            todo = {*self.todo}
            self._frames = [self._begin(place, task) for place, task in enumerate(self.job.tasks) if task in todo]
            if self.todo:
                self._run()
        except (Exception, KeyboardInterrupt) as error:
            raise FrameError("", len(self._written), self._keep()) from error
        skipped, seconds = len(self.job.tasks) - len(self.todo), time.perf_counter() - self._begun
        self.job.request.shown.say(report_line(self._written, skipped, self._files, seconds))

    def _begin(self, place: int, task: Task) -> FarmFrame:
        """Return a frame, with the passes of its checkpoint if it resumes one."""
        passes = self.job.settings.passes
        path = checkpoint_of(task.outputs)
        if not (self.job.request.passes.resume and path.exists()):
            return FarmFrame(task.name, place, passes, passes)
        sums = FrameSums.load(path)
        check_passes(path, sums, passes)
        left = sums.missing(passes)
        if not left:  # no worker will render a part, which would check that the checkpoint is of this picture
            self.job.render(task, None, checkpoint=Checkpoint(path, None))
        return FarmFrame(task.name, place, passes, sums.planned, left, path)

    def _run(self) -> None:
        shown, farm, threads = self.job.request.shown, self.job.request.farm, self.job.request.device.threads
        if farm.scheduler is None:
            threads = threads or max(1, processors() // (farm.workers or 1))
        with ExitStack() as stack:
            client = stack.enter_context(connected(farm.workers, farm.scheduler, farm.files))
            if (address := dashboard(client)) is not None:
                shown.say(f"Dask's dashboard: {address}")
            passes = self.job.settings.passes * len(self._frames)
            show = stack.enter_context(bar(shown.progress, shown.quiet, 1, passes))
            request = Request(self.job.request.anywhere(), self._frames[0].place, threads)

            def tick(state: FarmState) -> None:
                self.check()
                frames = f"{state.frames:,} of {counted(state.all_frames, 'frame')}"
                show(0, "", state.passes, f"{frames}, {counted(state.workers, 'worker')}")
                if self.due():
                    self._snapshot()

            memory = self.job.memory()
            Farm(
                client=client,
                open_scene=open_scene,
                request=request,
                memory=memory,
                frames=self._frames,
                joined=self._joined,
                finished=self._finished,
                tick=tick,
            ).run()

    def _joined(self, place: int) -> None:
        """Write a checkpoint of the passes that have come in, if one is due."""
        checkpoint, sums = self._checkpoints[place], self._frames[place].sums
        if sums is not None and checkpoint.due:
            checkpoint.save(sums)

    def _finished(self, place: int) -> None:
        """Write a frame, unless another machine has written it meanwhile and `--skip-existing` is given."""
        from ..shot.development import developed  # late: it starts Dr.Jit, and workers choose their device first

        task, sums = self.todo[place], self._frames[place].sums
        if sums is None:
            raise SceneError(f"frame {task.name} has no passes")
        if self.job.request.files.skip_existing and task.exists():
            return
        frame = developed(sums)
        finish_frame(frame, task.outputs, self.job.request, self.layers)
        self._written.append(frame.statistics)
        self._files += len(task.outputs)
        seconds = time.perf_counter() - self._begun
        self.job.request.shown.say(frame_line(task.name, frame.statistics, task.files, seconds))

    def _snapshot(self) -> None:
        """Write snapshots of all unfinished frames."""
        from ..shot.development import developed

        for task, frame in zip(self.todo, self._frames, strict=True):
            if frame.sums is not None:
                write_frame(developed(frame.sums), snapshots_of(task.outputs), self.job.request, self.layers)

    def _keep(self) -> str:
        """Write checkpoints of unfinished frames, if `--checkpoint` is given; return a message about what is left."""
        shown = sum(each.path.exists() for task in self.todo for each in snapshots_of(task.outputs))
        told = f"wrote {counted(shown, 'snapshot')}" if shown else ""
        kept = 0
        for frame, checkpoint in zip(self._frames, self._checkpoints, strict=False):
            if frame.sums is not None:
                checkpoint.save(frame.sums)
            kept += frame.file is not None or (frame.sums is not None and checkpoint.passes > 0)
        if not kept:
            return told
        text = "unfinished frame has a checkpoint" if kept == 1 else "unfinished frames have checkpoints"
        return ", ".join(filter(None, (told, f"{kept} {text}: --skip-existing --resume go on from there")))
