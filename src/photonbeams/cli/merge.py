"""`photonbeams merge`: frames from passes that several machines rendered."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .outputs import chosen_layers, parse_outputs, prepare_outputs, write_outputs
from .progress import counted, messages

if TYPE_CHECKING:
    from ..render.frame_sums import FrameSums


def merge(
    checkpoints: Annotated[list[Path], typer.Argument(help="Checkpoints of one frame, each of other passes.")],
    output: Annotated[
        list[Path], typer.Option("--output", "-o", help="Where to write: .exr (layered) or .png; may be repeated.")
    ],
    picture: Annotated[
        list[str] | None, typer.Option(metavar="LAYER=FILE.png", help="Write one layer as a picture; may be repeated.")
    ] = None,
    layers: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="Layers of an .exr, beside rgba; default: all.")
    ] = None,
    exposure: Annotated[float, typer.Option(help="Stops, for pictures alone.")] = 0.0,
    quiet: options.Quiet = False,
) -> None:
    """Join the passes of checkpoints into a frame: the same bits as if one machine had rendered all of them.

    For example:

    photonbeams render shot.usda --pass-range 0:15 --passes 32 -o a.checkpoint

    photonbeams render shot.usda --pass-range 16:31 --passes 32 -o b.checkpoint

    photonbeams merge a.checkpoint b.checkpoint -o frame.exr
    """
    from ..shot.development import Development

    outputs = parse_outputs(output, picture or ())
    with messages(quiet, verbose=False):
        prepare_outputs(outputs)
        sums = joined(checkpoints)
        _warn_of_gaps(sums)
        frame = Development.of(sums.development).frame(sums)
        for metadata in [frame.metadata, *(each for _, each in frame.views.values())]:
            metadata["commandLine"] = options.command_line()
        kept = chosen_layers(layers, outputs, [*frame.layers])
        write_outputs(frame, outputs, kept, exposure, chosen=layers is not None)
    if not quiet:
        files = ", ".join(str(each.path) for each in outputs)
        typer.echo(f"{counted(len(sums), 'pass', 'passes')} joined, wrote {files}", err=True)


def joined(paths: Sequence[Path]) -> FrameSums:
    """Return the sums of all passes in some checkpoints; SceneError where they are not of one picture."""
    from ..render.frame_sums import FrameSums
    from ..scene import SceneError

    result = FrameSums.load(paths[0])
    for path in paths[1:]:
        try:
            result.join(FrameSums.load(path))
        except SceneError as error:
            text = str(error)
            raise SceneError(text if text.startswith(f"{path}:") else f"{path}: {text}") from None
    if not len(result):
        raise SceneError(f"{paths[0]}: has no passes: expected at least one")
    return result


def _warn_of_gaps(sums: FrameSums) -> None:
    """Warn of passes that were planned and are not there."""
    ends = [0, *(end for each in sums.ranges() for end in (each.start, each.stop)), sums.planned or 0]
    missing = [f"{a} to {b - 1}" for a, b in zip(ends[::2], ends[1::2], strict=False) if a < b]
    if missing:
        logging.getLogger("photonbeams").warning("passes %s are missing", " and ".join(missing))
