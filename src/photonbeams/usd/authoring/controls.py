"""Controls for editing a stage: those of its lights, media and looks, with their values and documentation.

Names, types, defaults, ranges, choices and texts are those of the schemas.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..common.definitions import BLOCKER, LIGHT, LOOK, MEDIUM, PREFIX, RAMP, Definition, definitions, plain
from ..common.openusd import Usd, UsdGeom, UsdLux
from ..common.reading import Reading, Time, prims_under, target_paths
from ..lights.light import is_dome, is_light
from ..media.medium import is_medium

_SHOWN = Definition(
    "visibility", "choice", "inherited", choices=("inherited", "invisible"),
    doc="Whether the light is on: an invisible one does not shine.",
)  # fmt: skip
# Choices of prims, groups and files: the most, how deep folders are searched, and what counts as an image.
_MOST_CHOICES, _DEEPEST = 200, 2
_IMAGES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".hdr", ".tx")
_GROUP = f"{PREFIX}lightGroup"
Choices = Mapping[str, tuple[str, ...]]

_RAMP = ("knots", "colors", "interpolation")
_SCHEMAS = {"light": LIGHT, "medium": MEDIUM, "look": LOOK}
_SECTIONS = {"light": "Beams", "medium": "Fog", "look": "Look"}

_POSITIVE = {"least": 0}
# The inputs of UsdLux lights that the renderer reads, in the order of the page, with what UsdLux's schemas do not say.
_LIGHT_INPUTS: Mapping[str, Mapping[str, Any]] = {
    "inputs:intensity": _POSITIVE, "inputs:exposure": {"slider": (-10, 10), "unit": "stops"}, "inputs:color": {},
    "inputs:enableColorTemperature": {},
    "inputs:colorTemperature": {"least": 1000, "most": 10000, "unit": "K"}, "inputs:normalize": {},
    **dict.fromkeys(("inputs:radius", "inputs:width", "inputs:height", "inputs:length"), _POSITIVE),
    "inputs:angle": {"least": 0, "most": 360, "unit": "°"}, "inputs:diffuse": _POSITIVE, "inputs:texture:file": {},
    "inputs:shaping:cone:angle": {"least": 0, "most": 180, "unit": "°"},
    "inputs:shaping:cone:softness": {"least": 0, "most": 1},
    "inputs:shaping:focus": {"least": 0, "slider": (0, 50)}, "inputs:shaping:focusTint": {},
}  # fmt: skip


#: What a value has to be: one of these, or with () anything but nothing, no and 0.
Wanted = tuple[Any, ...]

_SET: Wanted = ()
_UNSET: Wanted = (None,)
_BEAMS = ("count", "intensity", "guides", "look", "scattered")
# For each attribute, what others of its prim have to be, so that it has an effect. Our own are without their prefix.
_INPUTS: Mapping[str, Mapping[str, Wanted]] = {
    "inputs:colorTemperature": {"inputs:enableColorTemperature": (True,)},
    "inputs:shaping:focusTint": {"inputs:shaping:focus": _SET},
}
_LIGHT: Mapping[str, Mapping[str, Wanted]] = {
    "portal:gobo": {"portal": _SET}, "gobo:angle": {"gobo": _SET}, "gobo:width": {"gobo": _SET},
    "gobo:wrap": {"gobo": _SET}, **{name: {"enabled": (True,)} for name in _BEAMS},
}  # fmt: skip
_MEDIUM: Mapping[str, Mapping[str, Wanted]] = {
    "scattering": {"nearColor": _UNSET}, "absorption": {"nearColor": _UNSET}, "farColor": {"nearColor": _SET},
    "farDistance": {"nearColor": _SET}, "albedo": {"nearColor": _SET},
}  # fmt: skip
_LOOK: Mapping[str, Mapping[str, Wanted]] = {
    "along:length": {"along:falloff": ("exponential", "power")}, "along:exponent": {"along:falloff": ("power",)},
    "along:coefficients": {"along:falloff": ("polynomial",)},
    "along:inner": {"along:outer": _SET}, "along:fade": {"along:outer": _SET},
    "across:width": {"across:profile": ("gaussian",)}, "across:hardness": {"across:profile": ("smoothstep",)},
    "across:values": {"across:profile": ("tabulated",)}, "across:inner": {"across:profile": ("hollow",)},
    "across:softness": {"across:profile": ("hollow",)}, "eye:length": {"eye:falloff": ("exponential",)},
    **{f"angle:{name}": {"angle:shading": ("glow",)} for name in ("anisotropy", "mix", "gain")},
    **{
        f"noise:{name}": {"noise:amount": _SET}
        for name in ("scale", "octaves", "contrast", "drift", "evolution", "space")
    },
}  # fmt: skip
_OWN = {"light": _LIGHT, "medium": _MEDIUM, "look": _LOOK}


@dataclass(frozen=True, kw_only=True)
class Control(Definition):
    """One value that can be edited, and what its schema says about it.

    Attributes
    ----------
    kind
        As in `Definition`, or "ramp".
    default, choices
        The value if nothing is set, as in JSON; and the allowed values, texts or paths of prims.
    path, label, section
        The path of the attribute or relationship, its name for people, and the section of the page that it is in.
    value
        The value now, as in JSON; None: no value.
    authored
        Whether the stage, or an edit, sets it.
    parts
        For a ramp, the paths of its knots, colors and interpolation.
    needs
        What other attributes have to be, by their paths, so that this has an effect: one of the values; with none
        given, anything but nothing, no and 0.
    """

    path: str
    label: str
    section: str
    value: Any
    authored: bool
    parts: Mapping[str, str] = field(default_factory=dict)
    needs: Mapping[str, Wanted] = field(default_factory=dict)


@dataclass(frozen=True)
class Controls:
    """The controls of a prim: its path, kind ("light", "medium" or "look"), type, and the looks that it uses."""

    path: str
    kind: str
    label: str
    type: str
    controls: tuple[Control, ...]
    uses: tuple[str, ...] = ()


def controls_of(stage: Usd.Stage, time: Time = None) -> list[Controls]:
    """Return the controls of the lights, media and looks of a stage, with their values at a time."""
    reading = Reading(stage, time)
    looks, media, lights, portals, guides = [], [], [], [], []
    for prim in prims_under(stage.GetPseudoRoot()):
        if prim.IsInstanceProxy():
            continue
        if prim.GetTypeName() == LOOK:
            looks.append(prim)
        elif is_light(prim):
            lights.append(prim)
        elif is_medium(reading, prim):
            media.append(prim)
        elif prim.IsA(UsdGeom.BasisCurves):
            guides.append(prim)
        elif prim.IsA(UsdGeom.Gprim):
            portals.append(prim)
    groups = {str(reading.value(each, _GROUP, "")) for each in lights if each.GetAttribute(_GROUP)} - {""}
    choices = {
        **{name: tuple(str(each.GetPath()) for each in prims[:_MOST_CHOICES])
           for name, prims in (("look", looks), ("portal", portals), ("guides", guides))},
        "lightGroup": tuple(sorted(groups)), "asset": pictures_beside(stage),
    }  # fmt: skip
    kinds = {"light": lights, "medium": media, "look": looks}
    return [_Edited(reading, prim, kind, choices).controls() for kind, prims in kinds.items() for prim in prims]


def pictures_beside(stage: Usd.Stage) -> tuple[str, ...]:
    """Return the images in the folder of a stage and in the folders there, by their paths from it."""
    root = Path(stage.GetRootLayer().realPath or ".").parent
    found: list[str] = []
    for number, (folder, names, files) in enumerate(os.walk(root)):
        depth = len(Path(folder).relative_to(root).parts)
        names[:] = sorted(each for each in names if not each.startswith(".") and depth < _DEEPEST)
        found += [
            Path(folder, each).relative_to(root).as_posix() for each in sorted(files) if each.lower().endswith(_IMAGES)
        ]
        if len(found) >= _MOST_CHOICES or number >= _MOST_CHOICES:
            break
    return tuple(found[:_MOST_CHOICES])


@dataclass(frozen=True)
class _Edited:
    """A prim whose values can be edited, its kind, and the choices of prims, groups and files."""

    reading: Reading
    prim: Usd.Prim
    kind: str
    choices: Choices

    def controls(self) -> Controls:
        """Return the controls of the prim."""
        prim = self.prim
        uses = [str(each) for each in target_paths(prim, "photonbeams:look")] if self.kind == "light" else []
        controls = [*self._of_light(), *self._of_schema(), *self._of_filters()]
        path, kind = str(prim.GetPath()), str(prim.GetTypeName())
        return Controls(path, self.kind, prim.GetName(), kind, tuple(controls), tuple(uses))

    def _of_light(self) -> Iterator[Control]:
        """Yield the controls of UsdLux."""
        if self.kind == "light":
            if self.prim.IsA(UsdGeom.Imageable):
                yield self._control(_SHOWN, "Light")
            for name in _LIGHT_INPUTS:
                if definition := _light_input(self.prim, name):
                    yield self._control(definition, "Light")

    def _of_schema(self) -> Iterator[Control]:
        """Yield the controls of photonbeams' own attributes and relationships."""
        for name, definition in definitions(_SCHEMAS[self.kind]).items():
            slot, _, rest = name.removeprefix(PREFIX).partition(":")
            section = slot.capitalize() if self.kind != "light" and rest else _SECTIONS[self.kind]
            if name.endswith(":ramp:knots"):
                yield self._ramp(name.removesuffix(":knots"), section)
            elif name == "photonbeams:enabled":  # its default depends on the kind of light
                yield self._control(replace(definition, default=not is_dome(self.prim)), section)
            elif ":ramp:" not in name and not (self.kind == "light" and _is_of_other_lights(self.prim, name)):
                yield self._control(definition, section)

    def _of_filters(self) -> Iterator[Control]:
        """Yield the controls of a light's filters."""
        for path in target_paths(self.prim, "light:filters") if self.kind == "light" else ():
            target = self.reading.stage.GetPrimAtPath(path)
            if target and target.GetTypeName() in (BLOCKER, RAMP):
                for definition in definitions(str(target.GetTypeName())).values():
                    yield replace(self, prim=target)._control(definition, f"Filter {target.GetName()}")

    def _control(self, definition: Definition, section: str) -> Control:
        """Return the control of an attribute or a relationship."""
        prim, name, value = self.prim, definition.name, definition.default
        if definition.kind == "paths":
            value = [str(each) for each in target_paths(prim, name)]
            authored = prim.HasRelationship(name) and prim.GetRelationship(name).HasAuthoredTargets()
        else:
            attribute = self.reading.attribute(prim, name)
            authored = bool(attribute) and attribute.HasAuthoredValue()
            value = plain(self.reading.value(prim, name, value)) if authored else value
        if definition.kind in ("number", "integer"):
            definition = replace(definition, slider=_slider(definition, definition.default if value is None else value))
        return self._made(definition, section, value, authored)

    def _ramp(self, name: str, section: str) -> Control:
        """Return the control of a ramp, three attributes in one."""
        parts = {part: self._control(definitions(LOOK)[f"{name}:{part}"], section) for part in _RAMP}
        value, default = ({key: getattr(each, which) for key, each in parts.items()} for which in ("value", "default"))
        doc = "Colours between knots, as a factor."
        definition = Definition(name, "ramp", default, choices=parts["interpolation"].choices, doc=doc)
        authored = any(each.authored for each in parts.values())
        made = self._made(definition, section, value, authored)
        return replace(made, parts={key: each.path for key, each in parts.items()})

    def _made(self, definition: Definition, section: str, value: Any, authored: bool) -> Control:
        """Return a control with what it needs to have an effect, and with its choices of prims, groups and files."""
        path, name = self.prim.GetPath(), definition.name
        key = "asset" if definition.kind == "asset" else name.removeprefix(PREFIX)
        fields = {**vars(definition), "choices": self.choices.get(key, definition.choices)}
        needs = {str(path.AppendProperty(other)): wanted for other, wanted in _needs_of(self.kind, name).items()}
        return Control(
            **fields, path=str(path.AppendProperty(name)), label=_label(name), section=section, value=value,
            authored=authored, needs=needs,
        )  # fmt: skip


def _is_of_other_lights(prim: Usd.Prim, name: str) -> bool:
    """Return whether an attribute means nothing for a light of this kind, and is not set."""
    distant, round_ = prim.IsA(UsdLux.DistantLight), prim.IsA(UsdLux.SphereLight)
    kinds = {"gobo:angle": round_, "gobo:width": distant, "gobo:wrap": round_ or distant}
    attribute = prim.GetAttribute(name)
    return not kinds.get(name.removeprefix(PREFIX), True) and not (attribute and attribute.HasAuthoredValue())


def _light_input(prim: Usd.Prim, name: str) -> Definition | None:
    """Return the definition of a UsdLux input that a light has, or would have with ShapingAPI; else None."""
    spec = prim.GetPrimDefinition().GetSchemaAttributeSpec(name)
    if not spec and name.startswith("inputs:shaping:") and prim.IsA(UsdLux.SphereLight):
        spec = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("ShapingAPI").GetSchemaAttributeSpec(name)
    return replace(Definition.of(spec), **_LIGHT_INPUTS[name]) if spec else None


def _slider(own: Definition, value: object) -> tuple[float, float]:
    """Return the range of a slider: the bounds of the value or, without bounds, twice the present value."""
    if own.slider is not None:
        return own.slider
    size = max(2 * abs(float(value)), 1.0) if isinstance(value, int | float) else 1.0
    return (own.least if own.least is not None else -size), (own.most if own.most is not None else size)


def _label(name: str) -> str:
    """Return a label for people: "inputs:shaping:cone:angle" is "Shaping cone angle"."""
    words = [word for word in name.split(":") if word not in ("inputs", "photonbeams")]
    if words[0] in ("along", "across", "eye", "angle", "noise", "height") and len(words) > 1:
        words = words[1:]
    spaced = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in " ".join(words))
    return spaced.strip().capitalize()


def _needs_of(kind: str, name: str) -> dict[str, Wanted]:
    """Return what other attributes have to be, by their names, so that an attribute of a kind of prim has an effect."""
    if not name.startswith(PREFIX):
        return dict(_INPUTS.get(name, {}))
    others = _OWN[kind].get(name.removeprefix(PREFIX), {})
    return {PREFIX + other: wanted for other, wanted in others.items()}
