"""Runs in Blender's Python, as `in_blender.py` does: curves, hair of particles, and points.

python -I hair.py CASE FOLDER
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
import numpy as np
from in_blender import extension, render, room, tell


def curves(name, places, kind=None):
    """Add a curves object, from the points of each curve."""
    data = bpy.data.hair_curves.new(name)
    data.add_curves([len(each) for each in places])
    data.points.foreach_set("position", np.concatenate(places).astype(np.float32).ravel())
    if kind is not None:
        data.set_types(type=kind)
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def dots():
    """Add a square whose corners geometry nodes make points of 10 cm."""
    bpy.ops.mesh.primitive_plane_add(size=2, location=(5, 0, 1))
    tree = bpy.data.node_groups.new("Dots", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    first, points, last = (
        tree.nodes.new(each) for each in ("NodeGroupInput", "GeometryNodeMeshToPoints", "NodeGroupOutput")
    )
    points.inputs["Radius"].default_value = 0.1
    tree.links.new(first.outputs[0], points.inputs[0])
    tree.links.new(points.outputs[0], last.inputs[0])
    bpy.context.object.name = "Dots"
    bpy.context.object.modifiers.new("Dots", "NODES").node_group = tree


def lawn():
    """Build a square that grows hair of half a metre, a third of it from parents; the square is hidden."""
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 2, 0), rotation=(np.pi / 2, 0, 0))
    square = bpy.context.object
    square.name = "Lawn"
    square.data.materials.append(bpy.data.materials.new("Grass"))
    square.modifiers.new("Hair", "PARTICLE_SYSTEM")
    system = square.particle_systems[0]
    system.name = "Blades"
    settings = system.settings
    settings.type, settings.count, settings.hair_length = "HAIR", 5, 0.5
    settings.root_radius, settings.tip_radius, settings.radius_scale = 1.0, 0.5, 0.02
    settings.child_type, settings.use_parent_particles = "SIMPLE", True
    settings.child_percent = settings.rendered_child_count = 2
    settings.child_radius = settings.child_roundness = 0
    settings.display_step = settings.render_step = 2
    square.show_instancer_for_viewport = square.show_instancer_for_render = False
    return square


def reading(folder):
    """Read all kinds, and tell their prims."""
    from extension.reading.kept import Kept
    from extension.reading.scene import SceneReader

    room(fog=0)
    straight = curves("Straight", [[(0, 0, 0), (0, 0, 1)], [(1, 0, 0), (1, 0, 0.5), (1, 0, 1)]], "POLY")
    straight.data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(5, 0.05, np.float32))
    curves("Bent", [[(0, 0, 0), (1, 0, 1), (2, 0, 0)]])
    curves("None", [[(0, 0, 0), (1, 0, 1)]]).data.remove_curves()
    dots()
    lawn()
    kept, said = Kept(str(folder)), []
    made = SceneReader(bpy.context.evaluated_depsgraph_get(), kept, said.append).prims()
    tell(
        prims=[
            {
                **each,
                "matrix": np.asarray(each.get("matrix", np.eye(4))).tolist(),
                "values": {
                    name: [kind, value.tolist() if hasattr(value, "tolist") else value, *rest]
                    for name, (kind, value, *rest) in each.get("values", {}).items()
                },
            }
            for each in made
        ],
        said=said,
    )


def frame(folder):
    """Render hair, without and with a lawn."""
    room(fog=0)
    render(folder / "without.exr")
    square = lawn()
    square.location, square.particle_systems[0].settings.radius_scale = (-0.5, 0, 0.5), 0.2
    render(folder / "with.exr")


if __name__ == "__main__":
    extension.register()
    {each.__name__: each for each in (reading, frame)}[sys.argv[1]](Path(sys.argv[2]))
    extension.unregister()
