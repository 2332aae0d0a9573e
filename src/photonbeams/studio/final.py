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
from pathlib import Path
from typing import NamedTuple

from ..runtime.files import atomic_file, temporary_folder, write_bytes
from ..scene import SceneError

_PROGRESS = re.compile(rb"openjd_progress: ([\d.]+)")

#: Called during a final render: per cent done, the file once it exists, and a sentence if the render failed.
Told = Callable[[int, Path | None, str | None], Awaitable[None]]


class Wanted(NamedTuple):
    """What a final render needs: the stage's file, a .usda layer of edits as text, and the command's other flags."""

    stage: Path
    edits: str
    flags: Sequence[str]


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
        """Render, and call `told` with the progress; SceneError if another final render is under way."""
        if self._process is not None:
            raise SceneError("a final render is under way: wait until it ends, or cancel it")
        work = Path(tempfile.mkdtemp(dir=self.folder))
        layer = work / "edits.usda"
        write_bytes(layer, wanted.edits.encode())
        name = wanted.stage.stem
        pattern = f"{name}.####.exr" if "--frames" in wanted.flags else f"{name}.exr"
        words = [sys.executable, "-m", "photonbeams", "render", str(wanted.stage), "--session-layer", str(layer)]
        words += [*wanted.flags, "-o", str(work / pattern), "--progress", "openjd"]
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
