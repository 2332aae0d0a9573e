"""Meshes that glow are lamps, as in Blender: the brightest of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .nodes import Told

_MOST = 8  # the renderer's kernels have code for each lamp that is a mesh
_TOKEN = "photonbeams:enabled"


class GlowingMeshes:
    """The prims of meshes whose materials emit light, with what they emit.

    Parameters
    ----------
    told
        Called with a sentence if there are more than can be lamps.
    """

    def __init__(self, told: Told) -> None:
        self._told, self._flux = told, list[tuple[float, dict[str, Any]]]()

    def add(self, prim: dict[str, Any], radiance: dict[int, Any], area: dict[int, float]) -> None:
        """Add the prim of a mesh whose material slots have these radiances (3,) and areas."""
        flux = sum(area[slot] * value for slot, value in radiance.items())
        if np.any(flux > 0):
            self._flux.append((float(np.mean(flux)), prim))

    def enable(self) -> None:
        """Make lamps of the brightest meshes; the others light nothing."""
        ranked = sorted(self._flux, key=lambda each: -each[0])
        for rank, (_, prim) in enumerate(ranked):
            prim["values"][_TOKEN] = ["bool", rank < _MOST]
        if len(ranked) > _MOST:
            self._told(f"{len(ranked)} meshes glow: the {_MOST} brightest are lamps")


def areas(values: dict[str, Any], faces: dict[int, Any], matrix: Any) -> dict[int, float]:
    """Return the area of the faces of each material slot of a mesh in the world, by its attributes."""
    points = values["points"][1] @ matrix[:3, :3].T
    corners, counts = values["faceVertexIndices"][1], values["faceVertexCounts"][1]
    starts = np.cumsum(counts) - counts
    following = np.arange(1, len(corners) + 1)
    following[starts + counts - 1] = starts  # the last corner of a face is followed by its first
    origin = np.repeat(points[corners[starts]], counts, axis=0)
    turns = np.cross(points[corners] - origin, points[corners[following]] - origin)
    doubled = np.linalg.norm(np.add.reduceat(turns, starts, axis=0), axis=1)
    return {slot: float(doubled[own].sum() / 2) for slot, own in faces.items()}
