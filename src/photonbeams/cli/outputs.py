"""The output files of frames, named by flags or render products, and the layers in them."""

from __future__ import annotations

import logging
import os
import shlex
import sys
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..constants import is_number, layers_named
from ..images.numbering import PLACEHOLDER, numbered, numbering_problem

if TYPE_CHECKING:
    from ..scene import Array
    from ..shot.shot import Frame
    from .flags import MessageFlags, PassFlags
    from .request import RenderRequest


_LONGEST_NAME = 255  # bytes, on most file systems
_PICTURES = (b"\x76\x2f\x31\x01", b"\x89PNG")  # what an .exr and a .png begin with


@dataclass(frozen=True)
class Output:
    """A file to write. If `variables` are empty, an .exr holds the layers of `--layers`, a picture `layer`."""

    path: Path
    layer: str = "rgba"  # which a picture shows
    variables: tuple[str, ...] = ()  # layers that a render product asks for
    single_part: bool = False  # whether an .exr holds all layers in one part
    deep: bool = False  # whether an .exr is a deep picture of the beams

    def numbered(self, frame: float) -> Output:
        """Return the output of a frame, with its padded number for the run of # in the name."""
        return replace(self, path=numbered(self.path, frame))

    def exists(self) -> bool:
        """Return whether the file exists and is not empty."""
        return self.path.is_file() and self.path.stat().st_size > 0

    def shown(self, names: Collection[str]) -> str:
        """Return the layer of `names` that a picture shows: the first one with colours."""
        found = [name for name in self.variables if name in names] or [self.layer]
        return next((name for name in found if not is_number(name)), found[0])


@dataclass
class PictureExposure:
    """The exposure of pictures in stops, the same for all frames; None until the first frame has chosen it."""

    stops: float | None

    def of(self, pixels: Array, shown: MessageFlags) -> float:
        """Return the exposure; if there is none yet, choose it for this picture and print it."""
        if self.stops is None:
            from ..images.display import exposure_of

            self.stops = exposure_of(pixels)
            shown.say(f"chose an exposure of {self.stops:g} stops, as with --exposure {self.stops:g}")
        return self.stops


def parse_outputs(
    files: Iterable[Path], pictures: Iterable[str], deep: Path | None = None, *, single_part: bool = False
) -> list[Output]:  # fmt: skip
    """Return the outputs that flags name, not yet numbered."""
    outputs = [Output(checked_path("--output", path, (".exr", ".png")), single_part=single_part) for path in files]
    for text in pictures:
        layer, _, name = text.partition("=")
        if not layer or not name:
            raise typer.BadParameter(f"--picture is {text}: expected LAYER=FILE.png, such as beams=beams.png")
        outputs.append(Output(checked_path("--picture", Path(name), (".png",)), layer))
    if deep is not None:
        outputs.append(Output(checked_path("--deep", deep, (".exr",)), deep=True))
    check_different([each.path for each in outputs])
    return outputs


def check_different(paths: Iterable[Path]) -> None:
    """Refuse files to write of which two are one, by their names or by a link."""
    from ..runtime.files import place_of

    seen = dict[object, Path]()
    for path in paths:
        if (other := seen.setdefault(place_of(path), path)) is not path:
            text = f"{path} is named twice" if path == other else f"{path} is {other}, by a link or another name"
            raise typer.BadParameter(f"{text}: expected a different file for each output")


def part_outputs(files: Iterable[Path]) -> list[Output]:
    """Return the output for a range of passes, not yet numbered."""
    outputs = [Output(checked_path("--output", path, (".checkpoint",))) for path in files]
    if len(outputs) != 1:
        raise typer.BadParameter("--pass-range writes a checkpoint: expected exactly one output, -o FILE.checkpoint")
    return outputs


def checked_path(flag: str, path: Path, suffixes: Sequence[str]) -> Path:
    """Return the path that a flag gives; refuse other suffixes, names not in UTF-8, and several runs of #."""
    if path.suffix.lower() not in suffixes:
        raise typer.BadParameter(f"{flag} is {path}: expected a name that ends in {' or '.join(suffixes)}")
    if os.fsencode(path).decode("utf-8", "ignore") != str(path):  # OpenEXR takes no other names
        raise typer.BadParameter(f"{flag} is {str(path)!r}: expected a name in UTF-8")
    if problem := numbering_problem(path):
        raise typer.BadParameter(f"{flag} is {path}: {problem}")
    return path


def check_product(path: Path, where: str, *, anywhere: bool = False) -> None:
    """Refuse a render product on a device, over a file that is no picture or, unless `anywhere`, outside this folder.

    Stages name their products, and a stage may come from a stranger.
    """
    from ..scene import SceneError

    target, folder = Path(os.path.realpath(path)), Path.cwd().resolve()
    if not (anywhere or target.is_relative_to(folder)):
        expected = "expected --allow-paths, --render-settings, or -o FILE"
        raise SceneError(f"{where} is '{path}', which is outside the working folder: {expected}")
    expected = "expected another name, or -o FILE"
    if target.exists() and not target.is_file():
        raise SceneError(f"{where} is '{path}', which is not a regular file: {expected}")
    if (head := _beginning(target)) and not head.startswith(_PICTURES):
        raise SceneError(f"{where} is '{path}', which exists and is not a picture: {expected}")


def check_outputs(outputs: Collection[object]) -> None:
    """Refuse a render without any output."""
    if not outputs:
        raise typer.BadParameter("expected at least one output: -o FILE.exr, -o FILE.png or --picture LAYER=FILE.png")


def check_placeholders(outputs: Iterable[Output], frames: int, digits: int) -> None:
    """Refuse outputs whose names would not differ between frames, which may have decimals (`digits` of them)."""
    if frames < 2:
        return
    wanted = "####" + "." * (digits > 0) + "#" * digits
    for output in outputs:
        found = PLACEHOLDER.search(output.path.name)
        if not found:
            raise typer.BadParameter(
                f"the output {output.path} is one file for {frames:,} frames: expected one run of # in its name, such "
                f"as {output.path.stem}.{wanted}{output.path.suffix}"
            )
        if len(found[0].partition(".")[2]) < digits:
            raise typer.BadParameter(
                f"the output {output.path} has too few digits for the frames: expected {wanted} in its name"
            )


def named_layers(text: str) -> list[str]:
    """Return the layers that the value of `--layers` names."""
    return [layer for name in text.split(",") for layer in layers_named(name.strip())]


def chosen_layers(text: str | None, outputs: Iterable[Output], names: Sequence[str]) -> list[str]:
    """Return the layers that an .exr keeps, by `--layers`; refuse layers that the frame will not have."""
    wanted = named_layers(text) if text is not None else list(names)
    for flag, asked in (("--layers", wanted), ("--picture", [output.layer for output in outputs])):
        for name in asked:
            if name not in names:
                raise typer.BadParameter(f"{flag} names '{name}': expected one of the layers {', '.join(names)}")
    _check_pictures(outputs, names)
    unknown = [name for output in outputs for name in output.variables if name not in names]
    for name in dict.fromkeys(unknown):
        logging.getLogger("photonbeams").warning(
            "a render product asks for '%s', which is not a layer: expected %s", name, ", ".join(names)
        )
    return [name for name in names if name in {"rgba", *wanted}]


def _check_pictures(outputs: Iterable[Output], names: Collection[str]) -> None:
    """Refuse pictures of layers without colours, before hours of rendering."""
    from ..scene import SceneError

    for output in outputs:
        shown = output.shown(names)
        if output.path.suffix.lower() != ".png" or not is_number(shown):
            continue
        text = f"'{shown}', which has no colours: expected another layer, or an .exr"
        if output.variables:
            raise SceneError(f"the render product {output.path} shows {text}")
        raise typer.BadParameter(f"--picture names {text}")


def prepare_outputs(outputs: Iterable[Output]) -> None:
    """Raise OSError for a file that cannot be written, before hours of rendering; leave no trace."""
    from ..runtime.files import try_path

    for output in outputs:
        try_path(output.path)


def write_outputs(
    frame: Frame, outputs: Iterable[Output], layers: Sequence[str], exposure: float, *, chosen: bool = False
) -> None:  # fmt: skip
    """Write all files, with the command line in their headers; if one cannot be written, write none.

    An .exr holds `layers` and, unless the user has `chosen` them, the frame's other layers. A render product holds only
    the layers that it asks for.
    """
    from ..runtime.files import atomic_path, write_bytes

    names = layers if chosen else [*dict.fromkeys([*layers, *frame.layers])]
    # The command line's text is UTF-8, whatever the encoding of file names.
    command = shlex.join(["photonbeams", *sys.argv[1:]]).encode("utf-8", "replace").decode("utf-8")
    for metadata in [frame.metadata, *(each for _, each in frame.views.values())]:
        metadata["commandLine"] = command
    with ExitStack() as stack:
        places = [(output, stack.enter_context(atomic_path(output.path))) for output in outputs]
        for output, beside in places:
            if output.deep:
                write_bytes(beside, frame.encoded_deep(output.path))
                continue
            shown = output.shown({*frame.layers, *layers})
            every = chosen or not output.variables
            kept = [name for name in names if every or name in ("rgba", *output.variables)]
            held = _holding(frame, kept if beside.suffix.lower() == ".exr" else [shown])
            write_bytes(beside, held.encoded(output.path, shown, exposure, single_part=output.single_part))


def _holding(frame: Frame, names: Sequence[str]) -> Frame:
    """Return a frame with only these layers.

    Light groups that an earlier frame had and this one lacks are black: which groups a function emits is not known
    beforehand.
    """
    import numpy as np

    def chosen(layers: dict[str, Array]) -> dict[str, Array]:
        return {name: layers[name] if name in layers else np.zeros_like(layers["beams"]) for name in names}

    views = {eye: (chosen(layers), metadata) for eye, (layers, metadata) in frame.views.items()}
    return replace(frame, layers=chosen(frame.layers), views=views)


def write_frame(frame: Frame, outputs: Sequence[Output], request: RenderRequest, kept: Sequence[str]) -> None:
    """Write the files of a frame, as the flags ask."""
    exposure = request.files.exposures.of(frame.layers["rgba"], request.shown)
    write_outputs(frame, outputs, kept, exposure, chosen=request.files.layers is not None)


def finish_frame(frame: Frame, outputs: Sequence[Output], request: RenderRequest, kept: Sequence[str]) -> None:
    """Write the files of a finished frame; remove its snapshots and the checkpoint that it used."""
    write_frame(frame, outputs, request, kept)
    for path in _beside(outputs, request.passes):
        path.unlink(missing_ok=True)


def check_beside(outputs: Sequence[Output], passes: PassFlags) -> None:
    """Refuse a file of another program in the place of the checkpoint or a snapshot, which are removed at the end."""
    from ..scene import SceneError

    for path in _beside(outputs, passes):
        head = _beginning(path)
        if head and not (head.startswith(_PICTURES[1]) or b"photonbeams" in head or b"about.npy" in head[:64]):
            kind = "checkpoint" if path.suffix == ".checkpoint" else "snapshot"
            raise SceneError(f"{path} would be removed: expected a {kind} of photonbeams, or another --output")


def _beginning(path: Path) -> bytes:
    """Return the first bytes of a file; none if there is no such file."""
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(1 << 16)


def _beside(outputs: Sequence[Output], passes: PassFlags) -> list[Path]:
    """Return the files of an unfinished frame: its snapshots, and the checkpoint if it uses one."""
    used = [checkpoint_of(outputs)] if passes.resume or passes.checkpoint is not None else []
    return [*used, *(each.path for each in snapshots_of(outputs))]


def checkpoint_of(outputs: Sequence[Output]) -> Path:
    """Return the path of a frame's checkpoint, beside its first output."""
    return _named(outputs[0].path, ".checkpoint")


def snapshots_of(outputs: Sequence[Output]) -> list[Output]:
    """Return the outputs for an unfinished frame: beside its own, because those would count as finished.

    Deep pictures have none: their samples are those of one of the last passes.
    """
    return [replace(each, path=_named(each.path, f".snapshot{each.path.suffix}")) for each in outputs if not each.deep]


def _named(path: Path, end: str) -> Path:
    """Return the path of a file beside an output; of a long name it has the last part, in which frames differ."""
    stem = os.fsencode(path.stem)[len(end) - _LONGEST_NAME :].decode(errors="ignore")
    return path.with_name(stem + end)
