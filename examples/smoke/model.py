"""Write `smoke.usda`: a projector in smoke that drifts, and the files that it names.

Run it with the project's Python from anywhere; it writes the stage, the gobo `slots.png` and the grids
`smoke.1.vdb` and `smoke.2.vdb` beside itself:

    .venv/bin/python examples/smoke/model.py

All of them are committed, so run it only to change the smoke or the geometry.

Metres, Y up. The projector hangs on the left, the camera looks along −Z.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from drift import Smoke
from pxr import Gf, Sdf, UsdGeom

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
    new_stage,
    render_settings,
    save,
    tube,
    write_image,
)
from vdb import write_vdb

HERE = Path(__file__).resolve().parent
LOW, HIGH = np.array([-4.2, -0.4, -1.5]), np.array([4.4, 4.2, 1.5])  # of the smoke
CELLS = (104, 56, 34)
TIMES = (0.75, 1.0)  # times of the grids; a renderer holds each until the next
LEVELS = 12  # levels of density from one power of two to the next; few, so that files are small
LAMP, TARGET = (-3.3, 3.0, -0.5), (2.6, 0.35, 0.35)


def slots() -> Array:
    """Return the gobo: slots of unequal widths, one above the other."""
    size = 256
    y, x = (np.mgrid[0:size, 0:size] + 0.5) * (2 / size) - 1
    slots = [(-0.80, 0.05), (-0.56, 0.09), (-0.27, 0.06), (0.0, 0.10), (0.24, 0.04), (0.50, 0.11), (0.80, 0.06)]
    light = sum(np.clip((half - np.abs(y - middle)) / 0.02 + 0.5, 0, 1) for middle, half in slots)
    return np.asarray(light * np.clip((0.96 - np.hypot(x, y)) / 0.03, 0, 1))[..., None]


def grids(folder: Path) -> list[str]:
    """Write the smoke at each time, and return the names of its files."""
    smoke, names = Smoke(5), []
    box = np.diag([*(HIGH - LOW), 1.0])
    box[:3, 3] = LOW
    for number, time in enumerate(TIMES, 1):
        mantissa, exponent = np.frexp(smoke.density(LOW, HIGH, CELLS, time))
        density = np.where(exponent < -7, 0, np.ldexp(np.round(2 * LEVELS * mantissa) / (2 * LEVELS), exponent))
        names.append(f"smoke.{number}.vdb")
        write_vdb(folder / names[-1], {"density": density.transpose(2, 1, 0)}, box)
    return names


def model(folder: Path) -> Path:
    """Write the stage and its files into `folder`."""
    write_image(folder / "slots.png", slots())
    stage = new_stage("A projector in drifting smoke. Smoke by drift.py; see docs/examples.md.", (1, 1))
    volume = define(stage, "/World/Smoke", "Volume", "Per metre, where the density is 1.", "PhotonBeamsMediumAPI")
    author(volume, {"photonbeams:scattering": Gf.Vec3f(0.6, 0.6, 0.6), "photonbeams:anisotropy": 0.35,
                    "photonbeams:absorption": Gf.Vec3f(0.02, 0.03, 0.05)})  # fmt: skip
    field = define(stage, "/World/Smoke/Density", "OpenVDBAsset")
    volume.CreateRelationship("field:density").SetTargets([field.GetPath()])
    field.GetAttribute("fieldName").Set("density")
    for time, name in zip(TIMES, grids(folder), strict=True):
        field.GetAttribute("filePath").Set(Sdf.AssetPath(f"./{name}"), time)
    lamp = define(stage, "/World/Projector", "SphereLight", "The projector.", "PhotonBeamsLightAPI")
    lamp.AddAppliedSchema("ShapingAPI")
    author(lamp, {
        "inputs:radius": 0.015, "inputs:intensity": 1000000.0, "inputs:color": Gf.Vec3f(1.0, 0.7, 0.38),
        "inputs:shaping:cone:angle": 13.0, "inputs:shaping:cone:softness": 0.05,
        "photonbeams:gobo": Sdf.AssetPath("./slots.png"), "photonbeams:lightGroup": "projector",
        "photonbeams:count": 3500, "photonbeams:look": Sdf.Path("/World/Looks/Sharp"),
    })  # fmt: skip
    UsdGeom.Xformable(lamp).AddTransformOp().Set(aimed(LAMP, TARGET))
    rim = define(
        stage, "/World/Rim", "SphereLight", "Cool light from behind: it draws the wisps.", "PhotonBeamsLightAPI"
    )
    rim.AddAppliedSchema("ShapingAPI")
    author(rim, {
        "inputs:radius": 0.25, "inputs:intensity": 330.0, "inputs:color": Gf.Vec3f(0.3, 0.55, 1.0),
        "inputs:shaping:cone:angle": 55.0, "inputs:shaping:cone:softness": 0.5,
        "photonbeams:lightGroup": "rim", "photonbeams:count": 900,
    })  # fmt: skip
    UsdGeom.Xformable(rim).AddTransformOp().Set(aimed((3.2, 6.2, -4.4), (0.2, 1.3, 0.2)))
    author(define(stage, "/World/Looks/Sharp", "PhotonBeamsLook", "Hard beams: slots stay slots."),
           {"photonbeams:across:profile": "smoothstep", "photonbeams:across:hardness": 0.5})  # fmt: skip
    dark = material(stage, "Floor", (0.045, 0.045, 0.05), 0.35)
    metal = material(stage, "Metal", (0.03, 0.03, 0.035), 0.4)
    mesh(stage, "/World/Floor", block((-12, -0.1, -9), (12, 0, 8)), dark)
    mesh(stage, "/World/Pipe", tube([(-9, 3.32, -0.55), (9, 3.32, -0.55)], 0.03, 12), metal, smooth=True)
    eye = camera(stage, "/World/Camera", 30)
    UsdGeom.Xformable(eye).AddTransformOp().Set(aimed((0.7, 1.0, 6.4), (0.05, 1.5, 0)))
    render_settings(stage, "/World/Camera")
    return save(stage, folder / "smoke.usda")


if __name__ == "__main__":
    print(model(HERE))
