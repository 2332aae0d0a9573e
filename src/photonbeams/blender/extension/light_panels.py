"""Panels of beams and their looks, in the Object Data of lamps and curves and in the World properties."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .looks import ATTRIBUTES, CURVED, FACTORS, PRESETS, curve_of, owner_of, property_of, ramp_of
from .panels import PropertiesPanel, split
from .thumbnails import THUMBNAILS

#: The attribute that chooses the function of a factor of a look, and its choices that have further parameters.
_CHOICES: dict[str, tuple[str, dict[str, tuple[str, ...]]]] = {
    "along": ("along:falloff", {"along:length": ("exponential", "power"), "along:exponent": ("power",),
                                "along:coefficients": ("polynomial",)}),
    "across": ("across:profile", {"across:width": ("gaussian",), "across:hardness": ("smoothstep",),
                                  "across:inner": ("hollow",), "across:softness": ("hollow",)}),
    "eye": ("eye:falloff", {"eye:length": ("exponential",)}),
    "angle": ("angle:shading", dict.fromkeys(("angle:anisotropy", "angle:mix", "angle:gain"), ("glow",))),
}  # fmt: skip
#: What does not have the name of its factor.
_BESIDE = {"along": ["surfaces"], "noise": ["variation"]}


class _BeamsPanel(PropertiesPanel):
    bl_context = "data"
    MEMBER: ClassVar = "light"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine, and the properties show what has beams."""
        if not super().poll(context) or getattr(context, cls.MEMBER, None) is None:
            return False
        return cls.MEMBER != "curve" or (context.object is not None and context.object.type == "CURVE")  # or text

    def draw_header(self, context: Any) -> None:
        """Draw whether there are beams."""
        self.layout.prop(getattr(context, self.MEMBER).photonbeams, "enabled", text="")


class PHOTONBEAMS_PT_beams(_BeamsPanel):  # noqa: N801 - Blender wants these names
    """The beams of a lamp."""

    bl_label = "Beams"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, light = split(self.layout, keyframes=True), context.light
        own = light.photonbeams
        _draw_beams(layout, own)
        gobo = layout.column()
        gobo.template_ID(own, "gobo", open="image.open", text="Gobo")
        if own.gobo is not None and light.type == "SUN":
            gobo.prop(own, "gobo_width")
        elif own.gobo is not None and light.type != "AREA":
            gobo.prop(own, "gobo_angle")
        if own.gobo is not None and light.type != "AREA":
            gobo.prop(own, "gobo_wrap")


class PHOTONBEAMS_PT_world_beams(_BeamsPanel):  # noqa: N801
    """The beams of the sky."""

    bl_label = "Beams"
    bl_context = "world"
    MEMBER = "world"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        _draw_beams(split(self.layout, keyframes=True), context.world.photonbeams)


class PHOTONBEAMS_PT_fog(PropertiesPanel):  # noqa: N801
    """How the fog of the world varies."""

    bl_label = "Fog"
    bl_context = "world"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine, and has a world."""
        return super().poll(context) and getattr(context, "world", None) is not None

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, own = split(self.layout, keyframes=True), context.world.photonbeams
        column = layout.column(align=True)
        column.prop(own, "fog_falloff")
        ground = column.column()
        ground.active = own.fog_falloff > 0
        ground.prop(own, "fog_ground")
        layout.prop(own, "fog_noise")
        wisps = layout.column()
        wisps.active = own.fog_noise > 0
        for name in ("fog_noise_scale", "fog_noise_contrast", "fog_noise_drift", "fog_noise_evolution"):
            wisps.prop(own, name)


class PHOTONBEAMS_PT_curve_beams(_BeamsPanel):  # noqa: N801
    """A curve that is beams."""

    bl_label = "Beams"
    MEMBER = "curve"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, own = split(self.layout, keyframes=True), context.curve.photonbeams
        layout.active = own.enabled
        for name in ("power", "color", "radius"):
            layout.prop(own, name)


def _draw_beams(layout: Any, own: Any) -> None:
    """Draw what lamps and the world have in common."""
    layout.active = own.enabled
    for name in ("intensity", "count", "seed", "scattered", "portal"):
        layout.prop(own, name)
    if own.portal is not None:
        layout.template_ID(own, "portal_gobo", open="image.open", text="Portal Image")


class _PresetsPanel(bpy.types.Panel):
    """Ready-made looks, or factors of looks, with their pictures."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "HEADER"  # it is shown by a button alone
    bl_label = "Presets"
    bl_ui_units_x = 16
    FACTOR: ClassVar = "look"

    def draw(self, _context: Any) -> None:
        """Draw the panel."""
        grid = self.layout.grid_flow(columns=3, even_columns=True)
        for each in PRESETS:
            if each["factor"] == self.FACTOR:
                cell = grid.column(align=True)
                cell.template_icon(THUMBNAILS.icon_of(each["name"]), scale=5.0)
                cell.operator("photonbeams.look_preset", text=each["label"]).preset = each["name"]


class _LookPanel(_BeamsPanel):
    """The look of what the properties show."""

    bl_label = "Look"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_header(self, _context: Any) -> None:
        """Draw nothing beside the name."""

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.template_ID(owner_of(context), "look", new="photonbeams.look_new")
        layout.popover("PHOTONBEAMS_PT_presets_look")


class _FactorPanel(_BeamsPanel):
    """A factor of a look."""

    bl_options: ClassVar = {"DEFAULT_CLOSED"}
    FACTOR: ClassVar = ""

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether what the properties show has a look."""
        return super().poll(context) and owner_of(context).look is not None

    def draw_header(self, _context: Any) -> None:
        """Draw nothing beside the name."""

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        tree, layout = owner_of(context).look, split(self.layout, keyframes=True)
        own = tree.photonbeams
        layout.popover(f"PHOTONBEAMS_PT_presets_{self.FACTOR}")
        choice, parameters = _CHOICES.get(self.FACTOR, ("", {}))
        if choice:
            layout.prop(own, property_of(choice))
        for name, choices in parameters.items():
            if getattr(own, property_of(choice)) in choices:
                layout.prop(own, property_of(name))
        if self.FACTOR in CURVED:
            self._draw_curve(layout, tree)
        if self.FACTOR in FACTORS:
            layout.prop(own, f"{self.FACTOR}_use_ramp")
            ramp = ramp_of(tree, self.FACTOR)
            if getattr(own, f"{self.FACTOR}_use_ramp") and ramp is not None:
                layout.template_color_ramp(ramp, "color_ramp", expand=True)
        names = [name for name in ATTRIBUTES if name.startswith(f"{self.FACTOR}:")] + _BESIDE.get(self.FACTOR, [])
        for name in names:
            if name != choice and name not in parameters:
                layout.prop(own, property_of(name))

    def _draw_curve(self, layout: Any, tree: Any) -> None:
        """Draw the curve, if there is one: a profile across the beam, a factor along it."""
        own = tree.photonbeams
        if self.FACTOR == "along":
            layout.prop(own, "along_use_curve")
        used = own.along_use_curve if self.FACTOR == "along" else own.across_profile == "tabulated"
        node = curve_of(tree, self.FACTOR)
        if used and node is not None:
            layout.template_curve_mapping(node, "mapping")


def _panels(suffix: str, member: str, context: str) -> list[type]:
    """Return the panels of looks for lamps, curves or the world."""
    name = f"PHOTONBEAMS_PT_{suffix}look"
    shared = {"MEMBER": member, "bl_context": context, "__doc__": "The look of beams."}
    factors = (("along", "Along the Beam"), ("across", "Across the Beam"), ("eye", "Toward the Camera"),
               ("angle", "By Angle"), ("noise", "Noise"))  # fmt: skip
    return [type(name, (_LookPanel,), {**shared, "bl_idname": name}), *(
        type(f"{name}_{factor}", (_FactorPanel,), {
            **shared, "bl_label": label, "bl_idname": f"{name}_{factor}", "bl_parent_id": name, "FACTOR": factor,
        })
        for factor, label in factors
    )]  # fmt: skip


def _presets() -> list[type]:
    """Return the panels of presets."""
    return [
        type(f"PHOTONBEAMS_PT_presets_{factor}", (_PresetsPanel,), {
            "bl_idname": f"PHOTONBEAMS_PT_presets_{factor}", "FACTOR": factor, "__doc__": "Ready-made looks.",
        })
        for factor in ("look", "along", "across", "eye", "angle", "noise")
    ]  # fmt: skip


CLASSES = (
    *_presets(), PHOTONBEAMS_PT_beams, *_panels("", "light", "data"), PHOTONBEAMS_PT_world_beams,
    *_panels("world_", "world", "world"), PHOTONBEAMS_PT_fog, PHOTONBEAMS_PT_curve_beams,
    *_panels("curve_", "curve", "data"),
)  # fmt: skip
