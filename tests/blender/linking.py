"""Runs in Blender's Python, as `in_blender.py` does: lights that are linked to some things only.

python -I linking.py CASE FOLDER
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bpy
from in_blender import extension, matt, render, room, tell


def linked(name, *things, state="INCLUDE"):
    """Return a collection that links objects, or other collections."""
    made = bpy.data.collections.new(name)
    for each in things:
        (made.children if isinstance(each, bpy.types.Collection) else made.objects).link(each)
    for each in (*made.collection_objects, *made.collection_children):
        each.light_linking.link_state = state
    return made


def shader(name, kind, output, **inputs):
    """Return a material of one shader."""
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    node = tree.nodes.new(kind)
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs[output])
    return made


def cube(name, size, place, made):
    """Add a cube of a material."""
    bpy.ops.mesh.primitive_cube_add(size=size, location=place)
    thing = bpy.context.object
    thing.name = name
    thing.data.materials.append(made)
    return thing


def links(folder):
    """Render links of all kinds, by this engine and by Cycles."""
    scene = room(fog=0)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.photonbeams.passes = 16
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 128, False, 0
    bpy.data.objects.remove(bpy.data.objects["Fill"])
    matt()
    key, box, twin, floor = (bpy.data.objects[name] for name in ("Key", "Cube", "Twin", "Plane"))
    key.data.energy = 1000
    inner = linked("Inner", box)
    links = key.light_linking

    def both(name):
        for engine in ("PHOTONBEAMS", "CYCLES"):
            scene.render.engine = engine
            render(folder / f"{name}.{engine}.exr", passes=False)
        links.receiver_collection = links.blocker_collection = None
        key.data.use_shadow = True

    links.receiver_collection = linked("Empty")
    both("plain")
    links.receiver_collection = linked("Only", floor, twin)
    both("included")
    links.receiver_collection = linked("Not", linked("Outer", inner), state="EXCLUDE")
    both("excluded")
    links.blocker_collection = linked("Clear", box, state="EXCLUDE")
    both("without its shadow")
    key.data.use_shadow = False
    both("without shadows")
    fog = cube("Fog", 4, (0, 1, 2.2), shader("Fog", "ShaderNodeVolumeScatter", "Volume", Density=0.05))
    links.receiver_collection = linked("Surfaces", floor, box, twin)
    both("without fog")
    bpy.data.objects.remove(fog)
    copy = bpy.data.objects.new("Copy", None)
    copy.instance_type, copy.instance_collection = "COLLECTION", inner
    scene.collection.objects.link(copy)
    scene.collection.objects.unlink(box)
    links.receiver_collection = linked("Copies", copy, state="EXCLUDE")
    both("copy excluded")
    glowing = cube("Glow", 0.4, (-0.6, 1, 2.5), shader("Glow", "ShaderNodeEmission", "Surface", Strength=30.0))
    bpy.data.objects.remove(key)
    glowing.light_linking.receiver_collection = linked("Glows", twin, state="EXCLUDE")
    scene.photonbeams.passes, scene.cycles.samples = 64, 512
    for engine in ("PHOTONBEAMS", "CYCLES"):
        scene.render.engine = engine
        render(folder / f"glow.{engine}.exr", passes=False)


def told(folder):
    """Link a lamp to one of two fogs, and hide it from fog, and from mirrors; tell its prims and what is said."""
    from extension.reading.kept import Kept
    from extension.reading.scene import SceneReader

    room()
    key, fill = (bpy.data.objects[name] for name in ("Key", "Fill"))
    fog = cube("Fog", 1, (0, 1, 2), shader("Fog", "ShaderNodeVolumeScatter", "Volume"))
    key.light_linking.receiver_collection = linked("Fogs", fog)
    fill.visible_volume_scatter = fill.visible_diffuse = False
    said = []
    prims = SceneReader(bpy.context.evaluated_depsgraph_get(), Kept(str(folder)), said.append).prims()
    lamps = {each["path"]: {**each["values"], **each["targets"]} for each in prims if each["type"] == "SphereLight"}
    tell(lamps=lamps, said=said)


if __name__ == "__main__":
    extension.register()
    {each.__name__: each for each in (links, told)}[sys.argv[1]](Path(sys.argv[2]))
    extension.unregister()
