"""Parts of Mitsuba's objects: shapes and media in groups, boxes of media, and volumes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import scene
from ...runtime.device import mitsuba
from ..bounds import box_of
from .interfaces import number

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import BoundingBox, MiMedium, MiObject, MiShape, MiVolume

mi = mitsuba()


class _Parts(mi.TraversalCallback):  # type: ignore[misc, name-defined]
    """Collects the parts of one of Mitsuba's objects, each once."""

    def __init__(self, found: dict[MiObject, None]) -> None:
        super().__init__()
        self.found = found

    def put(self, name: str, value: object, flags: int, cpptype: object = None) -> None:
        if isinstance(value, mi.Object) and value not in self.found:
            self.found[value] = None
            value.traverse(_Parts(self.found))  # a new callback: Mitsuba does not call Python methods recursively


def parts(plugin: MiObject, kind: type) -> list[Any]:
    """Return all parts of a Mitsuba scene that are of a class, including those in shape groups."""
    found: dict[Any, None] = {}
    plugin.traverse(_Parts(found))
    return [each for each in found if isinstance(each, kind)]


def boxes(shapes: Iterable[MiShape]) -> dict[int, BoundingBox]:
    """Return the box around all shapes with a medium inside, by the numbers of media."""
    result: dict[int, Any] = {}
    for shape in shapes:
        if shape.interior_medium() is not None:
            result.setdefault(number(shape.interior_medium()), mi.ScalarBoundingBox3f()).expand(box_of(shape))
    return result


class _Volumes(mi.TraversalCallback):  # type: ignore[misc, name-defined]
    """Collects the volumes of a medium by name."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, Any] = {}

    def put(self, name: str, value: object, flags: int, cpptype: object = None) -> None:
        if isinstance(value, mi.Volume):
            self.found[name] = value


def varies(plugin: MiMedium) -> bool:
    """Return whether a medium's coefficients vary; the albedo of Mitsuba's `homogeneous` media may.

    Raises
    ------
    SceneError
        The extinction of a `homogeneous` medium varies: Mitsuba itself takes it from arbitrary points.
    """
    if not plugin.is_homogeneous():
        return True
    volumes = _Volumes()
    plugin.traverse(volumes)
    if "sigma_t" in volumes.found and not is_constant(volumes.found["sigma_t"]):
        name = plugin.id() or plugin.class_name()
        raise scene.SceneError(
            f"medium {name}: it is homogeneous, but its sigma_t is a grid: expected a constant, or type heterogeneous"
        )
    return any(not is_constant(each) for each in volumes.found.values())


def is_constant(volume: MiVolume) -> bool:
    """Return whether a volume has the same value everywhere."""
    if volume.class_name() == "ConstVolume":
        return True
    data = next((np.asarray(value) for key, value in mi.traverse(volume) if key == "data"), None)
    return data is not None and bool(np.all(np.ptp(data.reshape(-1, data.shape[-1]), axis=0) == 0))
