"""The studio through its WebSocket, as a page uses it: time from an edit to the first new picture, orbits, memory."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import uvicorn
from rich.console import Console
from rich.table import Table
from websockets.sync.client import ClientConnection, connect

from photonbeams.studio.navigation import orbited
from photonbeams.studio.server import Studio
from photonbeams.studio.session import Session, SessionView
from photonbeams.usd.stage import up_axis

EXAMPLES = Path(__file__).parents[1] / "examples"
WIDTH, HEIGHT = 480, 270
#: Stages, and the edits of each: an attribute, and its value by the number of the edit.
STAGES: dict[str, dict[str, tuple[str, Callable[[int], Any]]]] = {
    "keyhole": {
        "look": ("/World/Looks/Keyhole.photonbeams:along:end", lambda k: 3.0 + 0.02 * k),
        "light": ("/World/Light/Key.inputs:intensity", lambda k: 20000.0 + 500 * k),
    },
    "forest": {
        "look": ("/World/Looks/Shafts.photonbeams:along:end", lambda k: 40.0 + 0.5 * k),
        "light": ("/World/Light/Sun.inputs:intensity", lambda k: 60000.0 + 2000 * k),
    },
    "concert": {
        "look": ("/World/Looks/Sharp.photonbeams:across:hardness", lambda k: 0.3 + 0.02 * k),
        "light": ("/World/Rig/Key/Yoke/Head/Lamp.inputs:intensity", lambda k: 2000.0 + 100 * k),
    },
}
#: Seconds to the first picture: median and 95th percentile.
GOALS = {"look": (0.15, 0.3), "light": (0.3, 0.6), "camera": (0.3, 0.6)}
EDITS = 20
# Seconds between edits, in which the whole picture is rendered, as it is while a user looks.
REST = 0.3
# Distance of the point about which the camera turns, in scene units.
DISTANCE = 2.0
ORBIT_SECONDS, POSES_PER_SECOND, GOAL_PICTURES = 5.0, 30, 20
MANY, SETTLED, PER_SECOND = 10_000, 2_000, 200
MEBIBYTE = 1 << 20


class Page:
    """A page: it sends messages, and another thread records which versions of the picture arrive, and when."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self.came = socket, threading.Condition()
        self.first: dict[int, float] = {}
        self.pictures: list[float] = []
        self.finished = self.version = 0
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for message in self._socket:
            with self.came:
                if isinstance(message, bytes):
                    now = time.perf_counter()
                    header = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
                    self.first.setdefault(header["version"], now)
                    self.pictures.append(now)
                    if header["passes"] == header["planned"] and header["scale"] == 1:
                        self.finished = header["version"]
                else:
                    self.version = max(self.version, json.loads(message).get("version", 0))
                self.came.notify_all()

    def send(self, kind: str, **content: Any) -> None:
        """Send a message."""
        self._socket.send(json.dumps({"type": kind, **content}))

    def wait(self, there: Callable[[], bool]) -> None:
        """Wait until a condition holds."""
        with self.came:
            if not self.came.wait_for(there, 120):
                raise TimeoutError("the studio shows no picture")

    def seconds(self, kind: str, **content: Any) -> float:
        """Return the seconds from a change to its first picture."""
        wanted, begin = self.version + 1, time.perf_counter()
        self.send(kind, **content)
        self.wait(lambda: any(version >= wanted for version in self.first))
        return min(when for version, when in self.first.items() if version >= wanted) - begin


@contextmanager
def opened(name: str) -> Iterator[Page]:
    """Open a stage in a studio, with a page that has received the finished picture."""
    view = SessionView(width=WIDTH, height=HEIGHT, passes=4)
    with Session(EXAMPLES / name / f"{name}.usda", view=view) as session:
        studio = Studio(session)
        server = uvicorn.Server(uvicorn.Config(studio.app(), host="127.0.0.1", port=0, log_level="error"))
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        with connect(f"ws://127.0.0.1:{port}/session?token={studio.token}", max_size=None, proxy=None) as socket:
            page = Page(socket)
            page.wait(lambda: page.finished > 0)
            yield page
        server.should_exit = True
        thread.join()


def poses(name: str) -> Callable[[float], list[float]]:
    """Return transforms of the camera, turned by angles in degrees about the vertical through a point before it."""
    import photonbeams as pb

    shot = pb.Shot.open(EXAMPLES / name / f"{name}.usda")
    start, up = shot.cameras(None)[0].to_world, up_axis(shot.stage)

    def turned(degrees: float) -> list[float]:
        return [float(each) for each in orbited(start, up, DISTANCE, np.radians(degrees), 0.0).ravel()]

    return turned


def latencies(page: Page, name: str) -> dict[str, list[float]]:
    """Return the seconds to the first picture, by kind of edit."""
    turned, found = poses(name), {}
    changes = {
        kind: (lambda k, p=path, v=value: ("set", {"values": {p: v(k)}}))
        for kind, (path, value) in STAGES[name].items()
    }
    changes["camera"] = lambda k: ("show", {"pose": turned(0.5 * k)})
    for kind, change in changes.items():
        found[kind] = []
        for k in range(EDITS + 1):
            what, content = change(k)
            seconds = page.seconds(what, **content)
            if k:  # the first may compile
                found[kind].append(seconds)
            time.sleep(REST)
    return found


def orbit(page: Page, name: str) -> float:
    """Return the pictures per second while the camera moves."""
    turned, begin = poses(name), time.perf_counter()
    for k in range(round(ORBIT_SECONDS * POSES_PER_SECOND)):
        page.send("show", pose=turned(0.5 * k))
        time.sleep(max(0.0, begin + (k + 1) / POSES_PER_SECOND - time.perf_counter()))
    return sum(begin + 0.5 < each < begin + ORBIT_SECONDS for each in page.pictures) / (ORBIT_SECONDS - 0.5)


def growth(page: Page, name: str) -> tuple[float, float]:
    """Return the memory in MiB after SETTLED edits and after MANY."""
    (path, value), process, found = STAGES[name]["look"], psutil.Process(), []
    for k in range(MANY):
        page.send("set", values={path: value(k % 50)})
        time.sleep(1 / PER_SECOND)
        if k + 1 in (SETTLED, MANY):
            page.wait(lambda: page.finished >= page.version)
            found.append(process.memory_info().rss / MEBIBYTE)
    return found[0], found[1]


def report(console: Console) -> None:
    """Print the seconds to first pictures, pictures per second, and memory."""
    table = Table(title=f"Studio, {WIDTH} × {HEIGHT}: seconds from an edit to its first picture, {EDITS} edits each")
    for column in ("", "edit", "median", "95 %", "goal", "orbit, pictures a second"):
        table.add_column(column, justify="right" if column not in ("", "edit") else "left")
    for name in STAGES:
        with opened(name) as page:
            found = latencies(page, name)
            rate = orbit(page, name)
            for kind, seconds in found.items():
                goal = " / ".join(f"{each:g}" for each in GOALS[kind])
                middle, late = np.quantile(seconds, [0.5, 0.95])
                last = f"{rate:.1f} (goal {GOAL_PICTURES})" if kind == "camera" else ""
                table.add_row(name, kind, f"{middle:.2f}", f"{late:.2f}", goal, last)
    console.print(table)
    with opened("keyhole") as page:
        before, after = growth(page, "keyhole")
    console.print(f"Memory after {SETTLED:,} edits {before:.0f} MiB, after {MANY:,} {after:.0f} MiB (goal: flat)")
