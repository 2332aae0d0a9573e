"""The page docs/performance.md: seconds to one error by `photon_beams` and by Mitsuba's `volpath`, scene by scene.

    python -m benchmarks performance [--write] [FOLDER …]

Each renderer is measured against itself: two renders of other seeds differ by √2 of their error, and the error falls as
the root of the time. So no reference is needed, and none is favoured. Whether both have the same mean is in the table,
too. Scenes are those of examples/mitsuba, and what .xml files of the folders named have: other people's, for instance
the fog scenes of Mitsuba's own tests.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
SIZE = 192, 108
# The error that both are brought to, a render's least seconds, and what one is given at most.
ERROR, LEAST, MOST = 0.02, 3.0, 30.0


@dataclass(frozen=True)
class Measured:
    """Seconds of a render, its relative error, and its mean with the error of that."""

    seconds: float
    error: float
    mean: float
    mean_error: float

    @property
    def wanted(self) -> float:
        """Seconds to the error that is wanted."""
        return self.seconds * (self.error / ERROR) ** 2


def measured(render: Callable[[int, int], Any]) -> Measured:
    """Return what two renders of a count of passes or samples show, `render(count, seed)`, the count as time allows."""
    render(1, 9)  # compiles
    count, seconds = 1, 0.0
    while True:
        begun = perf_counter()
        first = np.asarray(render(count, 0), dtype=np.float64)[..., :3]
        seconds = perf_counter() - begun
        if seconds > LEAST or count >= 1 << 16:
            break
        count = max(2 * count, int(count * min(LEAST / max(seconds, 1e-3), 8)))
    second = np.asarray(render(count, 1), dtype=np.float64)[..., :3]
    both = np.nan_to_num([first.mean(axis=2), second.mean(axis=2)])
    mean = both.mean()
    # Light-weighted, without the brightest hundredth: fireflies would decide alone.
    light = both.mean(axis=0)
    kept = light <= np.quantile(light, 0.99)
    error = np.abs(both[0] - both[1])[kept].sum() / np.sqrt(2) / max(light[kept].sum(), 1e-30)
    return Measured(seconds, float(error), float(mean), float(abs(both[0].mean() - both[1].mean()) / 2))


def scenes(folders: Sequence[str]) -> list[Path]:
    """Return the scenes' files."""
    found = sorted((ROOT / "examples" / "mitsuba").glob("*.xml"))
    return found + [path for folder in folders for path in sorted(Path(folder).glob("*.xml"))]


def renders(path: Path) -> dict[str, Callable[[int, int], Any]]:
    """Return how a scene is rendered by each of both."""
    from photonbeams.runtime.device import mitsuba

    mi = mitsuba()
    text = path.read_text()
    parameters = {"width": str(SIZE[0]), "height": str(SIZE[1])} if "$width" in text else {}
    scene = mi.load_file(str(path), **parameters)
    depth = scene.integrator() and re.search(r'name="max_depth"\s+value="(-?\d+)"', text)
    most = {"max_depth": int(depth[1])} if depth else {}
    integrators = {
        "photon_beams": mi.load_dict({"type": "photon_beams", **most}),
        "volpath": mi.load_dict({"type": "volpath", "rr_depth": 50, **most}),
    }

    def by(integrator: Any) -> Callable[[int, int], Any]:
        return lambda count, seed: mi.render(scene, integrator=integrator, spp=count, seed=seed)

    return {name: by(integrator) for name, integrator in integrators.items()}


def report(console: Console, options: Sequence[str] = ()) -> None:
    """Measure all scenes, show a table, and write it into the page where that is wanted."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks performance", description=__doc__)
    parser.add_argument("folders", nargs="*", metavar="FOLDER", help="folders of more scenes")
    parser.add_argument("--write", action="store_true", help="write the table into docs/performance.md")
    given = parser.parse_args(options)
    rows = []
    for path in scenes(given.folders):
        try:
            ours, theirs = (measured(render) for render in renders(path).values())
        except (RuntimeError, ValueError) as error:
            console.print(f"{path.name}: {' '.join(str(error).split())[:150]}")
            continue
        apart = ours.mean / theirs.mean - 1
        noise = np.hypot(ours.mean_error / ours.mean, theirs.mean_error / theirs.mean)
        rows.append(
            (path.stem.removesuffix("_volpath"), shown(ours.wanted), shown(theirs.wanted),
             shown(theirs.wanted / ours.wanted), f"{100 * apart:+.1f} ± {100 * noise:.1f} %")
        )  # fmt: skip
        console.print("  ".join(rows[-1]))
    heads = ("scene", "`photon_beams`, s", "`volpath`, s", "times as fast", "mean beside `volpath`")
    table = Table(*(each.replace("`", "") for each in heads), title=f"Seconds to an error of {100 * ERROR:g} %")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if given.write:
        write(heads, rows)


def shown(number: float) -> str:
    """Return a number as people read it."""
    return f"{number:,.0f}" if number >= 20 else f"{number:.2g}"


def write(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write the table into the page, between its marks."""
    lines = [f"| {' | '.join(heads)} |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    where = f"{platform.machine()}, {os.cpu_count()} processors, {SIZE[0]} × {SIZE[1]} pixels or the scene's own"
    text = "\n".join(["<!-- table -->", "", *lines, "", f"*{where}.*", "", "<!-- end -->"])
    PAGE.write_text(re.sub(r"<!-- table -->.*<!-- end -->", lambda _: text, PAGE.read_text(), flags=re.DOTALL))
