"""The cost of pixels: gathering the comparison scene along fewer rays than pixels, and along all, by picture size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from photonbeams.render.scene_frame import begin
from photonbeams.render.settings import Settings
from tests.helpers.mitsuba_scenes import comparison

SIZES = ((320, 180), (1280, 720), (3840, 2160))
GROWTH = 2.0  # greatest factor from one size to the next
_PATHS = 1 << 14


@dataclass
class Measured:
    """A gather: its seconds, its ray-beam tests, and the picture."""

    seconds: float
    tests: int
    picture: np.ndarray

    @classmethod
    def of(cls, size: tuple[int, int], depth: int, error: float) -> Measured:
        """Measure the second pass, because the first one compiles kernels."""
        scene = comparison(*size)
        settings = Settings(beams=_PATHS, max_depth=depth, method="beams", gather_error=error)
        frame = begin(scene, scene.sensors()[0], settings)
        frame.add_pass(0)
        frame.clear()
        frame.add_pass(1)
        statistics = frame.statistics
        return cls(statistics.seconds["beams"], statistics.tests, frame.layers()["beams"].mean(axis=2))


def report(console: Console) -> None:
    """Print seconds, tests and errors, and how they grow with the picture."""
    for depth, name in ((2, "single scattering"), (-1, "all scattering")):
        table = Table(title=f"Comparison scene, {name}, one pass of {_PATHS:,} light paths: gather")
        for column in ("", "all rays", "M tests", "fewer", "M tests", "growth", "goal", "median error", "of 95 %"):
            table.add_column(column, justify="right" if column else "left", no_wrap=True)
        before = None
        for size in SIZES:
            exact, fast = (Measured.of(size, depth, error) for error in (0.0, 0.002))
            lit = exact.picture > 0.05 * exact.picture.mean()
            error = np.abs(fast.picture - exact.picture)[lit] / exact.picture[lit]
            growth: list[Any] = ["", ""] if before is None else [f"{fast.seconds / before:.1f} ×", f"≤ {GROWTH:g} ×"]
            table.add_row(
                f"{size[0]} × {size[1]}", f"{exact.seconds:.2f} s", f"{exact.tests / 1e6:,.0f}",
                f"{fast.seconds:.2f} s", f"{fast.tests / 1e6:,.0f}", *growth, f"{np.median(error):.3%}",
                f"{np.percentile(error, 95):.2%}",
            )  # fmt: skip
            before = fast.seconds
        console.print(table)
