"""The process that renders: a Python of its own, so that its libraries and Blender's never meet."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from . import messages
from .bundle import Bundle, NoRendererError

#: What names a Python that has photonbeams, if the preferences name none.
VARIABLE = "PHOTONBEAMS_PYTHON"
_PATIENCE = 1.0  # seconds until a process that was asked to end is killed


class Python(NamedTuple):
    """A Python that has photonbeams, and a folder of further packages, "" for none."""

    path: str
    packages: str = ""


def python_of(chosen: str, bundle: Bundle | None = None) -> Python:
    """Return the Python that has photonbeams: the chosen one, Blender's with a bundle, or that of the command."""
    if chosen or (chosen := os.environ.get(VARIABLE, "")):
        return Python(chosen)
    if bundle is not None:
        return Python(sys.executable, bundle.packages())
    command = shutil.which("photonbeams")
    folder = Path() if command is None else Path(os.path.realpath(command)).parent
    names = (folder / "python", folder / "python3", folder / "python.exe", folder.parent / "python.exe")
    found = next((each for each in names if command is not None and each.exists()), None)
    if found is None:
        raise NoRendererError(
            "photonbeams was not found: expected a Python that has it (pip install 'photonbeams[usd]') in the "
            "preferences of this add-on"
        )
    return Python(str(found))


class Renderer:
    """A process that renders.

    Parameters
    ----------
    python
        The Python that has photonbeams.

    Raises
    ------
    NoRendererError
        The process cannot be started.
    """

    def __init__(self, python: Python) -> None:
        self.python, self.rendered = python, 0
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        if python.packages:
            environment |= {"PYTHONPATH": python.packages, "PYTHONNOUSERSITE": "1"}
        try:
            self._process = subprocess.Popen(
                [python.path, "-P", "-m", "photonbeams.blender.worker"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, env=environment,
            )  # fmt: skip
        except OSError as error:
            raise NoRendererError(
                f"{python.path} cannot be started ({error.strerror}): expected a Python 3.11"
            ) from None
        self._came: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        self._going: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        for work in (self._receive, self._write):  # Blender never waits for a pipe
            threading.Thread(target=work, daemon=True).start()

    def _receive(self) -> None:
        assert self._process.stdout is not None
        try:
            while (message := messages.read(self._process.stdout)) is not None:
                self._came.put(message)
        finally:
            self._came.put(None)

    def _write(self) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # the process has ended, or the pipe was closed
            while (message := self._going.get()) is not None:
                messages.write(self._process.stdin, message)
        with suppress(OSError):
            self._process.stdin.close()

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def number(self) -> int:
        """The number of the process."""
        return self._process.pid

    def send(self, do: str, **content: Any) -> None:
        """Send a message, whose arrays must not change any more; NoRendererError if the process has ended."""
        if not self.alive:
            raise self._ended()
        self._going.put({"do": do, **content})

    def receive(self, seconds: float) -> dict[str, Any] | None:
        """Return the next message, or None if there is none for so many seconds; NoRendererError as for `send`."""
        try:
            message = self._came.get(timeout=seconds)
        except Empty:
            return None
        if message is None:
            raise self._ended()
        return message

    def _ended(self) -> NoRendererError:
        code = self._waited()
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        killed = code < 0  # by a signal, of which the log says nothing
        why = f"code {code}" if killed or not lines else lines[-1][:180]
        return NoRendererError(f"the renderer has ended ({why}): the next render starts it again")

    def close(self) -> None:
        """End the process."""
        self._going.put(None)
        self._waited()
        self._log.close()

    def _waited(self) -> int:
        """Return the code with which the process ends, or is ended after a while."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_PATIENCE)
        self._process.kill()
        return self._process.wait()


class Pool:
    """Renderers that stay warm while nothing is rendered: a picture takes one, and each viewport."""

    def __init__(self) -> None:
        self._idle: list[Renderer] = []
        self.bundle: Bundle | None = None  #: The renderer that comes with the extension, if one does.

    def take(self, chosen: str) -> Renderer:
        """Return a renderer of the chosen Python, started if none waits.

        Raises
        ------
        NotYetError
            The one that comes with the extension is being unpacked.
        NoRendererError
            There can be none.
        """
        python = python_of(chosen, self.bundle)
        while self._idle:
            renderer = self._idle.pop()
            if renderer.alive and renderer.python == python:
                return renderer
            renderer.close()
        return Renderer(python)

    def give(self, renderer: Renderer) -> None:
        """Take back a renderer, which forgets its scene."""
        if renderer.alive:
            renderer.send("scene", prims=[], whole=True)
            self._idle.append(renderer)
        else:
            renderer.close()

    def close(self) -> None:
        """End the processes that wait."""
        while self._idle:
            self._idle.pop().close()


POOL = Pool()
