"""Controls for editing a stage: those of its lights, media and looks, with their values and documentation.

Names, types, defaults, choices and texts come from the schemas; ranges are those that the readers accept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..common import schemas as schemas
from ..common.openusd import Gf, Sdf, Usd, UsdGeom, UsdLux
from ..common.reading import Reading, prims_under, target_paths
from ..lights.lights import is_dome, is_light
from ..media.medium import is_medium

# Least and greatest values that the readers accept, and the ranges of sliders, by the ends of attribute names.
_RANGES: Mapping[str, tuple[float | None, float | None]] = {
    "anisotropy": (-0.99, 0.99), "mix": (0, 1), "gain": (0, None), "width": (0, None), "hardness": (0, 1),
    "across:inner": (0, 0.99), "softness": (0.01, 1), "amount": (0, 1), "contrast": (0, 100), "variation": (0, 1),
    "octaves": (1, 8), "count": (1, 100_000_000), "intensity": (0, None), "radius": (0, None), "height": (0, None),
    "length": (0, None), "exponent": (0, None), "along:inner": (0, None), "outer": (0, None), "bounces": (0, 64),
    "cone:angle": (0, 180), "cone:softness": (0, 1), "focus": (0, None), "gobo:angle": (0, 180),
    "inputs:angle": (0, 360), "colorTemperature": (1000, 10000), "farDistance": (0, None), "exposure": (None, None),
    "diffuse": (0, None), "scale": (0, None),
}  # fmt: skip
_SLIDERS: Mapping[str, tuple[float, float]] = {
    "exposure": (-10, 10), "across:width": (0.02, 2), "contrast": (0, 10), "count": (256, 16384),
    "focus": (0, 50), "bounces": (0, 8),
}  # fmt: skip
_UNITS: Mapping[str, str] = {
    "cone:angle": "°",
    "gobo:angle": "°",
    "inputs:angle": "°",
    "colorTemperature": "K",
    "exposure": "stops",
}
_RAMP = ("knots", "colors", "interpolation")

# The inputs of UsdLux lights that the renderer reads, in the order of the page.
_LIGHT_INPUTS = (
    "inputs:intensity", "inputs:exposure", "inputs:color", "inputs:enableColorTemperature", "inputs:colorTemperature",
    "inputs:normalize", "inputs:radius", "inputs:width", "inputs:height", "inputs:length", "inputs:angle",
    "inputs:diffuse", "inputs:texture:file", "inputs:shaping:cone:angle", "inputs:shaping:cone:softness",
    "inputs:shaping:focus", "inputs:shaping:focusTint",
)  # fmt: skip


@dataclass(frozen=True)
class Control:
    """One value that can be edited.

    Attributes
    ----------
    path, label, section
        The path of the attribute or relationship, its name for people, and the section of the page that it is in.
    kind
        One of number, integer, bool, color, numbers, choice, text, expression, asset, paths or ramp.
    value, default
        The value now, and the value if nothing is set, as in JSON; None: no value.
    authored
        Whether the stage, or an edit, sets it.
    least, most
        The bounds of a number; None: no bound.
    slider
        The range of a slider.
    choices
        The allowed values: texts, or paths of prims.
    unit, doc
        The unit, and a text that explains it.
    parts
        For a ramp, the paths of its knots, colors and interpolation.
    """

    path: str
    label: str
    section: str
    kind: str
    value: Any
    default: Any
    authored: bool
    least: float | None = None
    most: float | None = None
    slider: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    doc: str = ""
    parts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Controls:
    """The controls of a prim: its path, kind ("light", "medium" or "look"), type, and the looks that it uses."""

    path: str
    kind: str
    label: str
    type: str
    controls: tuple[Control, ...]
    uses: tuple[str, ...] = ()


def controls_of(stage: Usd.Stage, time: Any = None) -> list[Controls]:
    """Return the controls of the lights, media and looks of a stage, with their values at a time."""
    reading = Reading(stage, time)
    looks, media, lights = [], [], []
    for prim in prims_under(stage.GetPseudoRoot()):
        if prim.IsInstanceProxy():
            continue
        if prim.GetTypeName() == "PhotonBeamsLook":
            looks.append(prim)
        elif is_light(prim):
            lights.append(prim)
        elif is_medium(reading, prim):
            media.append(prim)
    paths = {"PhotonBeamsLook": tuple(str(each.GetPath()) for each in looks)}
    found = [_of_prim(reading, prim, "light", paths) for prim in lights]
    found += [_of_prim(reading, prim, "medium", paths) for prim in media]
    return found + [_of_prim(reading, prim, "look", paths) for prim in looks]


def _of_prim(reading: Reading, prim: Usd.Prim, kind: str, paths: Mapping[str, tuple[str, ...]]) -> Controls:
    controls = tuple(_controls(reading, prim, kind, paths))
    uses = tuple(str(each) for each in target_paths(prim, "photonbeams:look")) if kind == "light" else ()
    return Controls(str(prim.GetPath()), kind, prim.GetName(), str(prim.GetTypeName()), controls, uses)


def _controls(
    reading: Reading, prim: Usd.Prim, kind: str, paths: Mapping[str, tuple[str, ...]]
) -> Iterator[Control]:  # fmt: skip
    if kind == "light":
        if prim.IsA(UsdGeom.Imageable):
            yield _shown(reading, prim)
        for name in _LIGHT_INPUTS:
            if attribute := _attribute(prim, name):
                yield _control(reading, prim, attribute, "Light")
    definition = _definition(kind)
    names = [name for name in definition.GetPropertyNames() if name.startswith("photonbeams:")]
    for name in names:
        slot, _, rest = name.removeprefix("photonbeams:").partition(":")
        section = (
            slot.capitalize() if kind == "look" and rest else {"light": "Beams", "medium": "Fog"}.get(kind, "Look")
        )
        if name.endswith(":ramp:knots"):
            yield _ramp(reading, prim, definition, name.removesuffix(":knots"), section)
        elif ":ramp:" not in name:
            yield _defined(reading, prim, definition, name, section, paths)


def _definition(kind: str) -> Usd.PrimDefinition:
    registry = Usd.SchemaRegistry()
    if kind == "look":
        return registry.FindConcretePrimDefinition("PhotonBeamsLook")
    return registry.FindAppliedAPIPrimDefinition("PhotonBeamsLightAPI" if kind == "light" else "PhotonBeamsMediumAPI")


def _attribute(prim: Usd.Prim, name: str) -> Any:
    """Return the definition of a UsdLux attribute that a light has, or would have with ShapingAPI; else None."""
    attribute = prim.GetPrimDefinition().GetAttributeDefinition(name)
    if attribute:
        return attribute
    if name.startswith("inputs:shaping:") and prim.IsA(UsdLux.SphereLight):
        shaping = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("ShapingAPI")
        return shaping.GetAttributeDefinition(name)
    return None


def _shown(reading: Reading, prim: Usd.Prim) -> Control:
    path = str(prim.GetPath().AppendProperty("visibility"))
    value = str(reading.value(prim, "visibility", "inherited"))
    authored = prim.GetAttribute("visibility").HasAuthoredValue()
    choices, doc = ("inherited", "invisible"), "Whether the light is on: an invisible one does not shine."
    return Control(path, "Visibility", "Light", "choice", value, "inherited", authored, choices=choices, doc=doc)


def _control(reading: Reading, prim: Usd.Prim, attribute: Any, section: str) -> Control:
    """Return the control of an attribute, given its definition."""
    name, kind, fallback = attribute.GetName(), attribute.GetTypeName(), attribute.GetFallbackValue()
    default = _plain(fallback)
    own = prim.GetAttribute(name)
    authored = bool(own) and own.HasAuthoredValue()
    value = _plain(reading.value(prim, name, fallback)) if authored else default
    least, most = _ending(_RANGES, name) or (None, None)
    tokens = attribute.GetMetadata("allowedTokens") or ()
    shape = _kind_of(kind, name, bool(tokens))
    slider = _slider(name, least, most, value if value is not None else default) if shape in _NUMBERS else None
    documentation = " ".join(str(attribute.GetDocumentation() or "").split())
    return Control(
        str(prim.GetPath().AppendProperty(name)), _label(name), section, shape, value, default, authored,
        least, most, slider, tuple(map(str, tokens)), _ending(_UNITS, name) or "", documentation,
    )  # fmt: skip


def _defined(
    reading: Reading, prim: Usd.Prim, definition: Usd.PrimDefinition, name: str, section: str,
    paths: Mapping[str, tuple[str, ...]],
) -> Control:  # fmt: skip
    attribute = definition.GetAttributeDefinition(name)
    if attribute:
        control = _control(reading, prim, attribute, section)
        return _of_kind(control, prim) if name == "photonbeams:enabled" else control
    relationship = definition.GetRelationshipDefinition(name)
    targets = [str(each) for each in target_paths(prim, name)]
    authored = prim.HasRelationship(name) and prim.GetRelationship(name).HasAuthoredTargets()
    choices = paths["PhotonBeamsLook"] if name.endswith(":look") else ()
    documentation = " ".join(str(relationship.GetDocumentation() or "").split())
    path = str(prim.GetPath().AppendProperty(name))
    return Control(path, _label(name), section, "paths", targets, [], authored, choices=choices, doc=documentation)


def _of_kind(control: Control, prim: Usd.Prim) -> Control:
    """Return the control of whether a light makes beams, whose default depends on the kind of light."""
    does = not is_dome(prim)
    return replace(control, default=does, value=control.value if control.authored else does)


def _ramp(reading: Reading, prim: Usd.Prim, definition: Usd.PrimDefinition, name: str, section: str) -> Control:
    """Return the control of a ramp, three attributes in one."""
    parts = [_control(reading, prim, definition.GetAttributeDefinition(f"{name}:{part}"), section) for part in _RAMP]
    named = dict(zip(_RAMP, parts, strict=True))
    value, default = ({key: getattr(each, which) for key, each in named.items()} for which in ("value", "default"))
    return Control(
        str(prim.GetPath().AppendProperty(name)), "Ramp", section, "ramp", value, default,
        any(each.authored for each in parts), choices=named["interpolation"].choices,
        doc="Colours between knots, as a factor.", parts={key: each.path for key, each in named.items()},
    )  # fmt: skip


_NUMBERS = ("number", "integer")


def _kind_of(kind: Sdf.ValueTypeName, name: str, chosen: bool) -> str:
    if chosen:
        return "choice"
    if name.endswith("expression"):
        return "expression"
    if kind.role == "Color" and not kind.isArray:
        return "color"
    if kind.isArray or isinstance(kind.defaultValue, Gf.Vec2f | Gf.Vec3f | Gf.Vec3d):
        return "numbers"
    default = kind.defaultValue
    kinds = ((bool, "bool"), (int, "integer"), (float, "number"), (Sdf.AssetPath, "asset"))
    return next((shape for each, shape in kinds if isinstance(default, each)), "text")


def _slider(name: str, least: float | None, most: float | None, value: Any) -> tuple[float, float]:
    """Return the range of a slider: the bounds of the value or, without bounds, twice the present value."""
    if (known := _ending(_SLIDERS, name)) is not None:
        return known
    size = max(2 * abs(float(value)), 1.0) if isinstance(value, int | float) else 1.0
    return (least if least is not None else -size), (most if most is not None else size)


def _ending(table: Mapping[str, Any], name: str) -> Any:
    """Return the entry of a table for the longest key that the name ends with, or None."""
    ends = [end for end in table if name == end or name.endswith(f":{end}")]
    return table[max(ends, key=len)] if ends else None


def _label(name: str) -> str:
    """Return a label for people: "inputs:shaping:cone:angle" is "Shaping cone angle"."""
    words = [word for word in name.split(":") if word not in ("inputs", "photonbeams")]
    if words[0] in ("along", "across", "eye", "angle", "noise") and len(words) > 1:
        words = words[1:]
    spaced = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in " ".join(words))
    return spaced.strip().capitalize()


def _plain(value: Any) -> Any:
    """Return a USD value as JSON represents it."""
    if isinstance(value, float):  # most are 32-bit floats: show them as they were written
        return float(str(np.float32(value))) if np.float32(value) == value else value
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Sdf.AssetPath):
        return value.path
    return [_plain(each) for each in value]
