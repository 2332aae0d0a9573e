"""Options that several commands have, as types for typer."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .flags import Complexity

Scattering = Annotated[
    str | None, typer.Option(metavar="S|R,G,B", help="A fog for a stage without, or instead of the stage's.")
]
Absorption = Annotated[str | None, typer.Option(metavar="S|R,G,B", help="Its absorption.")]
Anisotropy = Annotated[float | None, typer.Option(help="Its mean cosine, -0.99 to 0.99.")]
Crop = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option(metavar="X0 Y0 X1 Y1", help="Part to render, in fractions from the top left."),
]
Frames = Annotated[
    str | None,
    typer.Option(
        "--frames",
        "-f",
        metavar="FRAMES",
        help="Such as 101, 101:105, 105:101, 101:109x2, or several with commas; default: the stage's start.",
    ),
]
Resolution = Annotated[
    tuple[int, int], typer.Option(metavar="W H", help="Size in pixels; what is 0 comes from the aperture.")
]
TwoEyes = Annotated[
    bool, typer.Option("--stereo", help="Two eyes: a pair of cameras with stereoRole, or the camera split in two.")
]
Interaxial = Annotated[float | None, typer.Option(help="Distance of the eyes in scene units; default: 65 mm.")]
Convergence = Annotated[
    float | None,
    typer.Option(help="Distance without disparity, scene units; default: the focus, or infinitely far."),
]
Simulate = Annotated[
    str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that changes the beams of each pass.")
]
Emit = Annotated[
    str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that makes beams from nothing.")
]
Picture = Annotated[
    list[str] | None, typer.Option(metavar="LAYER=FILE.png", help="Write one layer as a picture; may be repeated.")
]
Layers = Annotated[
    str | None, typer.Option(metavar="NAME,NAME", help="Layers of an .exr; default: all but normal and albedo.")
]
Exposure = Annotated[float, typer.Option(help="Stops, for pictures alone.")]
SkipExisting = Annotated[bool, typer.Option("--skip-existing", help="Leave out frames whose files are all there.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="/prim.attr=value", help="A value over the stage's; may be repeated."),
]
SessionLayers = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="A layer over the stage; may be repeated, the first is the strongest."),
]
Strict = Annotated[
    bool,
    typer.Option("--strict", help="Warnings about the stage are errors; without, what cannot be read is left out."),
]
Mask = Annotated[
    str | None,
    typer.Option(
        metavar="PATH,PATH", help="Prims that are read, with what is below and above them and what they refer to."
    ),
]
Purposes = Annotated[
    str | None,
    typer.Option(metavar="NAME,NAME", help="Purposes that are rendered beside default; default: render."),
]
Variants = Annotated[
    list[str] | None,
    typer.Option("--variant", metavar="/prim{set=choice}", help="A variant over the stage's; may be repeated."),
]
ComplexityName = Annotated[
    Complexity | None,
    typer.Option(
        help="How finely subdivision surfaces are refined; default: those that say of themselves that they are, high."
    ),
]
Threads = Annotated[int | None, typer.Option(help="Processor threads.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors alone.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print more.")]


def command_line() -> str:
    """Return the command for the header of an EXR, whose text is UTF-8 whatever file names are."""
    return shlex.join(["photonbeams", *sys.argv[1:]]).encode("utf-8", "replace").decode("utf-8")
