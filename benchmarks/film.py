"""The cost of a lens, a shutter and a second eye, beside a pinhole's frame with the same number of passes."""

from __future__ import annotations

from time import perf_counter

from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.usd.cameras.stereo import Stereo

from .keyhole import STAGE

FRAME, WIDTH, HEIGHT, PASSES, ROUNDS = 12, 1280, 720, 16, 3
OPEN = ("/World/Flight.shutter:open=-0.25", "/World/Flight.shutter:close=0.25", "/World/Flight.fStop=4")


def report(console: Console) -> None:
    """Print the least seconds of each case, run by turns, and their ratio to the pinhole's."""
    mono = pb.Shot.open(STAGE, camera="Flight", overrides=OPEN)
    eyes = pb.Shot.open(STAGE, camera="Flight", overrides=OPEN, stereo=Stereo())
    still = {"blur": False, "lens": False}
    cases = {
        "pinhole": (mono, still, None),
        "lens": (mono, {"blur": False}, None),
        "shutter": (mono, {"lens": False}, None),
        "lens and shutter": (mono, {}, 1.5),
        "two pinholes": (eyes, still, 1.8),
    }
    least: dict[str, float] = dict.fromkeys(cases, float("inf"))
    for _ in range(ROUNDS + 1):  # the first compiles, and is the slowest
        for name, (shot, how, _limit) in cases.items():
            begin = perf_counter()
            shot.render(FRAME, PASSES, width=WIDTH, height=HEIGHT, **how)
            least[name] = min(least[name], perf_counter() - begin)
    table = Table(title=f"Film camera: keyhole, {WIDTH} × {HEIGHT}, {PASSES} passes, least of {ROUNDS} frames by turns")
    for column in ("", "seconds", "ratio", "target"):
        table.add_column(column, justify="right" if column else "left")
    for name, (_, _, limit) in cases.items():
        ratio = least[name] / least["pinhole"]
        table.add_row(name, f"{least[name]:.2f}", f"{ratio:.2f}", "" if limit is None else f"≤ {limit:g}")
    console.print(table)
