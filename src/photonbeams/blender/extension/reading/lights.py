"""Lights and the world, as UsdLux: a light of W watts has the intensity W / π and `normalize`."""

from __future__ import annotations

from functools import partial
from math import degrees, pi
from typing import Any

import numpy as np
from mathutils import Euler

from .images import MISSING, Images, is_missing
from .nodes import Told, color_of, number_of, output_of, product_of, source_of
from .shading.profiles import constant_of, emission_node, emission_of, ies_node
from .shading.skies import SkyReader

#: From a Blender world to the pole and the middle of a DomeLight: +Y to +Z, and +Z to +X. Of row vectors.
_WORLD = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def light_prim(light: Any, path: str, told: Told) -> dict[str, Any]:
    """Return the prim of a light, without its transform."""
    strength, tint = nodes_of(light, told)
    factor = strength * 2.0**light.exposure
    values: dict[str, Any] = {"inputs:color": ["color3f", (tint_of(light) * tint).tolist()]}
    normalized, apis = light.normalize, list[str]()
    intensity = light.energy if light.type == "SUN" else light.energy / pi
    match light.type:
        case "SUN":
            kind = "DistantLight"
            normalized |= light.angle == 0
            values["inputs:angle"] = ["float", degrees(light.angle)]
        case "AREA":
            kind, own = _area(light)
            values |= own
        case _:
            kind, radius = "SphereLight", light.shadow_soft_size
            values |= {"inputs:radius": ["float", radius], "treatAsPoint": ["bool", radius == 0]}
            normalized |= radius == 0
            if light.type == "SPOT":
                apis.append("ShapingAPI")
                values["inputs:shaping:cone:angle"] = ["float", degrees(light.spot_size / 2)]
                values |= softness_values(light)
    values["inputs:intensity"] = ["float", intensity * factor]
    values["inputs:normalize"] = ["bool", normalized]
    return {"path": path, "type": kind, "apis": apis, "values": values | shadow_values(light)}


def tint_of(light: Any) -> Any:
    """Return the colour of a light, with that of its temperature, of which UsdLux has another one."""
    color = np.array(light.color[:])
    return color * np.array(light.temperature_color[:]) if light.use_temperature else color


def shadow_values(light: Any) -> dict[str, Any]:
    """Return what lets a lamp shine through everything, as its Shadow switch does."""
    return {} if light.use_shadow else {"inputs:shadow:enable": ["bool", False]}


def softness_values(light: Any) -> dict[str, Any]:
    """Return the softness of a spot's cone that leaves it the power that its blend does.

    Blender's light falls as smoothstep of the cosine, over the outer part `blend` of the solid angle, UsdLux's as
    1 − smoothstep of the angle, over its outer part `softness`. With equal power they differ by 5 % of the light in the
    middle, at most.
    """
    half, part = light.spot_size / 2, np.linspace(0, 1, 129)
    angle = half * (np.arange(512) + 0.5) / 512
    across = np.clip((angle / half - 1 + part[:, None]) / np.maximum(part[:, None], 1e-6), 0, 1)
    power = ((1 - across**2 * (3 - 2 * across)) * np.sin(angle)).sum(axis=1) * half / 512
    wanted = (1 - np.cos(half)) * (1 - light.spot_blend / 2)
    return {"inputs:shaping:cone:softness": ["float", float(np.interp(-wanted, -power, part))]}


def _area(light: Any) -> tuple[str, dict[str, Any]]:
    """Return the type and the size of an area light; `stretch_of` is that of discs."""
    wide, high = size_of(light)
    if light.shape in ("DISK", "ELLIPSE"):
        return "DiskLight", {"inputs:radius": ["float", 0.5]}
    return "RectLight", {"inputs:width": ["float", wide], "inputs:height": ["float", high]}


def stretch_of(light: Any) -> Any:
    """Return the scale (3,) of a light's own shape: a DiskLight is round, an area light may be an ellipse."""
    if light.type != "AREA" or light.shape not in ("DISK", "ELLIPSE"):
        return np.ones(3)
    return np.array([*size_of(light), 1.0])


def size_of(light: Any) -> tuple[float, float]:
    """Return the width and the height of an area light."""
    return light.size, light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size


def nodes_of(light: Any, told: Told) -> tuple[float, Any]:
    """Return the factor and the colour that a light's nodes give; an image is a gobo, an IES Texture a profile."""
    if not light.use_nodes or light.node_tree is None:
        return 1.0, np.ones(3)
    node = emission_of(light)
    if node is None:
        return 0.0, np.ones(3)
    tell = partial(_tell, told, light.name)
    if node.type != "EMISSION":
        tell("its nodes are not rendered, only its power and colour")
        return 1.0, np.ones(3)
    strength = _strength(light, node, tell)
    return strength, np.ones(3) if _image_node(node) is not None else np.array(color_of(node, "Color", tell))


def _strength(light: Any, node: Any, told: Told) -> float:
    """Return the strength of a light's Emission node, without its profile."""
    texture, factors = ies_node(node)
    if texture is None:
        source = source_of(node.inputs["Strength"])
        if source is not None and source.node.type == "LIGHT_FALLOFF":
            return _of_falloff(source, told)
        return number_of(node, "Strength", told, 1.0)
    found = constant_of(light, texture)
    for made, socket in factors:
        value, _ = product_of(made, socket, told)
        if isinstance(value, float):
            found *= value
        else:
            told(f"what is linked to {socket.name} of {made.name} is no number: it counts as 1")
    return found


def _of_falloff(source: Any, told: Told) -> float:
    """Return the strength of a Light Falloff at 1 m, where all of its outputs are equal."""
    node = source.node
    if source.name != "Quadratic" or number_of(node, "Smooth", told) > 0:
        what = "Smooth" if source.name == "Quadratic" else source.name
        told(f"{what} of {node.name} is not rendered: light falls by the square of the distance, from Strength at 1 m")
    return number_of(node, "Strength", told, 1.0)


def image_of(light: Any, told: Told) -> Any:
    """Return the image that a light's Emission node has as its colour, which is a gobo; None if there is none."""
    node = emission_node(light)
    made = None if node is None else _image_node(node)
    if made is None:
        return None
    if source_of(made.inputs["Vector"]) is not None:
        told(f"{light.name}: the coordinates of {made.name} are not rendered: its image is a gobo that fills the light")
    return made.image


def _image_node(node: Any) -> Any:
    """Return the Image Texture that gives an Emission node's colour; None if there is none."""
    source = source_of(node.inputs["Color"])
    return source.node if source is not None and source.node.type == "TEX_IMAGE" and source.node.image else None


def world_prims(world: Any, path: str, images: Images, told: Told) -> list[dict[str, Any]]:
    """Return the prim of what the world's surface emits; none if it is black."""
    if world is None:
        return []
    if world.node_tree is None:
        return _dome(path, 1.0, np.array(world.color[:]))
    output = output_of(world.node_tree, "OUTPUT_WORLD")
    source = None if output is None else source_of(output.inputs["Surface"])
    if source is None:
        return []
    node, tell = source.node, partial(_tell, told, f"World {world.name}")
    color = source_of(node.inputs["Color"]) if node.type in ("BACKGROUND", "EMISSION") else None
    if color is not None and color.node.type == "TEX_ENVIRONMENT" and color.node.image is not None:
        strength = number_of(node, "Strength", tell, 1.0)
        if is_missing(color.node.image):
            tell(f"the file of {color.node.image.name} is missing: it is magenta, as in Blender")
            return _dome(path, strength, np.array(MISSING))
        return _dome(path, strength, np.ones(3), images.file_of(color.node.image), _turned(color.node, tell))
    sky = SkyReader(tell)
    radiance = sky.radiance(source)
    suns = [{"path": f"{path}_Sun{k}", **prim} for k, prim in enumerate(sky.suns)]
    mean = radiance.mean(axis=(0, 1), dtype=np.float64)
    if np.ptp(radiance, axis=(0, 1)).max() <= 1e-5 * mean.max():
        return _dome(path, 1.0, mean) + suns
    return _dome(path, 1.0, np.ones(3), images.written(radiance, "sky")) + suns


def _tell(told: Told, whose: str, text: str) -> None:
    """Say what is not rendered of a lamp or a world."""
    told(f"{whose}: {text}")


def _turned(node: Any, told: Told) -> Any:
    """Return the rotation (4, 4) of an environment's Mapping node, of row vectors."""
    if node.projection != "EQUIRECTANGULAR":
        told(f"{node.name} is a mirror ball, which is not rendered: it is read as equirectangular")
    vector = source_of(node.inputs["Vector"])
    if vector is None or (vector.node.type == "TEX_COORD" and vector.name == "Generated"):
        return np.eye(4)
    if vector.node.type != "MAPPING" or vector.node.inputs["Rotation"].is_linked:
        told(f"the coordinates of {node.name} are not rendered: the sky is not turned")
        return np.eye(4)
    turn = np.array(Euler(vector.node.inputs["Rotation"].default_value).to_matrix().to_4x4())
    # Textures turn against their vectors: the inverse, transposed for row vectors.
    return turn.T if vector.node.vector_type == "TEXTURE" else turn


def _dome(path: str, strength: float, color: Any, file: str = "", turn: Any = None) -> list[dict[str, Any]]:
    if strength <= 0 or not np.any(color > 0):
        return []
    values = {"inputs:intensity": ["float", strength], "inputs:color": ["color3f", color.tolist()]}
    if file:
        values["inputs:texture:file"] = ["asset", file]
    matrix = _WORLD if turn is None else _WORLD @ turn
    return [{"path": path, "type": "DomeLight", "matrix": matrix, "values": values}]
