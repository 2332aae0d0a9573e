"""Where commands print what they were asked for: standard output, by rich."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def standard_output() -> Console:
    """Return the console of tables and of what is said about them."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 240  # what is piped or filed keeps its lines whole
    return console
