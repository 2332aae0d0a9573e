"""Panels where Cycles has its own."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
from bl_ui.properties_view_layer import ViewLayerLightgroupsPanelHelper

from .engine import ENGINE

# Panels of Blender's that make no sense here, and those of EEVEE that do.
_HIDDEN = {"DATA_PT_light", "VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes", "RENDER_PT_simplify_greasepencil"}
_OF_EEVEE = {
    "DATA_PT_EEVEE_light", "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume", "EEVEE_WORLD_PT_surface", "EEVEE_WORLD_PT_volume",
}  # fmt: skip


def split(layout: Any, keyframes: bool = False) -> Any:
    """Return a layout with names left of the values, and with or without buttons for keyframes."""
    layout.use_property_split, layout.use_property_decorate = True, keyframes
    return layout


class PropertiesPanel(bpy.types.Panel):
    """A panel among the properties, while the scene is rendered by this engine."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    COMPAT_ENGINES: ClassVar = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine."""
        return context.engine in cls.COMPAT_ENGINES


class _RenderPanel(PropertiesPanel):
    bl_context = "render"


class PHOTONBEAMS_PT_sampling(_RenderPanel):  # noqa: N801 - Blender wants these names
    """Passes, error and time."""

    bl_label = "Sampling"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, settings = split(self.layout), context.scene.photonbeams
        layout.prop(settings, "passes")
        heading = layout.row(heading="Until Error")
        heading.prop(settings, "use_error", text="")
        value = heading.row()
        value.active = settings.use_error
        value.prop(settings, "error", text="")
        layout.prop(settings, "time_limit")
        layout.prop(settings, "denoise")
        layout.prop(settings, "seed")


class PHOTONBEAMS_PT_viewport(_RenderPanel):  # noqa: N801
    """Passes and pixels of the pictures in a viewport."""

    bl_label = "Viewport"
    bl_parent_id = "PHOTONBEAMS_PT_sampling"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, settings = split(self.layout), context.scene.photonbeams
        layout.prop(settings, "viewport_passes", text="Passes")
        layout.prop(settings, "viewport_denoise", text="Denoise")
        layout.prop(context.scene.render, "preview_pixel_size", text="Pixel Size")


class PHOTONBEAMS_PT_light(_RenderPanel):  # noqa: N801
    """Light paths, bounces and the estimator."""

    bl_label = "Light"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout = split(self.layout)
        for name in ("bounces", "beams", "estimator", "surfaces"):
            layout.prop(context.scene.photonbeams, name)
        layout.operator("photonbeams.over_cycles")


class PHOTONBEAMS_PT_motion_blur(_RenderPanel):  # noqa: N801
    """The shutter, as Blender has it, and how finely motion is read."""

    bl_label = "Motion Blur"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        """Draw the switch."""
        self.layout.prop(context.scene.render, "use_motion_blur", text="")

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, render = split(self.layout), context.scene.render
        layout.active = render.use_motion_blur
        layout.prop(render, "motion_blur_position", text="Position")
        layout.prop(render, "motion_blur_shutter")
        layout.prop(context.scene.photonbeams, "motion_steps")


class PHOTONBEAMS_PT_film(_RenderPanel):  # noqa: N801
    """What the picture has where nothing is."""

    bl_label = "Film"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        split(self.layout).prop(context.scene.render, "film_transparent", text="Transparent")


class PHOTONBEAMS_PT_light_groups(ViewLayerLightgroupsPanelHelper, bpy.types.Panel):  # noqa: N801
    """The light groups of a view layer, each of which has a render pass."""

    COMPAT_ENGINES: ClassVar = {ENGINE}


class PHOTONBEAMS_PT_light_group(PropertiesPanel):  # noqa: N801
    """The light group of a lamp."""

    bl_context = "object"
    bl_label = "Light Group"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine, and the object is a lamp."""
        return super().poll(context) and context.object is not None and context.object.type == "LIGHT"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        split(self.layout).prop_search(
            context.object, "lightgroup", context.view_layer, "lightgroups", results_are_suggestions=True
        )


class PHOTONBEAMS_PT_light_shape(PropertiesPanel):  # noqa: N801
    """What EEVEE's panel of a lamp leaves out, or mixes with its own."""

    bl_context = "data"
    bl_label = "Spread and Shadow"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine, and the properties show a lamp."""
        return super().poll(context) and getattr(context, "light", None) is not None

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, light = split(self.layout, keyframes=True), context.light
        if light.type == "AREA":
            layout.prop(light, "spread")
        layout.prop(light, "use_shadow", text="Cast Shadow")


CLASSES = (
    PHOTONBEAMS_PT_sampling, PHOTONBEAMS_PT_viewport, PHOTONBEAMS_PT_light, PHOTONBEAMS_PT_motion_blur,
    PHOTONBEAMS_PT_film,
    PHOTONBEAMS_PT_light_groups, PHOTONBEAMS_PT_light_group, PHOTONBEAMS_PT_light_shape,
)  # fmt: skip


def shared_panels() -> list[Any]:
    """Return Blender's own panels that any engine may have."""
    return [
        each
        for each in bpy.types.Panel.__subclasses__()
        if ("BLENDER_RENDER" in getattr(each, "COMPAT_ENGINES", ()) and _name_of(each) not in _HIDDEN)
        or each.__name__ in _OF_EEVEE
    ]


def _name_of(panel: Any) -> str:
    """Return the name of a panel, also of its copy in the shader editor."""
    return str(panel.__name__).removeprefix("NODE_")
