"""Boxes around prims, which fog fills."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...scene import Mesh, SceneError
from ..common.openusd import Gf, Sdf, Usd, UsdGeom
from ..common.reading import Time

_PURPOSES = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]


def box_around(stage: Usd.Stage, paths: Sequence[str], name: str, time: Time = None) -> Mesh:
    """Return the box, along the axes of the world, around prims and what is below them, as a mesh called `name`.

    What is below counts with the purposes that are rendered, and with the purpose of the prim itself: a guide that
    stands for the fog is no part of the picture.

    Raises
    ------
    SceneError
        There is no prim of a path, or nothing with a volume under all of them.
    """
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    found = Gf.Range3d()
    for path in paths:
        prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if not prim:
            raise SceneError(f"there is no prim {path}: expected the path of a prim around which fog is")
        purposes = {*_PURPOSES, UsdGeom.Imageable(prim).ComputePurpose()}
        cache = UsdGeom.BBoxCache(code, sorted(purposes), True)
        found.UnionWith(cache.ComputeWorldBound(prim).ComputeAlignedRange())
    return checked_box(name, found.GetMin(), found.GetMax(), f"the box around {', '.join(paths)}")


def checked_box(name: str, low: ArrayLike, high: ArrayLike, what: str) -> Mesh:
    """Return the box from `low` to `high`; raise SceneError, which calls it `what`, if it holds nothing."""
    low, high = (np.array(each, dtype=np.float64) for each in (low, high))
    if not (np.all(np.isfinite([low, high])) and np.all(low < high)):
        ends = " to ".join(" ".join(f"{each:g}" for each in end) for end in (low, high))
        raise SceneError(f"{what} is {ends if np.all(low <= high) else 'empty'}: expected one with a volume, for fog")
    return Mesh.box(name, low, high)
