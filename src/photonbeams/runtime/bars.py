"""Progress bars on a terminal, for the command and for renders that a program starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

#: Called with what is done, the total if it is known, and a description.
Update = Callable[[int, "int | None", str], None]


def terminal(always: bool = False) -> Console | None:
    """Return a console on standard error, or None if that is not a terminal; `always` a console."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    return console if always or console.is_terminal else None


@contextmanager
def drawn(console: Console) -> Iterator[Update]:
    """Yield a function that updates a bar on a console; the bar is gone after the context."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task("passes", total=None)
        yield lambda done, total, text: shown.update(task, completed=done, total=total, description=text)
