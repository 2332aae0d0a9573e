"""`python -m benchmarks [NAME …]`: run the benchmarks of these names, or all, and print a table for each."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from importlib import import_module

from rich.console import Console

# In the order in which they run; each module prints its own table in `report(console)`.
NAMES = {
    "gather": "tests per second beside the yardstick's",
    "pixels": "the gather along fewer rays than pixels, from 320 × 180 to 3840 × 2160",
    "rays": "tests per second of the grid, for rays off a mirror ball",
    "looks": "what looks cost beside the plain one",
    "cost": "seconds and memory from a thousand to a million beams",
    "quadrature": "Gauss against Riemann at equal error",
    "transport": "Mitsuba scenes: Z-test, variance and seconds beside volpath, caustics, a million beams",
    "keyhole": "the example frame, from an empty kernel cache",
    "farm": "workers beside threads, what a task costs, memory over passes",
    "scale": "a thousand machines, simulated with the farm's own policy",
    "studio": "from an edit to its first picture, orbits, memory over ten thousand edits",
    "film": "lens, shutter and a second eye beside a pinhole",
}
# What runs only where it is named, with options of its own.
OPTIONAL = {
    "cycles": "the comparison scene beside Blender's Cycles with its denoiser: see `cycles --help`",
    "performance": "seconds to one error beside volpath, for docs/performance.md: see `performance --help`",
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="; ".join(f"{n}: {about}" for n, about in (NAMES | OPTIONAL).items())
    )
    own = sys.argv[1:2] if sys.argv[1:2] and sys.argv[1] in OPTIONAL else []
    names = own or parser.parse_args().names or list(NAMES)
    if unknown := [name for name in names if name not in NAMES | OPTIONAL]:
        parser.error(f"no benchmark {unknown[0]}: expected {', '.join(NAMES | OPTIONAL)}")
    console = Console()
    console.width = max(console.width, 110)  # a table that wraps cannot be read
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    console.print(f"[dim]{platform.machine()}, {os.cpu_count()} processors{load}: figures need an idle machine[/]")
    for name in names:
        module = import_module(f".{name}", __package__)
        module.report(console, *([sys.argv[2:]] if own else []))


if __name__ == "__main__":
    main()
