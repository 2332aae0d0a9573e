"""Render every stage below some folders through the command, and report how each ended.

    tools/sweep.py FOLDER… -o OUT [--passes 1] [--res 160] [--timeout 120] [--workers 2] [--every N]

It writes into OUT: a PNG for each picture, `report.csv`, and a contact sheet for each folder, in which each picture is
beside the suite's reference image, if one has the stage's name. A refusal is an exit with a one-sentence message.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import OpenImageIO
from pxr import Usd, UsdGeom, UsdLux, UsdVol

from photonbeams.usd.common.reading import quiet

STAGES = (".usd", ".usda", ".usdc", ".usdz")
REFERENCES = (
    "ref/reference.tif",
    "baseline/{stem}.png",
    "baseline/*{stem}*.png",
    "thumbnails/{stem}.png",
    "{stem}.png",
)
COLUMNS, ROWS = 4, 6  # of pairs on a page


@dataclass(frozen=True)
class Outcome:
    """How a stage ended: "picture", "refusal", "traceback", "crash" or "time-out", with its last sentence."""

    path: Path
    picture: Path
    kind: str
    sentence: str
    warnings: int
    complete: bool

    def row(self, root: Path) -> list[object]:
        """Return the row of the report."""
        return [self.path.relative_to(root), self.kind, self.complete, self.warnings, self.sentence]


def is_complete(path: Path) -> bool:
    """Return whether a stage is meant to be a picture: it has a camera, and a light and geometry or a volume."""
    try:
        with quiet():
            stage = Usd.Stage.Open(str(path))
            prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    except Exception:  # whatever its kind, OpenUSD cannot open the stage
        return False
    camera = any(prim.IsA(UsdGeom.Camera) for prim in prims)
    light = any(prim.HasAPI(UsdLux.LightAPI) for prim in prims)
    geometry = any(prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer) for prim in prims)
    return camera and ((light and geometry) or any(prim.IsA(UsdVol.Volume) for prim in prims))


def rendered(path: Path, picture: Path, arguments: argparse.Namespace) -> Outcome:
    """Render a stage in a process of its own, and return how it ended."""
    command = [
        sys.executable, "-m", "photonbeams", "render", str(path), "-o", str(picture), "--res", str(arguments.res), "0",
        "--passes", str(arguments.passes), "--progress", "none", "--device", "cpu", *arguments.flags,
    ]  # fmt: skip
    picture.parent.mkdir(parents=True, exist_ok=True)
    complete = is_complete(path)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=arguments.timeout, errors="replace")
    except subprocess.TimeoutExpired:
        return Outcome(path, picture, "time-out", f"after {arguments.timeout} s", 0, complete)
    lines = done.stderr.strip().splitlines()
    warnings = sum(line.startswith("Warning: ") for line in lines)
    noise = [line for line in lines if not re.match(r"Warning: |Error: |wrote |\d", line)]
    last = lines[-1] if lines else ""
    if "Traceback (most recent call last)" in done.stderr:
        kind = "traceback"
    elif done.returncode == 0 and picture.exists():
        kind, last = "picture", noise[0] if noise else ""
    elif done.returncode in (1, 2) and last.startswith("Error: "):
        kind = "refusal"
    else:
        kind, last = "crash", f"exit code {done.returncode}: {last}"
    return Outcome(path, picture, kind, last, warnings, complete)


def reference(path: Path) -> Path | None:
    """Return the reference image of a stage in its suite, or None."""
    for folder in (path.parent, path.parent.parent):
        for name in REFERENCES:
            found = sorted(folder.glob(name.format(stem=path.stem)))
            if found:
                return found[0]
    return None


def pixels(path: Path | None) -> np.ndarray | None:
    """Return an image's colours as they are stored, or None."""
    if path is None or not path.exists():
        return None
    found = np.asarray(OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT))
    return None if found.ndim != 3 else np.clip(found[..., :3] if found.shape[2] >= 3 else found[..., [0, 0, 0]], 0, 1)


def draw_sheets(outcomes: Sequence[Outcome], root: Path, out: Path) -> None:
    """Draw contact sheets of a folder's pictures, each beside its reference."""
    shown = [each for each in outcomes if each.kind == "picture"]
    for page in range(0, len(shown), COLUMNS * ROWS):
        rows = min(ROWS, -(-(len(shown) - page) // COLUMNS))
        figure, axes = plt.subplots(rows, 2 * COLUMNS, figsize=(16, 2.2 * rows), squeeze=False)
        for axis in axes.flat:
            axis.axis("off")
        for number, outcome in enumerate(shown[page : page + COLUMNS * ROWS]):
            row, column = divmod(number, COLUMNS)
            own, other = axes[row, 2 * column : 2 * column + 2]
            for axis, image in ((own, pixels(outcome.picture)), (other, pixels(reference(outcome.path)))):
                if image is not None:
                    axis.imshow(image)
            own.set_title(str(outcome.path.relative_to(root))[-46:], fontsize=6, loc="left")
        figure.tight_layout()
        figure.savefig(out / f"{root.name}.{page // (COLUMNS * ROWS)}.png", dpi=90)
        plt.close(figure)


def main() -> None:
    """Render the stages of all folders."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--passes", type=int, default=1)
    parser.add_argument("--res", type=int, default=160)
    parser.add_argument("--timeout", type=float, default=120)
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--every", type=int, default=1, help="render only every N-th stage")
    parser.add_argument("--complete", action="store_true", help="render only stages with camera, light and geometry")
    parser.add_argument(
        "--flags", nargs=argparse.REMAINDER, default=[], help="further flags for the command; must come last"
    )
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows: list[list[object]] = []
    counts: Counter[tuple[bool, str]] = Counter()
    for root in arguments.folders:
        paths = sorted(path for path in root.rglob("*") if path.suffix.lower() in STAGES and path.is_file())
        paths = [path for path in paths if not arguments.complete or is_complete(path)][:: arguments.every]
        pictures = [arguments.output / root.name / path.relative_to(root).with_suffix(".png") for path in paths]
        with ThreadPoolExecutor(arguments.workers) as pool:
            outcomes = []
            for outcome in pool.map(partial(rendered, arguments=arguments), paths, pictures):
                print(*outcome.row(root), flush=True)
                outcomes.append(outcome)
        counts.update((each.complete, each.kind) for each in outcomes)
        rows += [each.row(root) for each in outcomes]
        draw_sheets(outcomes, root, arguments.output)
    with (arguments.output / "report.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["stage", "end", "complete", "warnings", "sentence"], *rows])
    for complete, title in ((True, "with camera, light and geometry, or a volume"), (False, "others")):
        print(f"{title}: " + (", ".join(f"{n} {kind}" for (own, kind), n in counts.items() if own == complete) or "0"))


if __name__ == "__main__":
    main()
