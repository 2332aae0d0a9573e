"""The console on which commands print their results: standard output, by Rich."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def standard_output() -> Console:
    """Return the console for tables and the text around them."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 240  # in a pipe or a file, lines stay whole
    return console
