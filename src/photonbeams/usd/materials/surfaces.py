"""Convert surface shaders to the inputs of a UsdPreviewSurface, and note what they have beyond these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...scene import Array, rgb
from .bumps import tilt
from .images import read_image
from .layered import ior_of, open_pbr, standard_surface
from .network import Reader, ShaderNode, Surface
from .values import Value, as_number, constant, mix


def _preview(node: ShaderNode) -> Surface:
    """Read a UsdPreviewSurface."""
    threshold = node.scalar("opacityThreshold", 0.0)
    surface = Surface(
        diffuse=node.color("diffuseColor"),
        emissive=node.color("emissiveColor"),
        roughness=node.number("roughness"),
        metallic=node.number("metallic"),
        ior=node.number("ior"),
        clearcoat=node.number("clearcoat"),
        clearcoat_roughness=node.number("clearcoatRoughness"),
        opacity=node.number("opacity"),
        presence=threshold > 0 or node.text("opacityMode") == "presence",
    )
    tilt(node, surface, "normal")
    if node.has("displacement") and node.shader.GetInput("displacement").HasConnectedSource():
        node.lose("is not rendered: it is ignored", "displacement")
    if threshold > 0 and surface.opacity is not None:
        surface.opacity = node.combined(lambda values: (values >= threshold).astype(float), surface.opacity)
    if node.flag("useSpecularWorkflow"):
        _specular_workflow(node, surface)
    return surface


def _specular_workflow(node: ShaderNode, surface: Surface) -> None:
    """Set the index of refraction of a dielectric, or a metal, from the specular colour at normal incidence."""
    color = node.color_or(0.0, "specularColor")
    diffuse = np.full(3, 0.18) if surface.diffuse is None else surface.diffuse
    mean = constant(color)
    surface.metallic = np.zeros(1)
    if isinstance(color, np.ndarray) and np.ptp(mean) <= 0.02 and mean.max() < 0.2:
        surface.ior = ior_of(float(mean.mean()))
        return

    # The conversion of glTF's specular workflow by Khronos, with a reflectance of dielectrics of 0.04.
    def metallic(colors: Array, speculars: Array) -> Array:
        total, strongest = colors.max(axis=-1, keepdims=True), speculars.max(axis=-1, keepdims=True)
        linear = total * (1 - strongest) / 0.96 + strongest - 0.08
        root = np.sqrt(np.maximum(linear**2 - 4 * 0.04 * (0.04 - strongest), 0))
        return np.where(strongest <= 0.04, 0.0, np.clip((root - linear) / 0.08, 0, 1))

    def base(colors: Array, speculars: Array) -> Array:
        part = metallic(colors, speculars)
        dielectric = colors * (1 - speculars.max(axis=-1, keepdims=True)) / (0.96 * np.maximum(1 - part, 1e-4))
        conductor = (speculars - 0.04 * (1 - part)) / np.maximum(part, 1e-4)
        return np.clip(dielectric + part**2 * (conductor - dielectric), 0, 1)

    surface.ior = np.full(1, 1.5)
    surface.diffuse = node.combined(base, diffuse, color)
    surface.metallic = node.combined(metallic, diffuse, color)


def _unlit(name: str) -> Reader:
    """Return a reader of surfaces that show a colour regardless of the lights."""

    def read(node: ShaderNode) -> Surface:
        emissive = node.combined(np.multiply, node.color_or(1.0, name), node.number_or(1.0, "emission"))
        return Surface(np.zeros(3), emissive, ior=np.ones(1), opacity=node.mean("opacity"), presence=True)

    return read


def _diffuse(color: str, default: float = 0.5, weight: str = "", usual: float = 1.0) -> Reader:
    """Return a reader of surfaces that are only diffuse: an input of colours, and its weight, with their defaults."""

    def read(node: ShaderNode) -> Surface:
        diffuse = node.combined(np.multiply, node.color_or(default, color), node.number_or(usual, weight))
        return Surface(diffuse, roughness=np.ones(1), ior=np.ones(1), opacity=node.mean("opacity"), presence=True)

    return read


def _by_names(**names: Sequence[str]) -> Reader:
    """Return a reader of shaders that have these names for a surface's inputs; it notes that they are approximated."""

    def read(node: ShaderNode) -> Surface:
        node = node.renamed(names)
        node.lose(f"is a '{_label(node)}': it is rendered as the nearest UsdPreviewSurface")
        surface = Surface(
            diffuse=_product(node, node.color("diffuse"), node.number_or(1.0, "diffuse_weight")),
            emissive=_product(node, node.color("emissive"), node.number_or(float("emission" not in names), "emission")),
            roughness=node.number("roughness"),
            metallic=node.number("metallic"),
            ior=node.number("ior"),
            clearcoat=node.number("clearcoat"),
            opacity=node.mean("opacity"),
            presence=True,
        )
        clear = node.number_or(0.0, "transmission")
        if np.any(constant(clear) > 0):
            surface.opacity, surface.presence = node.combined(lambda part: 1 - part, clear), False
            surface.tint = node.color("tint")
        tilt(node, surface, "normal", "bumpNormal", "normalCamera")
        return surface

    return read


def _product(node: ShaderNode, color: Value | None, weight: Value) -> Value | None:
    return None if color is None else node.combined(np.multiply, color, weight)


def _label(node: ShaderNode) -> str:
    return node.label or "shader without an id"


def _omni(node: ShaderNode) -> Surface:
    """Read NVIDIA's OmniPBR, whose textures are its own inputs."""
    color = read_image(node, "diffuse_texture", "auto")
    if color is None:
        color = node.color_or(0.2, "diffuse_color_constant", "diffuse_color", "base_color")
    surface = Surface(
        diffuse=node.combined(lambda a, b: rgb(a) * rgb(b), color, node.color_or(1.0, "diffuse_tint")),
        roughness=_textured(
            node, 0.5, ("reflection_roughness_constant", "roughness"), "reflectionroughness_texture",
            "reflection_roughness_texture_influence",
        ),
        metallic=_textured(
            node, 0.0, ("metallic_constant", "metallic"), "metallic_texture", "metallic_texture_influence"
        ),
    )  # fmt: skip
    normals = read_image(node, "normalmap_texture", "raw")
    if normals is not None:
        surface.normal = node.combined(lambda a: 2 * rgb(a) - 1, normals)
    if node.flag("enable_emission"):
        surface.emissive = node.color_or(1.0, "emissive_color")
        node.lose("is not rendered: emissive_color is used as the radiance", "emissive_intensity")
    if node.flag("enable_opacity"):
        surface.opacity, surface.presence = node.number_or(1.0, "opacity_constant"), True
    return surface


def _textured(
    node: ShaderNode, default: float, constants: Sequence[str], texture: str, influence: str
) -> Value | None:  # fmt: skip
    """Return a constant, mixed with a texture by its influence."""
    image, part = read_image(node, texture, "raw"), node.vector(influence, (0.0,))
    if image is None or not np.any(part > 0):
        return node.number(*constants)
    return node.combined(mix, node.number_or(default, *constants), as_number(image), part)


def _glass(node: ShaderNode) -> Surface:
    """Read NVIDIA's OmniGlass."""
    return Surface(
        roughness=node.number_or(0.0, "frosting_roughness"),
        ior=node.number_or(1.491, "glass_ior"),
        opacity=np.zeros(1),
        thin=node.flag("thin_walled"),
        tint=node.color_or(1.0, "glass_color"),
    )


def _first_shader(*names: str) -> Reader:
    """Return a reader of shaders that combine others, of which the first connected one is rendered."""

    def read(node: ShaderNode) -> Surface:
        for name in names:
            inner = node.connected(name)
            if inner is not None and inner.shader.GetPrim() != node.shader.GetPrim():
                if node.category != "arnold:two_sided":
                    node.lose(f"is a '{_label(node)}': only its {name} is rendered")
                return surface_of(inner) or Surface()
        return Surface()

    return read


def surface_of(node: ShaderNode) -> Surface | None:
    """Return the surface of a shader, or None if nothing in it can be rendered."""
    kind = node.category
    if kind in SURFACES:
        return SURFACES[kind](node)
    if kind.startswith("arnold:") and kind in node.network.nodes:
        # In Arnold any node that returns a colour may be a surface.
        color = node.output("out")
        return None if color is None else Surface(np.zeros(3), color, ior=np.ones(1))
    surface = _GUESSED(node)
    values = (surface.diffuse, surface.emissive, surface.metallic, surface.roughness)
    return None if all(value is None for value in values) else surface


def _materialx_surface(node: ShaderNode) -> Surface:
    """Read MaterialX's `surface` of a BSDF and an EDF; only a diffuse BSDF is rendered without a loss."""
    surface = Surface(np.zeros(3), ior=np.ones(1), presence=True, opacity=node.number("opacity"))
    scattering, emission = node.connected("bsdf"), node.connected("edf")
    if scattering is not None:
        surface.diffuse = _weighted(scattering, 0.18)
        if scattering.category not in ("oren", "burley"):
            scattering.lose(f"is a '{_label(scattering)}': only its color is rendered, as diffuse reflection")
    if emission is not None:
        surface.emissive = _weighted(emission, 1.0)
    return surface


def _weighted(node: ShaderNode, default: float) -> Value:
    return node.combined(np.multiply, node.color_or(default, "color"), node.number_or(1.0, "weight"))


# Unknown shaders are read by the names that most shaders use.
_GUESSED = _by_names(
    diffuse=("diffuseColor", "baseColor", "base_color", "diffuse_color", "diffuse", "Kd_color", "color", "albedo",
             "Cs"),
    emissive=("emissiveColor", "emission_color", "emitColor"), emission=("emission", "emissionWeight"),
    roughness=("roughness", "specular_roughness", "specularRoughness"), metallic=("metallic", "metalness"),
    ior=("ior", "IOR"), opacity=("opacity", "presence"),
)  # fmt: skip

_PRINCIPLED = _by_names(
    diffuse=("baseColor", "base_color"), emissive=("emitColor", "emissive"), roughness=("roughness", "specRoughness"),
    opacity=("presence",), transmission=("specTrans", "spec_trans", "transmission", "refractionGain"),
    tint=("baseColor", "base_color"),
)  # fmt: skip

SURFACES: dict[str, Reader] = {
    "UsdPreviewSurface": _preview,
    "PxrPreviewSurface": _preview,
    **dict.fromkeys(("standard_surface", "arnold:standard_surface"), standard_surface),
    **dict.fromkeys(("open_pbr_surface", "arnold:openpbr_surface"), open_pbr),
    "surface_unlit": _unlit("emission_color"),
    "surface": _materialx_surface,
    "arnold:flat": _unlit("color"),
    "arnold:utility": _diffuse("color", default=1.0),
    "arnold:lambert": _diffuse("Kd_color", 1.0, "Kd", 0.7),
    "arnold:matte": _unlit("color"),
    "arnold:standard": _by_names(
        diffuse=("Kd_color",), diffuse_weight=("Kd",), emissive=("emission_color",), emission=("emission",),
        roughness=("specular_roughness",), ior=("IOR",), transmission=("Kt",), tint=("Kt_color",),
    ),
    "arnold:two_sided": _first_shader("front", "back"),
    **dict.fromkeys(
        ("arnold:ray_switch_shader", "arnold:ray_switch_rgba"), _first_shader("camera", "diffuse_reflection")
    ),
    "arnold:mix_shader": _first_shader("shader1", "shader2"),
    "arnold:switch_shader": _first_shader("input0", "input1"),
    "arnold:layer_shader": _first_shader("input1", "input2"),
    **dict.fromkeys(
        ("arnold:aov_write_rgb", "arnold:aov_write_rgba", "arnold:cryptomatte"), _first_shader("passthrough")
    ),
    **dict.fromkeys(("PxrDisney", "PxrDisneyBsdf", "disney_principled", "gltf_pbr"), _PRINCIPLED),
    "PxrSurface": _by_names(
        diffuse=("diffuseColor",), diffuse_weight=("diffuseGain",), emissive=("glowColor",), emission=("glowGain",),
        roughness=("specularRoughness",), opacity=("presence",), transmission=("refractionGain",),
        ior=("glassIor",), tint=("refractionColor",),
    ),
    "PxrDiffuse": _diffuse("diffuseColor"),
    "PxrConstant": _unlit("emitColor"),
    "PxrBlack": _diffuse("", default=0.0),
    **dict.fromkeys(("OmniPBR", "OmniSurface"), _omni),
    "OmniGlass": _glass,
}  # fmt: skip
