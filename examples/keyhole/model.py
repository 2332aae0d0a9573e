"""Write `keyhole.usda`, the shot of the Talk: warm light through the keyhole of an old door into a dusty dark room.

Run it with the project's Python from anywhere; it writes the stage and the texture `wood.png` beside itself:

    .venv/bin/python examples/keyhole/model.py

The stage is committed, so run it only to change the geometry. Lights, dust, look and cameras can be changed in the
stage's text just as easily.

Room: metres, Y up. The door's front is the plane z = 0, the lit chamber lies at z < 0, the shot's room at z > 0.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from shapes import (
    Shape,
    box,
    keyhole_outline,
    lathe,
    merge,
    pierced,
    placed,
    square_outline,
    torus,
)
from surfaces import material, mesh, write_wood

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from staging import aimed, new_stage, save, turned  # noqa: E402

NECK = np.array([-0.20, 1.02])  # the keyhole's neck on the door
HEIGHT = 0.17  # of the keyhole: larger than life, so that its shape reads in a wide shot
THICKNESS = 0.045  # of the door
LOCK = np.array([0.14, 0.21])  # half width and height of the block that the keyhole is cut into
SHAFT = np.array([0.20, -0.55, 0.82])  # direction of the light
LIGHT_DISTANCE, LIGHT_SIZE = 1.25, 0.16
FRAMES = (1, 101)
JUG = """
0.000 0.000  0.055 0.000  0.070 0.008  0.105 0.060  0.118 0.110  0.108 0.160  0.075 0.200
0.050 0.225  0.046 0.250  0.060 0.285  0.066 0.295  0.061 0.295  0.044 0.250  0.000 0.220
"""  # radius and height, from the foot up outside and down inside


# -- the room ------------------------------------------------------------------------------------------------------


def door(random: np.random.Generator) -> dict[str, Shape]:
    """Return the door's leaf, its iron and its frame; only the keyhole lets light through."""
    lock_low, lock_high = NECK - LOCK, NECK + LOCK
    edges = np.array([-0.47, lock_low[0], lock_high[0], 0.12, 0.30, 0.47])
    planks = []
    for left, right in pairwise(edges):
        # Neighbours overlap by a millimetre, so that no ray slips through the joint between two planks, and by twelve
        # at the end of a plank, so that none slips through at its bevelled corners.
        spans = [(0.02, 1.98)]
        if left == lock_low[0]:
            spans = [(0.02, lock_low[1] + 0.012), (lock_high[1] - 0.012, 1.98)]
        shift, front = random.random(2), random.uniform(-0.004, 0.0)
        for low, high in spans:
            planks.append(box((left, low, -THICKNESS), (right + 0.001, high, front), 0.006, 1, shift))
    hole = keyhole_outline(NECK, HEIGHT)
    around = square_outline(lock_low, lock_high + np.array([0.001, 0.0]), NECK, hole)
    planks.append(pierced(around, hole, -THICKNESS, 0.0, 0.003, random.random(2)))
    angles = np.arctan2(*(hole - NECK).T[::-1])
    shield = NECK + np.column_stack([0.12 * np.cos(angles), 0.01 + 0.19 * np.sin(angles)])
    shield[:, 1] += 0.018 * np.cos(4 * angles)  # an old smith's idea of an ornament
    iron = [pierced(shield, hole, -0.001, 0.007, 0.003, (0, 0))]
    for height in (0.32, 1.66):  # two hinge straps
        iron.append(box((-0.36, height - 0.03, -0.005), (0.47, height + 0.03, 0.008), 0.003, 0))
    studs = [NECK + offset for offset in ((-0.082, 0.095), (0.082, 0.095), (-0.082, -0.085), (0.082, -0.085))]
    studs += [np.array([x, y]) for y in (0.32, 1.66) for x in (-0.31, -0.14, 0.03, 0.20, 0.38)]
    cap = lathe([(0.013, 0.0), (0.012, 0.004), (0.009, 0.008), (0.005, 0.0105), (0.0, 0.0115)], 12)
    turn = turned(0, 90)
    rivets = [placed(cap, turn, (x, y, 0.006)) for x, y in studs]
    ring = placed(torus(0.055, 0.008), turn, (NECK[0], NECK[1] - 0.275, 0.03))
    boss = placed(torus(0.016, 0.009, 20, 8), turned(1, 0), (NECK[0], NECK[1] - 0.22, 0.02))
    frame = [
        box((-0.60, 0.0, -0.06), (-0.468, 2.10, 0.05), 0.012, 1, random.random(2)),
        box((0.468, 0.0, -0.06), (0.60, 2.10, 0.05), 0.012, 1, random.random(2)),
        box((-0.66, 1.96, -0.06), (0.66, 2.13, 0.06), 0.012, 0, random.random(2)),
        box((-0.47, -0.02, -0.20), (0.47, 0.03, 0.03), 0.008, 0, random.random(2)),
    ]
    return {
        "Leaf": merge(planks),
        "Iron": merge(iron),
        "Rivets": merge(rivets),
        "Ring": merge([ring, boss]),
        "Frame": merge(frame),
    }


def stones(random: np.random.Generator, width: tuple[float, float], height: float, gap: tuple[float, ...]) -> Shape:
    """Return a wall of rough blocks in the plane z = 0, with the opening `gap` (left, right, top)."""
    blocks, low, row = [], 0.0, 0
    while low < height:
        high = low + random.uniform(0.19, 0.27)
        left = width[0] - random.uniform(0.0, 0.3)
        while left < width[1]:
            right = left + random.uniform(0.28, 0.55)
            pieces = [(left, right)]
            if low < gap[2]:
                pieces = [(left, min(right, gap[0])), (max(left, gap[1]), right)]
            depth = random.uniform(0.012, 0.04)
            for a, b in pieces:
                if b - a > 0.05:
                    stone = box((a + 0.006, low + 0.006, -0.06), (b - 0.006, high - 0.006, depth), 0.014)
                    tilt = turned(0, random.normal(0, 0.5)) @ turned(1, random.normal(0, 0.6))
                    middle = np.array([(a + b) / 2, (low + high) / 2, 0.0])
                    blocks.append(placed(placed(stone, np.eye(3), -middle), tilt, middle))
            left = right
        low, row = high, row + 1
    return merge(blocks)


def room(random: np.random.Generator) -> dict[str, Shape]:
    """Return walls and floor of the shot's room, which is open above."""
    boards = []
    left = -3.0
    while left < 2.2:
        right = left + random.uniform(0.15, 0.2)
        cut = random.uniform(0.8, 2.6)
        for low, high in ((-0.04, cut - 0.002), (cut + 0.002, 4.0)):
            top = random.uniform(-0.004, 0.0)
            boards.append(box((left + 0.002, -0.04, low), (right - 0.002, top, high), 0.004, 2, random.random(2)))
        left = right
    # Solid masonry behind the stones: it closes the mortar joints, and its opening is smaller than the door's leaf.
    core = [
        box((-3.2, -0.05, -0.25), (-0.43, 2.9, -THICKNESS + 0.001)),
        box((0.43, -0.05, -0.25), (2.35, 2.9, -THICKNESS + 0.001)),
        box((-0.44, 1.94, -0.25), (0.44, 2.9, -THICKNESS + 0.001)),
        box((2.25, -0.05, -0.1), (2.45, 2.9, 4.2)),
        box((-3.25, -0.05, -0.1), (-3.05, 2.9, 4.2)),
        box((-3.2, -0.05, 4.0), (2.4, 2.9, 4.2)),
        box((-3.2, -0.25, -0.1), (2.45, -0.03, 4.0)),
    ]
    left_side = placed(stones(random, (-4.0, 0.1), 2.85, (9.0, 9.0, 0.0)), turned(1, 90), (-3.02, 0.0, 0.0))
    right_side = placed(stones(random, (-0.1, 4.0), 2.85, (9.0, 9.0, 0.0)), turned(1, -90), (2.21, 0.0, 0.0))
    return {
        "Floor": merge(boards),
        "Masonry": merge(core),
        "DoorWall": stones(random, (-3.1, 2.25), 2.85, (-0.60, 0.60, 2.13)),
        "LeftWall": left_side,
        "RightWall": right_side,
    }


def chamber() -> Shape:
    """Return the closed box behind the door, five overlapping slabs against the masonry."""
    x, y, z = (-1.3, 1.3), (-0.05, 2.7), (-2.0, -0.249)
    t = 0.1
    return merge(
        [
            box((x[0] - t, y[0] - t, z[0] - t), (x[0], y[1] + t, z[1])),
            box((x[1], y[0] - t, z[0] - t), (x[1] + t, y[1] + t, z[1])),
            box((x[0] - t, y[0] - t, z[0] - t), (x[1] + t, y[0], z[1])),
            box((x[0] - t, y[1], z[0] - t), (x[1] + t, y[1] + t, z[1])),
            box((x[0] - t, y[0] - t, z[0] - t), (x[1] + t, y[1] + t, z[0])),
        ]
    )


def props(random: np.random.Generator) -> dict[str, Shape]:
    """Return a chest, a jug and a stool for the light to fall on."""
    chest = [
        box((-0.45, 0.03, -0.26), (0.45, 0.36, 0.26), 0.012, 0, random.random(2)),
        *(
            box((-0.45, 0.36 + 0.085 * np.sin(a), -z), (0.45, 0.40 + 0.085 * np.sin(a), z), 0.01, 0, random.random(2))
            for a, z in ((0.0, 0.27), (0.5, 0.235), (1.0, 0.16), (1.45, 0.08))
        ),
    ]
    bands = []
    for x in (-0.36, 0.36):
        bands.append(box((x - 0.03, 0.02, -0.275), (x + 0.03, 0.375, 0.275), 0.004))
        bands.append(box((x - 0.03, 0.37, -0.28), (x + 0.03, 0.41, 0.28), 0.004))
    bands.append(box((-0.06, 0.27, 0.255), (0.06, 0.41, 0.285), 0.006))
    where = (turned(1, -62), (1.62, 0.0, 0.95))
    jug = lathe(np.array(JUG.split(), dtype=float).reshape(-1, 2), 40)
    handle = placed(torus(0.06, 0.009, 28, 8), turned(0, 90), (0.115, 0.2, 0.0))
    stool = [box((-0.19, 0.40, -0.15), (0.19, 0.44, 0.15), 0.012, 0, random.random(2))]
    for x, z in ((-0.13, -0.09), (0.13, -0.09), (-0.13, 0.09), (0.13, 0.09)):
        lean = turned(2, -40 * x) @ turned(0, 60 * z)
        leg = box((-0.02, -0.41, -0.02), (0.02, 0.0, 0.02), 0.006, 1, random.random(2))
        stool.append(placed(leg, lean, (x, 0.405, z)))
    return {
        "Chest": placed(merge(chest), *where),
        "ChestIron": placed(merge(bands), *where),
        "Jug": placed(merge([jug, handle]), turned(1, 35), (0.29, 0.0, 1.43)),
        "Stool": placed(merge(stool), turned(1, 24), (1.05, 0.0, 0.42)),
    }


# -- light, dust, cameras ------------------------------------------------------------------------------------------


def camera(stage: Usd.Stage, path: str, focal: float) -> UsdGeom.Camera:
    """Define a 36 mm wide 16:9 camera; apertures and focal length are tenths of a scene unit, so 0.36 is 36 mm."""
    result = UsdGeom.Camera.Define(stage, path)
    result.CreateHorizontalApertureAttr(0.36)
    result.CreateVerticalApertureAttr(0.2025)
    result.CreateFocalLengthAttr(focal / 100)
    result.CreateFocusDistanceAttr(2.5)
    result.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100))
    return result


def flight(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and target of the second camera at a time in [0, 1], on smooth curves through chosen places."""
    keyhole = np.array([*NECK, 0.0])
    eyes = [
        (-1.75, 1.00, 1.95),
        (-1.05, 0.90, 1.55),
        (-0.42, 0.62, 1.18),
        (-0.115, 0.50, 0.80),  # inside, near the axis
        (-0.14, 0.72, 0.50),  # up along the shaft, toward the light
        (0.08, 0.84, 0.50),
        (0.62, 0.95, 0.62),  # out on the other side
        (0.95, 0.98, 1.05),
    ]
    looks = [
        (0.1, 0.62, 0.75),
        (0.1, 0.62, 0.55),
        (0.1, 0.72, 0.20),
        keyhole + np.array([0.02, 0.02, 0.0]),
        keyhole + np.array([0.01, 0.0, 0.0]),
        (-0.24, 0.84, 0.02),
        (-0.34, 0.68, 0.42),
        (-0.3, 0.64, 0.55),
    ]
    where = time * (len(eyes) - 1)
    i = min(int(where), len(eyes) - 2)
    x = where - i

    def curve(points: Sequence[Sequence[float]]) -> np.ndarray:
        p = np.asarray([points[0], *points, points[-1]], dtype=float)[i : i + 4]
        return 0.5 * (
            2 * p[1]
            + x * (p[2] - p[0])
            + x**2 * (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3])
            + x**3 * (3 * (p[1] - p[2]) + p[3] - p[0])
        )

    return curve(eyes), curve(looks)


def lights(stage: Usd.Stage) -> None:
    """Define the warm key behind the door, the hole it shines through, and a cool fill that makes no beams."""
    toward = SHAFT / np.linalg.norm(SHAFT)
    middle = np.array([*NECK, -THICKNESS / 2])
    key = UsdLux.RectLight.Define(stage, "/World/Light/Key")
    prim = key.GetPrim()
    prim.SetDocumentation("The lamp in the closed chamber behind the door.")
    prim.AddAppliedSchema("PhotonBeamsLightAPI")
    key.CreateWidthAttr(LIGHT_SIZE)
    key.CreateHeightAttr(LIGHT_SIZE)
    key.CreateIntensityAttr(30000.0)
    key.CreateColorAttr(Gf.Vec3f(1.0, 0.72, 0.42))
    UsdGeom.Xformable(key).AddTransformOp().Set(aimed(middle - LIGHT_DISTANCE * toward, middle))
    for name, kind, value in (
        ("enabled", Sdf.ValueTypeNames.Bool, True),
        ("count", Sdf.ValueTypeNames.Int, 4096),
        ("intensity", Sdf.ValueTypeNames.Float, 4.0),
        ("lightGroup", Sdf.ValueTypeNames.Token, "key"),
    ):
        prim.CreateAttribute(f"photonbeams:{name}", kind, False).Set(value)
    prim.CreateRelationship("photonbeams:portal", False).AddTarget("/World/Portal")
    prim.CreateRelationship("photonbeams:look", False).AddTarget("/World/Looks/Keyhole")
    fill = UsdLux.DomeLight.Define(stage, "/World/Light/Fill")
    fill.GetPrim().SetDocumentation("The night sky over the roofless room, so that the dark is not black.")
    fill.CreateIntensityAttr(0.2)
    fill.CreateColorAttr(Gf.Vec3f(0.45, 0.62, 1.0))
    fill.GetPrim().CreateAttribute("photonbeams:enabled", Sdf.ValueTypeNames.Bool, False).Set(False)
    hole = keyhole_outline(NECK, HEIGHT)
    count = len(hole)
    points = np.column_stack([np.concatenate([[NECK], hole]), np.full(count + 1, middle[2])])
    fan = [[0, 1 + i, 1 + (i + 1) % count] for i in range(count)]
    portal = mesh(stage, "/World/Portal", Shape(points, fan, np.zeros((3 * count, 2))))
    portal.GetPrim().SetDocumentation("Fills the keyhole halfway through the door. A light's portal, and no surface.")


def dust_and_look(stage: Usd.Stage) -> None:
    """Define the fog and the look of the beams: the Talk's colour ramp times physical attenuation."""
    dust = stage.DefinePrim("/World/Dust", "Scope")
    dust.SetDocumentation("A thin fog that fills the whole space; coefficients per metre.")
    dust.AddAppliedSchema("PhotonBeamsMediumAPI")
    dust.CreateAttribute("photonbeams:scattering", Sdf.ValueTypeNames.Color3f, False).Set(Gf.Vec3f(0.12, 0.12, 0.12))
    dust.CreateAttribute("photonbeams:absorption", Sdf.ValueTypeNames.Color3f, False).Set(Gf.Vec3f(0.01, 0.02, 0.03))
    dust.CreateAttribute("photonbeams:anisotropy", Sdf.ValueTypeNames.Float, False).Set(0.2)
    look = stage.DefinePrim("/World/Looks/Keyhole", "PhotonBeamsLook")
    look.SetDocumentation(
        "Near-white at the keyhole, through orange to deep red and violet where the beams extinguish."
    )
    ramp = {
        0.0: (1.0, 0.93, 0.8),
        0.3: (1.0, 0.72, 0.36),
        0.6: (1.0, 0.36, 0.12),
        0.85: (0.55, 0.1, 0.12),
        1.0: (0.2, 0.05, 0.2),
    }
    look.CreateAttribute("photonbeams:along:ramp:knots", Sdf.ValueTypeNames.FloatArray, False).Set(list(ramp))
    look.CreateAttribute("photonbeams:along:ramp:colors", Sdf.ValueTypeNames.Color3fArray, False).Set(
        [Gf.Vec3f(*c) for c in ramp.values()]
    )
    for name, value in (("ramp:interpolation", "monotone"), ("space", "distance")):
        attribute = f"photonbeams:along:{name}"
        look.CreateAttribute(attribute, Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform).Set(value)
    for name, value in (("begin", LIGHT_DISTANCE), ("end", LIGHT_DISTANCE + 2.0)):  # from the hole to the floor
        look.CreateAttribute(f"photonbeams:along:{name}", Sdf.ValueTypeNames.Float, False).Set(value)
    look.CreateAttribute("photonbeams:along:physical", Sdf.ValueTypeNames.Bool, False).Set(True)


def cameras(stage: Usd.Stage) -> None:
    """Define the shot's camera, and the one that flies through the beams."""
    still = camera(stage, "/World/Camera", 32)
    UsdGeom.Xformable(still).AddTransformOp().Set(aimed((-2.0, 1.0, 2.35), (0.12, 0.56, 0.95)))
    flying = camera(stage, "/World/Flight", 28)
    flying.GetPrim().SetDocumentation("Flies into the shaft, up along it toward the light, and out on the other side.")
    flying.CreateFStopAttr(4.0)
    flying.CreateShutterOpenAttr(-0.25)  # half of a frame: the 180 degree shutter of a film camera
    flying.CreateShutterCloseAttr(0.25)
    path = UsdGeom.Xformable(flying).AddTransformOp()
    for frame in range(FRAMES[0], FRAMES[1] + 1):
        path.Set(aimed(*flight((frame - FRAMES[0]) / (FRAMES[1] - FRAMES[0]))), frame)


def model(folder: Path) -> Path:
    """Write `wood.png` and `keyhole.usda` into `folder`; the same version of this file writes the same bytes."""
    random = np.random.default_rng(11)
    write_wood(folder / "wood.png", random)
    stage = new_stage("The keyhole shot. Geometry by model.py; render it with `make keyhole`.", FRAMES)
    for group in ("Light", "Door", "Room", "Props"):
        UsdGeom.Xform.Define(stage, f"/World/{group}")
    for group in ("Looks", "Materials"):
        UsdGeom.Scope.Define(stage, f"/World/{group}")
    cameras(stage)
    lights(stage)
    dust_and_look(stage)
    old = material(stage, "OldWood", (0.55, 0.5, 0.45), 0.6, texture="./wood.png")
    boards = material(stage, "Boards", (1.5, 1.4, 1.3), 0.42, texture="./wood.png")
    oak = material(stage, "Oak", (0.9, 0.7, 0.5), 0.5, texture="./wood.png")
    iron = material(stage, "Iron", (0.16, 0.15, 0.15), 0.42, metallic=1.0)
    copper = material(stage, "Copper", (0.85, 0.48, 0.3), 0.3, metallic=1.0)
    stone = material(stage, "Stone", (0.27, 0.26, 0.25), 0.85)
    soot = material(stage, "Soot", (0.05, 0.045, 0.04), 0.9)
    for group, parts in (("Door", door(random)), ("Room", room(random)), ("Props", props(random))):
        for name, shape in parts.items():
            looks = {"Leaf": old, "Frame": old, "Floor": boards, "Chest": oak, "Stool": oak, "Jug": copper}
            looks |= dict.fromkeys(("Iron", "Rivets", "Ring", "ChestIron"), iron)
            mesh(stage, f"/World/{group}/{name}", shape, looks.get(name, stone))
    mesh(stage, "/World/Chamber", chamber(), soot).GetPrim().SetDocumentation(
        "Closed behind the door: light reaches the room through the keyhole alone."
    )
    return save(stage, folder / "keyhole.usda")


if __name__ == "__main__":
    print(model(HERE))
