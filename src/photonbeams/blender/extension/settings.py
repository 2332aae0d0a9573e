"""What an artist sets, as properties that are saved in the .blend."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty


class PhotonBeamsRenderSettings(bpy.types.PropertyGroup):
    """How a scene is rendered."""

    passes: IntProperty(
        name="Passes",
        default=16,
        min=1,
        soft_max=256,
        description="Passes that a picture averages; more have less noise",
    )
    viewport_passes: IntProperty(
        name="Viewport Passes",
        default=32,
        min=1,
        soft_max=256,
        description="Passes that the picture in a viewport averages",
    )
    viewport_denoise: BoolProperty(
        name="Denoise Viewport", default=True, description="Remove noise from the pictures in a viewport"
    )
    use_error: BoolProperty(name="Until Error", description="Render until the noise is small, at most so many passes")
    error: FloatProperty(
        name="Error", default=0.02, min=0.001, max=0.5, precision=3, description="Relative error, such as 0.02 for 2 %"
    )
    time_limit: FloatProperty(
        name="Time Limit", default=0.0, min=0.0, subtype="TIME_ABSOLUTE", unit="TIME_ABSOLUTE",
        description="Begin no further pass after so many seconds; 0: no limit",
    )  # fmt: skip
    bounces: IntProperty(
        name="Bounces", default=3, min=0, soft_max=16, description="How often light is scattered or reflected"
    )
    denoise: BoolProperty(name="Denoise", default=True, description="Remove noise with Open Image Denoise")
    surfaces: BoolProperty(
        name="Surfaces",
        default=True,
        description="Shade surfaces; without, they are black: only beams are rendered",
    )
    seed: IntProperty(
        name="Seed", default=0, min=0, description="Another seed has other noise; it is the same for all frames"
    )
    beams: IntProperty(
        name="Light Paths",
        default=0,
        min=0,
        soft_max=65536,
        description="Light paths in a pass; 0: as many as are usual",
    )
    motion_steps: IntProperty(
        name="Steps", default=2, min=1, soft_max=8,
        description="Into how many steps what moves is divided while the shutter is open; more follow curved motion",
    )  # fmt: skip
    estimator: EnumProperty(
        name="Estimator", default="auto", description="How beams are integrated along a ray",
        items=[
            ("auto", "Auto", "The billboard, and the frustum where the camera is inside a beam"),
            ("billboard", "Billboard", "Beam × Beam 1D: flat from the side, quick"),
            ("frustum", "Frustum", "Beam × Beam 2D: a cone, integrated by quadrature"),
        ],
    )  # fmt: skip

    def viewed(self) -> dict[str, Any]:
        """Return what the renderer is told about a viewport."""
        return {"passes": self.viewport_passes, "denoise": self.viewport_denoise, "bounces": self.bounces}

    def arguments(self) -> dict[str, Any]:
        """Return what the renderer is told."""
        found: dict[str, Any] = {
            "passes": self.passes, "max_depth": self.bounces + 2, "denoise": self.denoise, "seed": self.seed,
            "estimator": self.estimator, "surfaces": self.surfaces,
        }  # fmt: skip
        if self.use_error:
            found["error"] = self.error
        if self.time_limit > 0:
            found["time_limit"] = self.time_limit
        if self.beams > 0:
            found["beams"] = self.beams
        return found


class PhotonBeamsPreferences(bpy.types.AddonPreferences):
    """Where the renderer is."""

    bl_idname = __package__

    python: StringProperty(
        name="Python", subtype="FILE_PATH",
        description="A Python that has photonbeams; empty: that of the command photonbeams",
    )  # fmt: skip

    def draw(self, _context: Any) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "python")


def chosen_python() -> str:
    """Return the Python of the preferences, "" if none is chosen."""
    found = bpy.context.preferences.addons.get(__package__)
    return "" if found is None else bpy.path.abspath(found.preferences.python)


CLASSES = (PhotonBeamsRenderSettings, PhotonBeamsPreferences)
