"""Farms: workers of one thread beside threads of one process, the cost of a task, and memory over passes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from photonbeams.farm.cluster import connected
from photonbeams.farm.run import Farm, FarmFrame
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.sums import PassSums
from photonbeams.runtime.device import processors

KEYHOLE = Path(__file__).parents[1] / "examples" / "keyhole" / "keyhole.usda"
#: Passes of each frame at 1280 × 720, with one frame for each worker: a minute on one of two processors.
PASSES = 32
TASKS = 400
SIZE_4K = 3840 * 2160


def report(console: Console) -> None:
    """Print all tables."""
    beside_threads(console)
    tasks(console)
    passes_and_memory(console)


def _command(*arguments: Any) -> float:
    """Return the seconds of a command."""
    begin = perf_counter()
    subprocess.run([sys.executable, "-m", "photonbeams", *map(str, arguments)], check=True, capture_output=True)
    return perf_counter() - begin


def beside_threads(console: Console) -> None:
    """Print the speed of N workers of one thread beside N threads of one process, without the time to start."""
    count = processors()
    table = Table(title=f"{count} frames of the keyhole, {PASSES} passes of 1280 × 720")
    for name in ("", "seconds", "without start", "frames beside threads", "goal"):
        table.add_column(name, justify="right" if name else "left")
    with tempfile.TemporaryDirectory() as folder:
        base = ("render", KEYHOLE, "-cam", "Flight", "-f", f"1:{count}", "-q", "-o", Path(folder) / "a.##.exr")
        found = {}
        for name, more in (("threads", ("--threads", count)), ("workers", ("--workers", count, "--threads", 1))):
            small = _command(*base, *more, "--res", 64, 0, "--passes", 1)
            whole = _command(*base, *more, "--passes", PASSES)
            found[name] = whole, whole - small
    ratio = found["threads"][1] / found["workers"][1]
    for name, (whole, net) in found.items():
        last = (f"{ratio:.2f}", "≥ 0.90") if name == "workers" else ("", "")
        table.add_row(name, f"{whole:.1f}", f"{net:.1f}", *last)
    console.print(table)


def open_nothing(request: int) -> Any:
    """Return a function that renders passes of black pixels in no time."""

    def render(frame: int, numbers: range, planned: int | None) -> dict[str, np.ndarray]:
        sums = PassSums()
        for number in numbers:
            sums.add(number, {"surface/": np.zeros((3, request), np.float32), "alpha": np.zeros(request, np.float32)})
        return FrameSums([sums], planned).state()

    return render


def tasks(console: Console) -> None:
    """Print the overhead of a task: for a single pixel, and for a 4K frame with all of its sums."""
    table = Table(title="A task that renders nothing, one worker")
    for name in ("", "tasks", "milliseconds each", "goal", "MB moved each", "MB a second"):
        table.add_column(name, justify="right" if name else "left")
    with connected(workers=1) as client:
        for name, count, pixels, goal in (("one pixel", TASKS, 1, "< 50"), ("4K", 8, 4 * SIZE_4K, "")):
            frames = [FarmFrame(str(k), k, 8, 8) for k in range(count)]
            begin = perf_counter()
            Farm(client, open_nothing, pixels, 0, frames, lambda _: None, lambda _: None, lambda _: None).run()
            each = (perf_counter() - begin) / count
            moved = 4 * 4 * pixels / 1e6
            table.add_row(name, f"{count}", f"{1e3 * each:.1f}", goal, f"{moved:,.1f}", f"{moved / each:,.0f}")
    console.print(table)


def passes_and_memory(console: Console) -> None:
    """Print the peak memory of renders of more and more passes, and of more and more beams."""
    table = Table(title="The keyhole at 320 × 180: peak memory")
    for name in ("passes", "beams a pass", "GiB", "seconds"):
        table.add_column(name, justify="right")
    for passes, beams in ((10, 4096), (100, 4096), (1000, 4096), (2, 65_536), (2, 1_000_000)):
        found = _child(passes, beams)
        table.add_row(f"{passes:,}", f"{beams:,}", f"{found['memory']:.2f}", f"{found['seconds']:.1f}")
    console.print(table)


def _child(passes: int, beams: int) -> dict[str, float]:
    source = f"""
import json, resource, time
import photonbeams as pb
shot = pb.Shot.open({str(KEYHOLE)!r}, overrides="/World/Light/Key.photonbeams:count={beams}")
begin = time.perf_counter()
shot.render(passes={passes}, width=320)
print(json.dumps(dict(seconds=time.perf_counter() - begin,
                      memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)))
"""
    done = subprocess.run([sys.executable, "-c", source], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)
