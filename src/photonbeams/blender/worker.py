"""The renderer that Blender's extension starts: `python -m photonbeams.blender.worker`.

It reads messages from its input and writes others to its output (`extension/messages.py`), each a dict:

    {"do": "scene", "prims": […], "removed": […]}     change the stage; "whole": True begins a new one
    {"do": "render", "number": n, "camera": path, "settings": {…}, "width": w, "height": h,
     "crop": […], "pixel_aspect": a, "frame": time code}
    {"do": "cancel", "number": n}                     end the renders up to this one
    {"do": "view", "number": n, "camera": path, "view": {…}}
                                                      show a viewport, by fields of `SessionView`, until a message comes

    {"is": "ready", "version": text}                  once, at the beginning
    {"is": "progress", "number": n, "done": passes, "planned": passes, "error": relative error or None}
    {"is": "picture", "number": n, "layers": {…}}     the layers so far, (H, W, C) from the top row down; of a view
                                                      rgba alone, with "done", "planned" and "scale" as a `Picture` has
    {"is": "warning", "text": sentence}
    {"is": "end", "number": n, "problem": sentence}   no sentence: the render is finished, or was cancelled

The process ends when its input does, so none is left when Blender crashes.
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import threading
import time
from _thread import interrupt_main
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from math import inf
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, BinaryIO

from ..scene import SceneError
from ..scene.checks import shortened
from .extension import messages
from .words import Words

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..render.passes import Statistics
    from ..shot.shot import Shot
    from ..studio.viewing import LivePictures

# Least seconds between pictures of a render that is under way, and as many times what one takes, with its denoising.
_BETWEEN, _REST = 1.0, 8.0
# Seconds that a view waits after its first picture: while a camera moves, or a value is dragged, another one comes.
_MOVING = 0.25
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
        self._viewing = False  # whether a view is under way, beyond its first picture
        self._cancelled, self._telling = -inf, False
        self._stage: Any = None
        self._live: LivePictures | None = None  # of the views of this stage
        self.words = Words()  # in which problems and warnings are told
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
        gc.freeze()  # what the libraries have made stays, and is not looked through again
        while (message := self._waiting.get()) is not None:
            if message["do"] == "scene":
                self._change(message)
            elif message["do"] == "render":
                self._answer(message, self._render)
            elif message["do"] == "view":
                self._answer(message, self._view)

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
                    if self._viewing:
                        interrupt_main()
        finally:
            self._waiting.put(None)
            self._cancel(inf)

    def _cancel(self, number: float) -> None:
        self._cancelled = number
        interrupt_main()  # between two kernels, as Ctrl-C does

    def _leave(self, *_: object) -> None:
        """Raise KeyboardInterrupt if what is rendered is no longer wanted; never amid a message."""
        cancelled = self._rendering is not None and self._rendering <= self._cancelled
        if (cancelled or (self._viewing and not self._waiting.empty())) and not self._telling:
            self._rendering, self._viewing = None, False
            raise KeyboardInterrupt

    def _change(self, message: Mapping[str, Any]) -> None:
        from ..usd.authoring.prims import new_stage, remove_prims, write_prims

        if self._stage is None or message.get("whole"):
            self._stage, self._live, self._problem = new_stage(_UP_AXIS, _METERS), None, None
        self.words.learn(message["prims"])
        gc.collect()  # kernels have code for the surfaces and media of every scene in memory
        try:
            remove_prims(self._stage, message.get("removed", ()))
            write_prims(self._stage, message["prims"])
        except SceneError as error:
            self._problem = str(error)

    def _answer(self, wanted: Mapping[str, Any], render: Callable[[Mapping[str, Any]], None]) -> None:
        """Render what is wanted, and say that it has ended, and of which problem."""
        problem = self._unable or self._problem
        if problem is None:
            try:
                render(wanted)
            except KeyboardInterrupt:
                pass
            except (SceneError, OSError, MemoryError, RuntimeError) as error:  # Dr.Jit's and the device's, too
                problem = shortened(str(error) or type(error).__name__)
        self._rendering, self._viewing = None, False
        self.tell("end", number=wanted["number"], problem=problem and self.words.of(problem))

    def _render(self, wanted: Mapping[str, Any]) -> None:
        from ..shot.shot import Shot

        number = wanted["number"]
        shot = Shot(self._stage, wanted["camera"])
        self._rendering = number
        self._leave()
        frame = self._frame(shot, number, wanted)
        self._rendering = None
        self.tell("picture", number=number, layers=frame.layers)

    def _view(self, wanted: Mapping[str, Any]) -> None:
        from ..images.frame import within
        from ..shot.shot import Shot
        from ..shot.subject import Viewpoint
        from ..studio.live import Cancelled
        from ..studio.pictures import SessionView
        from ..studio.viewing import LivePictures

        if self._live is None:
            seen_by = Viewpoint(wanted["camera"], None)
            shot = Shot(self._stage, wanted["camera"])
            self._live = LivePictures(shot, lambda _: seen_by, tuple, nullcontext(), raw_at_last=False)
        number, view = wanted["number"], SessionView(**wanted["view"])
        with suppress(Cancelled):
            for picture in self._live.pictures(view, number, self._is_another_wanted, self._is_left):
                told = {"done": picture.passes, "planned": picture.planned, "scale": picture.scale}
                rgba = picture.layers["rgba"]
                shown = rgba if view.area is None else within(rgba, view.area)
                self.tell("picture", number=number, layers={"rgba": shown}, **told)
                if picture.is_first and self._is_another_wanted(_MOVING):
                    return
                self._viewing = True

    def _is_another_wanted(self, within: float = 0.0) -> bool:
        """Return whether a message waits, or comes within some seconds."""
        until = time.monotonic() + within
        while self._waiting.empty() and time.monotonic() < until:
            time.sleep(0.005)
        return not self._waiting.empty()

    def _is_left(self) -> bool:
        return self._cancelled == inf

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
        self._worker.tell("warning", text=self._worker.words.of(record.getMessage()))


def main() -> None:
    """Answer messages of the standard input by the standard output."""
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print does not get between the messages
    sys.stdin.close()
    Worker(source, sink).run()


if __name__ == "__main__":
    main()
