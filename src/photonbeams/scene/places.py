"""Coordinates that begin near a shot, because single precision is coarse far from zero.

At survey coordinates of 4e6 metres, numbers of single precision are a quarter of a metre apart. So kernels measure from
an origin near the cameras, one for the whole shot:

- What is described has the user's coordinates, in double precision: `scene`, `usd`, `shot` and `export`.
- `Origin.local` moves it, once, where a shot's `Shutter` is made. All coordinates in `world`, `transport` and `render`
  begin at the origin. `Scene.zero` says where the user's own begin in these.
- What leaves is moved back by that, and so is what users' looks and functions see.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar
from weakref import ref

import numpy as np
import numpy.typing as npt

from .checks import Array

T = TypeVar("T")

#: A point, where coordinates begin, as fields of records hold it.
Point = tuple[float, float, float]

ZERO: Point = (0.0, 0.0, 0.0)

# Fields of records that hold points, that hold transforms to the world, and that hold other records.
_POINTS = {"points", "center", "start", "end", "side", "guides", "zero"}
_TRANSFORMS = {"frame", "to_world"}
_PARTS = {
    *("meshes", "lights", "drawn", "media", "portal", "mesh", "filters"),
    *("grid", "scattering_color", "emission", "density"),
}

# The origin is zero within so many sizes of a shot. There, single precision has 4e-6 of the size.
_NEAR = 64.0


def origin_near(place: Array, size: float) -> Array:
    """Return the origin for a shot of a `size` around a `place`, (3,): zero near zero, else next to the place.

    It is a multiple of a power of two, so it stays where it is while the shot changes a little.
    """
    step = 2.0 ** np.ceil(np.log2(size))
    found: Array = step * np.round(np.asarray(place, dtype=np.float64) / step)
    return found if np.max(np.abs(found)) > _NEAR * size else np.zeros(3)


def origin_within(points: Array) -> Array:
    """Return the origin for points, (N, 3), that are written in single precision: zero if they are near it, or none."""
    if not len(points):
        return np.zeros(3)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return origin_near(0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0)


class Origin:
    """A point from which coordinates are measured.

    Parameters
    ----------
    place
        (3,) the point in the user's coordinates. Default: zero.
    """

    def __init__(self, place: npt.ArrayLike = ZERO) -> None:
        self._by = 0.0 - np.asarray(place, dtype=np.float64)
        self._known: dict[int, tuple[ref[Any], Any]] = {}  # by ids: what is the same object stays so

    def local(self, record: T) -> T:
        """Return a scene, or a part of it, or a camera, in coordinates that begin here."""
        if not self._by.any():
            return record
        key = id(record)
        if key not in self._known:
            gone = ref(record, lambda _: self._known.pop(key, None))
            self._known[key] = gone, moved(record, self._by, self.local)
        result: T = self._known[key][1]
        return result


def moved(record: T, by: Array, part: Callable[[Any], Any] | None = None) -> T:
    """Return a record whose points, and whose parts, are moved by a vector, (3,); `part` moves those instead."""
    if not np.any(by):
        return record
    changed: dict[str, Any] = {}
    for each in fields(record):  # type: ignore[arg-type]
        name, value = each.name, getattr(record, each.name)
        if name in _POINTS and value is not None:
            changed[name] = _shifted(value, by)
        elif name == "bounds" and value is not None:
            changed[name] = value[0] + by, value[1]
        elif name in _TRANSFORMS and np.shape(value) == (4, 4):
            changed[name] = np.array(value, dtype=np.float64)
            changed[name][:3, 3] += by
        elif name in _PARTS:
            changed[name] = _parts(value, part or (lambda own: moved(own, by)))
    return replace(record, **changed) if changed else record  # type: ignore[type-var]


def _shifted(value: Any, by: Array) -> Any:
    """Return points, a `Point`, or several arrays of points, moved by a vector."""
    if isinstance(value, tuple) and not (value and isinstance(value[0], float)):
        return tuple(_shifted(each, by) for each in value)
    result = np.asarray(value, dtype=np.float64) + by
    return tuple(result.tolist()) if isinstance(value, tuple) else result


def _parts(value: Any, part: Callable[[Any], Any]) -> Any:
    """Return a record, or several, each as `part` returns it; colours and None stay."""
    if isinstance(value, tuple):
        return tuple(each if isinstance(each, float) else part(each) for each in value)
    return value if value is None else part(value)
