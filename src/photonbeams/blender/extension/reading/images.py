"""Image files of materials and lights; packed and painted images are written to a temporary folder."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import bpy

from .exr import exr_of

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
        self._folder, self._written, self._count = Path(folder), dict[str, str](), 0

    def file_of(self, image: Any) -> str:
        """Return the path of an image's file."""
        path = bpy.path.abspath(image.filepath_raw, library=image.library)
        on_disk = (
            image.source in ("FILE", "TILED", "SEQUENCE", "MOVIE") and not image.is_dirty and not image.packed_file
        )
        if on_disk:
            return path
        if image.name_full not in self._written:
            suffix = "exr" if image.is_float else "png"
            name = re.sub(r"\W", "_", image.name)
            self._folder.mkdir(exist_ok=True)
            target = self._folder / f"{self._count}_{name}.{suffix}"  # another one after each change
            self._count += 1
            if image.packed_file is not None and not image.is_dirty and Path(path).suffix:
                target = target.with_suffix(Path(path).suffix)
                target.write_bytes(image.packed_file.data)
            else:
                image.save(filepath=str(target), save_copy=True)
            self._written[image.name_full] = str(target)
        return self._written[image.name_full]

    def written(self, pixels: Any, name: str) -> str:
        """Return the path of an EXR of scene-linear pixels (H, W, 3), from the top row down."""
        return self.stored(exr_of(pixels), name, ".exr")

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
