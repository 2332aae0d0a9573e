"""What a render says while it runs, on standard error: warnings, passes done, and what it took."""

from __future__ import annotations

import logging
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..render.frame import Statistics


class Progress(StrEnum):
    """How progress is shown."""

    rich = "rich"
    plain = "plain"
    none = "none"


@contextmanager
def messages(quiet: bool, verbose: bool) -> Iterator[None]:
    """Print the package's warnings within: with `quiet` errors alone, with `verbose` what is of interest, too."""
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
    """Messages as "Warning: text", as errors are "Error: text"."""

    def format(self, record: logging.LogRecord) -> str:
        return f"{record.levelname.capitalize()}: {record.getMessage()}"


@contextmanager
def held_interrupt() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C back until what is yielded is called; a second one is not held back.

    Compiled libraries lose an exception that is raised while they are imported or call Python: they print a traceback
    and go on, hang, or abort.
    """
    pressed = False

    def hold(*_: object) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = True

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not usual or threading.current_thread() is not threading.main_thread():
        yield check
        return
    signal.signal(signal.SIGINT, hold)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def bar(kind: Progress | None, quiet: bool, passes: int) -> Iterator[Callable[[int], None]]:
    """Yield what shows the number of passes done."""
    if quiet or kind is Progress.none:
        yield lambda done: None
        return
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if kind is Progress.plain or (kind is None and not console.is_terminal):
        yield _plain(passes)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Bar(*columns, console=console, transient=True) as shown:
        task = shown.add_task("passes", total=passes)
        yield lambda done: shown.update(task, completed=done)


def _plain(passes: int) -> Callable[[int], None]:
    """Return what prints a line about every twentieth of the passes: a log is read afterwards."""
    step = max(1, passes // 20)

    def show(done: int) -> None:
        if done % step == 0 or done == passes:
            print(f"pass {done} of {passes}", file=sys.stderr, flush=True)

    return show


def print_summary(statistics: Statistics, files: Iterable[Path], seconds: float) -> None:
    """Print what was done."""
    phases = ", ".join(f"{name} {value:.1f}" for name, value in statistics.seconds.items())
    lines = [
        f"{statistics.passes:,} passes, {statistics.beams:,} beams, "
        f"{statistics.tests / 1e6:,.0f} million ray-beam tests",
        f"{seconds:.1f} s ({phases}; compiling {statistics.compile_seconds:.1f} of it, "
        f"{statistics.kernels_compiled} kernels)",
        *(f"wrote {path}" for path in files),
    ]
    print("\n".join(lines), file=sys.stderr)
