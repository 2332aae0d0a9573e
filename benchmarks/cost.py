"""Time and peak memory of a picture from a thousand to a million beams; time should grow with the ray–beam tests."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from time import perf_counter

import drjit as dr
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.points import Points

from .scenes import RAMP, Fan, Picture

COUNTS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
MEMORY_BEAMS, MEMORY_TARGET = 100_000, 2.0  # GiB
LONG_ENOUGH = 2.0  # seconds of pictures from which the fastest is taken


def report(console: Console) -> None:
    """Print seconds, seconds per million tests and peak memory; each count runs in a process of its own."""
    table = Table(title="Cost: auto, colour ramp × physical, 1280 × 720")
    for name in ("beams", "M tests", "seconds", "ms per M tests", "peak memory"):
        table.add_column(name, justify="right")
    for count in COUNTS:
        child = subprocess.run(
            [sys.executable, "-m", "benchmarks.cost", str(count)], stdout=subprocess.PIPE, check=True, text=True
        )
        cost = json.loads(child.stdout)
        table.add_row(
            f"{count:,}",
            f"{cost['tests'] / 1e6:,.0f}",
            f"{cost['seconds']:.3f}",
            f"{cost['seconds'] / cost['tests'] * 1e9:.2f}",
            f"{cost['memory']:.2f} GiB" + (f" (≤ {MEMORY_TARGET:g})" if count == MEMORY_BEAMS else ""),
        )
    console.print(table)


def measure(count: int) -> dict[str, float]:
    """Return tests and least seconds of a picture of `count` beams, and this process' peak memory in GiB."""
    picture, points, beams = Picture(), Points(pb.gauss_legendre(6)), Fan.of(count).beams()
    estimate = picture.of(beams, RAMP, "auto", points)  # compiles
    spent: list[float] = []
    while sum(spent) < LONG_ENOUGH:
        dr.sync_thread()
        begin = perf_counter()
        picture.of(beams, RAMP, "auto", points)
        dr.sync_thread()
        spent.append(perf_counter() - begin)
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30
    return {"tests": estimate.billboard_tests + estimate.frustum_tests, "seconds": min(spent), "memory": peak}


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]))))
