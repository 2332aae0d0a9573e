"""Options that several commands share, as types for Typer."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .flags import Complexity

Scattering = Annotated[
    str | None,
    typer.Option(metavar="S|R,G,B", help="Scattering of the fog per scene unit: adds a fog, or changes the stage's."),
]
Absorption = Annotated[str | None, typer.Option(metavar="S|R,G,B", help="Absorption of the fog per scene unit.")]
Anisotropy = Annotated[float | None, typer.Option(help="Anisotropy of the fog: its mean cosine, -0.99 to 0.99.")]
Crop = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option(
        metavar="X0 Y0 X1 Y1",
        help="Render only this part, in fractions of the picture from its top left corner; where a "
        "stage is rendered, numbers beyond 0 to 1 add overscan.",
    ),
]
Frames = Annotated[
    str | None,
    typer.Option(
        "--frames",
        "-f",
        metavar="FRAMES",
        help="Frames, such as 101, 101:105, 105:101, 101:109x2, or several with commas; default: the stage's start.",
    ),
]
Resolution = Annotated[
    tuple[int, int],
    typer.Option(metavar="W H", help="Width and height in pixels; a 0 follows from the camera's aperture."),
]
TwoEyes = Annotated[
    bool,
    typer.Option(
        "--stereo", help="Render two eyes: a pair of cameras with stereoRole, or the one camera split in two."
    ),
]
Interaxial = Annotated[float | None, typer.Option(help="Distance between the eyes in scene units; default: 65 mm.")]
Convergence = Annotated[
    float | None,
    typer.Option(
        help="Distance, in scene units, at which both eyes see the same; default: the focus distance, or infinity."
    ),
]
Simulate = Annotated[
    str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that changes the beams of each pass.")
]
Emit = Annotated[
    str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that makes beams of its own.")
]
Picture = Annotated[
    list[str] | None, typer.Option(metavar="LAYER=FILE.png", help="Write one layer as a picture; may be repeated.")
]
Layers = Annotated[
    str | None,
    typer.Option(metavar="NAME,NAME", help="Layers to write into an .exr; default: all except normal and albedo."),
]
Exposure = Annotated[float, typer.Option(help="Exposure of .png pictures in stops; an .exr stays as it is.")]
SkipExisting = Annotated[bool, typer.Option("--skip-existing", help="Skip frames whose files all exist.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="/prim.attr=value", help="Override a value of the stage; may be repeated."),
]
SessionLayers = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="A USD layer over the stage; may be repeated, the first is the strongest."),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Treat warnings about the stage as errors; otherwise what cannot be read is left out."
    ),
]
Mask = Annotated[
    str | None,
    typer.Option(
        metavar="PATH,PATH", help="Read only these prims, their ancestors and descendants, and what they refer to."
    ),
]
Purposes = Annotated[
    str | None,
    typer.Option(metavar="NAME,NAME", help="Purposes to render, in addition to `default`; default: render."),
]
Variants = Annotated[
    list[str] | None,
    typer.Option("--variant", metavar="/prim{set=choice}", help="Select a variant; may be repeated."),
]
ComplexityName = Annotated[
    Complexity | None,
    typer.Option(
        help="How finely subdivision surfaces are refined; default: high for meshes that declare subdivision, else low."
    ),
]
Threads = Annotated[int | None, typer.Option(help="Number of processor threads; default: all.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print only errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print more, such as OpenUSD's own messages.")]


def command_line() -> str:
    """Return the command line for the header of an EXR. Its text is UTF-8, whatever the encoding of file names."""
    return shlex.join(["photonbeams", *sys.argv[1:]]).encode("utf-8", "replace").decode("utf-8")
