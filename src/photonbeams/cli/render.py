"""Render frames of a stage or a Mitsuba scene, with outputs, checkpoints and progress."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ..constants import REQUESTED
from ..runtime.limits import check_address_space, memory
from .animation import Task, frame_numbers, plan, render_frames, tasks_of
from .outputs import (
    check_beside,
    check_outputs,
    checkpoint_of,
    chosen_layers,
    finish_frame,
    prepare_outputs,
    snapshots_of,
    write_frame,
)  # fmt: skip
from .progress import (
    HeldSignals,
    counted,
    error_note,
    held_signals,
    messages,
    snapshots,
    spoken,
    standard_output,
)
from .request import RenderRequest

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..images.plates import Holdout, Plate
    from ..render.films.frame_sums import FrameSums
    from ..render.passes import PlannedPasses, Progress, Statistics
    from ..render.reuse import FilmMemory
    from ..render.settings import Settings
    from ..runtime.files import PathLike
    from ..shot import Shot
    from ..shot.estimate import RenderEstimate
    from ..usd.settings import RenderSettings


# Bytes of a pixel's sums in a view, and of the program with a scene.
_SUMS_BYTES, PROGRAM_BYTES = 300, 1 << 30


@dataclass(frozen=True)
class Job:
    """An open scene, and what is asked of it. Methods raise SceneError or BadParameter."""

    request: RenderRequest
    shot: Shot
    own: RenderSettings  # those of the stage; flags are stronger
    settings: Settings
    tasks: Sequence[Task]
    size: tuple[int, int] = (0, 0)  # of all frames, in pixels; `ready` finds it

    @classmethod
    def open(cls, request: RenderRequest, check: Callable[[], None]) -> Job:
        """Open the scene of a request; `check` raises KeyboardInterrupt for a delayed Ctrl-C."""
        from .scenes import opened

        numbers = frame_numbers(request.files.frames, request.outputs)
        shot, own = opened(request, numbers, check)
        if request.shown.renders:
            check_outputs(request.outputs or own.products)
        first = shot.settings(numbers[0])
        asked: dict[str, Any] = {name: request.wants(layers[0], own.products) for name, layers in REQUESTED.items()}
        asked["deep"] = request.wants_deep(own.products)
        pixel_filter = own.pixel_filter or first.pixel_filter
        settings = request.settings.over(replace(first, pixel_filter=pixel_filter, **asked))
        anywhere = bool(request.stage.render_settings) or request.stage.allow_paths
        tasks = tasks_of(
            shot, numbers, request.outputs, own.products, anywhere=anywhere, single_part=request.files.single_part
        )
        return cls(request, shot, own, settings, tasks)

    def layers(self, first: Task) -> list[str]:
        """Return the names of the layers that a frame has."""
        from ..render.films.sums import NOISY

        names = self.shot.subject.layers(self.shot.viewpoint, first.number)
        more = [layer for name, layers in REQUESTED.items() if getattr(self.settings, name) for layer in layers]
        noisy = [NOISY + name for name in names if name.startswith(("surface", "beams")) and self.settings.keep_noisy]
        return [*names, *more, *noisy]

    def files(self, todo: Sequence[Task]) -> Iterator[PathLike]:
        """Yield the files from which frames are read: those of the scene, and those that flags name."""
        from ..usd.cameras.stereo import views_of

        subject, request = self.shot.subject, self.request
        yield from subject.files([task.number for task in todo])
        yield from request.programs
        for task in todo:
            yield from request.plates.files(subject.number(task.number), views_of(self.shot.stereo, request.eyes.eye))

    def ready(self, first: Task, todo: Sequence[Task]) -> Job:
        """Return the job with the size of its frames.

        Raises what rendering these frames would raise about their size and about plates; in a dry run, also what it
        would raise about a Mitsuba scene, which rendering itself raises early enough.
        """
        from ..usd.cameras.stereo import views_of

        request, subject = self.request, self.shot.subject
        plates = [each for each in (request.plates.end(), request.plates.plate()) if each is not None]
        size = self._resolution(first.number, plates)
        for task in todo:
            for plate in plates:
                plate.check(subject.number(task.number), views_of(self.shot.stereo, request.eyes.eye), size)
        if not request.shown.renders:
            subject.check(self.shot.viewpoint, first.number, self.settings)
        return replace(self, size=size)

    def _resolution(self, number: float | None, plates: Sequence[Holdout | Plate]) -> tuple[int, int]:
        """Return width and height in pixels."""
        views, shot = self.request.views, self.shot
        wanted = views.res if any(views.res) else self.own.resolution or views.res
        aspect, eye = self.own.pixel_aspect, self.request.eyes.eye
        width, height = shot.resolution(wanted[0] or None, wanted[1] or None, number, plates, eye, aspect)
        scaled = max(1, round(views.res_scale * width)), max(1, round(views.res_scale * height))
        return shot.resolution(*scaled, number)

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, camera and size."""
        seen_by = " and ".join(self.shot.subject.camera_names(self.shot.viewpoint, first.number))
        return f"{self.request.scene} seen by {seen_by}, {self.size[0]} x {self.size[1]} pixels"

    @property
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""
        (width, height), request, own = self.size, self.request, self.own
        return {
            "settings": self.settings, "width": width, "height": height,
            "crop": request.views.crop_of(width, height, own.crop(width, height)), "pixel_aspect": own.pixel_aspect,
            "conform": own.conform, "view": request.eyes.eye, "holdout": request.plates.end(),
            "over": request.plates.plate(), "blur": not own.disable_motion_blur,
            "lens": not own.disable_depth_of_field,
        }  # fmt: skip

    def render(self, task: Task, progress: Progress | None, **kept: Any) -> Frame:
        """Return a rendered frame; `kept` are further arguments of `Shot.render`."""
        return self.shot.render(task.number, progress=progress, **kept, **self._given)

    def part(
        self, task: Task, part: PlannedPasses, progress: Progress | None = None, film: FilmMemory | None = None
    ) -> FrameSums:
        """Return the sums of some passes of a frame, which has a `film` in common with others."""
        return self.shot.render_part(part, task.number, progress=progress, film=film, **self._given)

    def estimate(self, task: Task) -> RenderEstimate:
        """Return how long a frame takes, and how much memory."""
        return self.shot.estimate(task.number, **self._given)

    def frames(self) -> int:
        """Return the number of frames: those of the flags, or else all of the stage's."""
        from ..usd.layers.frames import time_range

        ends = None if self.request.is_mitsuba else time_range(self.shot.stage)
        if self.request.files.frames is not None or ends is None:
            return len(self.tasks)
        return int(ends[1] - ends[0]) + 1

    def memory(self) -> int:
        """Return about how many bytes a pass needs; a large stage or many beams need more."""
        return PROGRAM_BYTES + self.picture_memory()

    def picture_memory(self) -> int:
        """Return about how many bytes the picture needs."""
        from ..images.frame import pixels_of
        from ..render.memory import PIXEL_BYTES

        views = 2 if self.shot.stereo and self.request.eyes.eye is None else 1
        left, top, right, bottom = pixels_of(self._given["crop"], *self.size, overscan=True)
        return (right - left) * (bottom - top) * (PIXEL_BYTES + views * _SUMS_BYTES)


def render(request: RenderRequest) -> None:
    """Render frames of a USD stage or a Mitsuba scene.

    For example:

    photonbeams render shot.usda -o out/shot.####.exr -f 1001:1048

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64

    photonbeams render cornell.xml -o cornell.exr --passes 64 --checkpoint 60
    """
    shown, passes = request.shown, request.passes
    with messages(shown), held_signals() as check, snapshots(passes.snapshot) as due:
        request.device.start()
        if request.views.list_cameras:
            from .scenes import camera_names

            with check.forced():
                print("\n".join(camera_names(request)))
            return
        with check.forced():
            job = Job.open(request, check)
            if shown.estimate:
                _show_estimate(job)
                check()
                return
        part = None if passes.part is None else passes.part.of(job.settings.passes)
        count = len(part) if part is not None else None if job.settings.error else job.settings.passes
        todo = [task for task in job.tasks if not (request.files.skip_existing and task.exists())]
        job, kept = _ready(job, todo, check)
        if shown.dry_run:
            shown.say(plan(job.seen((todo or job.tasks)[0]), job.tasks, todo, kept))
            return
        if request.farm.renders:
            from .farm import FarmAnimation

            FarmAnimation(job, todo, kept, check, due).render()
            return

        def finish(task: Task, advance: Callable[[int, str], None]) -> Statistics:
            if part is not None:
                return _part_written(job, part, task, advance, check)
            frame = _rendered(job, task, advance, kept, due, check)
            finish_frame(frame, task.outputs, request, kept)
            return frame.statistics

        with job.shot.film() if len(todo) > 1 else nullcontext():
            render_frames(job.tasks, count, request, finish, check)


def _ready(job: Job, todo: Sequence[Task], check: HeldSignals) -> tuple[Job, Sequence[str]]:
    """Check all that can be checked before the first pass; return the job, and the layers that files keep."""
    from ..render.films.denoising import check_denoiser
    from ..runtime.files import check_kept

    first = (todo or job.tasks)[0]
    with check.forced():
        kept = chosen_layers(job.request.files.layers, first.outputs, job.layers(first))
        check()
        job = job.ready(first, todo)
    check_kept([path for task in todo for path in task.written], job.files(todo))
    check_address_space(job.picture_memory())
    for task in todo:
        check_beside(task.outputs, job.request.passes)
        prepare_outputs(task.outputs)
    if job.settings.denoise:
        check_denoiser()
    check()
    return job, kept


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
    missing = job.shot.subject.warnings.missing_at(job.shot.subject.number(task.number))
    return Statistics(len(sums), sums.beams, sums.tests, {"passes": time.perf_counter() - start}, missing=missing)


def _rendered(
    job: Job, task: Task, advance: Callable[[int, str], None], kept: Sequence[str], due: Callable[[], bool],
    check: HeldSignals,
) -> Frame:  # fmt: skip
    """Render a frame, writing checkpoints and snapshots on the way, and a checkpoint if a signal ends it."""
    from ..render.checkpoint import Checkpoint

    checkpoint = None
    request, passes = job.request, job.request.passes
    if passes.checkpoint is not None or passes.resume:
        checkpoint = Checkpoint(checkpoint_of(task.outputs), passes.checkpoint, passes.resume)

    def progress(done: int, statistics: Statistics) -> None:
        advance(done, error_note(statistics.error, job.settings.error))

    written: list[str] = []

    def snapshot(frame: Callable[[], Frame]) -> None:
        if due():
            write_frame(frame(), files := snapshots_of(task.outputs), request, kept)
            written[:] = [f"wrote {', '.join(str(each.path) for each in files)}"]

    def kept_passes() -> str:
        if checkpoint is None or not checkpoint.passes:
            return ", ".join(written)
        done = counted(checkpoint.passes, "pass", "passes")
        flags = "--skip-existing --resume go" if len(job.tasks) > 1 else "--resume goes"
        return ", ".join([*written, f"{checkpoint.path} has {done}: {flags} on from there"])

    def rescue() -> str:
        if checkpoint is not None:
            checkpoint.rescue()
        return kept_passes()

    try:
        with check.forced(rescue):
            return job.render(task, progress, checkpoint=checkpoint, snapshot=snapshot)
    except KeyboardInterrupt as interrupt:
        interrupt.done = kept_passes()  # type: ignore[attr-defined]  # for the message about how the render ended
        raise


def _show_estimate(job: Job) -> None:
    """Print how long a render would take, and how much memory; raises what that would raise."""
    job = job.ready(job.tasks[0], job.tasks)
    cost = job.estimate(job.tasks[0])
    if job.request.shown.json:
        print(json.dumps(_fields(job, cost)))
        return
    console = standard_output()
    console.print(job.seen(job.tasks[0]))
    for name, text in _rows(job, cost):
        console.print(f"  {name:<10}{text}")


def _fields(job: Job, found: RenderEstimate) -> dict[str, Any]:
    """Return what is told as JSON: seconds of a frame, and bytes of all that the render needs."""
    passes, seconds = _part(job, found)
    return {
        "size": found.size, "frames": job.frames(), "passes": passes, "seconds": seconds, "within": found.within,
        "once": found.once, "each": found.each, "memory": PROGRAM_BYTES + found.memory,
    }  # fmt: skip


def _part(job: Job, found: RenderEstimate) -> tuple[int, float]:
    """Return the number of passes that are rendered, of all or of a part of them, and their seconds."""
    if job.request.passes.part is None:
        return found.passes, found.seconds
    passes = len(job.request.passes.part.of(found.passes))
    return passes, found.once + passes * found.each


def _rows(job: Job, found: RenderEstimate) -> Iterator[tuple[str, str]]:
    """Yield what is told, with its names."""
    (passes, seconds), within = _part(job, found), found.within
    each = f"{spoken(found.once)}, and {counted(passes, 'pass', 'passes')} of {found.each:.2g} s"
    most = "at most " if job.settings.error else ""
    yield "a frame", f"{most}about {spoken(seconds)}, {_range(seconds, within)}: {each}"
    frames = job.frames()
    if frames > 1:
        yield "all", f"{counted(frames, 'frame')} like the first: {most}about {spoken(frames * seconds)}"
    present = memory()
    has = "" if present is None else f"; this machine has {present / 2**30:.1f} GiB"
    yield "memory", f"{found.memory / 2**30:.2g} GiB a pass, and about {PROGRAM_BYTES / 2**30:.0f} GiB besides{has}"
    width, height = found.measured
    yield "measured", f"in {spoken(found.took)}, with up to {width} x {height} pixels; a busy machine takes longer"


def _range(seconds: float, within: float) -> str:
    return f"from {spoken(seconds / within)} to {spoken(seconds * within)}"
