"""Equirectangular and fisheye cameras: what places on their film see.

Places are (x, y), right and up from the middle of the film, in focal lengths; camera space is x right, y up, z forward.
An equirectangular camera has a longitude x and a latitude y in radians. A fisheye sees at the distance r from the
middle what is at the angle theta from its axis: r = theta (equidistant), 2 sin(theta / 2) (equisolid),
2 tan(theta / 2) (stereographic), or sin(theta) (orthographic).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import drjit as dr
import numpy as np

from ...runtime.device import Array3f, Bool, Float
from ...scene import Array, Camera
from ...scene.cameras import EQUIRECTANGULAR, FISHEYES

# Columns are right, up and back in camera space: ahead, to the right, back, to the left, up and down.
_CUBE = [
    np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]], float)
    for sine, cosine in ((0, 1), (-1, 0), (0, -1), (1, 0))
] + [np.array([[1, 0, 0], [0, 0, sine], [0, -sine, 0]], float) for sine in (-1, 1)]
#: How much wider faces are that are to overlap: what is known of a place on one is then known on its neighbour, too.
OVERLAP = 1.4

# From the middle of a face to its corners, in radians.
_CORNER = np.arccos(1 / np.sqrt(3))


def toward(projection: str, x: Float, y: Float) -> Array3f:
    """Return the directions, of any length, in which a camera looks."""
    if projection == EQUIRECTANGULAR:
        (sine, cosine), (up, level) = dr.sincos(x), dr.sincos(y)
        return Array3f(sine * level, up, cosine * level)
    square, side = x * x + y * y, Float(1)
    match projection:
        case "fisheyeEquidistant":
            angle = dr.sqrt(square)
            sine, cosine = dr.sincos(angle)
            side = dr.select(angle > 0, sine / angle, 1)
        case "fisheyeEquisolid":
            cosine = 1 - square / 2
            side = dr.safe_sqrt((1 + cosine) / 2)
        case "fisheyeStereographic":
            cosine = 1 - square / 4
        case "fisheyeOrthographic":
            cosine = dr.safe_sqrt(1 - square)
        case _:  # perspective
            return Array3f(x, y, 1)
    return Array3f(side * x, side * y, cosine)


def seen(camera: Camera, x: Float, y: Float) -> Bool:
    """Return at which places a panoramic camera sees anything: within the circle, or once all around."""
    if camera.projection in FISHEYES:
        return x * x + y * y <= dr.opaque(Float, camera.rim**2)
    return (dr.abs(x) <= dr.opaque(Float, np.pi)) & (dr.abs(y) <= dr.opaque(Float, np.pi / 2))


def on_film(projection: str, direction: Array) -> Array:
    """Return the places, (N, 2), at which a panoramic camera sees directions, (N, 3), in camera space."""
    x, y, z = direction.T
    across = np.hypot(x, y)
    if projection == EQUIRECTANGULAR:
        return np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], axis=1)
    radius = np.vectorize(FISHEYES[projection], otypes=[float])(np.arctan2(across, z))
    result: Array = direction[:, :2] * (radius / np.where(across > 0, across, 1))[:, None]
    return result


def faces(camera: Camera, wider: float = 1.0) -> Iterator[Camera]:
    """Yield perspective cameras that together show what a panoramic one may see: a cube's faces, `wider` by that."""
    half = np.pi if camera.projection == EQUIRECTANGULAR else np.radians(camera.angle) / 2
    for turned in _CUBE:
        if np.arccos(turned[2, 2]) < half + _CORNER:
            to_world = np.array(camera.to_world, dtype=np.float64)
            to_world[:3, :3] = to_world[:3, :3] @ turned
            yield replace(
                camera, to_world=to_world, focal_length=1.0,
                horizontal_aperture=2.0 * wider, vertical_aperture=2.0 * wider,
                horizontal_offset=0.0, vertical_offset=0.0, projection="perspective",
            )  # fmt: skip
