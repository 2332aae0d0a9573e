"""Image files of materials and lights; packed and painted images are written to a temporary folder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import bpy


class Images:
    """The files of images.

    Parameters
    ----------
    folder
        Where images without a file are written; made if it is not there.
    """

    def __init__(self, folder: str) -> None:
        self._folder, self._written = Path(folder), dict[str, str]()

    def file_of(self, image: Any) -> str:
        """Return the path of an image's file."""
        path = bpy.path.abspath(image.filepath_raw, library=image.library)
        on_disk = (
            image.source in ("FILE", "TILED", "SEQUENCE", "MOVIE") and not image.is_dirty and not image.packed_file
        )
        if on_disk:
            return path
        if image.name not in self._written:
            suffix = "exr" if image.is_float else "png"
            name = re.sub(r"\W", "_", image.name)
            self._folder.mkdir(exist_ok=True)
            target = self._folder / f"{len(self._written)}_{name}.{suffix}"
            if image.packed_file is not None and not image.is_dirty and Path(path).suffix:
                target = target.with_suffix(Path(path).suffix)
                target.write_bytes(image.packed_file.data)
            else:
                image.save(filepath=str(target), save_copy=True)
            self._written[image.name] = str(target)
        return self._written[image.name]
