"""docs/matrix.md, written from the rows: `python -m tests.matrix.page`."""

from __future__ import annotations

from pathlib import Path

from .rows import BIAS, BLOCK_BIAS, MATRIX

FILE = Path(__file__).parents[2] / "docs" / "matrix.md"

HEAD = f"""# What each door renders

A USD stage and a Mitsuba scene are two doors of one renderer. Each feature stands on this page with what its pictures
are held to: the mean of a picture is that of Mitsuba's `volpath` within {100 * BIAS:g} %, beside four standard errors,
and a Z-test finds no block of 4 x 4 pixels that differs by more than {100 * BLOCK_BIAS:g} %, beside six. The two doors
are held to each other in the same way.

The scenes are in [`tests/matrix`](../tests/matrix): a box of fog in the dark with a lamp above it. Where a Mitsuba
scene is not written by hand, it is what [`photonbeams export`](guide.md#a-stage-as-a-mitsuba-scene) makes of the stage.
`volpath` had {{samples}} samples a pixel or more.

| feature | stage | Mitsuba scene |
|---|---|---|
"""


def page() -> str:
    """Return the page."""
    from .references import SEEDS

    head = HEAD.format(samples=f"{SEEDS * min(row.samples for row in MATRIX):,}")
    agreed = f"as `volpath`, within {100 * BIAS:g} %"
    return head + "\n".join(f"| {row.name} | {agreed} | {agreed} |" for row in MATRIX) + "\n"


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
