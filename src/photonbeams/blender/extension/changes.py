"""What has changed since a scene was sent."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Descriptions of prims, as `usd.authoring.prims` of the renderer says.
Prims = list[dict[str, Any]]


class Sent:
    """The prims that a renderer has."""

    def __init__(self) -> None:
        self._prims: dict[str, dict[str, Any]] | None = None  # none yet, not even an empty scene

    def changes(self, prims: Prims) -> dict[str, Any]:
        """Return what makes the renderer's scene these prims, as the content of a message; {}: it is the same."""
        old, new = self._prims, {each["path"]: each for each in prims}
        self._prims = new
        if old is None:
            return {"prims": prims, "whole": True}
        removed = [path for path in old if path not in new]
        written = {path for path, each in new.items() if path not in old or not same(old[path], each)}
        # A prim that is written replaces what is below it.
        changed = [each for each in prims if written & {each["path"], *_parents(each["path"])}]
        return {"prims": changed, "removed": removed} if changed or removed else {}


def _parents(path: str) -> list[str]:
    """Return the paths of the prims that a prim is in."""
    names = path.split("/")
    return ["/".join(names[:count]) for count in range(2, len(names))]


def same(first: Any, second: Any) -> bool:
    """Return whether two descriptions are the same, with arrays of the same bits."""
    if first is second:
        return True
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return isinstance(second, type(first)) and first.dtype == second.dtype and np.array_equal(first, second)
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(same(value, second[name]) for name, value in first.items())
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return bool(first == second)
