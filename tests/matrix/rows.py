"""The matrix of features: each row is a stage, and the same scene for Mitsuba.

All rows show a box of fog, [-1, 1]³, in the dark, from outside; the lamp above it is not in the picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from photonbeams.runtime.device import mitsuba
from tests.helpers.usda import material, prim, quad

mi = mitsuba()
T = mi.ScalarTransform4f

WIDTH, HEIGHT = 32, 20
MANY = 8  # bounces: in fogs as thin as these, the light of later bounces is less than the noise

#: The fractions by which means, and means of blocks of pixels, may differ in addition to their noise.
BIAS, BLOCK_BIAS = 0.005, 0.015

#: Colour of the lamp, and of the walls of the room.
WARM = (1.0, 0.8, 0.5)

Parts = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """A feature.

    Attributes
    ----------
    name, stage
        The name of the feature, and the text of its stage.
    twin
        The same scene by hand, for `mi.load_dict`; None: the scene that `photonbeams export` makes of the stage.
    bounces
        How often light is scattered before it is scattered toward the camera.
    beams, plugin
        Number of beams in each pass of the stage, and the parameters of `photon_beams`.
    files
        Functions that write the files of the stage, by the names of the files.
    samples
        Number of samples of `volpath` for each pixel and seed.
    settings
        Settings of the stage's radii: the light of beams that lies outside of the fog is lost, more of wide beams.
    passes
        Number of passes, of the stage and of the Mitsuba scene. With an odd number, the mean of the places that are
        sampled in a pixel is its centre. A few passes with many beams take less time than many passes with few beams;
        the edges of a shaft need more than three places.
    """

    name: str
    stage: str
    twin: Callable[[], Parts] | None = None
    bounces: int = 0
    beams: int = 16384
    plugin: dict[str, float] = field(default_factory=lambda: {"paths": 8192, "radius": 0.02, "alpha": 1.0})
    files: dict[str, Callable[[Path], None]] = field(default_factory=dict)
    samples: int = 2048
    settings: dict[str, float] = field(default_factory=lambda: {"overlap": 0.2})
    passes: int = 3

    @property
    def max_depth(self) -> int:
        """The most edges of a path, as Mitsuba counts them."""
        return self.bounces + 2

    @property
    def fingerprint(self) -> str:
        """A hash that identifies the scene of a reference."""
        return sha256(f"{self.stage}{self.bounces}{WIDTH}x{HEIGHT}".encode()).hexdigest()[:12]


# -- stages ------------------------------------------------------------------------------------------------------------


def stage(*parts: str) -> str:
    return '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n' + CAMERA + "".join(parts)


CAMERA = prim(
    "Camera", "Camera", (0, 0.1, 4), "float focalLength = 24", "float horizontalAperture = 20",
    "float verticalAperture = 12.5",
)  # fmt: skip


def lamp(at: object = (-0.5, 1.8, 0.3), intensity: float = 200, radius: float = 0.1) -> str:
    color = f"color3f inputs:color = {WARM}"
    return prim(
        "SphereLight", "Lamp", at, f"float inputs:intensity = {intensity}", color, f"float inputs:radius = {radius}"
    )


def fog(
    name: str, at: object, size: float, scattering: object, absorption: object, g: float = 0.0, turn: float = 0.0
) -> str:
    """Return a cube of fog, turned around Y."""
    return prim(
        "Cube", name, at, f"double size = {size}", f"color3f photonbeams:scattering = {scattering}",
        f"color3f photonbeams:absorption = {absorption}", f"float photonbeams:anisotropy = {g}", turned=(0, turn, 0),
        api="PhotonBeamsMediumAPI",
    )  # fmt: skip


def box(scattering: float | tuple[float, ...], absorption: float | tuple[float, ...], g: float = 0.0) -> str:
    """Return the box of fog."""
    return fog("Fog", (0, 0, 0), 2, _three(scattering), _three(absorption), g)


def _three(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,) * 3


# -- by hand -----------------------------------------------------------------------------------------------------------


def rgb(value: Any) -> Parts:
    return {"type": "rgb", "value": list(np.broadcast_to(value, 3).astype(float))}


def seen() -> Parts:
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    return {
        "type": "perspective", "fov": float(np.degrees(2 * np.arctan(20 / 2 / 24))), "fov_axis": "x", "near_clip": 1e-3,
        "to_world": T().look_at([0, 0.1, 4], [0, 0.1, 0], [0, 1, 0]), "film": film,
    }  # fmt: skip


def emitter(at: Any = (-0.5, 1.8, 0.3), intensity: float = 200, radius: float = 0.1) -> Parts:
    light = {"type": "area", "radiance": rgb(intensity * np.array(WARM))}
    black = {"type": "diffuse", "reflectance": rgb(0.0)}
    return {"type": "sphere", "center": list(at), "radius": radius, "emitter": light, "bsdf": black}


def medium(scattering: Any, absorption: Any, g: float = 0.0) -> Parts:
    scattering, absorption = (np.broadcast_to(each, 3).astype(float) for each in (scattering, absorption))
    extinction = scattering + absorption
    phase = {"type": "hg", "g": g} if g else {"type": "isotropic"}
    return {
        "type": "homogeneous", "sigma_t": rgb(extinction / extinction.max()), "scale": float(extinction.max()),
        "albedo": rgb(scattering / extinction), "phase": phase,
    }  # fmt: skip


def filled(inside: Any, to_world: Any = None, **more: Any) -> Parts:
    return {"type": "cube", "to_world": to_world or T(), "bsdf": {"type": "null"}, "interior": inside, **more}


def with_box(scattering: Any, absorption: Any, g: float = 0.0, light: Parts | None = None, **more: Any) -> Parts:
    """Return the box of fog, its lamp and the camera, and more."""
    parts = {"sensor": seen(), "lamp": light or emitter(), "fog": filled(medium(scattering, absorption, g))}
    return {"type": "scene", **parts, **more}


def nested() -> Parts:
    outer, inner = mi.load_dict(medium(0.4, 0.1)), mi.load_dict(medium(*DENSE, g=0.3))
    place = T().translate([0.25, -0.1, 0.1]).rotate([0, 1, 0], 30).scale(0.4)
    parts = {"fog": filled(outer), "core": filled(inner, place, exterior=outer)}
    return {"type": "scene", "sensor": seen(), "lamp": emitter(), **parts}


def density() -> np.ndarray:
    """Return noise on 8³ points that vanishes at the boundary, by z, y and x."""
    axes = np.linspace(-1, 1, 8)
    place = np.stack(np.meshgrid(axes, axes, axes, indexing="ij"))
    noise: np.ndarray = 0.5 + np.random.default_rng(3).random((8, 8, 8))
    return (noise * np.prod(1 - place**2, axis=0)).astype(np.float32)


def write_density(path: Path) -> None:
    mi.VolumeGrid(density()[..., None]).write(str(path))


def smoke() -> Parts:
    volume = {"type": "gridvolume", "grid": mi.VolumeGrid(density()[..., None]), "raw": True}
    volume["to_world"] = T().translate(-1).scale(2)
    cloud = {"type": "heterogeneous", "sigma_t": volume, "albedo": 0.9, "scale": 2.0, "phase": {"type": "hg", "g": 0.4}}
    return {"type": "scene", "sensor": seen(), "lamp": emitter(), "fog": filled(cloud)}


def silver(points: Any) -> Parts:
    """Return a mirror: a rectangle with these corners, counter-clockwise."""
    a, b, _, d = np.array(points, dtype=float)
    x, y = (b - a) / 2, (d - a) / 2
    place = np.eye(4)
    place[:3] = np.column_stack([x, y, np.cross(x, y) / np.linalg.norm(np.cross(x, y)), a + x + y])
    bsdf = {"type": "twosided", "side": {"type": "conductor", "material": "none"}}
    return {"type": "rectangle", "to_world": T(place), "bsdf": bsdf}


# -- rows --------------------------------------------------------------------------------------------------------------

DENSE = ((2.0, 1.2, 0.6), (0.2, 0.2, 0.2))
COLORED = ((0.2, 0.4, 0.6), (0.1, 0.05, 0.02))

# A shutter of four black boards with a hole in it, between the lamp and the fog.
Y, HOLE = 1.2, (-0.15, 0.15)
BOARDS = {
    "Left": ((-3, -3), (HOLE[0], 3)), "Right": ((HOLE[1], -3), (3, 3)), "Back": ((HOLE[0], -3), (HOLE[1], HOLE[0])),
    "Front": ((HOLE[0], HOLE[1]), (HOLE[1], 3)),
}  # fmt: skip


def flat(low: tuple[float, float], high: tuple[float, float], y: float = Y) -> list[tuple[float, float, float]]:
    """Return the corners of a rectangle at a height, seen from above."""
    return [(low[0], y, high[1]), (high[0], y, high[1]), (high[0], y, low[1]), (low[0], y, low[1])]


MATT = ("float inputs:roughness = 1", "float inputs:ior = 1")
BLACK = material("Black", "color3f inputs:diffuseColor = (0, 0, 0)", *MATT)
SHUTTER = BLACK + "".join(quad(name, flat(*corners), "Black") for name, corners in BOARDS.items())
HIGH = (-0.2, 2.2, 0.1)
OPEN = lamp(HIGH, 800)
PORTAL = quad("Portal", flat((HOLE[0],) * 2, (HOLE[1],) * 2), "Black")
THROUGH = OPEN.replace('"Lamp" ', '"Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])').replace(
    "    float inputs:radius", "    rel photonbeams:portal = </Portal>\n    float inputs:radius"
)

WALLS = {
    "Floor": ([(-1.4, -1.1, 1.4), (1.4, -1.1, 1.4), (1.4, -1.1, -1.4), (-1.4, -1.1, -1.4)], (0.7, 0.7, 0.7)),
    "Wall": ([(-1.4, -1.1, -1.4), (1.4, -1.1, -1.4), (1.4, 2, -1.4), (-1.4, 2, -1.4)], (0.7, 0.7, 0.7)),
    "Left": ([(-1.4, -1.1, 1.4), (-1.4, -1.1, -1.4), (-1.4, 2, -1.4), (-1.4, 2, 1.4)], (0.8, 0.2, 0.1)),
    "Right": ([(1.4, -1.1, -1.4), (1.4, -1.1, 1.4), (1.4, 2, 1.4), (1.4, 2, -1.4)], (0.1, 0.6, 0.2)),
}
ROOM = "".join(
    material(f"{name}Paint", f"color3f inputs:diffuseColor = {color}", *MATT) + quad(name, points, f"{name}Paint")
    for name, (points, color) in WALLS.items()
)

FLOOR = [(-1.6, -1.05, 1.6), (1.6, -1.05, 1.6), (1.6, -1.05, -1.6), (-1.6, -1.05, -1.6)]
MIRROR = material(
    "Silver", "color3f inputs:diffuseColor = (1, 1, 1)", "float inputs:metallic = 1", "float inputs:roughness = 0"
) + quad("Mirror", FLOOR, "Silver")

GLASS = material("Glass", "float inputs:opacity = 0", "float inputs:ior = 1.5", "float inputs:roughness = 0")
FAR = {"at": (-0.35, 3.6, 0.2), "intensity": 300, "radius": 0.3}
BALL = GLASS + prim(
    "Sphere", "Ball", (-0.2, 1.7, 0.1), "double radius = 0.38", "rel material:binding = </Glass>",
    api="MaterialBindingAPI",
)  # fmt: skip
CLEAR = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
SHAPE = {"type": "sphere", "center": [-0.2, 1.7, 0.1], "radius": 0.38, "bsdf": CLEAR}

FEW = 24576  # beams in each pass, if each of them makes others
# Radii from photon differentials, narrow compared to the hole.
FINE = {"paths": 65536, "overlap": 0.2}
# For light that is scattered often and comes from many places: fewer and wider beams have less noise.
WIDE = {"paths": FEW, "overlap": 1.0}
EVEN = {"radius": 0.04, "alpha": 1.0}

SMOKE = prim(
    "Volume", "Smoke", (0, 0, 0), "rel field:density = </Smoke/density>",
    "color3f photonbeams:scattering = (1.8, 1.8, 1.8)", "color3f photonbeams:absorption = (0.2, 0.2, 0.2)",
    "float photonbeams:anisotropy = 0.4", api="PhotonBeamsMediumAPI",
)[:-2] + """
    def OpenVDBAsset "density"
    {
        asset filePath = @./smoke.vol@
        token fieldName = "density"
        double3 xformOp:translate = (-1, -1, -1)
        double3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
}
"""  # fmt: skip

#: The stage and the Mitsuba scene of each row are compared to `volpath`, and to each other.
MATRIX = (
    Row("single scattering, isotropic", stage(lamp(), box(0.4, 0.1))),
    Row("single scattering, Henyey-Greenstein 0.8", stage(lamp(), box(0.4, 0.1, 0.8)), passes=6),
    Row("single scattering, coloured", stage(lamp(), box(*COLORED))),
    Row("a hole without a portal", stage(OPEN, SHUTTER, box(0.4, 0.1)), beams=65536, plugin=FINE, samples=4096,
        passes=9),
    Row("a hole with a portal", stage(THROUGH, SHUTTER, PORTAL, box(0.4, 0.1)), plugin=FINE, samples=4096,
        passes=5),
    Row("multiple scattering, isotropic", stage(lamp(), box(1.2, 0.1)), partial(with_box, 1.2, 0.1), MANY, FEW),
    Row("multiple scattering, coloured", stage(lamp(), box((0.4, 0.8, 1.2), (0.2, 0.1, 0.05))),
        partial(with_box, (0.4, 0.8, 1.2), (0.2, 0.1, 0.05)), MANY, FEW),
    Row("nested media", stage(lamp(), box(0.4, 0.1), fog("Core", (0.25, -0.1, 0.1), 0.8, *DENSE, 0.3, 30)),
        nested, MANY, FEW),
    Row("a mirror", stage(lamp(), MIRROR, box(0.4, 0.1)),
        lambda: with_box(0.4, 0.1, mirror=silver(FLOOR)), MANY, FEW, samples=8192),
    Row("a grid", stage(lamp(), SMOKE), smoke, MANY, FEW, WIDE, {"smoke.vol": write_density},
        settings={"overlap": 1.0}),
    # Few of the beams toward the camera are bright: more beams help, as long as they do not get narrower.
    Row("multiple scattering, Henyey-Greenstein 0.8", stage(lamp(), box(0.6, 0.05, 0.8)),
        partial(with_box, 0.6, 0.05, 0.8), MANY, 32768, {"paths": 49152, **EVEN}, samples=4096, settings=EVEN),
    Row("a glass ball with its caustic", stage(lamp(**FAR), BALL, box(0.4, 0.1)),
        lambda: with_box(0.4, 0.1, light=emitter(**FAR), ball=SHAPE), MANY, FEW, {"paths": FEW, "overlap": 0.2},
        samples=16384),
    Row("a diffuse room", stage(lamp(), ROOM, box(0.2, 0.05)), None, MANY, FEW, WIDE, settings={"overlap": 1.0}),
)  # fmt: skip
