"""Read volume shaders: Arnold's standard_volume, MaterialX's and Karma's volumes, and others in part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...scene import BLACK, Array, Color, color
from ..common import blender
from ..common.openusd import Usd, UsdGeom, UsdShade
from ..common.reading import Reading
from ..materials.bound import bound_to
from ..materials.network import is_output
from .volumes import DENSITY, field_of

# Renderers for which a material may have a volume shader; "" is for all renderers.
_CONTEXTS = ("mtlx", "arnold", "kma", "karma", "", "ri", "glslfx")
_ANISOTROPY = 0.99
_DEEPEST = 16  # nodes in a chain

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
    shaders = [shader for each in _CONTEXTS if (shader := material.ComputeVolumeSource(each)[0])]
    if not shaders:
        text = "has no volume shader: extinction 1 and albedo 0.5 at density 1 are used"
        reading.warn(material.GetPrim(), text)
        return VolumeShading()
    shader = next((each for each in shaders if _reader(each) is not _other), shaders[0])
    return _reader(shader)(_VolumeNetwork(reading, prim, shader))


def _reader(shader: UsdShade.Shader) -> Callable[[_VolumeNetwork], VolumeShading]:
    kind = str(shader.GetShaderId() or "")
    if kind.removeprefix("arnold:") == "standard_volume":
        return _arnold
    if kind.startswith("ND_volume") or "anisotropic_vdf" in kind or "absorption_vdf" in kind:
        return _materialx
    return _coefficients if kind.split(":")[-1] == "kma_volume" else _other


class _VolumeNetwork:
    """A volume shader and the nodes connected to it, evaluated as products of constants and fields.

    Attributes
    ----------
    fields
        The volume's fields in the last value that was read, without the density.
    """

    def __init__(self, reading: Reading, prim: Usd.Prim, shader: UsdShade.Shader) -> None:
        self.reading, self.prim, self.shader = reading, prim, shader
        self.fields: list[str] = []

    def at(self, shader: UsdShade.Shader) -> _VolumeNetwork:
        """Return the network that begins at another of its nodes."""
        return _VolumeNetwork(self.reading, self.prim, shader)

    def source(self, name: str) -> UsdShade.Shader | None:
        """Return the node that is connected to an input, or None."""
        output = self._attribute(self.shader, name)
        return UsdShade.Shader(output.GetPrim()) if output is not None and is_output(output) else None

    def text(self, name: str, default: str) -> str:
        """Return an input that is a string."""
        attribute = self._attribute(self.shader, name)
        value = None if attribute is None else attribute.Get(self.reading.time)
        return value if isinstance(value, str) else default

    def number(self, name: str, default: float, minimum: float = 0.0, maximum: float = np.inf) -> float:
        """Return a number input; a value out of range is clipped, with a warning."""
        found = float(np.mean(self._checked(name, default)))
        if not minimum <= found <= maximum:
            text = f"is {found:g}: expected at least {minimum:g}{f' and at most {maximum:g}' if maximum < 9e9 else ''}"
            self.reading.warn(self.shader.GetPrim(), f"{text}; the nearest is used", f"inputs:{name}")
        return float(np.clip(found, minimum, maximum))

    def color(self, name: str, default: float) -> Color:
        """Return a colour input; negative numbers become 0, with a warning."""
        found = self._checked(name, default)
        if found.min() < 0:
            text = f"is {tuple(found.tolist())}: expected 0 or more; numbers below 0 count as 0"
            self.reading.warn(self.shader.GetPrim(), text, f"inputs:{name}")
        return color(np.maximum(found, 0), self.reading.place(self.shader.GetPrim(), f"inputs:{name}"))

    def fraction(self, name: str, value: Array | Color, minimum: float = 0.0) -> Array:
        """Return a colour, from the input `name`, whose numbers are at most 1; those out of range give a warning."""
        result = np.clip(value, minimum, 1)
        if np.any(np.less(value, minimum)) or np.any(np.greater(value, 1 + 1e-5)):
            text = f"makes {tuple(np.round(value, 6).tolist())}: expected {minimum:g} to 1; the nearest is used"
            self.reading.warn(self.shader.GetPrim(), text, f"inputs:{name}")
        return np.asarray(result)

    def _checked(self, name: str, default: float) -> Array:
        """Return an input as finite numbers, one or three of them."""
        self.fields = []
        found = self._value(self.shader, name, default, 0)
        if found.size in (1, 3) and np.all(np.isfinite(found)):
            return found
        raise self.reading.fail(self.shader.GetPrim(), f"inputs:{name}", f"is {found}: expected one or three numbers")

    def _attribute(self, node: UsdShade.Shader, name: str) -> Usd.Attribute | None:
        source = node.GetInput(name)
        attributes = UsdShade.Utils.GetValueProducingAttributes(source) if source else []
        return attributes[0] if attributes else None

    def _value(self, node: UsdShade.Shader, name: str, default: float, depth: int) -> Array:
        attribute = self._attribute(node, name)
        if attribute is None or depth > _DEEPEST:
            return np.asarray(default, dtype=np.float64)
        if is_output(attribute):
            return self._node(UsdShade.Shader(attribute.GetPrim()), default, depth + 1)
        value = attribute.Get(self.reading.time)
        try:
            found = np.asarray(default if value is None else value, dtype=np.float64)
        except (TypeError, ValueError):
            raise self.reading.fail(attribute.GetPrim(), attribute.GetName(), f"is {value}: expected numbers") from None
        return self.reading.in_working_space(attribute, found)

    def _node(self, node: UsdShade.Shader, default: float, depth: int) -> Array:
        """Evaluate a node: products of constants, primvars and fields; any other node returns its input."""
        kind = str(node.GetShaderId() or "")
        if "multiply" in kind:
            return self._value(node, "in1", 1.0, depth) * self._value(node, "in2", 1.0, depth)
        if "constant" in kind:
            return self._value(node, "value", default, depth)
        for key in ("geomprop", "fieldname", "varname", "attribute"):
            named = self._attribute(node, key)
            if named is not None:
                return self._property(node, str(named.Get(self.reading.time)), default, depth)
        if not any(each in kind for each in ("convert", "dot", "swizzle", "extract")):
            text = f"is a node '{kind}', which is not evaluated: its input is used as it is"
            self.reading.warn(node.GetPrim(), text)
        return self._value(node, "in", default, depth)

    def _property(self, node: UsdShade.Shader, name: str, default: float, depth: int) -> Array:
        """Return a primvar of the volume, or 1 for a field, which is added to `fields`."""
        if field_of(self.reading, self.prim, name) is not None:
            self.fields += [name] if name != DENSITY else []
            return np.asarray(1.0)
        primvar = UsdGeom.PrimvarsAPI(self.prim).FindPrimvarWithInheritance(name)
        value = primvar.Get(self.reading.time) if primvar else None
        if value is None:
            fallback = "fallback" if self._attribute(node, "fallback") is not None else "default"
            return self._value(node, fallback, default, depth)
        return np.asarray(value, dtype=np.float64).reshape(-1)[:3]


def _arnold(network: _VolumeNetwork) -> VolumeShading:
    """Read Arnold's standard_volume: `transparent` is the transmittance over `transparent_depth` at density 1."""
    depth = network.number("transparent_depth", 1.0, 1e-6)
    transparent = network.fraction("transparent", network.color("transparent", np.exp(-1.0)), 1e-6)
    extinction = network.number("density", 1.0) * -np.log(transparent) / depth
    scattered = network.number("scatter", 1.0) * np.array(network.color("scatter_color", _ALBEDO))
    albedo = network.fraction("scatter_color", scattered)
    if network.text("transparent_channel", ""):
        network.reading.warn(network.shader.GetPrim(), "is not rendered: it is ignored", "inputs:transparent_channel")
    return VolumeShading(
        tuple(albedo * extinction),
        tuple((1 - albedo) * extinction),
        network.number("scatter_anisotropy", 0.0, -_ANISOTROPY, _ANISOTROPY),
        network.text("density_channel", DENSITY) or DENSITY,
        network.text("scatter_color_channel", ""),
        _arnold_emission(network),
    )


def _arnold_emission(network: _VolumeNetwork) -> VolumeEmission | None:
    mode = network.text("emission_mode", "blackbody")
    strength = network.number("emission", 1.0) * np.array(network.color("emission_color", 1.0))
    if mode == "none" or not strength.any():
        return None
    if mode == "blackbody":
        kelvin = network.number("temperature", 1.0) * network.number("blackbody_kelvin", 5000.0)
        strength = strength * network.number("blackbody_intensity", 1.0)
        return VolumeEmission(tuple(strength), network.text("temperature_channel", "temperature"), kelvin)
    key, default = ("density_channel", DENSITY) if mode == "density" else ("emission_channel", "heat")
    return VolumeEmission(tuple(strength), network.text(key, default))


def _materialx(network: _VolumeNetwork) -> VolumeShading:
    """Read MaterialX's `volume`, which has a vdf and perhaps an edf."""
    nodes = [network.shader, *(network.source(name) for name in ("vdf", "edf"))]
    coefficients = VolumeShading(BLACK, BLACK)
    emission = None
    for node in filter(None, nodes):
        kind = str(node.GetShaderId() or "")
        if "_vdf" in kind:
            coefficients = _coefficients(network.at(node))
        elif "_edf" in kind:
            emission = _emission(network.at(node), "color")
    if coefficients.scattering == coefficients.absorption == BLACK:
        network.reading.warn(network.shader.GetPrim(), "scatters and absorbs nothing: expected a vdf that does")
    return VolumeShading(
        coefficients.scattering, coefficients.absorption, coefficients.anisotropy, DENSITY, coefficients.color, emission
    )


def _coefficients(network: _VolumeNetwork) -> VolumeShading:
    """Read absorption, scattering and anisotropy of MaterialX's vdf, or of Karma's volume, which adds emission."""
    absorption = network.color("absorption", 0.0)
    scattering = network.color("scattering", 0.0)
    fields = network.fields
    anisotropy = network.number("anisotropy", 0.0, -_ANISOTROPY, _ANISOTROPY)
    emission = _emission(network, "emission")
    return VolumeShading(scattering, absorption, anisotropy, DENSITY, fields[0] if fields else "", emission)


def _emission(network: _VolumeNetwork, name: str) -> VolumeEmission | None:
    found = network.color(name, 0.0)
    fields = network.fields
    return VolumeEmission(found, fields[0] if fields else DENSITY) if any(found) else None


def _other(network: _VolumeNetwork) -> VolumeShading:
    """Read a shader of another kind, by the input names that most shaders use."""
    shader, kind = network.shader.GetPrim(), str(network.shader.GetShaderId() or "none")
    text = f"is a volume shader '{kind}', which is not known: its densityScale, albedo and anisotropy are used"
    network.reading.warn(shader, text)

    def first(*names: str) -> str:
        return next((each for each in names if network.shader.GetInput(each)), names[0])

    density = network.number(first("densityScale", "densityscale", "density_scale", "density"), 1.0)
    name = first("albedo", "scatter_color", "scattercolor", "color")
    albedo = network.fraction(name, network.color(name, _ALBEDO))
    anisotropy = network.number(first("anisotropy", "phase", "g"), 0.0, -_ANISOTROPY, _ANISOTROPY)
    return VolumeShading(tuple(density * albedo), tuple(density * (1 - albedo)), anisotropy)
