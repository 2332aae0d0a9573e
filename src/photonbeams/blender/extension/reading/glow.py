"""Meshes that glow are lamps, as in Blender: the brightest of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .meshes import following
from .prims import Prim, Told

_MOST = 8  # the renderer's kernels have code for each lamp that is a mesh


class GlowingMeshes:
    """The prims of meshes whose materials emit light, with what they emit.

    Parameters
    ----------
    told
        Called with a sentence if there are more than can be lamps.
    """

    def __init__(self, told: Told) -> None:
        self._told, self._flux = told, list[tuple[float, Prim]]()

    def add(self, prim: Prim, faces: dict[int, Any], radiance: dict[int, Any]) -> None:
        """Add the prim of a mesh whose material slots have these faces and radiances (3,)."""
        if any(np.any(value > 0) for value in radiance.values()):
            area = _areas(prim)
            flux = sum(area[faces[slot]].sum() * value.mean() for slot, value in radiance.items())
            self._flux.append((flux, prim))

    def enable(self) -> None:
        """Make lamps of the brightest meshes; the others light nothing."""
        ranked = sorted(self._flux, key=lambda entry: -entry[0])
        for rank, (_, prim) in enumerate(ranked):
            prim.values["photonbeams:enabled"] = rank < _MOST
        if len(ranked) > _MOST:
            self._told(f"{len(ranked)} meshes glow: the {_MOST} brightest are lamps")


def _areas(prim: Prim) -> Any:
    """Return the areas of the faces of a mesh in the world."""
    corners = (prim.values["points"] @ prim.matrix[:3, :3])[prim.values["faceVertexIndices"]]
    counts = prim.values["faceVertexCounts"]
    starts = np.cumsum(counts) - counts
    origin = np.repeat(corners[starts], counts, axis=0)
    turns = np.cross(corners - origin, corners[following(prim.values)] - origin)
    return np.linalg.norm(np.add.reduceat(turns, starts, axis=0), axis=1) / 2
