"""Add > Photon Beams: a keyhole, a spot through blinds, and strands of light, at the 3D cursor."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, pi, radians, sin
from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector
from mathutils.geometry import tessellate_polygon

from .engine import ENGINE
from .reading.media import has_volume

_WALL = (1.5, 1.5)  # half of the width and of the height, in metres
_DENSITY = 0.05  # of a fog that is added, per metre
_BEHIND = 2.5  # how far walls are behind the cursor, in metres
_POWER = 2500.0  # of a spot 1 m behind a hole, in watts: its shaft is as bright as a lit wall


Outline = Sequence[tuple[float, float]]


def _keyhole() -> Outline:
    """Return the outline of a keyhole, 0.6 m high, counterclockwise: a disc, and a skirt that widens below it."""
    turn = np.linspace(radians(-60), radians(240), 33)
    return [(0.13 * cos(a), 0.13 * sin(a)) for a in turn] + [(-0.15, -0.47), (0.15, -0.47)]


def _rectangle(wide: float, high: float) -> Outline:
    """Return the outline of a rectangle of twice this size."""
    return [(wide, high), (-wide, high), (-wide, -high), (wide, -high)]


class _Adding(bpy.types.Operator):
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: Any) -> set[str]:
        """Add the things, select them, and add fog if the world has none."""
        for each in context.selected_objects:
            each.select_set(False)
        found = self.things()
        for thing in found:
            context.collection.objects.link(thing)
            if thing.parent is None:
                thing.matrix_world = Matrix.Translation(context.scene.cursor.location) @ thing.matrix_basis
            thing.select_set(True)
        context.view_layer.objects.active = found[0]
        _add_fog(context.scene)
        return {"FINISHED"}

    def things(self) -> list[Any]:
        """Return the new objects; those without a parent are where they are from the cursor."""
        raise NotImplementedError


def _filled(name: str, *outlines: Outline) -> Any:
    """Return a new object that is a mesh in the XZ plane: what is within an outline, but not within another one."""
    loops = [[Vector((x, 0, z)) for x, z in outline] for outline in outlines]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([point for loop in loops for point in loop], [], tessellate_polygon(loops))
    return bpy.data.objects.new(name, mesh)


def _lit_hole(name: str, outline: Outline, place: Any) -> list[Any]:
    """Return a wall, the portal in its hole, and a spot at a place behind it, which shines on the cursor."""
    wall, hole = _filled(name, _rectangle(*_WALL), outline), np.array(outline)
    wall.location = Vector(place) * (_BEHIND / place[1])
    (left, low), (right, high) = hole.min(axis=0), hole.max(axis=0)
    portal = _filled(f"{name} Portal", [(left, low), (right, low), (right, high), (left, high)])
    portal.display_type = "WIRE"
    light = bpy.data.lights.new(f"{name} Spot", "SPOT")
    light.energy = _POWER * Vector(place).length_squared
    light.shadow_soft_size = 0.02
    # A little more than the hole.
    light.spot_size = 2.4 * atan2(np.linalg.norm(hole, axis=1).max(), Vector(place).length)
    light.photonbeams.portal = portal
    spot = bpy.data.objects.new(light.name, light)
    spot.location = place
    spot.rotation_euler = (-spot.location).to_track_quat("-Z", "Y").to_euler()
    for each in (portal, spot):
        each.parent = wall
    return [wall, portal, spot]


class PHOTONBEAMS_OT_add_keyhole(_Adding):  # noqa: N801 - Blender wants these names
    """Add a wall with a keyhole, and a spot behind it whose beams are aimed at the hole."""

    bl_idname = "photonbeams.add_keyhole"
    bl_label = "Keyhole"

    def things(self) -> list[Any]:
        """Return the wall, its portal and the spot."""
        return _lit_hole("Keyhole", _keyhole(), (0.9, 1.5, 0.7))


class PHOTONBEAMS_OT_add_blinds(_Adding):  # noqa: N801
    """Add a wall with a window and its blinds, and a spot that shines through them."""

    bl_idname = "photonbeams.add_blinds"
    bl_label = "Spot Through Blinds"

    def things(self) -> list[Any]:
        """Return the wall with the blinds, the portal and the spot."""
        wide, high, count = 0.5, 0.6, 6
        step = 2 * high / count
        made = _lit_hole("Blinds", _rectangle(wide, high), (1.6, 3.0, 1.4))
        shape = bmesh.new()
        shape.from_mesh(made[0].data)
        for k in range(count):
            place, turn = (0, 0.09, (k + 0.5) * step - high), Euler((radians(-25), 0, 0))
            bmesh.ops.create_cube(shape, size=1, matrix=Matrix.LocRotScale(place, turn, (2 * wide, 0.18, 0.004)))
        shape.to_mesh(made[0].data)
        shape.free()
        return made


class PHOTONBEAMS_OT_add_strands(_Adding):  # noqa: N801
    """Add a curve whose splines are beams of light that wind around each other."""

    bl_idname = "photonbeams.add_strands"
    bl_label = "Strands"

    def things(self) -> list[Any]:
        """Return the curve."""
        curve = bpy.data.curves.new("Strands", "CURVE")
        curve.dimensions = "3D"
        for k in range(12):
            spline = curve.splines.new("BEZIER")
            spline.bezier_points.add(6)
            for j, point in enumerate(spline.bezier_points):
                turn, radius = 2 * pi * (k / 12 + j / 8), 0.15 + 0.25 * sin(pi * j / 6 + 0.4 * k) ** 2
                point.co = (radius * cos(turn), radius * sin(turn), j / 3)
                point.handle_left_type = point.handle_right_type = "AUTO"
        own = curve.photonbeams
        own.enabled, own.power, own.radius, own.color = True, 1.0, 0.012, (1.0, 0.7, 0.35)
        return [bpy.data.objects.new("Strands", curve)]


def _add_fog(scene: Any) -> None:
    """Give the world a thin fog unless it has a volume; a scene without a world gets a black one."""
    if scene.world is None:
        scene.world = bpy.data.worlds.new("World")
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    world = scene.world
    if world.node_tree is None or has_volume(world):
        return
    output = world.node_tree.get_output_node("ALL")
    if output is None:
        return
    fog = world.node_tree.nodes.new("ShaderNodeVolumeScatter")
    fog.location = output.location - Vector((200, 200))
    fog.inputs["Density"].default_value, fog.inputs["Anisotropy"].default_value = _DENSITY, 0.3
    world.node_tree.links.new(fog.outputs[0], output.inputs["Volume"])


class PHOTONBEAMS_MT_add(bpy.types.Menu):  # noqa: N801
    """Ready-made beams."""

    bl_label = "Photon Beams"

    def draw(self, _context: Any) -> None:
        """Draw the menu."""
        for name in ("keyhole", "blinds", "strands"):
            self.layout.operator(f"photonbeams.add_{name}")


def draw_entry(self: Any, context: Any) -> None:
    """Draw the entry in Blender's own menu."""
    if context.engine == ENGINE:
        self.layout.menu("PHOTONBEAMS_MT_add", icon="LIGHT_SPOT")


CLASSES = (PHOTONBEAMS_OT_add_keyhole, PHOTONBEAMS_OT_add_blinds, PHOTONBEAMS_OT_add_strands, PHOTONBEAMS_MT_add)
