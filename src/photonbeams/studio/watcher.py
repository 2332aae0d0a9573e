"""A page that watches the studio: what it shows, and what waits to be sent to it."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass, field

from starlette.websockets import WebSocket

from ..images.display import OWN
from ..usd.cameras.stereo import EYES
from . import protocol
from .session import Picture


@dataclass(eq=False)
class Watcher:
    """A page that watches: what it shows, and the picture and the texts that wait to be sent to it.

    `other` is a layer that is sent as well, to be compared with the first; `estimate` is at work on an answer.
    """

    socket: WebSocket
    layer: str = "rgba"
    other: str | None = None
    eye: str = EYES[0]
    exposure: float = 0.0
    display: str = OWN
    shown: Picture | None = None
    texts: deque[str] = field(default_factory=lambda: deque(maxlen=256))
    news: asyncio.Event = field(default_factory=asyncio.Event)
    times: deque[float] = field(default_factory=lambda: deque(maxlen=protocol.PER_SECOND))
    estimate: asyncio.Future[None] | None = None

    def tell(self, message: protocol.Answers) -> None:
        """Send a message after those that wait."""
        self.texts.append(protocol.encoded(message))
        self.news.set()

    def show(self, picture: Picture | None) -> None:
        """Show a picture, instead of one that still waits to be sent."""
        self.shown = picture
        self.news.set()

    def end_estimate(self) -> None:
        """End the estimate that is under way, if there is one."""
        if self.estimate is not None:
            self.estimate.cancel()

    def is_too_fast(self) -> bool:
        """Count a message; return whether there are too many in a second."""
        now = time.monotonic()
        too_fast = len(self.times) == self.times.maxlen and now - self.times[0] < 1.0
        self.times.append(now)
        return too_fast
