"""Write docs/matrix.md from the rows of the matrix: `python -m tests.matrix.page`."""

from __future__ import annotations

from pathlib import Path

from .rows import BIAS, BLOCK_BIAS, MATRIX

FILE = Path(__file__).parents[2] / "docs" / "matrix.md"

HEAD = f"""# Stages and Mitsuba scenes compared

The same renderer reads USD stages and Mitsuba scenes. This page lists features that are tested in both. A tick (✓)
means that the picture agrees with that of Mitsuba's `volpath`: its mean to within {100 * BIAS:g} % plus four standard
errors, and in a Z-test each block of 4 x 4 pixels to within {100 * BLOCK_BIAS:g} % plus six standard errors. Both
pictures, of the stage and of the Mitsuba scene, are compared with each other in the same way.

The scenes are in [`tests/matrix`](../tests/matrix): a box of fog in the dark with a lamp above it. A Mitsuba scene that
is not written by hand is what [`photonbeams export`](stages.md#a-stage-as-a-mitsuba-scene) makes of the stage. The
pictures of `volpath` have {{samples}} samples per pixel or more.

| feature | stage | Mitsuba scene |
|---|:---:|:---:|
"""


def page() -> str:
    """Return the text of the page."""
    from .references import SEEDS

    head = HEAD.format(samples=f"{SEEDS * min(row.samples for row in MATRIX):,}")
    return head + "\n".join(f"| {row.name} | ✓ | ✓ |" for row in MATRIX) + "\n"


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
