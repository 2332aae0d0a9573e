"""Scenes that are written here, as dictionaries for `mi.load_dict`, beside those of examples/."""

from __future__ import annotations

from typing import Any

import mitsuba as mi

Plugin = dict[str, Any]

WHITE = (0.725, 0.71, 0.68)
GREEN = (0.14, 0.45, 0.091)
RED = (0.63, 0.065, 0.05)


def caustic(width: int, height: int) -> Plugin:
    """Return a box of thin gas in which a ball of glass gathers a tiny lamp's light.

    The measures are those of the scene "volumetric caustic" in the rendering resources of B. Bitterli (2016, CC0). Half
    of the lamp's side is 2 mm where the room's is 1 m: the light is that of a point, which no camera path meets.
    """
    gas = {"type": "homogeneous", "albedo": rgb((1, 1, 1)), "sigma_t": 1.0}
    ball = {
        "type": "sphere", "center": [-0.22827, 1.2, 0.152505], "radius": 0.3, "exterior": reference("gas"),
        "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
    }  # fmt: skip
    place = mi.ScalarTransform4f().translate([-0.005, 1.98, -0.03]).rotate([1, 0, 0], 90).scale([0.0025, 0.002, 1])
    lamp = {
        "type": "rectangle", "to_world": place, "bsdf": {"type": "diffuse", "reflectance": rgb((0, 0, 0))},
        "exterior": reference("gas"),
        "emitter": {"type": "area", "radiance": rgb((541127.0, 381972.0, 127324.0))},
    }  # fmt: skip
    inside = mi.ScalarTransform4f().translate([0, 1, -0.005]).scale([1.01, 1.01, 1.005])
    volume = {"type": "cube", "to_world": inside, "bsdf": {"type": "null"}, "interior": reference("gas")}
    eye = mi.ScalarTransform4f().look_at([0, 1, 7], [0, 1, 0], [0, 1, 0])
    return {
        "type": "scene", "gas": gas, "camera": _camera(eye, 19.5, width, height), **_walls(), "ball": ball,
        "lamp": lamp, "volume": volume,
    }  # fmt: skip


def ball_under_a_sky(width: int, height: int) -> Plugin:
    """Return a ball of coloured fog under an even sky, whose light no beams carry."""
    fog = {"type": "homogeneous", "sigma_t": rgb((0.33, 0.66, 1.0)), "scale": 3.0, "albedo": 0.9}
    ball = {"type": "sphere", "radius": 1.0, "bsdf": {"type": "null"}, "interior": fog}
    eye = mi.ScalarTransform4f().look_at([0, 0.5, 4], [0, 0, 0], [0, 1, 0])
    sky = {"type": "constant", "radiance": rgb((1, 1, 1))}
    return {"type": "scene", "ball": ball, "sky": sky, "camera": _camera(eye, 40.0, width, height)}


def bare_box(width: int, height: int) -> Plugin:
    """Return a box without fog, with a lamp below its ceiling and a mirror ball: surfaces alone."""
    place = mi.ScalarTransform4f().translate([0, 1.98, 0]).rotate([1, 0, 0], 90).scale([0.25, 0.2, 1])
    lamp = {"type": "rectangle", "to_world": place, "emitter": {"type": "area", "radiance": rgb((17, 12, 4))}}
    ball = {"type": "sphere", "center": [0.35, 0.4, 0.2], "radius": 0.4, "bsdf": {"type": "conductor"}}
    block = {
        "type": "cube", "bsdf": _matte(WHITE),
        "to_world": mi.ScalarTransform4f().translate([-0.4, 0.6, -0.3]).rotate([0, 1, 0], 20).scale([0.28, 0.6, 0.28]),
    }  # fmt: skip
    eye = mi.ScalarTransform4f().look_at([0, 1, 6.5], [0, 1, 0], [0, 1, 0])
    return {
        "type": "scene", **_walls(), "lamp": lamp, "ball": ball, "block": block,
        "camera": _camera(eye, 22.0, width, height),
    }  # fmt: skip


def _walls() -> Plugin:
    """Return floor, ceiling, back, left and right wall of a box: x from −1 to 1, y from 0 to 2, z from −1 to 1."""
    middle = mi.ScalarTransform4f().translate([0, 1, 0])
    turned = {
        "floor": (middle.rotate([1, 0, 0], -90), WHITE),
        "ceiling": (middle.rotate([1, 0, 0], 90), WHITE),
        "back": (middle, WHITE),
        "left": (middle.rotate([0, 1, 0], 90), RED),
        "right": (middle.rotate([0, 1, 0], -90), GREEN),
    }
    return {
        name: {"type": "rectangle", "to_world": turn.translate([0, 0, -1]), "bsdf": _matte(color)}
        for name, (turn, color) in turned.items()
    }


def _camera(to_world: Any, degrees: float, width: int, height: int) -> Plugin:
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    return {"type": "perspective", "fov": degrees, "near_clip": 0.001, "to_world": to_world, "film": film}


def _matte(color: tuple[float, float, float]) -> Plugin:
    return {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(color)}}


def reference(name: str) -> Plugin:
    """Return what stands for the plug-in of a name."""
    return {"type": "ref", "id": name}


def rgb(color: Any) -> Plugin:
    """Return a color of three numbers."""
    return {"type": "rgb", "value": [float(channel) for channel in color]}
