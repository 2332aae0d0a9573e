"""Read volume shaders: Arnold's standard_volume, MaterialX's and Karma's volumes, and others in part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...scene import BLACK, Array, Color
from ..common import blender
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from ..materials.bound import READERS, bound_to
from ..materials.network import Network, ShaderNode
from ..materials.nodes import PRIMVARS, primvar
from ..materials.values import PrimvarValue, Value, constant
from .volumes import DENSITY, field_of

# Renderers for which a material may have a volume shader; "" is for all renderers.
_CONTEXTS = ("mtlx", "arnold", "kma", "karma", "", "ri", "glslfx")
_ANISOTROPY = 0.99

# The default albedo of Arnold's and Blender's volumes, whose extinction is the density.
_ALBEDO = 0.5


@dataclass(frozen=True)
class VolumeEmission:
    """What a volume emits per scene unit: a colour times a field, or the light of a black body.

    Attributes
    ----------
    field
        The field that scales the colour or, for a black body, gives its temperature.
    kelvin
        The temperature where the field is 1; 0: it is not a black body.
    """

    color: Color
    field: str
    kelvin: float = 0.0


@dataclass(frozen=True)
class VolumeShading:
    """The values of a volume shader: coefficients at density 1, and the fields that it reads."""

    scattering: Color = (_ALBEDO,) * 3
    absorption: Color = (1 - _ALBEDO,) * 3
    anisotropy: float = 0.0
    density: str = DENSITY
    color: str = ""
    emission: VolumeEmission | None = None


def read_shading(reading: Reading, prim: Usd.Prim) -> VolumeShading:
    """Return the values of the shader of a volume's material; without one, extinction 1 and albedo 0.5."""
    material = bound_to(reading, prim)
    if material is None:
        if not blender.wrote_prim(prim):
            return VolumeShading()
        half = _ALBEDO / blender.unit(reading, prim)
        text = (
            f"has no material, because Blender writes none for volumes: extinction {2 * half:g} and albedo 0.5 are used"
        )
        reading.warn(prim, f"{text}; for its own, set photonbeams:scattering, absorption and anisotropy")
        return VolumeShading((half,) * 3, (half,) * 3)
    network = Network(reading, READERS, primvar=partial(_property, reading, prim), other=_other_node)
    sources = (material.ComputeVolumeSource(each)[0] for each in _CONTEXTS)
    nodes = [ShaderNode(network, shader) for shader in sources if shader]
    if not nodes:
        text = "has no volume shader: extinction 1 and albedo 0.5 at density 1 are used"
        reading.warn(material.GetPrim(), text)
        return VolumeShading()
    node = next((each for each in nodes if _reader(each) is not _other), nodes[0])
    shading = _reader(node)(node)
    for tell in network.losses:
        tell()
    return shading


def _reader(node: ShaderNode) -> Callable[[ShaderNode], VolumeShading]:
    kind = node.label
    if kind.removeprefix("arnold:") == "standard_volume":
        return _arnold
    if kind.startswith("ND_volume") or "anisotropic_vdf" in kind or "absorption_vdf" in kind:
        return _materialx
    return _coefficients if kind.split(":")[-1] == "kma_volume" else _other


def _property(reading: Reading, prim: Usd.Prim, name: str, fallback: Array) -> Value:
    """Return a primvar of a volume, or a factor of 1 that varies as a field does; the density is in all values."""
    if field_of(reading, prim, name) is not None:
        return np.ones(1) if name == DENSITY else PrimvarValue(name, np.ones(1))
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    value = primvar.Get(reading.time) if primvar else None
    return fallback if value is None else np.asarray(value, dtype=np.float64).reshape(-1)[:3]


def _other_node(node: ShaderNode) -> Value | None:
    """Read a node of another kind: what names a property looks it up, and all else returns its input."""
    if any(map(node.has, PRIMVARS)):
        return primvar(node)
    node.lose(f"is a node '{node.label}', which is not evaluated: its input is used as it is")
    return node.value("in")


def _within(node: ShaderNode, name: str, values: Array, least: float = 0.0, most: float = np.inf) -> Array:
    """Return numbers that an input gives, or the nearest in a range, with a warning."""
    if np.any(values < least) or np.any(values > most + 1e-5):
        expected = f"at least {least:g}" if most == np.inf else f"{least:g} to {most:g}"
        given = f"is {values[0]:g}" if len(values) == 1 else f"makes {tuple(np.round(values, 6).tolist())}"
        node.lose(f"{given}: expected {expected}; the nearest is used", name)
    return np.clip(values, least, most)


def _number(node: ShaderNode, name: str, default: float, least: float = 0.0, most: float = np.inf) -> float:
    return float(_within(node, name, constant(node.number_or(default, name)), least, most)[0])


def _color(node: ShaderNode, name: str, default: float) -> Array:
    return _within(node, name, constant(node.color_or(default, name)))


def _anisotropy(node: ShaderNode, name: str) -> float:
    return _number(node, name, 0.0, -_ANISOTROPY, _ANISOTROPY)


def _field(node: ShaderNode, name: str, default: str) -> str:
    """Return the field that scales an input."""
    value = node.value(name)
    return value.name if isinstance(value, PrimvarValue) else default


def _triple(values: Array) -> Color:
    red, green, blue = values.tolist()
    return red, green, blue


def _arnold(node: ShaderNode) -> VolumeShading:
    """Read Arnold's standard_volume: `transparent` is the transmittance over `transparent_depth` at density 1."""
    depth = _number(node, "transparent_depth", 1.0, 1e-6)
    transparent = _within(node, "transparent", _color(node, "transparent", np.exp(-1.0)), 1e-6, 1)
    extinction = _number(node, "density", 1.0) * -np.log(transparent) / depth
    scattered = _number(node, "scatter", 1.0) * _color(node, "scatter_color", _ALBEDO)
    albedo = _within(node, "scatter_color", scattered, 0, 1)
    if node.text("transparent_channel"):
        node.lose("is not rendered: it is ignored", "transparent_channel")
    return VolumeShading(
        scattering=_triple(albedo * extinction),
        absorption=_triple((1 - albedo) * extinction),
        anisotropy=_anisotropy(node, "scatter_anisotropy"),
        density=node.text("density_channel") or DENSITY,
        color=node.text("scatter_color_channel"),
        emission=_arnold_emission(node),
    )


def _arnold_emission(node: ShaderNode) -> VolumeEmission | None:
    mode = node.text("emission_mode", "blackbody")
    strength = _number(node, "emission", 1.0) * _color(node, "emission_color", 1.0)
    if mode == "none" or not strength.any():
        return None
    if mode == "blackbody":
        kelvin = _number(node, "temperature", 1.0) * _number(node, "blackbody_kelvin", 5000.0)
        strength *= _number(node, "blackbody_intensity", 1.0)
        return VolumeEmission(_triple(strength), node.text("temperature_channel", "temperature"), kelvin)
    key, default = ("density_channel", DENSITY) if mode == "density" else ("emission_channel", "heat")
    return VolumeEmission(_triple(strength), node.text(key, default))


def _materialx(node: ShaderNode) -> VolumeShading:
    """Read MaterialX's `volume`, which has a vdf and perhaps an edf."""
    shading, emission = VolumeShading(BLACK, BLACK), None
    for part in filter(None, (node, node.connected("vdf"), node.connected("edf"))):
        if "_vdf" in part.label:
            shading = _coefficients(part)
        elif "_edf" in part.label:
            emission = _emission(part, "color")
    if shading.scattering == shading.absorption == BLACK:
        node.lose("scatters and absorbs nothing: expected a vdf that does")
    return replace(shading, emission=emission)


def _coefficients(node: ShaderNode) -> VolumeShading:
    """Read absorption, scattering and anisotropy of MaterialX's vdf, or of Karma's volume, which adds emission."""
    return VolumeShading(
        scattering=_triple(_color(node, "scattering", 0.0)),
        absorption=_triple(_color(node, "absorption", 0.0)),
        anisotropy=_anisotropy(node, "anisotropy"),
        color=_field(node, "scattering", ""),
        emission=_emission(node, "emission"),
    )


def _emission(node: ShaderNode, name: str) -> VolumeEmission | None:
    color = _color(node, name, 0.0)
    return VolumeEmission(_triple(color), _field(node, name, DENSITY)) if color.any() else None


def _other(node: ShaderNode) -> VolumeShading:
    """Read a shader of another kind, by the input names that most shaders use."""
    kind = node.label or "none"
    node.lose(f"is a volume shader '{kind}', which is not known: its densityScale, albedo and anisotropy are used")
    node = node.renamed(_USUAL)
    density = _number(node, "density", 1.0)
    albedo = _within(node, "albedo", _color(node, "albedo", _ALBEDO), 0, 1)
    scattering, absorption = _triple(density * albedo), _triple(density * (1 - albedo))
    return VolumeShading(scattering, absorption, _anisotropy(node, "anisotropy"))


_USUAL = {
    "density": ("densityScale", "densityscale", "density_scale", "density"),
    "albedo": ("albedo", "scatter_color", "scattercolor", "color"),
    "anisotropy": ("anisotropy", "phase", "g"),
}
