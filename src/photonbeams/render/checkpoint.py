"""Checkpoints: the state of a frame in a file, from which a later render resumes to the same bits."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ..runtime.digest import digest
from ..runtime.files import PathLike, atomic_path
from ..scene import SceneError
from .passes import Accumulating


class Checkpoint:
    """A file for the state of a frame.

    Parameters
    ----------
    path
        The file, written whole or not at all. It stays when the frame is done: remove it once that is written.
    every
        Seconds between two writes; it is also written when `progress` raises KeyboardInterrupt. None: never written.
    resume
        Whether a render begins with what the file has, if there is one.

    Attributes
    ----------
    passes
        Number of passes that the file has, if this render wrote it; else 0.
    """

    def __init__(self, path: PathLike, every: float | None = 60.0, resume: bool = True) -> None:
        if every is not None and not (isinstance(every, int | float) and every > 0):
            raise SceneError(f"every is {every!r}: expected a positive number of seconds, or None")
        self.path, self.every, self.resume, self.passes = Path(path), every, resume, 0
        self._about, self._written = "", time.perf_counter()

    @classmethod
    def of(cls, given: PathLike | Checkpoint | None) -> Checkpoint | None:
        """Return a checkpoint, or the one at a path; None stays None."""
        return given if given is None or isinstance(given, cls) else cls(given)  # type: ignore[arg-type]

    def begin(self, *about: Any) -> dict[str, np.ndarray] | None:
        """Return the state to resume from, None to start anew.

        `about` is everything that has to be the same for passes to be of one picture.

        Raises
        ------
        SceneError
            The file is no checkpoint, or one of another picture.
        """
        from importlib.metadata import version

        self._about, self._written = digest(version("photonbeams"), *about), time.perf_counter()
        if not self.resume or not self.path.is_file():
            return None
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                state = {name: archive[name] for name in archive.files}
                found = str(state.pop("about"))
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise SceneError(f"{self.path}: expected a checkpoint of photonbeams: {error}") from None
        if found != self._about:
            raise SceneError(
                f"{self.path}: is the checkpoint of another scene or of other settings: expected the same, or no "
                "--resume"
            )
        return state

    @property
    def due(self) -> bool:
        """Whether it is time to write."""
        return self.every is not None and time.perf_counter() - self._written >= self.every

    def save(self, frame: Accumulating) -> None:
        """Write the state of a frame that has at least one pass, unless the checkpoint is never written."""
        if self.every is None or not frame.statistics.passes:
            return
        with atomic_path(self.path) as beside, beside.open("wb") as file:
            np.savez(file, about=np.array(self._about), **frame.state())  # type: ignore[arg-type]
        self.passes, self._written = frame.statistics.passes, time.perf_counter()

    def remove(self) -> None:
        """Remove the file, if there is one."""
        self.path.unlink(missing_ok=True)
