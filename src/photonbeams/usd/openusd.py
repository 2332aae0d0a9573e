"""OpenUSD, or what stands in its place where it is not installed.

Mitsuba scenes, arrays and the plug-in need none of it, but shots and looks know of stages. So its modules come from
here: `from .openusd import Usd`. Without the package they are stand-ins, which tell on first use what is missing.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ..scene.extras import needs

#: Whether OpenUSD is there.
INSTALLED = find_spec("pxr") is not None


class _Missing(type):
    """The class of stand-ins: for a module, for its classes and for what these hold."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _stand_in(f"{cls.__name__}.{name}")

    def __and__(cls, other: Any) -> Any:
        """Return a stand-in for flags."""
        return cls

    def __call__(cls, *_: Any, **__: Any) -> Any:
        with needs("usd", "a stage", "OpenUSD"):
            raise ImportError


def _stand_in(name: str) -> Any:
    """Return a stand-in; as an exception, so that `except` clauses may name it."""
    return _Missing(name, (Exception,), {})


def __getattr__(name: str) -> Any:
    """Return a module of OpenUSD."""
    if name.startswith("__"):
        raise AttributeError(name)
    result = import_module(f"pxr.{name}") if INSTALLED else _stand_in(name)
    globals()[name] = result
    return result
