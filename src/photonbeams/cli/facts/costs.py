"""What `photonbeams render --estimate` tells: seconds and memory of a render, before it is paid for."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from ..progress import counted, spoken, standard_output
from ..render import PROGRAM_BYTES, Job

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ...shot.estimate import Estimate


def show_estimate(job: Job) -> None:
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


def _fields(job: Job, found: Estimate) -> dict[str, Any]:
    """Return what is told as JSON: seconds of a frame, and bytes of all that the render needs."""
    passes, seconds = _part(job, found)
    return {
        "size": found.size, "frames": job.frames(), "passes": passes, "seconds": seconds, "within": found.within,
        "once": found.once, "each": found.each, "memory": PROGRAM_BYTES + found.memory,
    }  # fmt: skip


def _part(job: Job, found: Estimate) -> tuple[int, float]:
    """Return the number of passes that are rendered, of all or of a part of them, and their seconds."""
    if job.request.passes.part is None:
        return found.passes, found.seconds
    passes = len(job.request.passes.part.of(found.passes))
    return passes, found.once + passes * found.each


def _rows(job: Job, found: Estimate) -> Iterator[tuple[str, str]]:
    """Yield what is told, with its names."""
    from ...runtime.limits import memory

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
