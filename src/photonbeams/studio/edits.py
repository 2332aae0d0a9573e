"""Edits of a stage: values in a layer over it, step by step, with undo and redo."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..runtime.files import PathLike
from ..scene import SceneError
from ..usd.editing import EMPTY, EditLayer

# Steps that can be undone.
_MOST = 500


class Edits:
    """A layer of values over a stage.

    Parameters
    ----------
    layer
        The layer over the stage that takes the values.
    path
        The file that the layer is written to by `save`; what it has already is laid over the stage.

    Raises
    ------
    SceneError
        A file that cannot be read as USD.
    """

    def __init__(self, layer: EditLayer, path: PathLike | None = None) -> None:
        self._layer, self.path = layer, None if path is None else Path(path)
        if self.path is not None and self.path.exists():
            layer.load(self.path)
        self._past: list[str] = []
        self._future: list[str] = []
        self._step: str | None = None
        self._saved = layer.text()

    def set(self, values: Mapping[str, Any], step: str | None = None) -> None:
        """Set values by their paths, "/Prim.attribute"; None leaves the value to the stage again.

        Edits of one `step` in a row are undone at once, as those of a drag.

        Raises
        ------
        SceneError
            A prim or an attribute that is not there, or a value of another type; nothing is set then.
        """
        before = self._layer.text()
        try:
            for path, value in values.items():
                self._layer.set(path, value)
        except SceneError:
            self._layer.replace(before)
            raise
        if step is None or step != self._step:
            self._past = [*self._past[-_MOST + 1 :], before]
        self._step, self._future = step, []

    def undo(self) -> bool:
        """Undo the last step; return whether there was one."""
        return self._moved(self._past, self._future)

    def redo(self) -> bool:
        """Do again what was undone last; return whether there was something."""
        return self._moved(self._future, self._past)

    def revert(self) -> None:
        """Leave all values to the stage again, as one step."""
        self._past.append(self._layer.text())
        self._step, self._future = None, []
        self._layer.replace(EMPTY)

    def _moved(self, source: list[str], target: list[str]) -> bool:
        if not source:
            return False
        target.append(self._layer.text())
        self._layer.replace(source.pop())
        self._step = None
        return True

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to undo."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether there is a step to do again."""
        return bool(self._future)

    @property
    def is_saved(self) -> bool:
        """Whether the file has all edits; with no file, whether there are none."""
        return self._layer.text() == self._saved

    def paths(self) -> list[str]:
        """Return the paths of what has a value in the layer."""
        return self._layer.paths()

    def text(self) -> str:
        """Return the layer as .usda."""
        return self._layer.text()

    def save(self, path: PathLike | None = None) -> Path:
        """Write the layer, whole or not at all, and return its file.

        Raises
        ------
        SceneError
            No file is known.
        OSError
            The file cannot be written.
        """
        target = self.path if path is None else Path(path)
        if target is None:
            raise SceneError("the edits have no file: expected the path of a .usda layer")
        self._layer.write(target)
        self.path, self._saved = target, self._layer.text()
        return target
