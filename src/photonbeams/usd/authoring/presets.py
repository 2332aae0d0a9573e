"""Looks to start from: values of `PhotonBeamsLook` attributes by name, for whole looks and for single factors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from ...scene import SceneError
from ..common.definitions import LOOK, PREFIX, definitions
from ..common.openusd import Sdf, Usd
from ..common.reading import Reading, file_of, prims_under, target_paths
from ..common.warnings import Warnings
from ..lights.light import is_dome, is_light
from ..looks.look import LookSpec, read_look
from .editing import EditLayer

#: Length, in scene units, of the beam that the lengths of presets are made for: the beam of `images.swatches`.
BEAM = 4.0

_EMBER = {
    "along:ramp:knots": [0, 0.35, 0.7, 1],
    "along:ramp:colors": [[1, 0.95, 0.8], [1, 0.6, 0.2], [0.8, 0.15, 0.1], [0.2, 0.05, 0.3]],
}
_RAINBOW = {
    "along:ramp:knots": [0, 0.18, 0.34, 0.5, 0.66, 0.82, 1],
    "along:ramp:colors": [
        [1, 0.08, 0.05], [1, 0.4, 0.02], [1, 0.9, 0.05], [0.1, 0.85, 0.15], [0.05, 0.7, 1], [0.12, 0.2, 1],
        [0.6, 0.1, 1],
    ],
    "along:ramp:interpolation": "smooth",
}  # fmt: skip
_PULSES = {"along:expression": "(0.15 + wave(5 * s - time) ** 3) * [1, 0.75 - 0.3 * s, 0.35]"}
_TORN = {
    "across:profile": "constant",
    "across:expression": "smoothstep(0, 0.3, 0.75 + 0.5 * snoise(2.5 * P, 0.3 * time) - r)",
}
_HOLLOW = {"across:profile": "hollow", "across:inner": 0.6, "across:softness": 0.8}
_SMOKE = {"noise:amount": 1, "noise:octaves": 5, "noise:contrast": 3, "noise:evolution": 0.15}
_SMOKE_LENGTHS = {"noise:scale": 0.8, "noise:drift": [0, 0.08, 0]}
_DUST = {"noise:amount": 0.9, "noise:evolution": 0.1}
_DUST_LENGTHS = {"noise:scale": 0.5, "noise:drift": [0.03, 0.05, 0]}
_EVEN = {"along:falloff": "none", "along:physical": False}
_FADING = {"along:falloff": "polynomial", "along:coefficients": [1, 0, -1]}


@dataclass(frozen=True)
class Preset:
    """A look, or one factor of a look, to start from.

    Attributes
    ----------
    factor
        "look" for a whole look; else "along", "across", "eye", "angle" or "noise".
    label
        The name for people.
    values
        Values of attributes, by names without "photonbeams:"; other attributes of the factor have their defaults.
    lengths
        Values of attributes that are lengths, for a beam that is `BEAM` long.
    """

    factor: str
    label: str
    values: Mapping[str, Any] = field(default_factory=dict)
    lengths: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The preset's name for programs, such as "look-soft-shaft"."""
        return f"{self.factor}-{self.label.lower().replace(' ', '-')}"

    def attributes(self, unit: float = 1.0) -> dict[str, Any]:
        """Return values by the names of attributes, with lengths multiplied by `unit` and rounded to two digits."""
        lengths = {name: _scaled(value, unit) for name, value in self.lengths.items()}
        return {f"{PREFIX}{name}": value for name, value in {**self.values, **lengths}.items()}


def _scaled(value: Any, unit: float) -> Any:
    return [_scaled(each, unit) for each in value] if isinstance(value, list) else float(f"{unit * value:.2g}")


PRESETS = (
    Preset("look", "Physical"),
    Preset("look", "Soft shaft", {"across:profile": "gaussian", "across:width": 0.4, **_FADING}),
    Preset("look", "Laser", {
        **_EVEN, "along:tint": [0.25, 1, 0.35], "eye:falloff": "none", "across:profile": "tabulated",
        "across:values": [1, 1, 0.06, 0.04, 0.025, 0.015, 0.01, 0.005, 0],
    }),
    Preset("look", "Smoke", {**_SMOKE, "across:profile": "biweight"}, _SMOKE_LENGTHS),
    Preset("look", "Dust", {**_DUST, "along:tint": [1, 0.9, 0.75], "across:profile": "biweight"},
           {**_DUST_LENGTHS, "along:inner": 1.5, "along:outer": 4}),
    Preset("look", "Hollow", _HOLLOW),
    Preset("look", "Tube", {
        "across:profile": "hollow", "across:inner": 0.55, "across:ramp:knots": [0.55, 0.75, 1],
        "across:ramp:colors": [[0.1, 0.5, 1], [0.7, 0.3, 1], [1, 0.2, 0.3]],
    }),
    Preset("look", "Ember", {**_EMBER, "across:profile": "smoothstep", "across:hardness": 0.2}),
    Preset("look", "Rainbow", {**_RAINBOW, "across:profile": "biweight"}),
    Preset("look", "Fading", _FADING),
    Preset("look", "Glow", {
        "across:profile": "gaussian", "across:width": 0.3, "angle:shading": "glow", "angle:mix": 0.6, "angle:gain": 2,
    }),
    Preset("look", "Pulses", _PULSES),
    Preset("look", "Torn", {**_TORN, "variation": 0.3}),
    Preset("look", "Deep water", {
        "along:ramp:knots": [0, 0.45, 1], "along:ramp:colors": [[0.75, 1, 0.9], [0.1, 0.55, 0.7], [0.02, 0.1, 0.35]],
        "along:ramp:interpolation": "monotone", "across:profile": "biweight", "variation": 0.6,
    }),
    Preset("along", "Physical"),
    Preset("along", "Even", _EVEN),
    Preset("along", "Fading", _FADING),
    Preset("along", "Growing", {"along:falloff": "polynomial", "along:coefficients": [0.05, 0, 0.95]}),
    Preset("along", "Short", {"along:falloff": "exponential"}, {"along:length": 0.8}),
    Preset("along", "From the light", {"along:falloff": "power", "along:exponent": 2}, {"along:length": 0.5}),
    Preset("along", "Ember", _EMBER),
    Preset("along", "Rainbow", _RAINBOW),
    Preset("along", "Two colours", {
        "along:ramp:knots": [0, 0.5], "along:ramp:colors": [[1, 0.6, 0.15], [0.15, 0.4, 1]],
        "along:ramp:interpolation": "none",
    }),
    Preset("along", "Bands", {"along:expression": "0.15 + 0.85 * smoothstep(0.35, 0.65, triangle(8 * s))"}),
    Preset("along", "Pulses", _PULSES),
    Preset("across", "Soft"),
    Preset("across", "Hard", {"across:profile": "constant"}),
    Preset("across", "Softer", {"across:profile": "biweight"}),
    Preset("across", "Core", {"across:profile": "gaussian", "across:width": 0.2}),
    Preset("across", "Flat", {"across:profile": "smoothstep", "across:hardness": 0.6}),
    Preset("across", "Hollow", _HOLLOW),
    Preset("across", "Double", {"across:profile": "tabulated", "across:values": [1, 0.7, 0.1, 0.1, 0.6, 0.5, 0]}),
    Preset("across", "White core", {
        "across:profile": "biweight", "across:ramp:knots": [0, 0.35, 1],
        "across:ramp:colors": [[1, 1, 1], [1, 0.6, 0.25], [0.9, 0.1, 0.4]],
    }),
    Preset("across", "Torn", _TORN),
    Preset("eye", "Physical"),
    Preset("eye", "None", {"eye:falloff": "none"}),
    Preset("eye", "Short", {"eye:falloff": "exponential"}, {"eye:length": 1.5}),
    Preset("eye", "Into the blue", {
        "eye:falloff": "none", "eye:ramp:knots": [0, 1], "eye:ramp:colors": [[1, 0.85, 0.6], [0.15, 0.35, 1]],
    }, {"eye:begin": 0, "eye:end": 6}),
    Preset("angle", "Physical"),
    Preset("angle", "Even", {"angle:shading": "constant"}),
    Preset("angle", "Glow", {"angle:shading": "glow"}),
    Preset("angle", "Flare", {
        "angle:shading": "glow", "angle:anisotropy": 0.9, "angle:mix": 0.8, "angle:gain": 3,
    }),
    Preset("angle", "Iridescent", {
        "angle:shading": "constant", "angle:ramp:knots": [0, 0.3, 0.5, 0.7, 1],
        "angle:ramp:colors": [[1, 0.8, 0.3], [1, 0.25, 0.5], [0.5, 0.3, 1], [0.15, 0.7, 1], [0.2, 1, 0.6]],
        "angle:ramp:interpolation": "smooth",
    }),
    Preset("noise", "None"),
    Preset("noise", "Dust", _DUST, _DUST_LENGTHS),
    Preset("noise", "Smoke", _SMOKE, _SMOKE_LENGTHS),
    Preset("noise", "Haze", {"noise:amount": 0.5, "noise:octaves": 2, "noise:contrast": 1}, {"noise:scale": 1.2}),
)  # fmt: skip


def preset_of(name: str) -> Preset:
    """Return the preset of a name; SceneError if there is none."""
    found = next((each for each in PRESETS if each.name == name), None)
    if found is None:
        raise SceneError(f"there is no preset {name!r}: expected one such as {PRESETS[1].name}")
    return found


@cache
def preset_look(name: str) -> LookSpec:
    """Return the look of the preset of this name: see `look_of`."""
    return look_of(preset_of(name))


def look_of(preset: Preset) -> LookSpec:
    """Return the look of a preset applied to an empty look, for a beam that is `BEAM` long."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Look", LOOK)
    layer = EditLayer(stage)
    for attribute, value in preset.attributes().items():
        layer.set(str(prim.GetPath().AppendProperty(attribute)), value)
    return read_look(Reading(stage, None, Warnings(strict=True)), prim, prim)


def apply_preset(stage: Usd.Stage, layer: EditLayer, preset: Preset, path: str, unit: float = 1.0) -> str:
    """Apply a preset to a look, or give a light a new look of that kind, and return the look's path.

    A light that made no beams makes some then. The stage's own values of the preset's factor lose their effect.

    Parameters
    ----------
    layer
        The layer over the stage that takes the values.
    path
        The path of the look or of the light.
    unit
        How many times longer the stage's beams are than `BEAM`.

    Raises
    ------
    SceneError
        The prim is neither, or cannot have a look.
    """
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if prim and prim.GetTypeName() == LOOK:
        look = path
    elif prim and is_light(prim):
        look = str(_free_path(stage, prim, preset))
        layer.define(look, LOOK)
        layer.set(f"{path}.photonbeams:look", [look])
        enabled = prim.GetAttribute("photonbeams:enabled")
        authored = enabled.HasAuthoredValue()
        if (authored and enabled.Get() is False) or (is_dome(prim) and not authored):
            layer.set(f"{path}.photonbeams:enabled", True)
    else:
        raise SceneError(f"{file_of(stage)} has no light or look {path} to apply a preset to")
    values = preset.attributes(unit)
    for name in _attributes(preset.factor):
        if name in values:
            layer.set(f"{look}.{name}", values[name])
        else:
            layer.leave(f"{look}.{name}")
    return look


def _attributes(factor: str) -> list[str]:
    """Return the names of a factor's attributes, or of all attributes of looks."""
    return [name for name in definitions(LOOK) if name.startswith(PREFIX if factor == "look" else f"{PREFIX}{factor}:")]


def _free_path(stage: Usd.Stage, light: Usd.Prim, preset: Preset) -> Sdf.Path:
    """Return a path for a new look: beside the existing looks, or in a scope under the light's root prim."""
    folder = next(_folders(stage, light))
    name = "".join(each.capitalize() for each in preset.label.split())
    numbers = ("", *map(str, range(1, 10_000)))
    free = (path for each in numbers if not stage.GetPrimAtPath(path := folder.AppendChild(f"{name}{each}")))
    return next(free)


def _folders(stage: Usd.Stage, light: Usd.Prim) -> Iterator[Sdf.Path]:
    own = [stage.GetPrimAtPath(each) for each in target_paths(light, "photonbeams:look")]
    for look in (*own, *prims_under(stage.GetPseudoRoot())):
        if look and look.GetTypeName() == LOOK and not look.IsInstanceProxy():
            yield look.GetPath().GetParentPath()
    world = light.GetPath().GetPrefixes()[0]
    yield (Sdf.Path("/") if world == light.GetPath() else world).AppendChild("Looks")
