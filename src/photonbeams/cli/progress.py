"""Show the progress of a render: warnings, passes and statistics on standard error; handle its signals."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..runtime.bars import Update, drawn, terminal

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ..render.passes import Statistics
    from .flags import MessageFlags


GRACE = 8.0  # seconds after a signal in which a pass may end: many schedulers kill after ten
_SOON = 1.0  # the same after a second signal
_LONG = 60.0  # seconds from which on lines tell how much time is left
NOTHING = "nothing was written"

# Signals that end a render. Windows has no SIGHUP.
_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def messages(shown: MessageFlags) -> Iterator[None]:
    """Print the package's warnings within the context: only errors with `quiet`, information too with `verbose`."""
    logger = logging.getLogger("photonbeams")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines())
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.ERROR if shown.quiet else logging.DEBUG if shown.verbose else logging.WARNING)
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
    signalled, written = threading.Event(), time.perf_counter()

    def due() -> bool:
        nonlocal written
        if not (signalled.is_set() or (every is not None and time.perf_counter() - written >= every)):
            return False
        signalled.clear()
        written = time.perf_counter()
        return True

    number = getattr(signal, "SIGUSR1", None)  # Windows has none
    if number is None or threading.current_thread() is not threading.main_thread():
        yield due
        return
    before = signal.signal(number, lambda *_: signalled.set())
    try:
        yield due
    finally:
        signal.signal(number, before)


Show = Callable[[int, str, int, str], None]


@contextmanager
def bar(kind: str | None, quiet: bool, frames: int, passes: int | None) -> Iterator[Show]:
    """Yield a function that updates the progress bar of a render.

    Its arguments are the index of the frame, its name, the number of its passes that are done, and a note. `passes` is
    the number of passes of a frame, None if it is not known yet.
    """
    several, total = frames > 1, passes and frames * passes
    with _drawn(kind, quiet) as update:
        lines, left = _ProgressLines(kind == "openjd"), _TimeLeft()

        def show(index: int, name: str, done: int, note: str) -> None:
            overall = index * (passes or 0) + done
            if update is not None:
                frame = f"frame {name} ({index + 1} of {frames})" if several else ""
                update(overall, total, ", ".join(filter(None, (note, frame, "passes"))))
                return
            text = f"{f'frame {name}: ' if several else ''}pass {done:,}"
            tail = note and f", {note}"
            if passes is None or total is None:
                lines.show(index, frames, text + tail, text + tail, part=(index, done.bit_length()))
            else:
                text += f" of {passes:,}"
                lines.show(overall, total, text + tail + left(overall, total), text)

        yield show


@contextmanager
def _drawn(kind: str | None, quiet: bool) -> Iterator[Update | None]:
    """Yield a function that draws a bar, of passes done, all passes and a description; None to print lines instead."""
    if quiet or kind == "none":
        yield lambda done, total, description: None
        return
    console = None if kind in ("plain", "openjd") else terminal(always=kind == "rich")
    if console is None:
        yield None
        return
    with drawn(console) as update:
        yield update


class _TimeLeft:
    """Tells how long the rest of a render takes, if that is long, by how long its passes have taken so far."""

    def __init__(self) -> None:
        self._begin: tuple[float, int] | None = None  # when a first pass was done, which takes longer than others

    def __call__(self, done: int, total: int) -> str:
        """Return the end of a line, when some of all passes are done."""
        now = time.perf_counter()
        if self._begin is None and done > 0:
            self._begin = now, done
        if self._begin is None or done <= self._begin[1]:
            return ""
        left = (now - self._begin[0]) / (done - self._begin[1]) * (total - done)
        return f", about {spoken(left)} left" if left >= _LONG else ""


class _ProgressLines:
    """Prints progress as lines, for a log: one about every twentieth of all passes.

    With `openjd`, lines are on standard output, in the form that Open Job Description reads.
    """

    def __init__(self, openjd: bool) -> None:
        self._openjd = openjd
        self._last: object = None

    def show(self, done: int, total: int, line: str, status: str, part: object = None) -> None:
        """Print a line, unless the last one was about the same `part`, by default a twentieth of the total."""
        part = part or 20 * done // total
        if part == self._last:
            return
        self._last = part
        from ..scene.checks import printable

        if self._openjd:
            print(f"openjd_progress: {100 * done / total:.1f}\nopenjd_status: {printable(status)}", flush=True)
        else:
            print(printable(line), file=sys.stderr, flush=True)


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
        *filter(None, [error_note(statistics.error), _missing_note(statistics)]),
        *(f"wrote {path}" for path in files),
    ]


def error_note(error: float | None, goal: float | None = None) -> str:
    """Return a note on the error of a picture and its goal, as far as they are known."""
    if error is None:
        return ""
    return f"error {100 * error:.2g} %" + (f" of {100 * goal:.2g} %" if goal else "")


def _missing_note(statistics: Statistics) -> str:
    """Return a note on what a frame lacks, which warnings have named; "" if it lacks nothing."""
    count = len(statistics.missing)
    return f"without {counted(count, 'thing')} that the stage names, as warned" if count else ""


def frame_line(name: str, statistics: Statistics, files: Iterable[Path], seconds: float) -> str:
    """Return a line about one frame of several."""
    done = f"{_passes(statistics)}, {counted(statistics.beams, 'beam')}, {seconds:.1f} s"
    parts = [done, _missing_note(statistics), f"wrote {', '.join(map(str, files))}"]
    return f"frame {name}: {', '.join(filter(None, parts))}"


def report_line(rendered: Sequence[Statistics], skipped: int, files: int, seconds: float) -> str:
    """Return a line about all frames."""
    frames = f"{counted(len(rendered), 'frame')} rendered, {skipped:,} skipped"
    lacking = sum(bool(each.missing) for each in rendered)
    note = f"; {counted(lacking, 'frame')} without something that the stage names, as warned" if lacking else ""
    return f"{frames}, {counted(files, 'file')} written, {seconds:.1f} s{note}"


def _passes(statistics: Statistics) -> str:
    return counted(statistics.passes, "pass", "passes")


def spoken(seconds: float) -> str:
    """Return seconds as people say them: "42 s", "7 min", "1.5 h"."""
    if seconds < 90:
        return f"{max(seconds, 0.1):.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def counted(count: int, noun: str, several: str | None = None) -> str:
    """Return a count with its noun, "1 frame" or "5 frames"; `several` is the plural, if not with s."""
    return f"{count:,} {noun if count == 1 else several or noun + 's'}"


def standard_output() -> Console:
    """Return the console for tables and the text around them."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 240  # in a pipe or a file, lines stay whole
    return console


def table_of(columns: Sequence[str] | None, rows: Iterable[Sequence[str]], right: int = 0) -> Table:
    """Return a plain table, its last `right` columns aligned right; without `columns`, the first of two is bold."""
    from rich.table import Table

    from ..scene.checks import printable

    names = columns or ("", "")
    table = Table(*names, show_header=columns is not None, box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(table.columns):
        column.overflow = "fold"
        column.justify = "right" if index >= len(names) - right else "left"
    if columns is None:
        table.columns[0].style = "bold"
    for row in rows:
        table.add_row(*map(printable, row))
    return table
