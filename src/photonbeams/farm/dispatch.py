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
from itertools import pairwise
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
class _FarmWorker:
    frame: int | None = None
    running: dict[FramePart, float] = field(default_factory=dict)  # its parts, and since when it has each


class LostError(Exception):
    """Several workers were lost while they rendered the same part."""

    def __init__(self, part: FramePart, lost: int) -> None:
        super().__init__(part, lost)
        self.part, self.lost = part, lost


class Dispatcher:
    """The state of a farm's work: the parts of each frame that are to be rendered, each a range of passes."""

    def __init__(self, frames: Sequence[Sequence[range]]) -> None:
        parts = [[FramePart(k, numbers) for numbers in each] for k, each in enumerate(frames)]
        self._left = [{*each} for each in parts]
        self._todo = {k: each for k, each in enumerate(parts) if each}  # parts that no worker has, by frame
        self._begun: set[int] = set()  # frames of which a worker had parts
        self._workers: dict[str, _FarmWorker] = {}
        self._times: deque[float] = deque(maxlen=50)  # seconds a pass
        self._looked = -math.inf
        self._lost: Counter[FramePart] = Counter()

    @property
    def done(self) -> bool:
        """Whether all parts have been rendered."""
        return not any(self._left)

    @property
    def workers(self) -> list[str]:
        """The names of the workers."""
        return [*self._workers]

    def add_worker(self, name: str) -> None:
        """Add a worker."""
        self._workers.setdefault(name, _FarmWorker())

    def lose_worker(self, name: str) -> None:
        """Remove a lost worker and put its parts back; raise LostError if MOST_LOST workers were lost at one part."""
        for part in self.exclude(name)[:1]:  # the others had not begun
            self._lost[part] += 1
            if self._lost[part] >= MOST_LOST:
                raise LostError(part, self._lost[part])

    def exclude(self, name: str) -> list[FramePart]:
        """Remove a worker, put its parts back for others, and return them, the one that it was rendering first."""
        parts = [*self._workers.pop(name, _FarmWorker()).running]
        for part in parts:
            self._put_back(part)
        return parts

    def next(self, now: float) -> tuple[str, FramePart] | None:
        """Return a worker and the part that it renders from `now` on; None if no worker is free or nothing is left."""
        name = min(self._workers, key=lambda each: len(self._workers[each].running), default="")
        worker = self._workers.get(name)
        if worker is None or len(worker.running) >= _QUEUED:
            return None
        if self._todo:
            part: FramePart | None = self._chosen(worker)
        else:
            part = None if worker.running or now - self._looked < LOOK else self._slow(now)
        if part is None:
            return None
        worker.frame, worker.running[part] = part.frame, now
        return name, part

    def finish(self, name: str, part: FramePart, now: float) -> bool:
        """Note that a worker has finished a part; return whether it is the first to do so."""
        worker = self._workers.get(name)
        if worker is not None and part in worker.running:
            self._times.append((now - worker.running.pop(part)) / len(part.numbers))
            worker.running = dict.fromkeys(worker.running, now)  # the worker begins the next one now
        if part not in self._left[part.frame]:
            return False
        self._left[part.frame].discard(part)
        if part in self._todo.get(part.frame, ()):  # put back when its first worker seemed to be lost
            self._take(part)
        return True

    def give_back(self, name: str, part: FramePart) -> None:
        """Note that a worker will not render a part."""
        self._workers.get(name, _FarmWorker()).running.pop(part, None)
        self._put_back(part)

    def frame_done(self, frame: int) -> bool:
        """Return whether all parts of a frame have been rendered."""
        return not self._left[frame]

    def _put_back(self, part: FramePart) -> None:
        elsewhere = any(part in worker.running for worker in self._workers.values())
        if part in self._left[part.frame] and not elsewhere and part not in self._todo.get(part.frame, ()):
            self._todo.setdefault(part.frame, []).insert(0, part)

    def _take(self, part: FramePart) -> None:
        self._todo[part.frame].remove(part)
        if not self._todo[part.frame]:
            del self._todo[part.frame]

    def _chosen(self, worker: _FarmWorker) -> FramePart:
        """Return the next part for a worker: of its own frame, else of a new one, else of the one with most left."""
        frame = worker.frame
        if frame is None or frame not in self._todo:
            most = max(self._todo, key=lambda each: len(self._todo[each]))
            frame = next((each for each in self._todo if each not in self._begun), most)
        self._begun.add(frame)
        part = self._todo[frame][0]
        self._take(part)
        return part

    def _slow(self, now: float) -> FramePart | None:
        """Return a part of the worker that is latest, if it takes several times as long as usual; else None."""
        self._looked = now
        if not self._times:
            return None
        usual = median(self._times)
        holders = Counter(part for worker in self._workers.values() for part in worker.running)
        late: list[tuple[float, list[FramePart]]] = []
        for worker in self._workers.values():
            for first, since in [*worker.running.items()][:1]:
                if now - since > max(LEAST, SLOW * usual * len(first.numbers)):
                    late.append((since, [*worker.running]))
        for _, parts in sorted(late, key=lambda each: each[0]):
            for part in parts:  # those that wait behind a hung part are late, too
                if holders[part] == 1 and part in self._left[part.frame]:
                    return part
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
        bounds = [each.start, *range((each.start // size + 1) * size, each.stop, size), each.stop]
        parts += [range(begin, end) for begin, end in pairwise(bounds)]
    return parts
