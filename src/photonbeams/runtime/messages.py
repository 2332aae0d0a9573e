"""Messages of Mitsuba as sentences for users."""

from __future__ import annotations

import re
from pathlib import Path

from ..scene.checks import shortened

_TRACE = "Traceback (most recent call last):"
_MAKING = re.compile(r': failed to instantiate \w+ plugin of type "(\w+)":$')


def reason(text: str, path: Path | None = None) -> str:
    """Return Mitsuba's message in one line, without source lines and tracebacks.

    At its beginning, the name of the file at `path`, or of a text, is left out.
    """
    text = re.sub(r"^\[[\w.]+:\d+\]\s*", "", text.strip())
    if path is not None:
        text = re.sub(
            rf"^(?:At|While loading|Error while loading) (?:{re.escape(str(path))}|string) \((.*?)\)", r"\1", text
        )
    text, trace, lines = text.partition(_TRACE)
    text = " ".join(text.split())
    if trace:  # from a plug-in in Python: its last line without indentation is the error, "Class: what is wrong"
        last = [line.partition(": ")[2] for line in lines.splitlines() if re.match(r"[\w.]+: ", line)]
        making = _MAKING.search(text)
        if making is not None:
            own = f"{making[1]}: "
            return shortened(f"{text[: making.start()]}: {own}{''.join(last[-1:]).removeprefix(own)}")
        text = " ".join((text, *last[-1:]))
    return text[:500].strip()
