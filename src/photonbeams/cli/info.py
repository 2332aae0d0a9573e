"""`photonbeams info`: show what a stage, a picture or a volume file holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from ..runtime.inputs import opened
from ..runtime.limits import check_address_space
from ..scene import Array, SceneError
from ..volumes.vdb import VDBGrid, read_grids
from ..volumes.vol import read_vol
from .facts.words import triple
from .flags import MessageFlags, SessionLayers
from .progress import messages, standard_output, table_of

if TYPE_CHECKING:
    from rich.console import Console

STAGES = (".usd", ".usda", ".usdc", ".usdz")
VOLUMES = (".vdb", ".vol")
VOLUME_COLUMNS = ("grid", "type", "class", "voxels", "box", "from", "voxel size", "range", "dense", "compression")
_MOST_TEXT = 300
_NO_NEWS = ("channels", "chunkCount", "lineOrder", "name", "type", "view", "screenWindowCenter", "screenWindowWidth")


def info(
    scene: Annotated[Path, typer.Argument(help="A stage, an image, or a volume file.")],
    session_layer: SessionLayers = None,
) -> None:
    """Show what a USD stage, an image or a volume file holds.

    For a stage: units, frames, fog, cameras, lights, what their light does, looks, meshes, and why the picture would be
    dark or blurred, with what to type against it. For an image: its parts with their views, channels, sizes, ranges and
    NaNs, and its headers. For a .vdb or .vol file: its grids with their types, boxes of active voxels, ranges of
    values, and the memory of the box.

    What a render would cost is told by photonbeams render --estimate.
    """
    console = standard_output()
    if scene.suffix.lower() in STAGES:
        check_address_space()
        with messages(MessageFlags()):
            _show_stage(console, scene, session_layer or ())
    elif session_layer:
        raise typer.BadParameter(f"--session-layer is for stages, but {scene} is not one: expected {', '.join(STAGES)}")
    elif scene.suffix.lower() == ".xml":
        raise typer.BadParameter(f"{scene} is a Mitsuba scene: expected a stage, an image or a volume file")
    elif scene.suffix.lower() in VOLUMES:
        console.print(table_of(VOLUME_COLUMNS, volume_rows(scene)))
    else:
        _show_image(console, scene)


# -- images ----------------------------------------------------------------------------------------------------------


def _show_image(console: Console, path: Path) -> None:
    from ..images.exr import deep_sizes
    from ..images.files import summaries

    parts = summaries(path)
    stereo, deep = any(part.view for part in parts), any(part.nans is None for part in parts)
    sizes = deep_sizes(path) if deep else [0] * len(parts)
    rows = []
    for part, size in zip(parts, sizes, strict=True):
        channels = " ".join(part.channels) if max(map(len, part.channels)) > 1 else "".join(part.channels)
        types = ", ".join(dict.fromkeys(part.types))
        if part.nans is None:
            types += f"; deep, {size // sum(2 if each == 'half' else 4 for each in part.types):,} samples"
        names = (part.layer, part.view) if stereo else (part.layer,)
        ranges = ("-" if value is None else f"{value:.5g}" for value in (part.least, part.mean, part.greatest))
        counts = ("-" if count is None else f"{count:,}" for count in (part.nans, part.infinite))
        rows.append((*names, channels, types, f"{part.width} x {part.height}", *ranges, *counts))
    columns = ("layer", *(["view"] if stereo else []), "channels", "type", "size", "min", "mean", "max")
    console.print(table_of((*columns, "NaN", "infinite"), rows, right=5))
    header = _header_rows(path) if path.suffix.lower() == ".exr" else []
    if header:
        console.print()
        console.print(table_of(None, header))


def _header_rows(path: Path) -> list[tuple[str, str]]:
    """Return the attributes of each view's first part, without those that describe the layout of the file.

    An attribute that is the same in all views is listed once; others, such as matrices, are listed for each view.
    """
    from ..images.exr import exr_parts

    headers: dict[str, dict[str, str]] = {}
    for part in exr_parts(path, header_only=True):
        texts = {name: _text(value) for name, value in part.header.items() if name not in _NO_NEWS}
        texts |= {name: _shortened(text) for name, text in texts.items() if name.endswith("/manifest")}
        headers.setdefault(str(part.header.get("view", "")), texts)
    rows: list[tuple[str, str]] = []
    for name in sorted({name for header in headers.values() for name in header}):
        texts = {view: header[name] for view, header in headers.items() if name in header}
        if len(texts) == len(headers) and len(set(texts.values())) == 1:
            rows.append((name, next(iter(texts.values()))))
        else:
            rows += [(f"{name} {view}".rstrip(), text) for view, text in texts.items()]
    return rows


def _shortened(text: str) -> str:
    """Return the beginning of a long text, such as a cryptomatte's list of thousands of names."""
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}..."


def _text(value: object) -> str:
    """Return a readable text for a header's value: matrices as rows, windows as corners."""
    if isinstance(value, tuple | list):
        return ", ".join(_text(each) for each in value)
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return " ".join(f"{number:g}" for number in value)
    if isinstance(value, np.ndarray):
        return "\n".join(" ".join(f"{number:9.5g}" for number in row) for row in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(getattr(value, "name", value))


# -- stages ----------------------------------------------------------------------------------------------------------


def _show_stage(console: Console, path: Path, layers: Sequence[Path]) -> None:
    from .facts.stages import tables

    for index, (columns, rows) in enumerate(tables(path, layers)):
        if rows:
            if index:
                console.print()
            console.print(table_of(columns, rows))


# -- volumes --------------------------------------------------------------------------------------------------------


def volume_rows(path: Path) -> list[tuple[str, ...]]:
    """Return a row for each grid of a file; SceneError if it cannot be read."""
    try:
        with opened(path) as file:
            if path.suffix.lower() == ".vdb":
                return [_grid_row(each) for each in read_grids(file)]
            voxels = read_vol(file)
    except SceneError as error:
        raise SceneError(f"{path}: expected a grid that can be read, but {error}") from None
    values, size = voxels.values, np.abs(np.diag(voxels.to_file)[:3])
    shape = np.array(values.shape[2::-1])
    kind = "float" if values.ndim == 3 else "vec3s"
    return [
        ("", kind, "", f"{np.prod(shape):,}", _times(shape), triple(voxels.to_file[:3, 3]), triple(size / shape),
         _range([values]), _memory(values.nbytes), "none")
    ]  # fmt: skip


def _grid_row(grid: VDBGrid) -> tuple[str, ...]:
    kind = grid.type + (", half" if grid.half else "")
    word = str(grid.metadata.get("class", ""))
    size = "frustum" if grid.to_file is None else triple(np.linalg.norm(grid.to_file[:3, :3], axis=0))
    row = [grid.name, kind, word, "none", "", "", size, "", "", grid.codec]
    try:
        tree = grid.tree
    except SceneError:  # points and text have no voxels
        row[3] = "not read"
        return tuple(row)
    if tree.box is not None:
        low, high = tree.box
        count = high - low + 1
        row[3:6] = f"{tree.active_voxels:,}", _times(count), " ".join(str(each) for each in low)
        parts = [values[masks] for _, masks, values in tree.leaves()]
        parts += [tile.value for tile in tree.tiles if tile.active]
        row[7:9] = _range(parts), _memory(4 * tree.channels * float(np.prod(count.astype(np.float64))))
    return tuple(row)


def _range(parts: list[Array]) -> str:
    """Return a text with the least and the greatest value."""
    some = [part for part in parts if part.size]
    return f"{min(part.min() for part in some):.5g} to {max(part.max() for part in some):.5g}" if some else ""


def _times(counts: Array) -> str:
    return " x ".join(str(each) for each in counts)


def _memory(size: float) -> str:
    return f"{size / 1e6:,.1f} MB" if size >= 1e5 else f"{size / 1e3:,.1f} kB"
