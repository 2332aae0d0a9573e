"""Where a frame goes: the files that `--output` and `--picture` name, and the layers in them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from ..shot.shot import Frame


@dataclass(frozen=True)
class Output:
    """A file to write, and the layer that it shows; an .exr holds the layers chosen by `--layers`."""

    path: Path
    layer: str = "rgba"

    def numbered(self, frame: float) -> Output:
        """Return the output of a frame: the run of # in its name is the number, padded."""
        padded = "%g" if frame != int(frame) else "%0{}d"
        name = re.sub("#+", lambda run: padded.format(len(run[0])) % frame, self.path.name)
        return replace(self, path=self.path.with_name(name))


def parse_outputs(files: Iterable[Path], pictures: Iterable[str]) -> list[Output]:
    """Return the outputs that flags name, not yet numbered."""
    outputs = [Output(_checked("--output", path, (".exr", ".png"))) for path in files]
    for text in pictures:
        layer, _, name = text.partition("=")
        if not layer or not name:
            raise typer.BadParameter(f"--picture is {text}: expected LAYER=FILE.png, such as beams=beams.png")
        outputs.append(Output(_checked("--picture", Path(name), (".png",)), layer))
    seen: set[Path] = set()
    for output in outputs:
        place = output.path.absolute()
        if place in seen:
            raise typer.BadParameter(f"{output.path} is named twice: expected a file for each output")
        seen.add(place)
    return outputs


def _checked(flag: str, path: Path, suffixes: Sequence[str]) -> Path:
    if path.suffix.lower() not in suffixes:
        raise typer.BadParameter(f"{flag} is {path}: expected a name that ends in {' or '.join(suffixes)}")
    if os.fsencode(path).decode("utf-8", "ignore") != str(path):  # OpenEXR takes no other names
        raise typer.BadParameter(f"{flag} is {str(path)!r}: expected a name in UTF-8")
    if len(re.findall("#+", path.name)) > 1:
        raise typer.BadParameter(f"{flag} is {path}: expected one run of # for the frame number")
    return path


def chosen_layers(text: str | None, outputs: Iterable[Output], names: Sequence[str]) -> list[str]:
    """Return which of the frame's layers `--layers` leaves in an .exr; refuse what the frame will not have."""
    wanted = [name.strip() for name in text.split(",")] if text is not None else list(names)
    for flag, asked in (("--layers", wanted), ("--picture", [output.layer for output in outputs])):
        for name in asked:
            if name not in names:
                raise typer.BadParameter(f"{flag} names '{name}': expected one of the layers {', '.join(names)}")
    return [name for name in names if name in {"rgba", *wanted}]


def prepare_outputs(outputs: Iterable[Output]) -> None:
    """Raise OSError, before hours of rendering, for a file that could not be written; leave no trace."""
    from ..shot.images import prepare_output

    for output in outputs:
        prepare_output(output.path)


def write_outputs(frame: Frame, outputs: Iterable[Output], layers: Iterable[str], exposure: float) -> None:
    """Write all files or, where one cannot be written, none."""
    from ..shot.images import atomic_path

    layered = replace(frame, layers={name: frame.layers[name] for name in layers})
    with ExitStack() as stack:
        places = [(output, stack.enter_context(atomic_path(output.path))) for output in outputs]
        for output, beside in places:
            source = layered if beside.suffix.lower() == ".exr" else frame
            source.write(beside, layer=output.layer, exposure=exposure)
