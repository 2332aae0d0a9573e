"""Final renders, and what they cost: commands with the edits of a session, each in a process of its own."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import sys
import tempfile
import zipfile
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import NamedTuple

from ..runtime.files import PathLike, atomic_file, temporary_folder, write_bytes
from ..scene import SceneError
from .pictures import SessionView

_PROGRESS = re.compile(rb"openjd_progress: ([\d.]+)")

# The priority of a final render, of all its threads: edits in the studio go first.
_NICE = 15

#: Called during a final render: per cent done, the file once it exists, and a sentence if the render failed.
Told = Callable[[int, Path | None, str | None], Awaitable[None]]


class Wanted(NamedTuple):
    """What a final render needs: the stage's file, a .usda layer of edits as text, and the command's other flags.

    `frames` are the first and the last frame; None: the stage has none. `file` is where its pictures are written; None:
    in a folder of the studio, from which they are handed out.
    """

    stage: Path
    edits: str
    flags: Sequence[str]
    frames: tuple[float, float] | None = None
    file: Path | None = None

    async def started(self, command: Sequence[str], folder: Path, *more: str) -> asyncio.subprocess.Process:
        """Start a command on the stage, with the edits, in a file of `folder`, the flags, and `more` of them."""
        layer = folder / "edits.usda"
        write_bytes(layer, self.edits.encode())
        frames = () if self.frames is None else ("--frames", "{:.10g}:{:.10g}".format(*self.frames))
        words = [*command, str(self.stage), "--session-layer", str(layer), *self.flags, *frames, *more]
        # A process group of its own: Ctrl-C in a terminal ends only the studio, which then ends the render properly. It
        # is of the same session, though: Linux compares the priorities of processes only within a session.
        return await asyncio.create_subprocess_exec(
            sys.executable, "-m", "photonbeams", *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
            process_group=0,
        )  # fmt: skip


def _error(messages: str) -> str | None:
    """Return the first error among a command's messages."""
    errors = [each.removeprefix("Error: ") for each in messages.splitlines() if each.startswith("Error: ")]
    return errors[0][:300] if errors else None


def flags_of(view: SessionView) -> Iterator[str]:
    """Yield the command's flags that render a view."""
    if view.camera:
        yield from ("--camera", view.camera)
    yield from ("--res", str(view.width), str(view.height), "--passes", str(view.passes))
    if view.bounces is not None:
        yield from ("--bounces", str(view.bounces))
    if view.denoise:
        yield "--denoise"
    if view.stereo is not None:
        yield "--stereo"
        eyes = {"--interaxial": view.stereo.interaxial, "--convergence": view.stereo.convergence}
        for name, value in eyes.items():
            if value is not None:
                yield from (name, repr(float(value)))


def file_beside(stage: Path, file: PathLike, numbered: bool) -> Path:
    """Return the path of a picture's file in the stage's folder, or SceneError if it is elsewhere.

    The name of a `numbered` one has a place for the frame number; it gets one if it has none.
    """
    folder = stage.resolve().parent
    target = (folder / file).resolve()
    if not target.is_relative_to(folder) or target.suffix.lower() not in (".exr", ".png"):
        raise SceneError(f"the file is {str(file)!r:.80}: expected an .exr or .png file in the stage's folder")
    target.parent.mkdir(parents=True, exist_ok=True)
    return target.with_suffix(f".####{target.suffix}") if numbered and "#" not in target.name else target


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
        name = wanted.stage.stem
        output = wanted.file or work / (f"{name}.exr" if wanted.frames is None else f"{name}.####.exr")
        process = self._process = await wanted.started(["render"], work, "-o", str(output), "--progress", "openjd")
        with suppress(AttributeError, OSError):  # Windows has no such priorities; the render may have ended already
            os.setpriority(os.PRIO_PROCESS, process.pid, _NICE)
        try:
            messages = asyncio.ensure_future(process.stderr.read())  # type: ignore[union-attr]
            async for line in process.stdout:  # type: ignore[union-attr]
                if found := _PROGRESS.search(line):
                    await told(min(int(float(found[1])), 99), None, None)
            code, text = await process.wait(), (await messages).decode(errors="replace")
            if code == 0:
                await told(100, wanted.file or self._packed(work, name), None)
            else:
                ended = "the render was cancelled" if code in (-signal.SIGTERM, 128 + signal.SIGTERM) else None
                await told(0, None, ended or _error(text) or f"the render ended with code {code}")
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


class Cost(NamedTuple):
    """About how long a final render takes, all its frames, in seconds; and how much memory, in bytes."""

    seconds: float
    memory: float


class Estimates:
    """Estimates final renders, one after another, by `photonbeams render --estimate`; the last one is remembered.

    Pictures are `resting` meanwhile: the command is quick, and measures what the render takes when it has the machine.
    """

    def __init__(self, folder: Path, resting: Callable[[], AbstractContextManager[None]]) -> None:
        self._folder, self._resting = folder, resting
        self._turn = asyncio.Lock()
        self._known: tuple[Wanted, Cost] | None = None  # of a render of one frame

    async def of(self, wanted: Wanted) -> Cost:
        """Return what a final render costs; SceneError for what it would refuse. Cancelling this ends its process."""
        first, last = wanted.frames or (0, 0)
        one = wanted._replace(frames=None if wanted.frames is None else (first, first), file=None)
        async with self._turn:
            if self._known is None or self._known[0] != one:
                self._known = one, await self._measured(one)
            frame = self._known[1]
        return frame._replace(seconds=frame.seconds * (int(last - first) + 1))

    async def _measured(self, wanted: Wanted) -> Cost:
        with self._resting(), tempfile.TemporaryDirectory(dir=self._folder) as folder:
            process = await wanted.started(["render", "--estimate", "--json"], Path(folder))
            try:
                output, messages = await process.communicate()
            finally:
                if process.returncode is None:
                    process.kill()  # at once: it writes nothing
                    await process.wait()
        if process.returncode:
            text = _error(messages.decode(errors="replace"))
            raise SceneError(text or f"the estimate ended with code {process.returncode}")
        found = json.loads(output.splitlines()[-1])  # after what libraries may print
        return Cost(found["seconds"], found["memory"])
