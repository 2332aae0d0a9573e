"""`python -m benchmarks [NAME …]`: run the named benchmarks, or all of them, and print a table for each."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from importlib import import_module

from rich.console import Console

# In the order in which they run; each module prints its own table in `report(console)`.
NAMES = {
    "gather": "ray-beam tests per second beside the yardstick's",
    "pixels": "the gather along fewer rays than pixels, from 320 × 180 to 3840 × 2160",
    "rays": "ray-beam tests per second of the grid, for rays off a mirror ball",
    "looks": "the cost of looks beside the physical one",
    "cost": "seconds and memory from a thousand to a million beams",
    "quadrature": "Gauss against Riemann at equal error",
    "transport": "Mitsuba scenes: Z-test, variance and seconds beside volpath, caustics, a million beams",
    "keyhole": "the example frame, from an empty kernel cache",
    "frames": "the keyhole's picture, its flight and a large pass: seconds and memory",
    "farm": "workers beside threads, the cost of a task, memory over passes",
    "scale": "a thousand machines, simulated with the farm's own scheduling policy",
    "studio": "from an edit to its first picture, orbits, memory over ten thousand edits",
    "film": "lens, shutter and a second eye beside a pinhole",
}
# Benchmarks that run only when they are named, with options of their own.
OPTIONAL = {
    "compare": "this tree beside another commit, before each landing: see `compare --help`",
    "cycles": "the comparison scene beside Blender's Cycles with its denoiser: see `cycles --help`",
    "rooms": "rooms in Mitsuba's format beside its own path tracers: see `rooms --help`",
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
        parser.error(f"there is no benchmark {unknown[0]}: expected {', '.join(NAMES | OPTIONAL)}")
    console = Console()
    console.width = max(console.width, 110)  # a wrapped table is unreadable
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    console.print(
        f"[dim]{platform.machine()}, {os.cpu_count()} processors{load}: for valid figures, the machine must be idle[/]"
    )
    for name in names:
        module = import_module(f".{name}", __package__)
        module.report(console, *([sys.argv[2:]] if own else []))


if __name__ == "__main__":
    main()
