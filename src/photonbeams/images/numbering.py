"""File names with a frame number, as in usdrecord: #### is a whole number, ####.## has two decimals."""

from __future__ import annotations

import re
from pathlib import Path

PLACEHOLDER = re.compile(r"#+(?:\.#+)?")


def numbering_problem(path: Path) -> str:
    """Return what is expected instead of the # in the name of a file to write, or ""."""
    # One # may be a part of a folder's name, such as C#.
    several = len(PLACEHOLDER.findall(path.name)) > 1 or "##" in str(path.parent)
    return "expected one run of # for the frame number, in the file's own name" if several else ""


def numbered(path: Path, frame: float) -> Path:
    """Return the path of a frame: each run of # in the name is replaced by the number, padded with zeros."""

    def number(run: re.Match[str]) -> str:
        digits = len(run[0].partition(".")[2])
        if not digits and frame != int(frame):
            return f"{frame:.10g}"
        return f"{frame:0{len(run[0])}.{digits}f}"

    return path.with_name(PLACEHOLDER.sub(number, path.name)) if path.name else path
