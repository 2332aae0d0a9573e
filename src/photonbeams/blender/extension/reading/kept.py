"""What is not read again while it does not change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import bpy

from .images import Images
from .prims import Values
from .volumes import GridFiles

# What values of nodes depend on.
_SHADED = (bpy.types.Material, bpy.types.World, bpy.types.NodeTree, bpy.types.Image, bpy.types.Texture)


class Kept:
    """Meshes, files of images and grids, and what is made of nodes, that stay from one reading of a scene to the next.

    Parameters
    ----------
    folder
        Where images and grids without a file are written.
    """

    def __init__(self, folder: str) -> None:
        self.images = Images(folder)
        self.grids = GridFiles(self.images)
        #: By an object's name and its data's number: the attributes and the faces of its mesh; None if it has none.
        self.meshes: dict[tuple[str, int], tuple[Values, dict[int, Any]] | None] = {}
        self._made: dict[Any, Any] = {}

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return what was made of materials or worlds for a key, and make it the first time."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def forget(self, updates: Iterable[Any]) -> None:
        """Forget what has changed, by the updates of a depsgraph."""
        for each in updates:
            changed = each.id.original
            if isinstance(changed, _SHADED):
                self._made.clear()
            if isinstance(changed, bpy.types.Image):
                self.images.forget(changed)
            elif each.is_updated_geometry:
                name, number = changed.name_full, changed.session_uid
                self.grids.forget(name, number)
                self.meshes = {key: mesh for key, mesh in self.meshes.items() if name != key[0] and number != key[1]}
