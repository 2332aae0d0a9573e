"""Frames of the keyhole as artists render them: seconds and peak memory, warm, each in a process of its own."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from time import perf_counter
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

import photonbeams as pb

from .keyhole import STAGE


class Case(NamedTuple):
    """A frame: its camera, number, size and settings, and the most seconds and GiB that it should take."""

    camera: str | None
    frame: int | None
    size: tuple[int, int]
    settings: dict[str, Any]
    seconds: float | None = None
    memory: float | None = None


FLIGHT = {"passes": 16, "beams": 2048}
CASES = {
    "make keyhole": Case(None, None, (1280, 720), {"passes": 5, "denoise": True}, 10.0),
    "a pass": Case(None, None, (1280, 720), {"passes": 1}),
    "a pass of nine times the pixels": Case(None, None, (3840, 2160), {"passes": 1}, None, 3.0),
    **{f"flight, frame {frame}": Case("Flight", frame, (640, 360), FLIGHT, 2.0) for frame in (1, 26, 51, 76)},
    "inside the shaft, 0.6 % error": Case("Flight", 51, (640, 360), {"error": 0.006, "passes": 256}, 4.0),
}
LARGE = 6.0  # times a pass


def report(console: Console) -> None:
    """Print seconds and memory of each frame beside its goals."""
    table = Table(title="Frames of the keyhole, warm", caption="Phases are in seconds.")
    for name in ("frame", "seconds", "goal", "peak memory", "goal", "error", "phases"):
        table.add_column(name, justify="right" if name not in ("frame", "phases") else "left")
    known: dict[str, float] = {}
    for name, case in CASES.items():
        child = subprocess.run(
            [sys.executable, "-m", "benchmarks.frames", name], stdout=subprocess.PIPE, check=True, text=True
        )
        found = json.loads(child.stdout)
        known[name] = found["seconds"]
        most = LARGE * known["a pass"] if case.memory else case.seconds
        error = "" if found["error"] is None else f"{found['error']:.2%}"
        phases = ", ".join(f"{phase} {seconds:.1f}" for phase, seconds in found["phases"].items() if seconds >= 0.05)
        table.add_row(
            name, f"{found['seconds']:.1f}", f"≤ {most:.1f}" if most else "", f"{found['memory']:.2f} GiB",
            f"≤ {case.memory:g}" if case.memory else "", error, phases,
        )  # fmt: skip
    console.print(table)


def measure(case: Case) -> dict[str, Any]:
    """Return seconds, phases and error of a frame of a warm process, and this process' peak memory in GiB."""
    shot = pb.Shot.open(STAGE, **({} if case.camera is None else {"camera": case.camera}))
    size = dict(zip(("width", "height"), case.size, strict=True))
    shot.render(case.frame, **size, **(case.settings | {"passes": 2, "error": None}))  # compiles
    begin = perf_counter()
    statistics = shot.render(case.frame, **size, **case.settings).statistics
    seconds, unit = perf_counter() - begin, 1 if sys.platform == "darwin" else 1024
    return {
        "seconds": seconds, "phases": statistics.seconds, "error": statistics.error,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30,
    }  # fmt: skip


if __name__ == "__main__":
    print(json.dumps(measure(CASES[sys.argv[1]])))
