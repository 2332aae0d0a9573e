"""A shot while its shutter is open: the stage read at any fraction of it, and what is at rest kept as it was."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from ..scene import Camera, Scene

T = TypeVar("T")


def followed(first: Scene, later: Scene) -> Scene:
    """Return a later state of a scene with the prims of the first one, in their order, for beams to be followed.

    What is equal is the same object in both, by which the renderer knows what is at rest. A prim that is not there
    later stays as it was; one that is new is left for the next frame.
    """
    parts: dict[str, Any] = {
        name: _matched(getattr(first, name), getattr(later, name)) for name in ("meshes", "lights", "drawn")
    }
    medium = first.medium if later.medium is None or equal(first.medium, later.medium) else later.medium
    if medium is first.medium and all(parts[name] is getattr(first, name) for name in parts):
        return first
    return replace(later, **parts, medium=medium, bounds=first.bounds)


def _matched(first: Sequence[T], later: Sequence[T]) -> Sequence[T]:
    by_name = {item.name: item for item in later}  # type: ignore[attr-defined]
    result = tuple(same(item, by_name.get(item.name, item)) for item in first)  # type: ignore[attr-defined]
    return first if all(a is b for a, b in zip(first, result, strict=True)) else result


def same(first: T, later: T) -> T:
    """Return the first of two values where they are equal, else the later."""
    return first if equal(first, later) else later


def equal(a: Any, b: Any) -> bool:
    """Return whether two values are equal, arrays and what holds arrays too."""
    if a is b:
        return True
    if is_dataclass(a) and type(a) is type(b):
        return all(equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(equal, a, b))
    return bool(type(a) is type(b) and a == b)


class Exposure:
    """What `render.frame.Shutter` asks: scene and cameras at fractions of the shutter, each read once.

    Parameters
    ----------
    read
        Returns scene and cameras at a time code.
    start, stop
        Time codes of shutter open and shutter close.
    """

    def __init__(self, read: Callable[[float], tuple[Scene, tuple[Camera, ...]]], start: float, stop: float) -> None:
        self._read, self._start, self._stop = read, start, stop
        self.duration = stop - start  # in time codes
        self._first = read(start)
        self._known: dict[float, tuple[Scene, tuple[Camera, ...]]] = {0.0: self._first}
        self.moving = stop > start and any(self._changed(fraction) for fraction in (1.0, 0.5))

    def __call__(self, fraction: float) -> tuple[Scene, tuple[Camera, ...]]:
        """Return scene and cameras at a fraction of the shutter, 0 to 1."""
        if fraction not in self._known:
            content, cameras = self._read(self._start + fraction * (self._stop - self._start))
            first, eyes = self._first
            self._known[fraction] = followed(first, content), tuple(map(same, eyes, cameras))
        return self._known[fraction]

    def _changed(self, fraction: float) -> bool:
        content, cameras = self(fraction)
        return content is not self._first[0] or any(a is not b for a, b in zip(cameras, self._first[1], strict=True))
