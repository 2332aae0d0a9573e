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
from .effects import Wanted, needs_of

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
    found = [_of_prim(reading, prim, "light", choices) for prim in lights]
    found += [_of_prim(reading, prim, "medium", choices) for prim in media]
    return found + [_of_prim(reading, prim, "look", choices) for prim in looks]


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


def _of_prim(reading: Reading, prim: Usd.Prim, kind: str, choices: Choices) -> Controls:
    controls = tuple(_controls(reading, prim, kind, choices))
    uses = tuple(str(each) for each in target_paths(prim, "photonbeams:look")) if kind == "light" else ()
    return Controls(str(prim.GetPath()), kind, prim.GetName(), str(prim.GetTypeName()), controls, uses)


def _controls(
    reading: Reading, prim: Usd.Prim, kind: str, choices: Choices
) -> Iterator[Control]:  # fmt: skip
    """Yield the controls of a prim, with what they need to have an effect, and with choices of files, groups, prims."""
    for each in _all_controls(reading, prim, kind, choices):
        needs = {
            str(prim.GetPath().AppendProperty(name)): wanted
            for name, wanted in needs_of(kind, each.name).items()
        }  # fmt: skip
        short = each.name.removeprefix(PREFIX)
        own = choices["asset"] if each.kind == "asset" else choices[short] if short == "lightGroup" else each.choices
        yield replace(each, needs=needs, choices=own)


def _all_controls(
    reading: Reading, prim: Usd.Prim, kind: str, choices: Choices
) -> Iterator[Control]:  # fmt: skip
    if kind == "light":
        if prim.IsA(UsdGeom.Imageable):
            yield _control(reading, prim, _SHOWN, "Light")
        for name in _LIGHT_INPUTS:
            if own := _light_input(prim, name):
                yield _control(reading, prim, own, "Light")
    for name, own in definitions(_SCHEMAS[kind]).items():
        slot, _, rest = name.removeprefix(PREFIX).partition(":")
        section = slot.capitalize() if kind != "light" and rest else _SECTIONS[kind]
        if own.kind == "paths":
            yield _paths(prim, own, section, choices)
        elif name.endswith(":ramp:knots"):
            yield _ramp(reading, prim, name.removesuffix(":knots"), section)
        elif ":ramp:" not in name and not (kind == "light" and _is_of_other_lights(prim, name)):
            control = _control(reading, prim, own, section)
            yield _of_kind(control, prim) if name == "photonbeams:enabled" else control
    for path in target_paths(prim, "light:filters") if kind == "light" else ():
        target = reading.stage.GetPrimAtPath(path)
        if target and target.GetTypeName() in (BLOCKER, RAMP):
            for own in definitions(str(target.GetTypeName())).values():
                yield _control(reading, target, own, f"Filter {target.GetName()}")


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


def _control(reading: Reading, prim: Usd.Prim, own: Definition, section: str) -> Control:
    """Return the control of an attribute."""
    attribute = reading.attribute(prim, own.name)
    authored = bool(attribute) and attribute.HasAuthoredValue()
    value = plain(reading.value(prim, own.name, own.default)) if authored else own.default
    if own.kind in ("number", "integer"):
        own = replace(own, slider=_slider(own, own.default if value is None else value))
    return _of(prim, own, section, value, authored)


def _of(prim: Usd.Prim, own: Definition, section: str, value: Any, authored: bool, **parts: str) -> Control:
    return Control(
        **vars(own), path=str(prim.GetPath().AppendProperty(own.name)), label=_label(own.name), section=section,
        value=value, authored=authored, parts=parts,
    )  # fmt: skip


def _paths(prim: Usd.Prim, own: Definition, section: str, choices: Choices) -> Control:
    """Return the control of a relationship."""
    targets = [str(each) for each in target_paths(prim, own.name)]
    authored = prim.HasRelationship(own.name) and prim.GetRelationship(own.name).HasAuthoredTargets()
    known = choices.get(own.name.removeprefix(PREFIX), ())
    return _of(prim, replace(own, choices=known), section, targets, authored)


def _of_kind(control: Control, prim: Usd.Prim) -> Control:
    """Return the control of whether a light makes beams, whose default depends on the kind of light."""
    does = not is_dome(prim)
    return replace(control, default=does, value=control.value if control.authored else does)


def _ramp(reading: Reading, prim: Usd.Prim, name: str, section: str) -> Control:
    """Return the control of a ramp, three attributes in one."""
    named = {part: _control(reading, prim, definitions(LOOK)[f"{name}:{part}"], section) for part in _RAMP}
    value, default = ({key: getattr(each, which) for key, each in named.items()} for which in ("value", "default"))
    doc = "Colours between knots, as a factor."
    own = Definition(name, "ramp", default, choices=named["interpolation"].choices, doc=doc)
    authored = any(each.authored for each in named.values())
    return _of(prim, own, section, value, authored, **{key: each.path for key, each in named.items()})


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
