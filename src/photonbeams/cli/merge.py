"""`photonbeams merge`: join passes or tiles, which several machines rendered, into frames."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from glob import glob
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..images.numbering import numbered
from ..runtime.files import check_kept
from ..runtime.limits import check_address_space
from ..scene import SceneError
from .animation import frame_numbers
from .flags import MessageFlags, PictureFlags, Quiet
from .outputs import Output, check_different, chosen_layers, parse_outputs, prepare_outputs, write_outputs
from .progress import counted, messages

if TYPE_CHECKING:
    from ..render.films.frame_sums import FrameSums


LOG = logging.getLogger("photonbeams")


def merge(
    checkpoints: Annotated[
        list[Path],
        typer.Argument(
            help="Checkpoints with different passes of one frame, or .exr tiles; * and ? are wildcards, "
            "a run of # stands for the frame number."
        ),
    ],
    output: Annotated[
        list[Path],
        typer.Option("--output", "-o", help="File to write: .exr (layered) or .png (tone-mapped); may be repeated."),
    ],
    pictures: PictureFlags,
    remove: Annotated[
        bool, typer.Option("--remove", help="Remove the checkpoints once their frame is written.")
    ] = False,
    partial: Annotated[bool, typer.Option("--partial", help="Also write frames that lack passes or tiles.")] = False,
    quiet: Quiet = False,
) -> None:
    """Join passes from checkpoints, or tiles, into frames, bit for bit as if one machine had rendered all of them.

    For example:

    photonbeams render shot.usda --passes 32 --pass-range 1/2 -o a.checkpoint

    photonbeams render shot.usda --passes 32 --pass-range 2/2 -o b.checkpoint

    photonbeams merge a.checkpoint b.checkpoint -o frame.exr
    """
    check_address_space()
    from ..shot.development import developed

    shown = MessageFlags(quiet=quiet)
    outputs = parse_outputs(output, pictures.picture or (), pictures.deep, single_part=pictures.single_part)
    layers = pictures.layers
    with messages(shown):
        numbers = frame_numbers(pictures.frames, outputs)
        written = [[each if number is None else each.numbered(number) for each in outputs] for number in numbers]
        targets = [each.path for files in written for each in files]
        check_different(targets)
        check_kept(targets, chain(*(each for number in numbers for each in _named(checkpoints, number).values())))
        for number, files in zip(numbers, written, strict=True):
            if pictures.skip_existing and all(each.exists() for each in files):
                continue
            prepare_outputs(files)
            paths = _found(checkpoints, number)
            tiles = [each for each in paths if each.suffix.lower() == ".exr"]
            if tiles and len(tiles) < len(paths):
                raise typer.BadParameter(f"{tiles[0]} is a tile: expected tiles or checkpoints, not both")
            if tiles:
                if layers is not None or remove or pictures.single_part or pictures.exposure:
                    text = "tiles are joined as they are: expected no --layers, --single-part, --exposure or --remove"
                    raise typer.BadParameter(text)
                _join_tiles(paths, files, shown, partial=partial)
                continue
            sums = joined(paths)
            _check_gaps(sums, files[0].path, partial=partial)
            try:
                frame = developed(sums)
                kept = chosen_layers(layers, files, [*frame.layers])
                write_outputs(frame, files, kept, pictures.exposure, chosen=layers is not None)
            except ValueError as error:  # also of what no header can hold
                raise SceneError(f"{paths[0]}: {error}") from None
            for path in paths if remove else ():
                path.unlink(missing_ok=True)
            text = ", ".join(str(each.path) for each in files)
            shown.say(f"{counted(len(sums), 'pass', 'passes')} of {len(paths)} files, wrote {text}")


def _join_tiles(paths: Sequence[Path], outputs: Sequence[Output], shown: MessageFlags, *, partial: bool) -> None:
    """Write the picture that the tiles make up."""
    from ..images.exr import exr_parts
    from ..images.tiles import join_tiles

    if len(outputs) != 1 or outputs[0].path.suffix.lower() != ".exr":
        raise typer.BadParameter("tiles are joined into one file: expected only -o FILE.exr")
    covered, pixels = join_tiles(paths, outputs[0].path, partial=partial)
    if covered < pixels:
        LOG.warning(
            "%s: %s of %s pixels are in no tile and stay black", outputs[0].path, f"{pixels - covered:,}", f"{pixels:,}"
        )
    header = exr_parts(outputs[0].path, header_only=True)[0].header
    (left, top), (right, bottom) = (map(int, corner) for corner in header["displayWindow"])  # NumPy's would overflow
    whole = (right + 1 - left) * (bottom + 1 - top)
    if pixels < whole:
        LOG.warning(
            "%s: %s of %s pixels of the picture are beyond these tiles: expected all tiles, unless it is a crop",
            outputs[0].path, f"{whole - pixels:,}", f"{whole:,}",
        )  # fmt: skip
    shown.say(f"{counted(len(paths), 'tile')} joined, wrote {outputs[0].path}")


def _named(given: Sequence[Path], number: float | None) -> dict[Path, list[Path]]:
    """Return the checkpoints of a frame by the paths that were given, sorted by name within each pattern."""
    paths = [each if number is None else numbered(each, number) for each in given]
    return {path: [path] if path.exists() else [*map(Path, sorted(glob(str(path))))] for path in paths}


def _found(given: Sequence[Path], number: float | None) -> list[Path]:
    """Return the checkpoints of a frame, without repetitions."""
    named = _named(given, number)
    for path, found in named.items():
        if not found:
            raise SceneError(f"{path}: no such file")
    return [*dict.fromkeys(chain(*named.values()))]


def joined(paths: Sequence[Path]) -> FrameSums:
    """Return the sums of all passes in some checkpoints; raise SceneError if they are not of one picture."""
    from ..render.films.frame_sums import FrameSums

    result = FrameSums.load(paths[0])
    for path in paths[1:]:
        more = FrameSums.load(path)
        try:
            result.join(more)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from None
    if not len(result):
        raise SceneError(f"{paths[0]}: has no passes: expected at least one")
    return result


def _check_gaps(sums: FrameSums, path: Path, *, partial: bool) -> None:
    """Refuse a frame that lacks planned passes, or warn about it with `partial`."""
    missing = " and ".join(f"{each.start} to {each.stop - 1}" for each in sums.missing(sums.planned or 0))
    if not missing:
        return
    if not partial:
        raise SceneError(f"{path}: passes {missing} are missing; expected all, or --partial")
    LOG.warning("%s: passes %s are missing", path, missing)
