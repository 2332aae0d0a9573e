"""Ray–beam tests per second of the tiled estimators and of the yardstick, run by turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import drjit as dr
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.points import Points

from .scenes import RAMP, Fan, Picture, rgb
from .yardstick import Yardstick

BEAMS, ROUNDS = 10_000, 5


@dataclass
class Case:
    """One contender: its name, its target ratio, and how it runs; `run` returns its number of tests."""

    name: str
    target: float | None
    run: Callable[[], int]
    kernel: float = float("inf")  # seconds of the gathering kernels
    whole: float = float("inf")  # seconds of everything, binning included
    tests: int = 0

    def measure(self) -> None:
        """Run once, and keep the least times."""
        dr.sync_thread()
        dr.kernel_history_clear()
        begin = perf_counter()
        self.tests = self.run()
        dr.sync_thread()
        self.whole = min(self.whole, perf_counter() - begin)
        seconds = [entry["execution_time"] / 1e3 for entry in dr.kernel_history() if entry["type"].name == "JIT"]
        self.kernel = min(self.kernel, max(seconds))


def report(console: Console) -> None:
    """Print the rates, and their ratios to the yardstick's."""
    fan, picture, points = Fan.of(BEAMS), Picture(), Points(pb.gauss_legendre(6))
    yardstick, beams = Yardstick(fan), fan.beams()

    def bare() -> int:
        yardstick.bin()
        yardstick.gather()
        return yardstick.tests

    def ours(estimator: str, look: pb.Look) -> Callable[[], int]:
        return lambda: picture.of(beams, look, estimator, points).billboard_tests

    same = pb.Look(angle=1.0)
    cases = [
        Case("yardstick", None, bare),
        Case("billboard, the yardstick's picture", 1.0, ours("billboard", same)),
        Case("billboard, physical", 1.0, ours("billboard", pb.Look())),
        Case("auto, physical", 0.5, ours("auto", pb.Look())),
        Case("auto, colour ramp × physical", 0.5, ours("auto", RAMP)),
    ]
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(ROUNDS + 1):  # the first compiles
            for case in cases:
                case.measure()
    console.print(_table(cases))
    a, b = (rgb(value).mean() for value in (yardstick.picture(), picture.of(beams, same, "billboard", points).radiance))
    console.print(
        f"Mean of the picture: ours over the yardstick's {b / a:.4f} (the kernels differ, their weight does not)."
    )


def _table(cases: list[Case]) -> Table:
    table = Table(title=f"Gather: {BEAMS:,} beams, 1280 × 720, least of {ROUNDS} runs by turns")
    for name in ("", "kernel", "M tests/s", "ratio", "with all", "M tests/s", "ratio", "target"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for case in cases:
        columns: list[Any] = [case.name]
        for seconds, best in ((case.kernel, cases[0].kernel), (case.whole, cases[0].whole)):
            rate, yardstick = case.tests / seconds, cases[0].tests / best
            columns += [f"{seconds:.3f} s", f"{rate / 1e6:.0f}", f"{rate / yardstick:.2f}"]
        table.add_row(*columns, "" if case.target is None else f"≥ {case.target:g}")
    return table
