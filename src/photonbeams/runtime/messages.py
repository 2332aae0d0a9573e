"""Messages of Mitsuba as sentences for users."""

from __future__ import annotations

import re
from pathlib import Path

from ..scene.checks import shortened

_TRACE = "Traceback (most recent call last):"


def reason(text: str, path: Path | None = None) -> str:
    """Return Mitsuba's message in one line, without source lines, tracebacks, and the name of the file at `path`."""
    text = re.sub(r"^\[[\w.]+:\d+\]\s*", "", text.strip())
    if path is not None:
        text = re.sub(rf"^At {re.escape(str(path))} \((.*?)\)", r"\1", text)
    text, trace, lines = text.partition(_TRACE)
    parts = [line.strip() for line in text.splitlines() if line.strip()]
    if trace:  # from a plug-in in Python: its last line without indentation is the error, "Class: what is wrong"
        last = [line for line in lines.splitlines() if re.match(r"[\w.]+: ", line)]
        parts.append(last[-1].partition(": ")[2] if last else "")
    return " ".join(parts)[:500].strip()


def own_reason(text: str, plugin: str) -> str | None:
    """Return what a plug-in in Python says in Mitsuba's message, and where it is; None for a message of others."""
    place, found, rest = text.partition(f'plugin of type "{plugin}": {_TRACE}')
    if not found:
        return None
    place = reason(place).partition(": failed to instantiate")[0]
    return shortened(f"{place}: {plugin}: {reason(_TRACE + rest).removeprefix(f'{plugin}: ')}")
