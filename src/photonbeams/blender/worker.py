"""The renderer that Blender's extension starts: `python -m photonbeams.blender.worker`.

It reads messages from its input and writes others to its output (`extension/messages.py`), each a dict:

    {"do": "scene", "prims": […], "removed": […]}     change the stage; "whole": True begins a new one
    {"do": "render", "number": n, "camera": path, "settings": {…}, "width": w, "height": h,
     "crop": […], "pixel_aspect": a, "frame": time code}
    {"do": "cancel", "number": n}                     end the renders up to this one

    {"is": "ready", "version": text}                  once, at the beginning
    {"is": "progress", "number": n, "done": passes, "planned": passes, "error": relative error or None}
    {"is": "picture", "number": n, "layers": {…}}     the layers so far, (H, W, C) from the top row down
    {"is": "warning", "text": sentence}
    {"is": "end", "number": n, "problem": sentence}   no sentence: the render is finished, or was cancelled

The process ends when its input does, so none is left when Blender crashes.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import time
from _thread import interrupt_main
from collections.abc import Callable, Mapping
from math import inf
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, BinaryIO

from ..scene import SceneError
from ..scene.checks import shortened
from .extension import messages

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..render.passes import Statistics
    from ..shot.shot import Shot

# Least seconds between pictures of a render that is under way, and as many times what one takes, with its denoising.
_BETWEEN, _REST = 1.0, 8.0
_UP_AXIS, _METERS = "Z", 1.0  # Blender's


class Worker:
    """Renders the scene that messages describe.

    Parameters
    ----------
    source, sink
        Where messages come from, and where others go.
    """

    def __init__(self, source: BinaryIO, sink: BinaryIO) -> None:
        self._source, self._sink = source, sink
        self._waiting: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        self._rendering: int | None = None  # the number of the render that is under way
        self._cancelled, self._telling = -inf, False
        self._stage: Any = None
        # What is wrong with the machine, and with the scene.
        self._unable: str | None = None
        self._problem: str | None = None

    def run(self) -> None:
        """Answer messages until there are no more."""
        from .. import __version__

        signal.signal(signal.SIGINT, self._leave)  # a parent that ignores it would hand this down
        logging.getLogger("photonbeams").addHandler(_WarningHandler(self))
        threading.Thread(target=self._receive, daemon=True).start()
        self.tell("ready", version=__version__)
        try:
            from ..render import stage_frame  # noqa: F401 - the libraries load while Blender reads the scene
        except (ImportError, RuntimeError) as error:  # the device's errors are RuntimeErrors
            self._unable = shortened(str(error))
        while (message := self._waiting.get()) is not None:
            if message["do"] == "scene":
                self._change(message)
            elif message["do"] == "render":
                self._render(message)

    def tell(self, kind: str, **content: Any) -> None:
        """Send a message."""
        self._telling = True
        try:
            messages.write(self._sink, {"is": kind, **content})
        finally:
            self._telling = False
        self._leave()

    def _receive(self) -> None:
        """Put messages into the queue; end what is rendered if it is no longer wanted."""
        try:
            while (message := messages.read(self._source)) is not None:
                if message["do"] == "cancel":
                    self._cancel(message["number"])
                else:
                    self._waiting.put(message)
        finally:
            self._waiting.put(None)
            self._cancel(inf)

    def _cancel(self, number: float) -> None:
        self._cancelled = number
        interrupt_main()  # between two kernels, as Ctrl-C does

    def _leave(self, *_: object) -> None:
        """Raise KeyboardInterrupt if what is rendered is no longer wanted; never amid a message."""
        if self._rendering is not None and self._rendering <= self._cancelled and not self._telling:
            self._rendering = None
            raise KeyboardInterrupt

    def _change(self, message: Mapping[str, Any]) -> None:
        from ..usd.authoring.prims import new_stage, remove_prims, write_prims

        if self._stage is None or message.get("whole"):
            self._stage, self._problem = new_stage(_UP_AXIS, _METERS), None
        try:
            remove_prims(self._stage, message.get("removed", ()))
            write_prims(self._stage, message["prims"])
        except SceneError as error:
            self._problem = str(error)

    def _render(self, wanted: Mapping[str, Any]) -> None:
        from ..shot.shot import Shot

        number, problem = wanted["number"], self._unable or self._problem
        if problem is not None:
            self.tell("end", number=number, problem=problem)
            return
        try:
            shot = Shot(self._stage, wanted["camera"])
            self._rendering = number
            self._leave()
            frame = self._frame(shot, number, wanted)
            self._rendering = None
            self.tell("picture", number=number, layers=frame.layers)
        except KeyboardInterrupt:
            pass
        except (SceneError, OSError, MemoryError, RuntimeError) as error:  # Dr.Jit's and the device's are RuntimeErrors
            problem = shortened(str(error) or type(error).__name__)
        self._rendering = None
        self.tell("end", number=number, problem=problem)

    def _frame(self, shot: Shot, number: int, wanted: Mapping[str, Any]) -> Frame:
        """Return the finished frame, and send pictures of it until then."""
        due, begun = time.monotonic() + _BETWEEN, wanted["settings"].get("passes")

        def progress(done: int, statistics: Statistics) -> None:
            self.tell("progress", number=number, done=done, planned=begun, error=statistics.error)

        def snapshot(frame: Callable[[], Frame]) -> None:
            nonlocal due
            if (begin := time.monotonic()) > due:
                self.tell("picture", number=number, layers=frame().layers)
                due = time.monotonic() + max(_BETWEEN, _REST * (time.monotonic() - begin))

        size = {name: wanted[name] for name in ("width", "height", "crop", "pixel_aspect", "frame") if name in wanted}
        return shot.render(progress=progress, snapshot=snapshot, **size, **wanted["settings"])


class _WarningHandler(logging.Handler):
    """Sends what photonbeams warns of."""

    def __init__(self, worker: Worker) -> None:
        super().__init__(logging.WARNING)
        self._worker = worker

    def emit(self, record: logging.LogRecord) -> None:
        """Send a warning."""
        self._worker.tell("warning", text=record.getMessage())


def main() -> None:
    """Answer messages of the standard input by the standard output."""
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print does not get between the messages
    sys.stdin.close()
    Worker(source, sink).run()


if __name__ == "__main__":
    main()
