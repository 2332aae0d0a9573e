"""Tiles: EXRs of parts of one picture, which are joined."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from ..runtime.files import PathLike, write_bytes
from ..scene import Array, SceneError
from .exr import exr_parts
from .files import MOST_PIXELS
from .writing import encoded_parts

_SAME = ("seed", "frame", "worldToCamera", "worldToNDC")  # attributes of a frame, not of its tiles

Box = tuple[int, int, int, int]  # x0, y0, x1, y1, the last pixel not included


def join_tiles(paths: Sequence[Path], output: PathLike, *, partial: bool = False) -> tuple[int, int]:
    """Join tiles into one picture and write it; return how many of its pixels they cover, and how many it has.

    The header is that of the first tile, with a data window around all of them, and with what any of them lacks, which
    is `missing`. Pixels that no tile covers are black.

    Raises
    ------
    SceneError
        A file that is no EXR; tiles with other display windows, layers, seeds, frames or cameras than the first; tiles
        that overlap; gaps between tiles, unless `partial`.
    OSError
        A file that cannot be read or written.
    """
    headers = [exr_parts(path, header_only=True) for path in paths]
    for path, parts in zip(paths, headers, strict=True):
        _check(path, parts, paths[0], headers[0])
    boxes = [_box(parts[0].header) for parts in headers]
    whole = min(b[0] for b in boxes), min(b[1] for b in boxes), max(b[2] for b in boxes), max(b[3] for b in boxes)
    columns, rows = whole[2] - whole[0], whole[3] - whole[1]
    if columns * rows > MOST_PIXELS:
        raise SceneError(f"{output}: the tiles span {columns} x {rows} pixels: expected up to {MOST_PIXELS:,}")
    covered = np.zeros((rows, columns), dtype=bool)
    joined: list[dict[str, Array]] = []
    for path, box in zip(paths, boxes, strict=True):
        place = np.s_[box[1] - whole[1] : box[3] - whole[1], box[0] - whole[0] : box[2] - whole[0]]
        if covered[place].any():
            raise SceneError(f"{path}: covers what another tile covers: expected parts that do not overlap")
        covered[place] = True
        parts = exr_parts(path)  # one at a time, since all of them may not fit into memory
        if not joined:
            like = [part.channels.items() for part in parts]
            joined = [{name: np.zeros(covered.shape, each.pixels.dtype) for name, each in kinds} for kinds in like]
        for part, into in zip(parts, joined, strict=True):
            for name, channel in part.channels.items():
                if channel.pixels.dtype != into[name].dtype or channel.pixels.shape != covered[place].shape:
                    text = f"its layer {part.name()} is stored in another way than in {paths[0]}, or at another size"
                    raise SceneError(f"{path}: {text}: expected tiles of one picture")
                into[name][place] = channel.pixels
    if len({repr(parts[0].header.get("passes")) for parts in headers}) > 1:
        text = "%s: its tiles have different numbers of passes, so that their noise differs"
        logging.getLogger("photonbeams").warning(text, output)
    if not covered.all() and not partial:
        text = f"{covered.size - int(covered.sum()):,} of {covered.size:,} pixels are in no tile"
        raise SceneError(f"{output}: {text}: expected all tiles, or --partial")
    window = (np.array(whole[:2], dtype=np.int32), np.array(whole[2:], dtype=np.int32) - 1)
    lacked = dict.fromkeys(str(each) for parts in headers for each in parts[0].header.get("missing", ()))
    about = {"dataWindow": window, **({"missing": [*lacked]} if lacked else {})}
    files = [
        OpenEXR.Part({**part.header, **about}, channels, part.name())
        for part, channels in zip(headers[0], joined, strict=True)
    ]
    write_bytes(output, encoded_parts(output, files))
    return int(covered.sum()), covered.size


def _box(header: dict[str, Any]) -> Box:
    (x0, y0), (x1, y1) = (map(int, each) for each in header["dataWindow"])
    return x0, y0, x1 + 1, y1 + 1


def _check(path: Path, parts: Sequence[OpenEXR.Part], first: Path, like: Sequence[OpenEXR.Part]) -> None:
    """Raise SceneError if a file is no tile of the picture of which the first file is one."""
    if any(part.type() in (OpenEXR.deepscanline, OpenEXR.deeptile) for part in parts):
        text = "tiles of deep pictures are not joined: expected --pass-range instead of --tile"
        raise SceneError(f"{path}: is a deep picture, and {text}")
    if _kind(parts) != _kind(like):
        raise SceneError(f"{path}: has other layers or another display window than {first}: expected its tiles")
    if any(_box(each.header) != _box(parts[0].header) for each in parts):
        raise SceneError(f"{path}: its layers have several data windows: expected one, as in tiles of a picture")
    for name in _SAME:
        if repr(parts[0].header.get(name)) != repr(like[0].header.get(name)):
            other = f"another {name} than" if name in parts[0].header else f"no {name}, unlike"
            raise SceneError(f"{path}: has {other} {first}: expected tiles of one picture")


def _kind(parts: Sequence[OpenEXR.Part]) -> Any:
    """Return what tiles of one picture must have in common."""
    return [
        (
            part.name(), repr(part.header["channels"]), part.header["pixelAspectRatio"],
            [tuple(map(int, each)) for each in part.header["displayWindow"]],
        )
        for part in parts
    ]  # fmt: skip
