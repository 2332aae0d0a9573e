"""Ray–beam tests per second of the grid, for rays off a mirror ball, beside the yardstick's; time to build it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.cells import Sorting, batches
from photonbeams.estimators.estimate import ENDLESS, bind
from photonbeams.estimators.geometry import Rays
from photonbeams.estimators.grid import build, sum_over_grid, traverse_grid
from photonbeams.estimators.points import Points
from photonbeams.estimators.records import pack
from photonbeams.numerics.arrays import to_float, to_vectors
from photonbeams.runtime.device import Array3f, UInt32

from .scenes import HEIGHT, MEDIUM, RAMP, WIDTH, Fan
from .yardstick import Yardstick

YARDSTICK_BEAMS, ROUNDS, TARGET = 10_000, 1, 40
#: Number of beams; pixels per ray, fewer rays with more beams, since tests grow with both; and the order of the rays.
CASES = ((10_000, 1, "in rows"), (10_000, 1, "in no order"), (100_000, 20, "in rows"))
BUILT = (1_000_000, 400)  # for building the lists alone
_CENTRE, _RADIUS = np.array([0.0, 0.2, -4.2]), 0.8


def report(console: Console) -> None:
    """Print the rates."""
    table = Table(title="Grid: rays off a mirror ball, after one that compiles")
    for name in ("", "beams", "rays", "cells", "build", "kernels", "M tests", "M tests/s", "target"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    yardstick = Yardstick(Fan.of(YARDSTICK_BEAMS))
    build_time, _ = _timed(yardstick.bin)
    _, kernel = _timed(yardstick.gather)
    table.add_row(
        "yardstick",
        f"{YARDSTICK_BEAMS:,}",
        f"{WIDTH * HEIGHT:,}",
        "",
        f"{build_time:.3f} s",
        *_rate(yardstick.tests, kernel),
        "",
    )
    for count, every, order in CASES:
        beams, rays = Fan.of(count).beams(), mirrored(every, shuffled=order != "in rows")
        for name, look, estimator in (("billboard, physical", pb.Look(), "billboard"), ("auto, ramp", RAMP, "auto")):
            row = _measured(beams, rays, look, estimator)
            table.add_row(f"{name}, {order}", f"{count:,}", f"{dr.width(rays.direction):,}", *row, f"≥ {TARGET}")
    beams, rays = Fan.of(BUILT[0]).beams(), mirrored(BUILT[1])
    build_time, _ = _timed(lambda: [None for _ in _lists(beams, rays)[2]])
    table.add_row("lists alone", f"{BUILT[0]:,}", f"{dr.width(rays.direction):,}", "", f"{build_time:.3f} s")
    console.print(table)


def mirrored(every: int = 1, shuffled: bool = False) -> Rays:
    """Return the rays of a picture's pixels, off a mirror ball behind the beams."""
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1, (np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1)
    x, y = (0.98 * each.ravel()[::every] / np.sqrt(2) for each in (x, y))
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
    bound, points = bind(look, beams, None, MEDIUM), Points(pb.gauss_legendre(6))
    packed = pack(beams, Array3f(0), shared=False)

    def whole() -> None:
        sum_over_grid(beams, None, packed, rays, bound, estimator, points)

    build_time, _ = _timed(lambda: [None for _ in _lists(beams, rays)[2]])
    _, kernels = _timed(whole, dr.width(rays.direction))
    cells = " × ".join(str(int(count[0])) for count in _lists(beams, rays)[0].counts)
    return [cells, f"{build_time:.3f} s", *_rate(grid_tests(beams, rays), kernels)]


def grid_tests(beams: pb.Beams, rays: Rays) -> int:
    """Return the number of tests: pairs of a ray and a beam in one of the ray's cells."""
    built = build(beams, None, rays)
    if built is None:
        return 0
    grid, marks, span = built
    parts = batches(partial(Sorting, grid.cells, marks.visit), len(beams))
    counts = (traverse_grid(rays, span, grid, part, lambda total, *_: total + 1, UInt32(0)) for part in parts)
    return sum(int(np.asarray(each, dtype=np.int64).sum()) for each in counts)


def _lists(beams: pb.Beams, rays: Rays) -> tuple[Any, Any, Iterator[Any]]:
    """Return the grid, the rays' span in it, and an iterator that makes its lists."""
    built = build(beams, None, rays)
    assert built is not None
    grid, marks, span = built
    return grid, span, batches(partial(Sorting, grid.cells, marks.visit), len(beams))


def _timed(run: Callable[[], Any], width: int | None = None) -> tuple[float, float]:
    """Return the least seconds of a run, and of its kernels of this width or, without one, of its longest kernel."""
    whole = kernel = float("inf")
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(ROUNDS + 1):  # the first compiles
            dr.sync_thread()
            dr.kernel_history_clear()
            begin = perf_counter()
            run()
            dr.sync_thread()
            whole = min(whole, perf_counter() - begin)
            spent = [(entry["size"], entry["execution_time"] / 1e3) for entry in dr.kernel_history([dr.KernelType.JIT])]
            own = sum(seconds for size, seconds in spent if size == width)
            kernel = min(kernel, own if width else max(seconds for _, seconds in spent))
    return whole, kernel


def _rate(tests: int, seconds: float) -> list[str]:
    return [f"{seconds:.3f} s", f"{tests / 1e6:,.0f}", f"{tests / seconds / 1e6:.0f}"]
