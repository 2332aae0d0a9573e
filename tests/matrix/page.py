"""Write docs/matrix.md from the rows of the matrix: `python -m tests.matrix.page`."""

from __future__ import annotations

from pathlib import Path

from .rows import BIAS, BLOCK_BIAS, MATRIX

FILE = Path(__file__).parents[2] / "docs" / "matrix.md"

HEAD = f"""# What each door renders

A USD stage and a Mitsuba scene are two doors of one renderer. This page lists features that are tested through both
doors. The test is the same for each: the mean of a picture must agree with that of Mitsuba's `volpath` to within
{100 * BIAS:g} % plus four standard errors, and in a Z-test no block of 4 x 4 pixels may differ by more than
{100 * BLOCK_BIAS:g} % plus six standard errors. The two doors are compared with each other in the same way.

The scenes are in [`tests/matrix`](../tests/matrix): a box of fog in the dark with a lamp above it. A Mitsuba scene that
is not written by hand is what [`photonbeams export`](stages.md#a-stage-as-a-mitsuba-scene) makes of the stage. `volpath`
had {{samples}} samples per pixel or more.

| feature | stage | Mitsuba scene |
|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    from .references import SEEDS

    head = HEAD.format(samples=f"{SEEDS * min(row.samples for row in MATRIX):,}")
    agreed = f"as `volpath`, within {100 * BIAS:g} %"
    return head + "\n".join(f"| {row.name} | {agreed} | {agreed} |" for row in MATRIX) + "\n"


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
