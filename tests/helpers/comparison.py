"""The comparison scene: a small light behind a hole in a foggy box, and its single scattering by numerical integration.

Other renderers were measured on the same scene (see benchmarks/). The integral here is deterministic, in float64: the
midpoint rule over the camera ray and over the light, with exact, sharp visibility through the hole.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from photonbeams import scene

RADIANCE = 1000 / (np.pi * 0.01)
SCATTERING, ABSORPTION = 0.1, 0.01
LIGHT_X, HOLE_X = -1.9, -1.3
HOLE_Y, HOLE_Z = (1.35, 1.65), (-0.1, 0.1)
BOX = np.array([[-2.0, 0.0, -2.0], [2.0, 3.0, 2.0]])
EYE = (0.0, 1.5, 1.95)
BLACK = scene.Material(diffuse=scene.BLACK, roughness=1.0, ior=1.001)


def quad(name: str, corners: object, material: scene.Material = BLACK) -> scene.Mesh:
    """Return a quadrilateral as two triangles."""
    return scene.Mesh(name, np.asarray(corners, dtype=np.float64), np.array([[0, 1, 2], [0, 2, 3]]), material=material)


def box(name: str, low: object, high: object, material: scene.Material = BLACK) -> scene.Mesh:
    """Return an axis-aligned box, wound outward."""
    bits = np.array([[(corner >> axis) & 1 for axis in range(3)] for corner in range(8)])
    points = np.where(bits, high, low).astype(np.float64)
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [[side[0], side[i], side[i + 1]] for side in sides for i in (1, 2)]
    return scene.Mesh(name, points, np.array(faces), material=material)


def across_x(name: str, x: float, y: tuple[float, float], z: tuple[float, float]) -> scene.Mesh:
    """Return a rectangle in a plane of constant x."""
    return quad(name, [[x, y[0], z[0]], [x, y[1], z[0]], [x, y[1], z[1]], [x, y[0], z[1]]])


def comparison_scene(portal: bool = True, beam_count: int | None = None) -> scene.Scene:
    """Return the box, the occluder with its hole, the light, the fog, and the hole as the light's portal."""
    low, high = BOX
    occluder = (
        across_x("/occluder/below", HOLE_X, (low[1], HOLE_Y[0]), (low[2], high[2])),
        across_x("/occluder/above", HOLE_X, (HOLE_Y[1], high[1]), (low[2], high[2])),
        across_x("/occluder/left", HOLE_X, HOLE_Y, (low[2], HOLE_Z[0])),
        across_x("/occluder/right", HOLE_X, HOLE_Y, (HOLE_Z[1], high[2])),
    )
    light = scene.FlatLight(
        "/light",
        radiance=(RADIANCE,) * 3,
        beam_count=beam_count,
        portal=across_x("/hole", HOLE_X, HOLE_Y, HOLE_Z) if portal else None,
        center=np.array([LIGHT_X, 1.5, 0.0]),
        half_x=np.array([0.0, 0.0, -0.05]),
        half_y=np.array([0.0, 0.05, 0.0]),
        axis=np.array([1.0, 0.0, 0.0]),
    )
    fog = scene.Medium((SCATTERING,) * 3, (ABSORPTION,) * 3)
    return scene.Scene(meshes=(box("/box", low, high), *occluder), lights=(light,), media=(fog,))


def camera(position: object = EYE) -> scene.Camera:
    """Return the scene's camera: 90 degrees wide, 16:9, looking along −z."""
    to_world = np.eye(4)
    to_world[:3, 3] = position
    return scene.Camera("/camera", to_world, focal_length=1.0, horizontal_aperture=2.0, vertical_aperture=2.0 * 9 / 16)


def camera_rays(
    width: int, height: int, position: object = EYE, turn: float = 0.0, places: object = (0.5, 0.5)
) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions (height · width, 3) through the pixels, top row first.

    `turn` is the angle in degrees by which the camera turns to its left from −z. `places` are the positions in the
    pixels through which the rays pass, (2,) or (height, width, 2).
    """
    across, down = np.moveaxis(np.broadcast_to(np.asarray(places, dtype=np.float64), (height, width, 2)), -1, 0)
    x = (np.arange(width) + across) / width * 2 - 1
    y = (1 - (np.arange(height)[:, None] + down) / height * 2) * height / width
    grid = np.stack([x, y, np.full((height, width), -1.0)], axis=-1).reshape(-1, 3)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    grid = grid @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    return np.broadcast_to(np.asarray(position, dtype=np.float64), grid.shape), grid / np.linalg.norm(
        grid, axis=1, keepdims=True
    )


def wall_distance(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the distance at which rays from inside the box, beyond the occluder, first meet a wall or the occluder."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(direction > 0, (BOX[1] - origin) / direction, (BOX[0] - origin) / direction).min(axis=1)
        plane = (HOLE_X - origin[:, 0]) / direction[:, 0]
    at = origin + plane[:, None] * direction
    through = (np.abs(at[:, 1] - 1.5) < 0.15) & (np.abs(at[:, 2]) < 0.1)
    return np.where((plane > 0) & (plane < t) & ~through, plane, t)


def fluence(points: np.ndarray, light_points: int = 24) -> np.ndarray:
    """Return the fluence that arrives unscattered at points: ∫ L cos θ V exp(−σt d) / d² dA, by the midpoint rule."""
    offsets = (np.arange(light_points) + 0.5) / light_points * 0.1 - 0.05
    total = np.zeros(len(points))
    for y in 1.5 + offsets:
        for z in offsets:
            x = points[:, 0] - LIGHT_X
            squared = x**2 + (points[:, 1] - y) ** 2 + (points[:, 2] - z) ** 2
            distance = np.sqrt(squared)
            part = (HOLE_X - LIGHT_X) / np.maximum(x, 1e-12)  # fraction of the way at which the occluder stands
            hole_y, hole_z = y + part * (points[:, 1] - y), z + part * (points[:, 2] - z)
            open_ = (part >= 1) | ((np.abs(hole_y - 1.5) < 0.15) & (np.abs(hole_z) < 0.1))
            value = RADIANCE * x / distance**3 * np.exp(-(SCATTERING + ABSORPTION) * distance)
            total += np.where(open_ & (x > 0), value, 0)
    return total * (0.1 / light_points) ** 2


@cache
def single_scattering(
    width: int,
    height: int,
    position: tuple[float, float, float] = EYE,
    steps: int = 192,
    light_points: int = 24,
    turn: float = 0.0,
) -> np.ndarray:
    """Return the single scattering of the fog at the pixels' centres (height, width)."""
    return scattered_along(*camera_rays(width, height, position, turn), steps, light_points).reshape(height, width)


def scattered_along(origin: np.ndarray, direction: np.ndarray, steps: int = 192, light_points: int = 24) -> np.ndarray:
    """Return the single scattering of the fog along rays: ∫ σs / 4π · fluence · exp(−σt t) dt, by the midpoint rule."""
    far = wall_distance(origin, direction)
    total = np.zeros(len(origin))
    for step in range(steps):
        t = (step + 0.5) / steps * far
        light = fluence(origin + t[:, None] * direction, light_points)
        total += light * np.exp(-(SCATTERING + ABSORPTION) * t) * far / steps
    result: np.ndarray = total * SCATTERING / (4 * np.pi)
    return result


def lit(reference: np.ndarray) -> np.ndarray:
    """Return the mask of the pixels that are compared."""
    return (reference > 0.02) & (reference < 3)
