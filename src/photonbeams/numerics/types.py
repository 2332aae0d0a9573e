"""Types of arguments that code for several array libraries shares."""

from __future__ import annotations

from typing import Any, Protocol


class Floats(Protocol):
    """A number, or an array of numbers, of Python, NumPy or Dr.Jit."""

    def __add__(self, other: Any, /) -> Any: ...
    def __sub__(self, other: Any, /) -> Any: ...
    def __lt__(self, other: Any, /) -> Any: ...
