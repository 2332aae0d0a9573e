"""`photonbeams steady`: average the frames of a film with their neighbours, so that their noise does not boil."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..images.numbering import numbered
from ..runtime.limits import check_address_space
from .animation import frame_numbers
from .flags import MessageFlags, Quiet
from .outputs import check_different, parse_outputs, prepare_outputs
from .progress import messages


def steady(
    film: Annotated[Path, typer.Argument(help="The .exr of each frame; a run of # stands for the frame number.")],
    frames: Annotated[str, typer.Option("--frames", "-f", metavar="FRAMES", help="Frames, as for `render`.")],
    output: Annotated[
        list[Path],
        typer.Option("--output", "-o", help="File to write: .exr (layered) or .png (tone-mapped); may be repeated."),
    ],
    neighbours: Annotated[
        int, typer.Option("--neighbours", min=1, max=16, help="Number of frames before, and after, that are averaged.")
    ] = 2,
    exposure: Annotated[
        float, typer.Option("--exposure", min=-100, max=100, help="Exposure of .png pictures in stops.")
    ] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Average each frame of a film with its neighbours, so that what denoising leaves of the noise does not boil.

    Neighbours are moved as the camera moves; where something else moves, or the light changes, they do not count.

    For example:

    photonbeams render shot.usda -f 1:96 --denoise -o shot.####.exr

    photonbeams steady shot.####.exr -f 1:96 -o steady.####.exr
    """
    check_address_space()
    from ..images.steady import FilmFrame
    from ..runtime.files import check_kept
    from ..scene import SceneError

    shown = MessageFlags(quiet=quiet)
    outputs = parse_outputs(output, ())
    numbers = [number for number in frame_numbers(frames, outputs) if number is not None]
    known: dict[float, FilmFrame] = {}
    with messages(shown):
        for path in (numbered(film, each) for each in numbers):
            if not path.exists():
                raise SceneError(f"{path}: no such file: expected all frames of the film")
        written = [each.numbered(number).path for number in numbers for each in outputs]
        check_different(written)
        check_kept(written, (numbered(film, each) for each in numbers))
        for index, number in enumerate(numbers):
            window = numbers[max(index - neighbours, 0) : index + neighbours + 1]
            known = {each: known.get(each) or FilmFrame.read(numbered(film, each)) for each in window}
            files = [each.numbered(number) for each in outputs]
            prepare_outputs(files)
            picture = known[number].averaged([known[each] for each in window if each < number],
                                             [known[each] for each in window if each > number])  # fmt: skip
            for each in files:
                picture.write(each.path, exposure)
            shown.say(f"frame {number:.10g}: wrote {', '.join(str(each.path) for each in files)}")
