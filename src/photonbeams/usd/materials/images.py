"""Read nodes that are images: files, UDIM tiles and checkerboards, and their placement on a surface."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ...images.textures import wrap_modes
from ...scene import Array, rgb
from ..common.openusd import Ar, Sdf, Usd, UsdShade
from ..common.reading import Reading
from ..common.textures import find_image, image_at, known_space, resolved, texture_limit
from .network import Network, Node, category, is_output
from .values import Image, Tiles, Value, mapped

_WRAPS = {
    "repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "black", "useMetadata": "",
    "periodic": "repeat", "constant": "black", "file": "", "missing": "black",
}  # fmt: skip
_LONGEST = 16  # transforms of UVs in a chain, which also ends loops
_UDIM = re.compile(r"<UDIM>|%\(UDIM\)d|<udim>")


def _usd_uv_texture(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read a UsdUVTexture: four channels, with scale and bias, or its fallback if there is no image."""
    fallback = network.value(node, "fallback")
    pixels = _pixels(network, node, "file", str(network.plain(node, "sourceColorSpace", "auto")), fallback)
    if pixels is None:
        return fallback
    scale, bias = network.vector(node, "scale", (1.0,) * 4), network.vector(node, "bias", (0.0,) * 4)
    wrap = _wraps(network, node, ("wrapS", "wrapT"), "useMetadata", "file")
    image = _placed(network, node, pixels, wrap, coordinates(network, node, "st"))
    return image if np.all(scale == 1) and np.all(bias == 0) else mapped(lambda values: values * scale + bias, image)


def _materialx_image(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read MaterialX's `image`, `tiledimage` and `gltf_colorimage`; only files of colours have a colour space."""
    name = str(node.GetShaderId())
    default = network.value(node, "default")
    # As in Storm and Karma, 8-bit files of colours are sRGB unless they say otherwise.
    space = "auto" if "color" in name.removeprefix("ND_gltf_color") else "raw"
    pixels = _pixels(network, node, "file", space, default)
    if pixels is None:
        return default
    wrap = _wraps(network, node, ("uaddressmode", "vaddressmode"), "periodic", "file")
    uv_name, transform = coordinates(network, node, "texcoord")
    if "tiledimage" in name:
        size = network.vector(node, "realworldtilesize", (1.0, 1.0))
        size = size / np.maximum(network.vector(node, "realworldimagesize", (1.0, 1.0)), 1e-9)
        tiling, offset = network.vector(node, "uvtiling", (1.0, 1.0)), network.vector(node, "uvoffset", (0.0, 0.0))
        transform = affine(np.diag(size * tiling), -offset * size) @ transform
    image = _placed(network, node, pixels, wrap, (uv_name, transform))
    single = re.search(r"_float\b|_float$", name)
    return mapped(lambda values: values[..., :1], image) if single else image


def _arnold_image(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    missing = network.value(node, "missing_texture_color")
    missing = missing if network.plain(node, "ignore_missing_textures", False) else None
    space = str(network.plain(node, "color_space", "auto"))
    pixels = _pixels(network, node, "filename", space, missing)
    if pixels is None:
        return missing
    wrap = _wraps(network, node, ("swrap", "twrap"), "periodic", "filename")
    uv_name, transform = coordinates(network, node, "uvcoords")
    uv_name = str(network.plain(node, "uvset", "")) or uv_name
    scale, offset = (
        [float(network.vector(node, f"{axis}{name}", (default,))[0]) for axis in "st"]
        for name, default in (("scale", 1.0), ("offset", 0.0))
    )
    transform = affine(np.diag(scale), np.array(offset)) @ transform
    flipped = np.array([bool(network.plain(node, name, False)) for name in ("sflip", "tflip")], dtype=float)
    transform = affine(np.diag(1 - 2 * flipped), flipped) @ transform
    if network.plain(node, "swap_st", False):
        transform = np.eye(3)[[1, 0, 2]] @ transform
    image = _placed(network, node, pixels, wrap, (uv_name, transform))
    factor, added = network.vector(node, "multiply", (1.0,) * 3), network.vector(node, "offset", (0.0,) * 3)
    if np.all(factor == 1) and np.all(added == 0):
        return image

    def adjusted(values: Array) -> Array:
        return np.concatenate([rgb(values) * factor + added, values[..., 3:]], axis=-1)

    return mapped(adjusted, image)


def _renderman_texture(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    space = "sRGB" if network.plain(node, "linearize", 0) else "raw"
    pixels = _pixels(network, node, "filename", space, None)
    if pixels is None:
        return network.value(node, "missingColor")
    return _placed(network, node, pixels, ("repeat", "repeat"), coordinates(network, node, "manifold"))


_SQUARE = 64  # pixels a side of a checkerboard's square, which limits how sharp its edges are


def _checkerboard(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's checkerboard, or MaterialX's, as an image of two by two squares."""
    if str(node.GetShaderId()).startswith("arnold:"):
        first, second = (network.vector(node, name, (value,) * 3) for name, value in (("color1", 1.0), ("color2", 0.0)))
        frequency = [float(network.vector(node, f"{axis}_frequency", (1.0,))[0]) for axis in "uv"]
        offset = [float(network.vector(node, f"{axis}_offset", (0.0,))[0]) for axis in "uv"]
        uv_name, transform = str(network.plain(node, "uvset", "")), np.eye(3)
        placed = affine(np.diag(frequency), np.array(offset))
    else:
        first, second = (network.vector(node, name, (value,) * 3) for name, value in (("color2", 0.0), ("color1", 1.0)))
        uv_name, transform = coordinates(network, node, "texcoord")
        placed = np.diag([*(0.5 * network.vector(node, "uvtiling", (8.0, 8.0))), 1.0])
    pattern = np.kron(np.array([[1, 0], [0, 1]]), np.ones((_SQUARE, _SQUARE)))[..., None]
    pixels = (second + pattern * (first - second)).astype(np.float32)
    return Image(pixels, ("repeat", "repeat"), placed @ transform, uv_name or "st")


IMAGES: dict[str, Node] = {
    "UsdUVTexture": _usd_uv_texture,
    "HwUvTexture": _usd_uv_texture,
    "image": _materialx_image,
    "tiledimage": _materialx_image,
    "gltf": _materialx_image,
    "checkerboard": _checkerboard,
    "arnold:image": _arnold_image,
    "arnold:checkerboard": _checkerboard,
    "PxrTexture": _renderman_texture,
}


def image_input(network: Network, node: UsdShade.Shader, name: str, space: str = "auto") -> Value | None:
    """Return the image that an input itself names, as in NVIDIA's shaders, with the UVs `st`."""
    pixels = _pixels(network, node, name, space, None)
    if pixels is None:
        return None
    return _placed(network, node, pixels, ("repeat", "repeat"), ("st", np.eye(3)))


def _pixels(
    network: Network, node: UsdShade.Shader, name: str, space: str, fallback: Value | None
) -> tuple[Array, Tiles | None] | None:
    """Return pixels with four channels, and how they are tiles, if they are; or None, with a warning."""
    attribute = network.source(node, name)
    asset = None if attribute is None else attribute.Get(network.reading.time)
    if attribute is None or asset is None or is_output(attribute):
        return None
    prim, own = attribute.GetPrim(), str(attribute.GetName())
    path = asset.path if isinstance(asset, Sdf.AssetPath) else str(asset)
    if _UDIM.search(path):
        found, problem = _tiles(network.reading, attribute, _UDIM.sub("<UDIM>", path), space)
    else:
        pixels, problem = find_image(network.reading, prim, own, space)
        found = None if pixels is None else (pixels, None)
    if problem:
        instead = "the default" if fallback is None else "its fallback"
        network.reading.lack(prim, f"{problem}; {instead} is used", own)
    return None if found is None else (_four_channels(found[0]), found[1])


def _tiles(
    reading: Reading, attribute: Usd.Attribute, path: str, space: str
) -> tuple[tuple[Array, Tiles | None] | None, str]:
    """Return the tiles of a UDIM texture in one image, and how they lie; or None, and why there is none."""
    prim, name = attribute.GetPrim(), str(attribute.GetName())
    layer = next((spec.layer for spec in attribute.GetPropertyStack(reading.time) if spec.layer), None)
    files = UsdShade.UdimUtils.ResolveUdimTilePaths(path, layer or reading.stage.GetRootLayer())
    if not files:
        return None, f"names {path}: expected files with numbers from 1001 on, but there are none"
    places = {divmod(int(number) - 1001, 10)[::-1]: str(Ar.GetResolver().Resolve(file) or file)
              for file, number in files}  # fmt: skip
    corner = np.min(list(places), axis=0)
    columns, rows = np.max(list(places), axis=0) - corner + 1
    known = known_space(reading, prim, name, space)
    limit = max(1, int(texture_limit(reading.stage) / np.sqrt(columns * rows)))
    tiles = {}
    for place, file in places.items():
        pixels, problem = image_at(reading, prim, name, file, known, limit)
        if pixels is None:
            reading.lack(prim, f"{problem}; black is used", name)
            continue
        tiles[place] = _four_channels(pixels)
    if not tiles:
        return None, f"names {path}: expected images that can be read"
    height, width = np.max([each.shape[:2] for each in tiles.values()], axis=0)
    atlas = np.zeros((rows * height, columns * width, 4), np.float32)
    for (column, row), pixels in tiles.items():
        top, left = (rows - 1 - (row - corner[1])) * height, (column - corner[0]) * width
        lines, places_across = (np.arange(n) * own // n for n, own in zip((height, width), pixels.shape, strict=False))
        atlas[top : top + height, left : left + width] = pixels[np.ix_(lines, places_across)]
    return (atlas, Tiles(attribute, frozenset(places))), ""


def _four_channels(pixels: Array) -> Array:
    """Return pixels as RGBA: grey is repeated, and a missing alpha is 1."""
    count = pixels.shape[2]
    if count == 4:
        return pixels
    alpha = pixels[..., -1:] if count == 2 else np.ones_like(pixels[..., :1])
    return np.concatenate([rgb(pixels), alpha], axis=2)


def _placed(
    network: Network, node: UsdShade.Shader, found: tuple[Array, Tiles | None], wrap: tuple[str, str],
    coordinates: tuple[str, Array],
) -> Image:  # fmt: skip
    pixels, tiles = found
    uv_name, transform = coordinates
    if tiles is None:
        return Image(pixels, wrap, transform, uv_name or "st")
    corner = np.min(list(tiles.there), axis=0)
    size = np.max(list(tiles.there), axis=0) - corner + 1
    square = affine(np.diag(1 / size), -corner / size)
    return Image(pixels, ("clamp", "clamp"), square, uv_name or "st", tiles=(tiles,)).moved(transform)


def _wraps(network: Network, node: UsdShade.Shader, names: tuple[str, str], default: str, file: str) -> tuple[str, str]:
    """Return the wrap modes that two inputs name; if they leave these to the file, its own modes, or else repeat."""
    found = []
    for name in names:
        value = str(network.plain(node, name, default))
        if value not in _WRAPS:
            known = ", ".join(list(_WRAPS)[:5])
            network.lose(node, f"is '{value}': expected one of {known}; repeat is used", name)
        found.append(_WRAPS.get(value, "repeat"))
    if all(found):
        return found[0], found[1]
    asset = network.plain(node, file)
    path = resolved(network.reading, asset) if isinstance(asset, Sdf.AssetPath) and asset.path else ""
    own = wrap_modes(path) if path and not Ar.IsPackageRelativePath(path) else None
    first, second = (_WRAPS.get(each, "") or "repeat" for each in own or ("repeat", "repeat"))
    return found[0] or first, found[1] or second


def coordinates(network: Network, node: UsdShade.Shader, name: str) -> tuple[str, Array]:
    """Return the primvar of an image's UVs, "" if none is named, and their (3, 3) transform."""
    transform = np.eye(3)
    for _ in range(_LONGEST):
        inner = network.connected(node, name)
        if inner is None:
            break
        node, kind = inner, category(inner)
        if kind in ("UsdPrimvarReader", "HwPrimvar", "PxrManifold2D", "PxrPrimvar"):
            return str(network.plain(node, "varname", "") or network.plain(node, "primvarS", "")), transform
        if kind in ("geompropvalue", "texcoord"):
            return str(network.plain(node, "geomprop", "")), transform
        if kind not in _TRANSFORMS:
            network.lose(node, f"is a shader '{node.GetShaderId()}', which is not rendered: UVs are used as they are")
            break
        name, own = _TRANSFORMS[kind](network, node)
        transform = transform @ own
    return "", transform


def _usd_transform_2d(network: Network, node: UsdShade.Shader) -> tuple[str, Array]:
    """Read a UsdTransform2d: scale, then rotate counter-clockwise by degrees, then translate."""
    turned = rotation(float(network.vector(node, "rotation", (0.0,))[0]))
    scale = network.vector(node, "scale", (1.0, 1.0))
    return "in", affine(turned * scale, network.vector(node, "translation", (0.0, 0.0)))


def _place_2d(network: Network, node: UsdShade.Shader) -> tuple[str, Array]:
    """Read MaterialX's place2d: divide by the scale, rotate clockwise, subtract the offset, all about the pivot."""
    scale = np.diag(1 / np.where((found := network.vector(node, "scale", (1.0, 1.0))) == 0, 1, found))
    turned = rotation(-float(network.vector(node, "rotate", (0.0,))[0]))
    offset, pivot = network.vector(node, "offset", (0.0, 0.0)), network.vector(node, "pivot", (0.0, 0.0))
    if network.plain(node, "operationorder", 0) == 1:
        linear, moved = scale @ turned, -scale @ turned @ offset
    else:
        linear, moved = turned @ scale, -offset
    return "texcoord", affine(linear, moved + pivot - linear @ pivot)


def _arithmetic(network: Network, node: UsdShade.Shader) -> tuple[str, Array]:
    """Read UVs that are multiplied or divided by a constant, or to which one is added or subtracted."""
    kind = category(node)
    by = network.vector(node, "in2", (0.0, 0.0) if kind in ("add", "subtract") else (1.0, 1.0))
    if kind in ("add", "subtract"):
        return "in1", affine(np.eye(2), by if kind == "add" else -by)
    return "in1", affine(np.diag(by if kind == "multiply" else 1 / np.where(by == 0, 1, by)), np.zeros(2))


_TRANSFORMS: dict[str, Any] = {
    "UsdTransform2d": _usd_transform_2d, "place2d": _place_2d,
    **dict.fromkeys(("add", "subtract", "multiply", "divide"), _arithmetic),
}  # fmt: skip


def rotation(degrees: float) -> Array:
    """Return a counter-clockwise rotation, (2, 2)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def affine(linear: Array, moved: Array) -> Array:
    """Return a linear transform of UVs, (2, 2), followed by a translation, as a (3, 3) matrix."""
    result = np.eye(3)
    result[:2, :2], result[:2, 2] = linear, moved
    return result
