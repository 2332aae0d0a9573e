"""Read normal maps and bumps, which tilt a surface's normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import UVTexture, rgb
from ..common.openusd import UsdShade
from .network import Network, Node, Surface, category
from .values import Image, Value, as_number, mapped

# Nodes for heights in scene units, with their inputs for the heights and the scale.
_HEIGHTS = {
    "arnold:bump2d": (("bump_map",), ("bump_height",)),
    "arnold:bump3d": (("bump_map",), ("bump_height",)),
    "PxrBump": (("inputBump",), ("scale",)),
}

_SOBEL = 1 / 16  # MaterialX's factor on slopes


def tilt(network: Network, node: UsdShade.Shader, surface: Surface, *names: str) -> None:
    """Set the normals or the heights of a surface from the first of these inputs that is connected."""
    for name in names:
        inner = network.connected(node, name)
        if inner is None:
            continue
        if category(inner) not in _HEIGHTS:
            surface.normal = network.color(node, name)
            return
        heights, scale = (network.number_or(inner, 1.0, *each) for each in _HEIGHTS[category(inner)])
        found = network.combined(inner, np.multiply, heights, scale)
        if isinstance(found, Image):
            surface.bump = as_number(found)
        elif not isinstance(found, np.ndarray):
            network.lose(inner, "has no image for its heights: it is ignored")
        return


def _normal_map(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read normals in tangent space from an image that encodes them as n / 2 + 1 / 2."""
    picture = network.first(node, "in", "input")
    if picture is None:
        return None
    strength = network.vector(node, "strength" if node.GetInput("strength") else "scale", (1.0, 1.0))
    signed = not network.plain(node, "color_to_signed", True)
    signs = [-1.0 if network.plain(node, name, False) else 1.0 for name in ("invert_x", "invert_y")]
    factor = np.array([*(strength * signs), 1.0])
    return mapped(lambda values: (rgb(values) if signed else 2 * rgb(values) - 1) * factor, picture)


def _renderman_normal_map(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    picture = network.value(node, "inputRGB")
    factor = np.array([*[float(network.vector(node, "bumpScale", (1.0,))[0])] * 2, 1.0])
    return None if picture is None else mapped(lambda values: (2 * rgb(values) - 1) * factor, picture)


def _normals_of(network: Network, node: UsdShade.Shader, heights: Value | None, scale: float) -> Value | None:
    """Return normals in tangent space from an image of heights over UVs, scaled as in MaterialX."""
    if not isinstance(heights, Image):
        if heights is not None and not isinstance(heights, np.ndarray):
            network.lose(node, "has no image for its heights: it is ignored")
        return None
    heights = as_number(heights)
    assert isinstance(heights, Image)
    wrap = heights.wrap[0] if heights.wrap[0] == heights.wrap[1] != "black" else "clamp"
    slopes = UVTexture(heights.pixels, wrap, heights.transform).slopes()
    normals = np.array([0.0, 0.0, 1.0]) - _SOBEL * scale * slopes.pixels
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    flat = np.array([0.0, 0.0, 1.0])
    return replace(heights, pixels=normals, wrap=(slopes.wrap,) * 2, transform=slopes.uv_transform, beyond=flat)


def _height_to_normal(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read MaterialX's `heighttonormal`, whose normals are encoded as n / 2 + 1 / 2."""
    scale = float(network.vector(node, "scale", (1.0,))[0])
    normals = _normals_of(network, node, network.value(node, "in"), scale)
    return np.array([0.5, 0.5, 1.0]) if normals is None else mapped(lambda values: values / 2 + 0.5, normals)


def _bump(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read MaterialX's `bump`, a `heighttonormal` whose slopes are scaled."""
    scale = float(network.vector(node, "scale", (1.0,))[0])
    return _normals_of(network, node, network.value(node, "height"), scale)


BUMPS: dict[str, Node] = {
    "normalmap": _normal_map,
    "arnold:normal_map": _normal_map,
    "PxrNormalMap": _renderman_normal_map,
    "heighttonormal": _height_to_normal,
    "bump": _bump,
}
