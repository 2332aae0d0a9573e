"""Beams over surfaces that Cycles renders: two scenes of the same objects, and the compositor."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .engine import ENGINE
from .reading.media import extinction_of, has_volume, medium_of
from .reading.shading.materials import has_surface


class PHOTONBEAMS_OT_over_cycles(bpy.types.Operator):  # noqa: N801 - Blender wants these names
    """Let Cycles render the surfaces, Photon Beams the light in the fog, and the compositor add both"""  # noqa: D400 - a tool tip

    bl_idname = "photonbeams.over_cycles"
    bl_label = "Beams over Cycles"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether the scene is rendered by this engine."""
        return context.scene.render.engine == ENGINE

    def execute(self, context: Any) -> set[str]:
        """Set up the scenes."""
        scene = context.scene
        beams = scene.copy()
        beams.name, beams.photonbeams.surfaces = f"{scene.name} Beams", False
        beams.compositing_node_group = None
        scene.render.engine = "CYCLES"
        scene.render.use_compositing = True
        everywhere = has_volume(scene.world)
        if everywhere:
            scene.world = _dimming(scene.world)
        fogs = [each.name for each in scene.objects if _is_fog(each)]
        if fogs:
            names = ", ".join(fogs[:3]) + (" …" if fogs[3:] else "")
            self.report({"WARNING"}, f"Cycles renders the fog of {names}, too: exclude its collection in {scene.name}")
        scene.compositing_node_group = _added(scene, beams, "Image" if everywhere else "Beams")
        return {"FINISHED"}


def _dimming(world: Any) -> Any:
    """Return a copy of a world whose fog dims light as before, and scatters none: Cycles has no noise in it.

    No light of the sky comes through it; that in the picture comes with the beams.
    """
    medium = medium_of(world, lambda _: None)
    extinction = np.zeros(3) if medium is None else extinction_of(medium)
    found = world.copy()
    found.name = f"{world.name} without Beams"
    tree = found.node_tree
    absorbing = tree.nodes.new("ShaderNodeVolumeAbsorption")
    density = max(float(np.max(extinction)), 1e-30)
    absorbing.inputs["Density"].default_value = density
    absorbing.inputs["Color"].default_value = (*(1 - extinction / density), 1.0)
    for node in tree.nodes:
        if node.type == "OUTPUT_WORLD":
            tree.links.new(absorbing.outputs[0], node.inputs["Volume"])
    return found


def _is_fog(thing: Any) -> bool:
    """Return whether an object is nothing but fog."""
    materials = [each.material for each in thing.material_slots if each.material is not None]
    return thing.type == "VOLUME" or any(has_volume(each) and not has_surface(each) for each in materials)


def _added(scene: Any, beams: Any, name: str) -> Any:
    """Return a compositor: the surfaces and a pass of the beams."""
    tree = bpy.data.node_groups.new(f"{scene.name} with Beams", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    plate, light = (_placed(tree, "CompositorNodeRLayers", 0, -400 * row) for row in range(2))
    plate.scene, light.scene = scene, beams
    both = _placed(tree, "ShaderNodeMix", 300, 0)
    both.data_type, both.blend_type, both.inputs[0].default_value = "RGBA", "ADD", 1.0
    tree.links.new(plate.outputs["Image"], both.inputs[6])  # of the inputs named A and B those of colours
    tree.links.new(light.outputs[name], both.inputs[7])
    tree.links.new(both.outputs[2], _placed(tree, "NodeGroupOutput", 600, 0).inputs[0])
    return tree


def _placed(tree: Any, kind: str, x: float, y: float) -> Any:
    """Return a new node at a place."""
    node = tree.nodes.new(kind)
    node.location = x, y
    return node


CLASSES = (PHOTONBEAMS_OT_over_cycles,)
