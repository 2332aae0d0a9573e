"""The command `photonbeams`.

Each command is a function in the module of the same name, which is imported when the command is called or listed. The
modules import heavy packages (Mitsuba, OpenUSD, Dr.Jit) inside the function, so that `--help` is fast. Exit codes: 0
success, 1 a failed render, 2 bad usage, 75 a lost farm (try again), 128 + the number of the signal that ended the
command (130 for Ctrl-C). Messages go to standard error.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from io import BufferedWriter, FileIO, TextIOWrapper
from itertools import pairwise
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

__all__ = ["app", "main"]

_COMMANDS = (
    "render", "merge", "steady", "beams", "export", "dress", "swatch", "studio", "info", "quadrature", "doctor",
)  # fmt: skip
_INTERRUPTED = 128 + signal.SIGINT
_LONGEST = 300  # characters of a message


class _Commands(TyperGroup):
    """The commands, imported one by one."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for name in _COMMANDS if find_spec(f"{__name__}.{name}")]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        # For an unknown name, load all commands: Typer suggests the one that was probably meant.
        for name in [cmd_name] if cmd_name in _COMMANDS else self.list_commands(ctx):
            if name not in self.commands and name in self.list_commands(ctx):
                self.commands[name] = _command(name)
        return self.commands.get(cmd_name)

    def invoke(self, ctx: Any) -> Any:
        """Call the command; raise `_Ended` for a signal that ends it, because Typer would take any for Ctrl-C."""
        from ..runtime.limits import LEAST, check_address_space, check_working_folder

        check_working_folder()
        check_address_space(libraries=LEAST)  # before NumPy is imported, which would end the process
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise _Ended from interrupt


class _Ended(Exception):  # noqa: N818 (no error: a signal)
    """A signal ended the command; it is the cause of this exception."""


def _command(name: str) -> Any:
    """Return the function `name` of the module `name` as a command."""
    from .groups import with_groups

    module = import_module(f"{__name__}.{name}")
    single = typer.Typer(add_completion=False)
    single.command(name)(with_groups(getattr(module, name)))
    return typer.main.get_command(single)


app = typer.Typer(cls=_Commands, add_completion=False, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        from .. import __version__

        print(f"photonbeams {__version__}")
        raise typer.Exit


@app.callback()
def _photonbeams(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Render volumetric light as photon beams: a USD stage in, a layered EXR out."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit the process.

    An error that a user can cause ends it with one sentence on standard error; with PHOTONBEAMS_TRACEBACK=1, the
    traceback is shown instead. An error of the program itself keeps its traceback.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    _ready_streams()
    _ignore_snapshots()
    try:
        # In its standalone mode Typer would draw a box around the message and break its lines.
        code = app(args=given or ["--help"], prog_name="photonbeams", standalone_mode=False)
        sys.stdout.flush()
    except TyperException as error:
        _fail(f"Error: {_usage(error)}", 2, given)
    except (Exception, KeyboardInterrupt) as error:
        number = _signal(error)
        if number is not None:
            _end(number, getattr(error, "done", None), given)
        sentence = _sentence(error)
        if sentence is None or os.environ.get("PHOTONBEAMS_TRACEBACK", "0") not in ("", "0"):
            raise
        code = max(getattr(each, "exit_code", 1) for each in (error, error.__cause__))
        _fail(f"Error: {sentence}", code, given)
    if code == _INTERRUPTED:  # before the command was called
        _end(signal.SIGINT, None, given)
    raise SystemExit(code or (0 if given else 2))  # without a command, the help is a usage error


def _ignore_snapshots() -> None:
    """Ignore SIGUSR1 until `progress.snapshots` handles it: it asks for a picture that is not begun, or is written."""
    if sys.platform != "win32" and threading.current_thread() is threading.main_thread():
        if signal.getsignal(signal.SIGUSR1) == signal.SIG_DFL:  # which would end the process
            signal.signal(signal.SIGUSR1, signal.SIG_IGN)


def _ready_streams() -> None:
    """Let both output streams take any name, as an escape sequence if their encoding has no such character.

    A stream that the caller has closed leads nowhere; otherwise the next file that is opened would get its number, and
    what compiled libraries print. Neither do messages that a full disk or a closed pipe does not take.
    """
    for name, number in (("stdout", 1), ("stderr", 2)):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_WRONLY)
            if null != number:  # a lower number was free, too
                os.dup2(null, number)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w", closefd=False))
        if isinstance(stream := getattr(sys, name), TextIOWrapper):  # a caller may have put another in its place
            stream.reconfigure(errors="backslashreplace")
            if stream is getattr(sys, f"__{name}__"):
                file, known = BufferedWriter(_Lasting(number, "wb", closefd=False)), (stream.encoding, stream.errors)
                setattr(sys, name, TextIOWrapper(file, *known, line_buffering=stream.line_buffering))


class _Lasting(FileIO):
    """An output stream: it loses messages that cannot be written, and says once where results cannot be."""

    _is_lost = False

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if self._is_lost or self.fileno() == 2:  # a render is worth more than its log
                return len(data)
            self._is_lost = True
            raise OSError(error.errno, error.strerror, "standard output") from None


def _signal(error: BaseException | None) -> int | None:
    """Return the signal that caused an error, or None: Dr.Jit wraps exceptions that are raised in a recorded loop."""
    found = None
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            found = getattr(error, "number", found or int(signal.SIGINT))
        error = error.__cause__ or error.__context__
    return found


def _end(number: int, done: str | None, given: Sequence[str]) -> NoReturn:
    """Say which signal ended the command and what was written; exit with the code that shells expect."""
    from .progress import NOTHING, ending

    _fail(f"{ending(number)}; {done or NOTHING}", 128 + number, given)


def _usage(error: TyperException) -> str:
    """Return a message about a command line: the flag, what was found, and what was expected."""
    parameter, details = getattr(error, "param", None), getattr(error.__cause__, "errors", None)
    if parameter is not None and callable(details):  # Typer's type check knows what it found
        found = details()[0]
        expected = str(found["msg"]).removeprefix("Input should be ").partition(", unable")[0].rstrip(".")
        before, choices, names = expected.partition(" is not one of ")
        return f"{parameter.opts[0]} is {found['input']}: expected {'one of ' + names if choices else before}"
    # One that our commands raise is a whole sentence.
    own = isinstance(error, typer.BadParameter) and (parameter is None or error.message.startswith(parameter.opts[0]))
    return error.message if own else " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined]


def _sentence(error: BaseException) -> str | None:
    """Return the message for an error that a user can cause, or None for a fault of the program."""
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return f"{error.filename}: {reason}" if error.filename is not None else reason
    from ..farm.cluster import FarmError
    from ..runtime.device import DeviceError
    from ..scene import SceneError
    from .animation import FrameError

    if isinstance(error, FrameError):
        cause = error.__cause__
        sentence = _usage(cause) if isinstance(cause, TyperException) else _sentence(cause)  # type: ignore[arg-type]
        return sentence and f"{error.frame}{sentence}"
    if isinstance(error, UnicodeDecodeError):  # from OpenUSD: text in a binary layer
        return f"a file has the text {error.object[:60].decode(errors='replace')!r}: expected UTF-8"
    if isinstance(error, SceneError | DeviceError | FarmError):
        return str(error)
    if isinstance(error, MemoryError) or "out of memory" in str(error):  # Dr.Jit raises a RuntimeError
        return "not enough memory for this many beams and pixels on this device"
    return None


def _fail(message: str, code: int, given: Sequence[str]) -> NoReturn:
    """Print a message on standard error, and for Open Job Description if `--progress openjd` is given; exit."""
    if len(message) > _LONGEST or not message.isprintable():
        from ..scene.checks import shortened

        message = shortened(message)
    with suppress(OSError):  # a full disk may be to blame, which holds the messages, too
        print(message, file=sys.stderr)
        if "--progress=openjd" in given or ("--progress", "openjd") in pairwise(given):
            print(f"openjd_fail: {message}", flush=True)
    raise SystemExit(code)
