"""Convert surface shaders to the inputs of a UsdPreviewSurface, and note what they have beyond these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scene import Array, rgb
from ..common.openusd import UsdShade
from .bumps import tilt
from .images import image_input
from .layered import OPEN_PBR, STANDARD, ior_of, layered
from .network import Network, Reader, Surface, category, shader_id
from .values import Value, as_number, constant, mix


def preview(network: Network, node: UsdShade.Shader) -> Surface:
    """Read a UsdPreviewSurface."""
    threshold = float(network.vector(node, "opacityThreshold", (0.0,))[0])
    surface = Surface(
        diffuse=network.color(node, "diffuseColor"),
        emissive=network.color(node, "emissiveColor"),
        roughness=network.number(node, "roughness"),
        metallic=network.number(node, "metallic"),
        ior=network.number(node, "ior"),
        clearcoat=network.number(node, "clearcoat"),
        clearcoat_roughness=network.number(node, "clearcoatRoughness"),
        opacity=network.number(node, "opacity"),
        presence=threshold > 0 or str(network.plain(node, "opacityMode", "")) == "presence",
    )
    tilt(network, node, surface, "normal")
    displacement = node.GetInput("displacement")
    if displacement and displacement.HasConnectedSource():
        network.lose(node, "is not rendered: it is ignored", "displacement")
    if threshold > 0 and surface.opacity is not None:
        surface.opacity = network.combined(node, lambda values: (values >= threshold).astype(float), surface.opacity)
    if network.plain(node, "useSpecularWorkflow", 0):
        _specular_workflow(network, node, surface)
    return surface


def _specular_workflow(network: Network, node: UsdShade.Shader, surface: Surface) -> None:
    """Set the index of refraction of a dielectric, or a metal, from the specular colour at normal incidence."""
    color = network.color_or(node, 0.0, "specularColor")
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
    surface.diffuse = network.combined(node, base, diffuse, color)
    surface.metallic = network.combined(node, metallic, diffuse, color)


def unlit(*names: str) -> Reader:
    """Return a reader of surfaces that show a colour regardless of the lights."""

    def read(network: Network, node: UsdShade.Shader) -> Surface:
        color = network.color_or(node, 1.0, *names)
        weight = network.number_or(node, 1.0, "emission")
        emissive = network.combined(node, np.multiply, color, weight)
        return Surface(np.zeros(3), emissive, ior=np.ones(1), opacity=_opacity(network, node), presence=True)

    return read


def _opacity(network: Network, node: UsdShade.Shader, *names: str) -> Value | None:
    found = network.color(node, *(names or ("opacity",)))
    return None if found is None else network.combined(node, lambda a: rgb(a).mean(axis=-1, keepdims=True), found)


def _diffuse(color: str, weight: str = "", default: float = 0.5, scale: float = 1.0) -> Reader:
    """Return a reader of surfaces that are only diffuse."""

    def read(network: Network, node: UsdShade.Shader) -> Surface:
        found = network.color_or(node, default, color)
        part = network.number_or(node, scale, weight) if weight else np.ones(1)
        diffuse = network.combined(node, np.multiply, found, part)
        return Surface(diffuse, roughness=np.ones(1), ior=np.ones(1), opacity=_opacity(network, node), presence=True)

    return read


@dataclass(frozen=True)
class _ByNames:
    """The names that a surface shader has for the inputs of a UsdPreviewSurface."""

    diffuse: tuple[str, ...] = ()
    weight: tuple[str, ...] = ()
    emissive: tuple[str, ...] = ()
    emission: tuple[str, ...] = ()
    roughness: tuple[str, ...] = ()
    metallic: tuple[str, ...] = ()
    ior: tuple[str, ...] = ()
    clearcoat: tuple[str, ...] = ()
    opacity: tuple[str, ...] = ()
    transmission: tuple[str, ...] = ()
    tint: tuple[str, ...] = ()

    def __call__(self, network: Network, node: UsdShade.Shader) -> Surface:
        """Return the surface, and note that the shader is approximated."""
        network.lose(node, f"is a '{_label(node)}': it is rendered as the nearest UsdPreviewSurface")
        diffuse, emissive = network.color(node, *self.diffuse), network.color(node, *self.emissive)
        weight, glow = network.number(node, *self.weight), network.number(node, *self.emission)
        if diffuse is not None and weight is not None:
            diffuse = network.combined(node, np.multiply, diffuse, weight)
        if emissive is not None and (glow is not None or self.emission):
            emissive = network.combined(node, np.multiply, emissive, np.zeros(1) if glow is None else glow)
        opacity, presence, tint = _opacity(network, node, *self.opacity) if self.opacity else None, True, None
        clear = network.number(node, *self.transmission)
        if clear is not None and np.any(constant(clear) > 0):
            opacity, presence = network.combined(node, lambda part: 1 - part, clear), False
            tint = network.color(node, *self.tint)
        surface = Surface(
            diffuse, emissive, network.number(node, *self.roughness), network.number(node, *self.metallic),
            network.number(node, *self.ior), network.number(node, *self.clearcoat), opacity=opacity, presence=presence,
            tint=tint,
        )  # fmt: skip
        tilt(network, node, surface, "normal", "bumpNormal", "normalCamera")
        return surface


def _label(node: UsdShade.Shader) -> str:
    return shader_id(node) or "shader without an id"


def _omni(network: Network, node: UsdShade.Shader) -> Surface:
    """Read NVIDIA's OmniPBR, whose textures are its own inputs."""
    tint = network.color_or(node, 1.0, "diffuse_tint")
    color = image_input(network, node, "diffuse_texture") or network.color_or(
        node, 0.2, "diffuse_color_constant", "diffuse_color", "base_color"
    )
    surface = Surface(
        diffuse=network.combined(node, lambda a, b: rgb(a) * rgb(b), color, tint),
        roughness=network.number(node, "reflection_roughness_constant", "roughness"),
        metallic=network.number(node, "metallic_constant", "metallic"),
    )
    for field, texture, influence in (
        ("roughness", "reflectionroughness_texture", "reflection_roughness_texture_influence"),
        ("metallic", "metallic_texture", "metallic_texture_influence"),
    ):
        image = image_input(network, node, texture, "raw")
        part = network.vector(node, influence, (0.0,))
        if image is not None and np.any(part > 0):
            plain = getattr(surface, field)
            plain = np.full(1, 0.5 if field == "roughness" else 0.0) if plain is None else plain
            setattr(surface, field, network.combined(node, mix, plain, as_number(image), part))
    normals = image_input(network, node, "normalmap_texture", "raw")
    if normals is not None:
        surface.normal = network.combined(node, lambda a: 2 * rgb(a) - 1, normals)
    if network.plain(node, "enable_emission", False):
        surface.emissive = network.color_or(node, 1.0, "emissive_color")
        network.lose(node, "is not rendered: emissive_color is used as the radiance", "emissive_intensity")
    if network.plain(node, "enable_opacity", False):
        surface.opacity, surface.presence = network.number_or(node, 1.0, "opacity_constant"), True
    return surface


def _glass(network: Network, node: UsdShade.Shader) -> Surface:
    """Read NVIDIA's OmniGlass."""
    tint = network.color_or(node, 1.0, "glass_color")
    ior = network.number_or(node, 1.491, "glass_ior")
    return Surface(roughness=network.number_or(node, 0.0, "frosting_roughness"), ior=ior, opacity=np.zeros(1),
                   thin=bool(network.plain(node, "thin_walled", False)), tint=tint)  # fmt: skip


def _first_shader(*names: str) -> Reader:
    """Return a reader of shaders that combine others, of which the first connected one is rendered."""

    def read(network: Network, node: UsdShade.Shader) -> Surface:
        for name in names:
            inner = network.connected(node, name)
            if inner and inner.GetPrim() != node.GetPrim():
                if category(node) != "arnold:two_sided":
                    network.lose(node, f"is a '{_label(node)}': only its {name} is rendered")
                return surface_of(network, inner) or Surface()
        return Surface()

    return read


def guessed(network: Network, node: UsdShade.Shader) -> Surface | None:
    """Read an unknown shader by the input names that most shaders use; None if it has none of them."""
    surface = _GUESSED(network, node)
    known = (surface.diffuse, surface.emissive, surface.metallic, surface.roughness)
    return surface if any(each is not None for each in known) else None


def surface_of(network: Network, node: UsdShade.Shader) -> Surface | None:
    """Return the surface of a shader, or None if nothing in it can be rendered."""
    kind = category(node)
    if kind in SURFACES:
        return SURFACES[kind](network, node)
    if kind.startswith("arnold:") and network.knows(kind):
        # In Arnold any node that returns a colour may be a surface.
        color = network.output(node, "out")
        return None if color is None else Surface(np.zeros(3), color, ior=np.ones(1))
    return guessed(network, node)


def _materialx_surface(network: Network, node: UsdShade.Shader) -> Surface:
    """Read MaterialX's `surface` of a BSDF and an EDF; only a diffuse BSDF is rendered without a loss."""
    surface = Surface(np.zeros(3), ior=np.ones(1), presence=True)
    surface.opacity = network.number(node, "opacity")
    for name in ("bsdf", "edf"):
        part = network.connected(node, name)
        if part is None:
            continue
        color = network.color_or(part, 0.18 if name == "bsdf" else 1.0, "color")
        weight = network.number_or(part, 1.0, "weight")
        value = network.combined(part, np.multiply, color, weight)
        if name == "edf":
            surface.emissive = value
            continue
        surface.diffuse = value
        if category(part) not in ("oren", "burley"):
            network.lose(part, f"is a '{_label(part)}': only its color is rendered, as diffuse reflection")
    return surface


_COLORS = ("diffuseColor", "baseColor", "base_color", "diffuse_color", "diffuse", "Kd_color", "color", "albedo", "Cs")
_GUESSED = _ByNames(
    diffuse=_COLORS, emissive=("emissiveColor", "emission_color", "emitColor"),
    emission=("emission", "emissionWeight"), roughness=("roughness", "specular_roughness", "specularRoughness"),
    metallic=("metallic", "metalness"), ior=("ior", "IOR"), opacity=("opacity", "presence"),
)  # fmt: skip

_PRINCIPLED = _ByNames(
    diffuse=("baseColor", "base_color"), emissive=("emitColor", "emissive"), roughness=("roughness", "specRoughness"),
    metallic=("metallic",), ior=("ior",), clearcoat=("clearcoat",), opacity=("presence",),
    transmission=("specTrans", "spec_trans", "transmission", "refractionGain"), tint=("baseColor", "base_color"),
)  # fmt: skip

SURFACES: dict[str, Reader] = {
    "UsdPreviewSurface": preview,
    "PxrPreviewSurface": preview,
    "standard_surface": layered(STANDARD),
    "arnold:standard_surface": layered(STANDARD),
    "open_pbr_surface": layered(OPEN_PBR),
    "arnold:openpbr_surface": layered(OPEN_PBR),
    "surface_unlit": unlit("emission_color"),
    "surface": _materialx_surface,
    "arnold:flat": unlit("color"),
    "arnold:utility": _diffuse("color", default=1.0),
    "arnold:lambert": _diffuse("Kd_color", "Kd", default=1.0, scale=0.7),
    "arnold:matte": unlit("color"),
    "arnold:standard": _ByNames(
        diffuse=("Kd_color",), weight=("Kd",), emissive=("emission_color",), emission=("emission",),
        roughness=("specular_roughness",), opacity=("opacity",), ior=("IOR",), transmission=("Kt",),
        tint=("Kt_color",),
    ),
    "arnold:two_sided": _first_shader("front", "back"),
    "arnold:ray_switch_shader": _first_shader("camera", "diffuse_reflection"),
    "arnold:ray_switch_rgba": _first_shader("camera", "diffuse_reflection"),
    "arnold:mix_shader": _first_shader("shader1", "shader2"),
    "arnold:switch_shader": _first_shader("input0", "input1"),
    "arnold:layer_shader": _first_shader("input1", "input2"),
    "arnold:aov_write_rgb": _first_shader("passthrough"),
    "arnold:aov_write_rgba": _first_shader("passthrough"),
    "arnold:cryptomatte": _first_shader("passthrough"),
    "PxrDisney": _PRINCIPLED,
    "PxrDisneyBsdf": _PRINCIPLED,
    "disney_principled": _PRINCIPLED,
    "gltf_pbr": _PRINCIPLED,
    "PxrSurface": _ByNames(
        diffuse=("diffuseColor",), weight=("diffuseGain",), emissive=("glowColor",), emission=("glowGain",),
        roughness=("specularRoughness",), opacity=("presence",), transmission=("refractionGain",),
        ior=("glassIor",), tint=("refractionColor",),
    ),
    "PxrDiffuse": _diffuse("diffuseColor"),
    "PxrConstant": unlit("emitColor"),
    "PxrBlack": _diffuse("no", default=0.0),
    "OmniPBR": _omni,
    "OmniSurface": _omni,
    "OmniGlass": _glass,
}  # fmt: skip
