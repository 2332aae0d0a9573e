"""Show the progress of a render: warnings, passes and statistics on standard error; handle its signals."""

from __future__ import annotations

import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from ..runtime.bars import Update, drawn, terminal

if TYPE_CHECKING:
    from ..farm.run import FarmState
    from ..render.passes import Statistics


# Signals that end a render. Windows has no SIGHUP.
_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Progress(StrEnum):
    """How progress is shown."""

    rich = "rich"
    plain = "plain"
    openjd = "openjd"
    none = "none"


@contextmanager
def messages(quiet: bool, verbose: bool) -> Iterator[None]:
    """Print the package's warnings within the context: only errors with `quiet`, information too with `verbose`."""
    logger = logging.getLogger("photonbeams")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines())
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.ERROR if quiet else logging.DEBUG if verbose else logging.WARNING)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


class _Lines(logging.Formatter):
    """Formats messages as "Warning: text", in the way of "Error: text"."""

    def format(self, record: logging.LogRecord) -> str:
        return f"{record.levelname.capitalize()}: {record.getMessage()}"


class Stopped(KeyboardInterrupt):
    """Ctrl-C, or another signal that ends a render in an orderly way; the exit code is 128 + `number`."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def held_signals() -> Iterator[Callable[[], None]]:
    """Delay Ctrl-C, SIGTERM and SIGHUP until the yielded function is called; a second signal is not delayed.

    Compiled libraries mishandle an exception that is raised during their import or while they call Python: they print
    a traceback and go on, hang, or abort. Signals that the parent process made this one ignore, as nohup does, stay
    ignored.
    """
    received: int | None = None

    def hold(number: int, _: object) -> None:
        nonlocal received
        if received is not None:
            raise Stopped(received)
        received = number

    def check() -> None:
        if received is not None:
            raise Stopped(received)

    if threading.current_thread() is not threading.main_thread():
        yield check
        return
    usual = {number: signal.getsignal(number) for number in _ENDING}
    held = [number for number, own in usual.items() if own in (signal.SIG_DFL, signal.default_int_handler)]
    for number in held:
        signal.signal(number, hold)
    try:
        yield check
    finally:
        for number in held:
            signal.signal(number, usual[number])


@contextmanager
def snapshots(every: float | None) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether a snapshot is due: every `every` seconds, and on SIGUSR1."""
    signalled, written = False, time.perf_counter()

    def note(*_: object) -> None:
        nonlocal signalled
        signalled = True

    def due() -> bool:
        nonlocal signalled, written
        found = signalled or (every is not None and time.perf_counter() - written >= every)
        if found:
            signalled, written = False, time.perf_counter()
        return found

    number = getattr(signal, "SIGUSR1", None)  # Windows has none
    if number is None or threading.current_thread() is not threading.main_thread():
        yield due
        return
    before = signal.signal(number, note)
    try:
        yield due
    finally:
        signal.signal(number, before)


Show = Callable[[int, str, int, str], None]


@contextmanager
def bar(kind: Progress | None, quiet: bool, frames: int, passes: int | None) -> Iterator[Show]:
    """Yield a function that updates the progress bar of a render.

    Its arguments are the place of the frame, from 0, its name, the number of its passes that are done, and a note.
    `passes` is the number of passes of a frame, None if it is not known yet.
    """
    with _drawn(kind, quiet) as update:
        if update is None:
            openjd = kind is Progress.openjd
            yield _plain_unknown(frames, openjd) if passes is None else _plain(frames, passes, openjd)
            return

        def show(index: int, name: str, done: int, note: str) -> None:
            description = f"frame {name} ({index + 1} of {frames}), passes" if frames > 1 else "passes"
            if passes is None:
                update(done, None, f"{note} {description}".strip())
            else:
                update(index * passes + done, frames * passes, f"{note} {description}".strip())

        yield show


@contextmanager
def farm_bar(kind: Progress | None, quiet: bool) -> Iterator[Callable[[FarmState], None]]:
    """Yield a function that updates the progress bar of a farm."""
    with _drawn(kind, quiet) as update:
        if update is None:
            yield _plain_farm(openjd=kind is Progress.openjd)
            return

        def show(state: FarmState) -> None:
            frames = f"frame {state.frames} of {state.all_frames}, {counted(state.workers, 'worker')}, passes"
            update(state.passes, state.all_passes, frames)

        yield show


@contextmanager
def _drawn(kind: Progress | None, quiet: bool) -> Iterator[Update | None]:
    """Yield a function that draws a bar, of passes done, all passes and a description; None to print lines instead."""
    if quiet or kind is Progress.none:
        yield lambda done, total, description: None
        return
    console = None if kind in (Progress.plain, Progress.openjd) else terminal(always=kind is Progress.rich)
    if console is None:
        yield None
        return
    with drawn(console) as update:
        yield update


def _plain_farm(openjd: bool) -> Callable[[FarmState], None]:
    """Return a function that prints a line about every twentieth of all passes."""
    last = -1

    def show(state: FarmState) -> None:
        nonlocal last
        twentieth = 20 * state.passes // max(state.all_passes, 1)
        if twentieth == last:
            return
        last = twentieth
        if openjd:
            _openjd(state.passes / max(state.all_passes, 1), f"{state.frames} of {state.all_frames} frames")
            return
        frames = f"{state.frames:,} of {counted(state.all_frames, 'frame')}, {counted(state.workers, 'worker')}"
        print(f"pass {state.passes:,} of {state.all_passes:,}, {frames}", file=sys.stderr, flush=True)

    return show


def _openjd(fraction: float, status: str) -> None:
    """Print progress on standard output, in the form that Open Job Description reads."""
    print(f"openjd_progress: {100 * fraction:.1f}\nopenjd_status: {status}", flush=True)


def _plain(frames: int, passes: int, openjd: bool) -> Show:
    """Return a function that prints a line about every twentieth of all passes, for a log."""
    total = frames * passes
    step = max(1, total // 20)
    last = -1

    def show(index: int, name: str, done: int, note: str) -> None:
        nonlocal last
        overall = index * passes + done
        # Many passes may be done at once, and a frame begins where the one before it ended.
        part = overall // step + (overall == total)
        if part > last:
            last = part
            frame = f"frame {name}: " if frames > 1 else ""
            if openjd:
                _openjd(overall / total, f"{frame}pass {done} of {passes}")
                return
            print(f"{frame}pass {done} of {passes}{note and f', {note}'}", file=sys.stderr, flush=True)

    return show


def _plain_unknown(frames: int, openjd: bool) -> Show:
    """Return a function that prints a line whenever the number of passes doubles, for an unknown total."""
    last = (-1, -1)

    def show(index: int, name: str, done: int, note: str) -> None:
        nonlocal last
        if (index, done.bit_length()) == last:
            return
        last = index, done.bit_length()
        frame = f"frame {name}: " if frames > 1 else ""
        text = f"{frame}pass {done}{note and f', {note}'}"
        if openjd:
            _openjd(index / frames, text)
            return
        print(text, file=sys.stderr, flush=True)

    return show


def summary_lines(
    statistics: Statistics, files: Iterable[Path], seconds: float, planned: int | None = None
) -> list[str]:
    """Return lines about a render of one frame; with fewer passes than `planned`, its time was up."""
    early = planned is not None and statistics.passes < planned
    passes = f"{statistics.passes:,} of {planned:,} passes (--time-limit)" if early else _passes(statistics)
    phases = ", ".join(f"{name} {value:.1f}" for name, value in statistics.seconds.items())
    return [
        f"{passes}, {counted(statistics.beams, 'beam')}, {statistics.tests / 1e6:,.0f} million ray-beam tests",
        f"{seconds:.1f} s ({phases})",
        *filter(None, [error_note(statistics.error)]),
        *(f"wrote {path}" for path in files),
    ]


def error_note(error: float | None, goal: float | None = None) -> str:
    """Return a note on the error of a picture and its goal, as far as they are known."""
    if error is None:
        return ""
    return f"error {100 * error:.2g} %" + (f" of {100 * goal:.2g} %" if goal else "")


def frame_line(name: str, statistics: Statistics, files: Iterable[Path], seconds: float) -> str:
    """Return a line about one frame of several."""
    done = f"{_passes(statistics)}, {counted(statistics.beams, 'beam')}, {seconds:.1f} s"
    return f"frame {name}: {done}, wrote {', '.join(map(str, files))}"


def report_line(rendered: int, skipped: int, files: int, seconds: float) -> str:
    """Return a line about all frames."""
    frames = f"{counted(rendered, 'frame')} rendered, {skipped:,} skipped"
    return f"{frames}, {counted(files, 'file')} written, {seconds:.1f} s"


def _passes(statistics: Statistics) -> str:
    return counted(statistics.passes, "pass", "passes")


def counted(count: int, noun: str, several: str | None = None) -> str:
    """Return a count with its noun, "1 frame" or "5 frames"; `several` is the plural, if not with s."""
    return f"{count:,} {noun if count == 1 else several or noun + 's'}"
