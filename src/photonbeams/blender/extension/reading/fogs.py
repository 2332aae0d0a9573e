"""Fog in objects: a closed mesh of even fog, or a box with a grid where the density varies."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from .kept import Kept
from .media import APIS, density_at, has_volume, medium_of
from .nodes import Told
from .shading.evaluation import Points

_CELLS = 64  # along the longest edge of a box
_HEADER = "<3sB5i6f"  # of Mitsuba's .vol files
_VARIES = 0.02  # of the mean: less counts as even


def fog_prims(prim: dict[str, Any], material: Any, kept: Kept, told: Told) -> list[dict[str, Any]]:
    """Return the prims of the fog in a mesh, by the mesh's own prim and its material; none without a volume.

    Domes light what has a volume's shader or a grid, as Blender's world does.
    """
    if material is None or not has_volume(material):
        return []
    values = prim["values"]
    points = values["points"][1]
    low, high = points.min(axis=0), points.max(axis=0)
    if is_box(points, low, high):
        spans = (high - low) * np.linalg.norm(prim["matrix"][:3, :3], axis=1)
        shape = np.maximum(np.ceil(_CELLS * spans / spans.max()), 1).astype(int)
        key = ("density", material.name_full, low.tobytes(), high.tobytes(), shape.tobytes())
        density = kept.once(key, lambda: density_at(material, _cells(low, high, shape)))
        if density is not None and density.std() > _VARIES * density.mean():
            medium = medium_of(material, told, density=1.0)
            assert medium is not None
            if medium.pop("photonbeams:emission", None) is not None:
                told(f"{material.name}: light from a box whose density varies is not rendered")
            file = kept.images.stored(_vol(density, low, high, shape), "density", ".vol")
            return _grid(prim, medium, file)
    medium = medium_of(material, told)
    if medium is None:
        return []
    if not is_closed(values):
        return [{**prim, "apis": APIS, "values": {**values, **medium}}]
    return _filled(prim, medium)


def is_box(points: Any, low: Any, high: Any) -> bool:
    """Return whether points (N, 3) are the corners of a box along the axes."""
    near = np.abs(np.stack([points - low, points - high])) <= 1e-5 * np.maximum(high - low, 1e-30)
    return bool(np.all(near.any(axis=0))) and len(np.unique(near[0], axis=0)) == 8


def is_closed(values: dict[str, Any]) -> bool:
    """Return whether each edge of a mesh is one of two faces, by its attributes."""
    corners, counts = values["faceVertexIndices"][1], values["faceVertexCounts"][1]
    following = np.arange(1, len(corners) + 1)
    ends = np.cumsum(counts)
    following[ends - 1] = ends - counts
    edges = np.sort(np.stack([corners, corners[following]], axis=1), axis=1)
    return bool(np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2))


def _filled(prim: dict[str, Any], medium: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the prims of a closed mesh with a volume material."""
    path = f"{prim['path']}/Volume"
    names = ("scattering", "absorption", "anisotropy")
    values = {f"inputs:{name}": ["vector3f" if name != "anisotropy" else "float", medium[f"photonbeams:{name}"][1]]
              for name in names}  # fmt: skip
    values |= {"info:id": ["token", "ND_anisotropic_vdf"], "outputs:out": ["token", None]}
    glow = {name: value for name, value in medium.items() if name == "photonbeams:emission"}
    bound = {"apis": ["MaterialBindingAPI"], "targets": {"material:binding": [path]}}
    return [
        {**prim, **bound, "values": {**prim["values"], **glow}},
        {"path": path, "type": "Material",
         "sources": {"outputs:mtlx:volume": ["token", f"{path}/Shader.outputs:out"]}},
        {"path": f"{path}/Shader", "type": "Shader", "values": values},
    ]  # fmt: skip


def _grid(prim: dict[str, Any], medium: dict[str, Any], file: str) -> list[dict[str, Any]]:
    """Return the prims of a volume with a grid of densities."""
    path = f"{prim['path']}/Density"
    volume = {"path": prim["path"], "type": "Volume", "matrix": prim["matrix"], "apis": APIS, "values": medium}
    field = {"path": path, "type": "OpenVDBAsset", "values": {"filePath": ["asset", file]}}
    return [{**volume, "targets": {"field:density": [path]}}, field]


def _cells(low: Any, high: Any, shape: Any) -> Points:
    """Return the middles of cells along x, y, z, those along x next to each other."""
    axes = [(np.arange(count) + 0.5) / count for count in shape]
    z, y, x = np.meshgrid(*reversed(axes), indexing="ij")
    unit = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    place = low + unit * (high - low)
    return Points(unit, place, unit, np.zeros_like(unit), np.ones(len(unit)))


def _vol(density: Any, low: Any, high: Any, shape: Any) -> bytes:
    """Return the content of a file with densities of cells."""
    header = struct.pack(_HEADER, b"VOL", 3, 1, *map(int, shape), 1, *map(float, low), *map(float, high))
    return header + np.maximum(density, 0).astype("<f4").tobytes()
