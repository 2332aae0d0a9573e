"""Read layered surfaces: Autodesk's standard surface, in Arnold and MaterialX, and OpenPBR."""

from __future__ import annotations

import numpy as np

from ...scene import Array
from ...scene.checks import shown
from .bumps import tilt
from .network import ShaderNode, Surface
from .values import Image, Value, constant, mix

# What OpenPBR calls the inputs of the standard surface.
_OPEN_PBR = {
    name: (other,)
    for name, other in {
        "base": "base_weight", "metalness": "base_metalness", "specular": "specular_weight",
        "specular_IOR": "specular_ior", "transmission": "transmission_weight", "subsurface": "subsurface_weight",
        "coat": "coat_weight", "emission": "emission_luminance", "opacity": "geometry_opacity",
        "thin_walled": "geometry_thin_walled", "normal": "geometry_normal", "sheen": "fuzz_weight",
        "specular_anisotropy": "specular_roughness_anisotropy", "thin_film_thickness": "thin_film_weight",
    }.items()
}  # fmt: skip
_IGNORED = ("sheen", "specular_anisotropy", "thin_film_thickness", "transmission_scatter")


def ior_of(reflectance: float) -> Array:
    """Return the index of refraction for a reflectance at normal incidence."""
    root = np.sqrt(np.clip(reflectance, 0, 0.99))
    return np.full(1, (1 + root) / (1 - root))


def open_pbr(node: ShaderNode) -> Surface:
    """Read an OpenPBR surface."""
    return _layered(node.renamed(_OPEN_PBR), 0.3, 0.0, 0.8)


def standard_surface(node: ShaderNode) -> Surface:
    """Read a standard surface."""
    return _layered(node, 0.2, 0.1, 1.0)


def _layered(node: ShaderNode, roughness: float, coat_roughness: float, under: float) -> Surface:
    """Read base, subsurface, transmission, coat and emission; `under` is the default of the subsurface's colour."""
    metallic, coat = node.number_or(0.0, "metalness"), node.number_or(0.0, "coat")
    surface = Surface(
        diffuse=_base(node, under, coat),
        emissive=node.combined(np.multiply, node.number_or(0.0, "emission"), node.color_or(1.0, "emission_color")),
        roughness=node.number_or(roughness, "specular_roughness"),
        metallic=metallic,
        ior=_weighted_ior(node),
        clearcoat=coat,
        clearcoat_roughness=node.number_or(coat_roughness, "coat_roughness"),
    )
    for name in _IGNORED:
        if np.any(constant(node.number_or(0.0, name)) != 0):
            node.lose("is not rendered: it is ignored", name)
    tilt(node, surface, "normal")
    clear = node.combined(lambda part, metal: part * (1 - metal), node.number_or(0.0, "transmission"), metallic)
    _set_opacity(node, surface, clear)
    return surface


def _base(node: ShaderNode, under: float, coat: Value) -> Value:
    """Return the colour of the base, mixed with that of the subsurface, and tinted by the coat."""
    base = node.combined(np.multiply, node.number_or(1.0, "base"), node.color_or(0.8, "base_color"))
    subsurface = node.number_or(0.0, "subsurface")
    if np.any(constant(subsurface) > 0):
        base = node.combined(mix, base, node.color_or(under, "subsurface_color"), subsurface)
        node.lose("is rendered as diffuse reflection", "subsurface")
    if np.any(constant(coat) > 0):
        tint = node.color_or(1.0, "coat_color")
        base = node.combined(lambda a, tint, part: a * mix(np.ones(3), tint, part), base, tint, coat)
    return base


def _weighted_ior(node: ShaderNode) -> Array:
    """Return the index of refraction with the same reflectance at normal incidence as the weighted specular layer."""
    ior, values = node.number_or(1.5, "specular_IOR"), {
        "specular": node.number_or(1.0, "specular"), "specular_color": node.color_or(1.0, "specular_color"),
    }  # fmt: skip
    if any(isinstance(each, Image) for each in (ior, *values.values())):
        node.lose("is a texture: its mean is used", "specular")
    eta, weight = float(constant(ior)[0]), 1.0
    for name, value in values.items():
        numbers = constant(value)
        if np.any((numbers < 0) | (numbers > 1)):
            node.lose(f"is {shown(numbers.tolist())}: expected 0 to 1; the nearest is used", name)
        weight *= float(np.clip(numbers, 0, 1).mean())
    return np.full(1, eta) if weight == 1 else ior_of(weight * ((eta - 1) / (eta + 1)) ** 2)


def _set_opacity(node: ShaderNode, surface: Surface, clear: Value) -> None:
    """Set the opacity of a surface that is cut out, or else clear: glass, or a thin wall, which does not refract."""
    cut = node.mean("opacity")
    surface.presence = cut is not None and bool(np.any(constant(cut) < 1))
    surface.thin = node.flag("thin_walled")
    is_clear = np.any(constant(clear) > 0)
    surface.opacity = cut if surface.presence else node.combined(lambda part: 1 - part, clear)
    if is_clear and surface.presence:
        node.lose("is not rendered on a surface that is cut out by its opacity: it is opaque", "transmission")
    elif is_clear:
        surface.tint = node.color_or(1.0, "transmission_color")
        if isinstance(clear, Image):
            node.lose("is a texture: the surface is clear there, and does not refract", "transmission")
        if constant(node.number_or(0.0, "transmission_depth"))[0] > 0:
            node.lose("is not rendered: light is tinted where it crosses the surface", "transmission_depth")
