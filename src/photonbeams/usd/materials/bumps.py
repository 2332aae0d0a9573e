"""Read normal maps and bumps, which tilt a surface's normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import Array, UVTexture, rgb
from .network import NodeReader, ShaderNode, Surface
from .values import Image, Value, as_number, mapped

# Nodes for heights in scene units, with their inputs for the heights and the scale.
_HEIGHTS = {
    "arnold:bump2d": ("bump_map", "bump_height"),
    "arnold:bump3d": ("bump_map", "bump_height"),
    "PxrBump": ("inputBump", "scale"),
}

_SOBEL = 1 / 16  # MaterialX's factor on slopes
_FLAT = np.array([0.0, 0.0, 1.0])


def tilt(node: ShaderNode, surface: Surface, *names: str) -> None:
    """Set the normals or the heights of a surface from the first of these inputs that is connected."""
    for name in names:
        inner = node.connected(name)
        if inner is None:
            continue
        if inner.category not in _HEIGHTS:
            surface.normal = node.color(name)
            return
        heights, scale = (inner.number_or(1.0, each) for each in _HEIGHTS[inner.category])
        image = _image(inner, inner.combined(np.multiply, heights, scale))
        surface.bump = image and as_number(image)
        return


def _image(node: ShaderNode, heights: Value | None) -> Image | None:
    """Return heights if they are an image; note a loss if they vary otherwise."""
    if isinstance(heights, Image):
        return heights
    if heights is not None and not isinstance(heights, np.ndarray):
        node.lose("has no image for its heights: it is ignored")
    return None


def _normal_map(node: ShaderNode) -> Value | None:
    """Read normals in tangent space from an image that encodes them as n / 2 + 1 / 2."""
    picture = node.first("in", "input", "inputRGB")
    if picture is None:
        return None
    strengths = (name for name in ("strength", "bumpScale") if node.has(name))
    strength = node.vector(next(strengths, "scale"), (1.0, 1.0))
    signed = not node.flag("color_to_signed", True)
    signs = [-1.0 if node.flag(name) else 1.0 for name in ("invert_x", "invert_y")]
    factor = np.array([*(strength * signs), 1.0])
    return mapped(lambda values: (rgb(values) if signed else 2 * rgb(values) - 1) * factor, picture)


def _normals(node: ShaderNode, name: str) -> Value:
    """Return normals in tangent space from an image of heights over UVs, scaled as in MaterialX."""
    image = _image(node, node.number(name))
    if image is None:
        return _FLAT
    wrap = image.wrap[0] if image.wrap[0] == image.wrap[1] != "black" else "clamp"
    slopes = UVTexture(image.pixels, wrap, image.transform).slopes()
    normals: Array = _FLAT - _SOBEL * node.scalar("scale", 1.0) * slopes.pixels
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return replace(image, pixels=normals, wrap=(slopes.wrap,) * 2, transform=slopes.uv_transform, beyond=_FLAT)


BUMPS: dict[str, NodeReader] = {
    "normalmap": _normal_map,
    "arnold:normal_map": _normal_map,
    "PxrNormalMap": _normal_map,
    "heighttonormal": lambda node: mapped(lambda values: values / 2 + 0.5, _normals(node, "in")),
    "bump": lambda node: _normals(node, "height"),
}
