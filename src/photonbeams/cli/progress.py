"""Show the progress of a render: warnings, passes and statistics on standard error; handle its signals."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from ..runtime.bars import Update, drawn, terminal

if TYPE_CHECKING:
    from ..farm.run import FarmState
    from ..render.passes import Statistics


GRACE = 8.0  # seconds after a signal in which a pass may end: many schedulers kill after ten
_SOON = 1.0  # the same after a second signal
NOTHING = "nothing was written"

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
        from ..scene.checks import shortened

        return shortened(f"{record.levelname.capitalize()}: {record.getMessage()}")


class Stopped(KeyboardInterrupt):
    """Ctrl-C, or another signal that ends a render in an orderly way; the exit code is 128 + `number`."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class HeldSignals:
    """Signals that are delayed until this is called, which raises `Stopped` if one was received."""

    def __init__(self) -> None:
        self._received: int | None = None
        self._rescues: list[Callable[[], str | None]] = []  # of the contexts in which a pass may be given up

    def __call__(self) -> None:
        """Raise `Stopped` if a signal was received."""
        if self._received is not None:
            raise Stopped(self._received)

    def hold(self, number: int, _: object) -> None:
        """Handle a signal: delay the first one."""
        self()
        self._received = number

    @contextmanager
    def forced(self, rescue: Callable[[], str | None] = lambda: None) -> Iterator[None]:
        """End the process some time after a signal, or soon after a second one, also in the middle of a kernel.

        `rescue` is called before, and returns a message about what was kept.
        """
        self._rescues.append(rescue)
        try:
            yield
        finally:
            self._rescues.pop()

    def watch(self, source: socket.socket, numbers: Collection[int]) -> None:
        """Read the numbers of signals until the socket is closed; end the process if nothing else does.

        A thread runs this: Python calls a signal's handler in the main thread, and not before a kernel has ended.
        """
        number, count, begun = 0, 0, 0.0
        while data := _received(source):
            for each in data:
                if each in numbers:
                    number, count, begun = number or each, count + 1, begun or time.perf_counter()
            source.settimeout(0.1 if count else None)
            if count and self._rescues and time.perf_counter() - begun > (GRACE if count == 1 else _SOON):
                done = self._rescues[-1]()
                print(f"{ending(number)} in the middle of a pass; {done or NOTHING}", file=sys.stderr, flush=True)
                os._exit(128 + number)


def _received(source: socket.socket) -> bytes:
    """Return the next bytes of a socket, or a byte 0 if there is none in time."""
    try:
        return source.recv(64)
    except TimeoutError:
        return bytes(1)
    except OSError:  # it was closed
        return b""


def ending(number: int) -> str:
    """Return which signal ended a command, in words."""
    return "Interrupted" if number == signal.SIGINT else f"Ended by {signal.Signals(number).name}"


@contextmanager
def held_signals() -> Iterator[HeldSignals]:
    """Delay Ctrl-C, SIGTERM and SIGHUP until the yielded object is called; a second signal is not delayed.

    Compiled libraries mishandle an exception that is raised during their import or while they call Python: they print
    a traceback and go on, hang, or abort. Signals that the parent process made this one ignore, as nohup does, stay
    ignored. Python's handlers wait for kernels to end; a thread does not, and ends the process: see `forced`.
    """
    result = HeldSignals()
    if threading.current_thread() is not threading.main_thread():
        yield result
        return
    usual = {number: signal.getsignal(number) for number in _ENDING}
    held = [number for number, own in usual.items() if own in (signal.SIG_DFL, signal.default_int_handler)]
    reading, writing = socket.socketpair()
    writing.setblocking(False)  # as Python requires of what its signal handler writes to
    thread = threading.Thread(target=result.watch, args=(reading, held), daemon=True)
    thread.start()
    before = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
    for number in held:
        signal.signal(number, result.hold)
    try:
        yield result
    finally:
        for number in held:
            signal.signal(number, usual[number])
        signal.set_wakeup_fd(before)
        writing.close()  # which ends the thread
        thread.join()
        reading.close()


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
