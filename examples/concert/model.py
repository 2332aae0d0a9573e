"""Write `concert.usda`: ten moving heads over an empty stage in haze, before the band comes on.

Run it with the project's Python from anywhere; it writes the stage and its gobos beside itself:

    .venv/bin/python examples/concert/model.py

The stage is committed, so run it only to change the geometry or the moves. Lights, haze, looks and camera can be
changed in the stage's text just as easily.

The stage: metres, Y up, its front edge at z = 3; the audience and the camera are at +Z.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import gear
import gobos
import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from staging import (
    Array,
    aimed,
    author,
    block,
    camera,
    define,
    material,
    mesh,
    moved,
    new_stage,
    render_settings,
    save,
    write_image,
)

HERE = Path(__file__).resolve().parent
FRAMES = (1, 48)
TRUSSES = {"Front": (7.4, 1.6), "Back": (5.5, -3.6)}  # height and depth
CYAN, BLUE, VIOLET = (0.05, 0.75, 1.0), (0.08, 0.2, 1.0), (0.55, 0.1, 1.0)
PINK, RED, AMBER = (1.0, 0.08, 0.45), (1.0, 0.10, 0.05), (1.0, 0.42, 0.06)


@dataclass(frozen=True)
class Fixture:
    """A moving head: the place of its pivot, what it shines at over time, and how.

    Attributes
    ----------
    name, place, hangs
        Its name, the place of its pivot, and whether it hangs on a truss or stands on the floor.
    target, swing, phase
        The middle of the target, how far the target moves along each axis, and its phase (1 is a full cycle).
    colors
        The two colours between which it changes.
    power, cone
        Intensity of the light, and degrees from its axis to its edge.
    group, look, gobo, spin
        Light group, look, image, and turns of the image per second.
    """

    name: str
    place: tuple[float, float, float]
    hangs: bool
    target: tuple[float, float, float]
    swing: tuple[float, float, float]
    phase: float
    colors: tuple[tuple[float, float, float], tuple[float, float, float]]
    power: float
    cone: float
    group: str
    look: str
    gobo: str = ""
    spin: float = 0.0


def fixtures() -> list[Fixture]:
    """Return the rig: five heads on the back truss, four on the floor before the curtain, one on the front truss."""
    rig = []
    y, z = TRUSSES["Back"]
    for k, x in enumerate((-5.0, -2.5, 0.0, 2.5, 5.0)):
        gobo = ("bars", "breakup", "star", "breakup", "bars")[k]
        rig.append(
            Fixture(
                f"Back{k + 1}", (x, y - 0.53, z), True, (0.8 * x, 0.0, 3.4), (1.7, 0.0, 1.2), 0.31 + 0.13 * k,
                ((CYAN, BLUE, VIOLET, BLUE, CYAN)[k], (BLUE, VIOLET, CYAN, VIOLET, BLUE)[k]),
                5000.0, 8.5, "back", "Sharp", gobo, 0.12 * (-1) ** k,
            )
        )  # fmt: skip
    for k, x in enumerate((-5.6, -3.6, 3.6, 5.6)):
        rig.append(
            Fixture(
                f"Floor{k + 1}", (x, 0.38, -4.6), False, ((2.6, -7.5, 7.5, -2.6)[k], 8.0, -1.0), (1.5, 0.0, 0.8),
                0.81 + 0.17 * k,
                ((PINK, RED, RED, PINK)[k], (AMBER, PINK, PINK, AMBER)[k]), 8000.0, 5.0, "floor", "Hollow",
            )
        )  # fmt: skip
    y, z = TRUSSES["Front"]
    rig.append(
        Fixture(
            "Key", (-1.8, y - 0.53, z), True, (0.0, 0.9, 0.9), (0.03, 0.0, 0.03), 0.0,
            ((1.0, 0.86, 0.66), (1.0, 0.86, 0.66)), 3000.0, 6.0, "key", "Soft",
        )
    )  # fmt: skip
    return rig


def pan_and_tilt(fixture: Fixture, times: Array) -> tuple[Array, Array]:
    """Return degrees about Y and X that turn −Z to the target, in the space of a fixture that may hang upside down."""
    turn = 2 * np.pi * (times / 2 + fixture.phase)
    sway = np.stack([np.sin(turn), np.sin(turn), np.cos(turn)], axis=-1)
    aim = np.array(fixture.target) + sway * fixture.swing - fixture.place
    if fixture.hangs:
        aim = aim * [-1, -1, 1]  # half a turn about Z
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    pan = np.unwrap(np.arctan2(-aim[:, 0], -aim[:, 2]))
    return np.degrees(pan), np.degrees(np.arcsin(aim[:, 1]))


def hang(stage: Usd.Stage, fixture: Fixture) -> None:
    """Define a fixture: foot, yoke that pans, head that tilts, and in the head its light."""
    root = UsdGeom.Xform.Define(stage, f"/World/Rig/{fixture.name}")
    root.AddTranslateOp().Set(Gf.Vec3d(*fixture.place))
    if fixture.hangs:
        root.AddRotateZOp().Set(180.0)
    path = str(root.GetPath())
    stage.DefinePrim(f"{path}/Foot").GetReferences().AddInternalReference("/Gear/Foot")
    yoke = UsdGeom.Xform.Define(stage, f"{path}/Yoke")
    stage.DefinePrim(f"{path}/Yoke/Fork").GetReferences().AddInternalReference("/Gear/Fork")
    head = UsdGeom.Xform.Define(stage, f"{path}/Yoke/Head")
    stage.DefinePrim(f"{path}/Yoke/Head/Can").GetReferences().AddInternalReference("/Gear/Can")
    lamp = define(stage, f"{path}/Yoke/Head/Lamp", "SphereLight", api="PhotonBeamsLightAPI")
    lamp.AddAppliedSchema("ShapingAPI")
    values = {
        "inputs:intensity": fixture.power,
        "inputs:normalize": True,
        "inputs:radius": 0.01,
        "inputs:shaping:cone:angle": fixture.cone,
        "inputs:shaping:cone:softness": 0.08,
        "photonbeams:count": 1600,
        "photonbeams:lightGroup": fixture.group,
        "photonbeams:look": Sdf.Path(f"/World/Looks/{fixture.look}"),
    }
    if fixture.gobo:
        values["photonbeams:gobo"] = Sdf.AssetPath(f"./{fixture.gobo}.png")
    author(lamp, values)
    lamp.CreateAttribute("treatAsPoint", Sdf.ValueTypeNames.Bool, False).Set(True)
    frames = np.arange(FRAMES[0], FRAMES[1] + 1)
    times = (frames - FRAMES[0]) / 24
    pans, tilts = pan_and_tilt(fixture, times)
    turn, tip = yoke.AddRotateYOp(), head.AddRotateXOp()
    placed = UsdGeom.Xformable(lamp)
    placed.AddTranslateOp().Set(Gf.Vec3d(0, 0, -gear.LENS))
    spin = placed.AddRotateZOp() if fixture.spin else None
    mixed = 0.5 - 0.5 * np.cos(2 * np.pi * (times / 2 + fixture.phase))
    for frame, time, pan, tilt, share in zip(frames.tolist(), times, pans, tilts, mixed, strict=True):
        turn.Set(round(float(pan), 3), frame)
        tip.Set(round(float(tilt), 3), frame)
        if spin is not None:
            spin.Set(round(360 * fixture.spin * float(time), 3), frame)
        if fixture.colors[0] != fixture.colors[1]:
            color = np.round((1 - share) * np.array(fixture.colors[0]) + share * np.array(fixture.colors[1]), 4)
            lamp.GetAttribute("inputs:color").Set(Gf.Vec3f(*color.tolist()), frame)
        else:
            lamp.GetAttribute("inputs:color").Set(Gf.Vec3f(*fixture.colors[0]))


def set_pieces(stage: Usd.Stage, random: np.random.Generator) -> None:
    """Define floor, curtain, trusses, and the equipment on the stage."""
    black = material(stage, "Black", (0.018, 0.018, 0.02), 0.45)
    floor = material(stage, "Floor", (0.055, 0.052, 0.05), 0.35)
    cloth = material(stage, "Cloth", (0.035, 0.03, 0.038), 0.95)
    alloy = material(stage, "Alloy", (0.55, 0.56, 0.58), 0.35, metallic=1.0)
    chrome = material(stage, "Chrome", (0.75, 0.72, 0.65), 0.25, metallic=1.0)
    shell = material(stage, "Shell", (0.30, 0.02, 0.02), 0.3)
    gear_root = stage.CreateClassPrim("/Gear")
    gear_root.SetDocumentation("Parts of a moving head; the fixtures of the rig refer to them.")
    mesh(stage, "/Gear/Foot", moved(gear.base(), np.eye(3), (0, -gear.PIVOT, 0)), None)
    mesh(stage, "/Gear/Fork", gear.yoke(), None)
    mesh(stage, "/Gear/Can", gear.head(), None, smooth=True)
    UsdShade.MaterialBindingAPI.Apply(UsdGeom.Xform.Define(stage, "/World/Rig").GetPrim()).Bind(black)
    mesh(stage, "/World/Set/Floor", block((-15, -1.0, -5.6), (15, 0, 3)), floor)
    mesh(stage, "/World/Set/Pit", block((-15, -1.0, 3), (15, -0.9, 16)), black)
    curtain = moved(gear.curtain(30, 12.0, random), np.eye(3), (0, 0, -5.4))
    mesh(stage, "/World/Set/Curtain", curtain, cloth, smooth=True)
    mesh(stage, "/World/Set/Riser", block((-1.7, 0, -3.1), (1.7, 0.4, -1.0)), black)
    for name, shape in gear.drums().items():
        look = {"Shells": shell, "Metal": chrome}[name]
        mesh(stage, f"/World/Set/{name}", moved(shape, np.eye(3), (0, 0.4, -1.9)), look)
    mesh(stage, "/World/Set/Microphone", moved(gear.microphone(), np.eye(3), (0, 0, 0.7)), chrome, smooth=True)
    mesh(stage, "/World/Set/Loudspeakers", gear.loudspeakers(), black)
    for name, (y, z) in TRUSSES.items():
        truss(stage, f"/World/Set/Truss{name}", y, z, alloy)


def truss(stage: Usd.Stage, path: str, y: float, z: float, look: UsdShade.Material) -> None:
    """Define a truss of fourteen metres from segments."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    mesh(stage, f"{path}/Segment", gear.truss(), look)
    instancer.CreatePrototypesRel().SetTargets([f"{path}/Segment"])
    instancer.CreateProtoIndicesAttr([0] * 7)
    instancer.CreatePositionsAttr([Gf.Vec3f(gear.SEGMENT * k - 7, y, z) for k in range(7)])


def haze_and_looks(stage: Usd.Stage) -> None:
    """Define the haze and the looks of the beams in it."""
    haze = define(stage, "/World/Haze", "Scope", "Haze from a machine; per metre.", "PhotonBeamsMediumAPI")
    author(haze, {"photonbeams:scattering": Gf.Vec3f(0.03, 0.03, 0.03), "photonbeams:anisotropy": 0.4})
    noise = {
        "photonbeams:noise:amount": 0.8,
        "photonbeams:noise:scale": 1.8,
        "photonbeams:noise:octaves": 3,
        "photonbeams:noise:drift": Gf.Vec3f(0.35, 0.08, 0.1),
    }
    off_axis = "length([Pl.x, Pl.y, 0]) / (0.0875 * -Pl.z)"  # 1 at 5 degrees from the light's axis
    looks = {
        "Sharp": ("Gobos: hard beams, so that bars stay bars.", {"photonbeams:across:profile": "smoothstep",
                                                                "photonbeams:across:hardness": 0.6}),
        "Hollow": ("Bright at the cone's wall, dim within it.", {
            "photonbeams:across:expression": f"0.1 + 2 * smoothstep(0.6, 0.95, {off_axis})",
        }),
        "Soft": ("The key light, which fades before it reaches the floor.", {"photonbeams:along:inner": 1.0,
                                                                            "photonbeams:along:outer": 9.5}),
    }  # fmt: skip
    for name, (doc, values) in looks.items():
        author(define(stage, f"/World/Looks/{name}", "PhotonBeamsLook", doc), {**values, **noise})


def cameras(stage: Usd.Stage) -> None:
    """Define the camera, which drifts along the pit."""
    pit = camera(stage, "/World/Camera", 26)
    path = UsdGeom.Xformable(pit).AddTransformOp()
    for frame in range(FRAMES[0], FRAMES[1] + 1):
        t = (frame - FRAMES[0]) / (FRAMES[1] - FRAMES[0])
        path.Set(aimed((-2.0 + 1.2 * t, 1.05, 8.9), (0.1 * t - 0.1, 2.75, -2.0)), frame)


def model(folder: Path) -> Path:
    """Write the gobos and `concert.usda` into `folder`; the same version of this file writes the same stage."""
    random = np.random.default_rng(4)
    for name, pixels in (("star", gobos.star()), ("bars", gobos.bars()), ("breakup", gobos.breakup(random))):
        write_image(folder / f"{name}.png", pixels)
    stage = new_stage("Moving heads in haze. Geometry and moves by model.py; see docs/examples.md.", FRAMES)
    cameras(stage)
    set_pieces(stage, random)
    for fixture in fixtures():
        hang(stage, fixture)
    doc = "What is left of the house lights, on surfaces alone."
    fill = define(stage, "/World/HouseLights", "DomeLight", doc, "PhotonBeamsLightAPI")
    author(fill, {"inputs:color": Gf.Vec3f(0.4, 0.5, 1.0), "inputs:intensity": 0.25, "photonbeams:enabled": False})
    haze_and_looks(stage)
    render_settings(stage, "/World/Camera")
    return save(stage, folder / "concert.usda")


if __name__ == "__main__":
    print(model(HERE))
