"""Looks: node groups whose nodes are Blender's own widgets of curves and colour ramps, saved in the .blend.

`tools/schema.py` writes looks.json, the attributes and the presets of looks, from the schema of `PhotonBeamsLook`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

_FILE = json.loads(Path(__file__).with_name("looks.json").read_text(encoding="utf-8"))
#: What the schema says of each attribute, by names without "photonbeams:".
ATTRIBUTES: dict[str, dict[str, Any]] = _FILE["attributes"]
#: Looks to start from: name, factor, label and values of attributes.
PRESETS: list[dict[str, Any]] = _FILE["presets"]
#: The factors of a look that may have a ramp, and those that may have a curve.
FACTORS, CURVED = ("along", "across", "eye", "angle"), ("along", "across")
INTERPOLATIONS = {"CONSTANT": "none", "LINEAR": "linear", "EASE": "smooth"}

_LABELS = {
    "across:profile": {"constant": "Hard", "epanechnikov": "Soft", "biweight": "Softer", "tabulated": "Curve"},
    "along:falloff": {"physical": "As the Fog Absorbs"}, "eye:falloff": {"physical": "As the Fog Absorbs"},
    "angle:shading": {"physical": "As the Fog Scatters", "constant": "Even"},
}  # fmt: skip
_NAMES = {"along:physical": "Fog Absorbs", "eye:length": "Length", "variation": "Variation"}


def property_of(attribute: str) -> str:
    """Return the name of the property that holds an attribute."""
    return attribute.replace(":", "_")


def _tip(doc: str) -> str:
    """Return a tool tip: Blender's lengths are metres, and it adds the full stop."""
    text = doc.replace("scene units", "metres").replace("scene unit", "metre").replace("`", "")
    return text.removesuffix(".")


def _items(attribute: str, own: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the choices of an attribute; its documentation explains some as "token: text."."""
    found = dict(re.findall(r"\b(\w+): (.+?)(?=\. |\.$)", _tip(own["doc"]) + "."))
    labels = {each: each[0].upper() + re.sub(r"([A-Z])", r" \1", each[1:]) for each in own["choices"]}
    labels |= _LABELS.get(attribute, {})
    return [(each, labels[each], found.get(each, "")) for each in own["choices"]]


def _property(attribute: str, own: Mapping[str, Any]) -> Any:
    """Return the property for an attribute."""
    name = _NAMES.get(attribute, attribute.rpartition(":")[2].capitalize())
    shared = {"name": name, "description": _tip(own["doc"])}
    default, kind = own["default"], own["kind"]
    limits: dict[str, Any] = {}
    if own["least"] is not None:
        limits["min"] = own["least"] + (1e-3 if own["open"] else 0)
    if own["most"] is not None:
        limits["max"] = own["most"]
    if own["slider"] is not None:
        limits["soft_min"], limits["soft_max"] = own["slider"]
    match kind:
        case "bool":
            return BoolProperty(default=default, **shared)
        case "integer":
            return IntProperty(default=default, **limits, **shared)
        case "choice":
            return EnumProperty(default=default, items=_items(attribute, own), **shared)
        case "color":
            return FloatVectorProperty(default=default, subtype="COLOR", min=0.0, soft_max=1.0, size=3, **shared)
        case "asset":
            return PointerProperty(type=bpy.types.Image, **shared)
        case "number":
            length = "scene units" in own["doc"] and "fractions" not in own["doc"]
            return FloatProperty(default=default, unit="LENGTH" if length else "NONE", **limits, **shared)
        case "numbers" if own["length"] == 3:
            return FloatVectorProperty(default=default, size=3, subtype="XYZ", **shared)
        case "numbers":  # of a polynomial
            return FloatVectorProperty(default=(1.0, 0.0, 0.0, 0.0), size=4, **shared)
    return StringProperty(**shared)


def _annotations() -> dict[str, Any]:
    """Return the properties of looks."""
    found: dict[str, Any] = {
        "is_look": BoolProperty(name="Look", description="Whether the node group is a look of beams"),
        "along_use_curve": BoolProperty(
            name="Curve", description="Multiply by a curve along the beam, from the light, left, to its end, right"
        ),
    }
    places = {
        "along": "along the beam, from the light to its end", "across": "from the beam's axis to its rim",
        "eye": "by the distance to the camera", "angle": "by the view angle, from straight into the light to along it",
    }  # fmt: skip
    for factor in FACTORS:
        found[f"{factor}_use_ramp"] = BoolProperty(
            name="Colour Ramp", description=f"Multiply by a colour ramp {places[factor]}"
        )
    return found | {property_of(name): _property(name, own) for name, own in ATTRIBUTES.items()}


class PhotonBeamsLook(bpy.types.PropertyGroup):
    """How beams look, as properties of a node group."""

    __annotations__ = _annotations()


def is_look(_owner: Any, tree: Any) -> bool:
    """Return whether a node group is a look."""
    return bool(tree.photonbeams.is_look)


def look_property() -> Any:
    """Return a property that chooses a look."""
    return PointerProperty(
        name="Look", type=bpy.types.NodeTree, poll=is_look, description="How the beams look; none: as in real fog"
    )


def ramp_of(tree: Any, factor: str) -> Any:
    """Return the node that has the colour ramp of a factor; None if somebody has removed it."""
    return tree.nodes.get(f"{factor} ramp")


def curve_of(tree: Any, factor: str) -> Any:
    """Return the node that has the curve of a factor; None if somebody has removed it."""
    return tree.nodes.get(f"{factor} curve")


def new_look(name: str) -> Any:
    """Return a new look that is physical."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    tree.photonbeams.is_look = True
    for k, factor in enumerate(FACTORS):
        node = tree.nodes.new("ShaderNodeValToRGB")
        node.name, node.location = f"{factor} ramp", (0, -300 * k)
        for element in node.color_ramp.elements:
            element.color = (1, 1, 1, 1)
        if factor in CURVED:
            node = tree.nodes.new("ShaderNodeFloatCurve")
            node.name, node.location = f"{factor} curve", (300, -300 * k)
            _set_curve(node, (1.0, 0.0))
    return tree


def apply_preset(tree: Any, preset: Mapping[str, Any]) -> None:
    """Set the values of a preset; other properties of its factor, or of all factors, have their defaults then."""
    own, factor, values = tree.photonbeams, preset["factor"], preset["values"]
    for attribute in ATTRIBUTES:
        if factor == "look" or attribute.startswith(f"{factor}:"):
            own.property_unset(property_of(attribute))
            if attribute in values:
                given = values[attribute]
                setattr(own, property_of(attribute), [*given, 0, 0, 0, 0][:4] if "coefficients" in attribute else given)
    for each in FACTORS if factor == "look" else [factor]:
        if each not in FACTORS:
            continue
        setattr(own, f"{each}_use_ramp", f"{each}:ramp:knots" in values)
        if f"{each}:ramp:knots" in values:
            _set_ramp(ramp_of(tree, each), *(values.get(f"{each}:ramp:{part}") for part in
                                             ("knots", "colors", "interpolation")))  # fmt: skip
    if factor in ("look", "along"):
        own.along_use_curve = False
    if "across:values" in values:
        _set_curve(curve_of(tree, "across"), values["across:values"])


def _set_ramp(node: Any, knots: list[float], colors: list[list[float]], interpolation: str | None) -> None:
    ramp = node.color_ramp
    ramp.color_mode = "RGB"
    ramp.interpolation = {ours: theirs for theirs, ours in INTERPOLATIONS.items()}[interpolation or "linear"]
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    for k, (knot, color) in enumerate(zip(knots, colors, strict=True)):
        element = ramp.elements[0] if k == 0 else ramp.elements.new(knot)
        element.position, element.color = knot, (*color, 1)


def _set_curve(node: Any, values: Any) -> None:
    """Give a curve values at equal steps, linear between them."""
    mapping = node.mapping
    mapping.extend = "HORIZONTAL"
    points = mapping.curves[0].points
    while len(points) > 2:
        points.remove(points[1])
    for k, value in enumerate(values):
        x = k / (len(values) - 1)
        if 0 < k < len(values) - 1:
            points.new(x, value)
        else:
            points[0 if k == 0 else len(points) - 1].location = (x, value)
    for point in points:
        point.handle_type = "VECTOR"
    mapping.update()


class PHOTONBEAMS_OT_look_new(bpy.types.Operator):  # noqa: N801 - Blender wants these names
    """Add a look, which several lamps may share."""

    bl_idname = "photonbeams.look_new"
    bl_label = "New Look"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether there is something that can have a look."""
        return owner_of(context) is not None

    def execute(self, context: Any) -> set[str]:
        """Add the look."""
        owner_of(context).look = new_look("Look")
        return {"FINISHED"}


class PHOTONBEAMS_OT_look_preset(bpy.types.Operator):  # noqa: N801
    """Set the look, or a part of it, to one that is ready-made."""

    bl_idname = "photonbeams.look_preset"
    bl_label = "Preset"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    preset: EnumProperty(
        name="Preset", description="The ready-made look",
        items=[(each["name"], each["label"], "") for each in PRESETS],
    )  # fmt: skip
    poll = PHOTONBEAMS_OT_look_new.poll

    def execute(self, context: Any) -> set[str]:
        """Apply the preset; what has no look gets a new one."""
        preset = next(each for each in PRESETS if each["name"] == self.preset)
        owner = owner_of(context)
        if owner.look is None:
            owner.look = new_look(preset["label"])
        apply_preset(owner.look, preset)
        return {"FINISHED"}


def owner_of(context: Any) -> Any:
    """Return the settings of the lamp, the curve or the world that the properties show; None if it has none."""
    data = next((found for each in ("light", "curve", "world") if (found := getattr(context, each, None))), None)
    if data is None and context.object is not None:
        data = context.object.data
    return getattr(data, "photonbeams", None)


CLASSES = (PhotonBeamsLook, PHOTONBEAMS_OT_look_new, PHOTONBEAMS_OT_look_preset)
