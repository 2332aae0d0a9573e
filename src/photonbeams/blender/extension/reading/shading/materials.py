"""Materials: what reaches the Surface of the output, as an OpenPBR shader, which the Principled BSDF resembles."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..images import Images
from ..meshes import varname
from ..nodes import Attribute, Texture, telling, value_of
from ..prims import Prim, Told, Values
from .bumps import Tilt, displacement_of, tilt_of, tilt_prims, with_bump
from .links import node_behind, output_of, source_at
from .mixing import PLAIN, TILT, Surface, between
from .textures import shader_prim, texture_prims

_SHADER = "ND_open_pbr_surface_surfaceshader"
# The inputs of the Principled BSDF by those of OpenPBR.
_PRINCIPLED = {
    "base_color": "Base Color", "base_metalness": "Metallic", "specular_roughness": "Roughness", "specular_ior": "IOR",
    "transmission_weight": "Transmission Weight", "coat_weight": "Coat Weight", "coat_roughness": "Coat Roughness",
    "emission_color": "Emission Color", "emission_luminance": "Emission Strength", "geometry_opacity": "Alpha",
}  # fmt: skip
# Inputs that are not rendered, and their values that make no difference.
_IGNORED = {
    "Subsurface Weight": 0.0, "Anisotropic": 0.0, "Sheen Weight": 0.0,
    "Thin Film Thickness": 0.0, "Coat Normal": None,
}  # fmt: skip
_GREY = (0.8, 0.8, 0.8)
_BLACK = (0.0, 0.0, 0.0)


def has_surface(material: Any) -> bool:
    """Return whether a material reflects, transmits or emits at its surface; one with only a volume does not."""
    if material is None or material.node_tree is None:
        return True
    output = output_of(material.node_tree, "OUTPUT_MATERIAL")
    if output is None or node_behind(output.inputs["Volume"]) is None:
        return output is not None
    node = node_behind(output.inputs["Surface"])
    return node is not None and not _is_clear(node)


def _is_clear(node: Any) -> bool:
    """Return whether light passes a shader node unchanged."""
    color = node.inputs["Color"] if node.type == "BSDF_TRANSPARENT" else None
    return color is not None and not color.is_linked and min(color.default_value[:3]) > 1 - 1e-6


def material_prims(material: Any, path: str, scale: float, images: Images, told: Told) -> list[Prim]:
    """Return the prims of a material: itself, its shader and its textures; `scale` is that of its displacement.

    None is the grey of objects without a material.
    """
    tell = told if material is None else telling(told, f"Material {material.name}")
    prims, values, sources = list[Prim](), Values({"info:id": _SHADER, "outputs:out": None}), dict[str, str]()
    for name, value in surface_of(material, scale, tell).items():
        place = f"{path}/{name}"
        if isinstance(value, Tilt | Texture):
            if isinstance(value, Tilt):
                own, sources[f"inputs:{name}"] = tilt_prims(value, place, images, tell)
            else:
                is_number = isinstance(PLAIN[name], float)
                own, sources[f"inputs:{name}"] = texture_prims(value, place, images, tell, is_number=is_number)
            prims += own
        elif isinstance(value, Attribute):
            prims.append(shader_prim(place, "UsdPrimvarReader_float3", "result", {"varname": varname(value.name)}))
            sources[f"inputs:{name}"] = f"{place}.outputs:result"
        else:
            values[f"inputs:{name}"] = value
    shader = Prim(f"{path}/Shader", "Shader", values, sources=sources)
    return [Prim(path, "Material", sources={"outputs:surface": f"{path}/Shader.outputs:out"}), shader, *prims]


def lets_through(prims: list[Prim]) -> bool:
    """Return whether light passes the surface of a material, by its prims."""
    plain = {"inputs:transmission_weight": 0.0, "inputs:geometry_opacity": 1.0}
    shader = prims[1]
    return any(name in shader.sources or shader.values.get(name, value) != value for name, value in plain.items())


def emitted_by(prims: list[Prim]) -> Any:
    """Return the mean radiance (3,) that the surface of a material emits, by its prims; images count as white."""
    values, strength = prims[1].values, "inputs:emission_luminance"
    factor = values.get(strength, float(strength in prims[1].sources))
    return factor * np.array(values.get("inputs:emission_color", [1.0] * 3))


def surface_of(material: Any, scale: float, told: Told) -> Surface:
    """Return the surface of a material; grey for none, or one without nodes."""
    if material is None:
        return {"base_color": _GREY, "specular_weight": 0.0}
    if material.node_tree is None:
        return {"base_color": tuple(material.diffuse_color[:3]), "specular_roughness": float(material.roughness)}
    source = source_at(material.node_tree, "OUTPUT_MATERIAL", "Surface")
    if source is None:
        return {"base_color": _BLACK, "specular_weight": 0.0}
    surface = _shaded(source.node, told)
    return _tilted(surface, with_bump(surface.get(TILT), displacement_of(material, scale, told), told))


def _tilted(surface: Surface, tilt: Tilt | None) -> Surface:
    """Return a surface whose normals are tilted."""
    return surface if tilt is None else {**surface, TILT: tilt}


def _shaded(node: Any, told: Told) -> Surface:
    """Return the surface that a shader node makes, and what tilts its normals."""
    return _tilted(_reflecting(node, told), tilt_of(node, told))


def _reflecting(node: Any, told: Told) -> Surface:
    """Return the surface that a shader node makes, with normals that are not tilted."""

    def value(name: str) -> Any:
        return value_of(node, name, told, bakes=True)

    match node.type:
        case "BSDF_PRINCIPLED":
            surface = {name: value(theirs) for name, theirs in _PRINCIPLED.items()}
            _tell_ignored(node, told)
            surface |= _specular(surface, value("Specular IOR Level"), value("Specular Tint"), told)
            surface["transmission_color"] = surface["base_color"]
            return {name: each for name, each in surface.items() if each is not None}
        case "EMISSION":
            glow = {"emission_color": value("Color"), "emission_luminance": value("Strength")}
            return {"base_color": _BLACK, "specular_weight": 0.0, **glow}
        case "BSDF_DIFFUSE":
            return {"base_color": value("Color"), "specular_weight": 0.0}
        case "BSDF_HAIR" | "BSDF_HAIR_PRINCIPLED":
            told(f"{node.name} is not rendered: hair is a surface of its colour")
            return {"base_color": value("Color"), "specular_roughness": 0.5}
        case "BSDF_GLOSSY" | "BSDF_ANISOTROPIC" | "BSDF_METALLIC":
            color = value("Color") if "Color" in node.inputs else value("Base Color")
            return {"base_color": color, "base_metalness": 1.0, "specular_roughness": value("Roughness")}
        case "BSDF_GLASS" | "BSDF_REFRACTION":
            glass = {"transmission_color": value("Color"), "specular_roughness": value("Roughness")}
            return {**glass, "transmission_weight": 1.0, "specular_ior": value("IOR")}
        case "BSDF_TRANSPARENT":
            return {"geometry_opacity": 0.0}
        case "MIX_SHADER":
            return _mixed(node, told)
        case "ADD_SHADER":
            return _added(_linked(node.inputs[0], told), _linked(node.inputs[1], told), told)
    told(f"{node.name} is not rendered: the surface is grey")
    return {"base_color": _GREY}


def _specular(principled: Surface, level: Any, tint: Any, told: Told) -> Surface:
    """Return the specular inputs of a Principled BSDF: the level scales the reflectance at normal incidence by 2."""
    surface: Surface = {} if tint in (None, (1.0,) * 3) else {"specular_color": tint}
    ior = principled["specular_ior"]
    if level in (None, 0.5):
        return surface
    if not (isinstance(level, float) and isinstance(ior, float)) or principled["transmission_weight"] != 0.0:
        told("Specular IOR Level is not rendered where it is an image, or where light passes through")
        return surface
    if level < 0.5:
        return {**surface, "specular_weight": 2 * level}
    root = min(2 * level * ((ior - 1) / (ior + 1)) ** 2, 0.99) ** 0.5
    return {**surface, "specular_ior": (1 + root) / (1 - root)}


def _tell_ignored(node: Any, told: Told) -> None:
    """Say which inputs of a Principled BSDF are not rendered though they would make a difference."""
    for name, plain in _IGNORED.items():
        socket = node.inputs.get(name)
        if socket is None:  # in another version of Blender
            continue
        if socket.is_linked or (plain is not None and abs(socket.default_value - plain) > 1e-6):
            told(f"{name} of {node.name} is not rendered")


def _linked(socket: Any, told: Told) -> Surface:
    """Return the surface that a socket is linked to; without a link it is black."""
    node = node_behind(socket)
    return {"base_color": _BLACK, "specular_weight": 0.0} if node is None else _shaded(node, told)


def _mixed(node: Any, told: Told) -> Surface:
    """Return what a Mix Shader makes: a surface that is cut out, or one between its two."""
    factor = value_of(node, node.inputs[0].name, told)
    if factor in (0.0, 1.0):
        return _linked(node.inputs[2 if factor else 1], told)
    first, second = (_linked(each, told) for each in node.inputs[1:3])
    if second.get("geometry_opacity") == 0.0 and isinstance(factor, float):
        return {**first, "geometry_opacity": 1 - factor}
    if first.get("geometry_opacity") == 0.0 and factor is not None:
        return {**second, "geometry_opacity": factor}
    if not isinstance(factor, float):
        told(f"{node.name} has an image as its factor, which is not rendered: it counts as a half")
        factor = 0.5
    return between(
        first, second, factor, partial(told, f"{node.name} mixes images, which is not rendered: one is used")
    )


def _added(first: Surface, second: Surface, told: Told) -> Surface:
    """Return what an Add Shader makes: a surface that also glows, or one that reflects what both do."""
    for surface, glow in ((first, second), (second, first)):
        if glow.get("base_color") == _BLACK and "emission_color" in glow:
            return {**surface, **{name: glow[name] for name in ("emission_color", "emission_luminance")}}
    tell = partial(told, "an Add Shader adds images, which is not rendered: one is used")
    return between(first, second, 0.5, tell, add=True)
