"""Load Python functions and looks that a user names on the command line, as FILE.py:NAME."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from ..looks import Look


def load_function(flag: str, text: str | None) -> Callable[..., Any] | None:
    """Return the function that a flag names, or None without the flag; BadParameter if there is none.

    Exceptions of the file or the function become a SceneError of one sentence, with file and line.
    """
    return None if text is None else _told(*_loaded(flag, text, callable, "a function"))


def load_looks(flag: str, texts: Sequence[str]) -> Look | dict[str, Look] | None:
    """Return the looks that a flag names: FILE.py:NAME for all beams, PRIM=FILE.py:NAME for some, or None."""
    from ..looks import Look

    found: dict[str, Look] = {}
    for text in texts:
        prim, _, place = text.rpartition("=")
        if prim in found or (found and "" in (prim, *found)):
            raise typer.BadParameter(
                f"{flag} is {text}: expected either one look for all beams, or at most one for each prim"
            )
        found[prim] = _loaded(flag, place, lambda value: isinstance(value, Look), "a photonbeams.Look")[0]
    return found.get("") or found or None


def _loaded(flag: str, text: str, fits: Callable[[object], bool], kind: str) -> tuple[Any, Path]:
    """Return the object that FILE.py:NAME names, and the file."""
    name, _, function = text.rpartition(":")
    path = Path(name)
    if path.suffix != ".py" or not function.isidentifier():
        raise typer.BadParameter(f"{flag} is {text}: expected FILE.py:NAME, such as beams.py:bend")
    if not path.is_file():
        raise typer.BadParameter(f"{flag} is {text}: expected a file that exists")
    module = _told(_module, path)(path)
    found = getattr(module, function, None)
    if not fits(found):
        raise typer.BadParameter(f"{flag} is {text}: expected {kind} '{function}' in {path}")
    return found, path


def _module(path: Path) -> ModuleType:
    """Run a file, as it is now, as a module of its own, which may import its neighbours."""
    module = ModuleType(f"photonbeams_program_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    sys.path.insert(0, str(path.parent.absolute()))
    try:
        exec(compile(path.read_bytes(), path, "exec"), vars(module))
    finally:
        sys.path.remove(str(path.parent.absolute()))
    return module


def _told(function: Callable[..., object], path: Path) -> Callable[..., Any]:
    """Return a function that raises exceptions and SystemExit as a SceneError of one sentence; Ctrl-C passes."""
    from ..scene import SceneError

    @wraps(function)
    def called(*given: object) -> object:
        try:
            return function(*given)
        except (Exception, SystemExit) as error:
            raise SceneError(_sentence(error, path)) from error

    return called


def _sentence(error: BaseException, path: Path) -> str:
    """Return an exception's file, line and message; the line is the last one in the user's file."""
    if isinstance(error, SyntaxError):
        line = f", line {error.lineno}" if error.lineno else ""  # a binary file has no lines
        return f"{path}{line}: {error.msg}"
    own = [entry for entry in traceback.extract_tb(error.__traceback__) if Path(entry.filename) == path]
    own = own or [each for each in traceback.extract_tb(error.__traceback__) if Path(each.filename).name == path.name]
    place = f"{path}, line {own[-1].lineno}" if own else str(path)
    text = " ".join(str(error).split())
    return f"{place}: {type(error).__name__}{': ' if text else ''}{text}"
