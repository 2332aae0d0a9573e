"""Reference pictures of `volpath`: means of blocks and their standard errors, in references.json beside this file.

`python -m tests.matrix.references [WORD ...]` renders those of the rows whose names contain one of the
words, or of all rows, in a few minutes.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import photonbeams as pb
from photonbeams.export.shot import export
from photonbeams.runtime.device import helping_thread
from tests.helpers.agreement import Means, means

from .rows import HEIGHT, MATRIX, WIDTH, Row, mi

FILE = Path(__file__).with_name("references.json")
SEEDS = 8


def opened(row: Row, folder: Path) -> pb.Shot:
    """Write the stage of a row and its files into a folder, and open it."""
    path = folder / "stage.usda"
    path.write_text(row.stage)
    for name, write in row.files.items():
        write(folder / name)
    return pb.Shot.open(path)


def twin(row: Row, folder: Path) -> Any:
    """Return the Mitsuba scene of a row."""
    if row.twin is not None:
        return mi.load_dict(row.twin())
    files = export(opened(row, folder), folder / "twin.xml", width=WIDTH, height=HEIGHT)
    with helping_thread():
        return mi.load_file(str(files[0]))


def reference(row: Row) -> Means:
    """Return the stored reference of a row; raise KeyError if it is of another scene."""
    found = json.loads(FILE.read_text())[row.name]
    if found["scene"] != row.fingerprint:
        raise KeyError(f"references.json has another scene for '{row.name}': run this module")
    return Means(*(np.array(found[name]) for name in Means._fields))


def rendered(row: Row) -> dict[str, Any]:
    """Render the reference of a row."""
    integrator = mi.load_dict({"type": "volpath", "max_depth": row.max_depth, "rr_depth": 50})
    with TemporaryDirectory() as folder:
        scene = twin(row, Path(folder))
        pictures = [
            np.array(mi.render(scene, integrator=integrator, spp=row.samples, seed=seed))[..., :3]
            for seed in range(SEEDS)
        ]
    found = means(np.array(pictures))._asdict()
    numbers = {name: np.vectorize(lambda x: float(f"{x:.4g}"))(value).tolist() for name, value in found.items()}
    return {"scene": row.fingerprint, "samples": SEEDS * row.samples, **numbers}


def main(words: list[str]) -> None:
    """Render and store references."""
    known = json.loads(FILE.read_text()) if FILE.exists() else {}
    rows = [row for row in MATRIX if not words or any(word in row.name for word in words)]
    for row in rows:
        known[row.name] = rendered(row)
        whole, error = (np.array(known[row.name][name]) for name in ("whole", "whole_error"))
        print(f"{row.name}: {whole} +- {error / whole}", flush=True)
        FILE.write_text(json.dumps({each.name: known[each.name] for each in MATRIX if each.name in known}))


if __name__ == "__main__":
    main(sys.argv[1:])
