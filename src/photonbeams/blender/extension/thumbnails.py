"""Pictures of presets by the renderer, which `tools/thumbnails.py` writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy.utils.previews

_FOLDER = Path(__file__).with_name("thumbnails")


class Thumbnails:
    """The pictures, read when they are first shown."""

    def __init__(self) -> None:
        self._previews: Any = None

    def icon_of(self, name: str) -> int:
        """Return the icon of a preset; 0 if it has no picture."""
        if self._previews is None:
            self._previews = bpy.utils.previews.new()
        if name not in self._previews:
            self._previews.load(name, str(_FOLDER / f"{name}.png"), "IMAGE")
        return int(self._previews[name].icon_id)

    def close(self) -> None:
        """Free the pictures."""
        if self._previews is not None:
            bpy.utils.previews.remove(self._previews)
        self._previews = None


THUMBNAILS = Thumbnails()
