"""Write `forest.usda`: morning sun through leaves into a misty wood.

Run it with the project's Python from anywhere; it writes the stage and the gobo `leaves.png` beside itself:

    .venv/bin/python examples/forest/model.py

The stage is committed, so run it only to change the geometry. Sun, mist, look and camera can be changed in the stage's
text just as easily.

The wood: metres, Y up. The camera stands near the origin and looks along −Z; the sun is ahead on the left.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from leaves import leaves
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from staging import (
    Array,
    Shape,
    aimed,
    author,
    camera,
    define,
    grid_faces,
    material,
    merge,
    mesh,
    moved,
    new_stage,
    render_settings,
    save,
    tube,
    turned,
    write_image,
)

HERE = Path(__file__).resolve().parent
FRAMES = (1, 72)
SUN = np.array([-0.46, 0.74, -0.80])  # toward the sun
MIDDLE, EDGE = np.array([0.0, -20.0]), 27.0  # of the wood, a disc; beams fill the sphere around everything in it
#: The trunks that shape the picture: place (x, z), thickness, kind. Others are scattered behind them.
TRUNKS = [
    (-2.6, -4.6, 1.15, 0), (3.6, -6.4, 1.1, 1), (-1.75, -11.5, 0.95, 2), (1.5, -13.8, 0.8, 0), (6.6, -11.0, 1.1, 2),
    (-6.8, -9.6, 1.15, 1), (-4.4, -16.5, 0.9, 0), (4.6, -18.5, 0.9, 1), (-0.2, -21.0, 0.75, 2), (9.6, -16.0, 1.0, 0),
    (-10.4, -14.6, 1.0, 2), (-8.2, -20.5, 0.9, 0), (2.3, -25.5, 0.8, 1),
]  # fmt: skip


def height(x: Array, z: Array) -> Array:
    """Return the ground's height: a hollow that the camera looks along, with mounds on both sides."""
    mounds = 0.22 * np.sin(0.45 * x + 1.0) * np.cos(0.33 * z + 0.4) + 0.10 * np.sin(1.3 * x - 0.7 * z)
    banks = 0.02 * np.minimum(np.abs(x - 0.4), 12.0) ** 1.6
    rise = 0.0011 * np.maximum(-z - 6, 0) ** 2
    return np.asarray(mounds + banks + rise - 0.25)


def ground(random: np.random.Generator) -> Shape:
    """Return the ground within the wood's edge, finer in front."""
    z = 7.0 - 56.0 * np.linspace(0, 1, 84) ** 1.5
    x = np.sinh(np.linspace(-2.0, 2.0, 72)) / np.sinh(2.0) * EDGE
    zz, xx = np.meshgrid(z, x, indexing="ij")
    rough = 0.05 * random.normal(size=zz.shape) * np.exp(zz / 25)
    points = np.stack([xx, height(xx, zz) + rough, zz], axis=-1).reshape(-1, 3)
    inside = np.linalg.norm(points[:, [0, 2]] - MIDDLE, axis=1) < EDGE
    faces = [face[::-1] for face in grid_faces(len(z), len(x)) if inside[face].all()]
    used, indices = np.unique(np.concatenate(faces), return_inverse=True)
    return points[used], indices.reshape(-1, 4).tolist()


def trunk(random: np.random.Generator) -> Shape:
    """Return a trunk of half a metre and stubs of branches: fluted, not quite straight, on spreading roots."""
    rings, sides = 34, 22
    h = np.linspace(0, 1, rings)[:, None] ** 1.5
    y = -0.5 + 17.5 * h
    angle = np.arange(sides) * (2 * np.pi / sides)
    roots = random.integers(4, 7)
    lobes = 0.5 + 0.5 * np.cos(roots * angle + random.uniform(0, 6))
    radius = 0.25 * (1 - 0.55 * h)
    radius = radius + (0.10 + 0.20 * lobes**2) * np.exp(-np.maximum(y + 0.1, 0) / 0.42)
    flutes = sum(
        random.uniform(0.02, 0.05) * np.cos(k * angle + random.uniform(0, 6) + random.uniform(-0.2, 0.2) * y)
        for k in (2, 3, 5, 7)
    )
    radius = radius * (1 + flutes + 0.025 * random.normal(size=(rings, sides)))
    bend_x, bend_z = (
        random.uniform(0.1, 0.3) * np.sin(y / random.uniform(3.5, 6) + random.uniform(0, 6)) for _ in range(2)
    )
    points = np.stack([bend_x + radius * np.cos(angle), y + 0 * angle, bend_z - radius * np.sin(angle)], axis=-1)
    parts = [(points.reshape(-1, 3), grid_faces(rings, sides, around=True))]
    for _ in range(9):
        low, turn = random.uniform(2.2, 14), random.uniform(0, 2 * np.pi)
        length = random.uniform(0.5, 2.4)
        out = np.linspace(0, 1, 5)
        droop = random.uniform(-0.5, 0.35)
        where = float(np.interp(low, y[:, 0], np.arange(rings)))
        start = [float(np.interp(where, np.arange(rings), each[:, 0])) for each in (bend_x, bend_z)]
        path = np.column_stack(
            [
                start[0] + length * out * np.cos(turn),
                low + length * (0.25 * out + droop * out**2) + 0.06 * random.normal(size=5) * out,
                start[1] + length * out * np.sin(turn),
            ]
        )
        parts.append(tube(path, 0.015 + random.uniform(0.03, 0.05) * (1 - out), 5))
    return merge(parts)


def fern(random: np.random.Generator) -> Shape:
    """Return a fern: fronds that arch outward, each a row of leaflets that shrink toward its tip."""
    leaflets = []
    for k in range(9):
        turn = turned(1, 40 * k + random.uniform(-14, 14))
        length, rise = random.uniform(0.55, 0.85), random.uniform(0.9, 1.35)
        for t in np.linspace(0.12, 1.0, 13):
            middle = np.array([length * t, rise * length * (0.85 * t - 0.62 * t**2), 0.0])
            wide = 0.20 * length * np.sin(np.pi * min(1.0, 0.25 + 0.78 * t)) + 0.012
            for side in (-1, 1):
                leaflet = np.array(
                    [
                        [0.0, 0.0, 0.0],
                        [0.055 * length, 0.012, side * 0.5 * wide],
                        [0.09 * length, -0.25 * wide, side * wide],
                        [0.01 * length, 0.0, side * 0.5 * wide],
                    ]
                )
                leaflets.append(moved((middle + leaflet, [[0, 1, 2, 3]]), turn))
    return merge(leaflets)


def bough(random: np.random.Generator) -> Shape:
    """Return a bough with leaves that hangs into the picture from above."""
    s = np.linspace(0, 1, 9)[:, None]
    spine = s * [1.9, -0.25, 0.1] + s**2 * [0.1, -0.55, 0.2]
    parts = [tube(spine, 0.022 - 0.017 * s[:, 0], 5)]
    for _ in range(240):
        t = random.uniform(0.08, 1.0)
        at = np.array([np.interp(t, s[:, 0], spine[:, i]) for i in range(3)])
        at = at + random.normal(size=3) * [0.08, 0.09, 0.16] * (0.4 + t)
        angles = random.uniform([0, -70, -40], [360, 10, 40])
        turn = turned(1, angles[0]) @ turned(2, angles[1]) @ turned(0, angles[2])
        long = random.uniform(0.05, 0.09)
        half = [[0, 0, 0], [0.25, 0.02, 0.24], [0.6, 0.0, 0.24], [1, -0.08, 0]]
        leaf = np.array([*half, [0.6, 0.0, -0.24], [0.25, 0.02, -0.24]]) * long
        parts.append(moved((leaf, [[0, 1, 2, 3, 4, 5]]), turn, at))
    return merge(parts)


def scatter(stage: Usd.Stage, path: str, kinds: list[Shape], look: object, places: Array, smooth: bool = False) -> None:
    """Define an instancer of several kinds at places: x, y, z, degrees about Y, scale (up and aside), kind."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    names = []
    for index, shape in enumerate(kinds):
        names.append(f"{path}/Kind{index}")
        mesh(stage, names[-1], shape, look, smooth)  # type: ignore[arg-type]
    instancer.CreatePrototypesRel().SetTargets(names)
    instancer.CreateProtoIndicesAttr([int(kind) for kind in places[:, 6]])
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(np.round(places[:, :3], 3).astype(np.float32)))
    half = np.radians(places[:, 3]) / 2
    instancer.CreateOrientationsAttr([Gf.Quath(float(np.cos(a)), 0.0, float(np.sin(a)), 0.0) for a in half])
    scales = np.round(places[:, [5, 4, 5]], 3).astype(np.float32)
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(scales))


def standing(x: float, z: float, random: np.random.Generator, up: float, aside: float, kind: int) -> list[float]:
    """Return a place on the ground, with a random turn."""
    return [x, float(height(np.array(x), np.array(z))), z, random.uniform(0, 360), up, aside, kind]


def wood(stage: Usd.Stage, random: np.random.Generator) -> None:
    """Define ground, trunks, ferns and the bough."""
    bark = material(stage, "Bark", (0.085, 0.065, 0.05), 0.9)
    soil = material(stage, "Soil", (0.10, 0.085, 0.045), 0.95)
    green = material(stage, "Fern", (0.10, 0.17, 0.035), 0.6)
    leaf = material(stage, "Leaf", (0.06, 0.10, 0.02), 0.6)
    mesh(stage, "/World/Ground", ground(random), soil, smooth=True)
    places = [standing(x, z, random, 1.0, thick, kind) for x, z, thick, kind in TRUNKS]
    taken = [(x, z) for x, z, _, _ in TRUNKS]
    while len(places) < 85:
        z = -14 - 32 * random.random()
        x = random.uniform(-1, 1) * min(4 - 0.75 * z, 0.96 * np.sqrt(EDGE**2 - (z - MIDDLE[1]) ** 2))
        near = min((x - a) ** 2 + (z - b) ** 2 for a, b in taken)
        if near > 3.2 and not (abs(x - 0.5) < 1.6 and z > -30):
            up, aside = random.uniform(0.9, 1.2), random.uniform(0.5, 1.0)
            places.append(standing(x, z, random, up, aside, random.integers(3)))
            taken.append((x, z))
    scatter(stage, "/World/Trunks", [trunk(random) for _ in range(3)], bark, np.array(places), smooth=True)
    ferns = []
    while len(ferns) < 150:
        z = -2.6 - 20 * random.random() ** 1.5
        x = random.uniform(-1, 1) * (1.5 - 0.62 * z)
        if abs(x - 0.25 - 0.05 * z) > 0.7 + 0.25 * random.random():  # keep a path free
            size = random.uniform(0.55, 1.05)
            ferns.append(standing(x, z, random, size, size, random.integers(2)))
    scatter(stage, "/World/Ferns", [fern(random) for _ in range(2)], green, np.array(ferns))
    boughs = [
        (-2.75, 3.35, -3.6, -12, 1, 1, 0),
        (-2.2, 3.75, -4.8, 8, 1.2, 1.2, 0),
        (3.5, 3.95, -5.2, 170, 1.1, 1.1, 0),
    ]
    scatter(stage, "/World/Boughs", [bough(random)], leaf, np.array(boughs, dtype=float))


def lights(stage: Usd.Stage) -> None:
    """Define the sun behind its leaves, and the sky, which fills the mist."""
    toward = SUN / np.linalg.norm(SUN)
    sun = define(
        stage, "/World/Light/Sun", "DistantLight", "The sun, ahead on the left, behind leaves.", "PhotonBeamsLightAPI"
    )
    place = np.array([0.0, 15.0, -20.0])  # of the leaves
    author(
        sun,
        {
            "inputs:angle": 0.53,
            "inputs:color": Gf.Vec3f(1.0, 0.76, 0.46),
            "inputs:intensity": 90000.0,
            "photonbeams:count": 8000,
            "photonbeams:intensity": 34.0,
            "photonbeams:gobo": Sdf.AssetPath("./leaves.png"),
            "photonbeams:gobo:width": 16.0,
            "photonbeams:gobo:wrap": "repeat",
            "photonbeams:lightGroup": "sun",
            "photonbeams:look": Sdf.Path("/World/Looks/Shafts"),
        },
    )
    UsdGeom.Xformable(sun).AddTransformOp().Set(aimed(place, place - toward))
    doc = "The sky above, soft: it fills the mist."
    sky = define(stage, "/World/Light/Sky", "DistantLight", doc, "PhotonBeamsLightAPI")
    author(
        sky,
        {
            "inputs:angle": 70.0,
            "inputs:color": Gf.Vec3f(0.55, 0.78, 0.8),
            "inputs:intensity": 1.2,
            "photonbeams:count": 300,
            "photonbeams:intensity": 1.8,
            "photonbeams:lightGroup": "sky",
            "photonbeams:look": Sdf.Path("/World/Looks/Haze"),
        },
    )
    UsdGeom.Xformable(sky).AddTransformOp().Set(aimed((0, 20, -20), (2, 0, -14)))
    doc = "The sky on leaves and ground, and between the last trunks."
    fill = define(stage, "/World/Light/Fill", "DomeLight", doc, "PhotonBeamsLightAPI")
    author(fill, {"inputs:color": Gf.Vec3f(0.62, 0.8, 0.78), "inputs:intensity": 0.05, "photonbeams:enabled": False})


def mist_and_looks(stage: Usd.Stage) -> None:
    """Define the mist and the look of the beams in it."""
    mist = define(stage, "/World/Mist", "Scope", "Mist that fills the wood; per metre.", "PhotonBeamsMediumAPI")
    author(
        mist,
        {
            "photonbeams:scattering": Gf.Vec3f(0.022, 0.022, 0.022),
            "photonbeams:absorption": Gf.Vec3f(0.002, 0.002, 0.003),
            "photonbeams:anisotropy": 0.55,
        },
    )
    shafts = define(
        stage, "/World/Looks/Shafts", "PhotonBeamsLook", "Gold above, cooler below, in mist that lies low and drifts."
    )
    author(
        shafts,
        {
            "photonbeams:along:ramp:knots": [0.0, 0.4, 0.7, 1.0],
            "photonbeams:along:ramp:colors": [
                Gf.Vec3f(1.0, 0.82, 0.5), Gf.Vec3f(1.0, 0.82, 0.52), Gf.Vec3f(0.7, 0.9, 0.72), Gf.Vec3f(0.3, 0.8, 0.9)
            ],
            "photonbeams:along:ramp:interpolation": "monotone",
            "photonbeams:along:space": "distance",
            "photonbeams:along:begin": 14.0,
            "photonbeams:along:end": 50.0,
            "photonbeams:along:expression": "0.3 + 0.7 * smoothstep(11, 1, P.y)",
            "photonbeams:across:profile": "biweight",
            "photonbeams:noise:amount": 0.8,
            "photonbeams:noise:scale": 3.0,
            "photonbeams:noise:octaves": 3,
            "photonbeams:noise:contrast": 2.0,
            "photonbeams:noise:drift": Gf.Vec3f(0.5, 0.06, 0.25),
        },
    )  # fmt: skip
    haze = define(stage, "/World/Looks/Haze", "PhotonBeamsLook", "The mist between the shafts.")
    author(haze, {"photonbeams:across:profile": "biweight", "photonbeams:angle:shading": "constant"})


def cameras(stage: Usd.Stage) -> None:
    """Define the camera, which walks a metre and a half into the wood."""
    walking = camera(stage, "/World/Camera", 28)
    path = UsdGeom.Xformable(walking).AddTransformOp()
    for frame in range(FRAMES[0], FRAMES[1] + 1):
        t = (frame - FRAMES[0]) / (FRAMES[1] - FRAMES[0])
        eased = t * t * (3 - 2 * t)
        eye = np.array([0.35 - 0.1 * eased, 1.45, 0.6 - 1.6 * eased])
        path.Set(aimed(eye, eye + np.array([-0.35, 0.45, -8.0])), frame)


def model(folder: Path) -> Path:
    """Write `leaves.png` and `forest.usda` into `folder`; the same version of this file writes the same stage."""
    random = np.random.default_rng(7)
    write_image(folder / "leaves.png", leaves(random))
    stage = new_stage("Sun through leaves. Geometry by model.py; see docs/examples.md.", FRAMES)
    cameras(stage)
    lights(stage)
    mist_and_looks(stage)
    wood(stage, random)
    render_settings(stage, "/World/Camera")
    return save(stage, folder / "forest.usda")


if __name__ == "__main__":
    print(model(HERE))
