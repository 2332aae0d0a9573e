"""Write `magic.usda`: strands of golden light wind out of a flower and up a column in a dark hall.

Run it with the project's Python from anywhere; it writes the stage beside itself, and `grow.usda`, a layer to lay over
it, in which the strands grow out of the flower:

    .venv/bin/python examples/magic/model.py

Both are committed, so run it only to change the geometry. Looks, lights and cameras can be changed in the stage's text
just as easily.

Metres, Y up. The flower stands on a low pedestal on the left, the column on the right.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt
from scipy.interpolate import CubicSpline

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "keyhole")]

from shapes import Array, Shape, box, lathe, merge, placed, torus  # noqa: E402
from staging import aimed, new_stage, render_settings, save, turned  # noqa: E402
from surfaces import material, mesh  # noqa: E402

FRAMES = (1, 48)
FLOWER = np.array([-0.85, 0.56, 0.35])  # its heart
COLUMN = np.array([0.62, 0.0, 0.0])
SHAFT = 0.165  # radius of the column
STRANDS = 27  # strands that wind up the column
TENDRILS = 14  # strands that curl about the flower
SPACING = 0.045  # between the points of a curve
# The strands' path from the flower to the foot of the column. From there on they wind around it.
WAY = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.02, 0.24, 0.02),
        (-0.10, 0.55, 0.0),
        (-0.13, 0.88, -0.16),
        (0.14, 1.06, -0.26),
        (0.46, 0.78, -0.08),
        (0.84, 0.26, 0.26),
    ]
)
TURNS, FOOT, TOP, AROUND = 2.6, 0.42, 1.78, 0.33  # of the helix: turns, heights, radius
GOLD = np.array([(1.0, 0.80, 0.42), (1.0, 0.66, 0.24), (1.0, 0.52, 0.16), (1.0, 0.90, 0.66), (1.0, 0.46, 0.34)])


# -- the hall ------------------------------------------------------------------------------------------------------


def column() -> dict[str, Shape]:
    """Return a fluted column on a square plinth, tall enough to leave the picture."""
    flutes, steps = 16, 16 * 8
    angles = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    groove = SHAFT - 0.018 * np.abs(np.sin(flutes / 2 * angles)) ** 0.7
    heights = np.array([0.30, 0.34, 1.2, 2.2, 3.4])
    rings = [
        np.column_stack([(groove if i else 0.0 * groove + SHAFT) * np.cos(angles), 0 * angles + y,
                         -(groove if i else 0.0 * groove + SHAFT) * np.sin(angles)])
        for i, y in enumerate(heights)
    ]  # fmt: skip
    faces = [
        [row * steps + i, row * steps + (i + 1) % steps, (row + 1) * steps + (i + 1) % steps, (row + 1) * steps + i]
        for row in range(len(heights) - 1)
        for i in range(steps)
    ]
    fluted = Shape(np.concatenate(rings), faces, np.zeros((4 * len(faces), 2)))
    base = lathe([(0.255, 0.12), (0.262, 0.14), (0.255, 0.17), (0.225, 0.19), (0.205, 0.215), (0.21, 0.235),
                  (0.225, 0.255), (0.205, 0.285), (0.172, 0.30), (0.0, 0.30)], 64)  # fmt: skip
    plinth = box((-0.29, 0.0, -0.29), (0.29, 0.125, 0.29), 0.012)
    return {name: placed(shape, np.eye(3), COLUMN) for name, shape in
            (("Shaft", fluted), ("Base", base), ("Plinth", plinth))}  # fmt: skip


def courses(random: np.random.Generator, width: tuple[float, float], height: float) -> Shape:
    """Return a wall of dressed stones, their faces near the plane z = 0."""
    blocks, low = [], 0.0
    while low < height:
        high, left = low + random.uniform(0.30, 0.38), width[0] - random.uniform(0.0, 0.6)
        while left < width[1]:
            right, front = left + random.uniform(0.5, 0.95), random.uniform(-0.012, 0.012)
            blocks.append(box((left + 0.005, low + 0.005, -0.1), (right - 0.005, high - 0.005, front), 0.012))
            left = right
        low = high
    return merge(blocks)


def flags(random: np.random.Generator) -> Shape:
    """Return a floor of flagstones."""
    stones, near = [], -1.3
    while near < 5.0:
        far, left = near + random.uniform(0.42, 0.6), -4.0 + random.uniform(0.0, 0.5)
        while left < 4.0:
            right, top = left + random.uniform(0.45, 0.85), random.uniform(-0.006, 0.004)
            stones.append(box((left + 0.004, -0.1, near + 0.004), (right - 0.004, top, far - 0.004), 0.008))
            left = right
        near = far
    return merge(stones)


def petal(length: float, width: float, opening: float, turn: float, steps: tuple[int, int] = (10, 6)) -> Shape:
    """Return a petal from the origin up, `opening` degrees off the vertical, that closes a little toward its tip."""
    u, v = np.meshgrid(np.linspace(0, 1, steps[0] + 1), np.linspace(-1, 1, steps[1] + 1), indexing="ij")
    lean = np.radians(opening) * (1.25 - 0.9 * u + 0.45 * u**4)
    half = width * np.sin(np.pi * u**0.75) ** 0.8 * (1 - 0.15 * u)
    step = np.gradient(u, axis=0) * length
    out = np.cumsum(np.sin(lean) * step, axis=0) - np.sin(lean) * step + 0.012
    up = np.cumsum(np.cos(lean) * step, axis=0) - np.cos(lean) * step
    hollow = 0.55 * half * v**2  # the rims stand up, like those of a boat
    points = np.stack([out - hollow * np.cos(lean), up + hollow * np.sin(lean), half * v], axis=-1).reshape(-1, 3)
    side = steps[1] + 1
    faces = [
        [i * side + j, i * side + j + 1, (i + 1) * side + j + 1, (i + 1) * side + j]
        for i in range(steps[0])
        for j in range(steps[1])
    ]
    grid = points.reshape(steps[0] + 1, side, 3)
    normals = np.cross(np.gradient(grid, axis=0), np.gradient(grid, axis=1)).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    shape = Shape(points, faces, np.zeros((4 * len(faces), 2)), normals)
    return placed(shape, turned(1, turn), (0.0, 0.0, 0.0))


def flower() -> dict[str, Shape]:
    """Return the blossom, its cup, and the pedestal."""
    rings = [(5, 0.17, 0.055, 20, 0.0), (7, 0.25, 0.078, 42, 12.0), (9, 0.31, 0.088, 66, 4.0)]
    petals = [
        petal(length, width, opening, first + 360 / count * i)
        for count, length, width, opening, first in rings
        for i in range(count)
    ]
    low = FLOWER - np.array([0.0, 0.05, 0.0])
    cup = lathe([(0.0, -0.06), (0.05, -0.055), (0.075, -0.03), (0.055, 0.0), (0.0, 0.01)], 40)
    drum = lathe([(0.20, 0.0), (0.205, 0.02), (0.20, 0.05), (0.165, 0.075), (0.15, 0.11), (0.142, 0.30), (0.15, 0.38),
                  (0.175, 0.41), (0.205, 0.425), (0.21, 0.45), (0.205, 0.475), (0.0, 0.48)], 56)  # fmt: skip
    ring = placed(torus(0.152, 0.012), np.eye(3), (0.0, 0.345, 0.0))
    foot = np.array([FLOWER[0], 0.0, FLOWER[2]])
    return {
        "Petals": placed(merge(petals), np.eye(3), low),
        "Cup": placed(cup, np.eye(3), low),
        "Pedestal": placed(merge([drum, ring]), np.eye(3), foot),
    }


# -- the strands ---------------------------------------------------------------------------------------------------


def spine(count: int = 900) -> Array:
    """Return points at even steps along the spine of all strands: from the flower, and around the column."""
    start = FLOWER + WAY[-1] - COLUMN
    begin = np.arctan2(start[2], start[0])
    turn = np.linspace(0, 1, 60)
    angle = begin - 2 * np.pi * TURNS * turn
    radius = AROUND - 0.05 * turn
    helix = COLUMN + np.column_stack([radius * np.cos(angle), FOOT + (TOP - FOOT) * turn, radius * np.sin(angle)])
    # Enter the helix along its tangent: leave out the last points before it takes over.
    points = np.concatenate([FLOWER + WAY[:-1], helix[3:]])
    return evenly(points, count)


def evenly(points: Array, count: int) -> Array:
    """Return a number of points at even steps along the smooth curve through `points`."""
    chord = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    curve = CubicSpline(chord, points)
    fine = curve(np.linspace(0, chord[-1], 40 * len(points)))
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    at = np.linspace(0, length[-1], count)
    return np.column_stack([np.interp(at, length, each) for each in fine.T])


def frames(points: Array) -> tuple[Array, Array]:
    """Return two directions across a curve that turn as little as possible along it."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.cross(tangent[0], (0.3, 0.1, 1.0))
    normals = [first / np.linalg.norm(first)]
    for each in tangent[1:]:
        normal = normals[-1] - each * (normals[-1] @ each)
        normals.append(normal / np.linalg.norm(normal))
    return np.array(normals), np.cross(tangent, normals)


def curl(place: Array, tangent: Array, across: Array, length: float, turns: float, steps: int = 60) -> Array:
    """Return a spiral that continues along `tangent` and bends more and more toward `across`, like a fern."""
    x = np.linspace(0, 1, steps + 1)[1:]
    angle = 2 * np.pi * turns * x**2.2
    step = length / steps * (1 - 0.55 * x)
    binormal = np.cross(tangent, across)
    walk = np.cumsum((np.cos(angle)[:, None] * tangent + np.sin(angle)[:, None] * across) * step[:, None], axis=0)
    return place + walk + 0.06 * length * x[:, None] ** 2 * binormal


def strands(random: np.random.Generator) -> list[Array]:
    """Return the curves: a braid along the spine, each strand leaving it in a curl of its own; and tendrils."""
    middle = spine()
    normal, binormal = frames(middle)
    u = np.linspace(0, 1, len(middle))
    # Tight in the flower, loose in the air, close about the column, and open at the end.
    loose = np.interp(u, [0, 0.03, 0.1, 0.18, 0.28, 0.85, 1], [0.010, 0.02, 0.09, 0.12, 0.055, 0.045, 0.12])
    found = []
    for i in range(STRANDS):
        share, phase = np.sqrt((i + 0.5) / STRANDS), 2.39996 * i
        twist = phase + 2 * np.pi * (2.2 + 0.5 * random.normal()) * u
        wave = 1 + 0.35 * np.sin(2 * np.pi * random.uniform(2, 4) * u + random.uniform(0, 6.3))
        offset = (loose * share * wave)[:, None] * (np.cos(twist)[:, None] * normal + np.sin(twist)[:, None] * binormal)
        curve = middle + offset
        # A third of the strands winds all the way up; the others leave in the air or on the column.
        reach = ((0.84, 1.0), (0.09, 0.27), (0.4, 0.93))[i % 3]
        end = int(len(u) * random.uniform(*reach)) - 2
        heading = curve[end] - curve[end - 4]
        heading /= np.linalg.norm(heading)
        # The curls lie more or less across the view; most turn up.
        outward = np.cross(heading, (0.0, 0.0, 1.0))
        outward *= np.sign(outward[1]) * (1 if random.uniform() < 0.8 else -1)
        outward += 0.35 * random.normal(size=3)
        outward -= heading * (outward @ heading)
        outward /= np.linalg.norm(outward)
        tip = curl(curve[end], heading, outward, random.uniform(0.7, 1.3), random.uniform(0.9, 1.5))
        found.append(resampled(np.concatenate([curve[: end + 1 : 12], tip[4::4]])))
    for i in range(TENDRILS):
        angle = 2.39996 * i + random.uniform(-0.2, 0.2)
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        heading = out * random.uniform(0.35, 0.9) + (0.0, 1.0, 0.0)
        heading /= np.linalg.norm(heading)
        across = out - heading * (out @ heading)
        across /= np.linalg.norm(across)
        side = 0.5 * random.normal() * np.cross(heading, across)
        across = (across + side) / np.linalg.norm(across + side)
        heart = FLOWER + 0.015 * out
        length = random.uniform(0.35, 0.75)
        found.append(
            resampled(np.concatenate([[heart], curl(heart, heading, across, length, random.uniform(0.8, 1.5))]))
        )
    return found


def resampled(points: Array) -> Array:
    """Return a curve with points closer where it is curled: at most `SPACING` apart."""
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return evenly(points, max(8, round(length / SPACING)))


def write_strands(stage: Usd.Stage, random: np.random.Generator) -> None:
    """Define the strands, and the glow around them: the same curves, wider and dimmer."""
    curves = strands(random)
    widths, powers, colors = [], [], []
    for number, points in enumerate(curves):
        count, s = len(points), np.linspace(0, 1, len(points))
        tendril = number >= STRANDS
        widest = random.uniform(0.005, 0.009) if tendril else random.choice([0.006, 0.009, 0.015], p=[0.4, 0.4, 0.2])
        taper = np.minimum(1, 0.35 + s / 0.12) * np.clip((1 - s) / 0.24, 0, 1) ** 0.8
        width = np.maximum(widest * taper, 0.0012)
        color = GOLD[random.choice(len(GOLD), p=[0.3, 0.28, 0.18, 0.14, 0.10])]
        widths.append(width)
        # The brightness of a beam is its power divided by its radius. So it is the same everywhere, except at the ends.
        powers.append(
            random.uniform(0.6, 1.1)
            * np.interp(s, [0, 0.12], [0.4, 1])[:, None]
            * (width / 0.01)[:, None]
            * color
            * (0.75 + 0.25 * (1 - s[:, None] ** 3))
        )
        colors.append(np.broadcast_to(color, (count, 3)))
    prim = UsdGeom.BasisCurves.Define(stage, "/World/Magic/Strands")
    prim.CreateTypeAttr("cubic")
    prim.CreateBasisAttr("bspline")
    prim.CreateWrapAttr("pinned")
    prim.CreateCurveVertexCountsAttr([len(points) for points in curves])
    prim.CreatePointsAttr(vectors(np.concatenate(curves), 4))
    prim.CreateWidthsAttr(numbers(np.concatenate(widths), 5))
    prim.SetWidthsInterpolation("vertex")
    prim.CreateDisplayColorPrimvar("uniform").Set(vectors(np.array([each[0] for each in colors]), 3))
    extent = UsdGeom.Curves.ComputeExtent(prim.GetPointsAttr().Get(), prim.GetWidthsAttr().Get())
    prim.CreateExtentAttr([Gf.Vec3f(*[round(float(x), 4) for x in each]) for each in extent])
    drawn(prim.GetPrim(), "strands", "/World/Looks/Strand")
    attribute(prim.GetPrim(), "power", Sdf.ValueTypeNames.Color3fArray, vectors(np.concatenate(powers), 4))
    prim.GetPrim().SetDocumentation("Filaments of light. They light no surface: the lamps of /World/Light/Along do.")
    glow = UsdGeom.BasisCurves.Define(stage, "/World/Magic/Glow")
    glow.GetPrim().GetReferences().AddInternalReference("/World/Magic/Strands")
    glow.GetPrim().SetDocumentation("The same curves once more, wide and soft.")
    glow.CreateWidthsAttr(numbers(9 * np.concatenate(widths) + 0.012, 5))
    drawn(glow.GetPrim(), "glow", "/World/Looks/Glow")


def drawn(prim: Usd.Prim, group: str, look: str) -> None:
    """Turn curves into beams, with a light group and a look."""
    prim.AddAppliedSchema("PhotonBeamsCurvesAPI")
    attribute(prim, "lightGroup", Sdf.ValueTypeNames.Token, group)
    prim.CreateRelationship("photonbeams:look", False).SetTargets([look])


def attribute(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: object, uniform: bool = False) -> None:
    """Author an attribute of photonbeams."""
    variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
    prim.CreateAttribute(f"photonbeams:{name}", kind, False, variability).Set(value)


def vectors(values: Array, digits: int) -> Vt.Vec3fArray:
    """Return rounded vectors in USD's type."""
    return Vt.Vec3fArray.FromNumpy(np.round(values, digits).astype(np.float32))


def numbers(values: Array, digits: int) -> Vt.FloatArray:
    """Return rounded numbers in USD's type."""
    return Vt.FloatArray.FromNumpy(np.round(values, digits).astype(np.float32))


# -- looks, light, cameras -----------------------------------------------------------------------------------------


def look(stage: Usd.Stage, name: str, doc: str, **values: object) -> None:
    """Define a look; `__` in a name stands for a colon."""
    kinds = Sdf.ValueTypeNames
    prim = stage.DefinePrim(f"/World/Looks/{name}", "PhotonBeamsLook")
    prim.SetDocumentation(doc)
    for key, value in values.items():
        kind, uniform = kinds.Float, False
        if isinstance(value, bool):
            kind = kinds.Bool
        elif isinstance(value, int):
            kind = kinds.Int
        elif isinstance(value, str):
            kind, uniform = (kinds.String, False) if key.endswith("expression") else (kinds.Token, True)
        elif key.endswith("colors"):
            kind, value = kinds.Color3fArray, [Gf.Vec3f(*each) for each in value]
        elif isinstance(value, list):
            kind = kinds.FloatArray
        elif isinstance(value, tuple):
            kind, value = kinds.Float3, Gf.Vec3f(*value)
        attribute(prim, key.replace("__", ":"), kind, value, uniform)


PULSES = "pow(fract(0.8 * distance - time + random), 5) * smoothstep(1, 0.94, fract(0.8 * distance - time + random))"


def looks(stage: Usd.Stage) -> None:
    """Define the fog that only beams feel, and the two looks."""
    air = stage.DefinePrim("/World/Air", "Scope")
    air.SetDocumentation("Something for the light to show in; surfaces are as in clear air.")
    air.AddAppliedSchema("PhotonBeamsMediumAPI")
    attribute(air, "scattering", Sdf.ValueTypeNames.Color3f, Gf.Vec3f(0.05, 0.05, 0.05))
    attribute(air, "surfaces", Sdf.ValueTypeNames.Bool, False)
    ramp = {
        "along__ramp__knots": [0.0, 0.35, 0.7, 1.0],
        "along__ramp__colors": [(1.0, 0.95, 0.8), (1.0, 0.8, 0.5), (1.0, 0.58, 0.3), (1.0, 0.34, 0.3)],
        "along__ramp__interpolation": "monotone",
    }
    look(
        stage, "Strand", "Pale at the flower, red at the tips; pulses run along each strand, at times of its own.",
        along__falloff="none", along__physical=False, **ramp,
        along__expression=f"0.4 + 2.6 * {PULSES}",
        across__profile="biweight",
        eye__falloff="none",
        angle__shading="constant",
    )  # fmt: skip
    look(
        stage, "Glow", "What surrounds the strands: their colours, in wisps, brighter where a pulse is.",
        along__falloff="none", along__physical=False, **ramp,
        along__expression=f"0.5 + 3 * {PULSES}",
        across__profile="gaussian", across__width=0.3,
        eye__falloff="none",
        angle__shading="constant",
        noise__amount=0.8, noise__scale=0.16, noise__octaves=3, noise__drift=(0.0, 0.12, 0.0),
    )  # fmt: skip


def lamp(stage: Usd.Stage, name: str, place: Sequence[float], color: Sequence[float], intensity: float) -> Usd.Prim:
    """Define a point light that lights only surfaces."""
    light = UsdLux.SphereLight.Define(stage, f"/World/Light/{name}")
    light.CreateTreatAsPointAttr(True)
    light.CreateNormalizeAttr(True)
    light.CreateColorAttr(Gf.Vec3f(*color))
    light.CreateIntensityAttr(round(intensity, 5))
    UsdGeom.Xformable(light).AddTranslateOp().Set(Gf.Vec3d(*[round(float(x), 4) for x in place]))
    light.GetPrim().AddAppliedSchema("PhotonBeamsLightAPI")
    attribute(light.GetPrim(), "enabled", Sdf.ValueTypeNames.Bool, False)
    return light.GetPrim()


def along() -> Array:
    """Return the places of the lamps along the strands."""
    return spine(2000)[150::70]


def lights(stage: Usd.Stage) -> None:
    """Define the light in the flower, lamps along the strands, and a cool moon from the left."""
    UsdGeom.Xform.Define(stage, "/World/Light/Along").GetPrim().SetDocumentation(
        "What the strands would throw on the hall: lamps along their way, which make no beams."
    )
    heart = lamp(stage, "Heart", FLOWER + np.array([0.0, 0.11, 0.03]), (1.0, 0.66, 0.32), 0.9)
    heart.SetDocumentation("The light in the blossom.")
    for number, place in enumerate(along()):
        lamp(stage, f"Along/Lamp{number + 1:02}", place, (1.0, 0.62, 0.27), 3.2 / len(along()))
    moon = UsdLux.RectLight.Define(stage, "/World/Light/Moon")
    moon.GetPrim().SetDocumentation("A cool rim from a window on the left that is not seen.")
    moon.CreateWidthAttr(1.2)
    moon.CreateHeightAttr(1.6)
    moon.CreateColorAttr(Gf.Vec3f(0.35, 0.52, 1.0))
    moon.CreateIntensityAttr(1.1)
    UsdGeom.Xformable(moon).AddTransformOp().Set(aimed((-3.4, 2.8, 1.2), (0.3, 0.7, -0.3)))
    moon.GetPrim().AddAppliedSchema("PhotonBeamsLightAPI")
    attribute(moon.GetPrim(), "enabled", Sdf.ValueTypeNames.Bool, False)


def cameras(stage: Usd.Stage) -> None:
    """Define the shot's camera, another one inside the strands, and the render settings."""
    for name, focal, eye, target in (
        ("Camera", 34, (-0.35, 1.0, 3.8), (-0.07, 1.0, 0.0)),
        ("Inside", 22, (-0.62, 1.42, 0.45), (0.55, 1.1, 0.0)),
    ):
        camera = UsdGeom.Camera.Define(stage, f"/World/{name}")
        camera.CreateHorizontalApertureAttr(0.36)
        camera.CreateVerticalApertureAttr(0.2025)
        camera.CreateFocalLengthAttr(focal / 100)
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100))
        UsdGeom.Xformable(camera).AddTransformOp().Set(aimed(eye, target))
    render_settings(stage, "/World/Camera")


def growth(folder: Path, like: Usd.Stage) -> None:
    """Write `grow.usda`: looks whose beams fade ever farther from the flower, and lamps that wait for the strands."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("comment", "Lay it over magic.usda, by --session-layer: the strands grow out of the flower.")
    first, last = FRAMES
    way = spine(2000)
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    reach = [(first, 0.25), (last, length + 1.6)]  # of the light, by frame; the longest curls have this length
    for name in ("Strand", "Glow"):
        prim = stage.OverridePrim(f"/World/Looks/{name}")
        for key, behind in (("inner", 0.25), ("outer", 0.0)):
            grown = prim.CreateAttribute(f"photonbeams:along:{key}", Sdf.ValueTypeNames.Float, False)
            for frame, distance in reach:
                grown.Set(round(distance - behind, 3), frame)
    for number in range(len(along())):
        path = f"/World/Light/Along/Lamp{number + 1:02}"
        intensity = like.GetPrimAtPath(path).GetAttribute("inputs:intensity").Get()
        distance = length * (150 + 70 * number) / len(way)
        frame = first + (last - first) * (distance - reach[0][1]) / (reach[1][1] - reach[0][1])
        lit = stage.OverridePrim(path).CreateAttribute("inputs:intensity", Sdf.ValueTypeNames.Float, False)
        lit.Set(0.0, round(frame - 1, 2))
        lit.Set(intensity, round(frame + 5, 2))
    save(stage, folder / "grow.usda")


def model(folder: Path) -> Path:
    """Write `magic.usda` and `grow.usda` into `folder`; the same version of this file writes the same bytes."""
    random = np.random.default_rng(5)
    stage = new_stage("Strands of light. Geometry by model.py.", FRAMES)
    for group in ("Magic", "Light", "Hall", "Flower"):
        UsdGeom.Xform.Define(stage, f"/World/{group}")
    for group in ("/World/Looks", "/World/Materials", "/Render"):
        UsdGeom.Scope.Define(stage, group)
    cameras(stage)
    looks(stage)
    lights(stage)
    write_strands(stage, random)
    stone = material(stage, "Stone", (0.13, 0.125, 0.13), 0.7)
    marble = material(stage, "Marble", (0.52, 0.49, 0.45), 0.45)
    flag = material(stage, "Flag", (0.20, 0.19, 0.19), 0.3)
    petals = material(stage, "Petals", (0.85, 0.50, 0.42), 0.5)
    # Light from within should show through the petals. There is no translucency, so they glow a little.
    shine = UsdShade.Shader(petals.GetPrim().GetChild("Surface")).CreateInput(
        "emissiveColor", Sdf.ValueTypeNames.Color3f
    )
    shine.Set(Gf.Vec3f(0.05, 0.014, 0.008))
    brass = material(stage, "Brass", (0.75, 0.5, 0.25), 0.35, metallic=1.0)
    wall = placed(courses(random, (-4.0, 4.0), 3.4), np.eye(3), (0.0, 0.0, -1.25))
    for name, shape, look_ in [
        ("Hall/Wall", wall, stone),
        ("Hall/Floor", flags(random), flag),
        *((f"Hall/{name}", shape, marble) for name, shape in column().items()),
        *((f"Flower/{name}", shape, {"Petals": petals, "Cup": brass}.get(name, marble))
          for name, shape in flower().items()),
    ]:  # fmt: skip
        mesh(stage, f"/World/{name}", shape, look_)
    growth(folder, stage)
    return save(stage, folder / "magic.usda")


if __name__ == "__main__":
    print(model(HERE))
