"""Read volume shaders: Arnold's standard_volume, MaterialX's and Karma's volumes, and others in part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...scene import BLACK, Array, Color, color
from ..common import blender
from ..common.openusd import Usd, UsdShade
from ..common.reading import Reading
from ..geometry.primvars import find_primvar
from ..materials.bound import bound_to
from ..materials.network import Network
from ..materials.nodes import NODES
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
    shaders = [shader for each in _CONTEXTS if (shader := material.ComputeVolumeSource(each)[0])]
    if not shaders:
        text = "has no volume shader: extinction 1 and albedo 0.5 at density 1 are used"
        reading.warn(material.GetPrim(), text)
        return VolumeShading()
    shader = next((each for each in shaders if _reader(each) is not _other), shaders[0])
    inputs = _VolumeInputs(Network(reading, NODES), prim, shader)
    shading = _reader(shader)(inputs)
    for loss in inputs.network.losses:
        loss()
    return shading


def _reader(shader: UsdShade.Shader) -> Callable[[_VolumeInputs], VolumeShading]:
    kind = str(shader.GetShaderId() or "")
    if kind.removeprefix("arnold:") == "standard_volume":
        return _arnold
    if kind.startswith("ND_volume") or "anisotropic_vdf" in kind or "absorption_vdf" in kind:
        return _materialx
    return _coefficients if kind.split(":")[-1] == "kma_volume" else _other


@dataclass
class _VolumeInputs:
    """The inputs of a shader on a volume: products of constants, primvars and fields.

    `field` is the volume's field in the last value that was read, "" without one or for the density.
    """

    network: Network
    prim: Usd.Prim
    shader: UsdShade.Shader
    field: str = ""

    def warn(self, text: str, name: str = "") -> None:
        """Warn about the shader, or one of its inputs."""
        self.network.reading.warn(self.shader.GetPrim(), text, f"inputs:{name}" if name else "")

    def text(self, name: str, default: str) -> str:
        """Return an input that is a string."""
        value = self.network.plain(self.shader, name)
        return value if isinstance(value, str) else default

    def number(self, name: str, default: float, minimum: float = 0.0, maximum: float = np.inf) -> float:
        """Return a number input; a value out of range is clipped, with a warning."""
        value = float(np.mean(self._numbers(name, default)))
        if not minimum <= value <= maximum:
            most = f" and at most {maximum:g}" if maximum < np.inf else ""
            self.warn(f"is {value:g}: expected at least {minimum:g}{most}; the nearest is used", name)
        return float(np.clip(value, minimum, maximum))

    def color(self, name: str, default: float) -> Color:
        """Return a colour input; negative numbers become 0, with a warning."""
        value = self._numbers(name, default)
        if value.min() < 0:
            self.warn(f"is {tuple(value.tolist())}: expected 0 or more; numbers below 0 count as 0", name)
        return color(np.maximum(value, 0), name)

    def fraction(self, name: str, value: Array | Color, minimum: float = 0.0) -> Array:
        """Return a colour, from the input `name`, whose numbers are at most 1; those out of range give a warning."""
        if np.any(np.less(value, minimum)) or np.any(np.greater(value, 1 + 1e-5)):
            text = f"makes {tuple(np.round(value, 6).tolist())}: expected {minimum:g} to 1; the nearest is used"
            self.warn(text, name)
        return np.clip(value, minimum, 1)

    def _numbers(self, name: str, default: float) -> Array:
        """Return an input as one or three finite numbers."""
        self.field = ""
        value = self.network.value(self.shader, name)
        numbers = np.full(1, default) if value is None else self._on_volume(value)
        if numbers.size in (1, 3) and np.all(np.isfinite(numbers)):
            return numbers
        text = f"is {numbers}: expected one or three numbers"
        raise self.network.reading.fail(self.shader.GetPrim(), f"inputs:{name}", text)

    def _on_volume(self, value: Value) -> Array:
        """Return a value where the fields of the volume are 1."""
        if not isinstance(value, PrimvarValue):
            return constant(value)
        reading = self.network.reading
        if field_of(reading, self.prim, value.name) is not None:
            self.field = value.name if value.name != DENSITY else ""
            return value.function(np.ones((1, 1)))[0]
        primvar = find_primvar(self.prim, value.name)
        if primvar is None:
            return value.fallback
        numbers = np.asarray(primvar.Get(reading.time), dtype=np.float64)
        return value.function(numbers.reshape(1, -1)[:, :3])[0]


def _arnold(inputs: _VolumeInputs) -> VolumeShading:
    """Read Arnold's standard_volume: `transparent` is the transmittance over `transparent_depth` at density 1."""
    depth = inputs.number("transparent_depth", 1.0, 1e-6)
    transparent = inputs.fraction("transparent", inputs.color("transparent", np.exp(-1.0)), 1e-6)
    extinction = inputs.number("density", 1.0) * -np.log(transparent) / depth
    scattered = inputs.number("scatter", 1.0) * np.array(inputs.color("scatter_color", _ALBEDO))
    albedo = inputs.fraction("scatter_color", scattered)
    if inputs.text("transparent_channel", ""):
        inputs.warn("is not rendered: it is ignored", "transparent_channel")
    return VolumeShading(
        scattering=tuple(albedo * extinction),
        absorption=tuple((1 - albedo) * extinction),
        anisotropy=inputs.number("scatter_anisotropy", 0.0, -_ANISOTROPY, _ANISOTROPY),
        density=inputs.text("density_channel", "") or DENSITY,
        color=inputs.text("scatter_color_channel", ""),
        emission=_arnold_emission(inputs),
    )


def _arnold_emission(inputs: _VolumeInputs) -> VolumeEmission | None:
    mode = inputs.text("emission_mode", "blackbody")
    strength = inputs.number("emission", 1.0) * np.array(inputs.color("emission_color", 1.0))
    if mode == "none" or not strength.any():
        return None
    if mode == "blackbody":
        kelvin = inputs.number("temperature", 1.0) * inputs.number("blackbody_kelvin", 5000.0)
        strength = strength * inputs.number("blackbody_intensity", 1.0)
        return VolumeEmission(tuple(strength), inputs.text("temperature_channel", "temperature"), kelvin)
    key, default = ("density_channel", DENSITY) if mode == "density" else ("emission_channel", "heat")
    return VolumeEmission(tuple(strength), inputs.text(key, default))


def _materialx(inputs: _VolumeInputs) -> VolumeShading:
    """Read MaterialX's `volume`, which has a vdf and perhaps an edf."""
    nodes = [inputs.shader, *(inputs.network.connected(inputs.shader, name) for name in ("vdf", "edf"))]
    shading, emission = VolumeShading(BLACK, BLACK), None
    for node in filter(None, nodes):
        kind = str(node.GetShaderId() or "")
        if "_vdf" in kind:
            shading = _coefficients(replace(inputs, shader=node))
        elif "_edf" in kind:
            emission = _emission(replace(inputs, shader=node), "color")
    if shading.scattering == shading.absorption == BLACK:
        inputs.warn("scatters and absorbs nothing: expected a vdf that does")
    return replace(shading, emission=emission)


def _coefficients(inputs: _VolumeInputs) -> VolumeShading:
    """Read absorption, scattering and anisotropy of MaterialX's vdf, or of Karma's volume, which adds emission."""
    absorption, scattering = (inputs.color(name, 0.0) for name in ("absorption", "scattering"))
    field = inputs.field  # of the scattering
    anisotropy = inputs.number("anisotropy", 0.0, -_ANISOTROPY, _ANISOTROPY)
    return VolumeShading(scattering, absorption, anisotropy, color=field, emission=_emission(inputs, "emission"))


def _emission(inputs: _VolumeInputs, name: str) -> VolumeEmission | None:
    emitted = inputs.color(name, 0.0)
    return VolumeEmission(emitted, inputs.field or DENSITY) if any(emitted) else None


def _other(inputs: _VolumeInputs) -> VolumeShading:
    """Read a shader of another kind, by the input names that most shaders use."""
    kind = str(inputs.shader.GetShaderId() or "none")
    inputs.warn(f"is a volume shader '{kind}', which is not known: its densityScale, albedo and anisotropy are used")

    def first(*names: str) -> str:
        return next((each for each in names if inputs.shader.GetInput(each)), names[0])

    density = inputs.number(first("densityScale", "densityscale", "density_scale", "density"), 1.0)
    name = first("albedo", "scatter_color", "scattercolor", "color")
    albedo = inputs.fraction(name, inputs.color(name, _ALBEDO))
    anisotropy = inputs.number(first("anisotropy", "phase", "g"), 0.0, -_ANISOTROPY, _ANISOTROPY)
    return VolumeShading(tuple(density * albedo), tuple(density * (1 - albedo)), anisotropy)
