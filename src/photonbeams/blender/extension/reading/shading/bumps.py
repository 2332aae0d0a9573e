"""What tilts a surface's normals: Bump and Normal Map nodes, and a material's displacement, which counts as a bump."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..images import Images
from ..nodes import Attribute, Texture, number_of, value_of
from ..prims import Prim, Told
from .links import node_behind, source_at
from .textures import shader_prim, texture_prims


@dataclass(frozen=True)
class Tilt:
    """What tilts normals.

    Attributes
    ----------
    heights
        Images of heights, and how high 1 is in them, in metres.
    normals, strength
        An image of normals in tangent space, in whose place heights have no effect, and how much it counts.
    """

    heights: tuple[tuple[Texture, float], ...] = ()
    normals: Texture | None = None
    strength: float = 1.0


def tilt_of(node: Any, told: Told) -> Tilt | None:
    """Return what tilts the normals of a shader node; None if nothing does."""
    return _tilt(node.inputs.get("Normal"), told)


def displacement_of(material: Any, scale: float, told: Told) -> Tilt | None:
    """Return what a material's displacement does as a bump, on an object of this scale; None if it does nothing."""
    node = _displacement(material)
    if node is None:
        return None
    if node.type != "DISPLACEMENT":
        told(f"the displacement of {node.name} is not rendered")
        return None
    if material.displacement_method != "BUMP":
        told(f"{node.name} moves the surface, which is not rendered: it is a bump")
    return _bump(node, scale * number_of(node, "Scale", told, 1.0), told)


def scale_of_heights(material: Any, matrix: Any) -> float:
    """Return how much the transform (4, 4) of an object scales the displacement of its material; 1: it does not."""
    node = None if material is None or material.node_tree is None else _displacement(material)
    if node is None or getattr(node, "space", "WORLD") != "OBJECT":
        return 1.0
    return round(float(np.linalg.norm(matrix[:3, :3], axis=1).mean()), 4)


def _displacement(material: Any) -> Any:
    """Return the node that a material's displacement comes from; None if there is none."""
    source = source_at(material.node_tree, "OUTPUT_MATERIAL", "Displacement")
    return None if source is None else source.node


def with_bump(tilt: Tilt | None, added: Tilt | None, told: Told) -> Tilt | None:
    """Return a tilt with the heights of another one."""
    if tilt is None or added is None:
        return tilt or added
    if tilt.normals is not None and added.heights:
        told("a bump over a normal map is not rendered: the normal map is used alone")
    return replace(tilt, heights=tilt.heights + added.heights)


def tilt_prims(tilt: Tilt, path: str, images: Images, told: Told) -> tuple[list[Prim], str]:
    """Return the prims of what tilts normals, and the path of the output that has them."""
    if tilt.normals is not None:
        # As in Cycles: a strength below 1 also raises the normal.
        side, up = 2 * tilt.strength, 2 * min(tilt.strength, 1.0)
        scaled = {"scale": [side, side, up, 1.0], "bias": [-side / 2, -side / 2, 1 - up, 0.0]}
        return texture_prims(tilt.normals, path, images, told, scaled)
    prims, total = list[Prim](), ""
    for number, (texture, height) in enumerate(tilt.heights):
        scaled = {"scale": [height] * 4}
        own, output = texture_prims(texture, f"{path}_{number}", images, told, scaled, is_number=True)
        prims += own
        if not total:
            total = output
            continue
        parts = {"in1": total, "in2": output}
        prims.append(shader_prim(f"{path}_sum{number}", "ND_add_float", "out", {}, parts))
        total = f"{path}_sum{number}.outputs:out"
    prims.append(shader_prim(path, "arnold:bump2d", "out", {"bump_height": 1.0}, {"bump_map": total}))
    return prims, f"{path}.outputs:out"


def _tilt(socket: Any, told: Told) -> Tilt | None:
    """Return what a socket of normals is linked to."""
    node = node_behind(socket)
    if node is None or node.type in ("NEW_GEOMETRY", "TEX_COORD"):
        return None
    if node.type == "BUMP":
        height = number_of(node, "Strength", told, 1.0) * number_of(node, "Distance", told, 1.0)
        return with_bump(
            _tilt(node.inputs["Normal"], told), _bump(node, -height if node.invert else height, told), told
        )
    if node.type == "NORMAL_MAP":
        return _normals(node, told)
    told(f"the normals of {node.name} are not rendered")
    return None


def _bump(node: Any, height: float, told: Told) -> Tilt | None:
    """Return the bump that a node's input Height makes; even heights make none."""
    value = value_of(node, "Height", told, bakes=True)
    if isinstance(value, Attribute):
        told(f"the heights of {node.name} come from an attribute, which is not rendered: they are even")
    return Tilt(((value, height),)) if isinstance(value, Texture) and height else None


def _normals(node: Any, told: Told) -> Tilt | None:
    """Return the normals that a Normal Map node makes."""
    if node.space != "TANGENT":
        told(f"{node.name} has normals in {node.space.lower().replace('_', ' ')} space, which are not rendered")
        return None
    value, strength = value_of(node, "Color", told, bakes=True), max(number_of(node, "Strength", told, 1.0), 0.0)
    return Tilt(normals=value, strength=strength) if isinstance(value, Texture) and strength else None
