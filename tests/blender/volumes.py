"""Runs in Blender's Python, as `in_blender.py` does: volumes of grids.

python -I volumes.py CASE FOLDER

FOLDER has smoke.vdb, with the grids density and tint, and smoke_0001.vdb and smoke_0002.vdb.
"""

import math
import sys
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).parent))

import bpy
import numpy as np
from in_blender import extension, render, room, tell


def volume(name, file="", nodes=None, **inputs):
    """Add a volume object of a file, whose material has a shader of these inputs."""
    data = bpy.data.volumes.new(name)
    data.filepath = str(file)
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    if nodes is None:
        return thing
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    shader = tree.nodes.new(nodes)
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    data.materials.append(made)
    return thing


def numbers(count):
    """Return 0, 1, 2, … as Blender's own kind of array, which the grids of a domain are: here without a simulation."""
    image = bpy.data.images.new("Numbers", count // 4, 1, float_buffer=True)
    image.pixels.foreach_set(np.arange(count, dtype=np.float32))
    return image.pixels


def frame(folder):
    """Render smoke in the light of a spot, and export the scene as Blender does."""
    scene = room(fog=0)
    scene.world, scene.photonbeams.passes = None, 2  # a sky in smoke takes long
    smoke = volume(
        "Smoke",
        folder / "smoke.vdb",
        "ShaderNodeVolumePrincipled",
        Density=3.0,
        Color=(0.8, 0.6, 0.4, 1),
        Anisotropy=0.3,
    )
    smoke.location, smoke.scale, smoke.rotation_euler = (-0.3, 0.7, 1.4), (1.5, 1.5, 1.5), (0, 0, math.radians(30))
    bpy.data.objects.remove(bpy.data.objects["Twin"])
    render(folder / "frame.exr")
    bpy.ops.wm.usd_export(filepath=str(folder / "frame.usdc"), evaluation_mode="RENDER")


def reading(folder):
    """Read volumes of all kinds, and tell their prims and what is said."""
    from extension.reading.kept import Kept
    from extension.reading.scene import SceneReader
    from extension.reading.volumes import smoke_grid, vol_of

    scene = room(fog=0)
    file = folder / "smoke.vdb"
    scaled = volume("Scaled", file, "ShaderNodeVolumePrincipled", Density=2.0, Color=(0.5, 0.25, 1, 1))
    scaled.scale = 2, 2, 2
    volume("Tinted", file, "ShaderNodeVolumePrincipled", Color_Attribute="tint", Absorption_Color=(0.25, 0.25, 0.25, 1))
    volume("Hot", file, "ShaderNodeVolumePrincipled", Blackbody_Intensity=0.5, Temperature_Attribute="tint")
    thin = volume("Thin", file, "ShaderNodeVolumeScatter", Color=(1, 1, 1, 1))
    tree = thin.data.materials[0].node_tree
    info, half = tree.nodes.new("ShaderNodeVolumeInfo"), tree.nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value = "MULTIPLY", 0.5
    tree.links.new(info.outputs["Density"], half.inputs[0])
    tree.links.new(half.outputs[0], tree.nodes["Volume Scatter"].inputs["Density"])
    volume("Bare", file)
    volume("Missing", folder / "missing.vdb")
    volume("Empty")
    volume("Other", file, "ShaderNodeVolumePrincipled", Density_Attribute="mist")
    film = volume("Film", folder / "smoke_0001.vdb")
    film.data.is_sequence, film.data.frame_duration, film.data.frame_start = True, 2, 1
    filled = volume("Filled")
    bpy.ops.mesh.primitive_uv_sphere_add()
    made = filled.modifiers.new("Filled", "MESH_TO_VOLUME")
    made.object, made.voxel_amount, made.density = bpy.context.object, 8, 2
    scene.frame_set(2)
    said = []
    prims = SceneReader(bpy.context.evaluated_depsgraph_get(), Kept(str(folder)), said.append).prims()
    plain = [
        {**each, "matrix": np.asarray(each.get("matrix", np.eye(4))).tolist()}
        for each in prims
        if each["path"].startswith("/Objects/") and each["type"] != "Mesh"
    ]
    domain = SimpleNamespace(domain_resolution=(2, 3, 4), density_grid=numbers(192), color_grid=numbers(96))
    for name in ("density", "color"):
        (folder / f"{name}.vol").write_bytes(vol_of(smoke_grid(domain, name), (-1, -1, -1), (1, 2, 3)))
    tell(prims=plain, said=said, flame=smoke_grid(domain, "flame") is None)


if __name__ == "__main__":
    extension.register()
    {each.__name__: each for each in (frame, reading)}[sys.argv[1]](Path(sys.argv[2]))
    extension.unregister()
