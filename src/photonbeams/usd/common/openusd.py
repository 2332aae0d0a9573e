"""The modules of OpenUSD, or stand-ins if it is not installed.

Mitsuba scenes, arrays and the plug-in do not need OpenUSD, but modules for shots and looks import it. They import its
modules from here: `from .openusd import Usd`. Without the package these are stand-ins, whose first use raises an error
that says what is missing.
"""

from __future__ import annotations

import logging
import os
import re
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ...scene.checks import shortened
from ...scene.extras import needs

#: Whether OpenUSD is installed.
INSTALLED = find_spec("pxr") is not None


def text_of(error: BaseException) -> str:
    """Return the text of an error of OpenUSD, which may quote bytes of a broken file that are no valid text."""
    try:
        return str(error)
    except UnicodeDecodeError as wrong:
        return wrong.object.decode(errors="replace")


def sentences_of(error: BaseException) -> list[str]:
    """Return what an error of OpenUSD says, without the places in its source."""
    return re.findall(r" : '(.*?)\s*'(?=\s*\n\tError|\s*$)", text_of(error), re.DOTALL)


@cache
def plugin_problem() -> str:
    """Return which plug-ins OpenUSD cannot load, and goes on without, as a sentence; "" if it loads all.

    It finds plug-ins and chooses its asset resolver when these are first asked for, and raises errors about them once.
    """
    if not INSTALLED:
        return ""
    from pxr import Ar, Plug, Tf

    found: list[str] = []
    for load in (Plug.Registry().GetAllPlugins, Ar.GetResolver):
        try:
            load()
        except Tf.ErrorException as error:
            found += sentences_of(error)
    named = os.environ.get("PXR_PLUGINPATH_NAME", "")
    reasons = "; ".join(each.rstrip(".") for each in found)
    return reasons and f"OpenUSD goes on without plug-ins of PXR_PLUGINPATH_NAME ('{named}'): {reasons}"


@cache
def _warn_of_plugins() -> None:
    """Warn about plug-ins that OpenUSD cannot load, once."""
    if problem := plugin_problem():
        logging.getLogger("photonbeams").warning("%s", shortened(problem))


class _Missing(type):
    """The class of stand-ins for a module, its classes and their attributes."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _stand_in(f"{cls.__name__}.{name}")

    def __and__(cls, other: Any) -> Any:
        """Return a stand-in for combined flags."""
        return cls

    def __call__(cls, *_: Any, **__: Any) -> Any:
        with needs("usd", "a stage", "OpenUSD"):
            raise ImportError


def _stand_in(name: str) -> Any:
    """Return a stand-in, which is an exception class so that `except` clauses may name it."""
    return _Missing(name, (Exception,), {})


def __getattr__(name: str) -> Any:
    """Return a module of OpenUSD."""
    if name.startswith("__"):
        raise AttributeError(name)
    _warn_of_plugins()  # otherwise whatever needs plug-ins first would raise their errors
    result = import_module(f"pxr.{name}") if INSTALLED else _stand_in(name)
    globals()[name] = result
    return result
