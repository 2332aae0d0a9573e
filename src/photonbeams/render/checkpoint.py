"""Checkpoints: the sums of a frame in a file, from which a later render resumes to the same bits."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..scene import SceneError, arguments
from .films.frame_sums import FrameSums
from .films.sums import ADDING

_PATIENCE = 5.0  # seconds; adding a pass to the sums takes less


class Checkpoint:
    """A file for the sums of a frame.

    Parameters
    ----------
    path
        The file, written completely or not at all. It stays when the frame is done: remove it once the picture is
        written.
    every
        Seconds between two writes. The file is also written when `progress` raises KeyboardInterrupt. None: never
        written.
    resume
        Whether a render begins with the passes in the file, if the file exists.

    Attributes
    ----------
    passes
        Number of passes in the file, if this render wrote it; else 0.
    source
        Returns the sums so far, while a frame is rendered; `accumulate` sets it.
    """

    @arguments
    def __init__(self, path: PathLike, every: float | None = 60.0, resume: bool = True) -> None:
        if every is not None and not (isinstance(every, int | float) and every > 0):
            raise SceneError(f"every is {every!r}: expected a positive number of seconds, or None")
        self.path, self.every, self.resume, self.passes = Path(path), every, resume, 0
        self.source: Callable[[], FrameSums] | None = None
        self._written = time.perf_counter()

    @classmethod
    def of(cls, given: PathLike | Checkpoint | None) -> Checkpoint | None:
        """Return a `given` checkpoint, or the checkpoint at a `given` path; None stays None."""
        return given if given is None or isinstance(given, cls) else cls(given)  # type: ignore[arg-type]

    def begin(self, about: str, passes: int | None = None) -> FrameSums | None:
        """Return the sums to resume from, or None to start from the first pass.

        Parameters
        ----------
        about
            Hash of the frame's content, as in `FrameSums`.
        passes
            How many passes the frame shall have; None: any number.

        Raises
        ------
        SceneError
            If the file is not a checkpoint, is of another picture, or has more passes.
        """
        self._written = time.perf_counter()
        if not self.resume or not self.path.exists():
            return None
        sums = FrameSums.load(self.path)
        if sums.about != about:
            raise SceneError(
                f"{self.path}: is the checkpoint of another scene or of other settings: expected the same, or no "
                "--resume"
            )
        check_passes(self.path, sums, passes)
        return sums

    @property
    def due(self) -> bool:
        """Whether it is time to write the file."""
        return self.every is not None and time.perf_counter() - self._written >= self.every

    def save(self, sums: FrameSums) -> None:
        """Write `sums`, if they have a pass and the checkpoint is to be written at all."""
        if self.every is None or not len(sums):
            return
        self._written = time.perf_counter()
        try:
            sums.save(self.path)
        except OSError as error:  # a full disk must not end a long render
            logging.getLogger("photonbeams").warning(
                "%s: %s; the render goes on without this checkpoint", self.path, error.strerror or error
            )
            return
        self.passes = len(sums)

    def rescue(self) -> None:
        """Write the sums so far from another thread, before the process ends in the middle of a pass."""
        if self.source is None or not ADDING.acquire(timeout=_PATIENCE):  # and no pass is added afterwards
            return
        sums = self.source()
        if all(each.ranges() == sums.ranges() for each in sums.views):  # both eyes have the same passes
            self.save(sums)

    def remove(self) -> None:
        """Remove the file, if it exists."""
        self.path.unlink(missing_ok=True)


def check_passes(path: PathLike, sums: FrameSums, passes: int | None) -> None:
    """Raise SceneError if a checkpoint has passes beyond those that are wanted: no pass can be taken out of a sum."""
    ranges = sums.ranges()
    if passes is not None and ranges and ranges[-1].stop > passes:
        expected = f"expected at least {ranges[-1].stop}, or no --resume"
        raise SceneError(f"{path}: has passes up to {ranges[-1].stop}, and {passes} are asked for: {expected}")


def identity(*about: Any) -> str:
    """Return a hash of everything that has to be the same for passes to be of one picture, with the version."""
    return digest(version("photonbeams"), *about)
