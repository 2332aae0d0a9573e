"""Panels where Cycles has its own."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .engine import ENGINE

# Panels of Blender's that make no sense here.
_HIDDEN = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes", "RENDER_PT_simplify_greasepencil"}


class _RenderPanel(bpy.types.Panel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES: ClassVar = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine."""
        return context.engine in cls.COMPAT_ENGINES


class PHOTONBEAMS_PT_sampling(_RenderPanel):  # noqa: N801 - Blender wants these names
    """Passes, error and time."""

    bl_label = "Sampling"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, settings = self.layout, context.scene.photonbeams
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(settings, "passes")
        heading = layout.row(heading="Until Error")
        heading.prop(settings, "use_error", text="")
        value = heading.row()
        value.active = settings.use_error
        value.prop(settings, "error", text="")
        layout.prop(settings, "time_limit")
        layout.prop(settings, "denoise")
        layout.prop(settings, "seed")


class PHOTONBEAMS_PT_light(_RenderPanel):  # noqa: N801
    """Light paths, bounces and the estimator."""

    bl_label = "Light"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, settings = self.layout, context.scene.photonbeams
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(settings, "bounces")
        layout.prop(settings, "beams")
        layout.prop(settings, "estimator")


CLASSES = (PHOTONBEAMS_PT_sampling, PHOTONBEAMS_PT_light)


def _shared() -> list[Any]:
    """Return Blender's own panels that any engine may have."""
    return [
        each
        for each in bpy.types.Panel.__subclasses__()
        if "BLENDER_RENDER" in getattr(each, "COMPAT_ENGINES", ()) and each.__name__ not in _HIDDEN
    ]


def register() -> None:
    """Add the panels."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    for each in _shared():
        each.COMPAT_ENGINES.add(ENGINE)


def unregister() -> None:
    """Remove the panels."""
    for each in _shared():
        each.COMPAT_ENGINES.discard(ENGINE)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
