"""Image files of materials and lights; packed and painted images are written to a temporary folder."""

from __future__ import annotations

import hashlib
import re
import struct
from itertools import count
from pathlib import Path
from typing import Any

import bpy
import numpy as np

#: What Blender shows in place of an image whose file is missing.
MISSING = (1.0, 0.0, 1.0)


def is_missing(image: Any) -> bool:
    """Return whether the file of an image does not exist."""
    if image.source != "FILE" or image.packed_file is not None or image.is_dirty or image.has_data:
        return False
    return not Path(bpy.path.abspath(image.filepath_raw, library=image.library)).is_file()


class Images:
    """The files of images.

    Parameters
    ----------
    folder
        Where images without a file are written; made if it is not there.
    """

    def __init__(self, folder: str) -> None:
        self._folder, self._written, self._count = Path(folder), dict[str, str](), count()

    def file_of(self, image: Any) -> str:
        """Return the path of an image's file."""
        path = str(bpy.path.abspath(image.filepath_raw, library=image.library))
        packed: Any = image.packed_file if not image.is_dirty else None
        if image.source in ("FILE", "TILED", "SEQUENCE", "MOVIE") and not image.is_dirty and packed is None:
            return path
        if image.name_full not in self._written:
            suffix = "" if packed is None else Path(path).suffix
            written = suffix or (".exr" if image.is_float else ".png")
            target = self.numbered(re.sub(r"\W", "_", image.name) + written)
            if suffix:
                Path(target).write_bytes(packed.data)
            else:
                image.save(filepath=target, save_copy=True)
            self._written[image.name_full] = target
        return self._written[image.name_full]

    def numbered(self, name: str) -> str:
        """Return the path of a file that is to be written: another one each time."""
        self._folder.mkdir(exist_ok=True)
        return str(self._folder / f"{next(self._count)}_{name}")

    def written(self, pixels: Any, name: str) -> str:
        """Return the path of a TIFF of scene-linear pixels (H, W, 3), from the top row down."""
        return self.stored(_tiff(pixels), name, ".tif")

    def stored(self, content: bytes, name: str, suffix: str) -> str:
        """Return the path of a file of this content."""
        target = self._folder / f"{name}_{hashlib.sha256(content).hexdigest()[:16]}{suffix}"
        if not target.exists():
            self._folder.mkdir(exist_ok=True)
            target.write_bytes(content)
        return str(target)

    def forget(self, image: Any) -> None:
        """Forget the file of an image that has changed."""
        self._written.pop(image.name_full, None)


def _tiff(pixels: Any) -> bytes:
    """Return the content of a TIFF 6.0 of pixels (H, W, 3): one strip of 32-bit floats without compression."""
    height, width, channels = pixels.shape
    data = np.ascontiguousarray(pixels, "<f4").tobytes()
    head = 8 + 2 + 12 * 10 + 4
    # The size, 32 bits that are not compressed, RGB, the place of the strip, its size, and that it has floats.
    tags = {
        256: width, 257: height, 258: 32, 259: 1, 262: 2, 273: head, 277: channels, 278: height, 279: len(data), 339: 3,
    }  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    return struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(4) + data
