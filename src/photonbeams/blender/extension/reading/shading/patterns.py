"""Textures: what the manual of Blender says of each, over arrays; images are read at the nearest pixel.

Noise is Perlin's (2002) with the hash of Jenkins (2006).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..images import MISSING, is_missing
from .calls import Call, Functions
from .functions import length_of

_SCALE = 0.982  # Blender's, which keeps noise of three dimensions in -1 to 1
# Steps of the hash: which of the numbers a, b, c is changed, by which other one, and by how many bits that is turned.
_STEPS = ((2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24))
_STREAM = 31  # between the cells of independent numbers


def _noise(call: Call) -> Any:
    place = call.place() * call["Scale"]
    if call.node.noise_dimensions == "1D":
        place = np.zeros_like(place)
    if call.node.noise_dimensions in ("1D", "4D"):
        place = place + call["W"] * 1.37
    shifts = (0.0,) if call.is_number else (0.0, 143.7, 271.3)
    octaves = float(call["Detail"].mean()), call["Roughness"], call["Lacunarity"]
    return np.hstack([_fractal(place + shift, *octaves) for shift in shifts])


def _voronoi(call: Call) -> Any:
    """Return what the nearest of points that are one in each cell has: its distance or colour."""
    if call.output not in ("Distance", "Color"):
        raise call.unknown()
    place = call.place() * call["Scale"]
    cell = np.floor(place).astype(np.int64)
    nearest, second, color = np.inf, np.inf, np.zeros(3)
    for each in np.ndindex(3, 3, 3):
        around = cell + each - 1
        random = _hashed(around, 3)
        away = length_of(around + call["Randomness"] * random - place)
        color = np.where(away < nearest, random, color)
        nearest, second = np.minimum(nearest, away), np.minimum(second, np.maximum(nearest, away))
    return color if call.output == "Color" else second if call.node.feature == "F2" else nearest


def _checker(call: Call) -> Any:
    place = call.place() * call["Scale"]
    even = np.floor((place + 1e-6) * 0.999999).sum(axis=1, keepdims=True) % 2 == 0
    return even if call.is_number else np.where(even, call["Color1"], call["Color2"])


def _brick(call: Call) -> Any:
    node, place = call.node, call.place() * call["Scale"]
    wide, high = call["Brick Width"], call["Row Height"]
    row = np.floor(place[:, 1:2] / high)
    along = place[:, :1] + np.where(row % max(node.offset_frequency, 1) == 0, node.offset * wide, 0)
    x, y = along % wide, place[:, 1:2] - row * high
    mortar = np.minimum(np.minimum(x, wide - x), np.minimum(y, high - y)) < call["Mortar Size"]
    if call.is_number:
        return mortar
    number = np.hstack([np.floor(along / wide), row, 0 * row]).astype(np.int64)
    tint = np.clip(_hashed(number, 1) + call["Bias"], 0, 1)
    return np.where(mortar, call["Mortar"], call["Color1"] + tint * (call["Color2"] - call["Color1"]))


def _gradient(call: Call) -> Any:
    place = call.place()
    x, y, _ = np.split(place, 3, axis=1)
    ball, t = np.maximum(1 - length_of(place), 0), np.clip(x, 0, 1)
    values = {
        "LINEAR": x, "QUADRATIC": t**2, "DIAGONAL": (x + y) / 2, "SPHERICAL": ball, "EASING": t * t * (3 - 2 * t),
        "QUADRATIC_SPHERE": ball**2, "RADIAL": np.arctan2(y, x) / (2 * np.pi) + 0.5,
    }  # fmt: skip
    return np.clip(values[call.node.gradient_type], 0, 1)


def _wave(call: Call) -> Any:
    node, place = call.node, call.place() * call["Scale"]
    if node.wave_type == "BANDS":
        axis = {"X": [20, 0, 0], "Y": [0, 20, 0], "Z": [0, 0, 20]}.get(node.bands_direction, [10, 10, 10])
        phase = place @ np.reshape(axis, (3, 1))
    else:
        away = {"X": [0, 1, 1], "Y": [1, 0, 1], "Z": [1, 1, 0]}.get(node.rings_direction, [1, 1, 1])
        phase = 20 * length_of(place * away)
    if np.any(call["Distortion"] != 0):
        octaves = float(call["Detail"].mean()), call["Detail Roughness"], 2.0
        phase = phase + call["Distortion"] * (2 * _fractal(place * call["Detail Scale"], *octaves) - 1)
    turns = (phase + call["Phase Offset"]) / (2 * np.pi)
    match node.wave_profile:
        case "SIN":
            return 0.5 - 0.5 * np.cos(2 * np.pi * turns)
        case "SAW":
            return turns - np.floor(turns)
    return 2 * np.abs(turns - np.floor(turns + 0.5))


def _white_noise(call: Call) -> Any:
    return _hashed(np.floor(call.place() * 2.0**20).astype(np.int64), 1 if call.is_number else 3)


def _image(call: Call) -> Any:
    node = call.node
    colors = call.points.images.get(node)
    if colors is None:
        pixels = pixels_of(node.image)
        if pixels is None and node.image is not None and is_missing(node.image):
            pixels = np.array([[[*MISSING, 1.0]]])
        if pixels is None:
            raise call.unknown()
        colors = _nearest(pixels, *call.place(call.points.uv)[:, :2].T)
    return colors[:, 3:] if call.output == "Alpha" else colors[:, :3]


def _environment(call: Call) -> Any:
    pixels = pixels_of(call.node.image)
    if pixels is None or call.node.projection != "EQUIRECTANGULAR":
        raise call.unknown()
    x, y, z = call.place().T
    u = np.arctan2(y, -x) / (2 * np.pi) + 0.5
    v = np.arctan2(z, np.hypot(x, y)) / np.pi + 0.5
    return _nearest(pixels, u, np.minimum(v, 1 - 1e-9))[:, :3]


def _nearest(pixels: Any, u: Any, v: Any) -> Any:
    """Return the colours (N, 4) of the pixels at places from 0 to 1, beyond which the image is repeated."""
    height, width = pixels.shape[:2]
    return pixels[(v * height).astype(np.int64) % height, (u * width).astype(np.int64) % width]


def pixels_of(image: Any) -> Any:
    """Return the scene-linear pixels (H, W, 4) of an image, from the bottom row up; None if it has none."""
    if image is None or not image.size[0] or image.channels not in (3, 4):
        return None
    pixels = np.ones((image.size[1], image.size[0], 4), np.float32)
    flat = np.empty(pixels[..., : image.channels].size, np.float32)
    image.pixels.foreach_get(flat)
    pixels[..., : image.channels] = flat.reshape(*pixels.shape[:2], -1)
    if not image.is_float and not image.colorspace_settings.is_data and image.colorspace_settings.name == "sRGB":
        color = pixels[..., :3]
        pixels[..., :3] = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    return pixels


def _fractal(points: Any, detail: float, roughness: Any, lacunarity: Any) -> Any:
    """Return noise (N, 1) from 0 to 1, about 0.5, at points (N, 3): `detail` octaves beyond the first."""
    detail = float(np.clip(detail, 0, 15))
    whole, part = int(detail), detail % 1
    total, most, amplitude, scale = 0.0, 0.0, 1.0, 1.0
    sums = []
    for _ in range(whole + 2):
        total, most = total + amplitude * _perlin(points * scale), most + amplitude
        amplitude, scale = amplitude * roughness, scale * lacunarity
        sums.append(0.5 * total / most + 0.5)
    return sums[whole] + part * (sums[whole + 1] - sums[whole])


def _perlin(points: Any) -> Any:
    """Return noise (N, 1) from -1 to 1 at points (N, 3)."""
    cell = np.floor(points)
    inside, corner = points - cell, cell.astype(np.int64)
    fade = inside**3 * (inside * (6 * inside - 15) + 10)
    total = np.zeros(len(points))
    for each in np.ndindex(2, 2, 2):
        weight = np.where(np.array(each) == 1, fade, 1 - fade).prod(axis=1)
        total += weight * _slope(_jenkins(corner + each), inside - each)
    return _SCALE * total[:, None]


def _slope(number: Any, offset: Any) -> Any:
    """Return the product of an offset (N, 3) and one of Perlin's gradients, which a number chooses."""
    low = number & 15
    x, y, z = offset.T
    u = np.where(low < 8, x, y)
    v = np.where(low < 4, y, np.where((low == 12) | (low == 14), x, z))
    return np.where(low & 1, -u, u) + np.where(low & 2, -v, v)


def _hashed(cells: Any, channels: int) -> Any:
    """Return numbers (N, channels) from 0 to 1 for each cell (N, 3) of integers."""
    return np.stack([_jenkins(cells + _STREAM * k) for k in range(channels)], axis=1) / 2.0**32


def _jenkins(cells: Any) -> Any:
    """Return a number of 32 bits (N,) for each cell (N, 3) of integers."""
    parts = np.uint32((0xDEADBEEF + (3 << 2) + 13) & 0xFFFFFFFF) + cells.astype(np.uint32).T
    for changed, other, turn in _STEPS:
        turned = (parts[other] << np.uint32(turn)) | (parts[other] >> np.uint32(32 - turn))
        parts[changed] = (parts[changed] ^ parts[other]) - turned
    return parts[2]


PATTERNS: Functions = {
    "TEX_NOISE": _noise, "TEX_VORONOI": _voronoi, "TEX_CHECKER": _checker, "TEX_BRICK": _brick,
    "TEX_GRADIENT": _gradient, "TEX_WAVE": _wave, "TEX_WHITE_NOISE": _white_noise, "TEX_IMAGE": _image,
    "TEX_ENVIRONMENT": _environment,
}  # fmt: skip
