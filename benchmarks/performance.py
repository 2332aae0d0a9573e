"""The page docs/performance.md: seconds to one error by `photon_beams`, by Mitsuba's `volpath` and by Cycles.

    python -m benchmarks performance [--write] [--cycles PYTHON] [FOLDER …]

`photon_beams` and `volpath` are each measured against themselves: two renders with different seeds differ by √2 of
their error, and the error falls as the root of the time. So neither needs a reference. Cycles renders with its
denoiser, whose error is not noise: it is measured against a long render by the faster of the other two. The table
shows each mean, too. Scenes are those of examples/mitsuba, and the .xml files of the folders named: other
people's, for instance the fog scenes of Mitsuba's own tests.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from tempfile import NamedTemporaryFile
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from photonbeams.runtime.device import mitsuba

from .cycles import BPY_PYTHON, cycles
from .cycles_scene import UntranslatedError, cycles_job

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
SIZE = 192, 108
# The error that all are brought to, and the least seconds of a render that is measured.
ERROR, LEAST = 0.02, 3.0
# Seconds of the reference, as many times those to the error, at most; samples of Cycles, and when it has had enough.
REFERENCE, REFERENCE_MOST = 16, 60.0
SAMPLES, LIMIT = (4, 16, 64, 256, 1024, 4096), 25.0
_GAP = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Measured:
    """Seconds of a render, its relative error, its mean with the error of that, and its passes or samples."""

    seconds: float
    error: float
    mean: float
    mean_error: float
    count: int = 0

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
        first = render(count, 0)
        seconds = perf_counter() - begun
        if seconds > LEAST or count >= 1 << 16:
            break
        count = max(2 * count, int(count * min(LEAST / max(seconds, 1e-3), 8)))
    second = render(count, 1)
    mean = (first.mean() + second.mean()) / 2
    error = distance(first, second, (first + second) / 2) / np.sqrt(2)
    return Measured(seconds, error, float(mean), float(abs(first.mean() - second.mean()) / 2), count)


def distance(first: Any, second: Any, light: Any) -> float:
    """Return how far two pictures are apart, (H, W, 3), in units of the light, weighted by it.

    The brightest hundredth of the pixels is left out: fireflies would decide alone.
    """
    first, second, light = (each.mean(axis=2) for each in (first, second, light))
    kept = light <= np.quantile(light, 0.99)
    return float(np.abs(first - second)[kept].sum() / max(light[kept].sum(), 1e-30))


def scenes(folders: Sequence[str]) -> list[Path]:
    """Return the scenes' files."""
    found = sorted((ROOT / "examples" / "mitsuba").glob("*.xml"))
    return found + [path for folder in folders for path in sorted(Path(folder).glob("*.xml"))]


def loaded(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return a scene, with a box filter as Cycles has it, and its longest path as a parameter of integrators."""
    mi = mitsuba()
    text = re.sub(r'<rfilter type="\w+"\s*/>', '<rfilter type="box"/>', path.read_text())
    parameters = {"width": str(SIZE[0]), "height": str(SIZE[1])} if "$width" in text else {}
    with NamedTemporaryFile("w", suffix=".xml", dir=path.parent) as file:  # beside the scene: its files are found
        file.write(text)
        file.flush()
        scene = mi.load_file(file.name, **parameters)
    depth = re.search(r'name="max_depth"\s+value="(-?\d+)"', text)
    return scene, {"max_depth": int(depth[1])} if depth else {}


def renders(scene: Any, most: dict[str, Any]) -> dict[str, Callable[[int, int], Any]]:
    """Return how a scene is rendered by each of both: pictures (H, W, 3) for a count and a seed."""
    mi = mitsuba()
    integrators = {
        "photon_beams": mi.load_dict({"type": "photon_beams", **most}),
        "volpath": mi.load_dict({"type": "volpath", "rr_depth": 50, **most}),
    }

    def by(integrator: Any) -> Callable[[int, int], Any]:
        def render(count: int, seed: int) -> Any:
            picture = mi.render(scene, integrator=integrator, spp=count, seed=seed)
            return np.nan_to_num(np.asarray(picture, dtype=np.float64)[..., :3])

        return render

    return {name: by(integrator) for name, integrator in integrators.items()}


def by_cycles(python: Path, scene: Any, most: dict[str, Any], both: list[tuple[Any, Measured]]) -> Cycles | None:
    """Return what Cycles measures, or None where the scene has something that it would render differently."""
    try:
        job = cycles_job(scene)
    except UntranslatedError:
        return None
    render, one = min(both, key=lambda each: each[1].wanted)
    count = max(1, round(one.count * min(REFERENCE * one.wanted, REFERENCE_MOST) / one.seconds))
    truth = render(count, 2)
    noise = one.error * np.sqrt(one.count / count)
    bounces = most.get("max_depth", -1) - 2
    job["bounces"] = bounces if bounces >= 0 else 1024
    tried: list[tuple[float, float]] = []
    mean = float("nan")
    for _, picture, seconds, _ in cycles(python, job, SAMPLES, truth.shape[1::-1], LIMIT):
        apart = distance(np.float64(picture), truth, truth)
        tried.append((seconds, float(np.sqrt(max(apart**2 - noise**2, 1e-12)))))
        mean = float(np.mean(picture) / truth.mean())
        if tried[-1][1] <= ERROR:
            break
    return Cycles(tried, mean) if tried else None


@dataclass(frozen=True)
class Cycles:
    """Seconds and errors of Cycles' pictures, with more and more samples, and the last one's mean, the true one 1."""

    tried: list[tuple[float, float]]
    mean: float

    @property
    def wanted(self) -> float:
        """Seconds to the error that is wanted, between two pictures; infinite where none has it."""
        if self.tried[-1][1] > ERROR:
            return float("inf")
        seconds, errors = np.log(self.tried).T
        return float(np.exp(np.interp(-np.log(ERROR), -errors, seconds)))

    def cell(self) -> str:
        """Return the cell of the table: seconds, or the last picture's with its error."""
        if np.isfinite(self.wanted):
            return shown(self.wanted)
        seconds, error = self.tried[-1]
        return f"{shown(seconds)} to {100 * error:.1f} %"


def row(path: Path, python: Path | None) -> tuple[str, ...]:
    """Measure a scene, and return its row of the table."""
    scene, most = loaded(path)
    found = renders(scene, most)
    ours, theirs = (measured(render) for render in found.values())
    other = by_cycles(python, scene, most, list(zip(found.values(), (ours, theirs), strict=True))) if python else None
    noise = np.hypot(ours.mean_error / ours.mean, theirs.mean_error / theirs.mean)
    return (
        path.stem.removesuffix("_volpath"), shown(ours.wanted), shown(theirs.wanted),
        other.cell() if other else "–", shown(theirs.wanted / ours.wanted),
        shown(other.wanted / ours.wanted) if other and np.isfinite(other.wanted) else "–",
        f"{100 * (ours.mean / theirs.mean - 1):+.1f}{_GAP}±{_GAP}{100 * noise:.1f}{_GAP}%",
        f"{100 * (other.mean - 1):+.1f}{_GAP}%" if other else "–",
    )  # fmt: skip


def report(console: Console, options: Sequence[str] = ()) -> None:
    """Measure all scenes, show a table, and write it into the page where that is wanted."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks performance", description=__doc__)
    parser.add_argument("folders", nargs="*", metavar="FOLDER", help="folders of more scenes")
    parser.add_argument("--write", action="store_true", help="write the table into docs/performance.md")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="scenes whose names begin so")
    parser.add_argument(
        "--cycles", type=Path, metavar="PYTHON", default=BPY_PYTHON if BPY_PYTHON.exists() else None,
        help=f"the Python that has bpy: {BPY_PYTHON}, if the set-up made it; none: no Cycles",
    )  # fmt: skip
    given = parser.parse_args(options)
    rows = []
    for path in scenes(given.folders):
        if given.only and not path.stem.startswith(tuple(given.only)):
            continue
        try:
            rows.append(row(path, given.cycles))
        except (RuntimeError, ValueError) as error:
            console.print(f"{path.name}: {' '.join(str(error).split())[:150]}")
        else:
            console.print("  ".join(rows[-1]))
    table = Table(*(each.replace("`", "") for each in HEADS), title=f"Seconds to an error of {100 * ERROR:g} %")
    for cells in rows:
        table.add_row(*cells)
    console.print(table)
    if given.write:
        write(HEADS, rows)


HEADS = (
    "scene", "`photon_beams`, s", "`volpath`, s", "Cycles, denoised, s", "times as fast as `volpath`",
    "times as fast as Cycles", "its mean, relative to `volpath`'s", "Cycles' mean, relative to the reference's",
)  # fmt: skip


def processor() -> str:
    """Return the processor's name."""
    path = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*: (.+)", path.read_text()) if path.exists() else None
    return found[1] if found else platform.machine()


def shown(number: float) -> str:
    """Return a number as people read it."""
    return f"{number:,.0f}" if number >= 20 else f"{number:.2g}"


def write(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write the table into the page, between its marks."""
    lines = [f"| {' | '.join(heads)} |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    size = f"{SIZE[0]} × {SIZE[1]} pixels or the scene's own"
    where = f"{processor()}, {os.cpu_count()} processors, {size}, {date.today():%B %Y}"
    text = "\n".join(["<!-- table -->", "", *lines, "", f"*{where}.*", "", "<!-- end -->"])
    PAGE.write_text(re.sub(r"<!-- table -->.*<!-- end -->", lambda _: text, PAGE.read_text(), flags=re.DOTALL))
