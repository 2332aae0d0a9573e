"""Final renders: the command `photonbeams render` with the edits of a session, in a process of its own."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import tempfile
import zipfile
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..runtime.files import atomic_file, temporary_folder, write_bytes
from ..scene import SceneError
from ..usd.cameras.stereo import Stereo

_PROGRESS = re.compile(rb"openjd_progress: ([\d.]+)")

#: Called during a final render: per cent done, the file once it exists, and a sentence if the render failed.
Told = Callable[[int, Path | None, str | None], Awaitable[None]]


@dataclass(frozen=True)
class Wanted:
    """What a final render needs.

    Attributes
    ----------
    stage, layers, overrides
        The stage's file; the layers over it, the strongest first; and values over these, as for the command.
    edits
        The text of a .usda layer with the edits.
    camera, width, height
        The camera, None: the stage's own; and the size in pixels.
    passes, frames
        The number of passes; and the first and the last frame, None: the stage's default.
    stereo
        How the camera becomes two eyes; None: it does not.
    """

    stage: Path
    layers: Sequence[str]
    overrides: Sequence[str]
    edits: str
    camera: str | None
    width: int
    height: int
    passes: int
    frames: tuple[float, float] | None
    stereo: Stereo | None = None

    def flags(self) -> list[str]:
        """Return the command's flags for the camera, the frames and stereo."""
        words = ["--camera", self.camera] if self.camera else []
        words += ["--frames", f"{self.frames[0]:g}:{self.frames[1]:g}"] if self.frames else []
        if self.stereo is not None:
            words.append("--stereo")
            for name in ("interaxial", "convergence"):
                if (value := getattr(self.stereo, name)) is not None:
                    words += [f"--{name}", repr(float(value))]
        return words


class FinalRender:
    """Runs at most one final render at a time; its files are in a folder that is removed with the studio."""

    def __init__(self) -> None:
        self._folder = temporary_folder("studio")
        self._process: asyncio.subprocess.Process | None = None

    @property
    def folder(self) -> Path:
        """The folder of finished files."""
        return Path(self._folder.name)

    async def run(self, wanted: Wanted, told: Told) -> None:
        """Render, and call `told` with the progress.

        Raises
        ------
        SceneError
            Another final render is under way.
        """
        if self._process is not None:
            raise SceneError("a final render is under way: wait until it ends, or cancel it")
        work = Path(tempfile.mkdtemp(dir=self.folder))
        layer = work / "edits.usda"
        write_bytes(layer, wanted.edits.encode())
        name = wanted.stage.stem
        pattern = f"{name}.####.exr" if wanted.frames else f"{name}.exr"
        words = [sys.executable, "-m", "photonbeams", "render", str(wanted.stage), "--session-layer", str(layer)]
        for each in wanted.layers:
            words += ["--session-layer", each]
        for each in wanted.overrides:
            words += ["--set", each]
        words += [*wanted.flags(), "--res", str(wanted.width), str(wanted.height), "--passes", str(wanted.passes)]
        words += ["-o", str(work / pattern), "--progress", "openjd"]
        # A process group of its own: Ctrl-C in a terminal ends only the studio, which then ends the render properly.
        process = self._process = await asyncio.create_subprocess_exec(
            *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, start_new_session=True
        )
        try:
            messages = asyncio.ensure_future(process.stderr.read())  # type: ignore[union-attr]
            async for line in process.stdout:  # type: ignore[union-attr]
                if found := _PROGRESS.search(line):
                    await told(min(int(float(found[1])), 99), None, None)
            code, text = await process.wait(), (await messages).decode(errors="replace")
            if code == 0:
                await told(100, self._packed(work, name), None)
            else:
                errors = [each.removeprefix("Error: ") for each in text.splitlines() if each.startswith("Error: ")]
                ended = "the render was cancelled" if code in (-signal.SIGTERM, 128 + signal.SIGTERM) else None
                await told(0, None, ended or (errors or [f"the render ended with code {code}"])[0][:300])
        finally:
            self._process = None

    def _packed(self, work: Path, name: str) -> Path:
        """Return the file of the only picture, or an archive of several."""
        pictures = sorted(work.glob("*.exr"))
        if len(pictures) == 1:
            target = self.folder / pictures[0].name
            os.replace(pictures[0], target)
            return target
        target = self.folder / f"{name}.zip"
        with (
            atomic_file(target) as file,
            zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive,  # EXR is compressed already
        ):
            for each in pictures:
                archive.write(each, each.name)
        return target

    def cancel(self) -> None:
        """End the render that is under way, if there is one."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.terminate()

    def close(self) -> None:
        """End the render that is under way, if there is one, and remove all files."""
        self.cancel()
        self._folder.cleanup()
