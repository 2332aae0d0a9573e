"""The client of a farm: give parts of frames to workers, join their results, and cope with workers that fail."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ..render.films.frame_sums import FrameSums
from ..scene import SceneError
from .cluster import MEMORY, FarmError
from .dispatch import Dispatcher, FramePart, LostError, most_passes, parts_of
from .work import MachineError, Opened, WorkerError, render_part, versions

if TYPE_CHECKING:
    from distributed import Client, Future

    from ..scene.checks import Array

LOG = logging.getLogger("photonbeams")

_LOOK = 1.0  # seconds between two looks at the list of workers
_GONE = 10.0  # seconds without a scheduler until it counts as gone
_NOBODY = 60.0  # seconds without a worker until the farm gives up
_BLAMED = 5.0  # seconds with only unfit workers until the farm gives up


@dataclass
class FarmFrame:
    """A frame to render: how many passes it gets, and the sums of those that are done already."""

    name: str
    place: int  # in the worker's list of frames
    passes: int
    planned: int | None  # see `FrameSums`
    left: Sequence[range] | None = None  # the passes that are still to be rendered, None for all of them
    # A checkpoint with the other passes, read when the frame begins: those of all frames may not fit into memory.
    file: Path | None = None
    sums: FrameSums | None = None  # so far, None before the frame begins

    def begin(self) -> None:
        """Load the passes of the checkpoint, if there is one."""
        if self.sums is None and self.file is not None:
            self.sums = FrameSums.load(self.file)

    def join(self, sums: FrameSums, sender: str) -> None:
        """Add the passes of a part; raise SceneError, naming the file or the sender, if they are of another picture."""
        self.begin()
        if self.sums is None:
            self.sums = sums
            return
        try:
            self.sums.join(sums)
        except SceneError as error:
            if self.file is None:
                raise SceneError(f"{sender}: {error}: expected the same files everywhere") from None
            raise SceneError(f"{self.file}: {error}, or no --resume") from None
        self.sums.development, self.file = sums.development, None


@dataclass
class FarmState:
    """The progress of a farm: passes and frames, done and in total, and the number of workers."""

    passes: int
    all_passes: int
    frames: int
    all_frames: int
    workers: int = 0


@dataclass
class Farm:
    """A farm that renders frames."""

    client: Client
    open_scene: Callable[[Any], Opened]  # at the top level of a module; a worker calls it with the request
    request: Any
    memory: int  # bytes that a part needs, roughly
    frames: Sequence[FarmFrame]
    joined: Callable[[int], None]  # called with the place of a frame whenever passes of it have arrived
    finished: Callable[[int], None]  # the same when all have arrived; its sums are released afterwards
    tick: Callable[[FarmState], None]  # called several times a second; an exception that it raises ends the work
    _key: str = field(default_factory=lambda: uuid4().hex)  # of the open scene, which stays open on the worker
    _ready: queue.SimpleQueue[Future] = field(default_factory=queue.SimpleQueue)
    _fetched: queue.SimpleQueue[tuple[str, FramePart, Any]] = field(default_factory=queue.SimpleQueue)
    _running: dict[Any, tuple[str, FramePart, Any]] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _bad: dict[str, WorkerError] = field(default_factory=dict)
    _bounded: set[str] = field(default_factory=set)
    _failed: dict[int, tuple[str, str]] = field(default_factory=dict)
    _looked: float = -1e9
    _connected: float = field(default_factory=time.monotonic)
    _seen: float = field(default_factory=time.monotonic)

    def run(self) -> None:
        """Render all frames; SceneError for one that nothing can render, FarmError if scheduler or workers are gone."""
        frames = self.frames
        workers = max(1, len(self._workers()))
        missing = [[range(each.passes)] if each.left is None else each.left for each in frames]
        parts = [parts_of(each, len(frames), workers, most_passes(workers)) for each in missing]
        self._dispatcher = Dispatcher(parts)
        passes, left = sum(each.passes for each in frames), sum(len(numbers) for each in parts for numbers in each)
        self._state = FarmState(passes - left, passes, 0, len(frames))
        for place, each in enumerate(parts):
            if not each:
                self._finish(place)
        self._fetching = ThreadPoolExecutor(2, "photonbeams-fetch")
        try:
            while not self._dispatcher.done:
                self._look()
                self._submit()
                self.tick(self._state)
                self._take()
        finally:
            self._stop()
            self._fetching.shutdown(wait=False)  # pending transfers end with the client

    def _workers(self) -> dict[str, str]:
        """Return the names of the workers by their addresses."""
        known = self.client.scheduler_info(n_workers=-1)["workers"]
        limits = {address: each.get("resources", {}).get(MEMORY) for address, each in known.items()}
        self._bounded = {address for address, limit in limits.items() if limit is not None}
        for address in self._bounded - self._bad.keys():
            if limits[address] < self.memory:
                need, there = (f"{each / 2**30:.1f} GiB" for each in (self.memory, limits[address]))
                name = known[address].get("name", address)
                text = f"worker {name} has {there} of memory, but a part needs {need}: use fewer workers, or --tile"
                self._bad[address] = WorkerError(text)
        return {address: str(each.get("name", address)) for address, each in known.items()}

    def _look(self) -> None:
        """Update the list of workers."""
        now = time.monotonic()
        if now - self._looked < _LOOK:
            return
        self._looked = now
        if self.client.status != "running":
            if now - self._connected > _GONE or self.client.status in ("closed", "closing"):
                raise FarmError("the scheduler is gone: start it again, and continue with --resume --skip-existing")
            return
        try:
            found = self._workers()
        except (OSError, TimeoutError):  # the client's status reports a lost connection
            return
        self._connected = now
        self._names.update(found)
        for address in [each for each in self._dispatcher.workers if each not in found]:
            self._lose(address)
        for address in found.keys() - self._bad.keys():
            self._dispatcher.add_worker(address)
        self._state.workers = len(self._dispatcher.workers)
        if self._dispatcher.workers:
            self._seen = now
        elif self._bad and now - self._seen > _BLAMED:
            error = next(iter(self._bad.values()))
            raise (FarmError if isinstance(error, MachineError) else SceneError)(str(error))
        elif now - self._seen > _NOBODY:
            raise FarmError(f"there has been no worker for {_NOBODY:.0f} seconds: expected at least one")

    def _lose(self, address: str) -> None:
        """Give the parts of a lost worker to others; raise FarmError if several were lost at the same part."""
        LOG.warning("worker %s is lost; others render its passes again", self._names.get(address, address))
        self._forget(address)
        try:
            self._dispatcher.lose_worker(address)
        except LostError as error:
            raise FarmError(
                f"{self._what(error.part)}: {error.lost} workers were lost at this part; expected more memory for each"
            ) from None

    def _forget(self, address: str) -> None:
        """Take back the parts that a worker was given."""
        for key, (worker, _, future) in [*self._running.items()]:
            if worker == address:
                del self._running[key]
                future.cancel(force=True)

    def _what(self, part: FramePart) -> str:
        numbers = part.numbers
        return f"frame {self.frames[part.frame].name}, passes {numbers.start} to {numbers.stop - 1}"

    def _submit(self) -> None:
        """Give free workers their next parts."""
        if self.client.status != "running":
            return
        while (given := self._dispatcher.next(time.monotonic())) is not None:
            address, part = given
            frame = self.frames[part.frame]
            future = self.client.submit(
                render_part, self.open_scene, self.request, self._key, versions(), frame.place, part.numbers,
                frame.planned, pure=False, workers=[address], allow_other_workers=False, retries=0,
                resources={MEMORY: self.memory} if address in self._bounded else None,
            )  # fmt: skip
            self._running[future.key] = address, part, future
            future.add_done_callback(self._ready.put)

    def _take(self) -> None:
        """Take results that have arrived, or wait for a moment."""
        while not self._fetched.empty():
            address, part, state = self._fetched.get()
            if state is None:  # its worker was lost before it could be fetched
                self._dispatcher.give_back(address, part)
            elif self._dispatcher.finish(address, part, time.monotonic()):
                self._join(address, part, state)
        try:
            future = self._ready.get(timeout=0.05)
        except queue.Empty:
            return
        if future.key not in self._running:
            return  # the worker was lost
        address, part, _ = self._running[future.key]
        if future.status != "finished":
            del self._running[future.key]
            self._refuse(address, part, future.exception() if future.status == "error" else None)
            return
        self._fetching.submit(self._fetch, future, address, part)

    def _fetch(self, future: Future, address: str, part: FramePart) -> None:
        """Fetch a result. This runs in a thread, because the network may be slow and the worker may die meanwhile."""
        try:
            state = future.result()
        except Exception as error:  # whatever its kind, there is no result
            LOG.debug("%s: %r", self._what(part), error)
            state = None
        self._running.pop(future.key, None)
        future.release()
        self._fetched.put((address, part, state))

    def _join(self, address: str, part: FramePart, state: Mapping[str, Array]) -> None:
        sender = f"worker {self._names.get(address, address)}: {self._what(part)}"
        try:
            sums = FrameSums.of(state)
        except (KeyError, ValueError) as error:
            raise SceneError(f"{sender}: the result is not a sum of passes: {error}") from None
        self.frames[part.frame].join(sums, sender)
        self._state.passes += len(part.numbers)
        if self._dispatcher.frame_done(part.frame):
            self._finish(part.frame)
        else:
            self.joined(part.frame)

    def _finish(self, place: int) -> None:
        frame = self.frames[place]
        frame.begin()
        self.finished(place)
        frame.sums = frame.file = None
        self._state.frames += 1

    def _refuse(self, address: str, part: FramePart, error: BaseException | None) -> None:
        """Exclude a worker that failed at a part, or raise SceneError if another worker failed in the same way."""
        if error is None or type(error).__name__ in ("KilledWorker", "CancelledError", "FutureCancelledError"):
            self._dispatcher.give_back(address, part)  # the next look tells whether the worker is lost
            return
        if isinstance(error, ImportError):
            error = MachineError(f"lacks what it needs: {error}")
        if not isinstance(error, WorkerError):
            raise error
        text, name = str(error), self._names.get(address, address)
        before = self._failed.get(part.frame)
        if before is not None and before[0] != address and before[1] == text and not isinstance(error, MachineError):
            raise SceneError(f"frame {self.frames[part.frame].name}: {text}")
        self._failed[part.frame] = address, text
        self._bad[address] = type(error)(f"worker {name}: {text}")
        if len(self._dispatcher.workers) > 1:
            LOG.warning("worker %s: %s; others do its work", name, text)
        self._forget(address)
        self._dispatcher.give_back(address, part)
        self._dispatcher.exclude(address)

    def _stop(self) -> None:
        """Cancel all parts that have not been rendered."""
        for _, _, future in [*self._running.values()]:  # a copy, because threads that fetch results remove entries
            future.cancel(force=True)
        self._running.clear()
