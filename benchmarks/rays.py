"""Ray–beam tests per second of the grid for rays off a mirror ball, beside the yardstick's, and what it is to build."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.arrays import to_float, to_vectors
from photonbeams.device import UInt32
from photonbeams.estimators.cells import batches
from photonbeams.estimators.estimate import ENDLESS, bind, estimate_rays
from photonbeams.estimators.geometry import Rays
from photonbeams.estimators.grid import build, walk
from photonbeams.estimators.points import Points

from .scenes import HEIGHT, MEDIUM, RAMP, WIDTH, Fan
from .yardstick import Yardstick

YARDSTICK_BEAMS, COUNTS, ROUNDS, TARGET = 10_000, (10_000, 100_000, 1_000_000), 3, 40
_CENTRE, _RADIUS = np.array([0.0, 0.2, -4.2]), 0.8


def report(console: Console) -> None:
    """Print the rates."""
    table = Table(title=f"Grid: {WIDTH * HEIGHT:,} rays off a mirror ball, least of {ROUNDS} runs")
    for name in ("", "beams", "cells", "build", "kernel", "M tests", "M tests/s", "target"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    yardstick = Yardstick(Fan.of(YARDSTICK_BEAMS))
    build_time, _ = _timed(yardstick.bin)
    _, kernel = _timed(yardstick.gather)
    table.add_row("yardstick", f"{YARDSTICK_BEAMS:,}", "", f"{build_time:.3f} s", *_rate(yardstick.tests, kernel), "")
    for count in COUNTS:
        beams = Fan.of(count).beams()
        for name, rays in (("in rows", mirrored()), ("in no order", mirrored(shuffled=True))):
            for about, look, estimator in (
                ("billboard, physical", pb.Look(), "billboard"),
                ("auto, ramp", RAMP, "auto"),
            ):
                row = _measured(beams, rays, look, estimator)
                table.add_row(f"{about}, {name}", f"{count:,}", *row, f"≥ {TARGET}")
    console.print(table)


def mirrored(shuffled: bool = False) -> Rays:
    """Return the rays of a picture's pixels, off a mirror ball behind the beams."""
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1, (np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1)
    x, y = 0.98 * x.ravel() / np.sqrt(2), 0.98 * y.ravel() / np.sqrt(2)
    if shuffled:
        order = np.random.default_rng(0).permutation(len(x))
        x, y = x[order], y[order]
    normal = np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=1)
    origin = _CENTRE + _RADIUS * normal
    incoming = origin / np.linalg.norm(origin, axis=1, keepdims=True)
    direction = incoming - 2 * np.sum(incoming * normal, axis=1, keepdims=True) * normal
    count = len(x)
    return Rays(to_vectors(origin), to_vectors(direction), to_float(np.full(count, ENDLESS)), to_float(np.zeros(count)))


def _measured(beams: pb.Beams, rays: Rays, look: pb.Look, estimator: str) -> list[str]:
    points = Points(pb.gauss_legendre(6))
    bind(look, beams, None, MEDIUM)

    def whole() -> None:
        dr.eval(estimate_rays(beams, rays, look=look, medium=MEDIUM, estimator=estimator, points=points))

    def lists() -> Any:
        built = build(beams, None, rays)
        assert built is not None
        grid, marks, span = built
        return grid, span, list(batches(grid.cells, marks.visit, len(beams)))

    build_time, _ = _timed(lists)
    _, kernel = _timed(whole)
    grid, span, parts = lists()
    tests = 0
    for part in parts:
        tests += int(np.asarray(walk(rays, span, grid, part, _count, UInt32(0)), dtype=np.int64).sum())
    cells = " × ".join(str(int(count[0])) for count in grid.counts)
    return [cells, f"{build_time:.3f} s", *_rate(tests, kernel)]


def _count(total: Any, *_: Any) -> Any:
    return total + 1


def _timed(run: Callable[[], Any]) -> tuple[float, float]:
    """Return the least seconds of a run, and of its longest kernel."""
    whole = kernel = float("inf")
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(ROUNDS + 1):  # the first compiles
            dr.sync_thread()
            dr.kernel_history_clear()
            begin = perf_counter()
            run()
            dr.sync_thread()
            whole = min(whole, perf_counter() - begin)
            seconds = [entry["execution_time"] / 1e3 for entry in dr.kernel_history() if entry["type"].name == "JIT"]
            kernel = min(kernel, max(seconds, default=float("inf")))
    return whole, kernel


def _rate(tests: int, seconds: float) -> list[str]:
    return [f"{seconds:.3f} s", f"{tests / 1e6:,.0f}", f"{tests / seconds / 1e6:.0f}"]
