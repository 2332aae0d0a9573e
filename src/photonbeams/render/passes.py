"""Passes: a frame is their mean, each of them a picture by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import drjit as dr
import numpy as np

if TYPE_CHECKING:
    from .checkpoint import Checkpoint
    from .settings import Settings

# Width of a beam in spacings of its neighbours in the first pass. One pass of 4,096 beams of the comparison scene is
# then within 1.5 % of the integral in the median, from beside (1.0 %) and from inside the shaft (1.4 %, worst of three
# seeds); at 1.5 the inside has 3 %, at 2.5 the blur of the shaft's edge has cost half a percent of its light.
OVERLAP = 2.2


@dataclass
class Statistics:
    """Statistics of a frame: passes, beams, ray–beam tests, seconds by phase, and compiled kernels.

    `error` is the relative standard error of the pixels, None where it is not known. For a resumed frame, passes, beams
    and tests count the whole frame, seconds and kernels count since the resumption.
    """

    passes: int = 0
    beams: int = 0
    tests: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    kernels_compiled: int = 0
    compile_seconds: float = 0.0
    error: float | None = None

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time within to a phase."""
        begin = time.perf_counter()
        yield
        dr.sync_thread()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def count_kernels(self) -> None:
        """Add what was compiled since the last call."""
        for entry in dr.kernel_history():
            if entry["type"].name == "JIT" and not entry["cache_hit"]:
                self.kernels_compiled += 1
                self.compile_seconds += entry["backend_time"] / 1e3


#: Told of the number of passes done and of the statistics so far.
Progress = Callable[[int, Statistics], None]


class Accumulating(Protocol):
    """A frame to which passes are added."""

    statistics: Statistics

    def add_pass(self, number: int) -> None:
        """Add pass `number`, and count it."""

    def error(self) -> float:
        """Return the relative standard error so far, NaN where that is not known."""

    def state(self) -> dict[str, np.ndarray]:
        """Return what another frame goes on from."""

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the state of another frame."""


Rendered = TypeVar("Rendered", bound=Accumulating)


def accumulate(
    begin: Callable[[], Rendered],
    settings: Settings,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    about: Sequence[Any] = (),
) -> Rendered:
    """Return a frame with all its passes, or with those that were begun within the time limit: at least one.

    `begin` returns the frame, which resumes from the checkpoint if that holds passes of the same picture, described by
    `about`. `progress` is called before each pass and after the last; where it raises KeyboardInterrupt, the checkpoint
    is written first.
    """
    state = None if checkpoint is None else checkpoint.begin(*about)
    start, limit = time.perf_counter(), settings.time_limit
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        frame = begin()
        if state is not None:
            frame.restore(state)
        for number in range(frame.statistics.passes, settings.passes):
            _tell(frame, settings, progress, checkpoint)
            frame.add_pass(number)
            frame.statistics.count_kernels()
            if limit is not None and time.perf_counter() - start > limit:
                break
    _tell(frame, settings, progress, checkpoint)
    frame.statistics.error = _known(frame.error())
    return frame


def _tell(frame: Accumulating, settings: Settings, progress: Progress | None, checkpoint: Checkpoint | None) -> None:
    """Report progress, and write the checkpoint where that is due."""
    statistics = frame.statistics
    try:
        if progress is not None:
            statistics.error = _known(frame.error())
            progress(statistics.passes, statistics)
    except KeyboardInterrupt:
        if checkpoint is not None:
            checkpoint.save(frame)
        raise
    if checkpoint is not None and checkpoint.due and 0 < statistics.passes < settings.passes:
        checkpoint.save(frame)


def _known(error: float) -> float | None:
    return None if np.isnan(error) else error


def pixel_offset(number: int) -> tuple[float, float]:
    """Return the offset of a pass within its pixels: the R2 sequence (Roberts 2018) from the centre on.

    Each point is followed by its mirror image at the centre: otherwise a picture of few passes would be shifted by a
    tenth of a pixel. All pixels have the same offset, so edges are smooth after a few passes, without noise.
    """
    g = 1.32471795724474602596  # the plastic number
    place = (number + 1) // 2
    x, y = (0.5 + place / g) % 1.0, (0.5 + place / g**2) % 1.0
    return (x, y) if number == 0 or number % 2 else (1 - x, 1 - y)
