"""Read nodes that are images: files, UDIM tiles and checkerboards, and their placement on a surface."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from ...images.textures import wrap_modes
from ...scene import Array, rgb
from ..common.openusd import Ar, Sdf, Usd, UsdShade
from ..common.reading import Reading
from ..common.textures import find_image, image_at, known_space, resolved, texture_limit
from .network import NodeReader, ShaderNode, is_output
from .values import Image, Tiles, Value, mapped, resized

_WRAPS = {
    "repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "black", "useMetadata": "",
    "periodic": "repeat", "constant": "black", "file": "", "missing": "black",
}  # fmt: skip
_LONGEST = 16  # transforms of UVs in a chain, which also ends loops
_UDIM = re.compile(r"<UDIM>|%\(UDIM\)d|<udim>")


def _usd_uv_texture(node: ShaderNode) -> Value | None:
    """Read a UsdUVTexture: four channels, with scale and bias, or its fallback if there is no image."""
    space = node.text("sourceColorSpace", "auto")
    image = read_image(node, "file", space, missing="fallback", wraps=("wrapS", "wrapT"), wrap="useMetadata", uvs="st")
    return _scaled(image, node.vector("scale", (1.0,) * 4), node.vector("bias", (0.0,) * 4))


def _materialx_image(node: ShaderNode) -> Value | None:
    """Read MaterialX's `image`, `tiledimage` and `gltf_colorimage`; only files of colours have a colour space."""
    name = node.label
    # As in Storm and Karma, 8-bit files of colours are sRGB unless they say otherwise.
    space = "auto" if "color" in name.removeprefix("ND_gltf_color") else "raw"
    placed = np.eye(3)
    if "tiledimage" in name:
        size = node.vector("realworldtilesize", (1.0, 1.0))
        size = size / np.maximum(node.vector("realworldimagesize", (1.0, 1.0)), 1e-9)
        tiling, offset = node.vector("uvtiling", (1.0, 1.0)), node.vector("uvoffset", (0.0, 0.0))
        placed = affine(np.diag(size * tiling), -offset * size)
    image = read_image(
        node, "file", space, missing="default", wraps=("uaddressmode", "vaddressmode"), uvs="texcoord", placed=placed
    )
    single = isinstance(image, Image) and re.search(r"_float\b|_float$", name)
    return mapped(lambda values: values[..., :1], image) if image is not None and single else image


def _arnold_image(node: ShaderNode) -> Value | None:
    scale, offset = ([node.scalar(f"{axis}{name}", default) for axis in "st"]
                     for name, default in (("scale", 1.0), ("offset", 0.0)))  # fmt: skip
    flipped = np.array([node.flag(name) for name in ("sflip", "tflip")], dtype=float)
    placed = affine(np.diag(1 - 2 * flipped), flipped) @ affine(np.diag(scale), np.array(offset))
    if node.flag("swap_st"):
        placed = placed[[1, 0, 2]]
    missing = "missing_texture_color" if node.flag("ignore_missing_textures") else ""
    image = read_image(
        node, "filename", node.text("color_space", "auto"), missing=missing, wraps=("swrap", "twrap"), uvs="uvcoords",
        placed=placed, uv_name=node.text("uvset"),
    )  # fmt: skip
    return _scaled(image, node.vector("multiply", (1.0,) * 3), node.vector("offset", (0.0,) * 3))


def _renderman_texture(node: ShaderNode) -> Value | None:
    space = "sRGB" if node.flag("linearize") else "raw"
    return read_image(node, "filename", space, missing="missingColor", uvs="manifold")


def _scaled(image: Value | None, factor: Array, added: Array) -> Value | None:
    """Return an image whose first channels are multiplied, and to which numbers are added; no other value changes."""
    count = len(factor)
    if not isinstance(image, Image) or (np.all(factor == 1) and np.all(added == 0)):
        return image

    def scaled(values: Array) -> Array:
        return np.concatenate([values[..., :count] * factor + added, values[..., count:]], axis=-1)

    return mapped(scaled, image)


_SQUARE = 64  # pixels a side of a checkerboard's square, which limits how sharp its edges are


def _arnold_checkerboard(node: ShaderNode) -> Value:
    frequency, offset = ([node.scalar(f"{axis}_{name}", default) for axis in "uv"]
                         for name, default in (("frequency", 1.0), ("offset", 0.0)))  # fmt: skip
    colors = node.vector("color1", (1.0,) * 3), node.vector("color2", (0.0,) * 3)
    return _checkerboard(colors, affine(np.diag(frequency), np.array(offset)), node.text("uvset"))


def _materialx_checkerboard(node: ShaderNode) -> Value:
    uv_name, transform = coordinates(node, "texcoord")
    placed = np.diag([*(0.5 * node.vector("uvtiling", (8.0, 8.0))), 1.0])
    colors = node.vector("color2", (0.0,) * 3), node.vector("color1", (1.0,) * 3)
    return _checkerboard(colors, placed @ transform, uv_name)


def _checkerboard(colors: tuple[Array, Array], transform: Array, uv_name: str) -> Image:
    """Return an image of two by two squares, whose upper left one has the first colour."""
    first, second = colors
    pattern = np.kron(np.eye(2), np.ones((_SQUARE, _SQUARE)))[..., None]
    pixels = (second + pattern * (first - second)).astype(np.float32)
    return Image(pixels, ("repeat", "repeat"), transform, uv_name or "st")


IMAGES: dict[str, NodeReader] = {
    "UsdUVTexture": _usd_uv_texture,
    "HwUvTexture": _usd_uv_texture,
    "image": _materialx_image,
    "tiledimage": _materialx_image,
    "gltf": _materialx_image,
    "checkerboard": _materialx_checkerboard,
    "arnold:image": _arnold_image,
    "arnold:checkerboard": _arnold_checkerboard,
    "PxrTexture": _renderman_texture,
}


def read_image(
    node: ShaderNode,
    file: str,
    space: str,
    *,
    missing: str = "",
    wraps: tuple[str, str] = ("", ""),
    wrap: str = "periodic",
    uvs: str = "",
    placed: Array | None = None,
    uv_name: str = "",
) -> Value | None:
    """Return the image that a node's input names, or what it is without the image, or None.

    Parameters
    ----------
    file, missing, wraps, uvs
        The inputs with the file, the value without one, the wrap modes and the coordinates.
    space, wrap
        The colour space and the wrap mode if the inputs do not tell.
    placed
        Transform of the coordinates, (3, 3), by the node itself.
    uv_name
        Primvar of the coordinates; "": the one that their node names, or else st.
    """
    fallback = node.value(missing)
    pixels, tiles = _pixels(node, file, space, "the default" if fallback is None else "its fallback")
    if pixels is None:
        return fallback
    modes = _wraps(node, wraps, wrap, file)
    named, transform = coordinates(node, uvs)
    if placed is not None:
        transform = placed @ transform
    uv_name = uv_name or named or "st"
    if tiles is None:
        return Image(pixels, modes, transform, uv_name)
    corner = np.min(list(tiles.there), axis=0)
    size = np.max(list(tiles.there), axis=0) - corner + 1
    square = affine(np.diag(1 / size), -corner / size)
    return Image(pixels, ("clamp", "clamp"), square, uv_name, tiles=(tiles,)).moved(transform)


def _pixels(node: ShaderNode, name: str, space: str, instead: str) -> tuple[Array | None, Tiles | None]:
    """Return pixels with four channels, or None, with a warning; and how they are tiles, if they are."""
    attribute, reading = node.source(name), node.network.reading
    asset = None if attribute is None else attribute.Get(reading.time)
    if attribute is None or asset is None or is_output(attribute):
        return None, None
    prim, own, tiles = attribute.GetPrim(), str(attribute.GetName()), None
    path = asset.path if isinstance(asset, Sdf.AssetPath) else str(asset)
    if _UDIM.search(path):
        path = _UDIM.sub("<UDIM>", path)
        places = _places(reading, attribute, path)
        pixels, tiles = _atlas(reading, attribute, places, space), Tiles(attribute, frozenset(places))
        expected = "images that can be read" if places else "files with numbers from 1001 on, but there are none"
        problem = f"names {path}: expected {expected}" if pixels is None else ""
    else:
        pixels, problem = find_image(reading, prim, own, space)
    if problem:
        reading.lack(prim, f"{problem}; {instead} is used", own)
    return None if pixels is None else _four_channels(pixels), tiles


def _places(reading: Reading, attribute: Usd.Attribute, path: str) -> dict[tuple[int, int], str]:
    """Return the files of a UDIM texture by column and row."""
    layer = next((spec.layer for spec in attribute.GetPropertyStack(reading.time) if spec.layer), None)
    files = UsdShade.UdimUtils.ResolveUdimTilePaths(path, layer or reading.stage.GetRootLayer())
    return {((int(number) - 1001) % 10, (int(number) - 1001) // 10): str(Ar.GetResolver().Resolve(file) or file)
            for file, number in files}  # fmt: skip


def _atlas(
    reading: Reading, attribute: Usd.Attribute, places: dict[tuple[int, int], str], space: str
) -> Array | None:  # fmt: skip
    """Return tiles of a UDIM texture in one image, which is black where one cannot be read; None if none can."""
    if not places:
        return None
    prim, name = attribute.GetPrim(), str(attribute.GetName())
    corner = np.min(list(places), axis=0)
    columns, rows = np.max(list(places), axis=0) - corner + 1
    known = known_space(reading, prim, name, space)
    limit = max(1, int(texture_limit(reading.stage) / np.sqrt(columns * rows)))
    tiles = {}
    for place, file in places.items():
        pixels, problem = image_at(reading, prim, name, file, known, limit)
        if pixels is None:
            reading.lack(prim, f"{problem}; black is used", name)
        else:
            tiles[place] = _four_channels(pixels)
    if not tiles:
        return None
    height, width = np.max([each.shape[:2] for each in tiles.values()], axis=0)
    atlas = np.zeros((rows * height, columns * width, 4), np.float32)
    for (column, row), pixels in tiles.items():
        top, left = (rows - 1 - (row - corner[1])) * height, (column - corner[0]) * width
        atlas[top : top + height, left : left + width] = resized(pixels, (height, width))
    return atlas


def _four_channels(pixels: Array) -> Array:
    """Return pixels as RGBA: grey is repeated, and a missing alpha is 1."""
    count = pixels.shape[2]
    if count == 4:
        return pixels
    alpha = pixels[..., -1:] if count == 2 else np.ones_like(pixels[..., :1])
    return np.concatenate([rgb(pixels), alpha], axis=2)


def _wraps(node: ShaderNode, names: tuple[str, str], default: str, file: str) -> tuple[str, str]:
    """Return the wrap modes that two inputs name; if they leave these to the file, its own modes, or else repeat."""
    modes = []
    for name in names:
        value = node.text(name, default)
        if value not in _WRAPS:
            expected = ", ".join(list(_WRAPS)[:5])
            node.lose(f"is '{value}': expected one of {expected}; repeat is used", name)
        modes.append(_WRAPS.get(value, "repeat"))
    if not all(modes):
        asset = node.plain(file)
        path = resolved(node.network.reading, asset) if isinstance(asset, Sdf.AssetPath) and asset.path else ""
        stored = wrap_modes(path) if path and not Ar.IsPackageRelativePath(path) else None
        of_file = (_WRAPS.get(each, "") or "repeat" for each in stored or ("repeat", "repeat"))
        modes = [mode or other for mode, other in zip(modes, of_file, strict=True)]
    return modes[0], modes[1]


def coordinates(node: ShaderNode, name: str) -> tuple[str, Array]:
    """Return the primvar of an image's UVs, "" if none is named, and their (3, 3) transform."""
    transform = np.eye(3)
    for _ in range(_LONGEST):
        inner = node.connected(name)
        if inner is None:
            break
        node = inner
        if node.category in _COORDINATES:
            return next(filter(None, map(node.text, ("varname", "primvarS", "geomprop"))), ""), transform
        if node.category not in _TRANSFORMS:
            node.lose(f"is a shader '{node.label}', which is not rendered: UVs are used as they are")
            break
        name, moved = _TRANSFORMS[node.category]
        transform = transform @ moved(node)
    return "", transform


def _usd_transform_2d(node: ShaderNode) -> Array:
    """Read a UsdTransform2d: scale, then rotate counter-clockwise by degrees, then translate."""
    scale = node.vector("scale", (1.0, 1.0))
    return affine(rotation(node.scalar("rotation", 0.0)) * scale, node.vector("translation", (0.0, 0.0)))


def _place_2d(node: ShaderNode) -> Array:
    """Read MaterialX's place2d: divide by the scale, rotate clockwise, subtract the offset, all about the pivot."""
    scale = np.diag(_inverse(node.vector("scale", (1.0, 1.0))))
    turned = rotation(-node.scalar("rotate", 0.0))
    offset, pivot = node.vector("offset", (0.0, 0.0)), node.vector("pivot", (0.0, 0.0))
    if node.plain("operationorder", 0) == 1:
        linear, moved = scale @ turned, -scale @ turned @ offset
    else:
        linear, moved = turned @ scale, -offset
    return affine(linear, moved + pivot - linear @ pivot)


def _added(node: ShaderNode) -> Array:
    by = node.vector("in2", (0.0, 0.0))
    return affine(np.eye(2), by if node.category == "add" else -by)


def _multiplied(node: ShaderNode) -> Array:
    by = node.vector("in2", (1.0, 1.0))
    return affine(np.diag(by if node.category == "multiply" else _inverse(by)), np.zeros(2))


def _inverse(values: Array) -> Array:
    return 1 / np.where(values == 0, 1, values)


_COORDINATES = ("UsdPrimvarReader", "HwPrimvar", "PxrManifold2D", "PxrPrimvar", "geompropvalue", "texcoord")
# Nodes that transform UVs, with their inputs for these.
_TRANSFORMS: dict[str, tuple[str, Callable[[ShaderNode], Array]]] = {
    "UsdTransform2d": ("in", _usd_transform_2d), "place2d": ("texcoord", _place_2d), "add": ("in1", _added),
    "subtract": ("in1", _added), "multiply": ("in1", _multiplied), "divide": ("in1", _multiplied),
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
