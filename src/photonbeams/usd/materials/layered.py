"""Read layered surfaces: Autodesk's standard surface, in Arnold and MaterialX, and OpenPBR."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...scene import Array, rgb
from ...scene.checks import shown
from ..common.openusd import UsdShade
from .bumps import tilt
from .network import Network, Reader, Surface
from .values import Image, Value, as_number, constant, mix


@dataclass(frozen=True)
class Names:
    """The names of a layered surface's inputs (Autodesk's standard surface, OpenPBR), and some defaults."""

    base: str
    metalness: str
    specular: str
    roughness_default: float
    ior: str
    transmission: str
    subsurface: str
    coat: str
    emission: str
    opacity: str
    thin: str
    normal: str
    ignored: tuple[str, ...]


STANDARD = Names(
    "base", "metalness", "specular", 0.2, "specular_IOR", "transmission", "subsurface", "coat", "emission",
    "opacity", "thin_walled", "normal", ("sheen", "specular_anisotropy", "thin_film_thickness", "transmission_scatter"),
)  # fmt: skip
OPEN_PBR = Names(
    "base_weight", "base_metalness", "specular_weight", 0.3, "specular_ior", "transmission_weight", "subsurface_weight",
    "coat_weight", "emission_luminance", "geometry_opacity", "geometry_thin_walled", "geometry_normal",
    ("fuzz_weight", "specular_roughness_anisotropy", "thin_film_weight", "transmission_scatter"),
)  # fmt: skip


def ior_of(reflectance: float) -> Array:
    """Return the index of refraction for a reflectance at normal incidence."""
    root = np.sqrt(np.clip(reflectance, 0, 0.99))
    return np.full(1, (1 + root) / (1 - root))


def layered(names: Names) -> Reader:
    """Return a reader of a layered surface: base, subsurface, transmission, coat, emission."""

    def read(network: Network, node: UsdShade.Shader) -> Surface:
        number, colored = partial(network.number_or, node), partial(network.color_or, node)
        base = network.combined(node, np.multiply, number(1.0, names.base), colored(0.8, "base_color"))
        subsurface, transmission = number(0.0, names.subsurface), number(0.0, names.transmission)
        if np.any(constant(subsurface) > 0):
            under = colored(1.0 if names is STANDARD else 0.8, "subsurface_color")
            base = network.combined(node, mix, base, under, subsurface)
            network.lose(node, "is rendered as diffuse reflection", names.subsurface)
        coat = number(0.0, names.coat)
        if np.any(constant(coat) > 0):
            base = network.combined(node, lambda a, tint, part: a * mix(np.ones(3), tint, part), base,
                                    colored(1.0, "coat_color"), coat)  # fmt: skip
        for name in names.ignored:
            found = network.number(node, name)
            if found is not None and np.any(constant(found) != 0):
                network.lose(node, "is not rendered: it is ignored", name)
        clear = network.combined(node, lambda part, metal: part * (1 - metal), transmission,
                                 number(0.0, names.metalness))  # fmt: skip
        surface = Surface(
            diffuse=base,
            emissive=network.combined(node, np.multiply, number(0.0, names.emission), colored(1.0, "emission_color")),
            roughness=number(names.roughness_default, "specular_roughness"),
            metallic=number(0.0, names.metalness),
            ior=_weighted_ior(network, node, names),
            clearcoat=coat,
            clearcoat_roughness=number(0.1 if names is STANDARD else 0.0, "coat_roughness"),
        )
        tilt(network, node, surface, names.normal)
        _set_opacity(network, node, surface, colored(1.0, names.opacity), clear, names)
        return surface

    return read


def _weighted_ior(network: Network, node: UsdShade.Shader, names: Names) -> Array:
    """Return the index of refraction with the same reflectance at normal incidence as the weighted specular layer."""
    ior = network.number_or(node, 1.5, names.ior)
    weight = network.number_or(node, 1.0, names.specular)
    tint = network.color_or(node, 1.0, "specular_color")
    if any(isinstance(each, Image) for each in (ior, weight, tint)):
        network.lose(node, "is a texture: its mean is used", names.specular)
    eta = float(constant(ior)[0])
    for name, value in ((names.specular, constant(weight)), ("specular_color", constant(tint))):
        if np.any((value < 0) | (value > 1)):
            network.lose(node, f"is {shown(value.tolist())}: expected 0 to 1; the nearest is used", name)
    reflectance = float(np.clip(constant(weight)[0], 0, 1)) * float(np.clip(constant(tint), 0, 1).mean())
    return np.full(1, eta) if reflectance == 1 else ior_of(reflectance * ((eta - 1) / (eta + 1)) ** 2)


def _set_opacity(
    network: Network, node: UsdShade.Shader, surface: Surface, opacity: Value, clear: Value, names: Names
) -> None:
    """Set the opacity of a surface that is cut out, or else clear: glass, or a thin wall, which does not refract."""
    cut = as_number(network.combined(node, lambda values: rgb(values).mean(axis=-1, keepdims=True), opacity))
    is_cut, is_clear = np.any(constant(cut) < 1), np.any(constant(clear) > 0)
    surface.presence, surface.thin = bool(is_cut), bool(network.plain(node, names.thin, False))
    if is_cut and is_clear:
        network.lose(node, "is not rendered on a surface that is cut out by its opacity: it is opaque", "transmission")
    surface.opacity = cut if is_cut else network.combined(node, lambda part: 1 - part, clear)
    if is_clear and not is_cut:
        surface.tint = network.color_or(node, 1.0, "transmission_color")
        if isinstance(clear, Image):
            network.lose(node, "is a texture: the surface is clear there, and does not refract", names.transmission)
        depth = network.number(node, "transmission_depth")
        if depth is not None and constant(depth)[0] > 0:
            network.lose(node, "is not rendered: light is tinted where it crosses the surface", "transmission_depth")
