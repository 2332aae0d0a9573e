"""Rooms made by chance, as dictionaries for `mi.load_dict`: balls and boxes among walls, lamps, fog, glass and smoke.

A number names a room: the same number gives the same room. Lengths are in metres, y is up, and the floor is at y = 0.
The room is 4 m wide, 2.6 m high and 4 m deep, and the camera looks along −z from before its open end.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from .made_scenes import Plugin, reference, rgb

# Half of the room's width and depth, and its height, in metres.
HALF = 2.0
HEIGHT = 2.6
# Objects stand in the middle of cells, so that none overlap: their x and z in metres.
CELLS = tuple((x, z) for z in (-1.2, 0.1) for x in (-1.2, 0.0, 1.2))
# The largest half side of an object, in metres, less than half of the distance of two cells.
LARGEST = 0.45
# Chances that a room has fog, that fog is coloured, and that a room has smoke.
FOG = 0.6
COLORED = 0.4
SMOKE = 0.35
# The optical depth of a metre of fog: thin haze to dense fog.
EXTINCTION = (0.05, 0.5)
# Voxels along an edge of a cloud of smoke.
VOXELS = 12
# A lamp's power is divided by the number of lamps; this is the radiant intensity of a single point lamp in W/sr.
INTENSITY = 6.0


def room(number: int, width: int, height: int) -> Plugin:
    """Return the room of a number, whose film has this many pixels."""
    rng = np.random.default_rng(number)
    fog = _fog(rng) if rng.random() < FOG else None
    outside: Plugin = {} if fog is None else {"exterior": reference("fog")}
    parts: Plugin = {"type": "scene"} | ({} if fog is None else {"fog": fog})
    parts |= {"shell": _shell(rng, fog is not None), "camera": _camera(rng, fog is not None, width, height)}
    parts |= {f"panel {side:+d}": _panel(rng, side) for side in (-1, 1)}
    cells = [CELLS[index] for index in rng.permutation(len(CELLS))]
    parts |= {f"object {index}": _object(rng, cells.pop()) | outside for index in range(rng.integers(2, 5))}
    if rng.random() < SMOKE:
        parts["smoke"] = _smoke(rng, cells.pop()) | outside
    count = int(rng.integers(1, 5))
    return parts | {f"lamp {index}": _lamp(rng, count, fog is not None) for index in range(count)}


def _color(rng: np.random.Generator, least: float, most: float) -> Plugin:
    """Return a colour whose channels are between two values."""
    return rgb(rng.uniform(least, most, 3))


def _matte(rng: np.random.Generator) -> Plugin:
    """Return a surface that scatters light to both of its sides."""
    return {"type": "twosided", "side": {"type": "diffuse", "reflectance": _color(rng, 0.1, 0.8)}}


# -- the room itself -------------------------------------------------------------------------------------------------


def _fog(rng: np.random.Generator) -> Plugin:
    """Return a fog, which may be coloured and may throw light forward."""
    extinction = float(np.exp(rng.uniform(*np.log(EXTINCTION))))
    tint = rng.uniform(0.4, 1.0, 3) if rng.random() < COLORED else np.ones(3)
    phase = {"type": "hg", "g": float(rng.uniform(-0.2, 0.7))}
    return {
        "type": "homogeneous", "sigma_t": rgb(tint), "scale": extinction, "albedo": _color(rng, 0.7, 0.95),
        "phase": phase,
    }  # fmt: skip


def _shell(rng: np.random.Generator, foggy: bool) -> Plugin:
    """Return the floor, the ceiling and the walls; fog fills the room."""
    place = mi.ScalarTransform4f().translate([0, HEIGHT / 2, 0]).scale([HALF, HEIGHT / 2, HALF])
    inside = {"interior": reference("fog")} if foggy else {}
    return {"type": "cube", "to_world": place, "bsdf": _matte(rng), **inside}


def _panel(rng: np.random.Generator, side: int) -> Plugin:
    """Return a panel a hand's breadth before the left (−1) or the right wall, in a colour of its own."""
    place = mi.ScalarTransform4f().translate([side * (HALF - 0.1), 0.4 * HEIGHT, -0.5]).rotate([0, 1, 0], 90)
    return {"type": "rectangle", "to_world": place.scale([1.0, 0.3 * HEIGHT, 1.0]), "bsdf": _matte(rng)}


def _camera(rng: np.random.Generator, foggy: bool, width: int, height: int) -> Plugin:
    """Return a camera near the front wall."""
    eye = [float(rng.uniform(-0.5, 0.5)), float(rng.uniform(1.0, 1.7)), HALF - 0.05]
    film = {
        "type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"},
    }  # fmt: skip
    return {
        "type": "perspective", "fov": 70.0, "near_clip": 0.001, "film": film,
        "to_world": mi.ScalarTransform4f().look_at(eye, [0, 0.9, -0.6], [0, 1, 0]),
        **({"medium": reference("fog")} if foggy else {}),
    }  # fmt: skip


# -- what stands in it -----------------------------------------------------------------------------------------------


def _object(rng: np.random.Generator, cell: tuple[float, float]) -> Plugin:
    """Return a ball or a box in a cell: matte, of glass, a mirror, or of rough metal."""
    size = float(rng.uniform(0.2, LARGEST))
    if rng.random() < 0.5:
        up = size + float(rng.choice([0.0, 0.5]))  # lies on the floor, or floats
        shape: Plugin = {"type": "sphere", "center": [cell[0], up + 0.001, cell[1]], "radius": size}
    else:
        half, tall = size / 2**0.5, float(rng.uniform(0.15, 0.7))
        place = mi.ScalarTransform4f().translate([cell[0], tall + 0.001, cell[1]])
        turned = place.rotate([0, 1, 0], float(rng.uniform(0, 90)))
        shape = {"type": "cube", "to_world": turned.scale([half, tall, half])}
    return shape | {"bsdf": _surface(rng)}


def _surface(rng: np.random.Generator) -> Plugin:
    """Return the surface of a closed object."""
    kind = rng.choice(["matte", "glass", "mirror", "metal", "plastic"], p=[0.4, 0.2, 0.15, 0.15, 0.1])
    surfaces: dict[str, Plugin] = {
        "matte": _matte(rng),
        "glass": {"type": "dielectric", "int_ior": 1.5},
        "mirror": {"type": "twosided", "side": {"type": "conductor", "material": "Ag"}},
        "metal": {"type": "twosided", "side": {"type": "roughconductor", "material": "Au", "alpha": 0.2}},
        "plastic": {"type": "plastic", "diffuse_reflectance": _color(rng, 0.1, 0.7)},
    }
    return surfaces[str(kind)]


def _smoke(rng: np.random.Generator, cell: tuple[float, float]) -> Plugin:
    """Return a cube of smoke on a grid, whose density is noise that vanishes at the boundary."""
    axes = np.linspace(-1, 1, VOXELS)
    place = np.stack(np.meshgrid(axes, axes, axes, indexing="ij"))
    density = rng.random((VOXELS,) * 3) ** 2 * np.prod(1 - place**2, axis=0)
    to_world = mi.ScalarTransform4f().translate([cell[0], 0.75, cell[1]]).scale([LARGEST, 0.7, LARGEST])
    volume = {
        "type": "gridvolume", "grid": mi.VolumeGrid(density[..., None].astype(np.float32)), "raw": True,
        "to_world": to_world.translate(-1).scale(2),
    }  # fmt: skip
    inside = {"type": "heterogeneous", "sigma_t": volume, "albedo": 0.9, "scale": float(rng.uniform(5, 20))}
    return {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": inside}


# -- lamps -----------------------------------------------------------------------------------------------------------


def _lamp(rng: np.random.Generator, count: int, foggy: bool) -> Plugin:
    """Return one of `count` lamps."""
    kind = rng.choice(["point", "spot", "ceiling", "ball"])
    make = {"point": _point_lamp, "spot": _spot_lamp, "ceiling": _ceiling_lamp, "ball": _ball_lamp}[str(kind)]
    lamp = make(rng, INTENSITY / count)
    medium = "exterior" if "emitter" in lamp else "medium"
    return lamp | ({medium: reference("fog")} if foggy else {})


def _high(rng: np.random.Generator) -> list[float]:
    """Return a place above the objects."""
    return [float(rng.uniform(-1.5, 1.5)), float(rng.uniform(1.9, 2.3)), float(rng.uniform(-1.5, 1.0))]


def _light(rng: np.random.Generator, strength: float) -> Plugin:
    """Return a colour of light, warm or cold."""
    return rgb(strength * rng.uniform(0.6, 1.0, 3))


def _point_lamp(rng: np.random.Generator, intensity: float) -> Plugin:
    return {"type": "point", "position": _high(rng), "intensity": _light(rng, intensity)}


def _spot_lamp(rng: np.random.Generator, intensity: float) -> Plugin:
    target = [float(rng.uniform(-1, 1)), 0.0, float(rng.uniform(-1, 0.5))]
    angle = float(rng.uniform(12, 40))  # degrees
    return {
        "type": "spot", "to_world": mi.ScalarTransform4f().look_at(_high(rng), target, [0.1, 0, 1]),
        "intensity": _light(rng, 5 * intensity), "cutoff_angle": angle, "beam_width": 0.8 * angle,
    }  # fmt: skip


def _ceiling_lamp(rng: np.random.Generator, intensity: float) -> Plugin:
    half = rng.uniform(0.1, 0.5, 2)
    x, _, z = _high(rng)
    place = mi.ScalarTransform4f().translate([x, HEIGHT - 0.02, z]).rotate([1, 0, 0], 90)
    emitter = {"type": "area", "radiance": _light(rng, 3 * intensity / float(4 * half.prod()))}
    return {"type": "rectangle", "to_world": place.scale([*half.tolist(), 1.0]), "emitter": emitter}


def _ball_lamp(rng: np.random.Generator, intensity: float) -> Plugin:
    radius = float(rng.uniform(0.03, 0.12))
    emitter = {"type": "area", "radiance": _light(rng, intensity / (np.pi * radius**2))}
    return {"type": "sphere", "center": _high(rng), "radius": radius, "emitter": emitter}
