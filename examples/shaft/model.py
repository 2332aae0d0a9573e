"""Write `physical.usda`: the sun through three windows into a dusty store of jars, as exact as the renderer is.

Run it with the project's Python from anywhere; it writes the stage beside itself:

    .venv/bin/python examples/shaft/model.py

The stage is committed, so run it only to change the geometry. `directed.usda` is written by hand: a thin layer over the
stage with what an artist makes of the same light.

Metres, Y up. The windows are in the wall on the right, x = 2; the camera looks along it from the left.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "keyhole")]

from shapes import Array, Shape, box, lathe, merge, pierced, placed, square_outline, torus  # noqa: E402
from staging import aimed, new_stage, render_settings, save, turned  # noqa: E402
from surfaces import material, mesh  # noqa: E402

WALL, THICKNESS, HEIGHT = 2.0, 0.36, 3.3  # place and thickness of the wall with the windows, height of the room
WINDOWS = (-1.35, -0.25, 0.85)  # middles of the windows, along the wall
HALF, SILL, SPRING = 0.22, 1.25, 2.15  # of a window: half its width, heights of its sill and of the foot of its arch
SUN = np.array([-0.80, -0.66, 0.10])  # direction of the light
JAR = """
0.000 0.000  0.085 0.000  0.095 0.015  0.150 0.110  0.205 0.260  0.225 0.400  0.215 0.500  0.170 0.600
0.105 0.665  0.082 0.700  0.080 0.745  0.105 0.790  0.118 0.805  0.112 0.815  0.095 0.800  0.066 0.745
0.066 0.700  0.000 0.600
"""  # radius and height, from the foot up outside and down inside
BOWL = "0.00 0.00  0.06 0.00  0.07 0.02  0.15 0.09  0.21 0.17  0.215 0.175  0.205 0.178  0.14 0.10  0.00 0.04"


# -- the store -----------------------------------------------------------------------------------------------------


def lancet(middle: float, half: float = HALF, steps: int = 14) -> Array:
    """Return a pointed window's outline (N, 2), counter-clockwise from the lower right corner."""
    arc = np.linspace(0, np.pi / 3, steps)  # of circles around the arch's other foot
    right = np.column_stack([-half + 2 * half * np.cos(arc), SPRING + 2 * half * np.sin(arc)])
    left = (right * [-1, 1])[::-1][1:]
    side = np.linspace((half, SILL), (half, SPRING), 7)[:-1]
    base = np.linspace((-half, SILL), (half, SILL), 6)[1:-1]
    outline = np.concatenate([side, right, left, (side * [-1, 1])[::-1], base])
    return outline + np.array([middle, 0.0])


def in_wall(shape: Shape) -> Shape:
    """Return a shape, made in the plane z = 0 with x along the wall, at its place in the wall with the windows."""
    return placed(shape, turned(1, -90), (WALL, 0.0, 0.0))


def windows() -> dict[str, Shape]:
    """Return the wall with its windows, and their bars."""
    panels, bars = [], []
    for middle in WINDOWS:
        hole, center = lancet(middle), (middle, 0.5 * (SILL + SPRING))
        # Neighbours overlap by a millimetre, so that no ray slips through the joint between them.
        around = square_outline((middle - 0.5505, -0.05), (middle + 0.5505, HEIGHT), center, hole)
        panels.append(pierced(around, hole, -THICKNESS, 0.0, 0.025, (0, 0)))
        top = SPRING + np.sqrt(3) * HALF
        bars.append(box((middle - 0.014, SILL, -0.21), (middle + 0.014, top, -0.17)))
        for y in np.linspace(SILL, SPRING, 4)[1:]:
            bars.append(box((middle - HALF - 0.01, y - 0.010, -0.205), (middle + HALF + 0.01, y + 0.010, -0.175)))
    low, high = WINDOWS[0] - 0.55, WINDOWS[-1] + 0.55
    panels += [
        box((-2.7, -0.05, -THICKNESS), (low + 0.001, HEIGHT, 0.0)),
        box((high - 0.001, -0.05, -THICKNESS), (6.2, HEIGHT, 0.0)),
    ]
    sills = [box((m - HALF - 0.06, SILL - 0.07, -0.05), (m + HALF + 0.06, SILL, 0.06), 0.012) for m in WINDOWS]
    return {"Windows": in_wall(merge(panels)), "Bars": in_wall(merge(bars)), "Sills": in_wall(merge(sills))}


def rubble(random: np.random.Generator, width: tuple[float, float]) -> Shape:
    """Return a wall of rough stones near the plane z = 0."""
    blocks, low = [], 0.0
    while low < HEIGHT:
        high, left = low + random.uniform(0.2, 0.3), width[0] - random.uniform(0.0, 0.3)
        while left < width[1]:
            right, front = left + random.uniform(0.3, 0.65), random.uniform(0.0, 0.03)
            blocks.append(box((left + 0.006, low + 0.006, -0.06), (right - 0.006, high - 0.006, front), 0.014))
            left = right
        low = high
    return merge(blocks)


def room(random: np.random.Generator) -> dict[str, Shape]:
    """Return the floor, the walls and the roof: the store is closed except for the windows."""
    boards, near = [], -2.5
    while near < 6.0:
        far, left = near + random.uniform(0.5, 0.7), -3.4 + random.uniform(-0.5, 0.0)
        while left < WALL:
            right = left + random.uniform(0.6, 1.0)
            boards.append(
                box((left + 0.005, -0.1, near + 0.005), (right - 0.005, random.uniform(-0.008, 0.0), far - 0.005), 0.01)
            )
            left = right
        near = far
    shell = [
        box((-3.7, -0.05, -2.75), (WALL + 0.01, HEIGHT, -2.5)),
        box((-3.7, -0.05, -2.75), (-3.4, HEIGHT, 6.2)),
        box((-3.7, -0.05, 6.0), (WALL + 0.01, HEIGHT, 6.2)),
        box((-3.7, HEIGHT - 0.01, -2.75), (WALL + THICKNESS, HEIGHT + 0.2, 6.2)),
        box((-3.7, -0.3, -2.75), (WALL + THICKNESS, -0.03, 6.2)),
    ]
    rafters = [
        box((-3.4, HEIGHT - 0.24, z - 0.09), (WALL, HEIGHT, z + 0.09), 0.012) for z in (-1.9, -0.8, 0.3, 1.4, 2.5)
    ]
    back = placed(rubble(random, (-3.4, WALL)), np.eye(3), (0.0, 0.0, -2.48))
    return {"Floor": merge(boards), "Shell": merge(shell), "Rafters": merge(rafters), "Back": back}


#: Places on the floor, and sizes, of the jars in the light and beside it.
JARS = (
    (0.12, 0.02, 1.15), (-0.42, -1.15, 1.0), (-1.75, -1.75, 1.5), (-1.2, -2.0, 1.15), (-2.35, -1.95, 1.25),
    (1.45, -2.05, 1.3), (1.0, -2.1, 0.9), (1.6, 1.75, 1.25), (-0.28, 0.95, 0.5), (-2.75, -0.4, 1.4),
)  # fmt: skip


def jar() -> Shape:
    """Return a jar of size 1, with two handles."""
    handle = placed(torus(0.075, 0.013, 28, 8), turned(0, 90), (0.135, 0.67, 0.0))
    body = lathe(np.array(JAR.split(), dtype=float).reshape(-1, 2), 48)
    return merge([body, handle, placed(handle, turned(1, 180), (0, 0, 0))])


def write_jars(stage: Usd.Stage, random: np.random.Generator, clay: UsdShade.Material) -> None:
    """Define the jars: one mesh, and references to it."""
    first = "/World/Things/Jar01"
    for number, (x, z, size) in enumerate(JARS):
        path = f"/World/Things/Jar{number + 1:02}"
        if number:
            stage.DefinePrim(path).GetReferences().AddInternalReference(first)
        one = UsdGeom.XformCommonAPI(mesh(stage, path, jar(), clay) if not number else stage.GetPrimAtPath(path))
        one.SetTranslate(Gf.Vec3d(x, 0, z))
        one.SetRotate(Gf.Vec3f(0, round(random.uniform(0, 180), 1), 0))
        one.SetScale(Gf.Vec3f(size, size, size))


def bench() -> dict[str, Shape]:
    """Return a bench along the back wall, and bowls on it."""
    bowl = lathe(np.array(BOWL.split(), dtype=float).reshape(-1, 2), 40)
    wood = [box((-0.75, 0.50, -2.4), (0.65, 0.55, -2.05), 0.01)]
    wood += [box((x - 0.04, 0.0, -2.36), (x + 0.04, 0.51, -2.1), 0.008) for x in (-0.6, 0.5)]
    bowls = [placed(bowl, np.eye(3), (x, 0.55, -2.22)) for x in (-0.45, 0.3)]
    return {"Bench": merge(wood), "Bowls": merge(bowls)}


# -- light, dust, camera -------------------------------------------------------------------------------------------


def without_beams(light: UsdLux.BoundableLightBase) -> None:
    """Make a light that lights only surfaces."""
    light.GetPrim().AddAppliedSchema("PhotonBeamsLightAPI")
    light.GetPrim().CreateAttribute("photonbeams:enabled", Sdf.ValueTypeNames.Bool, False).Set(False)


def lights(stage: Usd.Stage) -> None:
    """Define the sun with its windows, and, as lights for surfaces, what the walls of the store would reflect."""
    sun = UsdLux.DistantLight.Define(stage, "/World/Light/Sun")
    prim = sun.GetPrim()
    prim.SetDocumentation("Half a degree wide, as the sun is. All beams come through the windows.")
    prim.AddAppliedSchema("PhotonBeamsLightAPI")
    sun.CreateAngleAttr(0.53)
    sun.CreateNormalizeAttr(True)
    sun.CreateIntensityAttr(24.0)
    sun.CreateColorAttr(Gf.Vec3f(1.0, 0.9, 0.76))
    UsdGeom.Xformable(sun).AddTransformOp().Set(aimed(-6 * SUN, (0, 0, 0)))
    prim.CreateAttribute("photonbeams:lightGroup", Sdf.ValueTypeNames.Token, False).Set("sun")
    portals = []
    for number, middle in enumerate(WINDOWS):
        hole = lancet(middle)
        count = len(hole)
        points = np.column_stack([np.concatenate([[(middle, 0.5 * (SILL + SPRING))], hole]), np.full(count + 1, -0.30)])
        fan = [[0, 1 + i, 1 + (i + 1) % count] for i in range(count)]
        path = f"/World/Portals/Window{number + 1}"
        mesh(stage, path, in_wall(Shape(points, fan, np.zeros((3 * count, 2)))))
        portals.append(path)
    prim.CreateRelationship("photonbeams:portal", False).SetTargets(portals)
    sky = UsdLux.RectLight.Define(stage, "/World/Light/Sky")
    sky.GetPrim().SetDocumentation("Cool light from a door behind the camera.")
    sky.CreateWidthAttr(2.0)
    sky.CreateHeightAttr(2.4)
    sky.CreateIntensityAttr(4.0)
    sky.CreateColorAttr(Gf.Vec3f(0.5, 0.68, 1.0))
    UsdGeom.Xformable(sky).AddTransformOp().Set(aimed((-2.2, 1.9, 5.8), (-0.4, 0.9, 0.0)))
    without_beams(sky)
    UsdGeom.Xform.Define(stage, "/World/Light/Bounce").GetPrim().SetDocumentation(
        "What the sunlit floor throws back, without the noise that photonbeams:bounces would have."
    )
    for number, middle in enumerate(WINDOWS):
        lamp = UsdLux.SphereLight.Define(stage, f"/World/Light/Bounce/Lamp{number + 1}")
        lamp.CreateTreatAsPointAttr(True)
        lamp.CreateNormalizeAttr(True)
        lamp.CreateIntensityAttr(2.4)
        lamp.CreateColorAttr(Gf.Vec3f(1.0, 0.72, 0.48))
        UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(-0.85, 0.4, round(middle + 0.75, 3)))
        without_beams(lamp)


def dust_and_camera(stage: Usd.Stage) -> None:
    """Define the dust through which everything is seen, the camera, and the render settings."""
    dust = stage.DefinePrim("/World/Dust", "Scope")
    dust.SetDocumentation("The air of the store; coefficients per metre.")
    dust.AddAppliedSchema("PhotonBeamsMediumAPI")
    dust.CreateAttribute("photonbeams:scattering", Sdf.ValueTypeNames.Color3f, False).Set(Gf.Vec3f(0.10, 0.10, 0.10))
    dust.CreateAttribute("photonbeams:anisotropy", Sdf.ValueTypeNames.Float, False).Set(0.25)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateHorizontalApertureAttr(0.36)
    camera.CreateVerticalApertureAttr(0.2025)
    camera.CreateFocalLengthAttr(0.30)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100))
    UsdGeom.Xformable(camera).AddTransformOp().Set(aimed((-2.0, 1.25, 4.5), (0.12, 1.22, -0.5)))
    render_settings(stage, "/World/Camera")


def model(folder: Path) -> Path:
    """Write `physical.usda` into `folder`; the same version of this file writes the same bytes."""
    random = np.random.default_rng(3)
    stage = new_stage("The sun through three windows. Geometry by model.py; directed.usda goes over it.")
    for group in ("Light", "Portals", "Room", "Things"):
        UsdGeom.Xform.Define(stage, f"/World/{group}")
    for group in ("/World/Materials", "/Render"):
        UsdGeom.Scope.Define(stage, group)
    dust_and_camera(stage)
    lights(stage)
    plaster = material(stage, "Plaster", (0.34, 0.31, 0.28), 0.9)
    stone = material(stage, "Stone", (0.25, 0.23, 0.21), 0.85)
    flag = material(stage, "Flag", (0.27, 0.24, 0.21), 0.6)
    timber = material(stage, "Timber", (0.16, 0.10, 0.06), 0.7)
    clay = material(stage, "Clay", (0.46, 0.23, 0.13), 0.6)
    iron = material(stage, "Iron", (0.05, 0.05, 0.05), 0.5)
    of = {"Floor": flag, "Back": stone, "Sills": stone, "Rafters": timber, "Bench": timber, "Bars": iron}
    of["Bowls"] = clay
    for group, parts in (("Room", room(random) | windows()), ("Things", bench())):
        for name, shape in parts.items():
            mesh(stage, f"/World/{group}/{name}", shape, of.get(name, plaster))
    write_jars(stage, random, clay)
    return save(stage, folder / "physical.usda")


if __name__ == "__main__":
    print(model(HERE))
