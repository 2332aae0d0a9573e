"""The example frame at 1280 × 720: seconds by phase and number of kernels, from an empty kernel cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import drjit as dr
from rich.console import Console
from rich.table import Table

import photonbeams as pb

STAGE = Path(__file__).parents[1] / "examples" / "keyhole" / "keyhole.usda"
WIDTH, HEIGHT, PASSES, TARGET = 1280, 720, 64, 60.0  # seconds


def report(console: Console) -> None:
    """Print the first two frames of a process that has not compiled anything yet."""
    with tempfile.TemporaryDirectory() as home:  # Dr.Jit keeps its kernels in ~/.drjit
        child = subprocess.run(
            [sys.executable, "-m", "benchmarks.keyhole"],
            stdout=subprocess.PIPE, check=True, text=True, env={**os.environ, "HOME": home},
        )  # fmt: skip
    frames = json.loads(child.stdout)
    table = Table(title=f"Keyhole: {WIDTH} × {HEIGHT}, {PASSES} passes, two frames of one process")
    phases = list(frames[0]["phases"])
    for name in ("frame", "whole", *phases, "of it compiling", "kernels", "target"):
        table.add_column(name, justify="right")
    targets = (f"≤ {TARGET:g} s", "0 kernels")
    for number, (frame, target) in enumerate(zip(frames, targets, strict=True), 1):
        seconds = [frame["seconds"], *(frame["phases"][phase] for phase in phases), frame["compile_seconds"]]
        table.add_row(str(number), *(f"{value:.2f} s" for value in seconds), str(frame["kernels"]), target)
    console.print(table)


def measure() -> list[dict[str, Any]]:
    """Return the seconds and kernels of each of two frames."""
    shot, frames = pb.Shot.open(STAGE), []
    for _ in range(2):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            begin = perf_counter()
            statistics = shot.render(passes=PASSES, width=WIDTH, height=HEIGHT).statistics
            seconds = perf_counter() - begin
            compiled = [each for each in dr.kernel_history([dr.KernelType.JIT]) if not each["cache_hit"]]
        frames.append(
            {
                "seconds": seconds,
                "phases": statistics.seconds,
                "kernels": len(compiled),
                "compile_seconds": sum(each["backend_time"] for each in compiled) / 1e3,
            }
        )
    return frames


if __name__ == "__main__":
    print(json.dumps(measure()))
