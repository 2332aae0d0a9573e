"""What a render says while it runs, on standard error: warnings, passes done, and what it took."""

from __future__ import annotations

import logging
import sys
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
def bar(kind: Progress | None, quiet: bool, passes: int) -> Iterator[Callable[[int, Statistics], None] | None]:
    """Yield what is called with each pass done, to show it."""
    if quiet or kind is Progress.none:
        yield None
        return
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if kind is Progress.plain or (kind is None and not console.is_terminal):
        yield lambda done, statistics: print(f"pass {done} of {passes}", file=sys.stderr, flush=True)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Bar(*columns, console=console, transient=True) as shown:
        task = shown.add_task("passes", total=passes)
        yield lambda done, statistics: shown.update(task, completed=done)


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
