"""Apply a material to one mesh: images over the mesh's UVs, and values of primvars at its vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...scene import Array, Material, VertexValues, rgb
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from ..materials.bound import COLORS, TEXTURED, Bound, plain, texture_of
from ..materials.kept import kept
from ..materials.values import Image, Tiles, constant
from .polygons import Triangles
from .primvars import find_primvar, flattened

_MOST_COPIES = 16  # of an image side by side, if it repeats in only one direction


def primvars_of(reading: Reading, prim: Usd.Prim, bound: Bound) -> tuple[dict[str, Array], dict[str, UsdGeom.Primvar]]:
    """Return the primvars of a gprim that a material uses, by its fields: constants (1, C), and those that vary."""
    constants, varying = {}, {}
    for name, wanted in bound.primvars.items():
        primvar = find_primvar(prim, wanted.name)
        values = None if primvar is None else flattened(reading, prim, primvar, None)
        if primvar is None or values is None or not len(values):
            continue
        if len(values) == 1 or primvar.GetInterpolation() == "constant":
            constants[name] = values[:1]
        else:
            varying[name] = primvar
    return constants, varying


def on_mesh(
    reading: Reading, prim: Usd.Prim, bound: Bound, triangles: Triangles, constants: Mapping[str, Array]
) -> Material:
    """Return a bound material, completed with what depends on the mesh.

    Parameters
    ----------
    triangles
        Their values are the texture coordinates, without which images are replaced by their means, and primvars that
        vary, by fields of the material.
    constants
        Primvars of one value, (1, C), by fields of the material.
    """
    primvars, uvs = {**triangles.values, **constants}, triangles.values.get("uvs")
    changes: dict[str, Any] = {}
    for name, primvar in bound.primvars.items():
        if name in primvars:
            raw = primvar.function(primvars[name])
            values = np.clip(raw, 0, 1)
            if not np.allclose(values, raw, rtol=0, atol=1e-5):
                text = f"has {primvar.name} from {raw.min():g} to {raw.max():g}: expected 0 to 1; the nearest is used"
                reading.warn(prim, text)
            values = rgb(values) if name in COLORS else values[:, :1]
            varies = len(values) > 1 and bool(np.any(values != values[0]))
            changes[name] = VertexValues(np.ascontiguousarray(values)) if varies else plain(name, values[0])
            if name == "opacity" and np.any(values < 1):
                changes["presence"] = True
    if bound.images and uvs is None:
        reading.warn(prim, f"has no primvar '{bound.uv_name}' for its textures: their mean colour is used")
    if uvs is not None:
        for tiles in dict.fromkeys(each for image in bound.images.values() for each in image.tiles):
            _lack_tiles(reading, tiles, uvs[triangles.vertices])
        for name, image in bound.images.items():
            changes[name] = _texture(reading, prim, name, image, uvs=uvs)
    return replace(bound.material, **changes) if changes else bound.material


_SIDE = 10  # columns of tiles, and the rows that OpenUSD finds: 1001 to 1100
_EDGE = 1e-4  # of a tile, by which a triangle reaches into one that it uses
_FARTHEST = 1e6  # tiles from the first, where single precision no longer tells places in a tile apart
_NAMED = 5  # how many missing tiles are named


def _lack_tiles(reading: Reading, tiles: Tiles, corners: Array) -> None:
    """Warn about tiles that are not there, and that triangles use whose UVs have these corners, (T, 3, 2)."""
    with np.errstate(all="ignore"):  # UVs need not be finite
        corners = corners @ tiles.transform[:2, :2].T + tiles.transform[:2, 2]
    missing = _missing_tiles(corners, tiles)
    if missing:
        numbers = ", ".join(str(1001 + column + _SIDE * row) for row, column in missing[:_NAMED])
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        text = f"names tiles without {numbers}{more}: expected all that a mesh uses; black or the nearest is used"
        reading.lack(tiles.attribute.GetPrim(), text, str(tiles.attribute.GetName()))


def _missing_tiles(corners: Array, tiles: Tiles) -> list[tuple[int, int]]:
    """Return (row, column) of the tiles that are not there and that triangles use, in the order of their numbers."""
    corners = corners[np.all(np.abs(corners) < _FARTHEST, axis=(1, 2))]
    low, high = corners.min(axis=1) + _EDGE, corners.max(axis=1) - _EDGE
    first = np.floor(low.min(axis=0, initial=_SIDE)).clip(0).astype(int)
    last = np.ceil(high.max(axis=0, initial=0)).clip(max=_SIDE).astype(int)
    missing = []
    for row in range(first[1], last[1]):
        for column in range(first[0], last[0]):
            tile = column, row
            near = np.all((low < np.add(tile, 1)) & (high > tile), axis=1)
            if tile not in tiles.there and np.any(_overlap(corners[near] - tile)):
                missing.append((row, column))
    return missing


def _overlap(corners: Array) -> Array:
    """Return which triangles, (T, 3, 2), whose boxes overlap the unit square reach into it themselves, (T,).

    They do unless an edge of the triangle separates the two, by the separating axis theorem.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
    along = np.einsum("tnc,tkc->tnk", normals, corners)
    center, half = normals.sum(axis=-1) / 2, np.abs(normals).sum(axis=-1) * (0.5 - _EDGE)
    return np.all((center - half <= along.max(axis=-1)) & (center + half >= along.min(axis=-1)), axis=1)


def _texture(reading: Reading, prim: Usd.Prim, name: str, image: Image, *, uvs: Array) -> Any:
    """Return an image that matches its two wrap modes on the mesh's UVs, or its colour if all pixels are the same.

    The renderer has one mode for both.
    """
    cache, key, extended = kept(reading), ("texture", name, id(image)), image
    if not image.wrap[0] == image.wrap[1] != "black":
        seen = np.c_[uvs, np.ones(len(uvs))] @ image.transform[:2].T
        low, high = np.floor(seen.min(axis=0) + 1e-6).astype(int), np.ceil(seen.max(axis=0) - 1e-6).astype(int)
        high = np.maximum(high, low + 1)
        cache, key = reading.cache, (*key, *low.tolist(), *high.tolist())
        if key not in cache:
            extended = _extended(reading, prim, image, low, high - low)
    if key not in cache:
        texture = texture_of(name, extended, extended.wrap[0])
        even = name in TEXTURED and bool(np.all(texture.pixels == texture.pixels[:1, :1]))
        # It keeps the image alive, and so its id unique.
        cache[key] = plain(name, constant(image)) if even else texture, image
    return cache[key][0]


def _extended(reading: Reading, prim: Usd.Prim, image: Image, low: Array, counts: Array) -> Image:
    """Return an image that covers so many squares from `low` on; with a warning, fewer if these are too many.

    Beyond its own square the image is repeated or mirrored. A clamped image ends there, and one that wraps to black
    gets an edge with the value that black has after the network.
    """
    pixels, transform = image.pixels, np.eye(3)
    for axis, wrap in enumerate(image.wrap):
        direction = 1 - axis  # axis of the array: v goes up along its rows
        if wrap in ("repeat", "mirror"):
            first, count = int(low[axis]), int(counts[axis])
            if count > _MOST_COPIES:
                text = f"repeats a texture {count} times in one direction: only {_MOST_COPIES} are shown"
                reading.warn(prim, text)
            flipped = np.flip(pixels, direction) if wrap == "mirror" else pixels
            numbers = range(first, first + min(count, _MOST_COPIES))
            copies = [flipped if number % 2 else pixels for number in numbers]
            pixels = np.concatenate(copies if axis == 0 else copies[::-1], axis=direction)
            transform[axis, axis], transform[axis, 2] = 1 / len(copies), -first / len(copies)
        elif wrap == "black":
            size = pixels.shape[direction]
            edge = np.broadcast_to(image.beyond, np.take(pixels, [0], direction).shape).astype(np.float32)
            pixels = np.concatenate([edge, pixels, edge], axis=direction)
            transform[axis, axis], transform[axis, 2] = size / (size + 2), 1 / (size + 2)
    return replace(image, pixels=pixels, wrap=("clamp", "clamp"), transform=transform @ image.transform)
