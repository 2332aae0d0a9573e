"""Fog in objects: a closed mesh of even fog, or a box with a grid where the density varies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .kept import Kept
from .media import APIS, density_at, medium_of
from .meshes import following
from .prims import Prim, Told, Values
from .shading.calls import Points
from .volumes import vol_of

_CELLS = 64  # along the longest edge of a box
_VARIES = 0.02  # of the mean: less counts as even


def fog_prims(prim: Prim, material: Any, kept: Kept, told: Told) -> list[Prim]:
    """Return the prims of the fog in a mesh, by the mesh's own prim and its material; none without a volume.

    Domes light what has a volume's shader or a grid, as Blender's world does.
    """
    points = prim.values["points"]
    low, high = points.min(axis=0), points.max(axis=0)
    if is_box(points, low, high):
        spans = (high - low) * np.linalg.norm(prim.matrix[:3, :3], axis=1)
        shape = np.maximum(np.ceil(_CELLS * spans / spans.max()), 1).astype(int)
        key = ("density", material.name_full if material else "", low.tobytes(), high.tobytes(), shape.tobytes())
        density = kept.once(key, lambda: density_at(material, _cells(low, high, shape)))
        if density is not None and density.std() > _VARIES * density.mean():
            dense = medium_of(material, told, density=1.0) or {}
            if dense.pop("photonbeams:emission", None) is not None:
                told(f"{material.name}: light from a box whose density varies is not rendered")
            grid = np.maximum(density, 0).reshape(shape[::-1])
            return _grid(prim, dense, kept.images.stored(vol_of(grid, low, high), "density", ".vol"))
    medium = medium_of(material, told)
    if medium is None:
        return []
    if not is_closed(prim.values):
        return [replace(prim, apis=APIS, values=prim.values | medium)]
    return _filled(prim, medium)


def is_box(points: Any, low: Any, high: Any) -> bool:
    """Return whether points (N, 3) are the corners of a box along the axes."""
    near = np.abs(np.stack([points - low, points - high])) <= 1e-5 * np.maximum(high - low, 1e-30)
    return bool(np.all(near.any(axis=0))) and len(np.unique(near[0], axis=0)) == 8


def is_closed(values: Values) -> bool:
    """Return whether each edge of a mesh is one of two faces, by its attributes."""
    corners = values["faceVertexIndices"]
    edges = np.sort(np.stack([corners, corners[following(values)]], axis=1), axis=1)
    return bool(np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2))


def _filled(prim: Prim, medium: Values) -> list[Prim]:
    """Return the prims of a closed mesh with a volume material."""
    path = f"{prim.path}/Volume"
    values: Values = {"info:id": "ND_anisotropic_vdf", "outputs:out": None}
    for name in ("scattering", "absorption", "anisotropy"):
        values[f"inputs:{name}"] = medium[f"photonbeams:{name}"]
    glow = {name: value for name, value in medium.items() if name == "photonbeams:emission"}
    bound = {"material:binding": [path]}
    return [
        replace(prim, apis=["MaterialBindingAPI"], targets=bound, values=prim.values | glow),
        Prim(path, "Material", sources={"outputs:mtlx:volume": f"{path}/Shader.outputs:out"}),
        Prim(f"{path}/Shader", "Shader", values),
    ]


def _grid(prim: Prim, medium: Values, file: str) -> list[Prim]:
    """Return the prims of a volume with a grid of densities."""
    path = f"{prim.path}/Density"
    volume = Prim(prim.path, "Volume", medium, {"field:density": [path]}, apis=APIS, matrix=prim.matrix)
    return [volume, Prim(path, "OpenVDBAsset", {"filePath": file})]


def _cells(low: Any, high: Any, shape: Any) -> Points:
    """Return the middles of cells along x, y, z, those along x next to each other."""
    z, y, x = np.indices(shape[::-1]).reshape(3, -1) + 0.5
    unit = np.stack([x, y, z], axis=1) / shape
    return Points(unit, low + unit * (high - low), unit, np.zeros((1, 3)))
