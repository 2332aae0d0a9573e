"""The equipment on the concert's stage: truss, moving heads, drums, loudspeakers, a microphone, a curtain."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from staging import Shape, block, grid_faces, merge, moved, tube, turned

SEGMENT = 2.0  # metres of truss
LENS = 0.22  # from a moving head's pivot to its lens


def truss() -> Shape:
    """Return a segment of box truss along X, from 0 on: four chords and the lacing between them."""
    half, bays = 0.15, 4
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    parts = [tube([(0, y, z), (SEGMENT, y, z)], 0.024, 8) for y, z in corners]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        for k in range(bays):
            low, high = (a, b) if k % 2 else (b, a)
            x = SEGMENT / bays * np.array([k, k + 1])
            parts.append(tube([(x[0], *low), (x[1], *high)], 0.012, 5))
    return merge(parts)


def drum(radius: float, depth: float, steps: int = 28) -> Shape:
    """Return a closed cylinder about Y that stands on y = 0, its rims bevelled."""
    bevel = min(0.02, depth / 4)
    profile = [
        (0.0, 0.0), (radius - bevel, 0.0), (radius, bevel),
        (radius, depth - bevel), (radius - bevel, depth), (0.0, depth),
    ]  # fmt: skip
    angles = np.arange(steps) * (2 * np.pi / steps)
    points = np.concatenate([np.column_stack([r * np.cos(angles), 0 * angles + y, -r * np.sin(angles)])
                             for r, y in profile])  # fmt: skip
    return points, grid_faces(len(profile), steps, around=True)


def base() -> Shape:
    """Return the foot of a moving head that stands on y = 0, below its pivot."""
    return block((-0.18, 0.0, -0.16), (0.18, 0.12, 0.16))


PIVOT = 0.38  # height of a moving head's pivot over its foot


def yoke() -> Shape:
    """Return the fork that pans about Y; its pivot is the origin."""
    arms = [block((x - 0.03, -0.23, -0.06), (x + 0.03, 0.06, 0.06)) for x in (-0.19, 0.19)]
    return merge([*arms, block((-0.22, -0.26, -0.07), (0.22, -0.21, 0.07))])


def head() -> Shape:
    """Return the head that tilts about X and shines along −Z."""
    can = [(0.0, 0.2), (0.10, 0.2), (0.145, 0.12), (0.13, 0.0), (0.12, -0.12), (0.135, -0.2), (0.125, -0.215),
           (0.0, -0.19)]  # fmt: skip
    angles = np.arange(20) * (2 * np.pi / 20)
    points = np.concatenate([np.column_stack([r * np.cos(angles), r * np.sin(angles), 0 * angles + z]) for r, z in can])
    return points, [face[::-1] for face in grid_faces(len(can), 20, around=True)]


def drums() -> dict[str, Shape]:
    """Return a drum kit on a riser: its shells, and its metal parts."""
    lying = turned(0, 90)
    shells = [
        moved(drum(0.29, 0.42), lying, (0.0, 0.30, 0.1)),
        moved(drum(0.16, 0.2), turned(0, 22), (-0.19, 0.66, -0.02)),
        moved(drum(0.17, 0.22), turned(0, 22), (0.2, 0.66, -0.02)),
        moved(drum(0.21, 0.38), np.eye(3), (0.62, 0.18, -0.25)),
        moved(drum(0.18, 0.14), turned(0, 5), (-0.55, 0.5, -0.3)),
    ]
    metal = []
    cymbals = ((-0.75, 1.15, -0.05, 0.24, 14), (0.72, 1.22, -0.1, 0.26, 16), (-0.95, 0.85, -0.35, 0.18, 2))
    for x, y, z, radius, lean in cymbals:
        metal.append(moved(drum(radius, 0.012), turned(0, lean), (x, y, z)))
        metal.append(tube([(x, 0.02, z), (x, y + 0.05, z)], 0.011, 6))
        for turn in (30, 150, 270):
            foot = turned(1, turn) @ [0.3, 0.0, 0.0]
            metal.append(tube([(x, 0.28, z), (x + foot[0], 0.01, z + foot[2])], 0.009, 5))
    for x in (0.48, 0.76):
        metal.append(tube([(x, 0.0, -0.25), (x, 0.5, -0.25)], 0.009, 5))
    return {"Shells": merge(shells), "Metal": merge(metal)}


def microphone() -> Shape:
    """Return a microphone on its stand."""
    stand = [drum(0.15, 0.025), tube([(0, 0.02, 0), (0, 1.42, 0)], [0.013, 0.010], 8)]
    boom = tube([(0, 1.40, 0), (0.0, 1.52, 0.10)], 0.009, 6)
    body = tube([(0, 1.50, 0.08), (0, 1.555, 0.16)], [0.014, 0.02], 10)
    grille = [(0, 1.555, 0.16), (0, 1.565, 0.175), (0, 1.585, 0.205), (0, 1.605, 0.23)]
    ball = tube(grille, [0.02, 0.031, 0.031, 0.012], 12)
    return merge([*stand, boom, body, ball])


def loudspeakers() -> Shape:
    """Return two wedges before the singer and a stack on each side."""
    wedge = block((-0.3, 0.0, -0.25), (0.3, 0.3, 0.2))
    wedge[0][(wedge[0][:, 1] > 0) & (wedge[0][:, 2] < 0), 2] = 0.0  # its front leans back
    parts = [moved(wedge, turned(1, turn), (x, 0, 1.5)) for x, turn in ((-1.5, 18), (1.5, -18))]
    for side in (-1, 1):
        for k in range(3):
            parts.append(moved(block((-0.5, 0.78 * k, -0.4), (0.5, 0.78 * k + 0.76, 0.4)), turned(1, -8 * side),
                               (6.6 * side, 0.0, -0.6)))  # fmt: skip
    return merge(parts)


def curtain(width: float, height: float, random: np.random.Generator) -> Shape:
    """Return a pleated curtain in the plane z = 0."""
    x = np.linspace(-width / 2, width / 2, 300)
    y = np.linspace(0, height, 4)[:, None]
    wave = np.cumsum(random.uniform(0.6, 1.4, 300)) * (2 * np.pi / 9)
    z = 0.12 * np.sin(wave) + 0.03 * np.sin(0.37 * wave + y)
    points = np.stack([x + 0 * y, y + 0 * x, z], axis=-1)
    return points.reshape(-1, 3), grid_faces(4, 300)
