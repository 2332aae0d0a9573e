"""Passes: a frame is their mean, and each pass is a picture by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol, TypeVar

import drjit as dr
import numpy as np

if TYPE_CHECKING:
    from ..scene import Array
    from .checkpoint import Checkpoint
    from .films.frame_sums import FrameSums
    from .reuse import FilmMemory
    from .settings import Settings


@dataclass
class Statistics:
    """Statistics of a frame: passes, beams, ray–beam tests, seconds by phase, and what was missing.

    `error` is the relative standard error of the pixels, or None if it is not known. For a resumed frame, passes, beams
    and tests are those of the whole frame, and seconds are those since the resumption. `interrupt` is called between
    phases and their parts; an exception from it ends the frame.
    """

    passes: int = 0
    beams: int = 0
    tests: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    error: float | None = None
    missing: Sequence[str] = ()
    interrupt: Callable[[], None] | None = field(default=None, repr=False, compare=False)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time that is spent within the context to the phase `name`."""
        self.step()
        begin = time.perf_counter()
        yield
        dr.sync_thread()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def step(self) -> None:
        """Give the caller an opportunity to end the frame, once its kernels are done: the next frame need not wait."""
        if self.interrupt is not None:
            dr.sync_thread()
            self.interrupt()

    @property
    def stepping(self) -> Callable[[], None] | None:
        """The function `step`; None if nobody may end the frame."""
        return None if self.interrupt is None else self.step

    def fresh(self) -> Statistics:
        """Return the statistics of a frame without passes."""
        return Statistics(interrupt=self.interrupt)


#: Called with the number of passes done and with the statistics so far.
Progress = Callable[[int, Statistics], None]


@dataclass(frozen=True)
class PlannedPasses:
    """Some of the passes of a frame, and how many are `planned` in all; None: the number is not known."""

    numbers: range
    planned: int | None


@dataclass(frozen=True)
class RunOptions:
    """How a frame is rendered pass by pass: which passes, callbacks, and what is kept.

    Attributes
    ----------
    progress
        Called before each pass and after the last; if it raises KeyboardInterrupt, the checkpoint is written first.
    checkpoint
        Where passes are saved on the way and resumed from.
    snapshot
        Called at the same times, once there is a pass, with a function that returns the sums so far.
    part
        Which passes are rendered; None: all. Passes that the checkpoint has are not rendered again.
    development
        Returns what develops the sums into a picture, as arrays by name; checkpoints contain it.
    kept
        The last frame that was begun, by its content and the planned passes: another part of the same frame reuses its
        world. None: no frame is kept.
    film
        What frames of a film have in common; None: each is a shot by itself.
    warn
        Called with sentences about what is hardly meant so, before the first pass; None: nobody asks.
    """

    progress: Progress | None = None
    checkpoint: Checkpoint | None = None
    snapshot: Callable[[Callable[[], FrameSums]], None] | None = None
    part: PlannedPasses | None = None
    development: Callable[[], Mapping[str, Array]] = dict
    kept: dict[tuple[str, int | None], Accumulating] | None = None
    film: FilmMemory | None = None
    warn: Callable[[str], None] | None = None

    @property
    def named(self) -> bool:
        """Whether the passes need a hash of their content."""
        return self.checkpoint is not None or self.part is not None


PLAIN_RUN = RunOptions()


class Accumulating(Protocol):
    """A frame to which passes are added; `about` is the hash of its content, as in `FrameSums`."""

    statistics: Statistics
    about: str

    def doubts(self) -> Iterable[str]:
        """Return sentences about what is hardly meant so."""

    def together(self, number: int) -> int:
        """Return how many passes from `number` on are best rendered at once."""

    def add_passes(self, numbers: range) -> None:
        """Add passes, and count them."""

    def error(self) -> float:
        """Return the relative standard error so far, or NaN if it is not known."""

    def sums(self) -> FrameSums:
        """Return the sums so far."""

    def restore(self, sums: FrameSums) -> None:
        """Continue from the sums of another frame."""

    def clear(self) -> None:
        """Begin again, without passes."""


Rendered = TypeVar("Rendered", bound=Accumulating)


def accumulate(
    begin: Callable[[int | None], Rendered],
    settings: Settings,
    run: RunOptions,
    about: str = "",
) -> Rendered:
    """Return a frame with all its passes, or with fewer: those begun within the time limit, or enough for the error.

    There is at least one pass. The error is compared to its goal only after certain numbers of passes, those of
    `next_check`, so that the outcome depends on nothing but the passes. The estimate of the error is itself random, and
    a test after each pass would stop when it happens to be low.

    Parameters
    ----------
    begin
        Returns the frame without passes, given how many passes are planned, or None if that is not known.
    settings
        Passes, time limit and error.
    run
        Which passes, callbacks, and what is kept.
    about
        Hash of the passes' content, as in `FrameSums`.
    """
    checkpoint = run.checkpoint
    limit, goal = settings.time_limit, settings.error if run.part is None else None
    known_number = limit is None and goal is None
    part = run.part or PlannedPasses(range(settings.passes), settings.passes if known_number else None)
    saved = None if checkpoint is None else checkpoint.begin(about, settings.passes)
    start = time.perf_counter()
    frame = _begun(begin, run.kept, about, part.planned if saved is None else saved.planned)
    for text in () if run.warn is None else frame.doubts():
        run.warn(text)  # type: ignore[misc]
    if saved is not None:
        frame.restore(saved)
    if checkpoint is not None:
        checkpoint.source = lambda: _developable(frame, run)
    there = [] if saved is None else saved.ranges()
    left = _missing(part.numbers, there)
    while left and not (goal is not None and _good_enough(frame, goal)):
        _tell(frame, run)
        first, most = left[0], frame.together(left[0].start)
        done = frame.statistics.passes
        if limit is not None:  # one pass first, then each time as many as are done
            most = min(most, max(done, 1))
        if goal is not None:
            most = min(most, next_check(done) - done)
        numbers = first[:most]
        left = [each for each in (first[len(numbers) :], *left[1:]) if each]
        frame.add_passes(numbers)
        if limit is not None and time.perf_counter() - start > limit:
            break
        if checkpoint is not None and checkpoint.due and left:
            checkpoint.save(_developable(frame, run))
    _tell(frame, run)
    frame.statistics.error = known(frame.error())
    return frame


def next_check(done: int) -> int:
    """Return the least number of passes above `done` at which the error is compared to its goal.

    These numbers are 8, 12, 16, 24, 32, 48, …: a frame has about a third more passes than it needs, at most half more.
    The differences between fewer than 8 passes tell too little. Sample sequences are the most even at powers of two.
    """
    power = max(8, 1 << done.bit_length())
    return 3 * power // 4 if power > 8 and done < 3 * power // 4 else power


def _good_enough(frame: Accumulating, goal: float) -> bool:
    """Return whether the error is compared after this number of passes, and is at most the goal."""
    done = frame.statistics.passes
    return done > 0 and next_check(done - 1) == done and frame.error() <= goal


def _begun(
    begin: Callable[[int | None], Rendered], kept: dict[tuple[str, int | None], Accumulating] | None, about: str,
    planned: int | None,
) -> Rendered:  # fmt: skip
    """Return a frame without passes: the kept frame, if it is of the same picture."""
    if kept is not None and (about, planned) in kept:
        kept[about, planned].clear()
        return kept[about, planned]  # type: ignore[return-value]
    if kept is not None:
        kept.clear()  # gives its memory back before another world is built
    frame = begin(planned)
    frame.about = about
    if kept is not None:
        kept[about, planned] = frame
    return frame


def _missing(numbers: range, there: Sequence[range]) -> list[range]:
    """Return the `numbers` that are missing, as ranges (there may be a billion); `there` are ranges in order."""
    result, first = [], numbers.start
    for each in there:
        result.append(range(first, min(each.start, numbers.stop)))
        first = max(first, each.stop)
    return [each for each in (*result, range(first, numbers.stop)) if each]


def _tell(frame: Accumulating, run: RunOptions) -> None:
    """Report the passes so far; if Ctrl-C was pressed, write the checkpoint first."""
    statistics = frame.statistics
    try:
        if run.progress is not None:
            statistics.error = known(frame.error())
            run.progress(statistics.passes, statistics)
        if run.snapshot is not None and statistics.passes:
            run.snapshot(frame.sums)
    except KeyboardInterrupt:
        if run.checkpoint is not None:
            run.checkpoint.save(_developable(frame, run))
        raise


def _developable(frame: Accumulating, run: RunOptions) -> FrameSums:
    """Return the sums so far, with what develops them."""
    return replace(frame.sums(), development=run.development())


def known(error: float) -> float | None:
    """Return an error, or None for NaN."""
    return None if np.isnan(error) else error
