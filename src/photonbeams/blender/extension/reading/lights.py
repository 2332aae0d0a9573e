"""Lights and the world, as UsdLux: a light of W watts has the intensity W / π and `normalize`."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, pi
from typing import Any

import numpy as np
from mathutils import Euler

from .images import MISSING, Images, is_missing
from .nodes import color_of, number_of, product_of, source_of, telling
from .prims import Prim, Told, Values
from .shading.evaluation import varies
from .shading.links import node_behind, source_at
from .shading.profiles import constant_of, emission_node, emission_of, ies_node
from .shading.skies import SkyReader

#: From a Blender world to the pole and the middle of a DomeLight: +Y to +Z, and +Z to +X. Of row vectors.
_WORLD = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def light_prim(light: Any, path: str, told: Told) -> Prim:
    """Return the prim of a light, without its transform."""
    strength, tint = nodes_of(light, told)
    factor = strength * 2.0**light.exposure
    color = tint * np.array(light.color)
    if light.use_temperature:  # of which UsdLux has another colour
        color = color * np.array(light.temperature_color)
    values: Values = {"inputs:color": color.tolist()}
    if not light.use_shadow:
        values["inputs:shadow:enable"] = False
    normalized, apis = light.normalize, list[str]()
    intensity = light.energy if light.type == "SUN" else light.energy / pi
    match light.type:
        case "SUN":
            kind = "DistantLight"
            normalized |= light.angle == 0
            values["inputs:angle"] = degrees(light.angle)
        case "AREA":
            kind, own = _area(light)
            values |= own
        case _:
            kind, radius = "SphereLight", light.shadow_soft_size
            values |= {"inputs:radius": radius, "treatAsPoint": radius == 0}
            normalized |= radius == 0
            if light.type == "SPOT":
                apis.append("ShapingAPI")
                values["inputs:shaping:cone:angle"] = degrees(light.spot_size / 2)
                values["inputs:shaping:cone:softness"] = _softness(light)
    values["inputs:intensity"] = intensity * factor
    values["inputs:normalize"] = normalized
    return Prim(path, kind, values, apis=apis)


def _softness(light: Any) -> float:
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
    return float(np.interp(-wanted, -power, part))


def _area(light: Any) -> tuple[str, Values]:
    """Return the type and the size of an area light; `stretch_of` is that of discs."""
    wide, high = size_of(light)
    if light.shape in ("DISK", "ELLIPSE"):
        return "DiskLight", {"inputs:radius": 0.5}
    return "RectLight", {"inputs:width": wide, "inputs:height": high}


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
    tell = telling(told, light.name)
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
    if node_behind(made.inputs["Vector"]) is not None:
        told(f"{light.name}: the coordinates of {made.name} are not rendered: its image is a gobo that fills the light")
    return made.image


def _image_node(node: Any) -> Any:
    """Return the Image Texture that gives an Emission node's colour; None if there is none."""
    made = node_behind(node.inputs["Color"])
    return made if made is not None and made.type == "TEX_IMAGE" and made.image else None


def world_prims(world: Any, path: str, images: Images, told: Told) -> list[Prim]:
    """Return the prim of what the world's surface emits; none if it is black."""
    if world is None:
        return []
    if world.node_tree is None:
        return _dome(path, 1.0, np.array(world.color[:]))
    source = source_at(world.node_tree, "OUTPUT_WORLD", "Surface")
    if source is None:
        return []
    node, tell = source.node, telling(told, f"World {world.name}")
    color = node_behind(node.inputs["Color"]) if node.type in ("BACKGROUND", "EMISSION") else None
    if color is not None and color.type == "TEX_ENVIRONMENT" and color.image is not None:
        strength = number_of(node, "Strength", tell, 1.0)
        if is_missing(color.image):
            tell(f"the file of {color.image.name} is missing: it is magenta, as in Blender")
            return _dome(path, strength, np.array(MISSING))
        return _dome(path, strength, np.ones(3), images.file_of(color.image), _turned(color, tell))
    sky = SkyReader(tell)
    radiance = sky.radiance(source)
    suns = [replace(sun, path=f"{path}_Sun{k}") for k, sun in enumerate(sky.suns)]
    if varies(radiance.reshape(-1, 3)):
        return _dome(path, 1.0, np.ones(3), images.written(radiance, "sky")) + suns
    return _dome(path, 1.0, radiance[0, 0]) + suns


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


def _dome(path: str, strength: float, color: Any, file: str = "", turn: Any = None) -> list[Prim]:
    if strength <= 0 or not np.any(color > 0):
        return []
    values: Values = {"inputs:intensity": strength, "inputs:color": color.tolist()}
    if file:
        values["inputs:texture:file"] = file
    matrix = _WORLD if turn is None else _WORLD @ turn
    return [Prim(path, "DomeLight", values, matrix=matrix)]
