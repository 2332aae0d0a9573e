"""A worker process as the comparison sees it: it is asked for renders, and started again if it dies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO, cast

from .protocol import Reply, Request
from .trees import ROOT

# Kernels and logs of the workers, which git ignores. Kernels are kept by their code, so those of all commits may lie
# here together; the folder can be deleted at any time.
CACHES = ROOT / "out" / "compare"


class Worker:
    """A process that renders by the code of a tree, with a kernel cache of its own, which is kept under its name."""

    def __init__(self, name: str, tree: Path) -> None:
        self.name, self._tree = name, tree
        self._home = CACHES / name
        self._home.mkdir(parents=True, exist_ok=True)
        self.log = CACHES / f"{name}.log"
        self.log.write_text("")
        self.scenes: tuple[str, ...] = ()
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Worker:
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def _start(self) -> None:
        """Start the process, and check that it has the code of its tree."""
        source = self._tree / "src"
        # Dr.Jit keeps its kernels in $HOME/.drjit.
        environment = os.environ | {"HOME": str(self._home), "PYTHONPATH": f"{source}{os.pathsep}{ROOT}"}
        with self.log.open("a") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.compare.worker"], cwd=ROOT, env=environment, text=True, stderr=log,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            )  # fmt: skip
        hello = self._read()
        if hello is None:
            self._stop()
            raise OSError(f"the code of {self._tree} does not start: {self._last_line()} (see {self.log})")
        if not Path(hello["file"]).resolve().is_relative_to(source.resolve()):
            self._stop()
            raise OSError(f"photonbeams comes from {hello['file']}: expected it from {source}")
        self.scenes = tuple(hello["scenes"])

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def send(self, request: Request) -> None:
        """Ask for a render."""
        if self._process is None:
            self._start()
        process = cast("subprocess.Popen[str]", self._process)
        cast("TextIO", process.stdin).write(json.dumps(asdict(request)) + "\n")
        cast("TextIO", process.stdin).flush()

    def receive(self) -> Reply:
        """Wait for the render, and return what it cost; a process that has died has failed in it."""
        message = self._read()
        if message is not None:
            return Reply(**message)
        self._stop()
        return Reply(error=f"the process died: {self._last_line()} (see {self.log})")

    def ask(self, request: Request) -> Reply:
        """Return what a render cost."""
        self.send(request)
        return self.receive()

    def _read(self) -> dict[str, Any] | None:
        """Return the next message, or None if the process has ended."""
        process = cast("subprocess.Popen[str]", self._process)
        line = cast("TextIO", process.stdout).readline()
        return cast("dict[str, Any]", json.loads(line)) if line else None

    def _last_line(self) -> str:
        return next((line for line in reversed(self.log.read_text().splitlines()) if line.strip()), "it says nothing")
