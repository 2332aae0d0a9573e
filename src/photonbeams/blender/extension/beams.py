"""The beams of lamps, of the world and of curves, as properties that are saved in the .blend."""

from __future__ import annotations

from math import pi
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
)

from .looks import look_property


def _is_portal(_owner: Any, thing: Any) -> bool:
    """Return whether an object can be a portal: one that has faces, or an area light."""
    return thing.type in ("MESH", "CURVE", "SURFACE", "FONT", "META") or (
        thing.type == "LIGHT" and thing.data.type == "AREA"
    )


class _Beams:
    """What lamps and the world have in common."""

    intensity: FloatProperty(
        name="Intensity in Fog", default=1.0, min=0.0, soft_max=10.0,
        description="A factor on the beams alone: light on surfaces does not change",
    )  # fmt: skip
    count: IntProperty(
        name="Count", default=0, min=0, max=100_000_000, soft_max=65536,
        description="Beams in each pass: more of them are finer; 0: as many as are usual",
    )  # fmt: skip
    seed: IntProperty(
        name="Seed", default=0, min=0, description="Another seed has other beams; the same seed has the same ones"
    )
    portal: PointerProperty(
        name="Portal", type=bpy.types.Object, poll=_is_portal,
        description="The hole or the window that light comes through: beams are aimed at it. It is not a surface then; "
        "an area light that is a portal is no lamp",
    )  # fmt: skip
    portal_gobo: PointerProperty(
        name="Portal Image", type=bpy.types.Image,
        description="An image that covers the portal, such as stained glass, or leaves; the portal has to be flat",
    )  # fmt: skip
    look: look_property()
    scattered: EnumProperty(
        name="Scattered Light", default="physical",
        description="Beams of light that fog or surfaces have scattered before, where light bounces",
        items=[
            ("physical", "Physical", "As in real fog, without the look"),
            ("look", "Look", "With the look, like the beams that come straight from the light"),
            ("off", "Off", "No beams of scattered light"),
        ],
    )  # fmt: skip


class PhotonBeamsLightSettings(_Beams, bpy.types.PropertyGroup):
    """The beams of a lamp."""

    enabled: BoolProperty(name="Beams", default=True, description="Whether the lamp makes beams in fog")
    gobo: PointerProperty(
        name="Gobo", type=bpy.types.Image,
        description="An image that the light shines through, like a slide; its colours filter the light. An Image "
        "Texture on the Color of the lamp's Emission node is one, too",
    )  # fmt: skip
    gobo_angle: FloatProperty(
        name="Angle", default=0.0, min=0.0, max=pi * 0.999, subtype="ANGLE",
        description="How many degrees the image's width covers in front of a point or a spot; 0: the spot's cone",
    )  # fmt: skip
    gobo_width: FloatProperty(
        name="Width", default=1.0, min=1e-4, soft_max=100.0, unit="LENGTH",
        description="Width of a sun's image in metres; it is centred on the sun's place",
    )  # fmt: skip
    gobo_wrap: EnumProperty(
        name="Around", default="black", description="What is around the image of a point, a spot or a sun",
        items=[("black", "No Light", "No light"), ("repeat", "Repeat", "The image is repeated")],
    )  # fmt: skip


class PhotonBeamsWorldSettings(_Beams, bpy.types.PropertyGroup):
    """The beams of the sky, and how the fog of the world varies."""

    enabled: BoolProperty(
        name="Beams", default=False, description="Whether the sky makes beams in fog, such as through a portal"
    )
    fog_falloff: FloatProperty(
        name="Falloff", default=0.0, min=0.0, soft_max=100.0, unit="LENGTH",
        description="Metres of height over which the fog of the world falls to 1 / e; 0: it is the same at all heights",
    )  # fmt: skip
    fog_ground: FloatProperty(
        name="Ground", default=0.0, soft_min=-100.0, soft_max=100.0, unit="LENGTH",
        description="Height above which the fog falls; below it does not vary",
    )  # fmt: skip
    fog_noise: FloatProperty(
        name="Wisps", default=0.0, min=0.0, max=1.0, description="How much the fog of the world varies in wisps"
    )
    fog_noise_scale: FloatProperty(
        name="Size", default=1.0, min=1e-3, soft_max=100.0, unit="LENGTH", description="Size of the largest wisps"
    )
    fog_noise_contrast: FloatProperty(
        name="Contrast", default=2.0, min=0.0, max=100.0, soft_max=10.0, description="How torn the wisps are"
    )
    fog_noise_drift: FloatVectorProperty(
        name="Drift", default=(0.0, 0.0, 0.0), size=3, subtype="VELOCITY",
        description="How the wisps move, in metres per second",
    )  # fmt: skip
    fog_noise_evolution: FloatProperty(
        name="Evolution", default=0.0, soft_min=0.0, soft_max=2.0,
        description="How often wisps change into others per second",
    )  # fmt: skip


class PhotonBeamsCurveSettings(bpy.types.PropertyGroup):
    """A curve that is beams."""

    enabled: BoolProperty(
        name="Beams", default=False,
        description="Render the splines as beams of light in fog, from their first points to their last, not as a mesh",
    )  # fmt: skip
    power: FloatProperty(
        name="Power", default=10.0, min=0.0, soft_max=1000.0, unit="POWER", description="Light of each spline, in watts"
    )
    color: FloatVectorProperty(
        name="Color", default=(1.0, 1.0, 1.0), min=0.0, soft_max=1.0, size=3, subtype="COLOR",
        description="Colour of the light",
    )  # fmt: skip
    radius: FloatProperty(
        name="Radius", default=0.05, min=1e-5, soft_max=1.0, unit="LENGTH",
        description="Radius of the beams in metres, where the radius of the curve's own points is 1",
    )  # fmt: skip
    look: look_property()


CLASSES = (PhotonBeamsLightSettings, PhotonBeamsWorldSettings, PhotonBeamsCurveSettings)
