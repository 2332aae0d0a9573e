"""Decide which worker renders which passes next: the policy of a farm, without any network.

Frames are rendered in parts of a few passes. A worker continues with the frame that it has begun, because it has built
that frame's world. Otherwise it begins a new frame, or, if none is left, helps with the frame that has most left to do.
The parts of a lost worker are rendered again. A part that takes several times as long as others is begun a second time
elsewhere; the first result counts, and both have the same bits.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

#: A part is begun a second time after SLOW times the median time of a part, and after LEAST seconds or more.
SLOW, LEAST = 4.0, 5.0
LOOK = 0.5  # seconds between two searches for such parts
#: When this many workers are lost at one part, the part is to blame.
MOST_LOST = 3
_QUEUED = 2  # parts that a worker has at a time, so that it never waits for the next one
_MOST_PARTS = 1 << 17


@dataclass(frozen=True)
class FramePart:
    """Some passes of a frame; `frame` is its place in the list of frames."""

    frame: int
    numbers: range


@dataclass
class _Running:
    """A part that a worker has, and the time since when."""

    part: FramePart
    since: float


@dataclass
class _Worker:
    frame: int | None = None
    running: list[_Running] = field(default_factory=list)


class LostError(Exception):
    """Several workers were lost while they rendered the same part."""

    def __init__(self, part: FramePart, lost: int) -> None:
        super().__init__(part, lost)
        self.part, self.lost = part, lost


class Dispatcher:
    """The state of a farm's work: the parts of each frame that are to be rendered, each a range of passes."""

    def __init__(self, frames: Sequence[Sequence[range]]) -> None:
        self._todo = [[FramePart(k, numbers) for numbers in parts] for k, parts in enumerate(frames)]
        self._left = [{*parts} for parts in self._todo]
        self._count = sum(map(len, self._left))
        self._open = {frame for frame, parts in enumerate(self._todo) if parts}  # frames with parts that no worker has
        self._fresh = deque(sorted(self._open))  # frames that no worker has begun
        self._workers: dict[str, _Worker] = {}
        self._free: dict[str, None] = {}  # workers that may be given more
        self._times: deque[float] = deque(maxlen=50)  # seconds a pass
        self._looked = -math.inf
        self._lost: dict[FramePart, int] = {}

    @property
    def done(self) -> bool:
        """Whether all parts have been rendered."""
        return not self._count

    @property
    def workers(self) -> list[str]:
        """The names of the workers."""
        return [*self._workers]

    def add_worker(self, name: str) -> None:
        """Add a worker."""
        if name not in self._workers:
            self._workers[name] = _Worker()
            self._free[name] = None

    def lose_worker(self, name: str) -> None:
        """Remove a lost worker and put its parts back; raise LostError if MOST_LOST workers were lost at one part."""
        for part in self.exclude(name)[:1]:  # the others had not begun
            self._lost[part] = self._lost.get(part, 0) + 1
            if self._lost[part] >= MOST_LOST:
                raise LostError(part, self._lost[part])

    def exclude(self, name: str) -> list[FramePart]:
        """Remove a worker, put its parts back for others, and return them, the one that it was rendering first."""
        worker = self._workers.pop(name, _Worker())
        self._free.pop(name, None)
        for each in worker.running:
            self._again(each.part)
        return [each.part for each in worker.running]

    def next(self, now: float) -> tuple[str, FramePart] | None:
        """Return a worker and the part that it renders from `now` on; None if no worker is free or nothing is left."""
        idle = next((name for name in self._free if not self._workers[name].running), None)
        if not self._open:
            part = None if idle is None or now - self._looked < LOOK else self._slow(now)
            return None if part is None or idle is None else self._given(idle, part, now)
        name = idle or next(iter(self._free), None)
        return None if name is None else self._given(name, self._chosen(self._workers[name]), now)

    def _given(self, name: str, part: FramePart, now: float) -> tuple[str, FramePart]:
        worker = self._workers[name]
        worker.frame = part.frame
        worker.running.append(_Running(part, now))
        if len(worker.running) >= _QUEUED:
            del self._free[name]
        return name, part

    def finish(self, name: str, part: FramePart, now: float) -> bool:
        """Note that a worker has finished a part; return whether it is the first to do so."""
        worker = self._workers.get(name)
        if worker is not None:
            for each in [each for each in worker.running if each.part == part]:
                self._times.append((now - each.since) / len(part.numbers))
                worker.running.remove(each)
            for each in worker.running:
                each.since = now  # the worker begins it now
            self._free[name] = None
        if part not in self._left[part.frame]:
            return False
        self._left[part.frame].discard(part)
        self._count -= 1
        if part in self._todo[part.frame]:  # put back when its first worker seemed to be lost
            self._todo[part.frame].remove(part)
            if not self._todo[part.frame]:
                self._open.discard(part.frame)
        return True

    def give_back(self, name: str, part: FramePart) -> None:
        """Note that a worker will not render a part."""
        worker = self._workers.get(name)
        if worker is not None:
            worker.running = [each for each in worker.running if each.part != part]
            self._free[name] = None
        self._again(part)

    def frame_done(self, frame: int) -> bool:
        """Return whether all parts of a frame have been rendered."""
        return not self._left[frame]

    def _again(self, part: FramePart) -> None:
        elsewhere = any(each.part == part for worker in self._workers.values() for each in worker.running)
        if part in self._left[part.frame] and not elsewhere and part not in self._todo[part.frame]:
            self._todo[part.frame].insert(0, part)
            self._open.add(part.frame)

    def _chosen(self, worker: _Worker) -> FramePart:
        """Return the next part for a worker: of its own frame, else of a new one, else of the one with most left."""
        frame = worker.frame
        if frame is None or not self._todo[frame]:
            while self._fresh and self._fresh[0] not in self._open:
                self._fresh.popleft()
            frame = (
                self._fresh.popleft()
                if self._fresh
                else max(self._open, key=lambda each: (len(self._todo[each]), -each))
            )
        part = self._todo[frame].pop(0)
        if not self._todo[frame]:
            self._open.discard(frame)
        return part

    def _slow(self, now: float) -> FramePart | None:
        """Return a part of the worker that is latest, if it takes several times as long as usual; else None."""
        self._looked = now
        if not self._times:
            return None
        usual = median(self._times)
        held = [worker.running for worker in self._workers.values() if worker.running]
        counts = Counter(each.part for running in held for each in running)
        late = [
            running
            for running in held
            if now - running[0].since > max(LEAST, SLOW * usual * len(running[0].part.numbers))
        ]
        for running in sorted(late, key=lambda each: each[0].since):
            for each in running:  # parts that wait behind a hung part are late, too
                if counts[each.part] == 1 and each.part in self._left[each.part.frame]:
                    return each.part
        return None


def most_passes(workers: int) -> int:
    """Return the greatest number of passes in a part: eight, or more on large farms.

    A lost worker loses a part, which should therefore be small. But the sums of all parts go to one machine, and its
    network limits how many it can take in a second; so on large farms parts are larger.
    """
    return 8 << max(0, (workers - 1).bit_length() - 6)


def parts_of(missing: Sequence[range], frames: int, workers: int, most: int) -> list[range]:
    """Return the missing passes of a frame in aligned parts, of which every worker has several to do.

    `most` is the greatest number of passes in a part, a power of two: a lost worker loses this much.
    """
    total = sum(map(len, missing)) * frames
    size = most
    while size > 1 and total < 3 * size * workers:
        size //= 2
    while total > _MOST_PARTS * size:
        size *= 2
    parts = []
    for each in missing:
        begin = each.start
        while begin < each.stop:
            end = min((begin // size + 1) * size, each.stop)
            parts.append(range(begin, end))
            begin = end
    return parts
