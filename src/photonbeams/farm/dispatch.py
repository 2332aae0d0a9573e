"""Which worker renders which passes next: the policy of a farm, without any network.

Frames are rendered in parts of a few passes. A worker goes on with the frame that it has begun, for it has built that
frame's world; without one it begins a frame, and where none is left it helps with the one that has most to do. What a
lost worker had is done again. A part that takes several times as long as others is begun a second time elsewhere; the
one that is done first counts, and both are the same bits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

#: A part is begun a second time after so many median times of a part, and after so many seconds at least.
SLOW, LEAST = 4.0, 5.0
#: So many workers may be lost at one part before it is blamed for that.
MOST_LOST = 3


@dataclass(frozen=True)
class FramePart:
    """Some passes of a frame, which is named by its place in the list of frames."""

    frame: int
    numbers: range


@dataclass
class _Running:
    """A part on a worker, since when, and whether it is a second run of it."""

    part: FramePart
    worker: str
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
    """The state of a farm's work.

    Parameters
    ----------
    frames
        The parts of each frame that are to be rendered.
    queued
        How many parts a worker is given at a time: with two, it does not wait for the next one.
    """

    def __init__(self, frames: Sequence[Sequence[range]], queued: int = 2) -> None:
        self._todo = [[FramePart(k, numbers) for numbers in parts] for k, parts in enumerate(frames)]
        self._left = [{*parts} for parts in self._todo]
        self._queued = queued
        self._workers: dict[str, _Worker] = {}
        self._times: list[float] = []  # seconds a pass
        self._lost: dict[FramePart, int] = {}

    @property
    def done(self) -> bool:
        """Whether all parts have been rendered."""
        return not any(self._left)

    @property
    def workers(self) -> list[str]:
        """The workers there are."""
        return [*self._workers]

    def add_worker(self, name: str) -> None:
        """Count on a worker."""
        self._workers.setdefault(name, _Worker())

    def lose_worker(self, name: str) -> None:
        """Count no longer on a worker, and do again what it was doing; LostError where that loses every worker."""
        lost = self._workers.pop(name, None)
        for place, each in enumerate(lost.running if lost else ()):
            self._again(each.part)
            if place == 0:  # the others had not begun
                self._lost[each.part] = self._lost.get(each.part, 0) + 1
                if self._lost[each.part] >= MOST_LOST:
                    raise LostError(each.part, self._lost[each.part])

    def next(self, now: float) -> tuple[str, FramePart] | None:
        """Return a worker and what it is to render, from now on; None where nobody is free or nothing is left."""
        for length in range(self._queued):
            for name, worker in self._workers.items():
                if len(worker.running) == length and (part := self._chosen(worker, now, length)) is not None:
                    worker.frame = part.frame
                    worker.running.append(_Running(part, name, now))
                    return name, part
        return None

    def finish(self, name: str, part: FramePart, now: float) -> bool:
        """Note that a worker is done with a part; return whether nobody had been before."""
        worker = self._workers.get(name)
        if worker is not None:
            for each in [each for each in worker.running if each.part == part]:
                self._times.append((now - each.since) / len(part.numbers))
                worker.running.remove(each)
            for each in worker.running:
                each.since = now  # it begins now
        if part not in self._left[part.frame]:
            return False
        self._left[part.frame].discard(part)
        if part in self._todo[part.frame]:  # given back when its first worker seemed to be lost
            self._todo[part.frame].remove(part)
        return True

    def give_back(self, name: str, part: FramePart) -> None:
        """Note that a worker will not render a part."""
        worker = self._workers.get(name)
        if worker is not None:
            worker.running = [each for each in worker.running if each.part != part]
        self._again(part)

    def frame_done(self, frame: int) -> bool:
        """Return whether all parts of a frame have been rendered."""
        return not self._left[frame]

    def running(self) -> list[tuple[str, FramePart]]:
        """Return what the workers are doing."""
        return [(name, each.part) for name, worker in self._workers.items() for each in worker.running]

    def _again(self, part: FramePart) -> None:
        elsewhere = any(each.part == part for worker in self._workers.values() for each in worker.running)
        if part in self._left[part.frame] and not elsewhere and part not in self._todo[part.frame]:
            self._todo[part.frame].insert(0, part)

    def _chosen(self, worker: _Worker, now: float, length: int) -> FramePart | None:
        """Return the next part for a worker."""
        if worker.frame is not None and self._todo[worker.frame]:
            return self._todo[worker.frame].pop(0)
        begun = {each.frame for each in self._workers.values()}
        fresh = (frame for frame, parts in enumerate(self._todo) if parts and frame not in begun)
        frame = next(fresh, None)
        if frame is None:
            frame = max(range(len(self._todo)), key=lambda each: len(self._todo[each]), default=None)
        if frame is not None and self._todo[frame]:
            return self._todo[frame].pop(0)
        return self._slow(now) if length == 0 else None

    def _slow(self, now: float) -> FramePart | None:
        """Return a part of the worker that has taken longest, if that takes several times as long as it should."""
        if not self._times:
            return None
        usual = median(self._times[-50:])
        held = [worker.running for worker in self._workers.values() if worker.running]
        counts = Counter(each.part for running in held for each in running)
        late = [
            running
            for running in held
            if now - running[0].since > max(LEAST, SLOW * usual * len(running[0].part.numbers))
        ]
        for running in sorted(late, key=lambda each: each[0].since):
            for each in running:  # what waits behind a hung part is late, too
                if counts[each.part] == 1 and each.part in self._left[each.part.frame]:
                    return each.part
        return None


def parts_of(missing: Sequence[range], frames: int, workers: int, most: int) -> list[range]:
    """Return the passes of a frame in aligned parts: so few passes that every worker has several parts to do.

    Parameters
    ----------
    missing
        The passes that are not there yet.
    frames, workers
        How many frames there are, and how many workers share them.
    most
        The most passes in a part, a power of two: so much is lost with a worker.
    """
    total = sum(map(len, missing)) * frames
    size = most
    while size > 1 and total < 3 * size * workers:
        size //= 2
    parts = []
    for each in missing:
        begin = each.start
        while begin < each.stop:
            end = min((begin // size + 1) * size, each.stop)
            parts.append(range(begin, end))
            begin = end
    return parts
